"""Metrics of landforms: what a window of heights measures, in numbers that need no scale.

Landforms are the geomorphons of Jasiewicz & Stepinski, "Geomorphons – a pattern recognition approach to
classification and mapping of landforms" (2013). Slopes are in degrees, lengths in shares of the window,
heights in shares of its relief: windows of different cell sizes compare with each other and with real land
(:mod:`sketchterrain.measure.realism`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.host.library import host_function
from sketchterrain.landforms.flow_routing import (
    FlowNetwork,
    closed_hollows,
    rise_share,
    route_flow,
    sinuosities,
    stream_orders,
)

MIN_WINDOW: Final = 96  # cells along a side
HORIZON: Final = 24  # cells that geomorphons look in each direction; a margin so wide is not classified
CHANNEL_AREA: Final = 100  # cells of drainage area from which on there is a channel
HOLLOW_DEPTH: Final = 0.05  # cells: shallower hollows are not counted

FORMS: Final = ("flat", "peak", "ridge", "shoulder", "spur", "slope", "hollow", "footslope", "valley", "pit")
"""The ten landforms, by their codes."""

_INNER = slice(HORIZON, -HORIZON), slice(HORIZON, -HORIZON)  # the cells that are classified
_FLATNESS = math.radians(1.0)  # angles between zenith and nadir horizons that differ by less count as level
# Table 1 of Jasiewicz & Stepinski: rows are numbers of lower directions, columns of higher ones.
_FLAT, _PEAK, _RIDGE, _SHOULDER, _SPUR, _SLOPE, _HOLLOW, _FOOTSLOPE, _VALLEY, _PIT = range(len(FORMS))
_CODES = {letter: code for code, letter in enumerate("FPRHSLOTVI")} | {"-": -1}
_FORM_TABLE = np.array(
    [
        [_CODES[letter] for letter in row]
        for row in (
            "FFFTTVVVI",
            "FFTTTVVV-",
            "FHLLOOV--",
            "HHLLLO---",
            "HHSLL----",
            "RRSS-----",
            "RRR------",
            "RR-------",
            "P--------",
        )
    ],
    np.int8,
)


class WindowMaps(NamedTuple):
    """What a window's metrics were measured on, (rows, columns) each."""

    hollow: BoolArray  # closed hollows
    rising: BoolArray  # channels that rise against their flow
    slope: Float64Array  # degrees


def geomorphons(height: Float64Array, cell: float) -> npt.NDArray[np.int8]:
    """Return the landform of each cell (m) of heights (m), an index into :data:`FORMS`."""
    z = np.ascontiguousarray(height, np.float64)
    form, scratch = np.empty(z.shape, np.int8), np.empty((2, z.shape[1]))
    host_function("geomorphons")(z, cell, _FLATNESS, HORIZON, _FORM_TABLE, form, scratch)
    return form


def measure_window_maps(
    height: npt.ArrayLike, cell: float, masked: BoolArray | None = None
) -> tuple[dict[str, float], WindowMaps]:
    """Return all metrics of a window (NaN: cannot be measured), and maps of hollows, rises and slopes.

    Parameters
    ----------
    height : finite heights (rows, columns), m, at least 96 cells each way; real land has 192
    cell : side of a cell, m
    masked : cells that are no ground, (rows, columns): slopes, heights, curvature, landforms and hollows are
        those of the others, while water flows across
    """
    z = np.ascontiguousarray(height, np.float64)
    if z.ndim != 2 or min(z.shape) < MIN_WINDOW or not np.isfinite(z).all():
        raise ValueError(f"expected finite heights of at least {MIN_WINDOW}² cells, got shape {z.shape}")
    ground = np.ones(z.shape, np.bool_) if masked is None else ~masked
    low, high = np.percentile(z[ground], (1, 99))
    relief = max(high - low, 1e-6)
    south, east = np.gradient(z, cell)
    slope = np.hypot(south, east)
    median_slope = float(np.median(slope[ground]))
    degrees = np.degrees(np.arctan(slope))
    form = geomorphons(z, cell)
    flow = route_flow(z, cell)
    with np.errstate(invalid="ignore", divide="ignore"):
        metrics = {"relief_m": float(relief)}
        metrics |= _landforms(form, ground)
        metrics |= _slopes(z[ground], slope[ground], degrees[ground], low, relief)
        metrics |= _heights(z, ground, low, high, relief)
        metrics |= _roughness(z, ground, slope, cell)
        metrics |= _drainage(z, ground, flow, cell, relief)
        metrics |= _channels(z, flow, form, median_slope, cell)
        metrics |= _streams(flow)
        metrics |= _summits(z, relief)
        metrics |= _treated_depressions(z, ground, flow, median_slope, cell)
    flat = z.ravel()
    hollow = closed_hollows(flow, flat, HOLLOW_DEPTH * cell)
    channel = flow.channels(2 * CHANNEL_AREA)
    rising = np.zeros(flat.size, np.bool_)
    rising[channel] = flat[flow.receiver[channel]] > flat[channel]
    return metrics, WindowMaps(hollow.reshape(z.shape), rising.reshape(z.shape), degrees)


def _landforms(form: npt.NDArray[np.int8], ground: BoolArray) -> dict[str, float]:
    inner, dry = form[_INNER], ground[_INNER]
    count = np.bincount(inner[dry], minlength=len(FORMS))
    share = count / max(int(count.sum()), 1)
    return {f"g_{name}": float(value) for name, value in zip(FORMS, share, strict=True)} | {
        "ridge_extent": _extent(np.isin(inner, (_RIDGE, _PEAK)) & dry),
        "valley_extent": _extent(np.isin(inner, (_VALLEY, _PIT)) & dry),
    }


def _extent(mask: BoolArray) -> float:
    """Return the mean extent of the connected piece of a cell: its box's diagonal over the window's."""
    number, count = ndimage.label(mask, np.ones((3, 3)))
    if count == 0:
        return 0.0
    cells = np.bincount(number.ravel())[1:]
    diagonals = [
        math.hypot(*(side.stop - side.start for side in box)) for box in ndimage.find_objects(number)
    ]
    return float(np.average(diagonals, weights=cells) / math.hypot(*mask.shape))


def _slopes(
    z: Float64Array, slope: Float64Array, degrees: Float64Array, low: float, relief: float
) -> dict[str, float]:
    percents = (5, 25, 50, 75, 95, 99)
    found = {
        f"slope_p{percent:02}": float(value)
        for percent, value in zip(percents, np.percentile(degrees, percents), strict=True)
    }
    steep = np.percentile(slope, 95)
    found["level_share"] = float((slope < 0.1 * steep).mean())
    found["middle_share"] = float(((slope > 0.2 * steep) & (slope < 0.6 * steep)).mean())
    lower, upper = z < low + relief / 3.0, z >= low + 2.0 * relief / 3.0
    at_foot, at_top = (_median(slope[part], least=31) for part in (lower, upper))
    found["high_low_slope"] = float(np.log2(np.maximum(at_top, 1e-3) / np.maximum(at_foot, 1e-3)))
    return found


def _heights(z: Float64Array, ground: BoolArray, low: float, high: float, relief: float) -> dict[str, float]:
    near, far = (_local_relief(z, side) for side in (7, 33))
    return {
        "hypsometric": float((np.clip(z[ground], low, high).mean() - low) / relief),
        "relief_growth": float(
            math.log(max(np.median(far), 1e-9) / max(np.median(near), 1e-9)) / math.log(32 / 6)
        ),
        "quiet_share": float((far < 0.1 * relief).mean()),
    }


def _local_relief(z: Float64Array, side: int) -> Float64Array:
    """Return highest minus lowest height within squares of so many cells, where they fit in."""
    inner = (slice(side // 2, -(side // 2)),) * 2
    return np.asarray((ndimage.maximum_filter(z, side) - ndimage.minimum_filter(z, side))[inner])


def _roughness(z: Float64Array, ground: BoolArray, slope: Float64Array, cell: float) -> dict[str, float]:
    coarse, fine = spectral_slopes(z, (48.0, 12.0, 3.0))
    detail = z - ndimage.gaussian_filter(z, 1.5)
    curvature = ndimage.gaussian_laplace(z, 2.0)[ground]
    deviation = curvature - curvature.mean()
    return {
        "spectrum_coarse": coarse,
        "spectrum_fine": fine,
        "skin": float(_rms(detail[ground]) / (cell * max(_rms(slope[ground]), 1e-9))),
        "curvature_skew": float((deviation**3).mean() / max(curvature.std(), 1e-12) ** 3),
    }


def spectral_slopes(z: Float64Array, wavelengths: Sequence[float], *, bins: int = 8) -> list[float]:
    """Return the exponents β of the power spectrum P(k) ~ k^-β between descending wavelengths (cells).

    P is the mean of |FFT|² over rings of k, of heights without their plane under a Hann window.
    """
    rows, columns = z.shape
    y, x = np.mgrid[-1 : 1 : rows * 1j, -1 : 1 : columns * 1j]
    plane = np.stack([np.ones(z.size), x.ravel(), y.ravel()], axis=-1)
    coefficients = np.linalg.lstsq(plane, z.ravel(), rcond=None)[0]
    level = z - (plane @ coefficients).reshape(z.shape)
    power = np.abs(np.fft.rfft2(level * np.outer(np.hanning(rows), np.hanning(columns)))).ravel() ** 2
    frequency = np.hypot(np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns)).ravel()
    exponents = []
    for long, short in pairwise(wavelengths):
        edges = np.geomspace(1.0 / long, 1.0 / short, bins + 1)
        ring = np.digitize(frequency, edges) - 1
        inside = (ring >= 0) & (ring < bins)
        count = np.maximum(np.bincount(ring[inside], minlength=bins), 1)
        mean = np.bincount(ring[inside], power[inside], bins) / count
        used = mean > 0.0
        middle = np.log(np.sqrt(edges[1:] * edges[:-1]))
        fit = np.polyfit(middle[used], np.log(mean[used]), 1)[0] if used.sum() > 3 else math.nan
        exponents.append(-float(fit))
    return exponents


def _drainage(
    z: Float64Array, ground: BoolArray, flow: FlowNetwork, cell: float, relief: float
) -> dict[str, float]:
    height = z.ravel()
    channel = flow.channels(CHANNEL_AREA)
    basins = np.sort(flow.area[flow.receiver < 0])[::-1]
    bends = sinuosities(flow, 2 * CHANNEL_AREA, reach=32.0)
    slope_fit, correlation = _concavity(flow, height, channel, cell)
    hack = (
        np.polyfit(np.log(flow.area[channel]), np.log(flow.length[channel]), 1)[0]
        if channel.size > 50
        else math.nan
    )
    return {
        "sink_share": float(closed_hollows(flow, height, HOLLOW_DEPTH * cell)[ground.ravel()].mean()),
        "sink_depth": float((flow.filled - height).mean() / relief),
        "uphill": rise_share(flow, height, 2 * CHANNEL_AREA),
        "sinuosity": _median(bends, least=11),
        "largest_basins": float(basins[:3].sum() / z.size),
        "concavity": slope_fit,
        "concavity_r2": correlation,
        "hack": float(hack),
    }


def _concavity(
    flow: FlowNetwork, height: Float64Array, channel: Int64Array, cell: float
) -> tuple[float, float]:
    """Return the concavity θ of S ~ A^-θ along channels, fitted to medians, and the fit's r²."""
    most = 0.25 * height.size
    channel = channel[flow.area[channel] < most]
    slope = flow.slope(height, channel, cell, steps=5)
    edges = np.geomspace(CHANNEL_AREA, most, 9)
    in_class = np.digitize(flow.area[channel], edges) - 1
    log_area, log_slope = [], []
    for number, (lower, upper) in enumerate(pairwise(edges)):
        median = _median(slope[in_class == number], least=15)
        if median > 1e-5:
            log_area.append(0.5 * math.log(lower * upper))
            log_slope.append(math.log(median))
    if len(log_area) < 4:
        return math.nan, math.nan
    theta = -float(np.polyfit(log_area, log_slope, 1)[0])
    return theta, float(np.corrcoef(log_area, log_slope)[0, 1] ** 2)


def _channels(
    z: Float64Array, flow: FlowNetwork, form: npt.NDArray[np.int8], median_slope: float, cell: float
) -> dict[str, float]:
    """Return whether channels lie in valleys, and how deep these are over the median slope."""
    channel = flow.channels(CHANNEL_AREA)
    is_channel = np.zeros(z.shape, np.bool_)
    is_channel.flat[channel] = True
    forms = form[_INNER][is_channel[_INNER]]
    found = {"channel_in_valley": math.nan, "channel_off_slope": math.nan, "valley_depth": math.nan}
    if forms.size:
        found["channel_in_valley"] = float(np.isin(forms, (_VALLEY, _PIT, _HOLLOW)).mean())
        found["channel_off_slope"] = float(np.isin(forms, (_SLOPE, _SPUR, _RIDGE, _PEAK, _SHOULDER)).mean())
    if channel.size:
        away, nearest = ndimage.distance_transform_edt(~is_channel, return_indices=True)
        beside = (away > 6.0) & (away < 10.0)
        rise = _median((z - z[tuple(nearest)])[beside], least=51)
        found["valley_depth"] = rise / (8.0 * cell) / max(median_slope, 1e-6)
    return found


def _streams(flow: FlowNetwork) -> dict[str, float]:
    """Return Horton's ratios of the numbers and mean lengths of streams of successive orders."""
    stream = stream_orders(flow, CHANNEL_AREA // 2)
    to = flow.receiver
    counts, lengths = [], []
    for order in range(1, int(stream.max()) + 1):
        cells = np.flatnonzero(stream == order)
        downstream = to[cells][to[cells] >= 0]
        continued = np.unique(downstream[stream[downstream] == order])
        count = cells.size - continued.size
        if count:
            counts.append(count)
            lengths.append(flow.step[cells].sum() / count)
    if len(counts) < 3:
        return {"bifurcation": math.nan, "length_ratio": math.nan}
    orders = np.arange(len(counts))
    return {
        "bifurcation": math.exp(-np.polyfit(orders, np.log(counts), 1)[0]),
        "length_ratio": math.exp(np.polyfit(orders[:-1], np.log(lengths[:-1]), 1)[0]),
    }


def _treated_depressions(
    z: Float64Array, ground: BoolArray, flow: FlowNetwork, median_slope: float, cell: float, *, reach: int = 6
) -> dict[str, float]:
    """Return what gives away depressions that were filled or breached.

    Trenches cut through barriers are a cell or two wide and close under a blur (``reopened_hollows``); on
    fills and in trenches water runs level as far as the spill point, then descends steeply (``level_steps``).
    """
    smooth = ndimage.gaussian_filter(z, 1.5)
    hollow = closed_hollows(route_flow(smooth, cell), smooth.ravel(), HOLLOW_DEPTH * cell)[ground.ravel()]
    channel = flow.channels(CHANNEL_AREA)
    channel = channel[flow.area[channel] < 0.25 * z.size]
    below, whole = flow.downstream(channel, reach)
    channel, below = channel[whole], below[whole]
    _, whole = flow.downstream(below, reach)
    channel, below = channel[whole], below[whole]
    if not channel.size:
        return {"reopened_hollows": float(hollow.mean()), "level_steps": 0.0}
    first, second = (flow.slope(flow.filled, start, cell, reach) for start in (channel, below))
    step = (first < 0.1 * second) & (second > 0.1 * median_slope)
    return {"reopened_hollows": float(hollow.mean()), "level_steps": float(step.mean())}


def _summits(z: Float64Array, relief: float) -> dict[str, float]:
    """Return summits above a quarter of the relief per 10⁴ cells, and the height of their key saddles."""
    base = np.percentile(z, 2)
    summit, saddle = key_saddles(ndimage.gaussian_filter(z, 0.7), 0.05 * relief)
    high = summit - base > 0.25 * relief
    ratio = (saddle[high] - base) / (summit[high] - base)
    return {"summits": float(high.sum() / z.size * 1e4), "saddle_height": _median(ratio, least=3)}


def key_saddles(z: Float64Array, least_prominence: float) -> tuple[Float64Array, Float64Array]:
    """Return heights of summits of some prominence and of their key saddles; the highest summit has none."""
    z = np.ascontiguousarray(z, np.float64)
    descending = np.argsort(-z.ravel(), kind="stable")
    summit, saddle, scratch = np.empty(z.size), np.empty(z.size), np.empty((2, z.size), np.int64)
    arguments = z.shape[1], z.ravel(), descending, least_prominence, summit, saddle, scratch
    count = host_function("key_saddles")(*arguments)
    return summit[:count], saddle[:count]


def _median(values: Float64Array, *, least: int) -> float:
    """Return the median, NaN of fewer values."""
    return float(np.median(values)) if values.size >= least else math.nan


def _rms(values: Float64Array) -> float:
    return float(np.sqrt((values**2).mean()))


def median_metrics(windows: Iterable[dict[str, float]]) -> dict[str, float]:
    """Return the median of each metric over windows, NaN where no window has it."""
    columns = list(windows)
    values = {name: np.array([window[name] for window in columns]) for name in columns[0]}
    return {name: _median(each[~np.isnan(each)], least=1) for name, each in values.items()}
