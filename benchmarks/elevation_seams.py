"""Seams between DEM grids: patches beside other ways to join them, on generated and on real relief."""

from __future__ import annotations

import math
import os
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage

from sketchterrain.array_types import BoolArray, Float32Array, Float64Array
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.report import Row, Table, value_of
from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.grids import ElevationGrid, SketchFrame, read_grid
from sketchterrain.elevation.mips import without_voids
from sketchterrain.elevation.selection import Patchwork

SEED = 1
FOLDER = "SKETCHTERRAIN_DEMS"
"""Environment variable: a folder with the files of `_REAL`; without it, generated relief is measured."""

_RELIEF = 600.0  # m, standard deviation of heights
_EXPONENT = 1.9  # of amplitudes: the power of real relief falls as k^-3.8 or so
_SIDE, _WAVES = 1024, 12.0  # samples of generated truth, and their steps below which waves are filtered out
_REAL = {  # and the distance of samples, m, which is taken to be the same in both directions
    "bigtujunga30m_utm11.tif": 30.0,
    "N42E001.hgt.zip": 90.0,
    "jacksboro_fault_dem.npz": 90.0,
    "terra_elev_vinschgau.tif": 250.0,
}
_RATIO = 4.0  # of the steps of the coarse and the fine grid
_MAPTERHORN, _EROSION, _BOX = 250.0 / 30.0, 0.5, 1.25  # its 250 m, in steps of 30 m; shares of them
_BAND = 10.0  # fine steps on each side of the rim of the fine grid
_OWN = "patches"

_ERRORS = {
    "inside": "rms inside the fine grid, m",
    "rim": "at its rim, m",
    "slope": "worst slope of the error inside",
    "rim_slope": "at the rim",
}


class _Truth(NamedTuple):
    name: str
    heights: Float64Array
    step: float  # m
    fine: float  # m


def seam_tables(effort: Effort) -> tuple[Table, Table]:
    """Return errors and seams where a fine grid, rotated, ends on one with 4 times its steps.

    Both are filtered and sampled from the truth. Peers resample both to the fine step, a fraction off its
    samples: GDAL's bilinear warp with rasterio.merge (the fine grid first), its cubic spline warp one over
    the other; and re-implementations of dem_mosaic of the Ames Stereo Pipeline (weights are Manhattan
    distances from the rims, squared; or, by priority, cubed within the blending length) and of Mapterhorn
    (mask eroded by half of its width, box filter, smoothstep). Real grids are taken to be square and free of
    voids.
    """
    rows = [
        row
        for truth in _truths(effort)
        for degrees in effort.elevation_angles
        for row in _seams(truth, degrees)
    ]
    summary = tuple(_summary(rows))
    return Table("Seams", tuple(rows), _ERRORS), Table("Seams, means of all angles", summary, _ERRORS)


def generated_heights(side: int, seed: int = SEED) -> Float32Array:
    """Return heights (side, side), m, of noise with the spectrum of relief."""
    small = min(side, 4096)
    frequency = np.hypot(np.fft.fftfreq(small)[:, None], np.fft.rfftfreq(small)[None])
    frequency[0, 0] = 1.0
    noise = np.fft.rfft2(np.random.default_rng(seed).normal(size=(small, small)))
    height = np.fft.irfft2(noise * frequency**-_EXPONENT)
    height *= _RELIEF / height.std()
    return np.tile((height + 1500.0).astype(np.float32), (side // small, side // small))


def patchwork(*grids: ElevationGrid) -> Patchwork:
    """Return the patchwork of some grids."""
    parts = [build_patches(each) for each in grids]
    return Patchwork({each.id: each for each in parts})


def _truths(effort: Effort) -> Iterator[_Truth]:
    heights = generated_heights(_SIDE).astype(np.float64)
    yield _Truth("generated", ndimage.gaussian_filter(heights, _WAVES / 4.0, mode="wrap"), 10.0, 30.0)
    folder = os.environ.get(FOLDER, "")
    for name, step in list(_REAL.items())[: effort.elevation_dems]:
        path = Path(folder) / name
        if folder and path.is_file():
            crs = "EPSG:4326" if path.suffix == ".npz" else None
            grid = read_grid(path, SketchFrame("EPSG:32632"), crs=crs)
            yield _Truth(
                path.name.partition(".")[0], without_voids(grid.samples).astype(np.float64), step, step
            )


def _seams(truth: _Truth, degrees: float) -> list[Row]:
    fine_step, size = truth.fine, np.array(truth.heights.shape[::-1]) - 1.0
    extent = truth.step * size
    side = 0.45 * float(extent.min())
    fine = _sampled(truth, fine_step, (side, side), degrees, 1.0)
    coarse = _sampled(truth, _RATIO * fine_step, (0.95 * extent[0], 0.95 * extent[1]), 0.0, 10.0)
    middle = 0.5 * extent
    half = 0.35 * extent.min()
    x_axis, y_axis = (np.arange(m - half, m + half, fine_step) + 0.37 * fine_step for m in middle)
    x, y = np.meshgrid(x_axis, y_axis[::-1])
    exact = ndimage.map_coordinates(truth.heights, [y / truth.step, x / truth.step], order=3)
    angle = math.radians(degrees)
    along = (x - middle[0]) * math.cos(angle) + (y - middle[1]) * math.sin(angle)
    across = (y - middle[1]) * math.cos(angle) - (x - middle[0]) * math.sin(angle)
    depth = 0.5 * side - np.maximum(np.abs(along), np.abs(across))
    work = patchwork(fine, coarse)
    which = work.cover(0.0)
    methods: dict[str, Callable[[], Float64Array]] = {
        _OWN: lambda: work.surface(which).evaluate(x, y).height,
        **_peers(fine, coarse, x_axis, y_axis, fine_step),
    }
    inside, rim = depth > _BAND * fine_step, np.abs(depth) < _BAND * fine_step
    rows: list[Row] = []
    for name, method in methods.items():
        off = method() - exact
        slope = np.hypot(*np.gradient(off, fine_step))
        rows.append(
            {
                "ground": truth.name,
                "degrees": degrees,
                "method": name,
                "inside": float(np.sqrt(np.mean(off[inside] ** 2))),
                "rim": float(np.sqrt(np.mean(off[rim] ** 2))),
                "slope": float(slope[inside].max()),
                "rim_slope": float(slope[rim].max()),
            }
        )
    return rows


def _summary(rows: list[Row]) -> Iterator[Row]:
    """Yield means over all angles, and in how many comparisons each method is the best."""
    grouped: dict[tuple[Any, Any], list[Row]] = defaultdict(list)
    for row in rows:
        grouped[row["ground"], row["method"]].append(row)
    for (ground, method), mine in grouped.items():
        rivals = [row for row in rows if row["ground"] == ground]
        best = sum(
            value_of(row, key)
            == min(value_of(each, key) for each in rivals if each["degrees"] == row["degrees"])
            for row in mine
            for key in _ERRORS
        )
        means = {key: float(np.mean([value_of(row, key) for row in mine])) for key in _ERRORS}
        yield {"ground": ground, "method": method, **means, "best": f"{best} of {len(mine) * len(_ERRORS)}"}


def _sampled(
    truth: _Truth, step: float, sides: tuple[float, float], degrees: float, accuracy: float
) -> ElevationGrid:
    """Return a rotated grid in the middle of the truth, filtered for its step."""
    counts = [int(each / step) for each in sides]
    x_middle, y_middle = (0.5 * truth.step * (n - 1) for n in truth.heights.shape[::-1])
    a, d = step * math.cos(math.radians(degrees)), step * math.sin(math.radians(degrees))
    right, down = (0.5 * (n - 1) for n in counts)
    place = (a, d, x_middle - a * right - d * down, d, -a, y_middle - d * right + a * down)
    column, row = np.meshgrid(np.arange(float(counts[0])), np.arange(float(counts[1])))
    x, y = place[0] * column + place[1] * row + place[2], place[3] * column + place[4] * row + place[5]
    filtered = ndimage.gaussian_filter(truth.heights, 0.4 * math.sqrt((step / truth.step) ** 2 - 1.0))
    samples = ndimage.map_coordinates(filtered, [y / truth.step, x / truth.step], order=3)
    return ElevationGrid(samples.astype(np.float32), place, accuracy)


def _peers(
    fine: ElevationGrid, coarse: ElevationGrid, x: Float64Array, y: Float64Array, step: float
) -> dict[str, Callable[[], Float64Array]]:
    """Return other ways to join two grids, on a grid of the finer step."""
    from rasterio import Affine, MemoryFile
    from rasterio.enums import Resampling
    from rasterio.merge import merge
    from rasterio.warp import reproject

    crs, shape = "EPSG:32610", (len(y), len(x))
    target = Affine(step, 0.0, x[0] - 0.5 * step, 0.0, -step, y[-1] + 0.5 * step)

    def warped(grid: ElevationGrid, how: Resampling, values: Any = None) -> Float64Array:
        a, b, c, d, e, f = grid.place
        source = Affine(a, b, c - 0.5 * (a + b), d, e, f - 0.5 * (d + e))
        found = np.full(shape, np.nan, np.float32)
        places = {"src_transform": source, "dst_transform": target, "src_crs": crs, "dst_crs": crs}
        heights = grid.samples if values is None else values.astype(np.float32)
        reproject(heights, found, **places, dst_nodata=np.nan, resampling=how)
        return found.astype(np.float64)

    def merged() -> Float64Array:
        profile = {"driver": "GTiff", "width": len(x), "height": len(y), "count": 1, "dtype": "float32"}
        files = [MemoryFile() for _ in range(2)]
        for file, grid in zip(files, (fine, coarse), strict=True):
            with file.open(**profile, crs=crs, transform=target, nodata=np.nan) as each:
                each.write(warped(grid, Resampling.bilinear).astype(np.float32), 1)
        sources = [file.open() for file in files]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # rasterio multiplies transforms by `*`
            found, _ = merge(sources)
        return np.asarray(found[0], np.float64)

    def over(part: Float64Array, fine_heights: Float64Array, coarse_heights: Float64Array) -> Float64Array:
        return np.where(part > 0.0, part * np.nan_to_num(fine_heights), 0.0) + (1.0 - part) * coarse_heights

    def cubic() -> Float64Array:
        heights, below = (warped(each, Resampling.cubic_spline) for each in (fine, coarse))
        return over(np.isfinite(heights).astype(np.float64), heights, below)

    def mosaic() -> Float64Array:
        pairs = [
            (
                warped(each, Resampling.bilinear),
                warped(each, Resampling.bilinear, _grassfire(each.samples)) ** 2,
            )
            for each in (fine, coarse)
        ]
        weights = [np.where(np.isfinite(height), np.nan_to_num(weight), 0.0) for height, weight in pairs]
        return over(weights[0] / (weights[0] + weights[1]), pairs[0][0], pairs[1][0])

    def by_priority() -> Float64Array:
        heights, below = (warped(each, Resampling.bilinear) for each in (fine, coarse))
        depth = _grassfire(heights)
        rest = np.where(depth < _MAPTERHORN, 1.0, np.nan)  # the coarse grid without what the fine one covers
        weights = depth**3, _grassfire(rest) ** 3
        return over(weights[0] / (weights[0] + weights[1]), heights, below)

    def mapterhorn() -> Float64Array:
        heights, below = (warped(each, Resampling.cubic_spline) for each in (fine, coarse))
        width = _EROSION * _MAPTERHORN
        eroded = ndimage.binary_erosion(np.isfinite(heights), iterations=round(width))
        t = ndimage.uniform_filter(eroded.astype(np.float64), 2 * round(0.5 * _BOX * width) + 1)
        return over(t * t * (3.0 - 2.0 * t), heights, below)

    return {
        "rasterio.merge, bilinear": merged,
        "gdalwarp, cubic spline": cubic,
        "dem_mosaic's weights": mosaic,
        "dem_mosaic's, by priority": by_priority,
        "Mapterhorn's mask": mapterhorn,
    }


def _grassfire(heights: Float32Array | Float64Array) -> Float64Array:
    """Return Manhattan distances from voids and the rim, 1 beside them."""
    known: BoolArray = np.pad(np.isfinite(heights), 1)
    return np.asarray(ndimage.distance_transform_cdt(known, "taxicab")[1:-1, 1:-1], np.float64)
