"""Defects of DEM samples: values that mean "no data", collars, voids, spikes and terraces."""

from __future__ import annotations

from typing import Any, Final, TypeAlias

import numpy as np
from numba import njit
from scipy import ndimage

from sketchterrain.array_types import BoolArray, Float32Array

Findings: TypeAlias = tuple[str, ...]
"""What was found, in words, with counts."""

MAX_FILLED: Final = 64
"""Largest side (samples) of a void that is filled."""

_SENTINELS = (-9999.0, 9999.0, -999.0)  # where no height is near them
_SENTINEL_GAP = 100.0  # m
_HEIGHTS = 12_000.0  # m: deeper and higher is no place on Earth
_COLLAR_HEIGHT = 20.0  # m: zeros along a rim are not the sea where the ground beside them is so high
_EIGHT = np.ones((3, 3), np.uint8)
_SPIKE_SLOPE, _SPIKE_TIMES = 1.5, 12.0
_TERRACED = 0.3  # share of samples equal to their neighbour
_TERRACE_ROUNDS = 10
_MAX_ROUNDS, _CLOSE = 2000, 1e-4  # of the membrane; m


def clean_samples(raw: Any, known: BoolArray, step: float) -> tuple[Float32Array, Findings]:
    """Return heights (m) with NaN for voids, of which small ones are filled, and what was found.

    `raw` (rows, columns) are a file's values, `known` where it has data, `step` the distance (m) of samples.
    Spikes and terraces are reported and kept.
    """
    found = []
    values = raw.astype(np.float32)
    with np.errstate(invalid="ignore"):
        odd = known & ~(np.abs(values) <= _HEIGHTS)
    if odd.any():
        names = sorted({f"{each:.6g}" for each in np.unique(values[odd])[:4]})
        found.append(f"{np.count_nonzero(odd)} samples of no data ({', '.join(names)})")
    known = known & ~odd
    for sentinel in _SENTINELS:
        hit = known & (values == sentinel)
        if hit.any() and not (known & ~hit & (np.abs(values - sentinel) < _SENTINEL_GAP)).any():
            found.append(f"{np.count_nonzero(hit)} samples of no data ({sentinel:g})")
            known &= ~hit
    collar = _collar(values, known)
    if collar.any():
        found.append(f"{np.count_nonzero(collar)} zeros in collars along the rim, taken for no data")
        known &= ~collar
    samples = np.where(known, values, np.float32(np.nan))
    if known.any():
        found += _spikes(samples, step) + _terraces(samples)
        found += [] if known.all() else _fill_small_voids(samples)
    return samples, tuple(found)


def smooth_terraces(samples: Float32Array) -> tuple[Float32Array, Findings]:
    """Return heights in steps smoothed by at most half a step, and what was done; others as they are."""
    found = _quantum(samples)
    if found is None:
        return samples, ()
    known, half = np.isfinite(samples), 0.5 * found[0]
    # Half a step above and below at borders, in between by the distances (samples) from them.
    highest = ndimage.maximum_filter(np.where(known, samples, -np.inf), 3)
    lowest = ndimage.minimum_filter(np.where(known, samples, np.inf), 3)
    up, down = (ndimage.distance_transform_edt(each == samples) + 0.5 for each in (highest, lowest))
    heights = np.where(known, samples + half * (down - up) / (down + up), 0.0)
    weight = np.maximum(ndimage.gaussian_filter(known.astype(np.float64), 1.0), 1e-6)
    for _ in range(_TERRACE_ROUNDS):
        heights = ndimage.gaussian_filter(heights, 1.0) / weight
        heights = np.where(known, np.clip(heights, samples - half, samples + half), 0.0)
    changed = np.where(known, heights, np.nan).astype(np.float32)
    most = float(np.nanmax(np.abs(changed - samples)))
    return changed, (f"terraces of {found[0]:.3g} m smoothed, by at most {most:.2g} m",)


def _collar(values: Float32Array, known: BoolArray) -> BoolArray:
    """Return where zeros form a collar along the rim, or beside voids, at the foot of a cliff."""
    zero = known & (values == 0.0)
    collar = np.zeros(zero.shape, bool)
    if not zero.any():
        return collar
    labels, _ = ndimage.label(zero, _EIGHT)
    rim = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    boxes = ndimage.find_objects(labels)
    for label in np.unique(rim[rim > 0]):
        rows, columns = boxes[label - 1]
        part = np.s_[max(rows.start - 1, 0) : rows.stop + 1, max(columns.start - 1, 0) : columns.stop + 1]
        region = labels[part] == label
        beside = ndimage.binary_dilation(region, _EIGHT) & known[part] & ~zero[part]
        if beside.any() and np.median(np.abs(values[part][beside])) > _COLLAR_HEIGHT:
            collar[part] |= region
    return collar


def _spikes(samples: Float32Array, step: float) -> list[str]:
    """Report samples that stand out from all their neighbours, by steep slopes and unlike others."""
    inner = samples[1:-1, 1:-1]
    if not inner.size:
        return []
    rows, columns = samples.shape
    least = np.full(inner.shape, np.inf, np.float32)
    above, below = least.copy(), least.copy()
    with np.errstate(invalid="ignore"):
        for row in range(3):
            for column in range(3):
                if (row, column) != (1, 1):
                    rise = inner - samples[row : row + rows - 2, column : column + columns - 2]
                    np.fmin(above, rise, out=above)
                    np.fmin(below, -rise, out=below)
        stands_out = np.maximum(above, below)
        rises = np.diff(samples, axis=0)
        rises = np.abs(rises[np.isfinite(rises)])
        usual = float(np.median(rises)) if len(rises) else 0.0
        count = np.count_nonzero(
            (stands_out > max(_SPIKE_SLOPE * step, _SPIKE_TIMES * (usual + 1e-6))) & np.isfinite(stands_out)
        )
    return [f"{count} spikes, higher or lower than all their neighbours (kept)"] if count else []


def _terraces(samples: Float32Array) -> list[str]:
    """Report heights in steps."""
    if (found := _quantum(samples)) is None:
        return []
    quantum, share = found
    equal = f"{100.0 * share:.0f} % of neighbours are equal"
    return [f"terraces: {equal}, heights are in steps of {quantum:.3g} m (kept)"]


def _quantum(samples: Float32Array) -> tuple[float, float] | None:
    """Return the step of heights, and the share of equal neighbours, where these are many."""
    rise = np.abs(np.diff(samples[: 1 << 11, : 1 << 11], axis=1))
    rise = rise[np.isfinite(rise)]
    moved = rise[rise > 1e-4]
    if not len(moved) or len(moved) > (1.0 - _TERRACED) * len(rise):
        return None
    quantum = float(moved.min())
    multiples = moved / quantum
    if np.mean(np.abs(multiples - np.round(multiples)) < 0.02) < 0.99:
        return None
    return quantum, 1.0 - len(moved) / len(rise)


def _fill_small_voids(samples: Float32Array) -> list[str]:
    """Fill voids that don't touch the rim and are at most `MAX_FILLED` across, in place, by a membrane."""
    labels, _ = ndimage.label(np.isnan(samples), _EIGHT)
    counts = np.bincount(labels.ravel())
    boxes = np.array([(r.start, r.stop, c.start, c.stop) for r, c in ndimage.find_objects(labels)])
    top, bottom, left, right = boxes.T
    small = np.maximum(bottom - top, right - left) <= MAX_FILLED
    small &= (top > 0) & (left > 0) & (bottom < samples.shape[0]) & (right < samples.shape[1])
    voids = np.flatnonzero(small)
    _fill(samples, labels, boxes, voids)
    filled, left_out = int(counts[1:][small].sum()), int(counts[1:][~small].sum())
    report = []
    if filled:
        report.append(f"{filled} samples in {len(voids)} small voids, filled")
    if left_out:
        report.append(f"{left_out} samples in large voids or at the rim, left out")
    return report


@njit(cache=True, nogil=True)
def _membrane(height, void, missing):  # type: ignore[no-untyped-def]
    """Solve Laplace's equation in a void by successive over-relaxation, in place."""
    rows, columns = height.shape
    relaxation = 2.0 / (1.0 + np.sin(np.pi / max(rows, columns)))
    for _ in range(_MAX_ROUNDS):
        most = 0.0
        for r in range(1, rows - 1):
            for c in range(1, columns - 1):
                if not void[r, c]:
                    continue
                total, count = 0.0, 0
                for dr, dc in ((0, 1), (0, -1), (1, 0), (-1, 0)):
                    if not missing[r + dr, c + dc]:
                        total += height[r + dr, c + dc]
                        count += 1
                if count:
                    change = relaxation * (total / count - height[r, c])
                    height[r, c] += change
                    most = max(most, abs(change))
        if most < _CLOSE:
            break


@njit(cache=True, nogil=True)
def _fill(samples, labels, boxes, voids):  # type: ignore[no-untyped-def]
    """Fill some of the voids, in place."""
    for n in voids:
        top, bottom, left, right = boxes[n]
        part = samples[top - 1 : bottom + 1, left - 1 : right + 1]
        void = labels[top - 1 : bottom + 1, left - 1 : right + 1] == n + 1
        window = part.astype(np.float64)
        mean = np.nanmean(window)
        for r in range(window.shape[0]):
            for c in range(window.shape[1]):
                if void[r, c]:
                    window[r, c] = mean
        _membrane(window, void, np.isnan(window))
        for r in range(window.shape[0]):
            for c in range(window.shape[1]):
                if void[r, c]:
                    part[r, c] = window[r, c]
