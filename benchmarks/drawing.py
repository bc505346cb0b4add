"""Figures of the benchmarks as files."""

from pathlib import Path

from matplotlib.figure import Figure

from dipcg.files import written


def save_figure(figure: Figure, path: Path, dpi: int) -> None:
    """Write a figure whole or not at all; its folder is made if it is missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with written(path) as unfinished:
        figure.savefig(unfinished, dpi=dpi)
