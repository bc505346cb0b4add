"""What a Blender file needs from outside of it, which may change, be missing, or be nobody's business.

It runs in child processes with Blender. A file that needs any of it is refused, so that nothing else is read.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Any


def needed_by(obj: Any, without: tuple[type, ...] = ()) -> set[Any]:
    """All data blocks that an object needs, directly or through others, and itself; none of or through some types."""
    import bpy

    uses = defaultdict(set)
    for used, users in bpy.data.user_map().items():
        for user in users:
            uses[user].add(used)
    needed, todo = {obj}, [obj]
    while todo:
        new = {block for block in uses[todo.pop()] - needed if not isinstance(block, without)}
        needed |= new
        todo += new
    return needed


def trees(needed: Iterable[Any]) -> list[Any]:
    """The node trees among data blocks."""
    import bpy

    return [block for block in needed if isinstance(block, bpy.types.NodeTree)]


def check_nothing_outside(path: str, obj: Any) -> None:
    """Raise ValueError with a sentence when the shape of an object needs data or files outside the Blender file."""
    import bpy

    needed = needed_by(obj)
    linked = {f"the {b.bl_rna.name.lower()} {b.name!r} of {b.library.filepath}" for b in needed if b.library}
    # A driver may read what else a material has; its pictures are forgotten before anything is built.
    pictures = needed_by(obj, without=(bpy.types.Material,))
    shaping = {block for block in needed if block in pictures or not isinstance(block, bpy.types.Image)}
    outside = linked | _files(shaping) | set(_caches(shaping))
    if outside:
        raise ValueError(
            f"The object {obj.name!r} in {path} needs {', '.join(sorted(outside))}. In Blender, make it local "
            "(Object > Relations > Make Local), pack it (File > External Data) or apply its modifier, and save."
        )
    readers = sorted({node.name for tree in trees(shaping) for node in tree.nodes if _reads_a_file(node)})
    if readers:
        raise ValueError(
            f"The object {obj.name!r} in {path} has nodes that read other files: {', '.join(readers)}. In Blender, "
            "import what they read, use Object Info nodes in their place, and save."
        )


def forget_pictures() -> None:
    """Leave no path in the pictures that lie outside the Blender file, so that nothing can read them."""
    import bpy

    for image in bpy.data.images:
        if not _is_inside(image):
            image.filepath_raw = ""


def _files(needed: Iterable[Any]) -> set[str]:
    """The files of pictures, fonts, volumes, sounds and the like that are not packed."""
    import bpy

    blocks = [b for b in needed if not isinstance(b, (bpy.types.Text, bpy.types.Library))]
    files = {b.filepath for b in blocks if isinstance(getattr(b, "filepath", None), str) and not _is_inside(b)}
    return files - {"", "<builtin>"}


def _is_inside(block: Any) -> bool:
    """Whether Blender reads what is packed, or makes it: it reads films, sequences and volumes from their paths."""
    import bpy

    source = getattr(block, "source", "FILE")
    if source != "FILE" or isinstance(block, bpy.types.Volume):
        return source == "GENERATED"
    return bool(getattr(block, "packed_file", None)) and not getattr(block, "use_multiview", False)


def _reads_a_file(node: Any) -> bool:
    """Whether a node reads a file that a path names, as the Import nodes of Blender 4.5 do."""
    if node.bl_idname.startswith("GeometryNodeImport"):
        return True
    takes_path = any(socket.bl_idname == "NodeSocketStringFilePath" for socket in node.inputs)
    return takes_path and node.bl_idname != "GeometryNodeGroup"


def _caches(needed: Iterable[Any]) -> Iterator[str]:
    """Motion and sculpted detail that lie in files beside the Blender file."""
    import bpy

    for obj in needed:
        for modifier in obj.modifiers if isinstance(obj, bpy.types.Object) else ():
            if (modifier.type == "MESH_CACHE" and modifier.filepath) or getattr(modifier, "is_external", False):
                yield modifier.filepath
            elif modifier.type == "NODES":
                yield from filter(_exists, _bakes(modifier))
            elif _is_cached(modifier):
                yield f"the cache of its modifier {modifier.name!r}"


def _bakes(modifier: Any) -> Iterator[str]:
    """The folders of baked nodes and simulations, which Blender also reads where a bake is to be packed and is not."""
    for bake in modifier.bakes if hasattr(modifier, "bakes") else ():
        yield bake.directory if bake.use_custom_path else modifier.bake_directory


def _is_cached(modifier: Any) -> bool:
    """Whether a simulation reads what it made before from files."""
    domain = getattr(modifier, "domain_settings", None)
    if modifier.type == "OCEAN":
        return modifier.is_cached
    if domain is not None:
        # It also writes into that folder, which may be anywhere.
        return True
    cache = getattr(getattr(modifier, "particle_system", modifier), "point_cache", None)
    return cache is not None and (cache.use_disk_cache or cache.use_external)


def _exists(folder: str) -> bool:
    import bpy

    return bool(folder) and os.path.isdir(bpy.path.abspath(folder))
