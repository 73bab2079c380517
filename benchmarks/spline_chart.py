"""Chart of the ways to the distance to a spline: error against time, and where each fails."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sketchterrain.benchmarks.outcome import value_of
from sketchterrain.benchmarks.spline_cases import KINDS
from sketchterrain.benchmarks.spline_methods import ARCS, FLATTENED, SEGMENTS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.benchmarks.outcome import Row

# Okabe and Ito's palette, which colour-blind people can tell apart.
_COLOURS = {
    "Newton": "#E69F00",
    "two steps": "#AA5586",
    "iterated sampling": "#D55E00",
    "all roots": "#333333",
    SEGMENTS: "#009E73",
    ARCS: "#0072B2",
}
_SHOWN_CELL = 2.0


def draw_splines(rows: Sequence[Row]) -> Any:
    """Worst error against time; a table of failures by trap."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.15))
    _errors(left, rows)
    _failures(right, [row for row in rows if row["cell_size"] == _SHOWN_CELL])
    return figure


def _errors(axes: Any, rows: Sequence[Row]) -> None:
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
