"""The command line: `dipcg COMMAND`. It is the top of the package, and nothing else imports it.

Each command is a function whose signature and docstring define its flags and its help. Heavy packages are imported
inside the functions, so that `dipcg --help` loads neither torch nor Blender. `commands.py` lists the commands; it
is not called `main.py`, because the function `main`, which this package exports, would hide a module of that name.
A single picture starts one worker, because starting a second Blender takes longer than it saves. Errors that a user
can cause are printed as one sentence, without a traceback.
"""

from dipcg.cli.commands import main

__all__ = ["main"]
