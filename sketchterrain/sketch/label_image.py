"""A label image: what one layer of a sketch is, checked once and never written to again."""

from __future__ import annotations

from typing import TypeAlias
from weakref import WeakValueDictionary

import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError

LabelImage: TypeAlias = npt.NDArray[np.uint8]

MAX_SIDE = 16384
"""The most pixels along a side of a sketch."""

MAX_LABELS = 16
"""The most labels in one layer: an image with more looks antialiased."""

_PIXELS_AT_ONCE = 1 << 20

# Images that were checked and made read-only, by identity: the next sketch need not look at them again.
_known: WeakValueDictionary[int, LabelImage] = WeakValueDictionary()


def labels_in(image: LabelImage) -> tuple[int, ...]:
    """Return the labels, 1 to 255, that stand in a label image, ascending."""
    rows = max(1, _PIXELS_AT_ONCE // max(1, image.shape[1]))
    seen = np.zeros(256, dtype=bool)
    for top in range(0, image.shape[0], rows):  # bincount widens its input eightfold
        seen |= np.bincount(image[top : top + rows].ravel(), minlength=256) > 0
    return tuple(int(label) for label in np.flatnonzero(seen) if label)


def check_image(name: str, image: LabelImage) -> LabelImage:
    """Return a layer's image, read-only; a writeable array is copied."""
    if _known.get(id(image)) is image and not image.flags.writeable:
        return image
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 2:
        given = f"{image.dtype} {image.shape}" if isinstance(image, np.ndarray) else type(image).__name__
        raise InputError(f"layer {name}: expected a uint8 array (height, width), got {given}")
    if not 1 <= min(image.shape) <= max(image.shape) <= MAX_SIDE:
        raise InputError(
            f"layer {name} is {image.shape[1]}×{image.shape[0]} px: expected sides of 1 to {MAX_SIDE} px"
        )
    labels = labels_in(image)
    if len(labels) > MAX_LABELS:
        raise InputError(
            f"layer {name} looks antialiased: it has {len(labels)} labels, expected at most {MAX_LABELS}"
        )
    others = image.flags.writeable or not image.flags.c_contiguous or image.base is not None
    return freeze_image(np.array(image, dtype=np.uint8, order="C") if others else image)


def freeze_image(image: LabelImage) -> LabelImage:
    """Make a label image read-only, and remember that it is one."""
    image.flags.writeable = False
    _known[id(image)] = image
    return image
