"""A chart of tracing: wrong labels and broken rivers against JPEG's quality, beside the nearest colour."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sketchterrain.benchmarks.outcome import value_of
from sketchterrain.benchmarks.tracing import NEAREST, OWN

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.benchmarks.outcome import Row

# Okabe and Ito's palette, which colour-blind people can tell apart.
_COLOURS = {OWN: "#D55E00", NEAREST: "#0072B2"}


def draw_tracing(rows: Sequence[Row]) -> Any:
    """Wrong labels of all pixels and of those away from borders, and parts of rivers."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 3.6), layout="constrained")
    wrong, rivers = figure.subplots(1, 2)
    for method, colour in _COLOURS.items():
        mine = [row for row in rows if row["method"] == method]
        quality = [value_of(row, "quality") for row in mine]
        for key, style, what in (("wrong", "-", "all pixels"), ("wrong_away", ":", "away from borders")):
            shares = [max(value_of(row, key), 1e-3) for row in mine]
            wrong.plot(quality, shares, f"o{style}", color=colour, markersize=4, label=f"{method}, {what}")
        parts = [value_of(row, "river_parts") for row in mine]
        rivers.plot(quality, parts, "o-", color=colour, markersize=4, label=method)
    drawn = [value_of(row, "drawn_parts") for row in rows[:1]]
    rivers.axhline(drawn[0], color="#BBBBBB", linewidth=1.0, label="drawn")
    wrong.set(yscale="log", xlabel="JPEG quality", ylabel="wrong labels, % (least shown: 0.001)")
    rivers.set(yscale="log", xlabel="JPEG quality", ylabel="parts of rivers")
    for axes in (wrong, rivers):
        axes.legend(frameon=False, fontsize=8)
        axes.spines[["top", "right"]].set_visible(False)
    return figure
