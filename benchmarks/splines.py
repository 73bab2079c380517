"""Distance to splines: error against time of methods."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.plotting import BLUE, GREEN, INK, ORANGE, PURPLE, VERMILION, new_figure
from sketchterrain.benchmarks.report import Column, Outcome, Row, Table, value_of
from sketchterrain.benchmarks.spline_methods import (
    ARCS,
    FLATTENED,
    KERNELS,
    KINDS,
    SEGMENTS,
    SplineQueries,
    distances,
    pieces_of,
    splines_and_places,
)
from sketchterrain.benchmarks.timing import TimedContext, alternate, spread

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


_COLOURS = {
    "Newton": ORANGE,
    "two steps": PURPLE,
    "iterated sampling": VERMILION,
    "all roots": INK,
    SEGMENTS: GREEN,
    ARCS: BLUE,
}


def draw_splines(rows: Sequence[Row]) -> Any:
    """Worst error against time; a table of failures by trap."""
    figure = new_figure(11.0, 4.6)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.15))
    _draw_errors(left, rows)
    _failures(right, [row for row in rows if row["cell_size"] == _SHOWN_CELL])
    return figure


def _draw_errors(axes: Any, rows: Sequence[Row]) -> None:
    """Draw a point a method; a line of points, one a cell size, where splines are flattened for it."""
    for method, colour in _COLOURS.items():
        mine = [row for row in rows if row["method"] == method]
        if not mine:
            continue
        if method not in FLATTENED:
            mine = [row for row in mine if row["cell_size"] == _SHOWN_CELL]
        x, y = (
            [value_of(row, "ns_per_place") for row in mine],
            [value_of(row, "worst_mm") for row in mine],
        )
        fails = any(value_of(row, "failures") > 0 for row in mine)
        axes.plot(x, y, "X-" if fails else "o-", color=colour, markersize=7, linewidth=1.0)
        text = f"{method}: fails" if fails else method
        left = method == "two steps"  # else it would lie upon Newton
        axes.annotate(
            text,
            (x[0], y[0]),
            (-7, -12) if left else (7, 5),
            ha="right" if left else "left",
            textcoords="offset points",
            color=colour,
            fontweight="bold",
            fontsize=8.0,
        )
        for row, place in zip(mine, zip(x, y, strict=True), strict=True):
            if method == ARCS:
                label = f"{value_of(row, 'cell_size'):g} m"
                axes.annotate(
                    label, place, (-6, -4), textcoords="offset points", ha="right", va="top", fontsize=7.5
                )
    axes.set(xscale="log", yscale="log", xlabel="ns a place", ylabel="worst error, mm")
    low, high = axes.get_xlim()
    axes.set_xlim(low / 1.6, high * 3.0)
    axes.set_title("Error against time; figures at points are cell sizes")


def _failures(axes: Any, rows: Sequence[Row]) -> None:
    methods = [str(row["method"]) for row in rows]
    shares = [[value_of(row, kind) for kind in KINDS] for row in rows]
    axes.imshow(shares, cmap="Oranges", vmin=0.0, vmax=60.0, aspect="auto")
    for i, line in enumerate(shares):
        for j, share in enumerate(line):
            shown = "0" if share == 0.0 else f"{share:.2g}"
            axes.text(j, i, shown, ha="center", va="center", fontsize=8.0)
    axes.set_xticks(range(len(KINDS)), list(KINDS), rotation=35, ha="right")
    axes.set_yticks(range(len(methods)), methods)
    axes.grid(visible=False)
    axes.tick_params(length=0)
    axes.set_title(f"Places wrong by over 1 % of cells of {_SHOWN_CELL:g} m, %")
