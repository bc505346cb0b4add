"""Pictures of meshes with OpenGL through EGL: one code path for a GPU and for Mesa on a CPU.

Normals come from screen-space derivatives, so a mesh needs none and looks flat-shaded. A context belongs to the thread
that made it; make one renderer per thread.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from dipcg.camera import View, depth_range, fit, perspective, world_to_camera
from dipcg.materials import PALETTE
from dipcg.mesh import Mesh

MAX_LIGHTS = 3
# Ids of this process and of those it was forked from, if they have rendered.
_rendered_in: set[int] = set()


@dataclass(frozen=True)
class Look:
    """Colours and lights of a picture: everything about it that is neither shape nor camera.

    Colours are sRGB in [0, 1], one row per part (rows repeat when there are more parts); lights are directions from the
    object in camera axes with a strength each; `grain` is the contrast of a streaky solid texture, one number per
    part like the colours, `grain_scale` its streaks per metre along each axis. With `normals` the colours are the
    surface's normals in camera axes, from which lines can be drawn.
    """

    colours: Float[np.ndarray, "p 3"] = field(default_factory=lambda: PALETTE)
    lights: Float[np.ndarray, "l 3"] = field(default_factory=lambda: np.array([[0.5, 0.8, 0.6], [-0.8, 0.2, 0.5]]))
    strengths: Float[np.ndarray, " l"] = field(default_factory=lambda: np.array([0.6, 0.2]))
    ambient: float = 0.3
    grain: Float[np.ndarray, " p"] = field(default_factory=lambda: np.zeros(1))
    grain_scale: Float[np.ndarray, "3"] = field(default_factory=lambda: np.array([60.0, 60.0, 4.0]))
    normals: bool = False


def sample_look(rng: np.random.Generator, parts: int) -> Look:
    """Random materials and lights, from one plain colour to a texture and a colour for each part."""
    base = rng.uniform(0.05, 0.95, (1, 3)) if rng.random() < 0.6 else np.full((1, 3), rng.uniform(0.03, 0.97))
    spread = rng.choice([0.0, 0.05, 0.4])
    lights = rng.normal(size=(int(rng.integers(1, MAX_LIGHTS + 1)), 3)) * [1, 1, 0.7] + [0, 0.7, 0.5]
    return Look(
        colours=np.clip(base + rng.normal(size=(parts, 3)) * spread, 0.01, 0.99),
        lights=lights,
        strengths=rng.dirichlet(np.ones(len(lights))) * rng.uniform(0.3, 1.0),
        ambient=float(rng.uniform(0.15, 0.7)),
        grain=rng.uniform(0.1, 0.6, parts) * (rng.random(parts) < rng.choice([0.0, 0.0, 0.5, 1.0])),
        grain_scale=rng.permutation(np.exp(rng.uniform(np.log([30, 30, 2]), np.log([150, 150, 20])))),
    )


class Renderer:
    """An OpenGL context with square targets of `size` pixels and 4× multisampling.

    Raises RuntimeError with the command that helps when this machine has no working EGL.
    """

    def __init__(self, size: int = 256, samples: int = 4) -> None:
        self.size = size
        self._samples = samples
        self._loaded: tuple[Mesh, Any, list[tuple[int, int]]] | None = None

    def render(
        self, mesh: Mesh, view: View, look: Look | None = None, margin: float | None = None
    ) -> UInt8[np.ndarray, "size size 4"]:
        """Draw the mesh with straight alpha.

        With a `margin` the picture is cropped to the object as `images.crop_to_object` does; without, the field of
        view of `view` decides.
        """
        to_camera = world_to_camera(view, mesh.centre, mesh.side)
        projection = _projection(mesh, view, to_camera, margin)
        # Another renderer of this thread may have made its own context the current one.
        with self._context:
            self._draw(mesh, look or Look(), to_camera, projection)
            self._context.copy_framebuffer(self._resolved, self._multisampled)
            flat = np.frombuffer(self._resolved.read(components=4), np.uint8)
        return _straight_alpha(flat.reshape(self.size, self.size, 4)[::-1])

    def close(self) -> None:
        """Free the context."""
        with self._context:
            self._release()
        self._context.release()

    @property
    def device(self) -> str:
        """The name of the OpenGL renderer, e.g. llvmpipe for Mesa on a CPU."""
        with self._context:
            return str(self._context.info["GL_RENDERER"])

    @cached_property
    def _context(self) -> Any:
        return open_context()

    @cached_property
    def _program(self) -> Any:
        return self._context.program(vertex_shader=_VERTEX, fragment_shader=_FRAGMENT)

    @cached_property
    def _multisampled(self) -> Any:
        gl, square = self._context, (self.size, self.size)
        colour = gl.renderbuffer(square, 4, samples=self._samples)
        return gl.framebuffer([colour], gl.depth_renderbuffer(square, samples=self._samples))

    @cached_property
    def _resolved(self) -> Any:
        return self._context.simple_framebuffer((self.size, self.size), 4)

    def _draw(self, mesh: Mesh, look: Look, to_camera: np.ndarray, projection: np.ndarray) -> None:
        vertices, ranges = self._load(mesh)
        self._set_look(look)
        self._program["to_camera"].write(to_camera.T.astype("f4").tobytes())
        self._program["projection"].write(projection.T.astype("f4").tobytes())
        self._multisampled.use()
        self._multisampled.clear(0, 0, 0, 0)
        self._context.enable(self._context.DEPTH_TEST)
        for part, (first, count) in enumerate(ranges):
            self._program["colour"].value = tuple(look.colours[part % len(look.colours)])
            self._program["grain"].value = float(look.grain[part % len(look.grain)])
            vertices.render(self._context.TRIANGLES, vertices=count, first=first)

    def _set_look(self, look: Look) -> None:
        lights = np.zeros((MAX_LIGHTS, 4), "f4")
        unit = look.lights / np.linalg.norm(look.lights, axis=1, keepdims=True)
        lights[: len(unit)] = np.column_stack([unit, look.strengths])
        self._program["lights"].write(lights.tobytes())
        self._program["ambient"].value = look.ambient
        self._program["normals"].value = look.normals
        self._program["grain_scale"].value = tuple(look.grain_scale)

    def _load(self, mesh: Mesh) -> tuple[Any, list[tuple[int, int]]]:
        if self._loaded is None or self._loaded[0] is not mesh:
            self._release()
            order = np.argsort(mesh.parts, kind="stable")
            buffers = [
                self._context.buffer(np.ascontiguousarray(mesh.vertices)),
                self._context.buffer(np.ascontiguousarray(mesh.faces[order])),
            ]
            array = self._context.vertex_array(self._program, [(buffers[0], "3f", "position")], buffers[1])
            self._loaded = (mesh, (array, *buffers), _ranges(mesh))
        return self._loaded[1][0], self._loaded[2]

    def _release(self) -> None:
        for item in self._loaded[1] if self._loaded else ():
            item.release()
        self._loaded = None


def open_context() -> Any:
    """A context without a window; raises RuntimeError with the command that helps when there is no working EGL."""
    import moderngl

    if _rendered_in - {os.getpid()}:
        # Mesa would wait for threads that exist in the other process alone.
        raise RuntimeError(
            "This process was forked from one that had rendered, and OpenGL cannot go on there; "
            "start it with multiprocessing's `spawn`, or render in one of the two only."
        )
    _rendered_in.add(os.getpid())
    try:
        return moderngl.create_context(standalone=True, backend="egl")  # pyright: ignore[reportArgumentType]
    except Exception as error:
        raise RuntimeError(
            f"OpenGL through EGL could not be started ({error}). "
            "On Debian or Ubuntu run `apt-get install libegl1 libgl1-mesa-dri`, then `dipcg doctor`."
        ) from None


def _projection(mesh: Mesh, view: View, to_camera: np.ndarray, margin: float | None) -> np.ndarray:
    if margin is not None:
        return fit(mesh.vertices, to_camera, margin)
    depth = -(mesh.vertices @ to_camera[2, :3] + to_camera[2, 3])
    return perspective(view.fov_deg, *depth_range(np.maximum(depth, 1e-6)))


def _ranges(mesh: Mesh) -> list[tuple[int, int]]:
    """First index and number of indices of each part, once faces are sorted by part."""
    counts = 3 * np.bincount(mesh.parts, minlength=len(mesh.part_names))
    return list(zip((np.cumsum(counts) - counts).tolist(), counts.tolist(), strict=True))


def _straight_alpha(image: UInt8[np.ndarray, "h w 4"]) -> UInt8[np.ndarray, "h w 4"]:
    """Undo the blending with black that multisampling does at the silhouette."""
    out = image.copy()
    ys, xs = np.nonzero((image[..., 3] > 0) & (image[..., 3] < 255))
    edge = image[ys, xs].astype(np.float32)
    out[ys, xs, :3] = np.minimum(edge[:, :3] * 255 / edge[:, 3:], 255)
    return out


_VERTEX = """
#version 330
uniform mat4 to_camera;
uniform mat4 projection;
in vec3 position;
out vec3 seen;
out vec3 solid;
void main() {
    vec4 at = to_camera * vec4(position, 1);
    seen = at.xyz;
    solid = position;
    gl_Position = projection * at;
}
"""

_FRAGMENT = """
#version 330
uniform vec3 colour;
uniform vec4 lights[3];
uniform float ambient;
uniform float grain;
uniform bool normals;
uniform vec3 grain_scale;
in vec3 seen;
in vec3 solid;
out vec4 result;

float streaks(vec3 p) { return sin(p.x + 2.0 * sin(0.3 * p.y)) * sin(p.y + 2.0 * sin(0.4 * p.z)) * sin(p.z); }

void main() {
    vec3 normal = normalize(cross(dFdx(seen), dFdy(seen)));
    if (normals) { result = vec4(0.5 + 0.5 * normal, 1); return; }
    float light = ambient;
    for (int i = 0; i < 3; i++) light += lights[i].w * max(dot(normal, lights[i].xyz), 0.0);
    vec3 base = colour * colour;  // a gamma of 2: square and root cost a CPU less than pow
    if (grain > 0.0) base *= 1.0 + grain * streaks(solid * grain_scale);
    result = vec4(sqrt(clamp(base * light, 0.0, 1.0)), 1);
}
"""
