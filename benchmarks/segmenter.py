"""Train the segmenter that cuts objects out of photographs: `python -m benchmarks segmenter DATA... --write FILE`.

Each DATA is a folder of `dipcg dataset build`. The grounds are drawn at random (`training/grounds.py`), and every sixth
is a piece of a photograph that scikit-image ships. `python -m benchmarks cutout` measures the result.
"""

import argparse
from pathlib import Path

import numpy as np
import torch
from skimage import data

from dipcg.images.segmenter import FILE, Segmenter
from dipcg.training.grounds import Photograph
from dipcg.training.segment import fit_segmenter, render_views, save_segmenter

# The others of scikit-image's photographs are for testing (benchmarks/cutout.py).
PHOTOGRAPHS = ("astronaut", "chelsea", "brick", "immunohistochemistry")
SAVED_EVERY = 100


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", nargs="+", help="folders of shapes")
    parser.add_argument("--steps", type=int, default=8_000)
    parser.add_argument("--views", type=int, default=500, help="rendered pictures of each folder")
    parser.add_argument("--write", type=Path, default=FILE)
    args = parser.parse_args()
    torch.set_num_threads(1)
    views = [view for folder in args.data for view in render_views(folder, "train", args.views)]
    print(f"{len(views)} views", flush=True)
    about = {"made by": "python -m benchmarks segmenter", "data": ", ".join(Path(folder).name for folder in args.data)}
    about |= {"views": len(views)}
    losses: list[float] = []

    def report(step: int, loss: float) -> None:
        losses.append(loss)
        if step % SAVED_EVERY == 0:
            print(f"step {step}, loss {np.mean(losses[-SAVED_EVERY:]):.3f}", flush=True)

    network: Segmenter = fit_segmenter(views, photographs(PHOTOGRAPHS), args.steps, report=report)
    save_segmenter(network, args.write, about | {"steps": len(losses), "loss": float(np.mean(losses[-SAVED_EVERY:]))})
    print(f"Wrote {args.write}: {args.write.stat().st_size} bytes after {len(losses)} steps.")


def photographs(names: tuple[str, ...]) -> list[Photograph]:
    """Photographs that scikit-image ships, in colour and in [0, 1]."""
    pictures = [np.asarray(getattr(data, name)(), np.float32) / 255 for name in names]
    return [picture if picture.ndim == 3 else np.repeat(picture[..., None], 3, axis=2) for picture in pictures]


if __name__ == "__main__":
    main()
