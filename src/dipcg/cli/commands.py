"""The commands, one function each. Nothing heavy is imported before a command needs it.

Exit codes: 0 for success, 1 for a failure that a sentence on stderr describes, 2 for a wrong command line.
"""

from __future__ import annotations

import io
import json as jsons
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from itertools import pairwise

import tyro
from tyro.conf import FlagCreatePairsOff

from dipcg.cli.addon import blender_addon
from dipcg.cli.assets import edit, sample
from dipcg.cli.code import ALLOW, allowed_code
from dipcg.cli.dataset import dataset_build, dataset_gallery, dataset_info
from dipcg.cli.estimate import estimate
from dipcg.cli.evaluate import evaluate
from dipcg.cli.examples import example_for
from dipcg.cli.generators import generators, generators_add, generators_check
from dipcg.cli.mcmc import mcmc
from dipcg.cli.serve import serve
from dipcg.cli.terminal import error_text
from dipcg.cli.train import import_checkpoint, train


def doctor(*, json: bool = False) -> None:
    """Say what is missing on this machine, and which command installs it.

    Args:
        json: print JSON
    """
    from dipcg.cli import doctor as checking

    checks = checking.checks()
    print(jsons.dumps([asdict(check) for check in checks], indent=1) if json else checking.report(checks))
    if not all(check.ok for check in checks):
        raise SystemExit(1)


ABOUT = "From a picture to the parameters of a procedural generator, and so to an exact, light, editable asset.\n\n"
ABOUT += f"Every command takes {ALLOW} FILE.py: a Python file that a data file names runs only so."
COMMANDS = {
    "generators": generators,
    "generators add": generators_add,
    "generators check": generators_check,
    "sample": sample,
    "estimate": estimate,
    "edit": edit,
    "dataset build": dataset_build,
    "dataset info": dataset_info,
    "dataset gallery": dataset_gallery,
    "train": train,
    "evaluate": evaluate,
    "mcmc": mcmc,
    "import-checkpoint": import_checkpoint,
    "serve": serve,
    "blender-addon": blender_addon,
    "doctor": doctor,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command; an error becomes one sentence on stderr and exit code 1."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    for stream in (sys.stdout, sys.stderr):
        # The name of a file may hold bytes that are no UTF-8, and a terminal may show ASCII alone.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    # tyro takes subcommands of one word alone.
    if " ".join(words[:2]) in COMMANDS:
        words[:2] = [" ".join(words[:2])]
    if example := example_for(words):
        print(example)
    try:
        words = allowed_code(words)
        commands = COMMANDS | {"train": _trainer(words)}
        tyro.extras.subcommand_cli_from_dict(
            commands, prog="dipcg", description=ABOUT, args=words, config=(FlagCreatePairsOff,)
        )
    except (ValueError, LookupError, RuntimeError, ImportError, OSError) as error:
        print(error_text(error), file=sys.stderr)
        raise SystemExit(1) from None
    except KeyboardInterrupt as interrupt:
        print(" ".join(["Stopped.", *map(str, interrupt.args)]), file=sys.stderr)
        raise SystemExit(130) from None


def _trainer(words: Sequence[str]) -> Callable[..., None]:
    """The train command with the defaults of the recipe that the words name, so that other flags still change them."""
    from dipcg.training.recipes import find_recipe

    given = [word.removeprefix("--recipe=") for word in words if word.startswith("--recipe=")]
    given += [after for word, after in pairwise(words) if word == "--recipe"]
    if words[:1] != ["train"] or not given:
        return train
    recipe = find_recipe(given[-1])
    return partial(train, recipe=given[-1], train=recipe.train, model=recipe.model)
