"""Assets as files: each module of this folder writes one family of formats.

glTF is written by about a hundred lines of our own: the version of trimesh that Infinigen needs writes colours
without regard to sRGB, writes an image once for each use, and places parts by matrices. The tests read our files
with trimesh and with Khronos' validator. USD goes through usd-core, because Blender's exporter needs a process and
seconds for each file. OBJ and PLY are written by us too, because trimesh writes triangles alone. Files for Blender
and baked textures are made by functions of `blender` in a child process. Normals are split at creases of 35 degrees
in one place, `mesh/surface.py`, for files, for Blender, and for the tangent space of normal maps.
"""

from dipcg.export.asset import FORMATS, Asset, ExportError

__all__ = ["FORMATS", "Asset", "ExportError"]
