"""The command line: `dipcg COMMAND`. It is the top of the package, and nothing else imports it."""

from dipcg.cli.commands import main

__all__ = ["main"]
