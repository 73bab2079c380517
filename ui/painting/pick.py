"""Picking: which paint lies beneath a pixel."""

from __future__ import annotations

from collections.abc import Iterable

from sketchterrain.sketch.document import LabelImage


def pick(layers: Iterable[tuple[str, LabelImage]], row: int, column: int) -> tuple[str, int] | None:
    """Return the layer and the label of the paint that is seen at a pixel.

    Parameters
    ----------
    layers
        Names and images, the topmost first.
    row, column
        The pixel; it may lie outside of the images.
    """
    for name, image in layers:
        if 0 <= row < image.shape[0] and 0 <= column < image.shape[1] and image[row, column]:
            return name, int(image[row, column])
    return None
