"""What training pictures look like: `python -m benchmarks.augmentation DATA SHEET.png`, a row for each shape."""

import sys

import numpy as np

from dipcg.data.shapes import load_shapes
from dipcg.images import save_image
from dipcg.inference.preview import in_rows
from dipcg.training.pictures import Pictures

SIDE, COLUMNS, ROWS = 128, 12, 5


def main(data: str, sheet: str) -> None:
    generator, shapes = load_shapes(data, "train")
    pictures = Pictures(generator, shapes, COLUMNS * ROWS, seed=1, slots=COLUMNS * ROWS)
    images = (pictures.batch(0, SIDE).images.permute(0, 2, 3, 1).numpy() * 255).astype(np.uint8)
    save_image(in_rows(list(np.ascontiguousarray(images)), COLUMNS), sheet)
    print(f"Wrote {sheet}: {len(images)} pictures, none of them chosen.")


if __name__ == "__main__":
    main(*sys.argv[1:])
