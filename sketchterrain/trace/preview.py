"""A traced sketch as a picture: labels in the colours that the program shows them in, beside their source."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from PIL import Image

from sketchterrain.sketch.document import labels_in
from sketchterrain.sketch.label_colours import DRAW_ORDER, label_rgb

if TYPE_CHECKING:
    from sketchterrain.sketch import Sketch

__all__ = ["preview_png", "sketch_picture"]

_PAPER = 255
_GAP = 8  # px between the two
_TALLEST = 1024  # px


def sketch_picture(sketch: Sketch) -> npt.NDArray[np.uint8]:
    """Return what a sketch looks like on white paper: uint8, (height, width, 3), sRGB."""
    shown = np.full((sketch.height_px, sketch.width_px, 3), _PAPER, dtype=np.uint8)
    for layer in DRAW_ORDER:
        image = sketch.layers[layer]
        for label in labels_in(image):
            shown[image == label] = label_rgb(layer, label)
    return shown


def preview_png(sketch: Sketch, source: npt.NDArray[np.uint8] | None = None) -> bytes:
    """Return a PNG of a sketch.

    Parameters
    ----------
    sketch
    source
        uint8, (height, width, 4): what it was traced from, shown at the left.
    """
    traced = Image.fromarray(sketch_picture(sketch))
    height = min(traced.height, _TALLEST)
    size = max(1, round(traced.width * height / traced.height)), height
    traced = traced.resize(size, Image.Resampling.NEAREST)
    if source is not None:
        beside = Image.new("RGB", (2 * size[0] + _GAP, height), (128, 128, 128))
        original = Image.fromarray(source).resize(size, Image.Resampling.BOX)
        beside.paste(original, (0, 0), original)
        beside.paste(traced, (size[0] + _GAP, 0))
        traced = beside
    stream = io.BytesIO()
    traced.save(stream, format="PNG")
    return stream.getvalue()
