"""An asset as files: each file of this folder writes one family of formats."""

from dipcg.export.asset import FORMATS, Asset, ExportError

__all__ = ["FORMATS", "Asset", "ExportError"]
