"""Charts of what pictures cost: time and difference by quality, and by part."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.benchmarks.outcome import value_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.benchmarks.outcome import Row

_HUES: Final = ("#0072B2", "#D55E00", "#009E73", "#AA5586", "#E69F00")
_SMALL: Final = 7.5


def draw_qualities(rows: Sequence[Row]) -> Any:
    """Draw the time of a picture by its quality, and its difference from the best against that time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 6.4), layout="constrained")
    panels = figure.subplots(2, 2)
    known = [row for row in rows if row["opengl"] != "absent"]
    views = list(dict.fromkeys(str(row["view"]) for row in known))
    kinds = (("still", "whole picture"), ("moving", "frame in motion"))
    for (kind, title), (left, right) in zip(kinds, panels, strict=True):
        for view, hue in zip(views, _HUES, strict=False):
            of_view = sorted((row for row in known if row["view"] == view), key=_number)
            numbers = [_number(row) for row in of_view]
            times = [value_of(row, f"{kind}_ms") for row in of_view]
            differences = [value_of(row, f"{kind}_difference") for row in of_view]
            left.plot(numbers, times, color=hue, marker="o", markersize=3.5, linewidth=1.3, label=view)
            right.plot(times, differences, color=hue, marker="o", markersize=3.5, linewidth=1.3)
            for number, time, apart in zip(numbers, times, differences, strict=True):
                right.annotate(f" {number:g}", (time, apart), fontsize=_SMALL, color=hue)
        left.set(title=f"{title}: time", xlabel="quality", ylabel="ms", yscale="log")
        right.set(title=f"{title}: difference from the best", xlabel="ms", ylabel="ΔE 2000", xscale="log")
        right.set_ylim(bottom=0.0)
        for axis in (left.yaxis, right.xaxis):
            axis.set_major_formatter(lambda value, _: f"{value:g}")
            axis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:g}"[0] in "25" else "")
    figure.legend(
        *panels[0][0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=4,
        fontsize=_SMALL,
        frameon=False,
    )
    drivers = ", ".join(dict.fromkeys(str(row["opengl"]) for row in known))
    figure.suptitle(f"Pictures by {drivers or 'no OpenGL'}", x=0.01, ha="left")
    return figure


def draw_parts(rows: Sequence[Row]) -> Any:
    """Draw what each part of the best picture takes, and how much of the picture it is."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    parts = list(dict.fromkeys(str(row["part"]) for row in rows))
    views = list(dict.fromkeys(str(row["view"]) for row in rows))
    thick = 0.8 / max(len(views), 1)
    for number, (view, hue) in enumerate(zip(views, _HUES, strict=False)):
        of_view = {str(row["part"]): row for row in rows if row["view"] == view}
        at = np.arange(len(parts)) + (number - (len(views) - 1) / 2) * thick
        for axes, key in ((left, "spared_ms"), (right, "difference")):
            values = [value_of(of_view[part], key) for part in parts]
            axes.barh(at, values, height=thick, color=hue, label=view)
    for axes, title, unit in ((left, "time that it takes", "ms"), (right, "what it changes", "ΔE 2000")):
        axes.set(title=title, xlabel=unit, yticks=range(len(parts)), yticklabels=parts)
        axes.invert_yaxis()
    left.legend(fontsize=_SMALL, frameon=False)
    return figure


def _number(row: Row) -> float:
    return value_of(row, "number")
