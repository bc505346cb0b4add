"""dipcg: from a picture to the parameters of a procedural generator, and so to an exact, light, editable asset."""

__version__ = "0.1.0"
