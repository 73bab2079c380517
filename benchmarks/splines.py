"""Ways of measuring the distance to a spline: failures, error and time of each, driven into every trap."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.benchmarks.outcome import Column, Outcome, Row, Table
from sketchterrain.benchmarks.spline_cases import KINDS, distances, splines_and_places
from sketchterrain.benchmarks.spline_methods import ARCS, FLATTENED, KERNELS, SplineQueries, pieces_of
from sketchterrain.benchmarks.timing import alternate, spread

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array
    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.timing import TimedContext


SEED = 20131
EACH = 64
"""Places a spline."""
CELL_SIZES = (0.125, 0.5, 2.0, 8.0, 32.0)
"""For which splines are flattened, and whose hundredth is the largest error that is no failure, m."""

_SHOWN_CELL = 2.0
_MOST_TIMED = 1 << 16

_COLUMNS = (
    Column("method", "method"),
    Column("cell_size", "cell, m"),
    Column("pieces", "pieces a spline"),
    Column("failures", "failures, %"),
    Column("mean_mm", "mean error, mm"),
    Column("worst_mm", "worst, mm"),
    Column("worst_share", "worst, % of a cell"),
    Column("ns_per_place", "ns a place"),
)


def measure(context: TimedContext, effort: Effort) -> Outcome:
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
    laps = alternate(
        {str(case): partial(context.lap, work) for case, work in works.items()}, rounds=effort.rounds
    )
    rows = []
    found: dict[str, Float64Array] = {}
    for method, cell in cases:
        if method in FLATTENED or method not in found:
            found[method] = np.abs(queries.distances(method, cell) - expected)
        case = (method, cell if method in FLATTENED else CELL_SIZES[0])
        seconds = spread([lap.device for lap in laps[str(case)]]).median
        rows.append(
            {
                "method": method,
                "cell_size": cell,
                "pieces": _pieces(timed.cubics, method, cell),
                "ns_per_place": seconds / np.prod(timed.shape) * 1e9,
                **_errors(found[method], cell),
            }
        )
    shown = tuple(row for row in rows if row["cell_size"] == _SHOWN_CELL)
    kinds = (Column("method", "method"), *(Column(kind, kind) for kind in KINDS))
    return Outcome(
        (
            Table(f"Distance to a spline, {expected.size} places", _COLUMNS, tuple(rows)),
            Table(f"Failures by trap, % of the places, cells of {_SHOWN_CELL:g} m", kinds, shown),
        )
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
