"""Code that runs inside a Blender process: reading Blender files, materials, baking, scenes and parts of meshes.

`bpy` and Infinigen are imported inside functions, and only child processes of `workers` call these functions; the
reader of TOML files also runs in the calling process, without Blender. A Blender
file becomes a TOML file, not code: it lists the inputs of the modifier as parameters, can be edited, runs nothing,
and holds the file's hash, so that a changed file is refused. Files are opened with scripts off, and the object is
evaluated alone in a scene of its own with one more modifier that turns instances into faces. `sockets` hides the
differences between Blender 3.4 and 5.3, because a file may need the Blender of its maker. `mirrors` is left out
of a new TOML file, because the mirror image of an asset may not be an asset of the same generator, and flipped
training pictures would then teach wrong parameters. Texture maps are baked as emitted light, because Cycles' own
passes give a metal no base colour: the value of a channel is linked to an emission in place of the shader. The caps
of a table's top are made again from its rim, because Infinigen leaves slits there, and printers and simulators need
closed solids.
"""
