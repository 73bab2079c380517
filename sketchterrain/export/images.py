"""Heights, normals and material weights as images, with JSON that tells what their values mean."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sketchterrain.export.files import write_json, write_png, write_values_png
from sketchterrain.export.sampled import Sampled, normal_bytes
from sketchterrain.export.weights import CHANNELS, four_of, quantised_weights

if TYPE_CHECKING:  # loads OpenCL
    from sketchterrain.terrain import Raster

_STEPS = 65535
ORIENTATION = {"row_0": "north", "column_0": "west", "samples": "vertices"}


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
            "orientation": ORIENTATION,
        },
    )
    return image, meaning


def write_normals(folder: Path, raster: Raster) -> tuple[Path, ...]:
    """Write ``normal.png``, 8-bit RGB the OpenGL way: red east, green north (Y+), blue up, 128 is zero."""
    return (write_values_png(folder / "normal.png", normal_bytes(raster.normal)),)


def _quantised(height: npt.NDArray[np.float32], low: float, step: float) -> npt.NDArray[np.uint16]:
    if step == 0.0:
        return np.zeros(height.shape, np.uint16)
    value = np.rint((height.astype(np.float64) - low) / step)
    return np.clip(value, 0, _STEPS).astype(np.uint16)


def write_materials(folder: Path, raster: Raster, names: Sequence[str]) -> tuple[Path, ...]:
    """Write ``materials.png``, ``materials-2.png`` … (RGBA) and ``materials.json``, which names the channels.

    Parameters
    ----------
    folder
    raster
    names
        One for each material of the raster, in its order.
    """
    weights = quantised_weights(raster.materials)
    images = [
        write_values_png(folder / f"{weights_suffix(first)}.png", four_of(weights, first))
        for first in range(0, len(names), len(CHANNELS))
    ]
    meaning = {
        "format": 1,
        "encoding": "value / 255 is the weight; the weights of a vertex sum to 255 over all files",
        "alpha": "a weight like the others, not opacity: do not premultiply",
        "orientation": ORIENTATION,
        "materials": [
            {
                "name": name,
                "index": index,
                "file": f"{weights_suffix(index)}.png",
                "channel": CHANNELS[index % len(CHANNELS)],
            }
            for index, name in enumerate(names)
        ],
    }
    return (*images, write_json(folder / "materials.json", meaning))


def ground_images(stem: Path, sampled: Sampled, names: Sequence[str]) -> dict[Path, str]:
    """Write ``STEM_normal.png``, ``STEM_materials.png``, ``STEM_materials-2.png`` …; return what each is."""
    path = stem.with_name(f"{stem.name}_normal.png")
    about = "normals, red east, green north (Y+), blue up; 0 is -1, 255 is 1"
    files = {write_values_png(path, sampled.normal): about}
    for first in range(0, len(names), len(CHANNELS)):
        path = stem.with_name(f"{stem.name}_{weights_suffix(first)}.png")
        held = ", ".join(names[first : first + len(CHANNELS)])
        files[write_values_png(path, four_of(sampled.weights, first))] = f"weights of {held}; no opacity"
    return files


def weights_suffix(index: int) -> str:
    """Return how the file with a material's weights ends: ``materials``, ``materials-2`` and so on."""
    number = index // len(CHANNELS) + 1
    return f"materials-{number}" if number > 1 else "materials"


def write_picture(path: Path, pixels: npt.NDArray[np.uint8]) -> tuple[Path, ...]:
    """Write a picture, (height, width, 3) of uint8, as a PNG at `path`."""
    return (write_png(path, pixels),)
