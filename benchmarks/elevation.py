"""Elevation: exactness, error bounds and time of patchworks of DEM grids."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy import ndimage

from sketchterrain.array_types import Float32Array
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.flight_scene import RATE, OwnTiles, Stop, view_of
from sketchterrain.benchmarks.report import Row, Table, Tables
from sketchterrain.benchmarks.timing import Lap, TimedContext, alternate, lap, spread
from sketchterrain.document.rasters import raster_source
from sketchterrain.document.store import load_sketch
from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.grids import ElevationGrid
from sketchterrain.elevation.selection import Patchwork
from sketchterrain.generation.building import build
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.camera import Camera
from sketchterrain.importing.elevation import sketch_on_elevation
from sketchterrain.terrain.layers.base import PatchSlotBuffers

SEED = 1

_STEP = 10.0  # m: Puget Sound's, as in the paper
_ERRORS = (0, 0.5, 1, 2, 3, 4, 5, 7, 10, 15, 20, 25, 30, 40, 50, 70, 100, 150, 200, 300)  # m
_PAPER = {1024: 0.75, 4096: 11.73, 16384: 196.2}  # s, one core of a Core i5 of 2.67 GHz
_PAPER_QUERIES = {50.0: 800.0, 0.0: 55.0}
_QUERIES = 200
_RELIEF = 600.0  # m, standard deviation of heights
_EXPONENT = 1.9  # of amplitudes: the power of real relief falls as k^-3.8 or so

_BOUNDS = {
    "error": "e, m",
    "most": "largest error, m",
    "rms": "rms, m",
    "overlap": "patches at a point, mean",
    "histogram": "points with 1, 2, … patches, %",
}
_BUILDS = {"side": "side, samples", "add_s": "adding a grid of 1024², s"}
_STORES = {
    "side": "side, samples",
    "far_ms": "1,000 patches at 50 m, ms",
    "together_ms": "1,000 finest ones side by side",
    "add_s": "adding a grid of 1024², s",
    "bytes": "bytes a sample",
    "overhead": "over float32, %",
    "beside_finest": "over the finest level, %",
}
_RATES = {
    "side": "side, samples",
    "error": "e, m",
    "queries": "queries a second",
    "rows": "points by rows, M/s",
    "random": "at random, M/s",
}


def measure(context: TimedContext, effort: Effort) -> Tables:
    """Patchworks of generated DEM grids (Rocca, Panozzo & Puppo 2012), times in seconds beside the paper's.

    The ground is noise whose amplitudes fall as k^-1.9, in steps of 10 m, with a deviation of 600 m. Errors
    are those at all samples of one grid; queries are uniform covers of all of it. Times of building are
    medians; the paper's are those of one core, Puget Sound and bilinear patches, ours of bicubic ones. Stores
    are those of `write_large_dem`, each in a process of its own, whose memory is counted beyond that of its
    libraries; patches are read from files that are not in the system's memory. Tiles are those of a preset
    with and without its data, in turn; flights are over DEMs of the same sizes.
    """
    sides = effort.elevation_sides
    return (
        Table("Exactness and bound", tuple(_bounds(sides[0])), _BOUNDS),
        Table("Building", tuple(_build(each, effort.rounds) for each in sides), _BUILDS),
        Table("Stores on disk", tuple(_store(each) for each in sides), _STORES),
        Table("Queries and evaluation", tuple(_rates(sides[0])), _RATES),
        tile_times(context, effort),
        flight_table(tuple(_flight(context, each) for each in sides)),
    )


def _flight(context: TimedContext, side: int) -> Row:
    with TemporaryDirectory(prefix="sketchterrain-") as folder:
        return flight(context, write_large_dem(Path(folder) / "dem.tif", side), side)


def _generated_heights(side: int, seed: int = SEED) -> Float32Array:
    """Return heights (side, side), m, of noise with the spectrum of relief."""
    small = min(side, 4096)
    frequency = np.hypot(np.fft.fftfreq(small)[:, None], np.fft.rfftfreq(small)[None])
    frequency[0, 0] = 1.0
    noise = np.fft.rfft2(np.random.default_rng(seed).normal(size=(small, small)))
    height = np.fft.irfft2(noise * frequency**-_EXPONENT)
    height *= _RELIEF / height.std()
    return np.tile((height + 1500.0).astype(np.float32), (side // small, side // small))


def _patchwork(*grids: ElevationGrid) -> Patchwork:
    """Return the patchwork of some grids."""
    parts = [build_patches(each) for each in grids]
    return Patchwork({each.id: each for each in parts})


def _grid(side: int, place: tuple[float, ...] | None = None, seed: int = SEED) -> ElevationGrid:
    at: Any = place or (_STEP, 0.0, 0.0, 0.0, -_STEP, _STEP * (side - 1))
    return ElevationGrid(_generated_heights(side, seed), at)


def _bounds(side: int) -> list[Row]:
    grid = _grid(side)
    work = _patchwork(grid)
    x, y = grid.to_metres(*np.meshgrid(np.arange(float(side)), np.arange(float(side))))
    rows: list[Row] = []
    for error in _ERRORS:
        which = work.cover(float(error))
        surface = work.surface(which)
        found = surface.evaluate(x, y)
        off, count = found.height - grid.samples, found.patches.astype(np.int64)
        shares = 100.0 * np.bincount(count.ravel())[1:] / count.size
        rows.append(
            {
                "error": float(error),
                "patches": len(which),
                "most": float(np.abs(off).max()),
                "rms": float(np.sqrt(np.mean(off * off))),
                "overlap": float(count.mean()),
                "overlap_most": int(count.max()),
                "histogram": ", ".join(f"{share:.2g}" for share in shares),
            }
        )
    return rows


def _build(side: int, rounds: int) -> Row:
    grid = _grid(side)
    _patchwork(_grid(64)).tops  # noqa: B018 - compiles
    work, times = _patchwork(grid), list[float]()
    for _ in range(rounds):
        times.append(lap(lambda: _patchwork(grid).tops).wall)
    far = 0.3 * _STEP * side
    inset = build_patches(_grid(min(side, 1024), (9.0, 4.0, far, 4.0, -9.0, far), SEED + 1))
    return {
        "side": side,
        "total_s": spread(times).median,
        "paper_s": _PAPER.get(side),
        "patches": len(work),
        "add_s": lap(lambda: Patchwork({**work.grids, inset.id: inset}).tops).wall,
    }


def _store(side: int) -> Row:
    with TemporaryDirectory(prefix="sketchterrain-") as folder:
        path = write_large_dem(Path(folder) / "dem.tif", side)
        script = Path(__file__).with_name("stored_dem.py")
        command = [sys.executable, "-P", str(script), str(path), folder]
        done = subprocess.run(command, check=True, capture_output=True)
        row: Row = json.loads(done.stdout)
        return row


def _rates(side: int) -> list[Row]:
    work = _patchwork(_grid(side))
    extent = _STEP * (side - 1)
    axis = np.linspace(0.0, extent, 1000)
    lines = tuple(each.ravel() for each in np.meshgrid(axis, axis))
    anywhere = np.random.default_rng(SEED).uniform(0.0, extent, (2, len(lines[0])))
    rows: list[Row] = []
    for error in (50.0, 0.0):
        which = work.cover(error)
        queries = [lap(partial(work.cover, error)).wall for _ in range(_QUERIES)]
        surface = work.surface(which)
        rates = [
            len(x) / 1e6 / min(lap(partial(surface.evaluate, x, y)).wall for _ in range(3))
            for x, y in (lines, anywhere)
        ]
        rows.append(
            {
                "side": side,
                "error": error,
                "patches": len(which),
                "queries": 1.0 / spread(queries).median,
                "paper": _PAPER_QUERIES[error],
                "surface_ms": 1e3 * lap(partial(work.surface, which)).wall,
                "rows": rates[0],
                "random": rates[1],
            }
        )
    return rows


REAL = Path(os.environ.get("SKETCHTERRAIN_DEMS", "")) / "bigtujunga30m_utm11.tif"

_FINER = 3  # samples a step of the real one
_ROWS = 256  # of a strip and of tiles
_QUANTUM = 0.1  # m, as Puget Sound's in the paper
_NOISE = 1024  # samples along a side of the noise, which repeats
_LONGEST = 8.0 * _FINER  # samples: the longest wave of the noise, below what the real DEM resolves
_DEVIATION = 1.0  # m


def write_large_dem(path: Path, side: int) -> Path:
    """Write a DEM of side × side samples, 10 m apart, in steps of 0.1 m as 16-bit integers.

    It is generated: SRTM 1″ around Big Tujunga (of `REAL`; smooth noise where this is missing), repeated by
    reflection, refined three times by cubic splines, with octaves of noise added below its resolution. The
    same side gives the same file.
    """
    import rasterio
    from rasterio.windows import Window

    real, noise = _real(), _octaves()
    place = rasterio.Affine(_STEP, 0.0, 0.0, 0.0, -_STEP, _STEP * side)
    profile = {"width": side, "height": side, "count": 1, "dtype": "int16", "transform": place}
    tiles = {"tiled": True, "blockxsize": _ROWS, "blockysize": _ROWS, "bigtiff": "IF_SAFER"}
    with rasterio.open(path, "w", driver="GTiff", crs="EPSG:32611", **profile, **tiles) as file:
        file.scales = (_QUANTUM,)
        columns = np.arange(side)
        for first in range(0, side, _ROWS):
            rows = np.arange(first, min(first + _ROWS, side))
            # A whole strip of the real one, refined along both axes.
            heights = _refined(_refined(real, rows, 0), columns, 1)
            heights = heights + noise[np.ix_(rows % _NOISE, columns % _NOISE)]
            window = Window(0, first, side, len(rows))
            file.write(np.round(heights / _QUANTUM).astype(np.int16), 1, window=window)
    return path


def _real() -> Float32Array:
    """Return coefficients of a cubic spline through the real heights."""
    if not REAL.is_file():
        noise = np.random.default_rng(2).normal(size=(640, 1200))
        heights = 1200.0 + 6e3 * ndimage.gaussian_filter(noise, 12.0, mode="mirror")
    else:
        import rasterio

        with rasterio.open(REAL) as file:
            heights = file.read(1).astype(np.float64)
    return np.asarray(ndimage.spline_filter(heights, 3, mode="mirror"), np.float32)


def _refined(values: Float32Array, at: np.ndarray, axis: int) -> Float32Array:
    """Return a cubic spline of coefficients along an axis, reflected at its ends."""
    size, place = values.shape[axis], at / _FINER
    first = np.floor(place).astype(int)
    t = (place - first).reshape([-1 if each == axis else 1 for each in (0, 1)])
    weights = ((1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3)
    found: Float32Array = np.float32(0.0)  # type: ignore[assignment]
    for offset, weight in enumerate(weights, start=-1):
        around = np.mod(first + offset, 2 * size - 2)
        taken = np.take(values, np.where(around < size, around, 2 * size - 2 - around), axis=axis)
        found = found + (weight / 6.0).astype(np.float32) * taken
    return found


def _octaves() -> Float32Array:
    frequency = np.hypot(np.fft.fftfreq(_NOISE)[:, None], np.fft.rfftfreq(_NOISE)[None])
    amplitude = np.where(frequency > 1.0 / _LONGEST, np.maximum(frequency, 1e-9) ** -1.9, 0.0)
    spectrum = np.fft.rfft2(np.random.default_rng(1).normal(size=(_NOISE, _NOISE)))
    noise = np.fft.irfft2(spectrum * amplitude)
    return np.asarray(noise * (_DEVIATION / noise.std()), np.float32)


_PRESET = "andorra"
_TILES = 64  # of a level that are timed
_SPEED, _ABOVE, _AHEAD = 160.0, 600.0, 4000.0  # m/s, m above the ground, m to what the eye looks at
_SECONDS, _BUDGET = 10.0, 8e-3  # of the flight; s a frame for generation
_ASKED_TILES, _ASKED_BYTES = 1.3, 1600.0
_PATCH_BYTES = 35 * 35 * 5 + 24 * 4 + 16

_TILE_HEADINGS = {"ms": "with detail, ms", "smooth": "with ÷ without", "ratio": "with detail ÷ without"}
_FLIGHT_HEADINGS = {
    "ms": "ms a frame: choice and generation",
    "slow_ms": "95 % within, ms",
    "tiles": "tiles a frame",
    "bytes": "bytes of patches a frame",
}


def tile_times(context: TimedContext, effort: Effort) -> Table:
    """Time tiles of the preset `andorra`, without its data, with them, and with detail below them."""
    sketch = load_sketch(_PRESET)
    smooth = sketch.replace(base={**sketch.base, "detail": 0.0})
    terrains = {
        name: build(each, device=context)
        for name, each in (("without", sketch.replace(rasters=())), ("smooth", smooth), ("detail", sketch))
    }
    rows = []
    for level in (4, 6, 8, 10):
        side = 1 << level
        first = side // 2 - 4
        keys = [(first + column, first + row) for row in range(8) for column in range(8)][:_TILES]
        work = {name: partial(_lap, context, each, keys, level) for name, each in terrains.items()}
        laps = alternate(work, rounds=effort.rounds)
        times = {name: 1e3 * median(lap.wall for lap in each) for name, each in laps.items()}
        rows.append(
            {
                "level": level,
                "cell": sketch.extent / (64 << level),
                "without_ms": times["without"],
                "smooth_ms": times["smooth"],
                "ms": times["detail"],
                "smooth": times["smooth"] / times["without"],
                "ratio": times["detail"] / times["without"],
                "asked": _ASKED_TILES,
            }
        )
    return Table(f"{_TILES} tiles of {_PRESET}", tuple(rows), _TILE_HEADINGS)


def _lap(context: TimedContext, terrain: Terrain, keys: list[tuple[int, int]], level: int) -> Lap:
    return context.lap(lambda: terrain.evaluator.tiles(keys, level))


def flight(context: TimedContext, path: Path, side: int) -> Row:
    """Fly over a DEM of side × side samples, 160 m/s, 600 m above it, tiles within 1 px of 720."""
    sketch, _ = sketch_on_elevation([raster_source(path, "elevation")])
    terrain = build(sketch, device=context)
    tiles = OwnTiles(terrain, quads=64, tolerance=1.0)
    stops = list(_stops(terrain))
    with _counted() as uploaded:
        first = tiles.converge(view_of(stops[0], terrain.extent))
        patches = sum(uploaded)
        uploaded.clear()
        frames = [
            tiles.frame(view_of(stop, terrain.extent), elapsed=1.0 / RATE, budget=_BUDGET) for stop in stops
        ]
    seconds = np.array([each.generation + each.choice for each in frames])
    return {
        "grid": f"{side}²",
        "first_ms": 1e3 * (first.generation + first.choice),
        "frames": len(frames),
        "ms": 1e3 * float(seconds.mean()),
        "slow_ms": 1e3 * float(np.quantile(seconds, 0.95)),
        "tiles": float(np.mean([each.tiles for each in frames])),
        "first_patches": patches,
        "bytes": _PATCH_BYTES * sum(uploaded) / len(frames),
        "asked": _ASKED_BYTES,
    }


def flight_table(rows: tuple[Row, ...]) -> Table:
    """Return the table of flights."""
    return Table(f"Flights at {_SPEED:.0f} m/s, {RATE:.0f} frames a second", rows, _FLIGHT_HEADINGS)


def _stops(terrain: Terrain) -> Iterator[Stop]:
    """Yield the frames of a straight flight along the sketch's diagonal."""
    along = _SPEED * np.arange(round(_SECONDS * RATE)) / RATE
    middle = 0.5 * np.array(terrain.size)
    ahead = np.array([0.8, 0.6])
    eyes = middle + (along - along.mean())[:, None] * ahead
    ground = terrain.heights(*eyes.T, cell_size=_ABOVE / 4.0).astype(np.float64)
    height = np.convolve(np.pad(ground, 60, mode="edge"), np.ones(121) / 121.0, mode="valid") + _ABOVE
    velocity = (*(_SPEED * ahead).tolist(), 0.0)
    for eye, top, below in zip(eyes, height.tolist(), ground.tolist(), strict=True):
        target = eye + _AHEAD * ahead
        camera = Camera((*eye.tolist(), top), (*target.tolist(), below), fov=45.0)
        yield Stop(camera, below, velocity)


@contextmanager
def _counted() -> Iterator[list[int]]:
    """Collect how many patches are uploaded at a time."""
    counts: list[int] = []
    upload = PatchSlotBuffers._upload

    def counted(buffers: PatchSlotBuffers, numbers: np.ndarray, slots: np.ndarray) -> None:
        counts.append(len(numbers))
        upload(buffers, numbers, slots)

    PatchSlotBuffers._upload = counted  # type: ignore[assignment, method-assign]
    try:
        yield counts
    finally:
        PatchSlotBuffers._upload = upload  # type: ignore[method-assign]
