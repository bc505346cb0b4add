"""Small Blender files for tests/importing/test_blend.py; `python tests/importing/make_blends.py FOLDER` writes them."""

import contextlib
import os
import shutil
import sys
from pathlib import Path

import bpy

# Name, type, lowest and highest value, default, subtype.
KINDS = [
    ("Size", "Float", 1.0, 2.0, 1.5, "DISTANCE"),
    ("Höhe!", "Float", 1.0, 3.0, 2.0, "NONE"),
    ("size", "Float", None, None, 0.5, "NONE"),
    ("2nd Turn", "Float", -1.5707964, 1.5707964, 0.0, "ANGLE"),
    ("Fixed", "Float", 0.5, 0.5, 0.5, "NONE"),
    ("Hidden", "Float", 0.0, 1.0, 0.25, "NONE"),
    ("Few", "Int", 2, 5, 3, "NONE"),
    ("Many", "Int", 1, 100, 50, "NONE"),
    ("Shown", "Bool", None, None, True, ""),
    ("Shift", "Vector", -1.0, 1.0, (0.1, 0.2, 0.3), "TRANSLATION"),
    ("Turn", "Rotation", None, None, None, ""),
    ("Note", "String", None, None, None, ""),
    ("Other", "Object", None, None, None, ""),
]


def tree_of(inputs: list[tuple]) -> bpy.types.NodeTree:
    tree = bpy.data.node_groups.new("tree", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    for name, kind, low, high, default, subtype in inputs:
        item = tree.interface.new_socket(name, in_out="INPUT", socket_type=f"NodeSocket{kind}")
        if subtype:
            item.subtype = subtype
        if low is not None:
            item.min_value, item.max_value = low, high
        if default is not None:
            item.default_value = default
        item.hide_in_modifier = name == "Hidden"
    return tree


def box(tree: bpy.types.NodeTree, links: dict[str, str]) -> bpy.types.NodeTree:
    """A cube, moved and turned; `links` has inputs of the modifier by inputs of its nodes."""
    nodes = {kind: tree.nodes.new(f"GeometryNode{kind}") for kind in ("MeshCube", "Transform")}
    given, result = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    tree.links.new(nodes["MeshCube"].outputs[0], nodes["Transform"].inputs[0])
    tree.links.new(nodes["Transform"].outputs[0], result.inputs[0])
    for target, name in links.items():
        kind, socket = target.split(".")
        tree.links.new(given.outputs[name], nodes[kind].inputs[socket])
    return tree


def add(name: str, tree: bpy.types.NodeTree) -> bpy.types.Object:
    obj = bpy.data.objects.new(name, bpy.data.meshes.new(name))
    bpy.context.scene.collection.objects.link(obj)
    obj.modifiers.new("nodes", "NODES").node_group = tree
    return obj


def simple() -> bpy.types.NodeTree:
    return box(tree_of(KINDS[:1]), {"Transform.Scale": "Size"})


def kinds() -> None:
    links = {"Transform.Translation": "Shift", "Transform.Rotation": "Turn", "Transform.Scale": "Size"}
    add("Box", box(tree_of(KINDS), links | {"MeshCube.Vertices X": "Few", "MeshCube.Vertices Y": "Many"}))


def two() -> None:
    add("First", simple())
    add("Second", simple())
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Empty", None))


def plain() -> None:
    bpy.ops.mesh.primitive_cube_add()


def unseen() -> None:
    """Hidden, in a collection left out, on a modifier switched off, mirrored: still what the file describes."""
    obj = add("Box", simple())
    obj.hide_viewport, obj.scale, obj.location = True, (-1, 2, 1), (0, 0, 5)
    obj.modifiers[0].show_viewport = False
    bpy.context.scene.collection.objects.unlink(obj)
    left_out = bpy.data.collections.new("left out")
    bpy.context.scene.collection.children.link(left_out)
    left_out.objects.link(obj)
    bpy.context.view_layer.layer_collection.children[0].exclude = True


def instances() -> None:
    tree = tree_of(KINDS[:1])
    kinds = ("MeshLine", "InstanceOnPoints", "MeshCube", "SetMaterial")
    line, points, cube, paint = (tree.nodes.new(f"GeometryNode{kind}") for kind in kinds)
    result = tree.nodes.new("NodeGroupOutput")
    line.inputs["Count"].default_value = 3
    line.inputs["Offset"].default_value = (2, 0, 0)
    paint.inputs["Material"].default_value = bpy.data.materials.new("red")
    tree.links.new(line.outputs[0], points.inputs["Points"])
    tree.links.new(cube.outputs[0], paint.inputs[0])
    tree.links.new(paint.outputs[0], points.inputs["Instance"])
    tree.links.new(tree.nodes.new("NodeGroupInput").outputs["Size"], points.inputs["Scale"])
    join = tree.nodes.new("GeometryNodeJoinGeometry")
    tree.links.new(points.outputs[0], join.inputs[0])
    tree.links.new(cube.outputs[0], join.inputs[0])
    tree.links.new(join.outputs[0], result.inputs[0])
    add("Row", tree)


def curve() -> None:
    tree = tree_of(KINDS[:1])
    circle, result = tree.nodes.new("GeometryNodeCurvePrimitiveCircle"), tree.nodes.new("NodeGroupOutput")
    tree.links.new(circle.outputs[0], result.inputs[0])
    add("Ring", tree)


def mixed() -> None:
    """A cube, and beside it a curve and a point, which Blender draws without faces."""
    tree = box(tree_of(KINDS[:1]), {"Transform.Scale": "Size"})
    move = next(node for node in tree.nodes if node.type == "TRANSFORM_GEOMETRY")
    join = tree.nodes.new("GeometryNodeJoinGeometry")
    for kind in ("MeshCube", "CurvePrimitiveCircle", "Points"):
        tree.links.new(tree.nodes.new(f"GeometryNode{kind}").outputs[0], join.inputs[0])
    tree.links.new(join.outputs[0], move.inputs[0])
    add("Mixed", tree)


def bevelled() -> None:
    """A curve object with a round profile of its own."""
    bpy.ops.curve.primitive_bezier_circle_add()
    tree = tree_of(KINDS[:1])
    curve = tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    # Blender hands the curve to the first input alone.
    tree.interface.move(curve, 0)
    move, given = tree.nodes.new("GeometryNodeTransform"), tree.nodes.new("NodeGroupInput")
    tree.links.new(given.outputs["Geometry"], move.inputs[0])
    tree.links.new(given.outputs["Size"], move.inputs["Scale"])
    tree.links.new(move.outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0])
    bpy.context.object.data.bevel_depth = 0.1
    bpy.context.object.modifiers.new("nodes", "NODES").node_group = tree


def unlinked() -> None:
    """A curve object whose nodes give nothing at all."""
    bevelled()
    tree = bpy.context.object.modifiers[0].node_group
    tree.links.remove(next(link for link in tree.links if link.to_node.type == "GROUP_OUTPUT"))


def no_inputs() -> None:
    add("Box", box(tree_of(KINDS[-2:]), {}))


def linked() -> None:
    with bpy.data.libraries.load(str(FOLDER / "kinds.blend"), link=True) as (theirs, ours):
        ours.node_groups = theirs.node_groups
    add("Box", ours.node_groups[0])


def pictured(packed: bool) -> None:
    """A plane whose points a picture lifts, with a material that another picture colours."""
    image = bpy.data.images.new("height", 4, 4)
    image.filepath_raw, image.file_format = str(FOLDER / "height.png"), "PNG"
    image.save()
    image.source = "FILE"
    if packed:
        image.pack()
    tree = tree_of(KINDS[:1])
    grid, move, result = (
        tree.nodes.new(kind) for kind in ("GeometryNodeMeshGrid", "GeometryNodeSetPosition", "NodeGroupOutput")
    )
    texture = tree.nodes.new("GeometryNodeImageTexture")
    texture.inputs["Image"].default_value = image
    tree.links.new(tree.nodes.new("NodeGroupInput").outputs["Size"], grid.inputs["Size X"])
    tree.links.new(grid.outputs[0], move.inputs["Geometry"])
    tree.links.new(texture.outputs["Color"], move.inputs["Offset"])
    tree.links.new(move.outputs[0], result.inputs[0])
    coloured(add("Relief", tree))


def coloured(obj: bpy.types.Object) -> None:
    """A material with a picture that is not packed and not there, which changes no shape."""
    material = bpy.data.materials.new("wood")
    material.use_nodes = True
    image = bpy.data.images.new("wood", 4, 4)
    image.source, image.filepath = "FILE", "//wood.png"
    material.node_tree.nodes.new("ShaderNodeTexImage").image = image
    obj.data.materials.append(material)


def picture_packed() -> None:
    pictured(True)


def picture_beside() -> None:
    pictured(False)


def baked() -> None:
    """A box whose Bake node takes what it baked from a folder beside the file."""
    tree = simple()
    bake, result = tree.nodes.new("GeometryNodeBake"), tree.nodes["Group Output"]
    tree.links.new(result.inputs[0].links[0].from_socket, bake.inputs[0])
    tree.links.new(bake.outputs[0], result.inputs[0])
    modifier = add("Box", tree).modifiers[0]
    modifier.bake_directory = "//bakes"
    (FOLDER / "bakes").mkdir()


def cloth() -> None:
    """A box with cloth, whose motion lies in files."""
    modifier = add("Box", simple()).modifiers.new("cloth", "CLOTH")
    modifier.point_cache.use_external = True


def smoke(name: str = "Smoke") -> None:
    """A box, and smoke that Blender writes into a folder when it evaluates it: another object, or the box itself."""
    add("Box", simple())
    smoking = bpy.data.objects.get(name) or bpy.data.objects.new(name, bpy.data.meshes.new(name))
    if name == "Smoke":
        bpy.context.scene.collection.objects.link(smoking)
    smoking.data.from_pydata([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], [], [(0, 1, 3, 2)])
    modifier = smoking.modifiers.new("smoke", "FLUID")
    modifier.fluid_type = "DOMAIN"
    modifier.domain_settings.cache_type, modifier.domain_settings.resolution_max = "REPLAY", 6
    modifier.domain_settings.cache_directory = str(FOLDER / "written")


def smoking() -> None:
    smoke("Box")


def hoarder() -> None:
    """A box, and a picture that is no picture, which Blender is told to pack whenever it saves."""
    add("Box", simple())
    image = bpy.data.images.new("secret", 4, 4)
    image.source, image.filepath, image.use_fake_user = "FILE", str(FOLDER / "secret.txt"), True
    bpy.data.use_autopack = True


def sequence() -> None:
    """A relief whose picture is packed and yet read from the disk, as a sequence is."""
    pictured(True)
    bpy.data.images["height"].source = "SEQUENCE"


def sculpted() -> None:
    """A plane whose sculpted detail lies in a file beside the Blender file."""
    bpy.ops.mesh.primitive_plane_add()
    box = bpy.context.object
    box.modifiers.new("nodes", "NODES").node_group = simple()
    modifier = box.modifiers.new("detail", "MULTIRES")
    bpy.ops.object.multires_subdivide(modifier="detail")
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "sculpted.blend"))
    bpy.ops.object.multires_external_save(filepath=str(FOLDER / "detail.btx"), modifier=modifier.name)


def volume() -> None:
    """A box that needs a volume, which Blender reads from the disk though it is packed."""
    made = bpy.data.volumes.new("cloud")
    made.filepath = str(FOLDER / "cloud.vdb")
    Path(made.filepath).touch()
    bpy.ops.file.pack_all()
    tree = simple()
    tree.nodes.new("GeometryNodeObjectInfo").inputs["Object"].default_value = bpy.data.objects.new("cloud", made)
    add("Box", tree)


def driven(box: bpy.types.Object, target: str) -> bpy.types.Material:
    """A material of the box that a driver of its place reads."""
    material = bpy.data.materials.new("wood")
    material.use_nodes = True
    box.data.materials.append(material)
    driver = box.driver_add("location", 0).driver
    driver.type, variable = "SUM", driver.variables.new()
    variable.targets[0].id_type, variable.targets[0].id = "MATERIAL", material
    variable.targets[0].data_path = target
    return material


def pixels() -> None:
    """A box that stands where a pixel of a picture beside the file says, which only its material has."""
    material = driven(add("Box", simple()), 'node_tree.nodes["Image Texture"].image.pixels[0]')
    image = bpy.data.images.new("white", 4, 4)
    image.pixels = [1.0] * 64
    image.filepath_raw, image.file_format = str(FOLDER / "white.png"), "PNG"
    image.save()
    image.source = "FILE"
    material.node_tree.nodes.new("ShaderNodeTexImage").image = image


def through() -> None:
    """A box that stands where a material says, which asks an object whose mesh lies in a file."""
    material = driven(add("Box", simple()), '["place"]')
    material["place"] = 0.0
    other = bpy.data.objects.new("other", bpy.data.meshes.new("other"))
    bpy.context.scene.collection.objects.link(other)
    other.modifiers.new("cache", "MESH_CACHE").filepath = "//other.mdd"
    variable = material.driver_add('["place"]').driver.variables.new()
    variable.type, variable.targets[0].id = "TRANSFORMS", other


def trap() -> None:
    """A text that runs when Auto Run is on, and a driver that calls what it must not."""
    obj = add("Box", simple())
    text = bpy.data.texts.new("trap.py")
    ran = {what: f"open({str(FOLDER / what)!r}, 'w').close()" for what in ("text-ran", "driver-ran")}
    text.write(f"import bpy\n{ran['text-ran']}\n")
    text.write(f"bpy.app.driver_namespace['spring'] = lambda: {ran['driver-ran']} or 1.0\n")
    text.use_module = True
    driver = obj.driver_add("location", 0).driver
    driver.type, driver.expression = "SCRIPTED", "spring()"


if __name__ == "__main__":
    FOLDER = Path(sys.argv[1]).resolve()
    bpy.context.preferences.filepaths.save_version = 0
    usual = (kinds, two, plain, unseen, instances, curve, mixed, bevelled, unlinked, no_inputs, linked)
    outside = (picture_packed, picture_beside, baked, cloth, smoke, smoking, hoarder, sequence, sculpted)
    outside += (volume, pixels, through)
    for make in (*usual, trap, *outside):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        make()
        # Blender saves a file and then complains about what it cannot pack.
        with contextlib.suppress(RuntimeError) if make == hoarder else contextlib.nullcontext():
            bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / f"{make.__name__}.blend"), compress=True)
    # Made by saving the smoke.
    shutil.rmtree(FOLDER / "written")
    # Blender sometimes crashes when it shuts down.
    os._exit(0)
