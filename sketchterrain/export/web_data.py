"""Data of the web page: arrays as scripts, levels of heights, weights in four bits, textures."""

from __future__ import annotations

import io
import json
import zlib
from base64 import b64encode
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from sketchterrain.array_types import UInt8Array
from sketchterrain.export.sampled import srgb_of
from sketchterrain.io.files import write_atomic

FORMAT: Final = 1  # of the data scripts, as in web/viewer.js
LEVELS: Final = 3  # of heights that are finer than the coarsest
STEP: Final = 1 << LEVELS  # vertices between those of the coarsest
_WHOLE: Final = 15  # sum of a vertex's weights
_QUALITY: Final = 85  # of WebP

UInt16Array = npt.NDArray[np.uint16]


def write_data(path: Path, arrays: Mapping[str, npt.NDArray[Any]], facts: Mapping[str, Any]) -> Path:
    """Write facts and arrays as a script, since no page may fetch files from a folder.

    An array is its bytes in planes of equal significance, of the numbers or of their differences, whichever
    is smaller, deflated and in base64.
    """
    entries = []
    for name, values in arrays.items():
        flat = np.ascontiguousarray(values).ravel()
        steps = np.diff(flat, prepend=flat.dtype.type(0))
        plain, differences = (zlib.compress(_byte_planes(each), 9) for each in (flat, steps))
        packed = min(plain, differences, key=len)
        text = b64encode(packed).decode("ascii")
        entries.append([name, flat.dtype.str[1:], flat.size, packed is not plain, text])
    head = ", ".join(json.dumps(each, allow_nan=False) for each in (FORMAT, path.stem, facts))
    lines = ",\n".join(json.dumps(entry) for entry in entries)
    return write_atomic(path, f"sketchterrainData({head}, [\n{lines}\n]);\n".encode())


def _byte_planes(values: npt.NDArray[Any]) -> bytes:
    little = values.astype(values.dtype.newbyteorder("<"))
    return little.view(np.uint8).reshape(-1, values.itemsize).T.tobytes()


def padded(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Repeat the last row and column until their numbers are one more than a multiple of `STEP`."""
    ends = [(0, -(side - 1) % STEP) for side in values.shape[:2]]
    return np.pad(values, ends + [(0, 0)] * (values.ndim - 2), mode="edge")


def height_levels(numbers: UInt16Array) -> list[UInt16Array]:
    """Return the coarsest level of padded numbers, (rows, columns), then the residuals of each finer one.

    Residuals are differences from a cubic through four neighbours: of odd rows in even columns, then of odd
    columns; 0, −1, 1, −2 … are 0, 1, 2, 3 …
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
    """Interpolate between successive rows in integers, as the viewer does."""
    wide = np.pad(values, [(1, 1), (0, 0)], mode="edge")
    return (9 * (wide[1:-2] + wide[2:-1]) - wide[:-3] - wide[3:] + 8) >> 4


def four_bit_weights(weights: UInt8Array) -> UInt8Array:
    """Return weights of a sum of 255 as (materials, rows, columns) numbers of a sum of 15.

    Sums over the first materials are rounded, so that a weight differs by less than one step.
    """
    upto = np.cumsum(weights, axis=-1, dtype=np.int32)
    steps = np.diff((2 * _WHOLE * upto + 255) // 510, axis=-1, prepend=0)
    return np.moveaxis(steps, -1, 0).astype(np.uint8)


def texture_strip(colour: UInt8Array, tints: npt.NDArray[np.float64]) -> UInt8Array:
    """Return textures (materials, n, n, 4) of √albedo and height as a WebP: tinted colours, then heights."""
    albedo = np.clip((colour[..., :3] / 255.0) ** 2 * tints[:, None, None], 0.0, 1.0)
    pixels = np.concatenate([srgb_of(albedo), np.repeat(colour[..., 3:], 3, axis=-1)], axis=2)
    stream = io.BytesIO()
    Image.fromarray(pixels.reshape(-1, *pixels.shape[2:])).save(stream, "WEBP", quality=_QUALITY, method=4)
    return np.frombuffer(stream.getvalue(), np.uint8)
