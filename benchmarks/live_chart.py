"""Chart of what a stroke waits for until the terrain shows it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.benchmarks.live import STAGES
from sketchterrain.benchmarks.outcome import samples_of, value_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.benchmarks.outcome import Row

GOAL = 150.0
"""ms, within which 95 % of strokes shall be there."""
# Okabe and Ito's palette, which colour-blind people can tell apart.
_COLOURS = ("#999999", "#0072B2", "#AA5586", "#E69F00", "#009E73")
_LINES = ("#0072B2", "#D55E00")
_INK = "#333333"


def draw_live(rows: Sequence[Row]) -> Any:
    """How many sketches are there after a time; what the mean of it is made of."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 3.8), layout="constrained")
    shares, parts = figure.subplots(1, 2)
    for row, colour in zip(rows, _LINES, strict=False):
        ms = np.sort(samples_of(row, "seconds")) * 1e3
        share = np.arange(1, len(ms) + 1) / len(ms) * 100.0
        shares.plot(ms, share, color=colour, linewidth=1.8, label=str(row["painting"]))
    shares.axvline(GOAL, color=_INK, linewidth=0.9, linestyle=":")
    shares.axhline(95.0, color=_INK, linewidth=0.9, linestyle=":")
    shares.set(xlim=(0, None), ylim=(0, 101), xlabel="ms from the stroke to its heights in the view's tiles")
    shares.set(ylabel="% of sketches", title="There after")
    shares.legend(frameon=False, loc="lower right")
    names = [str(row["painting"]) for row in rows]
    left = np.zeros(len(rows))
    for stage, colour in zip(STAGES, _COLOURS, strict=True):
        widths = np.array([value_of(row, f"{stage}_ms".replace(" ", "_")) for row in rows])
        parts.barh(names, widths, left=left, color=colour, height=0.5, label=stage)
        left = left + widths
    parts.invert_yaxis()
    parts.set(xlabel="ms, mean", title="Where the time goes")
    parts.legend(frameon=False, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.18), fontsize=8)
    figure.suptitle("Painting while the terrain follows", x=0.01, ha="left")
    return figure
