"""Chart of how the time from a sketch to its features grows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sketchterrain.benchmarks.outcome import value_of
from sketchterrain.benchmarks.sketch_scaling import STAGES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.benchmarks.outcome import Row

# Okabe and Ito's palette, which colour-blind people can tell apart.
_BLUE, _VERMILION, _GREEN, _PURPLE, _ORANGE = "#0072B2", "#D55E00", "#009E73", "#AA5586", "#E69F00"
_INK = "#333333"


def draw_scaling(rows: Sequence[Row]) -> Any:
    """Time against pixels and against shapes, by stage, with what linear growth would be."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 4.4), layout="constrained")
    panels = figure.subplots(1, 2)
    lines = (*(f"{stage} ms".replace(" ", "_") for stage in STAGES), "whole_ms", "again_ms")
    names = (*STAGES, "the whole", "placed again after a stroke")
    colours = (_GREEN, _ORANGE, _PURPLE, _VERMILION, _BLUE, _INK, _INK)
    for growing, axes in zip(("pixels", "shapes"), panels, strict=True):
        mine = [row for row in rows if row["growing"] == growing]
        x = [value_of(row, "side") ** 2 if growing == "pixels" else value_of(row, "shapes") for row in mine]
        times = [[max(value_of(row, key), 0.01) for row in mine] for key in lines]
        for name, colour, key, ms in zip(names, colours, lines, times, strict=True):
            style = "--" if key == "again_ms" else "-"
            width = 2.2 if key == "whole_ms" else 1.2
            axes.plot(x, ms, f"o{style}", color=colour, markersize=3.5, linewidth=width, label=name)
        whole = times[lines.index("whole_ms")][-1]
        axes.plot(x, [whole * value / x[-1] for value in x], ":", color=_INK, linewidth=0.8, label="linear")
        fixed = "20 shapes" if growing == "pixels" else f"{value_of(mine[0], 'side'):g} px"
        axes.set(xlabel=growing, ylabel="ms", title=f"{growing.capitalize()}, {fixed}")
        axes.set(xscale="log", yscale="log")
    panels[1].legend(fontsize=7.5, loc="upper left", frameon=False)
    figure.suptitle("From a sketch to placed features", x=0.01, ha="left")
    return figure
