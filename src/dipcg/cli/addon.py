"""The command that packs the add-on for Blender: blender-addon."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

from dipcg.cli.assets import Output

PACKAGE = Path(__file__).parents[1]
# Beside the package when it is installed, at the top of a checkout.
FOLDERS = (PACKAGE / "addon", PACKAGE.parents[1] / "addon")


def blender_addon(*, output: Output = Path("dipcg.zip")) -> None:
    """Write the add-on for Blender 4.2 and later, which sets the inputs of a modifier from a picture.

    Args:
        output: the zip file to write
    """
    from dipcg.files import write_file

    write_file(output, packed())
    print(f"Wrote {output}. In Blender: Edit > Preferences > Get Extensions > Install from Disk.")


def packed() -> bytes:
    """The add-on as a zip file; the API's client is part of it. Raises LookupError when this installation lacks it."""
    folder = next((folder for folder in FOLDERS if (folder / "blender_manifest.toml").is_file()), None)
    if folder is None:
        raise LookupError("This installation lacks the folder of the add-on; install dipcg again from its wheel.")
    files = {path.name: path for path in sorted(folder.iterdir()) if path.suffix in (".py", ".toml")}
    files["client.py"] = PACKAGE / "app" / "client.py"
    zipped = io.BytesIO()
    with zipfile.ZipFile(zipped, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, path in files.items():
            archive.writestr(zipfile.ZipInfo(name), path.read_bytes(), zipfile.ZIP_DEFLATED)
    return zipped.getvalue()
