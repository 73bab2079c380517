"""Chart of meshes: error against triangles, beside uniform grids, and the seconds that they take."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sketchterrain.benchmarks.outcome import value_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.benchmarks.outcome import Row

# Okabe and Ito's palette, which colour-blind people can tell apart.
_HUES = ("#0072B2", "#D55E00", "#009E73", "#AA5586", "#E69F00")


def draw_meshes(rows: Sequence[Row]) -> Any:
    """Draw the error of each ground's meshes against their triangles, and the time against them."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, NullFormatter

    figure = Figure(figsize=(10.0, 4.4), layout="constrained")
    errors, times = figure.subplots(1, 2)
    rows = [row for row in rows if row.get("triangles")]
    grounds = list(dict.fromkeys(str(row["ground"]) for row in rows))
    for ground, colour in zip(grounds, _HUES, strict=False):
        mine = sorted((row for row in rows if row["ground"] == ground), key=_triangles)
        triangles = [_triangles(row) for row in mine]
        style = {"color": colour, "markersize": 4.0, "linewidth": 1.4}
        errors.plot(triangles, [value_of(row, "error") for row in mine], "o-", **style)
        uniform = [value_of(row, "uniform_triangles") for row in mine]
        known = [value_of(row, "uniform_error") or float("nan") for row in mine]
        errors.plot(uniform, known, "s:", **style)
        times.plot(
            triangles, [value_of(row, "median_ms") * 1e-3 for row in mine], "o-", label=ground, **style
        )
        times.plot(triangles, [value_of(row, "check_ms") * 1e-3 for row in mine], "^:", **style)
    for axes, label in (
        (errors, "largest error, m; dotted: uniform grid"),
        (times, "processor, s; dotted: measuring alone"),
    ):
        axes.set(xscale="log", yscale="log", xlabel="triangles", ylabel=label)
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter(FuncFormatter(lambda value, _: _tick(value)))
            axis.set_minor_formatter(NullFormatter())
    times.legend(fontsize=7.5, frameon=False)
    vertices = int(value_of(rows[0], "vertices")) if rows else 0
    figure.suptitle(
        f"Meshes at an error bound, of {vertices:,} vertices: down and left is better", x=0.01, ha="left"
    )
    return figure


def _triangles(row: Row) -> float:
    return value_of(row, "triangles")


def _tick(value: float) -> str:
    if value >= 1e6:
        return f"{value * 1e-6:g}M"
    return f"{value * 1e-3:g}k" if value >= 1e4 else f"{value:.10g}"
