"""How much detail a DEM lost below its resolution, by wavelength and slope, measured from the DEM alone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import ndimage
from scipy.optimize import nnls

from sketchterrain.array_types import BoolArray, Float32Array, Float64Array
from sketchterrain.elevation.grids import ElevationGrid
from sketchterrain.elevation.mips import without_voids

LEVEL: Final = 0.02
"""Slope below which there is less and less detail: lakes and plains stay level."""

_SAMPLES = 4.5  # steps of the longest wavelength that a grid lost
_STEEPENING = 0.23  # by which the exponent of relief grows with each finer octave
_EXPONENTS = np.linspace(0.3, 1.6, 1301)
_UNRESOLVED = 1.9  # exponent of octaves that are smoothed or interpolated, no ground
_COARSER = 2.4  # what averages over 4 lose over those over 2, in small grids
_CORRELATION = 0.3  # of what successive averages lose
_WAVES = 0.4  # step of the averages that lose a wavelength, over it
_ROUGH = 0.006  # rms of the finest octaves over their wavelength, on a slope of 1 …
_STEEP = 0.08  # … and of the steepest ones: more than in any DEM that was looked at
_FACTORS = (2, 4, 8, 16)
_RIM = 3  # averages beside voids and the grid's rim that are not compared
_PART, _ROWS = 256, 64  # side of each of the four parts that are measured of large grids; read at once
_CLASSES = 16
_LEAST = 1e-3  # m, loss of relief: samples are rounded
_CLIFF = 50.0  # square of a loss over the median one: seams and spikes are no relief


@dataclass(frozen=True)
class DetailLaw:
    """Amplitudes of the detail below the samples of a grid (docs/kernels/base.md)."""

    step: float  # m, between samples that the ground is resolved at
    lost: float = 0.0  # m, rms of what samples so far apart lose
    exponent: float = 1.0  # log2 of what samples twice as far apart lose, over that
    shape: tuple[float, ...] = (1.0, 1.0, 1.0)  # square of the amplitude on gentle, middling, steep slopes
    slope: float = 1.0  # root mean square slope

    @property
    def resolution(self) -> float:
        """Longest wavelength that is lost, m."""
        return _SAMPLES * self.step

    def lost_at(self, step: Float64Array) -> Float64Array:
        """Return the rms (m) of what samples so far apart lose."""
        octaves = np.log2(step / self.step)
        here = self.exponent + 0.5 * _STEEPENING
        gentlest, steepest = min(_EXPONENTS[0], here), max(_EXPONENTS[-1], here)  # beyond x
        x = np.clip(octaves, (here - steepest) / _STEEPENING, (here - gentlest) / _STEEPENING)
        power = (here - 0.5 * _STEEPENING * x) * x
        power += np.where(octaves < x, steepest, gentlest) * (octaves - x)
        return np.asarray(self.lost * 2.0**power)

    def octave(self, wavelength: Float64Array) -> Float64Array:
        """Return the rms (m) of octaves of detail on all slopes."""
        step = _WAVES * wavelength
        octave = np.sqrt(self.lost_at(step) ** 2 - self.lost_at(0.5 * step) ** 2)
        per_slope = self.slope * wavelength
        return np.clip(octave, _ROUGH * per_slope * (self.lost > 0.0), _STEEP * per_slope)


def slope_terms(square: Float64Array, slope: float) -> Float64Array:
    """Return the terms (…, 3) of the square amplitude by the square of the slope."""
    t = square / (square + slope**2)
    level = (square / (square + LEVEL**2)) ** 2
    return np.stack([level * (1.0 - t) ** 2, level * 2.0 * t * (1.0 - t), level * t * t], axis=-1)


def measure_detail(grid: ElevationGrid) -> DetailLaw:
    """Return the law of a grid's detail, extrapolated from what averages over 2 to 16 samples lose.

    Where the finest octaves are much smoother than relief, the ground is resolved at 2, 4 … steps only.
    """
    rows, columns = grid.shape
    column, row = np.array([0.0, 1.0, 0.0]) + columns // 2, np.array([0.0, 0.0, 1.0]) + rows // 2
    x, y = grid.to_metres(column, row)
    steps = math.hypot(x[1] - x[0], y[1] - y[0]), math.hypot(x[2] - x[0], y[2] - y[0])
    parts = _parts(grid)
    found: list[tuple[float, Float64Array, Float64Array]] = []
    for n in _FACTORS:
        losses = [_losses(z.astype(np.float64), n, steps) for z in parts if min(z.shape) >= n]
        square = np.concatenate([each[0] for each in losses] or [np.zeros(0)])
        if square.size < _CLASSES**2:
            break
        square = np.minimum(square, _CLIFF * np.median(square))
        found.append((math.sqrt(np.mean(square)), square, np.concatenate([each[1] for each in losses])))
    step, rms = _rounded(math.sqrt(steps[0] * steps[1])), [each[0] for each in found]
    if not rms or min(rms) < _LEAST:
        return DetailLaw(step)
    rms += [rms[0] * _COARSER] * (len(rms) == 1)
    first = 0
    while first + 2 < len(rms) and math.log2(rms[first + 1] / rms[first]) > _UNRESOLVED:
        first += 1
    lost, exponent = _extrapolated(*rms[first : first + 2])
    slope = _rounded(math.sqrt(np.mean(found[first][2])))
    step *= 2**first
    lost = min(lost, _rounded(_STEEP * slope * _SAMPLES * step))
    return DetailLaw(step, lost, exponent, _shape(*found[first][1:], slope), slope)


def _parts(grid: ElevationGrid) -> list[Float32Array]:
    """Return all samples, or four parts of many, read by few rows."""
    rows, columns = grid.shape
    if rows * columns <= 4 * _PART**2:
        return [grid.samples[:]]
    across, down = ([max(int(share * n) - _PART // 2, 0) for share in (0.3, 0.7)] for n in (columns, rows))
    parts: list[Float32Array] = []
    for first in down:
        strips = (grid.samples[i : i + _ROWS] for i in range(first, min(first + _PART, rows), _ROWS))
        pairs = [[each[:, j : j + _PART].copy() for j in across] for each in strips]
        parts += map(np.concatenate, zip(*pairs, strict=True))
    return parts


def _losses(z: Float64Array, n: int, steps: tuple[float, float]) -> tuple[Float64Array, Float64Array]:
    """Return squares of what means of n × n samples lose (m²), and of slopes of splines through them."""
    rows, columns = (side // n for side in z.shape)
    z = z[: rows * n, : columns * n]
    blocks = rows, n, columns, n
    void = np.isnan(z).reshape(blocks).any(axis=(1, 3))
    near = ndimage.maximum_filter(void, 2 * _RIM + 1, mode="constant", cval=1)
    used: BoolArray = ~np.repeat(np.repeat(near, n, axis=0), n, axis=1)
    z = without_voids(z.astype(np.float32)).astype(np.float64)
    means = z.reshape(blocks).mean(axis=(1, 3))
    smooth = ndimage.zoom(means, n, order=3, mode="grid-mirror", grid_mode=True)
    south, east = (np.asarray(each) for each in np.gradient(smooth, steps[1], steps[0]))
    return (z - smooth)[used] ** 2, (south**2 + east**2)[used]


def _extrapolated(fine: float, coarse: float) -> tuple[float, float]:
    """Return what samples lost (m), and the exponent of what averages of two lose over it.

    With losses L of steps h, 2 h, 4 h and differences D of the latter two from the samples (m),
    L² = D² + L(h)² + 2 ρ D L(h), and the exponent of L falls by a constant from one octave to the next.
    """
    gain = 4.0**_EXPONENTS - 1.0
    lost = fine * (_CORRELATION + np.sqrt(_CORRELATION**2 + gain)) / gain
    ratio = np.sqrt(coarse**2 + lost**2 + 2.0 * _CORRELATION * coarse * lost) / lost
    best = np.argmin(np.abs(np.log2(ratio) - 2.0 * _EXPONENTS + _STEEPENING))
    return _rounded(lost[best]), _rounded(_EXPONENTS[best])


def _shape(square: Float64Array, slopes: Float64Array, slope: float) -> tuple[float, ...]:
    """Return the square of the amplitude by slope, of mean 1, fitted to the means of classes."""
    ends = np.quantile(slopes, np.linspace(0.0, 1.0, _CLASSES + 1))
    member = np.searchsorted(ends[1:-1], slopes, side="right")
    sums = [np.bincount(member, each, _CLASSES) for each in (square, *slope_terms(slopes, slope).T)]
    loss, *terms = (each / np.maximum(np.bincount(member, minlength=_CLASSES), 1) for each in sums)
    loss = np.maximum(loss / np.mean(square), 0.05)
    fit = nnls(np.stack(terms, axis=-1) / loss[:, None], np.ones(_CLASSES))[0]
    return tuple(_rounded(each) for each in fit)


def _rounded(value: float) -> float:
    """Return a number of four digits: sums differ in their last bits from machine to machine."""
    return float(f"{value:.4g}")
