"""Output in a terminal: progress bars, tables and errors."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dipcg.evaluation.tables import Table

Update = Callable[[int, str], None]


@contextlib.contextmanager
def bar(label: str, total: int) -> Iterator[Update]:
    """A progress bar with the time left if stderr is a terminal; the update takes the work done and a short note."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda done, note: None
        return
    text = TextColumn("{task.fields[note]}")
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total}"))
    with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), text, console=console) as progress:
        task = progress.add_task(label, total=total, note="")
        try:
            yield lambda done, note: progress.update(task, completed=done, note=note)
        except BaseException:
            # The bar vanishes, so that the sentence of the error stands alone.
            progress.live.transient = True
            raise


@contextlib.contextmanager
def counter(what: str) -> Iterator[Callable[[int], None]]:
    """A line that counts something if stderr is a terminal; it appears with the first update."""
    from rich.console import Console

    console = Console(stderr=True)
    status = console.status("")

    def update(count: int) -> None:
        if console.is_terminal:
            status.update(f"{count} {what}")
            status.start()

    try:
        yield update
    finally:
        status.stop()


def error_text(error: Exception) -> str:
    """The sentence of an error, and for a failed build also how to repeat it."""
    from dipcg.workers.process import BuildError

    if isinstance(error, BuildError):
        return f"{error} {error.hint}".rstrip()
    if isinstance(error, OSError) and error.filename:
        return f"{error.filename} cannot be used ({error.strerror})."
    return str(error.args[0] if error.args and isinstance(error, KeyError) else error)


def table(results: Table) -> str:
    """A Markdown table of means with 95 % intervals, one row per method; n is the number of pictures."""
    measured = {name for values in results.values.values() for name in values}
    names = [metric.name for metric in results.metrics if metric.name in measured]
    lines = ["| | n | " + " | ".join(names) + " | failed builds |", "|---" * (len(names) + 3) + "|"]
    for row, values in results.values.items():
        cells = [_cell(results, row, name) if name in values else "" for name in names]
        count = max(map(len, values.values()), default=0)
        lines.append(f"| {row} | {count} | " + " | ".join(cells) + f" | {results.failures[row]} |")
    return "\n".join(lines)


def differences(results: Table) -> str:
    """A Markdown table of each row minus the estimate in the first metric; empty without an estimate."""
    metric = results.metrics[0].name
    rows = [
        f"| {row} | {mean:+.3f} [{low:+.3f}, {high:+.3f}] |"
        for row, (mean, low, high) in results.differences(metric).items()
    ]
    return "\n".join([f"| | {metric}, less the estimate's |", "|---|---|", *rows]) if rows else ""


def _cell(results: Table, row: str, name: str) -> str:
    low, high = results.interval(row, name)
    return f"{results.mean(row, name):.3f} [{low:.3f}, {high:.3f}]"
