"""Distance to splines: error against time of methods."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.plotting import Curves, draw_curves
from sketchterrain.benchmarks.report import Row, Table, Tables
from sketchterrain.benchmarks.timing import TimedContext, alternate, spread
from sketchterrain.geometry.splines import cubics
from sketchterrain.terrain.centrelines import bisect, position

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext


SEGMENTS, ARCS = "straight pieces", "arcs"

FLATTENED = (SEGMENTS, ARCS)
"""Methods that flatten the splines first, for one cell size; the others work on the cubics themselves."""

KERNELS = {
    "Newton": "spline_newton_distances",
    "two steps": "spline_two_step_distances",
    "iterated sampling": "spline_sampling_distances",
    "all roots": "spline_roots_distances",
    SEGMENTS: "spline_segments_distances",
    ARCS: "spline_arcs_distances",
}
"""Kernels in ``kernels/splines.cl`` by the method's name."""


class SplineQueries:
    """Splines and places on a device."""

    def __init__(self, context: ComputeContext, controls: Float64Array, places: Float64Array) -> None:
        self._context = context
        self.shape = places.shape[:2]
        # As the kernels get them: the error is then the method's and its arithmetic's.
        self.cubics = cubics(controls).astype(context.real_dtype).astype(np.float64)
        self.places = places.astype(context.real_dtype).astype(np.float64)
        self._cubic = context.upload(self.cubics.astype(context.real_dtype))
        self._place = context.upload(self.places.astype(context.real_dtype))
        self._out = context.empty(self.shape, context.real_dtype)

    def work(self, method: str, cell_size: float) -> Callable[[], None]:
        """Return what launches one of `KERNELS`, for a cell size (m)."""
        size, each = (int(np.prod(self.shape)),), np.int32(self.shape[1])
        launch = partial(self._context.launch, "baselines/splines.cl", KERNELS[method], size)
        if method not in FLATTENED:
            count = np.int32(self.cubics.shape[1])
            return partial(launch, self._cubic, count, self._place, each, self._out)
        starts, *pieces = pieces_of(self.cubics, 0.01 * cell_size, arcs=method == ARCS)
        upload, real = self._context.upload, self._context.real_dtype
        buffers = (upload(starts), *(upload(part.astype(real)) for part in pieces))
        return partial(launch, *buffers, self._place, each, self._out)

    def distances(self, method: str, cell_size: float) -> npt.NDArray[Any]:
        """Return the distances (m) by a method, shape (count, each)."""
        self.work(method, cell_size)()
        return self._context.download(self._out, self.shape, self._context.real_dtype)


def pieces_of(
    cubic: Float64Array, tolerance: float, *, arcs: bool
) -> tuple[npt.NDArray[np.int32], Float64Array, Float64Array]:
    """Return flattened splines as ``spline_arcs_distances`` in ``kernels/splines.cl`` reads them."""
    flat = cubic.reshape(-1, 2, 4)
    found = bisect(flat, tolerance, arcs=arcs).within(tolerance)
    ends = position(flat[found.cubic], np.stack([found.first, found.last], axis=-1))
    chord = ends[:, 1] - ends[:, 0]
    length2 = (chord**2).sum(axis=-1)
    inverse = np.where(length2 > 0.0, 1.0 / np.where(length2 > 0.0, length2, 1.0), 0.0)
    counts = np.bincount(found.cubic // cubic.shape[1], minlength=len(cubic))
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return starts, ends[:, 0], np.column_stack([chord, inverse, found.bend])


CONTROLS = 6
"""Control points of each spline."""

SPACING = 58.0
"""Metres between control points, as in the preset valley_river."""

_NEAR = 3.0  # spacings: how far places lie from the curve
_SAMPLES, _THIRDS, _CHUNK = 256, 60, 64


def _random(rng: np.random.Generator, count: int) -> Float64Array:
    return rng.uniform(-1.5, 1.5, (count, CONTROLS, 2))


def _river(rng: np.random.Generator, count: int) -> Float64Array:
    """Headings that wander, as a traced river's do."""
    heading = np.cumsum(rng.normal(0, 0.5, (count, CONTROLS)), axis=1) + rng.uniform(0, 2 * np.pi, (count, 1))
    return np.cumsum(np.stack([np.cos(heading), np.sin(heading)], axis=-1), axis=1)


def _inflections(rng: np.random.Generator, count: int) -> Float64Array:
    swing = rng.uniform(0.05, 1.5, (count, 1)) * np.where(np.arange(CONTROLS) % 2, 1.0, -1.0)
    return np.stack([np.arange(CONTROLS) * rng.uniform(0.3, 1.0, (count, 1)), swing], axis=-1)


def _cusps(rng: np.random.Generator, count: int) -> Float64Array:
    """Curves that turn back on themselves at control points: the derivative vanishes there, or nearly."""
    a, b = _random(rng, 2 * count)[:, 0].reshape(2, count, 1, 2)
    there = np.where(np.arange(CONTROLS)[:, None] % 2 == 0, a, b)
    off = 10.0 ** rng.uniform(-8, -1, (count, 1, 1))
    return np.asarray(there + off * rng.normal(size=(count, CONTROLS, 2)))


def _loops(rng: np.random.Generator, count: int) -> Float64Array:
    turn = rng.uniform(1.0, 1.9, (count, 1)) * 2 * np.pi / (CONTROLS - 1)
    angle = np.arange(CONTROLS) * turn
    radius = 1.0 + rng.uniform(-0.3, 0.3, (count, 1)) * np.arange(CONTROLS) / CONTROLS
    return np.asarray(radius[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1))


def _coincident(rng: np.random.Generator, count: int) -> Float64Array:
    """Neighbours that are all but one point, and a later one that is an earlier one."""
    points = _random(rng, count)
    points[:, 2] = points[:, 1] + 10.0 ** rng.uniform(-8, -2, (count, 1)) * rng.normal(size=(count, 2))
    points[:, 5] = points[:, 0]
    return points


def _collinear(rng: np.random.Generator, count: int) -> Float64Array:
    """On one line, in order or not."""
    along = rng.uniform(-2, 2, (count, CONTROLS))
    along[::2].sort(axis=1)
    angle = rng.uniform(0, np.pi, (count, 1))
    return np.asarray(along[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1))


def _equidistant(rng: np.random.Generator, count: int) -> Float64Array:
    """Symmetric about the x axis, so that places on it are equally far from two branches."""
    gap = rng.uniform(0.02, 1.0, (count, 1))
    x = np.sort(rng.uniform(0, 2, (count, 3)), axis=1)
    x[:, 2] += 0.05
    branch = np.stack([x, gap * np.ones(3)], axis=-1)
    return np.concatenate([branch, branch[:, ::-1] * [1, -1]], axis=1)


def _hairpins(rng: np.random.Generator, count: int) -> Float64Array:
    """There and back, closer than a river of 10 m is wide."""
    gap = rng.uniform(1e-3, 0.08, (count, 1))
    x = np.array([0.0, 1.0, 2.0, 2.0, 1.0, 0.0]) + rng.normal(0, 0.02, (count, CONTROLS))
    side = np.array([0.5, 0.5, 0.5, -0.5, -0.5, -0.5])
    return np.stack([x, gap * side], axis=-1)


KINDS: dict[str, Callable[[np.random.Generator, int], Float64Array]] = {
    "river": _river,
    "random": _random,
    "inflections": _inflections,
    "cusps": _cusps,
    "loops": _loops,
    "coincident": _coincident,
    "collinear": _collinear,
    "equidistant": _equidistant,
    "hairpins": _hairpins,
}
"""What makes (count, CONTROLS, 2) control points, in spacings, by the name of the trap."""


def splines_and_places(kind: str, count: int, *, each: int, seed: int) -> tuple[Float64Array, Float64Array]:
    """Draw splines of a kind and places around them."""
    rng = np.random.default_rng([seed, list(KINDS).index(kind)])
    controls = KINDS[kind](rng, count)
    cubic = cubics(controls)
    low, high = controls.min(axis=1, keepdims=True), controls.max(axis=1, keepdims=True)
    places = rng.uniform(low - 0.5 * _NEAR, high + 0.5 * _NEAR, (count, each, 2))
    segment, t = rng.integers(0, CONTROLS - 1, (count, each)), rng.random((count, each))
    c = cubic[np.arange(count)[:, None], segment]
    power = np.stack([np.ones_like(t), t, t * t, t**3], axis=-1)
    slope = np.stack([np.zeros_like(t), np.ones_like(t), 2 * t, 3 * t * t], axis=-1)
    bend = np.stack([np.zeros_like(t), np.zeros_like(t), np.full_like(t, 2.0), 6 * t], axis=-1)
    at, d, dd = (np.einsum("nkij,nkj->nki", c, basis) for basis in (power, slope, bend))
    trap = rng.random((count, each))
    near = at + rng.normal(0, 0.05, at.shape)
    cross = d[..., 0] * dd[..., 1] - d[..., 1] * dd[..., 0]
    turn = (d**2).sum(axis=-1) / np.where(np.abs(cross) < 1e-9, 1e-9, cross)
    centre = at + turn[..., None] * np.stack([-d[..., 1], d[..., 0]], axis=-1)
    places = np.where((trap < 0.5)[..., None], near, places)
    reachable = (trap < 0.25) & (np.abs(centre) < 2 * _NEAR).all(axis=-1)
    places = np.where(reachable[..., None], centre, places)
    places[trap < 0.125, 1] = 0.0
    return controls * SPACING, places * SPACING


def distances(cubic: Float64Array, places: Float64Array) -> Float64Array:
    """Compute the distances in float64: minima among many samples, each then searched for by thirds."""
    found = [
        _distances(cubic[first : first + _CHUNK], places[first : first + _CHUNK])
        for first in range(0, len(cubic), _CHUNK)
    ]
    return np.concatenate(found)


def _distances(cubic: Float64Array, places: Float64Array) -> Float64Array:
    count, each = places.shape[:2]
    t = np.linspace(0.0, 1.0, _SAMPLES + 1)
    at = np.einsum("npdk,sk->npsd", cubic, t[:, None] ** np.arange(4)).reshape(count, 1, -1, 2)
    square = ((at - places[:, :, None]) ** 2).sum(axis=-1).reshape(count, each, -1, _SAMPLES + 1)
    beside = np.pad(square, [(0, 0)] * 3 + [(1, 1)], constant_values=np.inf)
    spline, place, piece, k = np.nonzero((square <= beside[..., 2:]) & (square <= beside[..., :-2]))
    c, there = cubic[spline, piece], places[spline, place]
    low, high = t[np.maximum(k - 1, 0)], t[np.minimum(k + 1, _SAMPLES)]
    for _ in range(_THIRDS):
        third = (high - low) / 3.0
        left = _square(c, low + third, there) < _square(c, high - third, there)
        low, high = np.where(left, low, low + third), np.where(left, high - third, high)
    best = square.min(axis=(2, 3))
    np.minimum.at(best, (spline, place), _square(c, 0.5 * (low + high), there))
    return np.asarray(np.sqrt(best))


def _square(cubic: Float64Array, t: Float64Array, place: Float64Array) -> Float64Array:
    t = t[:, None]
    at = ((cubic[..., 3] * t + cubic[..., 2]) * t + cubic[..., 1]) * t + cubic[..., 0]
    return np.asarray(((at - place) ** 2).sum(axis=-1))


SEED = 20131
EACH = 64
"""Places a spline."""
CELL_SIZES = (0.125, 0.5, 2.0, 8.0, 32.0)
"""For which splines are flattened, and whose hundredth is the largest error that is no failure, m."""

_SHOWN_CELL = 2.0
_MOST_TIMED = 1 << 16

_HEADINGS = {"failures": "failures, %", "worst_share": "worst, % of a cell"}


def measure(context: TimedContext, effort: Effort) -> Tables:
    """Errors, and device time in nanoseconds a place, of every way to the distance to a spline.

    Splines have six control points 58 m apart, as the rivers of valley_river have, and 64 places each: close
    by, up to 87 m around, on centres of curvature, and as far from one branch as from the other. As many are
    drawn from each kind of trap. The error is against float64: the least of 1280 samples a spline and of what
    a search by thirds finds beside each of their minima. A failure is an error above 1 % of the cell size.
    Time is the median of rounds in which all ways take turns, on an even share of all kinds; the splines are
    flattened beforehand, and every place asks all pieces of its spline.
    """
    count = effort.spline_count
    drawn = [splines_and_places(kind, count, each=EACH, seed=SEED) for kind in KINDS]
    controls, places = (np.concatenate(part) for part in zip(*drawn, strict=True))
    queries = SplineQueries(context, controls, places)
    expected = distances(queries.cubics, queries.places)
    share = max(1, controls.shape[0] * EACH // _MOST_TIMED)
    timed = SplineQueries(context, controls[::share], places[::share])
    cases = [(method, cell) for method in KERNELS for cell in CELL_SIZES]
    # A method on the cubics themselves takes the same time for every cell.
    works = {
        (method, cell if method in FLATTENED else CELL_SIZES[0]): timed.work(method, cell)
        for method, cell in cases
    }
    laps = alternate({case: partial(context.lap, work) for case, work in works.items()}, rounds=effort.rounds)
    rows = []
    found: dict[str, Float64Array] = {}
    for method, cell in cases:
        if method in FLATTENED or method not in found:
            found[method] = np.abs(queries.distances(method, cell) - expected)
        case = (method, cell if method in FLATTENED else CELL_SIZES[0])
        seconds = spread([lap.device for lap in laps[case]]).median
        rows.append(
            {
                "method": method,
                "cell_size": cell,
                "pieces": _pieces(timed.cubics, method, cell),
                "ns_per_place": seconds / np.prod(timed.shape) * 1e9,
                **_errors(found[method], cell),
            }
        )
    shown = [row for row in rows if row["cell_size"] == _SHOWN_CELL]
    kinds = tuple({key: row[key] for key in ("method", *KINDS)} for row in shown)
    return (
        Table(f"Distance to a spline, {expected.size} places", tuple(rows), _HEADINGS, KINDS),
        Table(f"Failures by trap, % of the places, cells of {_SHOWN_CELL:g} m", kinds),
    )


def failures(error: Float64Array, cell_size: float) -> npt.NDArray[np.bool_]:
    """Return which errors (m) are failures: above 1 % of the cell size (m), or no number."""
    return np.asarray(~(error <= 0.01 * cell_size))


def _errors(error: Float64Array, cell: float) -> Row:
    """Worst and mean error, and failures, in all and by kind."""
    failed = failures(error, cell)
    by_kind = failed.reshape(len(KINDS), -1).mean(axis=1) * 100
    return {
        "failures": float(failed.mean() * 100),
        "failed": int(failed.sum()),
        "mean_mm": float(error.mean() * 1e3),
        "worst_mm": float(error.max() * 1e3),
        "worst_share": float(error.max() / cell * 100),
        **dict(zip(KINDS, by_kind.tolist(), strict=True)),
    }


def _pieces(cubics: Float64Array, method: str, cell: float) -> float:
    if method not in FLATTENED:
        return float(cubics.shape[1])
    starts, *_ = pieces_of(cubics, 0.01 * cell, arcs=method == ARCS)
    return float(starts[-1] / len(cubics))


_PANEL = Curves(
    *("", "ns_per_place", {"": "worst_mm"}),
    by="method",
    text="cell_size",
    units=("ns a place", "worst error, mm"),
)
draw_splines = partial(draw_curves, "Distance to a spline: error against time, by cell size in m", [_PANEL])
