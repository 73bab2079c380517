"""Chart of other ways: error against time, a panel for each choice."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from sketchterrain.benchmarks.choices import SUBJECTS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.benchmarks.outcome import Row

_CHOSEN, _OTHER = "#0072B2", "#777777"
_COLUMNS = 3
_APART = 0.07  # of a panel's height, between labels


def draw_choices(figure: Any, rows: Sequence[Row]) -> Any:
    """Draw a dot a way, blue where it is the one that is used; exact ways stand on the floor."""
    lines = -(-len(SUBJECTS) // _COLUMNS)
    panels = figure.subplots(lines, _COLUMNS, squeeze=False).ravel()
    for (subject, unit), axes in zip(SUBJECTS.items(), panels, strict=True):
        _panel(axes, [row for row in rows if row["subject"] == subject])
        axes.set_title(unit, fontsize=9.0)
    figure.suptitle(
        "Largest error against time of each way to do the same, down and left is better. Blue: what is used.",
        x=0.01,
        ha="left",
    )
    return figure


def _panel(axes: Any, rows: Sequence[Row]) -> None:
    from matplotlib.ticker import FormatStrFormatter, NullFormatter

    errors, times = [_number(row, "error") for row in rows], [_number(row, "ns") for row in rows]
    known = [error for error in errors if error > 0] or [1.0]
    floor = 10.0 ** (math.floor(math.log10(min(known))) - 1)
    top = 10.0 ** math.ceil(math.log10(max(known)) + 0.3)
    axes.set(xscale="log", yscale="log", xlim=(min(times) / 1.6, max(times) * 8), ylim=(floor / 1.5, top))
    axes.set_xlabel("ns a point", fontsize=8.0)
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.xaxis.set_major_formatter(FormatStrFormatter("%g"))
    decades = math.log10(top / floor * 1.5)
    heights = _spread([math.log10(max(error, floor)) for error in errors], decades * _APART)
    label_x = max(times) * 1.25
    for row, time, error, height in zip(rows, times, errors, heights, strict=True):
        chosen = row["chosen"] == "yes"
        colour, place = _CHOSEN if chosen else _OTHER, max(error, floor)
        axes.plot(time, place, "o", color=colour, markersize=6 if chosen else 5, clip_on=False)
        axes.plot([time, label_x * 0.96], [place, 10.0**height], "-", color=colour, linewidth=0.4, alpha=0.5)
        text = f"{row['choice']}: exact" if error == 0 else str(row["choice"])
        weight = "bold" if chosen else "normal"
        axes.text(label_x, 10.0**height, text, color=colour, fontsize=7.5, va="center", fontweight=weight)


def _spread(values: Sequence[float], apart: float) -> list[float]:
    """Move values up as little as keeps them so far apart, in their order."""
    order = sorted(range(len(values)), key=lambda i: values[i])
    moved = list(values)
    for before, here in pairwise(order):
        moved[here] = max(values[here], moved[before] + apart)
    return moved


def _number(row: Row, key: str) -> float:
    value = row[key]
    return float(value) if isinstance(value, (int, float)) else 0.0
