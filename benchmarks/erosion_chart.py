"""Charts of gullies: slopes, drainage and heights beside noise and a simulation; errors of normals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sketchterrain.benchmarks.outcome import samples_of, value_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.benchmarks.outcome import Row

# Okabe and Ito's palette, which colour-blind people can tell apart.
_BLUE, _VERMILION, _GREEN, _PURPLE = "#0072B2", "#D55E00", "#009E73", "#AA5586"
_COLOURS = {"fBm": _PURPLE, "no gullies": _GREEN, "gullies": _VERMILION, "fastscapelib": _BLUE}
_BIN = 3.0  # degrees


def draw_erosion(rows: Sequence[Row]) -> Any:
    """Shares of slopes, mean slope against drainage area, hypsometry, and times, one line a ground."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 3.8), layout="constrained")
    slopes, drainage, heights, times = figure.subplots(1, 4)
    kept = [row for row in rows if row.get("slope_share")]
    for row in kept:
        name = str(row["method"])
        style = {"color": _COLOURS[name], "label": name, "linewidth": 1.4}
        share = samples_of(row, "slope_share")
        slopes.plot([_BIN * (i + 0.5) for i in range(len(share))], [100 * each for each in share], **style)
        area = [each / 1e6 for each in samples_of(row, "area_m2")]
        drainage.plot(area, samples_of(row, "area_slope"), "o-", markersize=2.5, **style)
        heights.plot(range(101), samples_of(row, "hypsometry"), **style)
    slopes.set(xlabel="slope, degrees", ylabel="% of the ground", title="Slopes")
    drainage.set(xlabel="drainage area, km²", ylabel="mean slope", title="ValueSlope against area")
    drainage.set(xscale="log", yscale="log")
    heights.set(xlabel="% of the ground below", ylabel="relative height", title="Hypsometry")
    names = [str(row["method"]) for row in kept]
    times.barh(names, [value_of(row, "ms") for row in kept], color=[_COLOURS[name] for name in names])
    times.set(xscale="log", xlabel="ms", title=f"Time for {value_of(kept[0], 'side'):g}² cells")
    times.invert_yaxis()
    slopes.legend(fontsize=7.5, frameon=False)
    return figure


def draw_normals(rows: Sequence[Row]) -> Any:
    """Median errors of normals, and their 95th percentiles as whiskers, by cell size."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 3.2), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    grounds = list(dict.fromkeys(str(row["ground"]) for row in rows))
    for ground, axes in zip(grounds, panels, strict=True):
        for method, colour in (("finite differences", _BLUE), ("analytic", _VERMILION)):
            mine = [row for row in rows if row["ground"] == ground and row["method"] == method]
            cells = [value_of(row, "cell_size") for row in mine]
            middle, most = ([value_of(row, key) for row in mine] for key in ("median_deg", "p95_deg"))
            axes.plot(cells, middle, "o-", color=colour, markersize=3.5, label=f"{method}, median")
            axes.plot(cells, most, "^:", color=colour, markersize=3.5, label="95 %")
        axes.set(xscale="log", yscale="log", xlabel="cell, m", title=ground.capitalize())
        axes.set_xticks(cells, [f"{cell:g}" for cell in cells])
        axes.minorticks_off()
    panels[0].set_ylabel("error of normals, degrees")
    panels[1].legend(fontsize=7.0, frameon=False)
    return figure
