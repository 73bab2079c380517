"""Colours, figures and axes that all charts share. matplotlib comes with the extra ``bench``."""

from typing import Any

# Okabe and Ito's palette, distinguishable by colour-blind readers.
BLUE, SKY, VERMILION, GREEN, PURPLE, ORANGE = "#0072B2", "#56B4E9", "#D55E00", "#009E73", "#AA5586", "#E69F00"
GREY, INK = "#888888", "#333333"
HUES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE)
SMALL = 7.5
"""Points of a label's font."""

STYLE = {
    "font.size": 9.0,
    "font.family": "DejaVu Sans",
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.6,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "svg.fonttype": "none",
    "svg.hashsalt": "sketchterrain",
}


def new_figure(width: float, height: float, title: str | None = None) -> Any:
    """Return an empty figure, inches, with an optional title at its left."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    if title is not None:
        figure.suptitle(title, x=0.01, ha="left")
    return figure


def plain_numbers(*axes: Any) -> None:
    """Write plain numbers at the major ticks of logarithmic axes, and none at the minor ones."""
    from matplotlib.ticker import FormatStrFormatter, NullFormatter

    for axis in axes:
        axis.set_major_formatter(FormatStrFormatter("%g"))
        axis.set_minor_formatter(NullFormatter())
