"""The help of each command begins with an example that the command line accepts."""

import inspect
import shlex
from functools import wraps

import pytest

from dipcg.cli import commands, main
from dipcg.cli.examples import EXAMPLES


def test_every_command_has_an_example():
    assert EXAMPLES.keys() == commands.COMMANDS.keys()


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_example_is_a_command_line_of_this_command(name, monkeypatch):
    calls = []
    function = commands.COMMANDS[name]

    @wraps(function)
    def recorded(*args, **options) -> None:
        calls.append(inspect.signature(function).bind(*args, **options))

    monkeypatch.setitem(commands.COMMANDS, name, recorded)
    monkeypatch.setattr(commands, "train", recorded if name == "train" else commands.train)
    program, *words = shlex.split(EXAMPLES[name])
    assert program == "dipcg"
    main(words)
    assert len(calls) == 1


@pytest.mark.parametrize("name", EXAMPLES)
def test_help_begins_with_the_example(name, capsys):
    with pytest.raises(SystemExit) as end:
        main([*name.split(), "--help"])
    assert not end.value.code
    assert capsys.readouterr().out.startswith(f"example: {EXAMPLES[name]}\n")
