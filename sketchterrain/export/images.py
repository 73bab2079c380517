"""Heights, normals and material weights as PNG, with JSON that documents their values."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sketchterrain.export.files import write_json, write_png, write_values_png
from sketchterrain.export.sampled import TerrainSamples, quantise_normals
from sketchterrain.export.weights import CHANNELS, quantise_weights, rgba_weights

if TYPE_CHECKING:  # loads OpenCL
    from sketchterrain.terrain import Raster

_STEPS = 65535
ORIENTATION = {"row_0": "north", "column_0": "west", "samples": "vertices"}


def write_height_png(folder: Path, raster: Raster) -> tuple[Path, ...]:
    """Write ``height.png``, 16-bit grey, and ``height.json`` with the meaning of its values.

    Height is minimum + value · metres_per_step, to half a step. A flat terrain has value 0 and a step of 0 m.
    """
    low, high = float(raster.height.min()), float(raster.height.max())
    step = (high - low) / _STEPS
    rows, columns = raster.height.shape
    values = np.zeros(raster.height.shape, np.uint16)
    if step > 0.0:
        steps = np.rint((raster.height.astype(np.float64) - low) / step)
        values = np.clip(steps, 0, _STEPS).astype(np.uint16)
    image = write_values_png(folder / "height.png", values)
    description = write_json(
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
    return image, description


def write_normal_png(folder: Path, raster: Raster) -> tuple[Path, ...]:
    """Write ``normal.png``, 8-bit RGB in OpenGL's convention: red east, green north (Y+), blue up."""
    return (write_values_png(folder / "normal.png", quantise_normals(raster.normal)),)


def write_materials(folder: Path, raster: Raster, names: Sequence[str]) -> tuple[Path, ...]:
    """Write ``materials.png``, ``materials-2.png`` … (RGBA) and ``materials.json`` with their channels."""
    weights = quantise_weights(raster.materials)
    images = [
        write_values_png(folder / f"{weights_suffix(first)}.png", rgba_weights(weights, first))
        for first in range(0, len(names), len(CHANNELS))
    ]
    description = {
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
    return (*images, write_json(folder / "materials.json", description))


def write_normals_and_weights(stem: Path, samples: TerrainSamples, names: Sequence[str]) -> dict[Path, str]:
    """Write ``STEM_normal.png``, ``STEM_materials.png``, ``STEM_materials-2.png`` … with descriptions."""
    path = stem.with_name(f"{stem.name}_normal.png")
    description = "normals, red east, green north (Y+), blue up; 0 is -1, 255 is 1"
    files = {write_values_png(path, samples.normal): description}
    for first in range(0, len(names), len(CHANNELS)):
        path = stem.with_name(f"{stem.name}_{weights_suffix(first)}.png")
        materials = ", ".join(names[first : first + len(CHANNELS)])
        write_values_png(path, rgba_weights(samples.weights, first))
        files[path] = f"weights of {materials}; no opacity"
    return files


def weights_suffix(index: int) -> str:
    """Return the end of the file name of a material's weights: ``materials``, ``materials-2`` and so on."""
    number = index // len(CHANNELS) + 1
    return f"materials-{number}" if number > 1 else "materials"


def write_picture(path: Path, pixels: npt.NDArray[np.uint8]) -> tuple[Path, ...]:
    """Write an image, (height, width, 3) uint8, as a PNG."""
    return (write_png(path, pixels),)
