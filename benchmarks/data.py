"""Data sets: pictures against Blender Cycles, bytes, decoding, workers and Ray nodes, side by side.

`DIPCG_BENCH_CHAIRS` is how many chairs are built for the comparisons of workers and of nodes, in shards of 15 so that
there is something to share out; their rates are from the first shard to the last, without the start.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.timing import header, machine, row, seconds
from dipcg.camera import View
from dipcg.data import store
from dipcg.data.cluster import Ray
from dipcg.data.codec import decode_mesh, encode_mesh
from dipcg.data.store import Executor, Local, Progress, build_dataset
from dipcg.generators import load_generator
from dipcg.images import MARGIN
from dipcg.mesh import Mesh
from dipcg.render import Renderer
from dipcg.workers.pool import BuildPool

CHAIRS, SHARD = int(os.environ.get("DIPCG_BENCH_CHAIRS", "180")), 15
VIEWS, CYCLES_VIEWS = 24, 3
# Bytes that the published recipe stores for a picture and its augmentations.
FEATURES = 6 * 256 * 768 * 4

CYCLES = """
import sys, time
import numpy as np
from dipcg.generators import load_generator
started = time.perf_counter()
chair = load_generator("chair")
chair.prepare()
started = time.perf_counter()
mesh = chair.build(chair.space.sample(np.random.default_rng(0)))
import bpy
built = time.perf_counter() - started
data = bpy.data.meshes.new("chair")
data.from_pydata(mesh.vertices.tolist(), [], mesh.faces.tolist())
scene = bpy.context.scene
scene.collection.objects.link(bpy.data.objects.new("chair", data))
camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
camera.location, camera.rotation_euler = (0.0, -3.0, 1.0), (1.4, 0.0, 0.0)
scene.collection.objects.link(camera)
lamp = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
scene.collection.objects.link(lamp)
scene.camera = camera
scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", 100
scene.render.resolution_x = scene.render.resolution_y = 256
scene.render.filepath = sys.argv[1]
bpy.ops.render.render(write_still=True)
started = time.perf_counter()
for _ in range(int(sys.argv[2])):
    bpy.ops.render.render(write_still=True)
print("measured", built, (time.perf_counter() - started) / int(sys.argv[2]), flush=True)
import os
os._exit(0)
"""


def main() -> None:
    print(machine() + "\n")
    meshes = _chairs()
    _against_cycles(meshes)
    packed = [encode_mesh(mesh) for mesh in meshes]
    each = float(np.mean([len(one) for one in packed]))
    ratio = VIEWS * FEATURES / each
    print(f"\nBytes for 20,000 chairs: {20_000 * each / 1e6:,.0f} MB; as features of {VIEWS} pictures in 6 versions")
    print(f"{20_000 * VIEWS * FEATURES / 1e12:.2f} TB, {ratio:,.0f} times as much.\n")
    decode = seconds(lambda: [decode_mesh(one) for one in packed])[0] / len(packed)
    print(f"Decoding: {1 / decode:,.0f} chairs a second on one core.\n")
    header("chairs built by", "a second", "ratio")
    _compare({"1 worker": Local(1), "2 workers": Local(2)}, [])
    _compare_nodes()


def _chairs() -> list[Mesh]:
    space = load_generator("chair").space
    with BuildPool("chair", workers=2) as pool:
        built = pool.map([space.sample(np.random.default_rng(seed)) for seed in range(16)])
        return [mesh for mesh in built if isinstance(mesh, Mesh)]


def _against_cycles(meshes: list[Mesh]) -> None:
    space = load_generator("chair").space
    with BuildPool("chair") as pool:
        build = seconds(lambda: pool.build(space.sample(np.random.default_rng(0)), "light"), 5)[0]
    renders = {size: _render_seconds(meshes, size) for size in (128, 256)}
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", CYCLES, str(Path(folder) / "chair.png"), str(CYCLES_VIEWS)]
        told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    full, cycles = map(float, next(line for line in told.splitlines() if line.startswith("measured")).split()[1:])
    header(f"one chair with {VIEWS} views", "build s", "view s", "total s", "ratio")
    theirs = full + VIEWS * cycles
    row("Blender Cycles, 256², 100 samples", f"{full:.2f}", f"{cycles:.2f}", f"{theirs:.1f}", 1)
    for size, view in renders.items():
        ours = build + VIEWS * view
        row(f"ours, {size}²", f"{build:.2f}", f"{view:.4f}", f"{ours:.2f}", f"{theirs / ours:.0f}")


def _render_seconds(meshes: list[Mesh], size: int) -> float:
    renderer = Renderer(size)
    views = [View(float(azimuth), 20.0) for azimuth in range(0, 360, 45)]
    draw = lambda: [renderer.render(mesh, view, margin=MARGIN) for mesh in meshes for view in views]  # noqa: E731
    taken = seconds(draw, 2)[0] / (len(meshes) * len(views))
    renderer.close()
    return taken


def _compare(ways: dict[str, Executor], rates: list[float]) -> None:
    """Build by each way and append its rate; ratios are to the first."""
    store.SHARD = SHARD
    for name, executor in ways.items():
        seen: list[tuple[float, int]] = []

        def note(progress: Progress, seen: list[tuple[float, int]] = seen) -> None:
            if progress.done >= SHARD:
                seen.append((time.perf_counter(), progress.done))

        with tempfile.TemporaryDirectory() as folder:
            build_dataset("chair", folder, CHAIRS, executor=executor, report=note)
        (started, first), (ended, last) = seen[0], seen[-1]
        rates.append((last - first) / (ended - started))
        row(name, f"{rates[-1]:.2f}", f"{rates[-1] / rates[0]:.2f}")


def _compare_nodes() -> None:
    try:
        import ray
        from ray.cluster_utils import Cluster
    except ImportError:
        return print("Ray is not installed: nodes are not compared.")
    rates: list[float] = []
    for nodes in (1, 2):
        cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0})
        for _ in range(nodes):
            cluster.add_node(num_cpus=1)
        _compare({f"{nodes} Ray node(s) of 1 processor": Ray(cluster.address)}, rates)
        ray.shutdown()
        cluster.shutdown()
    return None


if __name__ == "__main__":
    main()
