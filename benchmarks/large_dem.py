"""A DEM of any size for benchmarks, made of a real one, as a tiled GeoTIFF."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from scipy import ndimage

from sketchterrain.array_types import Float32Array

STEP = 10.0  # m
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
    place = rasterio.Affine(STEP, 0.0, 0.0, 0.0, -STEP, STEP * side)
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
