"""A folder of pictures becomes a folder of assets with a page that shows them all; a second run does the rest."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from urllib.parse import quote

from dipcg.files import write_file
from dipcg.images import SUFFIXES

PAGE = "index.html"


class BatchError(ValueError):
    """A folder of pictures cannot be used; the message says why and what to do."""


@dataclass(frozen=True)
class Files:
    """The files that are written for one picture; the preview is written last."""

    asset: Path
    params: Path
    preview: Path

    @property
    def done(self) -> bool:
        return all(path.is_file() for path in (self.asset, self.params, self.preview))


@dataclass(frozen=True)
class Batch:
    """Pictures, the files that are written for each in the folder `out`, and what else is beside the pictures."""

    out: Path
    files: Mapping[Path, Files]
    others: Sequence[Path] = ()

    @property
    def waiting(self) -> list[Path]:
        """The pictures of which a file is missing."""
        return [picture for picture, files in self.files.items() if not files.done]

    def write_page(self, problems: Mapping[Path, str]) -> Path:
        """Write the page with every picture, whether done, failed or waiting."""
        cards = "\n".join(_card(picture, files, problems.get(picture)) for picture, files in self.files.items())
        done = sum(files.done for files in self.files.values())
        title = f"{done} of {len(self.files)} pictures" + (f", {len(problems)} failed" if problems else "")
        page = self.out / PAGE
        write_file(page, TEMPLATE.format(title=title, cards=cards))
        return page


def open_batch(pictures: Path, out: Path, suffix: str = ".glb") -> Batch:
    """The batch of a folder of pictures; makes the folder for the files.

    Raises BatchError for a folder without pictures, and when `out` is a file.
    """
    paths = sorted(path for path in pictures.iterdir() if not path.name.startswith("."))
    chosen = [path for path in paths if path.suffix.lower() in SUFFIXES and not path.is_dir()]
    if not chosen:
        raise BatchError(f"{pictures} has no pictures; they end in {', '.join(SUFFIXES)}.")
    if out.absolute() == pictures.absolute():
        raise BatchError(f"{out} holds the pictures; choose another folder to write to.")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BatchError(f"The folder {out} cannot be made ({error.strerror}).") from None
    stems = distinct_stems(chosen)
    files = {path: _files(out, stem, suffix) for path, stem in zip(chosen, stems, strict=True)}
    return Batch(out, files, [path for path in paths if path not in files and path != out])


def distinct_stems(pictures: Sequence[Path]) -> list[str]:
    """The names after which files are named: a.png becomes `a`, or `a.png` where there is also a.jpg."""
    stems = [path.stem for path in pictures]
    # The second time for a.png.jpg, whose stem is the name that a.png now has.
    for _ in range(2):
        counts = Counter(stems)
        stems = [path.name if counts[stem] > 1 else stem for path, stem in zip(pictures, stems, strict=True)]
    return stems


def _files(out: Path, stem: str, suffix: str) -> Files:
    return Files(out / f"{stem}{suffix}", out / f"{stem}.json", out / f"{stem}.preview.png")


def _card(picture: Path, files: Files, problem: str | None) -> str:
    name = _shown(picture.name)
    if problem:
        return f'<article class="failed"><h2>{name}</h2><p>{_shown(problem)}</p></article>'
    if not files.done:
        return f'<article class="waiting"><h2>{name}</h2><p>not estimated yet</p></article>'
    asset, params, preview = (quote(os.fsencode(path.name)) for path in (files.asset, files.params, files.preview))
    links = f'<a href="{asset}">{_shown(files.asset.name)}</a> · <a href="{params}">parameters</a>'
    drawn = f'<img src="{preview}" alt="{name}, its estimate from the same camera, and turned" loading="lazy">'
    return f"<article><h2>{name}</h2>{drawn}<p>{links}</p></article>"


def _shown(text: str) -> str:
    """Text for the page; bytes of a file's name that are no UTF-8 are shown as �."""
    return escape(os.fsencode(text).decode(errors="replace"))


TEMPLATE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
  body {{ font: 15px/1.5 system-ui, sans-serif; margin: 24px; color: #222; background: #fafafa; }}
  main {{ display: grid; grid-template-columns: repeat(auto-fill, minmax(min(420px, 100%), 1fr)); gap: 16px; }}
  article {{ background: #fff; border: 1px solid #ddd; border-radius: 8px; padding: 12px 16px; }}
  article.failed {{ border-color: #c33; background: #fff5f5; }}
  article.waiting {{ color: #777; }}
  h1 {{ font-size: 20px; }}
  h2 {{ font-size: 15px; margin: 0 0 8px; overflow-wrap: anywhere; }}
  img {{ width: 100%; height: auto; }}
  p {{ margin: 8px 0 0; overflow-wrap: anywhere; }}
</style>
<h1>{title}</h1>
<p>Each row: the picture as the estimator saw it, the asset from the same camera, and turned by 60°.</p>
<main>
{cards}
</main>
</html>
"""
