"""Charts of flights: screen error against triangles and time; generation in the thesis's terms."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from sketchterrain.benchmarks.flight import BUDGET, MOST
from sketchterrain.benchmarks.flight_methods import OURS, THESIS
from sketchterrain.benchmarks.plotting import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    SMALL,
    VERMILION,
    new_figure,
)
from sketchterrain.benchmarks.report import Row, samples_of, value_of

_COLOURS = {
    f"{OURS}, 32": BLUE,
    f"{OURS}, 64": SKY,
    f"{THESIS}, 32": ORANGE,
    THESIS: VERMILION,
    "uniform": GREY,
    "pymartini": GREEN,
    "pydelatin": PURPLE,
}
_APART = 0.045  # of a panel's height, between labels
_BINS = 12  # a decade
_QUADS = 64  # whose frames are shown one by one


def draw_errors(rows: Sequence[Row]) -> Any:
    """Draw a line a way, a dot a setting: error against triangles, and against time."""
    figure = new_figure(11.0, 4.6, "Screen error of what is drawn. Down and left is better.")
    left, right = figure.subplots(1, 2, sharey=True)
    rows = [row for row in rows if row.get(MOST) is not None]
    errors = [value_of(row, MOST) for row in rows]
    low, high = min([*errors, 1.0]) / 2, max(errors) * 1.6
    for axes, key, what in ((left, "triangles", "triangles in view"), (right, "ms", "ms from nothing")):
        values = [value_of(row, key) for row in rows]
        axes.set(xscale="log", yscale="log", ylim=(low, high))
        axes.set(xlim=(min(values) / 1.5, max(values) * (max(values) / min(values)) ** 0.75), xlabel=what)
        axes.plot([min(values) / 1.5, max(values) * 1.2], [1, 1], ":", color=INK, linewidth=0.8)
        names = list(dict.fromkeys(str(row["way"]) for row in rows))
        ends = {}
        for name in names:
            mine = [row for row in rows if row["way"] == name]
            x, y = [value_of(row, key) for row in mine], [value_of(row, MOST) for row in mine]
            axes.plot(x, y, "o-", color=_colour(name), markersize=4, linewidth=1.4)
            last = int(np.argmin(y))
            ends[name] = (x[last], y[last])
        _label(axes, ends, max(values) * 1.5)
        _plain(axes)
    left.set_ylabel("pixels that 99.9 % of the samples stay within")
    return figure


def draw_generation(rows: Sequence[Row]) -> Any:
    """Bars by size of tiles and setting as in the thesis's figures 7.1 and 7.2; single frames below."""
    title = f"Generation in flight. Dotted: this program's budget, {BUDGET * 1e3:g} ms a frame."
    figure = new_figure(12.0, 7.0, title)
    panels = figure.subplots(2, 3)
    settings = list(dict.fromkeys((str(row["way"]), str(row["shown"])) for row in rows))
    shades = _shades([way for way, _ in settings])
    sizes = sorted({int(value_of(row, "quads")) for row in rows})
    bars = (
        ("updating_ms", "generation while updating, ms a frame"),
        ("worst_ms", "worst frame's generation, ms"),
        ("initial_ms", "initial generation, ms"),
    )
    width = 0.8 / len(settings)
    for axes, (key, title) in zip(panels[0], bars, strict=True):
        for number, (way, shown) in enumerate(settings):
            mine = {
                int(value_of(row, "quads")): row for row in rows if (row["way"], row["shown"]) == (way, shown)
            }
            places = [sizes.index(quads) + (number + 0.5) * width - 0.4 for quads in mine]
            heights = [value_of(row, key) for row in mine.values()]
            axes.bar(places, heights, width * 0.92, color=shades[number], label=f"{way}, {shown}")
        tops = [value_of(row, key) for row in rows if value_of(row, key) > 0] or [1.0]
        axes.set(yscale="log", title=title, xlabel="quads along a tile")
        axes.set_ylim(10 ** np.floor(np.log10(min(tops))), 10 ** np.ceil(np.log10(max(tops))))
        axes.set_xticks(range(len(sizes)), [str(size) for size in sizes])
        axes.grid(visible=False, axis="x")
        if key != "initial_ms":
            axes.axhline(BUDGET * 1e3, color=INK, linewidth=0.8, linestyle=":")
        _plain(axes, x=False)
    frames: tuple[tuple[str, Callable[[Row], Sequence[float]]], ...] = (
        ("generation of a frame, ms", lambda row: [1e3 * each for each in samples_of(row, "seconds")]),
        ("choice and generation, ms", _whole_frames),
        ("triangles in view", lambda row: samples_of(row, "triangles_each")),
    )
    size = _QUADS if _QUADS in sizes else sizes[0]
    for axes, (title, values) in zip(panels[1], frames, strict=True):
        for way, shown in {way: (way, shown) for way, shown in settings}.values():
            for row in rows:
                if (row["way"], row["shown"], row["quads"]) == (way, shown, size):
                    _histogram(axes, values(row), shades[settings.index((way, shown))])
        axes.set(title=f"{title}, {size} quads", xscale="log", ylabel="% of the frames")
        _plain(axes, y=False)
    figure.legend(
        *panels[0][0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=min(4, len(settings)),
        fontsize=SMALL,
        frameon=False,
    )
    return figure


def _whole_frames(row: Row) -> list[float]:
    generation, choice = samples_of(row, "seconds"), samples_of(row, "choice_seconds")
    return [1e3 * (a + b) for a, b in zip(generation, choice, strict=True)]


def _histogram(axes: Any, values: Sequence[float], colour: str) -> None:
    """Draw the share of frames by size, twelve bins a decade; what is 0 stands in no bin."""
    some = np.log10([value for value in values if value > 0])
    if not some.size:
        return
    edges = np.arange(np.floor(some.min() * _BINS), np.floor(some.max() * _BINS) + 2) / _BINS
    share = 100.0 * np.histogram(some, edges)[0] / len(values)
    axes.stairs(share, 10**edges, color=colour, linewidth=1.3)


def _label(axes: Any, ends: dict[str, tuple[float, float]], column: float) -> None:
    """Name the lines in a column to the right of their lowest ends, moved apart where they would overlap."""
    low, high = np.log10(axes.get_ylim())
    apart = (high - low) * _APART
    names = sorted(ends, key=lambda name: ends[name][1])
    places = np.log10([ends[name][1] for name in names])
    for _ in range(200):
        missing = np.maximum(apart - np.diff(places), 0.0) / 2
        places[:-1] -= missing
        places[1:] += missing
    places += max(low + apart / 2 - places[0], 0.0)
    for name, place in zip(names, places, strict=True):
        x, y = ends[name]
        colour = _colour(name)
        axes.plot([x, column], [y, 10**place], color=colour, linewidth=0.6, alpha=0.6)
        style = {"fontsize": SMALL, "va": "center", "color": colour, "fontweight": "bold"}
        axes.annotate(name, (column * 1.08, 10**place), **style)


def _plain(axes: Any, *, x: bool = True, y: bool = True) -> None:
    """Write plain numbers at the decades of logarithmic axes."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for axis, wanted in ((axes.xaxis, x), (axes.yaxis, y)):
        if wanted:
            low, high = axis.get_view_interval()
            axis.set_major_locator(LogLocator(subs=(1.0,) if high > 100 * low else (1.0, 2.0, 5.0)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: _tick(value)))
            axis.set_minor_formatter(NullFormatter())


def _tick(value: float) -> str:
    if value >= 1e6:
        return f"{value / 1e6:g} M"
    return f"{value / 1e3:g}k" if value >= 1e4 else f"{value:g}"


def _colour(name: str) -> str:
    return next((colour for start, colour in _COLOURS.items() if name.startswith(start)), GREY)


def _shades(names: Sequence[str]) -> list[str]:
    """Return a colour for each setting: the way's, the stronger the later."""
    ramps = {
        OURS: ("#BBDDF0", "#56B4E9", "#0072B2", "#003F63"),
        THESIS: ("#F3CDB4", "#E69F5A", "#D55E00", "#7F3800"),
    }
    seen: dict[str, int] = {}
    shades = []
    for name in names:
        ramp, number = ramps[name], seen.get(name, 0)
        seen[name] = number + 1
        count = names.count(name)
        shades.append(ramp[min(len(ramp) - 1, number + (1 if count < len(ramp) else 0))])
    return shades
