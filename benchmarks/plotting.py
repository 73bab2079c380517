"""Colours, figures and axes that all charts share. matplotlib comes with the extra ``bench``."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from sketchterrain.benchmarks.report import Row, value_of

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
    "legend.frameon": False,
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


class BarPanel(NamedTuple):
    """A panel of bars: its title and unit, the rows' key of each series, and the values asked for."""

    title: str
    unit: str
    series: Mapping[str, str]
    asked: tuple[float, ...] = ()


def draw_bars(title: str, panels: Sequence[BarPanel], names: Sequence[str], rows: Sequence[Row]) -> Any:
    """Draw panels with a group of bars for each row, named by some of its cells; dotted: what is asked."""
    dotted = ". Dotted: asked." if any(panel.asked for panel in panels) else ""
    figure = new_figure(1.5 + 3.7 * len(panels), 1.6 + 0.4 * len(rows), title + dotted)
    labels = [", ".join(str(row[name]) for name in names) for row in rows]
    every = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
    for panel, axes in zip(panels, every, strict=True):
        thick = 0.8 / len(panel.series)
        for number, ((name, key), hue) in enumerate(zip(panel.series.items(), HUES, strict=False)):
            places = [place + (number + 0.5) * thick - 0.4 for place in range(len(rows))]
            axes.barh(places, [value_of(row, key) for row in rows], height=thick, color=hue, label=name)
        for asked in panel.asked:
            axes.axvline(asked, color=INK, linewidth=1.0, linestyle=":")
        axes.set(title=panel.title, xlabel=panel.unit, ylim=(len(rows) - 0.5, -0.5))
        if len(panel.series) > 1:
            axes.legend(fontsize=SMALL, ncols=2, loc="upper left", bbox_to_anchor=(0.0, -0.25))
    every[0].set_yticks(range(len(rows)), labels)
    return figure
