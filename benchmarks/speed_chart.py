"""Charts of the program against its rivals: noise, and tiles' error against time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sketchterrain.benchmarks.outcome import value_of
from sketchterrain.benchmarks.thesis_tiles import OURS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.benchmarks.outcome import Row

_OWN, _OTHER = "#0072B2", "#999999"
_LEAST = 1e-4  # mm; what is exact stands there


def draw_rates(figure: Any, rows: Sequence[Row]) -> Any:
    """Draw a bar a method, longer is faster; methods that are absent have none."""
    axes = figure.subplots()
    names = [str(row["method"]) for row in rows]
    rates = [value_of(row, "million_octaves_per_s") for row in rows]
    colours = [_OWN if name.startswith(OURS) else _OTHER for name in names]
    axes.barh(range(len(rows)), rates, color=colours, height=0.62)
    for place, (row, rate) in enumerate(zip(rows, rates, strict=True)):
        text = f"{rate:.0f}" if rate else str(row.get("note") or "absent")
        axes.annotate(text, (rate, place), (4, 0), textcoords="offset points", va="center", fontsize=8.0)
    axes.set_yticks(range(len(rows)), names)
    axes.set(xlim=(0, max(rates) * 1.12), xlabel="million points × octaves a second")
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    figure.suptitle("Simplex fBm of 8 octaves, the same threads for all but NumPy", x=0.01, ha="left")
    return figure


def draw_thesis(figure: Any, rows: Sequence[Row]) -> Any:
    """Draw a dot a way, a panel a ground: the error of 99 % of the vertices against time.

    Without float64 no error is known, and nothing is drawn.
    """
    from matplotlib.ticker import FormatStrFormatter, NullFormatter

    rows = [row for row in rows if row.get("error_mm") is not None]
    if not rows:
        return figure
    grounds = list(dict.fromkeys(str(row["ground"]) for row in rows))
    panels = figure.subplots(1, len(grounds), squeeze=False, sharey=True)[0]
    for ground, axes in zip(grounds, panels, strict=True):
        for number, row in enumerate(row for row in rows if row["ground"] == ground):
            own = str(row["method"]).startswith(OURS)
            x, y = value_of(row, "us_per_tile"), max(value_of(row, "error_mm"), _LEAST)
            colour = _OWN if own else _OTHER
            axes.plot(x, y, "o", color=colour, markersize=6, clip_on=False)
            text = str(row["method"]).removeprefix("the thesis's way, ").removeprefix(f"{OURS}, ")
            weight = "bold" if own else "normal"
            axes.annotate(
                text,
                (x, y),
                (6, -11 if number % 2 else 4),
                textcoords="offset points",
                color=colour,
                fontsize=7.5,
                fontweight=weight,
            )
        times = [value_of(row, "us_per_tile") for row in rows if row["ground"] == ground]
        axes.set(xscale="log", yscale="log", xlim=(min(times) / 1.5, max(times) * 5), title=ground)
        axes.set_xlabel("µs a tile")
        axes.set_ylim(_LEAST / 2, 3 * max(value_of(row, "error_mm") for row in rows) + _LEAST)
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.xaxis.set_major_formatter(FormatStrFormatter("%g"))
    panels[0].set_ylabel("height error of 99 % of the vertices, mm")
    figure.suptitle(
        "Tiles against the thesis's way: samples a piece × rounds. Down and left is better.",
        x=0.01,
        ha="left",
    )
    return figure
