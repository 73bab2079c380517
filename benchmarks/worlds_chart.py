"""Chart of what worlds take by their size."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sketchterrain.benchmarks.outcome import value_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.benchmarks.outcome import Row

# Okabe and Ito's palette, which colour-blind people can tell apart.
_BLUE, _VERMILION, _INK = "#0072B2", "#D55E00", "#333333"


def draw_worlds(rows: Sequence[Row]) -> Any:
    """Time and memory against area: the one should rise in proportion, the other not at all."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, NullFormatter

    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    time, memory = figure.subplots(1, 2)
    area = [(value_of(row, "side") - 1.0) ** 2 * 1e-6 for row in rows]
    seconds = [value_of(row, "seconds") for row in rows]
    time.plot(area, seconds, "o-", color=_BLUE, markersize=4.5, label="measured")
    linear = [seconds[-1] * each / area[-1] for each in area]
    time.plot(area, linear, ":", color=_INK, linewidth=1.0, label="in proportion to the largest")
    time.set(xscale="log", yscale="log", ylabel="s", title="Time")
    time.legend(fontsize=7.5, frameon=False)
    most = [value_of(row, "megabytes") for row in rows]
    memory.plot(area, most, "o-", color=_BLUE, markersize=4.5, label="measured")
    expected = [value_of(row, "megabytes") * value_of(row, "estimated_memory") for row in rows]
    memory.plot(area, expected, "x", color=_VERMILION, markersize=6, label="estimated before")
    memory.legend(fontsize=7.5, frameon=False, loc="lower right")
    memory.axhline(2000.0, color=_INK, linewidth=0.8, linestyle=":")
    memory.annotate("2 GB", (area[0], 2000.0), (0, -10), textcoords="offset points", fontsize=7.5)
    memory.set(xscale="log", ylim=(0, 2200), ylabel="MB at most", title="Memory")
    for axes in (time, memory):
        axes.set(xlabel="km² at 1 m, with all coarser levels")
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
    time.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    figure.suptitle("What a world takes, by its area", x=0.01, ha="left")
    return figure
