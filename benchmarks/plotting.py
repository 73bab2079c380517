"""Colours, figures and axes that all charts share. matplotlib comes with the extra ``bench``."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from sketchterrain.benchmarks.report import Row, value_of

# Okabe and Ito's palette, distinguishable by colour-blind readers.
BLUE, SKY, VERMILION, GREEN, PURPLE, ORANGE = "#0072B2", "#56B4E9", "#D55E00", "#009E73", "#AA5586", "#E69F00"
GREY, INK = "#888888", "#333333"
HUES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, GREY, INK)
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
    from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

    for axis in axes:
        low, high = axis.get_view_interval()
        axis.set_major_locator(LogLocator(subs=(1.0,) if high > 100.0 * low else (1.0, 2.0, 5.0)))
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
    labels = [", ".join(str(row[name]) for name in names if row[name] is not None) for row in rows]
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


class Curves(NamedTuple):
    """A panel of curves: the key across, keys up by name, keys of curves and of texts at points."""

    title: str
    x: str
    y: Mapping[str, str]
    by: str = ""
    text: str = ""
    units: tuple[str, str] = ("", "")
    scales: tuple[str, str] = ("log", "log")
    asked: tuple[float, ...] = ()
    joined: bool = True


def draw_curves(title: str, panels: Sequence[Curves], rows: Sequence[Row], *, each: str = "") -> Any:
    """Draw panels over the rows that have both numbers, for each value of a key; dotted: what is asked."""
    dotted = ". Dotted: asked." if any(panel.asked for panel in panels) else ""
    parts = [(value, panel) for value in _values(rows, each) for panel in panels]
    columns = min(len(parts), 3)
    lines = -(-len(parts) // columns)
    figure = new_figure(1.0 + 3.7 * columns, 1.2 + 3.0 * lines, title + dotted)
    every = figure.subplots(lines, columns, squeeze=False).ravel()
    for axes in every[len(parts) :]:
        axes.set_axis_off()
    series: dict[str, Any] = {}
    for axes, (value, panel) in zip(every, parts, strict=False):
        hues = {name: HUES[number % len(HUES)] for number, name in enumerate(_values(rows, panel.by))}
        _draw_panel(axes, panel, hues, [row for row in rows if str(row.get(each, "")) == value])
        axes.set(title=": ".join(filter(None, (value, panel.title))), xlabel=panel.units[0])
        axes.set_ylabel(panel.units[1])
        handles, names = axes.get_legend_handles_labels()
        series |= dict(zip(names, handles, strict=True))
    if len(series) > 1:
        figure.legend(series.values(), series, loc="outside lower center", ncols=columns, fontsize=SMALL)
    return figure


def _values(rows: Sequence[Row], key: str) -> list[str]:
    return list(dict.fromkeys(str(row.get(key, "")) for row in rows))


def _draw_panel(axes: Any, panel: Curves, hues: Mapping[str, str], rows: Sequence[Row]) -> None:
    """Draw each curve, exact values at a tenth of the least other one of a logarithmic axis."""
    keys = (panel.x, *panel.y.values())
    known = [[value_of(row, key) for row in rows if value_of(row, key) > 0.0] or [1.0] for key in keys]
    floors = min(known[0]) / 10.0, min(map(min, known[1:])) / 10.0
    for name, hue in hues.items():
        mine = [row for row in rows if str(row.get(panel.by, "")) == name]
        for number, (part, key) in enumerate(panel.y.items()):
            drawn = [row for row in mine if None not in (row.get(panel.x), row.get(key))]
            places = [
                tuple(
                    max(value_of(row, what), floor) if scale == "log" else value_of(row, what)
                    for what, floor, scale in zip((panel.x, key), floors, panel.scales, strict=True)
                )
                for row in drawn
            ]
            colour = hue if panel.by else HUES[number % len(HUES)]
            line = ("-", ":", "--", "-.")[number % 4 if panel.by else 0] if panel.joined else ""
            label = ", ".join(filter(None, (name, part)))
            if places:
                across, up = zip(*places, strict=True)
                axes.plot(across, up, line, marker="o", color=colour, markersize=3.5, label=label)
            for place, row in {
                place: row for place, row in zip(places, drawn, strict=True) if panel.text
            }.items():
                cell = row.get(panel.text)
                text = f"{cell:.3g}" if isinstance(cell, float) else str(cell)
                axes.annotate(text, place, (4, 4), textcoords="offset points", fontsize=SMALL, color=colour)
    for asked in panel.asked:
        axes.axhline(asked, color=INK, linewidth=1.0, linestyle=":")
    axes.set(xscale=panel.scales[0], yscale=panel.scales[1])
    plain_numbers(
        *(axis for axis, scale in zip((axes.xaxis, axes.yaxis), panel.scales, strict=True) if scale == "log")
    )
