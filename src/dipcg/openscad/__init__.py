"""OpenSCAD files as generators: the Customizer's comments declare the parameters, and `openscad` builds.

The comments are read here, because OpenSCAD 2021.01, which Debian has, cannot export them; later versions can.
"""
