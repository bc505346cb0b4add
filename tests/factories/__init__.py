"""Infinigen's own assets, and the parameters with which our adapters make the same ones.

A file for each generator has `KEYS` (seeds or modes of some assets), `make(key)`, which runs Infinigen's factory and
returns vertices, faces and the factory's own parameters, and `params_of(own)`, which turns these into ours. Optional:
`ATOL`, the tolerance of the bounding box in metres; `LIGHT_TOLERANCE`, of the distance of light meshes in longest
sides; `VARIED`, parameters that differ among the assets; and `check(ours, theirs)`, which asserts more of two meshes.
"""
