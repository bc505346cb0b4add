"""Worker processes: whatever a generator does costs one sample, and nothing is left behind."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from dipcg.parameter_file import params_from_json
from dipcg.registry import allow_code
from dipcg.workers import memory
from dipcg.workers.pool import BuildPool
from dipcg.workers.process import BuildError, Child

pytestmark = pytest.mark.slow

GENERATOR = '''
"""A triangle that misbehaves on request."""
import os, signal, socket, stat, struct, subprocess, sys, tempfile, time
import numpy as np
from dipcg.space import Choice, ParameterSpace, Real

MODES = {modes}
space = ParameterSpace(Real("size", 1.0, 2.0), Choice("mode", MODES))
recycle_after = {recycle_after}
{extra}

TEXT = b'["progress", [0.5, "baking"]]'
PROGRESS = struct.pack("<QQ", len(TEXT) + 8, len(TEXT)) + TEXT

def to_parent():
    """The socket to the program that asks for builds."""
    return next(fd for fd in range(3, 64) if is_socket(fd))

def is_socket(fd):
    try: return stat.S_ISSOCK(os.fstat(fd).st_mode)
    except OSError: return False

def build(params):
    triangle = np.array([[0, 0, 0], [1, 0, 0], [0, params["size"], os.getpid()]], float), [[0, 1, 2]]
    mode = params["mode"]
    if mode == "raise": raise RuntimeError("no such leg")
    if mode == "novel": raise RuntimeError("a long\\nstory. " * 1000)
    if mode == "nan": return triangle[0] * np.nan, triangle[1]
    if mode == "empty": return np.zeros((0, 3)), np.zeros((0, 3))
    if mode == "index": return triangle[0], [[0, 1, 7]]
    if mode == "nothing": return None
    if mode == "hang": time.sleep(60)
    if mode == "exit": os._exit(3)
    if mode == "quit": sys.exit(3)
    if mode == "kill": os.kill(os.getpid(), signal.SIGKILL)
    if mode == "crash": os.kill(os.getpid(), signal.SIGSEGV)
    if mode == "close": os.closerange(3, 64); time.sleep(60)
    if mode == "half": os.write(to_parent(), struct.pack("<Q", 1000) + b"half"); time.sleep(60)
    if mode == "pickle": os.write(to_parent(), struct.pack("<Q", 4) + b"I01."); time.sleep(60)
    if mode == "progress":
        while True: os.write(to_parent(), PROGRESS); time.sleep(0.1)
    if mode == "child":
        pid = subprocess.Popen(["sleep", "60"]).pid
        return [triangle[0] + [[0, 0, 0], [0, 0, 0], [0, 0, pid - os.getpid()]], triangle[1]]
    if mode == "daemon":
        sleep = "sleep 60 >/dev/null & echo $!"
        pid = subprocess.run(["setsid", "sh", "-c", sleep], stdout=subprocess.PIPE, text=True).stdout
        return [triangle[0] + [[0, 0, 0], [0, 0, 0], [0, 0, int(pid) - os.getpid()]], triangle[1]]
    if mode == "slow": time.sleep(0.3)
    if mode == "memory":
        held = []
        while True: held.append(np.ones(10_000_000)); time.sleep(0.02)
    if mode == "litter": tempfile.mkdtemp()
    if mode == "noise":
        print("x" * 100_000, flush=True)
        os.write(1, b"y" * 100_000)
        os.write(2, b"z" * 100_000)
        sys.stdin.read()
    return triangle
'''
MODES = ("good", "raise", "nan", "empty", "index", "nothing", "hang", "exit", "quit", "kill", "crash", "close", "slow")
MODES += ("noise", "novel", "litter", "half", "pickle", "progress", "child", "daemon", "memory")


def write_generator(folder: Path, recycle_after: int = 1000, extra: str = "") -> str:
    path = folder / "triangle.py"
    path.write_text(GENERATOR.format(modes=MODES, recycle_after=recycle_after, extra=extra))
    allow_code(path)
    return str(path)


def params(mode: str = "good", size: float = 1.5) -> dict:
    return {"size": size, "mode": mode}


def reproduced(error: BuildError) -> tuple[str, dict]:
    """Generator and parameters from the hint of a failure, as `dipcg edit` reads them."""
    assert "`dipcg edit`" in error.hint
    return params_from_json(error.hint[error.hint.index("{") :])


def pid_of(mesh) -> int:
    """The process that built the mesh wrote its id into the third vertex."""
    return int(mesh.vertices[2, 2])


def is_alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


def wait_until(condition, seconds: float = 10.0) -> bool:
    deadline = time.monotonic() + seconds
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.02)
    return condition()


@pytest.fixture(scope="module")
def pool(tmp_path_factory):
    with BuildPool(write_generator(tmp_path_factory.mktemp("generator")), workers=1, timeout_s=1.0) as pool:
        yield pool


@pytest.mark.parametrize(
    ("mode", "reason", "sentence"),
    [
        ("raise", "raised", "RuntimeError: no such leg"),
        ("nan", "unusable", "3 of its 3 vertices are not finite"),
        ("empty", "unusable", "it has 0 vertices and 0 faces"),
        ("index", "unusable", "a face names vertex 7 of 3"),
        ("nothing", "raised", "TypeError"),
        ("hang", "timeout", "took longer than 1 s"),
        ("exit", "crashed", "exit code 3"),
        ("quit", "crashed", "exit code 3"),
        ("kill", "crashed", "exit code -9"),
        ("crash", "crashed", "exit code -11"),
        ("close", "crashed", "process died"),
        ("half", "timeout", "took longer than 1 s"),
        ("pickle", "crashed", "something else than a result"),
        ("progress", "crashed", "something else than a result"),
    ],
)
def test_a_failure_costs_one_sample_and_says_which(pool, mode, reason, sentence):
    with pytest.raises(BuildError) as error:
        pool.build(params(mode))
    assert error.value.reason == reason
    assert sentence in str(error.value)
    assert (error.value.generator, error.value.params) == (pool.generator.ref, params(mode))
    assert reproduced(error.value) == (pool.generator.ref, params(mode))
    assert pool.build(params()).vertices[2, 1] == 1.5, "the next build works"


@pytest.mark.parametrize("mode", ["raise", "nan"])
def test_a_raised_error_and_a_bad_mesh_keep_the_warm_process(pool, mode):
    before = pid_of(pool.build(params()))
    with pytest.raises(BuildError):
        pool.build(params(mode))
    assert pid_of(pool.build(params())) == before


def test_a_long_story_becomes_one_bearable_line(pool):
    with pytest.raises(BuildError, match=r"RuntimeError: a long story\. a long story\.") as error:
        pool.build(params("novel"))
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 1000


def test_a_stopped_process_is_gone(pool):
    before = pid_of(pool.build(params()))
    with pytest.raises(BuildError):
        pool.build(params("hang"))
    assert not is_alive(before)


def test_a_build_that_takes_too_much_memory_is_stopped_and_the_next_one_works(tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "MOST_BYTES", 3 * 2**29)
    with BuildPool(write_generator(tmp_path)) as pool:
        with pytest.raises(BuildError, match=r"needed more than 1\.5 GB of memory and was stopped\.") as error:
            pool.build(params("memory"))
        assert error.value.reason == "memory"
        assert pool.build(params()).vertices[2, 1] == 1.5


def test_the_memory_of_what_a_process_has_started_counts(tmp_path):
    program = "import sys; held = bytearray(b'x') * 300_000_000; print(flush=True); sys.stdin.read()"
    starts = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {program!r}])"
    with subprocess.Popen([sys.executable, "-c", starts], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        assert 3e8 < memory.used_bytes(process.pid) < 6e8
    assert memory.used_bytes(process.pid) == 0


def test_what_python_prints_reaches_the_terminal_and_neither_stdout_nor_the_pipe(tmp_path, capfd):
    with BuildPool(write_generator(tmp_path)) as pool:
        assert pool.build(params("noise")).vertices[2, 1] == 1.5
    # What is written from C, as by Blender, is dropped.
    assert capfd.readouterr() == ("", "x" * 100_000 + "\n")


def test_an_error_names_the_last_line_of_the_users_file(tmp_path):
    (tmp_path / "legs.py").write_text("import json\n\ndef legs():\n    return json.loads('no')\n")
    (tmp_path / "stool.py").write_text(
        "from dipcg.space import ParameterSpace, Real\nfrom legs import legs\n"
        "space = ParameterSpace(Real('size', 1.0, 2.0))\ndef build(params):\n    return legs()\n"
    )
    allow_code(tmp_path / "stool.py")
    with BuildPool(str(tmp_path / "stool.py")) as pool, pytest.raises(BuildError) as error:
        pool.build({"size": 1.0})
    assert str(error.value).endswith(" (legs.py, line 4).")


def test_files_beside_a_generator_are_found_from_any_folder(tmp_path, monkeypatch):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "beside_triangle.py").write_text("SIZE = 3.0\n")
    (tmp_path / "mine" / "corners.txt").write_text("0 0 0 1 0 0 0 1 0")
    (tmp_path / "mine" / "triangle.py").write_text(
        "import numpy as np\nfrom beside_triangle import SIZE\nfrom dipcg.space import ParameterSpace, Real\n"
        "space = ParameterSpace(Real('size', 1.0, float(open('corners.txt').read().split()[3]) + SIZE))\n"
        "def build(params):\n"
        "    return params['size'] * np.loadtxt('corners.txt').reshape(3, 3), [[0, 1, 2]]\n"
    )
    monkeypatch.chdir(tmp_path)
    allow_code("mine/triangle.py")
    with BuildPool("mine/triangle.py") as pool:
        assert pool.build({"size": 4.0}).side == 4.0


def test_results_come_in_order_with_errors_in_their_place(tmp_path):
    sizes = np.linspace(1, 2, 12).tolist()
    modes = ["slow", "good", "raise", "exit"] * 3
    with BuildPool(write_generator(tmp_path), workers=2, timeout_s=5.0) as pool:
        results = list(pool.map(params(mode, size) for mode, size in zip(modes, sizes, strict=True)))
    for mode, size, result in zip(modes, sizes, results, strict=True):
        if mode in ("raise", "exit"):
            assert isinstance(result, BuildError)
            assert result.params["size"] == size
        else:
            assert result.vertices[2, 1] == pytest.approx(size)


def test_mapping_reads_its_input_as_it_goes(tmp_path):
    read = 0

    def endless():
        nonlocal read
        while True:
            read += 1
            yield params()

    with BuildPool(write_generator(tmp_path)) as pool:
        results = pool.map(endless())
        for _ in range(5):
            next(results)
        assert read < 50


def test_two_workers_are_two_processes_that_agree_to_the_last_vertex(tmp_path):
    with BuildPool(write_generator(tmp_path), workers=2) as pool:
        meshes = list(pool.map([params("slow")] * 4))
    assert len({pid_of(mesh) for mesh in meshes}) == 2
    for mesh in meshes:
        np.testing.assert_array_equal(mesh.vertices[:, :2], meshes[0].vertices[:, :2])
        np.testing.assert_array_equal(mesh.faces, meshes[0].faces)


def test_processes_are_recycled_after_the_declared_number_of_builds(tmp_path):
    with BuildPool(write_generator(tmp_path, recycle_after=3)) as pool:
        pids = [pid_of(pool.build(params())) for _ in range(7)]
        assert len(set(pids[0:3])) == len(set(pids[3:6])) == 1
        assert len(set(pids)) == 3
        assert not any(is_alive(pid) for pid in pids[:6])


def test_slow_imports_do_not_count_as_build_time(tmp_path):
    slow = "def prepare(): time.sleep(1.0)"
    with BuildPool(write_generator(tmp_path, extra=slow), timeout_s=0.5) as pool:
        assert pool.build(params()).vertices[2, 1] == 1.5


def test_a_generator_that_cannot_start_says_so(tmp_path):
    broken = "def prepare(): raise ImportError('no Blender here')"
    with BuildPool(write_generator(tmp_path, extra=broken)) as pool, pytest.raises(BuildError) as error:
        pool.build(params())
    assert error.value.reason == "start"
    assert "ImportError: no Blender here" in str(error.value)


def test_a_missing_package_is_named_before_any_process_starts(tmp_path):
    with pytest.raises(ModuleNotFoundError, match="needs no_such_package: run `pip install"):
        BuildPool(write_generator(tmp_path, extra="needs = ('no_such_package',)"))
    with pytest.raises(LookupError, match="Did you mean 'box'"):
        BuildPool("boxx")


def test_closing_stops_even_a_hanging_build_at_once(tmp_path):
    with BuildPool(write_generator(tmp_path), timeout_s=60.0) as pool:
        pid = pid_of(pool.build(params()))
        future = pool.submit(params("hang"))
        waiting = pool.submit(params())
        time.sleep(0.2)
        started = time.monotonic()
    assert time.monotonic() - started < 5
    assert not is_alive(pid)
    assert isinstance(future.exception(), BuildError)
    assert waiting.cancelled()


@pytest.mark.parametrize("count", [2, 6])
def test_builds_that_hang_keep_no_other_build_waiting(tmp_path, count):
    """Two run beside the others; of six some are stopped, and not as if they had crashed."""
    with BuildPool(write_generator(tmp_path), workers=1, timeout_s=60.0) as pool:
        pool.share(0.3)
        hanging = [pool.submit(params("hang"), tries=2) for _ in range(count)]
        assert pool.build(params()).vertices[2, 1] == 1.5
        ended = [future for future in hanging if future.done()]
        assert len(ended) == max(0, count - 3)
        assert {future.exception().reason for future in ended} <= {"timeout"}


def test_the_lowest_priority_is_built_first_and_a_cancelled_build_never(tmp_path):
    done: list[str] = []
    with BuildPool(write_generator(tmp_path), workers=1) as pool:
        first = pool.submit(params("slow"))
        later, sooner, never = (pool.submit(params(), priority=priority) for priority in (2, 1, 0))
        for name, future in (("later", later), ("sooner", sooner)):
            future.add_done_callback(lambda _, name=name: done.append(name))
        assert never.cancel()
        later.result()
    assert first.done()
    assert done == ["sooner", "later"]


def test_a_file_of_the_working_folder_is_not_taken_for_a_module_of_python(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("random", "socket", "numpy", "dipcg"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('this is not the module')")
    with BuildPool("box") as pool:
        assert len(pool.build(pool.generator.space.sample(np.random.default_rng(0))).faces)


@pytest.mark.parametrize("mode", ["child", "daemon"])
def test_what_a_build_has_started_goes_with_its_worker(tmp_path, mode):
    """A process below the worker, and one that has left its group and its parent."""
    with BuildPool(write_generator(tmp_path)) as pool:
        started = pid_of(pool.build(params(mode)))
        assert is_alive(started)
    assert wait_until(lambda: not is_alive(started))


def test_what_a_build_has_started_goes_with_the_program(tmp_path):
    command = [sys.executable, "-c", SCRIPT.replace('"slow"', '"child"'), write_generator(tmp_path), "hang"]
    parent = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    started = {int(parent.stdout.readline()) for _ in range(4)}
    assert all(is_alive(pid) for pid in started)
    parent.kill()
    parent.wait()
    parent.stdout.close()
    assert wait_until(lambda: not any(is_alive(pid) for pid in started))


SCRIPT = """
import dipcg, sys
dipcg.allow_code(sys.argv[1])
from dipcg.workers.pool import BuildPool
with BuildPool(sys.argv[1], workers=2, timeout_s=60.0) as pool:
    for mesh in pool.map([{"size": 1.0, "mode": "slow"}] * 4):
        print(int(mesh.vertices[2, 2]), flush=True)
    futures = [pool.submit({"size": 1.0, "mode": sys.argv[2]}) for _ in range(2)]
    print("busy", flush=True)
    [future.result() for future in futures]
    print("idle", flush=True)
    import time; time.sleep(60)
"""


@pytest.mark.parametrize("stop", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM], ids=lambda stop: stop.name)
@pytest.mark.parametrize("doing", ["hang", "good"], ids=["during a build", "between builds"])
def test_no_process_outlives_its_parent(tmp_path, stop, doing):
    command = [sys.executable, "-c", SCRIPT, write_generator(tmp_path), doing]
    parent = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        # Background jobs of a shell ignore SIGINT.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    children = {int(parent.stdout.readline()) for _ in range(4)}
    while parent.stdout.readline().strip() != ("busy" if doing == "hang" else "idle"):
        pass
    time.sleep(0.2)
    assert all(is_alive(pid) for pid in children)
    os.kill(parent.pid, stop)
    parent.wait(timeout=10)
    parent.stdout.close()
    assert len(children) == 2
    assert wait_until(lambda: not any(is_alive(pid) for pid in children))


def test_folders_that_a_build_leaves_behind_go_with_its_worker(tmp_path, monkeypatch):
    ref = write_generator(tmp_path)
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    with BuildPool(ref) as pool:
        pool.build(params("litter"))
        assert [path.name for own in (tmp_path / "temporary").iterdir() for path in own.iterdir()]
    assert not list((tmp_path / "temporary").iterdir())


def test_progress_is_reported_however_often_before_the_result(monkeypatch):
    """More messages than Python's calls can be nested."""
    child, notes = Child("", "call"), []
    messages = iter([*[("progress", (0.5, "baking"))] * (2 * sys.getrecursionlimit()), ("done", "maps")])
    monkeypatch.setattr(child, "_next_message", lambda *_: next(messages))
    try:
        assert child.request(("", ()), 1.0, lambda share, note: notes.append(note)) == "maps"
    finally:
        child.stop()
    assert len(notes) == 2 * sys.getrecursionlimit()
