"""Label images: the read-only pixel arrays of a sketch's layers."""

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

_BLOCK_PIXELS = 1 << 20

# Images that were checked and frozen, by identity: the next sketch need not check them again.
_checked: WeakValueDictionary[int, LabelImage] = WeakValueDictionary()


def labels_in(image: LabelImage) -> tuple[int, ...]:
    """Return the labels in an image, 1 to 255, ascending."""
    rows = max(1, _BLOCK_PIXELS // max(1, image.shape[1]))
    present = np.zeros(256, dtype=bool)
    for top in range(0, image.shape[0], rows):  # bincount widens its input eightfold
        present |= np.bincount(image[top : top + rows].ravel(), minlength=256) > 0
    return tuple(int(label) for label in np.flatnonzero(present) if label)


def check_image(name: str, image: LabelImage) -> LabelImage:
    """Return a layer's image, uint8 (height, width), read-only; a writeable array is copied.

    Raise InputError, naming the layer, if it is not a label image.
    """
    if _checked.get(id(image)) is image and not image.flags.writeable:
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
    shared = image.flags.writeable or not image.flags.c_contiguous or image.base is not None
    return freeze_image(np.array(image, dtype=np.uint8, order="C") if shared else image)


def freeze_image(image: LabelImage) -> LabelImage:
    """Make a valid label image read-only and register it as checked."""
    image.flags.writeable = False
    _checked[id(image)] = image
    return image
