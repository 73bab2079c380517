"""Data of the web page: arrays as scripts, levels of heights, weights in four bits, baked textures."""

from __future__ import annotations

import io
import json
import zlib
from base64 import b64encode
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from sketchterrain.array_types import UInt8Array
from sketchterrain.export.sampled import srgb_of
from sketchterrain.io.files import write_atomic

if TYPE_CHECKING:
    from sketchterrain.look.texture_levels import Levels

FORMAT: Final = 1  # of the data scripts, as in web/viewer.js
LEVELS: Final = 3  # halvings of the heights before the coarsest level
STEP: Final = 1 << LEVELS  # vertices between those of the coarsest level
_WHOLE: Final = 15  # sum of the weights of a vertex
_QUALITY: Final = 85  # of WebP

UInt16Array = npt.NDArray[np.uint16]


def write_data(
    path: Path, arrays: Mapping[str, npt.NDArray[Any]], facts: Mapping[str, Any] | None = None
) -> Path:
    """Write facts and arrays as a script, as browsers let no page of a folder fetch other files.

    An array's bytes are in planes of equal significance, deflated and in base64; its numbers, or their
    differences, whichever is smaller.
    """
    entries = []
    for name, values in arrays.items():
        flat = np.ascontiguousarray(values).ravel()
        steps = np.diff(flat, prepend=flat.dtype.type(0))
        plain, differences = (zlib.compress(_byte_planes(each), 9) for each in (flat, steps))
        packed = min(plain, differences, key=len)
        entries.append(
            [name, flat.dtype.str[1:], flat.size, packed is not plain, b64encode(packed).decode("ascii")]
        )
    content = ", ".join(json.dumps(each, allow_nan=False) for each in (FORMAT, path.stem, facts or {}))
    lines = ",\n".join(json.dumps(entry) for entry in entries)
    return write_atomic(path, f"sketchterrainData({content}, [\n{lines}\n]);\n".encode())


def _byte_planes(values: npt.NDArray[Any]) -> bytes:
    little = values.astype(values.dtype.newbyteorder("<"))
    return little.view(np.uint8).reshape(-1, values.itemsize).T.tobytes()


def padded(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Repeat the last row and column until their numbers are one more than a multiple of `STEP`."""
    ends = [(0, -(side - 1) % STEP) for side in values.shape[:2]]
    return np.pad(values, ends + [(0, 0)] * (values.ndim - 2), mode="edge")


def height_levels(numbers: UInt16Array) -> list[UInt16Array]:
    """Return the coarsest level of padded numbers, (rows, columns), then for each finer one its residuals.

    Residuals are differences from a cubic through four neighbours, as unsigned numbers 0, −1, 1, −2 …: of odd
    rows in even columns, then of odd columns.
    """
    levels = [numbers[::STEP, ::STEP]]
    for level in range(LEVELS - 1, -1, -1):
        fine = numbers[:: 1 << level, :: 1 << level].astype(np.int32)
        rows = fine[1::2, ::2] - _between(fine[::2, ::2])
        columns = fine[:, 1::2] - _between(fine[:, ::2].T).T
        rest = np.concatenate([rows.ravel(), columns.ravel()]).astype(np.int16)
        levels.append((rest << 1 ^ rest >> 15).view(np.uint16))
    return levels


def _between(values: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
    """Interpolate between successive rows by a cubic, in integers as the viewer does."""
    wide = np.pad(values, [(1, 1), (0, 0)], mode="edge")
    return (9 * (wide[1:-2] + wide[2:-1]) - wide[:-3] - wide[3:] + 8) >> 4


def four_bit_weights(weights: UInt8Array) -> UInt8Array:
    """Return weights of a sum of 255 as (materials, rows, columns) numbers of a sum of 15.

    The sums over the first materials are rounded, so that a weight differs by less than one step.
    """
    upto = np.cumsum(weights, axis=-1, dtype=np.int32)
    rounded = (2 * _WHOLE * upto + 255) // 510
    return np.moveaxis(np.diff(rounded, axis=-1, prepend=0), -1, 0).astype(np.uint8)


def texture_strip(levels: Levels, present: npt.NDArray[np.intp]) -> UInt8Array:
    """Return the finest level of some materials as a WebP, one below the other: colour, and height in grey."""
    colour = levels[0][0][present]
    encoded = srgb_of((np.arange(256) / 255.0) ** 2)[colour[..., :3]]
    grey = np.repeat(colour[..., 3:], 3, axis=-1)
    pixels = np.concatenate([encoded, grey], axis=2)
    stream = io.BytesIO()
    Image.fromarray(pixels.reshape(-1, *pixels.shape[2:])).save(stream, "WEBP", quality=_QUALITY, method=4)
    return np.frombuffer(stream.getvalue(), np.uint8)
