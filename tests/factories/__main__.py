"""Write Infinigen's own assets of a generator: `python -m factories NAME OUT.npz`, in a process with Blender."""

import importlib
import json
import os
import sys

import numpy as np

from dipcg.blender.infinigen import clean_blender, silence


def main(name: str, path: str) -> None:
    factory, arrays = importlib.import_module(f"factories.{name}"), {}
    for key in factory.KEYS:
        clean_blender()
        with silence():
            vertices, faces, own = factory.make(key)
        text = json.dumps(own, default=lambda value: np.asarray(value).tolist())
        arrays |= {f"{key}.vertices": vertices, f"{key}.faces": faces, f"{key}.own": text}
    np.savez(path, **arrays)
    # Blender's own shutdown is slow.
    os._exit(0)


if __name__ == "__main__":
    main(*sys.argv[1:])
