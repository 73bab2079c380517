"""Elevation: exactness, error bounds, time and seams of patchworks of DEM grids."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np
from scipy import ndimage

from sketchterrain.array_types import Float32Array, Float64Array
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.large_dem import write_large_dem
from sketchterrain.benchmarks.report import Column, Outcome, Row, Table
from sketchterrain.benchmarks.timing import TimedContext, lap, spread
from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.grids import ElevationGrid
from sketchterrain.elevation.selection import Patchwork

SEED = 1

_STEP = 10.0  # m: Puget Sound's, as in the paper
_RELIEF = 600.0  # m, standard deviation of heights
_EXPONENT = 1.9  # of amplitudes: the power of real relief falls as k^-3.8 or so
_ERRORS = (0, 0.5, 1, 2, 3, 4, 5, 7, 10, 15, 20, 25, 30, 40, 50, 70, 100, 150, 200, 300)  # m
_PAPER = {1024: 0.75, 4096: 11.73, 16384: 196.2}  # s, one core of a Core i5 of 2.67 GHz
_PAPER_QUERIES = {50.0: 800.0, 0.0: 55.0}
_QUERIES = 200
_TRUTH_STEP, _TRUTH_SIDE = 10.0, 1024
_WAVES = 12.0  # steps of the truth: shorter waves are filtered out
_ANGLES = (0.0, 15.0, 30.0, 45.0)  # degrees
_FINE, _COARSE = 30.0, 120.0  # m
_FEATHER = 250.0  # m, Mapterhorn's
_BAND = 300.0  # m on each side of the rim of the fine grid

_BOUNDS = (
    Column("error", "e, m"),
    Column("patches", "patches"),
    Column("most", "largest error, m"),
    Column("rms", "rms, m"),
    Column("overlap", "patches at a point, mean"),
    Column("overlap_most", "most"),
    Column("histogram", "points with 1, 2, … patches, %"),
)
_BUILDS = (
    Column("side", "side, samples"),
    Column("total_s", "in memory, s"),
    Column("paper_s", "paper, bilinear, s"),
    Column("patches", "patches"),
    Column("add_s", "adding a grid of 1024², s"),
)
_STORES = (
    Column("side", "side, samples"),
    Column("build_s", "file to store, s"),
    Column("megabytes", "most memory, MB"),
    Column("open_ms", "opening, ms"),
    Column("far_ms", "1,000 patches at 50 m, ms"),
    Column("together_ms", "1,000 finest ones side by side"),
    Column("apart_ms", "anywhere"),
    Column("view_ms", "view of 15 km at 1 px, ms"),
    Column("view_patches", "its patches"),
    Column("add_s", "adding a grid of 1024², s"),
    Column("bytes", "bytes a sample"),
    Column("overhead", "over float32, %"),
    Column("beside_finest", "over the finest level, %"),
)
_RATES = (
    Column("side", "side, samples"),
    Column("error", "e, m"),
    Column("patches", "patches"),
    Column("queries", "queries a second"),
    Column("paper", "paper's"),
    Column("surface_ms", "surface, ms"),
    Column("rows", "points by rows, M/s"),
    Column("random", "at random, M/s"),
)
_SEAMS = (
    Column("degrees", "rotation, °"),
    Column("method", "method"),
    Column("inside", "rms inside the fine grid, m"),
    Column("rim", "at its rim, m"),
    Column("slope", "worst slope of the error inside"),
    Column("rim_slope", "at the rim"),
)


def measure(_: TimedContext, effort: Effort) -> Outcome:
    """Patchworks of generated DEM grids (Rocca, Panozzo & Puppo 2012), times in seconds beside the paper's.

    The ground is noise whose amplitudes fall as k^-1.9, in steps of 10 m, with a deviation of 600 m. Errors
    are those at all samples of one grid; queries are uniform covers of all of it. Times of building are
    medians; the paper's are those of one core, Puget Sound and bilinear patches, ours of bicubic ones. Seams:
    a grid of 30 m, rotated, in one of 120 m, both filtered from a truth in steps of 10 m, beside the same
    grids resampled to 30 m: by GDAL's bilinear warp with rasterio.merge (the fine grid first), by its cubic
    spline warp one over the other, and by that with Mapterhorn's feathered mask, 250 m wide. Stores are those
    of `write_large_dem`, each in a process of its own, whose memory is counted beyond that of its libraries;
    patches are read from files that are not in the system's memory.
    """
    sides = effort.elevation_sides
    return Outcome(
        (
            Table("Exactness and bound", _BOUNDS, tuple(_bounds(sides[0]))),
            Table("Building", _BUILDS, tuple(_build(each, effort.rounds) for each in sides)),
            Table("Stores on disk", _STORES, tuple(_store(each) for each in sides)),
            Table("Queries and evaluation", _RATES, tuple(_rates(sides[0]))),
            Table("Seams", _SEAMS, tuple(row for angle in _ANGLES for row in _seams(angle))),
        )
    )


def generated_heights(side: int, seed: int = SEED) -> Float32Array:
    """Return heights (side, side), m, of noise with the spectrum of relief."""
    small = min(side, 4096)
    frequency = np.hypot(np.fft.fftfreq(small)[:, None], np.fft.rfftfreq(small)[None])
    frequency[0, 0] = 1.0
    noise = np.fft.rfft2(np.random.default_rng(seed).normal(size=(small, small)))
    height = np.fft.irfft2(noise * frequency**-_EXPONENT)
    height *= _RELIEF / height.std()
    return np.tile((height + 1500.0).astype(np.float32), (side // small, side // small))


def _grid(side: int, place: tuple[float, ...] | None = None, seed: int = SEED) -> ElevationGrid:
    at: Any = place or (_STEP, 0.0, 0.0, 0.0, -_STEP, _STEP * (side - 1))
    return ElevationGrid(generated_heights(side, seed), at)


def _patchwork(*grids: ElevationGrid) -> Patchwork:
    parts = [build_patches(each) for each in grids]
    return Patchwork({each.id: each for each in parts})


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
    work, times = Patchwork(), []
    for _ in range(rounds):
        start = perf_counter()
        work = _patchwork(grid)
        work.tops  # noqa: B018
        times.append(perf_counter() - start)
    far = 0.3 * _STEP * side
    inset = build_patches(_grid(min(side, 1024), (9.0, 4.0, far, 4.0, -9.0, far), SEED + 1))
    return {
        "side": side,
        "total_s": spread(times).median,
        "paper_s": _PAPER.get(side),
        "patches": len(work),
        "add_s": lap(lambda: work.with_grid(inset).tops).wall,
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


def _seams(degrees: float) -> list[Row]:
    truth = ndimage.gaussian_filter(
        generated_heights(_TRUTH_SIDE).astype(np.float64), _WAVES / 4.0, mode="wrap"
    )
    extent = _TRUTH_STEP * (_TRUTH_SIDE - 1)
    fine = _sampled(truth, _FINE, 0.45 * extent, degrees, 1.0)
    coarse = _sampled(truth, _COARSE, 0.95 * extent, 0.0, 10.0)
    axis = np.arange(0.15 * extent, 0.85 * extent, _FINE)
    x, y = np.meshgrid(axis, axis[::-1])
    exact = ndimage.map_coordinates(truth, [y / _TRUTH_STEP, x / _TRUTH_STEP], order=3)
    angle, middle = math.radians(degrees), 0.5 * extent
    along = (x - middle) * math.cos(angle) + (y - middle) * math.sin(angle)
    across = (y - middle) * math.cos(angle) - (x - middle) * math.sin(angle)
    depth = 0.225 * extent - np.maximum(np.abs(along), np.abs(across))
    work = _patchwork(fine, coarse)
    methods: dict[str, Callable[[], Float64Array]] = {
        "patches": lambda: work.surface(work.cover(0.0)).evaluate(x, y).height,
        "patches, the paper's weights": lambda: (
            work.surface(work.cover(0.0), wendland=True).evaluate(x, y).height
        ),
        **_peers(fine, coarse, axis),
    }
    rows: list[Row] = []
    for name, method in methods.items():
        off = method() - exact
        slope = np.hypot(*np.gradient(off, _FINE))
        inside, rim = depth > _BAND, np.abs(depth) < _BAND
        rows.append(
            {
                "degrees": degrees,
                "method": name,
                "inside": float(np.sqrt(np.mean(off[inside] ** 2))),
                "rim": float(np.sqrt(np.mean(off[rim] ** 2))),
                "slope": float(slope[inside].max()),
                "rim_slope": float(slope[rim].max()),
            }
        )
    return rows


def _sampled(truth: Float64Array, step: float, side: float, degrees: float, accuracy: float) -> ElevationGrid:
    """Return a rotated grid in the middle of the truth, filtered for its step."""
    count = int(side / step)
    middle = 0.5 * _TRUTH_STEP * (_TRUTH_SIDE - 1)
    a, d = step * math.cos(math.radians(degrees)), step * math.sin(math.radians(degrees))
    half = 0.5 * (count - 1)
    place = (a, d, middle - (a + d) * half, d, -a, middle - (d - a) * half)
    column, row = np.meshgrid(np.arange(float(count)), np.arange(float(count)))
    x, y = place[0] * column + place[1] * row + place[2], place[3] * column + place[4] * row + place[5]
    filtered = ndimage.gaussian_filter(truth, 0.4 * step / _TRUTH_STEP)
    samples = ndimage.map_coordinates(filtered, [y / _TRUTH_STEP, x / _TRUTH_STEP], order=3)
    return ElevationGrid(samples.astype(np.float32), place, accuracy)


def _peers(
    fine: ElevationGrid, coarse: ElevationGrid, axis: Float64Array
) -> dict[str, Callable[[], Float64Array]]:
    """Return other ways to join two grids, on a grid of the finer step."""
    from rasterio import Affine, MemoryFile
    from rasterio.enums import Resampling
    from rasterio.merge import merge
    from rasterio.warp import reproject

    crs, size = "EPSG:32610", len(axis)
    target = Affine(_FINE, 0.0, axis[0] - 0.5 * _FINE, 0.0, -_FINE, axis[-1] + 0.5 * _FINE)

    def warped(grid: ElevationGrid, how: Resampling) -> Float64Array:
        a, b, c, d, e, f = grid.place
        source = Affine(a, b, c - 0.5 * (a + b), d, e, f - 0.5 * (d + e))
        found = np.full((size, size), np.nan, np.float32)
        places = {"src_transform": source, "dst_transform": target, "src_crs": crs, "dst_crs": crs}
        reproject(grid.samples, found, **places, dst_nodata=np.nan, resampling=how)
        return found.astype(np.float64)

    def merged() -> Float64Array:
        profile = {"driver": "GTiff", "width": size, "height": size, "count": 1, "dtype": "float32"}
        files = [MemoryFile() for _ in range(2)]
        for file, grid in zip(files, (fine, coarse), strict=True):
            with file.open(**profile, crs=crs, transform=target, nodata=np.nan) as each:
                each.write(warped(grid, Resampling.bilinear).astype(np.float32), 1)
        sources = [file.open() for file in files]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # rasterio multiplies transforms by `*`
            found, _ = merge(sources)
        return np.asarray(found[0], np.float64)

    def cubic() -> Float64Array:
        over, under = (warped(each, Resampling.cubic_spline) for each in (fine, coarse))
        return np.where(np.isnan(over), under, over)

    def feathered() -> Float64Array:
        over, under = (warped(each, Resampling.cubic_spline) for each in (fine, coarse))
        known = np.isfinite(over)
        t = np.clip(ndimage.distance_transform_edt(known) * _FINE / _FEATHER, 0.0, 1.0)
        part = t * t * (3.0 - 2.0 * t)
        return np.asarray(np.where(known, part * np.nan_to_num(over), 0.0) + (1.0 - part) * under)

    return {
        "rasterio.merge, bilinear": merged,
        "gdalwarp, cubic spline": cubic,
        "cubic spline, feathered": feathered,
    }
