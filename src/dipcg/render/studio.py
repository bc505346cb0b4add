"""Pictures of assets for people: materials, soft shadows and light from all around, by OpenGL through EGL.

Light comes from directions all over the sky and from a lamp, each with its own shadow map, and is added up. That gives
soft shadows, dark corners, and a shadow on the floor. Training pictures are drawn by `renderer.py`, which is faster.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from dipcg.camera import View, fit, world_to_camera
from dipcg.materials import Finish, linear, srgb
from dipcg.mesh import Mesh
from dipcg.mesh.pieces import pieces, split
from dipcg.render import open_context

# Directions of the sky and of the lamp, and the lamp's share of the light on what faces it.
SKY, LAMP, LAMP_SHARE = 24, 8, 0.6
# The lamp is above the camera on its left, and a tenth of its distance wide.
LAMP_FROM, LAMP_SIZE = (-0.6, 0.9, 0.5), 0.12
# How bright a white surface that faces the lamp and the sky is.
EXPOSURE = 1.25
# Light that comes up from the floor, as a share of that of the sky.
BOUNCE = 0.6
# Pixels of a shadow map, and of the picture for each pixel of the result, along a side.
SHADOW_SIDE, FINER = 512, 2
# How far from the surface, in longest sides, it is asked whether light arrives there.
LIFT = 0.006
# The shadow on the floor has faded so many longest sides from the middle, and is lighter than a real one.
FLOOR, FLOOR_SHADE = 1.4, 0.6
# The blur of the shadow on the floor, as a share of the picture's side: single shadows would show as stripes.
FLOOR_BLUR = 0.012


def draw(
    mesh: Mesh, finishes: Sequence[Finish], view: View, size: int = 384, margin: float = 0.06
) -> UInt8[np.ndarray, "size size 4"]:
    """The mesh and its shadow on the floor with straight alpha, framed as `render.Renderer` does with a margin.

    Raises RuntimeError with the command that helps when this machine has no working EGL.
    """
    context = open_context()
    try:
        with context:
            return _finished(_Stage(context, mesh, finishes, size * FINER).light(view, margin), size)
    finally:
        context.release()


class _Stage:
    """The mesh and the floor in a context, and the targets that they are drawn to."""

    def __init__(self, context: Any, mesh: Mesh, finishes: Sequence[Finish], size: int) -> None:
        self.context, self.mesh, self.size = context, mesh, size
        self.program = context.program(vertex_shader=_VERTEX, fragment_shader=_FRAGMENT)
        self.shapes = [(*self._loaded(*corners), finish) for corners, finish in _surfaces(mesh, finishes)]
        self.floor = self._loaded(*_floor(mesh))
        self.depth = context.depth_texture((SHADOW_SIDE, SHADOW_SIDE))
        self.depth.compare_func = ""
        context.blend_func, context.depth_func = (context.ONE, context.ONE), "<="
        self.shadow = context.framebuffer(depth_attachment=self.depth)
        colour = context.texture((size, size), 4, dtype="f4")
        self.picture = context.framebuffer([colour], context.depth_renderbuffer((size, size)))

    def light(self, view: View, margin: float) -> Float[np.ndarray, "n n 4"]:
        """Linear light of the object and the light on the floor as a share of that without the object."""
        to_camera = world_to_camera(view, self.mesh.centre, self.mesh.side)
        projection = fit(self.mesh.vertices, to_camera, margin)
        self._set("to_camera", to_camera)
        self._set("projection", projection)
        eye = -to_camera[:3, :3].T @ to_camera[:3, 3]
        self.program["eye"].value, self.program["up_light"].value = tuple(eye), BOUNCE * (1 - LAMP_SHARE)
        self.program["middle"].value, self.program["reach"].value = tuple(self.mesh.centre), FLOOR * self.mesh.side
        self.program["lift"].value = LIFT * self.mesh.side
        self.picture.use()
        self.picture.clear()
        self.context.enable_only(self.context.DEPTH_TEST | self.context.BLEND)
        # The nearest surface is found before light is added, so that none shines through.
        self.program["mode"].value = 3
        for array, count, _ in self.shapes:
            array.render(self.context.TRIANGLES, vertices=count)
        for number, (direction, weight) in enumerate(_directions(to_camera)):
            self._add(direction, weight, first=number == 0)
        flat = np.frombuffer(self.picture.read(components=4, dtype="f4"), np.float32)
        return flat.reshape(self.size, self.size, 4)[::-1]

    def _add(self, direction: np.ndarray, weight: float, first: bool) -> None:
        """Add the light of one direction."""
        gl = self.context
        self._set("to_light", _from_light(self.mesh, direction))
        self.shadow.use()
        self.shadow.clear()
        gl.enable_only(gl.DEPTH_TEST)
        self.program["mode"].value = 0
        for array, count, _ in self.shapes:
            array.render(gl.TRIANGLES, vertices=count)
        self.picture.use()
        gl.enable_only(gl.DEPTH_TEST | gl.BLEND)
        self.depth.use(0)
        self.program["light"].value, self.program["weight"].value = tuple(direction), weight
        self.program["first"].value = first
        for array, count, finish in self.shapes:
            self.program["mode"].value = 1
            self.program["base"].value = tuple(linear(np.array(finish.colour)))
            self.program["surface"].value = (max(finish.roughness, 0.3), finish.metallic)
            array.render(gl.TRIANGLES, vertices=count)
        self.program["mode"].value = 2
        self.floor[0].render(gl.TRIANGLES, vertices=self.floor[1])

    def _loaded(self, vertices: np.ndarray, normals: np.ndarray, faces: np.ndarray) -> tuple[Any, int]:
        content = np.column_stack([vertices, normals]).astype("f4").tobytes()
        buffers = self.context.buffer(content), self.context.buffer(faces.astype("i4").tobytes())
        layout = [(buffers[0], "3f 3f", "position", "normal")]
        return self.context.vertex_array(self.program, layout, buffers[1]), faces.size

    def _set(self, name: str, matrix: Float[np.ndarray, "4 4"]) -> None:
        self.program[name].write(matrix.T.astype("f4").tobytes())


def _surfaces(mesh: Mesh, finishes: Sequence[Finish]) -> Iterator[tuple[tuple[np.ndarray, ...], Finish]]:
    for piece in pieces(mesh):
        shape = split(piece)
        yield (shape.vertices, shape.normals, shape.faces), finishes[piece.part]


def _floor(mesh: Mesh) -> tuple[Float32[np.ndarray, "v 3"], Float32[np.ndarray, "v 3"], np.ndarray]:
    """Two triangles below the mesh."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32) * 2 * FLOOR * mesh.side
    corners += np.array([*mesh.centre[:2], mesh.bounds[0, 2] - 1e-4 * mesh.side], np.float32)
    return corners, np.tile(np.array([0, 0, 1], np.float32), (4, 1)), np.array([[0, 1, 2], [0, 2, 3]])


def _directions(to_camera: Float[np.ndarray, "4 4"]) -> Iterator[tuple[np.ndarray, float]]:
    """Directions to the light with their weights: a spiral over the sky, and one over the lamp."""
    number = np.arange(SKY) + 0.5
    height, turn = number / SKY, number * np.pi * (3 - np.sqrt(5))
    flat = np.sqrt(1 - height**2)
    sky = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), height])
    yield from ((direction, (1 - LAMP_SHARE) * 2 / SKY) for direction in sky)
    around = np.sqrt((np.arange(LAMP) + 0.5) / LAMP) * LAMP_SIZE
    turn = np.arange(LAMP) * np.pi * (3 - np.sqrt(5))
    seen = np.array(LAMP_FROM) + np.column_stack([around * np.cos(turn), around * np.sin(turn), np.zeros(LAMP)])
    lamp = seen @ to_camera[:3, :3]
    # It never shines from below.
    lamp[:, 2] = np.maximum(lamp[:, 2], 0.3)
    yield from ((direction / np.linalg.norm(direction), LAMP_SHARE / LAMP) for direction in lamp)


def _from_light(mesh: Mesh, direction: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """The parallel projection along the light that holds the whole mesh."""
    right = np.cross([0, 0, 1] if abs(direction[2]) < 0.9 else [0, 1, 0], direction)
    right /= np.linalg.norm(right)
    radius = float(np.linalg.norm(mesh.bounds[1] - mesh.bounds[0])) / 2 * 1.02
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, np.cross(direction, right), -np.asarray(direction)]) / radius
    matrix[:3, 3] = -matrix[:3, :3] @ mesh.centre
    return matrix


def _finished(light: Float[np.ndarray, "n n 4"], size: int) -> UInt8[np.ndarray, "size size 4"]:
    """The picture with straight alpha: the object in sRGB over its black shadow."""
    object_ = light[..., 3:] < 0
    alpha = np.where(object_, 1, FLOOR_SHADE * _blurred(light[..., 3:].clip(0, 1), ~object_))
    premultiplied = np.concatenate([np.where(object_, srgb(EXPOSURE * light[..., :3]), 0), alpha], 2)
    small = premultiplied.reshape(size, FINER, size, FINER, 4).mean((1, 3))
    straight = small[..., :3] / np.maximum(small[..., 3:], 1e-6)
    return np.rint(255 * np.clip(np.concatenate([straight, small[..., 3:]], 2), 0, 1)).astype(np.uint8)


def _blurred(missing: Float[np.ndarray, "n n 1"], floor: Bool[np.ndarray, "n n 1"]) -> Float[np.ndarray, "n n 1"]:
    """The light that is missing on the floor, blurred; what the object hides of the floor does not count."""
    import cv2

    shares = floor.astype(np.float32)
    both = np.concatenate([missing * shares, shares], 2)
    sums = cv2.GaussianBlur(both, (0, 0), FLOOR_BLUR * len(missing))
    return sums[..., :1] / np.maximum(sums[..., 1:], 1e-3)


_VERTEX = """
#version 330
uniform mat4 to_camera, projection, to_light;
uniform int mode;
in vec3 position, normal;
out vec3 at, facing;
void main() {
    at = position;
    facing = normal;
    gl_Position = (mode == 0 ? to_light : projection * to_camera) * vec4(position, 1);
}
"""

# What is drawn: 0 the depth as the light sees it, 1 the object, 2 the floor, 3 the depth as the camera sees it.
# The fourth channel is -1 at the object and the light that is missing at the floor.
_FRAGMENT = """
#version 330
uniform sampler2D shadows;
uniform int mode;
uniform bool first;
uniform vec3 base, eye, light, middle;
uniform vec2 surface;
uniform float weight, up_light, reach, lift;
uniform mat4 to_light;
in vec3 at, facing;
out vec4 result;

float lit(vec3 point) {
    vec3 place = 0.5 + 0.5 * (to_light * vec4(point, 1)).xyz;
    if (any(lessThan(place.xy, vec2(0))) || any(greaterThan(place.xy, vec2(1)))) return 1.0;
    float nearest = texture(shadows, place.xy).r;
    return nearest < 1.0 && place.z > nearest ? 0.0 : 1.0;
}

void main() {
    if (mode == 0 || mode == 3) { result = vec4(0); return; }
    if (mode == 2) {
        float fade = 1.0 - smoothstep(0.4, 1.0, length(at.xy - middle.xy) / reach);
        result = vec4(0, 0, 0, fade * weight * light.z * (1.0 - lit(at)));
        return;
    }
    vec3 to_eye = normalize(eye - at);
    vec3 normal = normalize(facing);
    if (dot(normal, to_eye) < 0.0) normal = -normal;
    float slope = max(dot(normal, light), 0.0);
    float bright = weight * slope * (slope > 0.0 ? lit(at + lift * (normal + light)) : 0.0);
    vec3 halfway = normalize(light + to_eye);
    float shine = 2.0 / pow(surface.x, 4.0);
    float gloss = (shine + 2.0) / 8.0 * pow(max(dot(normal, halfway), 0.0), shine);
    vec3 colour = base * (1.0 - 0.5 * surface.y) + mix(vec3(0.04), base, surface.y) * gloss;
    vec3 ambient = first ? base * up_light * (0.5 - 0.5 * normal.z) : vec3(0);
    result = vec4(colour * bright + ambient, first ? -1.0 : 0.0);
}
"""
