"""The camera that took a picture: it sees the object where the picture shows it, and the picture behind it.

Azimuth 0 looks at the front (from -Y) and grows counter-clockwise seen from above; the distance is from the centre of
the bounding box in multiples of its longest side. Of the picture, the object's rectangle says the size and the place.
"""

from __future__ import annotations

from array import array
from math import cos, radians, sin
from typing import Any

import bpy
from mathutils import Matrix, Vector

NAME = "dipcg camera"
# The least alpha that belongs to the object.
VISIBLE = 0.125
Box = tuple[float, float, float, float]


def place(context: bpy.types.Context, points: list[Vector], view: dict[str, float], picture: str, cutout: str) -> Any:
    """Put the camera before points in world axes, with the files of a picture and of its cut-out."""
    image, box = _load(picture), _object_box(cutout)
    obj = _camera(context)
    obj.matrix_world = _stand(points, view)
    _frame(obj.data, [obj.matrix_world.inverted() @ point for point in points], box, tuple(image.size))
    _show_behind(obj.data, image)
    render = context.scene.render
    (render.resolution_x, render.resolution_y), render.resolution_percentage = image.size, 100
    render.pixel_aspect_x = render.pixel_aspect_y = 1
    context.scene.camera = obj
    return obj


def points_of(context: bpy.types.Context, root: Any) -> list[Vector]:
    """The corners of all faces of an object, of its instances and of the objects below it, in world axes."""
    family = {root, *root.children_recursive}
    graph = context.evaluated_depsgraph_get()
    graph.update()
    found = []
    for instance in graph.object_instances:
        owner = instance.parent if instance.is_instance else instance.object
        if owner.original in family and instance.object.type == "MESH":
            matrix = instance.matrix_world.copy()
            found += [matrix @ vertex.co for vertex in instance.object.data.vertices]
    return found


def _stand(points: list[Vector], view: dict[str, float]) -> Matrix:
    low, high = ([pick(axis) for axis in zip(*points, strict=True)] for pick in (min, max))
    side, centre = max(b - a for a, b in zip(low, high, strict=True)), (Vector(low) + Vector(high)) / 2
    azimuth, elevation = radians(view["azimuth_deg"]), radians(view["elevation_deg"])
    back = Vector((sin(azimuth) * cos(elevation), -cos(azimuth) * cos(elevation), sin(elevation)))
    right = Vector((cos(azimuth), sin(azimuth), 0))
    turned = Matrix((right, back.cross(right), back)).transposed().to_4x4()
    return Matrix.Translation(centre + back * view["distance"] * side) @ turned


def _frame(camera: Any, seen: list[Vector], box: Box, size: tuple[int, int]) -> None:
    """Give the camera the focal length and the shift with which the points fill the rectangle of the picture."""
    slopes = [(p.x / -p.z, p.y / -p.z) for p in seen]
    (left, bottom), (right, top) = ([pick(axis) for axis in zip(*slopes, strict=True)] for pick in (min, max))
    longer = max(size)
    scale = max(box[2] - box[0], box[3] - box[1]) / max(right - left, top - bottom) / longer
    camera.type, camera.sensor_fit, camera.lens_unit = "PERSP", "AUTO", "MILLIMETERS"
    camera.lens = camera.sensor_width * scale
    camera.shift_x = (left + right) / 2 * scale - ((box[0] + box[2]) / 2 - size[0] / 2) / longer
    camera.shift_y = (bottom + top) / 2 * scale - ((box[1] + box[3]) / 2 - size[1] / 2) / longer


def _object_box(path: str) -> Box:
    """Left, bottom, right and top of what can be seen of a cut-out, in pixels from the lower left."""
    image = bpy.data.images.load(path)
    width, height = image.size
    pixels = array("f", bytes(16 * width * height))
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    alpha = pixels[3::4]
    rows = [y for y in range(height) if max(alpha[y * width : (y + 1) * width]) > VISIBLE]
    columns = [x for x in range(width) if max(alpha[x::width]) > VISIBLE]
    if not rows:
        return 0, 0, width, height
    return columns[0], rows[0], columns[-1] + 1, rows[-1] + 1


def _load(path: str) -> Any:
    image = bpy.data.images.load(path)
    image.name = "dipcg picture"
    # The file is a temporary one.
    image.pack()
    return image


def _camera(context: bpy.types.Context) -> Any:
    """The camera that was made for an earlier candidate, or a new one."""
    found = context.scene.objects.get(NAME)
    if found and found.type == "CAMERA":
        return found
    made = bpy.data.objects.new(NAME, bpy.data.cameras.new(NAME))
    context.scene.collection.objects.link(made)
    return made


def _show_behind(camera: Any, image: Any) -> None:
    camera.background_images.clear()
    behind = camera.background_images.new()
    behind.image, behind.alpha, behind.display_depth, behind.frame_method = image, 0.6, "BACK", "FIT"
    camera.show_background_images = True
