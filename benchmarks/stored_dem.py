"""A script: time and memory of the store of one DEM, as JSON; run by its path, to import nothing else."""

from __future__ import annotations

import json
import os
import resource
import sys
from contextlib import nullcontext
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import rasterio
import scipy.sparse.csgraph
from scipy import ndimage

from sketchterrain.array_types import Float64Array
from sketchterrain.elevation.base import PatchStore
from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.grids import ElevationGrid, SketchFrame, read_grid
from sketchterrain.elevation.patches import GridPatches
from sketchterrain.elevation.selection import Patchwork

_IMPORTED = rasterio, ndimage, scipy.sparse.csgraph  # before memory is measured
_FRAME = SketchFrame("EPSG:32611")
_PATCHES = 1000
_STEP, _INSET = 10.0, 1024  # m, samples


def measure(path: Path, folder: Path) -> dict[str, Any]:
    """Return the facts of one DEM."""
    _compile(folder / "small")
    before = _peak()
    start = perf_counter()
    part = _loaded(folder / "store", path)
    built = perf_counter() - start
    Patchwork({part.id: part}).cover_for_cells(4.0 * _STEP)
    memory = _peak() - before
    files = list((folder / "store" / part.id.hex()).iterdir())
    for each in files:
        _forget(each)
    start = perf_counter()
    part = _loaded(folder / "store", path)
    opened = perf_counter() - start
    work = Patchwork({part.id: part})
    far = work.cover(50.0)
    gathered = _timed(lambda: work.patch_data(far[:_PATCHES]))
    near = work.within(work.cover(0.0), _square(part, 32.0 * 28.0))[:_PATCHES]
    _forget(part.planes.values.path)
    together = _timed(lambda: work.patch_data(near))
    scattered = np.random.default_rng(1).permutation(work.cover(0.0))[:_PATCHES]
    _forget(part.planes.values.path)
    apart = _timed(lambda: work.patch_data(scattered))
    samples = part.grid.shape[0] * part.grid.shape[1]
    size = sum(each.stat().st_size for each in files)
    coefficients = part.planes.shapes[0][0] * part.planes.shapes[0][1]
    return {
        "side": part.grid.shape[1],
        "build_s": built,
        "megabytes": memory,
        "open_ms": 1e3 * opened,
        "far_ms": 1e3 * gathered,
        "together_ms": 1e3 * together,
        "apart_ms": 1e3 * apart,
        "add_s": _added(work, part),
        "bytes": size / samples,
        "overhead": 100.0 * (size / (4.0 * samples) - 1.0),
        "beside_finest": 100.0 * (size / (4.0 * coefficients) - 1.0),
    }


def _loaded(folder: Path, path: Path) -> GridPatches:
    return PatchStore(folder).load(path, lambda: nullcontext(read_grid(path, _FRAME)))[0]


def _peak() -> float:
    """Return the most memory that was used, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def _compile(folder: Path) -> None:
    samples = np.random.default_rng(1).normal(size=(100, 100)).astype(np.float32)
    samples[40:60, 40:60] = np.nan
    part = PatchStore(folder).patches(ElevationGrid(samples, (_STEP, 0.0, 0.0, 0.0, -_STEP, 0.0)))
    work = Patchwork({part.id: part})
    work.patch_data(work.cover_for_cells(_STEP))


def _forget(path: Path) -> None:
    """Write a file back, and drop it from the system's memory."""
    with path.open("rb") as file:
        os.fsync(file.fileno())
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def _timed(work: Any) -> float:
    start = perf_counter()
    work()
    return perf_counter() - start


def _middle(part: GridPatches) -> Float64Array:
    row, column = (np.array(0.5 * n) for n in part.grid.shape)
    return np.array(part.grid.to_metres(column, row))


def _square(part: GridPatches, steps: float) -> tuple[float, float, float, float]:
    x, y = _middle(part)
    half = 0.5 * steps * _STEP
    return x - half, y - half, x + half, y + half


def _added(work: Patchwork, part: GridPatches) -> float:
    """Return the seconds that adding a grid of 1024² takes, its patches included."""
    x, y = _middle(part)
    samples = np.random.default_rng(3).normal(size=(_INSET, _INSET)).astype(np.float32)
    grid = ElevationGrid(samples, (9.0, 4.0, x, 4.0, -9.0, y), frame=_FRAME)
    inset = build_patches(grid)
    return _timed(lambda: Patchwork({**work.grids, inset.id: inset}).tops)


if __name__ == "__main__":
    sys.stdout.write(json.dumps(measure(Path(sys.argv[1]), Path(sys.argv[2]))))
