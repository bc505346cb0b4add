"""Which Python files, and programs that TOML files name, may run: those that stand on the command line."""

from __future__ import annotations

from argparse import ArgumentParser
from collections.abc import Sequence

from dipcg.registry import allow_code, is_path

ALLOW = "--allow-code"


def allowed_code(words: Sequence[str]) -> list[str]:
    """Let the code of the files run that the words of a command name, and return the words without `--allow-code`."""
    # Every command takes the flag, so it is read before tyro reads those of one command.
    parser = ArgumentParser("dipcg", add_help=False, allow_abbrev=False)
    parser.add_argument(ALLOW, action="append", default=[])
    given, rest = parser.parse_known_args(words)
    # `--encoder=mine.py` names a file too.
    allow_code(*given.allow_code, *(word.rpartition("=")[2] for word in rest if is_path(word)))
    return rest
