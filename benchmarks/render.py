"""Milliseconds a view on this machine's OpenGL."""

import numpy as np

from benchmarks.timing import header, machine, row, seconds
from dipcg.camera import View
from dipcg.mesh import Mesh, make_mesh
from dipcg.render import Renderer


def main() -> None:
    header("faces", "picture", "median ms", "95 % ms")
    for faces in (4_000, 8_000):
        for size in (128, 256):
            renderer = Renderer(size)
            mesh = ball(faces)
            median, late = seconds(lambda r=renderer, m=mesh: r.render(m, View(30, 20)), 100)
            row(len(mesh.faces), f"{size}²", f"{1e3 * median:.2f}", f"{1e3 * late:.2f}")
    print(f"\n{renderer.device}; {machine()}")


def ball(faces: int) -> Mesh:
    """A sphere of about so many triangles."""
    rings = int(np.sqrt(faces / 4))
    up, around = np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)
    grid = np.stack(
        np.broadcast_arrays(
            np.sin(up)[:, None] * np.cos(around), np.sin(up)[:, None] * np.sin(around), np.cos(up)[:, None]
        ),
        -1,
    )
    number = np.arange((rings + 1) * 2 * rings).reshape(rings + 1, -1)
    a, b, c, d = number[:-1], number[1:], np.roll(number, -1, 1)[1:], np.roll(number, -1, 1)[:-1]
    quads = np.stack([a, b, c, d], -1).reshape(-1, 4)
    return make_mesh(grid.reshape(-1, 3), np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]))


if __name__ == "__main__":
    main()
