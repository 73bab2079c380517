"""Heights and normals as images for engines."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.export.files import write_json
from sketchterrain.export.png import write_values_png

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

    from sketchterrain.terrain import Raster

__all__ = ["write_height_png", "write_normals"]

_STEPS = 65535


def write_height_png(folder: Path, raster: Raster) -> tuple[Path, ...]:
    """Write ``height.png``, 16-bit grey, and ``height.json``, which says what its values mean.

    Metres are minimum + value · metres_per_step; a height is off by at most half a step. A terrain that is
    flat all over has value 0 and a step of 0 m.
    """
    low, high = float(raster.height.min()), float(raster.height.max())
    step = (high - low) / _STEPS
    rows, columns = raster.height.shape
    image = write_values_png(folder / "height.png", _quantised(raster.height, low, step))
    meaning = write_json(
        folder / "height.json",
        {
            "format": 1,
            "file": image.name,
            "units": "m",
            "minimum": low,
            "maximum": high,
            "metres_per_step": step,
            "width": columns,
            "height": rows,
            "spacing": {"x": raster.spacing[0], "y": raster.spacing[1]},
            "bounds": {
                "west": 0.0,
                "south": 0.0,
                "east": (columns - 1) * raster.spacing[0],
                "north": (rows - 1) * raster.spacing[1],
            },
            "orientation": {"row_0": "north", "column_0": "west", "samples": "vertices"},
        },
    )
    return image, meaning


def write_normals(folder: Path, raster: Raster) -> tuple[Path, ...]:
    """Write ``normal.png``, 8-bit RGB the OpenGL way: red east, green north (Y+), blue up, 128 is zero."""
    # 127.5 each way: −1 is 0, 1 is 255.
    colour = np.rint(raster.normal * np.float32(127.5) + np.float32(127.5)).astype(np.uint8)
    return (write_values_png(folder / "normal.png", colour),)


def _quantised(height: npt.NDArray[np.float32], low: float, step: float) -> npt.NDArray[np.uint16]:
    if step == 0.0:
        return np.zeros(height.shape, np.uint16)
    value = np.rint((height.astype(np.float64) - low) / step)
    return np.clip(value, 0, _STEPS).astype(np.uint16)
