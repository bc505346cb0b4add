"""Pictures by OpenGL: a fast renderer for training and comparing, and one for people with materials and shadows."""

from dipcg.render.renderer import Look, Renderer, open_context, sample_look

__all__ = ["Look", "Renderer", "open_context", "sample_look"]
