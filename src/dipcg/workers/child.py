"""The program that a child process runs: `python -m dipcg.workers.child build|call FILE_DESCRIPTOR GENERATOR`.

Blender runs here and nowhere else. Each message that is sent back is a pair of a kind and a value: "ready", "progress",
"done", or the reason of a failure (`workers.process.Reason`) with a sentence.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import os
import socket
import sys
import sysconfig
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from dipcg.generators import load_generator
from dipcg.mesh import MeshError
from dipcg.registry import allow_code
from dipcg.workers.messages import Channel

# The longest message of an error that is passed on, in characters.
MAX_CHARACTERS = 500
# From linux/prctl.h.
PR_SET_CHILD_SUBREAPER = 36

Message = tuple[str, Any]


def serve_builds(parent: Channel, ref: str) -> None:
    """Prepare a generator once, then build the mesh of each (params, detail) that the parent sends."""
    try:
        # The parent has loaded it too.
        allow_code(ref)
        generator = load_generator(ref)
        if ref.endswith(".py"):
            _show_prints()
            # What the file reads is found beside it, from whichever folder the command was typed in.
            os.chdir(Path(ref).parent)
        generator.prepare()
    except Exception as error:
        return parent.send(("start", f"The generator could not be loaded, {describe(error)}."))
    parent.send(("ready", None))
    while True:
        work = partial(generator.build, *parent.receive())
        parent.send(_outcome(work, "The generator raised {}.", MeshError, "unusable"))


def serve_calls(parent: Channel, _: str) -> None:
    """Call the function of `dipcg` for each (function, arguments) that the parent sends."""
    parent.send(("ready", None))
    while True:
        work = partial(_call, parent, *parent.receive())
        parent.send(_outcome(work, "Blender could not do this: {}.", ValueError, "raised"))


def _call(parent: Channel, name: str, arguments: tuple) -> Any:
    module, function = name.split(":")
    called = getattr(importlib.import_module(f"dipcg.{module}"), function)
    return called(lambda share, note: parent.send(("progress", (share, note))), *arguments)


def _outcome(work: Callable[[], Any], sentence: str, expected: type[Exception], kind: str) -> Message:
    """The result of some work, or the error it raised: the message of an expected one is a sentence already."""
    try:
        return "done", work()
    except expected as error:
        return kind, str(error)
    except Exception as error:
        return "raised", sentence.format(describe(error))


def _show_prints() -> None:
    """Send what Python prints to the terminal, and what Blender writes from C to nowhere, as its standard error is."""
    sys.stdout = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)


def describe(error: Exception) -> str:
    """The type and the message of an error in one line of limited length, and the line of a user's file it is from."""
    message = " ".join(str(error).split())[:MAX_CHARACTERS]
    return f"{type(error).__name__}: {message}".rstrip(".: ") + _place(error)


def _place(error: Exception) -> str:
    """The last line outside installed packages and this one, such as " (stool.py, line 12)"."""
    installed = (*map(sysconfig.get_path, ("stdlib", "purelib", "platlib")), str(Path(__file__).parents[1]), "<")
    frames = [f for f in traceback.extract_tb(error.__traceback__) if not f.filename.startswith(installed)]
    return f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""


def adopt_orphans() -> None:
    """Ask Linux to make this process the parent of what its children leave behind, so that it goes with this one."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1)


def main(kind: str, descriptor: str, ref: str) -> None:
    """Serve until the parent closes the socket."""
    adopt_orphans()
    # No program that a build starts may hold the socket open.
    os.set_inheritable(int(descriptor), False)
    serve = {"build": serve_builds, "call": serve_calls}[kind]
    with contextlib.suppress(EOFError, ConnectionError, KeyboardInterrupt):
        serve(Channel(socket.socket(fileno=int(descriptor))), ref)
    # Blender's own shutdown is slow and sometimes crashes.
    os._exit(0)


if __name__ == "__main__":
    main(*sys.argv[1:])
