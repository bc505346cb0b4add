"""The only preparation of pictures in the project: read one, cut the object out, crop it as training pictures are.

No file of the room imports torch when it is itself imported, except `segmenter.py`, which is imported when a picture is
cut out. An image is `UInt8[np.ndarray, "h w 4"]` with straight alpha.
"""

from dipcg.images.cutout import Background, Cutout, cut_by_colour, cut_out, prepare
from dipcg.images.formats import MAX_PIXELS, SUFFIXES, ImageError
from dipcg.images.read import MAX_SIDE, RGBA, Source, load_image, read_image
from dipcg.images.views import MARGIN, crop_to_object, edges, over_white, save_image, silhouette

__all__ = [
    "Background",
    "Cutout",
    "cut_by_colour",
    "cut_out",
    "prepare",
    "MAX_PIXELS",
    "SUFFIXES",
    "ImageError",
    "MAX_SIDE",
    "RGBA",
    "Source",
    "load_image",
    "read_image",
    "MARGIN",
    "crop_to_object",
    "edges",
    "over_white",
    "save_image",
    "silhouette",
]
