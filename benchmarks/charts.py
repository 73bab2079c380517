"""Charts: error against time, kernels' times, tiles' rates. matplotlib comes with the extra ``bench``."""

import io
import math
from collections.abc import Callable, Iterable, Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np

from sketchterrain.benchmarks.accuracy import DOUBLE, FLOAT, NUMPY
from sketchterrain.benchmarks.choices import draw_choices
from sketchterrain.benchmarks.clipped_tree import draw_index
from sketchterrain.benchmarks.culling import draw_culling
from sketchterrain.benchmarks.drapes import draw_drapes
from sketchterrain.benchmarks.erosion import draw_erosion, draw_normals
from sketchterrain.benchmarks.flight import BUDGET, MOST
from sketchterrain.benchmarks.flight_methods import OURS, THESIS
from sketchterrain.benchmarks.landforms import draw_stability, draw_terrains, draw_trade_offs
from sketchterrain.benchmarks.live import draw_live, draw_views
from sketchterrain.benchmarks.low_flight import draw_flight
from sketchterrain.benchmarks.pictures import draw_motion, draw_parts, draw_previews, draw_qualities
from sketchterrain.benchmarks.plotting import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    SMALL,
    STYLE,
    VERMILION,
    new_figure,
)
from sketchterrain.benchmarks.points import draw_room, draw_spectra, draw_table_6_1
from sketchterrain.benchmarks.report import Outcome, Row, samples_of, value_of
from sketchterrain.benchmarks.roads import draw_roads
from sketchterrain.benchmarks.speed import draw_rates, draw_thesis
from sketchterrain.benchmarks.splines import draw_splines
from sketchterrain.benchmarks.vector_scale import draw_scale
from sketchterrain.benchmarks.worlds import draw_worlds

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
    series = panels[0][0].get_legend_handles_labels()
    figure.legend(*series, loc="outside lower center", ncols=min(4, len(settings)), fontsize=SMALL)
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


def available() -> bool:
    """Whether matplotlib is installed."""
    return find_spec("matplotlib") is not None


def draw(name: str, outcome: Outcome) -> dict[str, bytes]:
    """Return a benchmark's chart as the contents of files by suffix, or nothing if it has none.

    Also nothing where matplotlib is missing.
    """
    if name not in CHARTS or not available():
        return {}
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        drawn = {"": CHARTS[name](outcome.tables[0].rows)}
        for number, (ending, drawer) in enumerate(MORE.get(name, {}).items(), start=1):
            drawn[f"-{ending}"] = drawer(outcome.tables[number].rows)
        return {
            f"{ending}.{kind}": _saved(figure, kind)
            for ending, figure in drawn.items()
            for kind in ("png", "svg")
        }


def _saved(figure: Any, kind: str) -> bytes:
    stream = io.BytesIO()
    # No date, so that the same numbers make the same file.
    metadata = {"Date": None} if kind == "svg" else {}
    figure.savefig(stream, format=kind, dpi=120, metadata=metadata)
    return stream.getvalue()


def _log_axis(axis: Any, limits: tuple[float, float]) -> None:
    """Make an axis logarithmic, with a plain number at each decade: 0.01, 100, 10k."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.axes.set(**{f"{axis.axis_name}scale": "log", f"{axis.axis_name}lim": limits})
    axis.set_major_locator(LogLocator(numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _: _tick(value)))
    axis.set_minor_formatter(NullFormatter())


def _tick(value: float) -> str:
    if value >= 1e6:
        return f"{value / 1e6:g} M"
    if value >= 10_000:
        return f"{value / 1000:g}k"
    return f"{value:.10g}" if value > 0.9e-4 else f"{value:.0e}"


def _decades(values: Iterable[float], *, below: int = 0, above: int = 0) -> tuple[float, float]:
    """Powers of ten around the values, with room to spare."""
    known = [math.log10(value) for value in values]
    return 10.0 ** (math.floor(min(known)) - below), 10.0 ** (math.ceil(max(known)) + above)


# Error against time ---------------------------------------------------------------------------------------

_MEASURES = (
    ("height_mm", "heights", "largest error, mm"),
    ("normal_deg", "normals", "largest error, degrees"),
    ("material", "weights", "largest error, share of 1"),
)
_METHODS = {FLOAT: (BLUE, "o", -1), DOUBLE: (VERMILION, "s", 1), NUMPY: (PURPLE, "|", -1)}
"""Colour, marker, and the side of its points on which a method's labels stand."""


def _accuracy(rows: Sequence[Row]) -> Any:
    """Error against time: a point a method and cell size, a row of panels a ground."""
    grounds = list(dict.fromkeys(str(row["ground"]) for row in rows))
    title = "Error against time, down and left is better. Labels are cell sizes in metres."
    figure = new_figure(11.0, 0.5 + 3.7 * len(grounds), title)
    panels = figure.subplots(len(grounds), len(_MEASURES), squeeze=False)
    for ground, line in zip(grounds, panels, strict=True):
        of_ground = [row for row in rows if row["ground"] == ground]
        times = [value_of(row, "ns_per_vertex") for row in of_ground]
        for (key, title, unit), axes in zip(_MEASURES, line, strict=True):
            axes.set(ylabel=unit, title=f"{ground}: {title}", xlabel="ns a vertex")
            errors = [value_of(row, key) for row in of_ground if value_of(row, key) > 0] or [1.0]
            _log_axis(axes.xaxis, (min(times) / 80, max(times) * 4))  # room for labels on both sides
            _log_axis(axes.yaxis, _decades(errors, below=1, above=1))
            for method in _METHODS:
                _error_points(axes, of_ground, method, key)
            _references(axes, of_ground, key)
    return figure


def _error_points(axes: Any, rows: Sequence[Row], method: str, key: str) -> None:
    """Mark a method's errors, with all its labels in one column beside the points of all methods."""
    colour, marker, side = _METHODS[method]
    known = [row for row in rows if row["method"] == method and value_of(row, key) > 0]
    if not known:
        return
    times = [value_of(row, "ns_per_vertex") for row in known]
    axes.plot(times, [value_of(row, key) for row in known], marker, color=colour, markersize=5)
    every = [value_of(row, "ns_per_vertex") for row in rows if value_of(row, key) > 0]
    x = max(every) if side > 0 else min(every)
    style = {"textcoords": "offset points", "va": "center", "color": colour}
    style["ha"] = "left" if side > 0 else "right"
    low, high = axes.get_ylim()
    for y, text in _merged(known, key, decades=math.log10(high / low)):
        axes.annotate(text, (x, y), (8 * side, 0), fontsize=SMALL, **style)
    top = max(value_of(row, key) for row in known)
    axes.annotate(method.removesuffix(" kernels"), (x, top), (8 * side, 13), fontweight="bold", **style)


def _references(axes: Any, rows: Sequence[Row], key: str) -> None:
    """Mark, on the time axis, the method that the others' errors are measured against."""
    method = DOUBLE if key == "material" else NUMPY
    times = [value_of(row, "ns_per_vertex") for row in rows if row["method"] == method]
    if not times:
        return
    colour, below = _METHODS[method][0], axes.get_xaxis_transform()
    axes.plot(times, [0.03] * len(times), "|", color=colour, markersize=8, transform=below)
    style = {"xycoords": below, "va": "bottom", "ha": "right", "color": colour, "fontsize": SMALL}
    axes.annotate(f"{method},\nthe reference", (max(times), 0.07), **style)


def _merged(rows: Sequence[Row], key: str, *, decades: float) -> list[tuple[float, str]]:
    """Labels of cell sizes and their heights: points within 6 % of the axis share one, a range."""
    groups: list[list[Row]] = []
    for row in sorted(rows, key=lambda row: value_of(row, key)):
        if groups and math.log10(value_of(row, key) / value_of(groups[-1][-1], key)) < 0.06 * decades:
            groups[-1].append(row)
        else:
            groups.append([row])
    labels = []
    for group in groups:
        sizes = sorted((value_of(row, "cell_size") for row in group), reverse=True)
        y = math.sqrt(value_of(group[0], key) * value_of(group[-1], key))
        shown = [f"{size:.2g}" for size in sizes]
        labels.append((y, ", ".join(shown) if len(shown) < 3 else f"{shown[0]} … {shown[-1]}"))
    return labels


# Kernels --------------------------------------------------------------------------------------------------


def _kernels(rows: Sequence[Row]) -> Any:
    """Nanoseconds an item: a line a kernel and ground, a dot a level, a whisker to the 95th percentile."""
    lines = list(dict.fromkeys((str(row["kernel"]), row["ground"]) for row in rows))
    levels = sorted({int(value_of(row, "level")) for row in rows if row["level"] is not None})
    shades = dict(zip(levels, (ORANGE, VERMILION, BLUE, GREEN, PURPLE), strict=False))
    figure = new_figure(8.0, 1.2 + 0.24 * len(lines), "What an item costs in each kernel")
    axes = figure.subplots()
    for row in rows:
        y = lines.index((str(row["kernel"]), row["ground"]))
        x = value_of(row, "ns_per_item")
        worst = x * value_of(row, "p95_ms") / value_of(row, "median_ms")
        colour = INK if row["level"] is None else shades[int(value_of(row, "level"))]
        axes.plot([x, worst], [y, y], "-", color=colour, linewidth=1.2)
        axes.plot(x, y, "o", color=colour, markersize=5)
    axes.set(
        ylim=(len(lines) - 0.4, -1.1),
        xlabel="ns an item of device time: median, and line to the 95th percentile",
    )
    axes.set_yticks(
        range(len(lines)), [kernel if ground is None else f"{kernel}, {ground}" for kernel, ground in lines]
    )
    axes.tick_params(axis="y", length=0)
    _log_axis(axes.xaxis, _decades(value_of(row, "ns_per_item") for row in rows))
    for place, level in enumerate(levels):
        axes.text(
            0.02 + 0.1 * place,
            1.0,
            f"level {level}",
            color=shades[level],
            transform=axes.transAxes,
            fontweight="bold",
            va="top",
        )
    return figure


CHARTS: dict[str, Callable[[Sequence[Row]], Any]] = {
    "accuracy": _accuracy,
    "culling": draw_culling,
    "drapes": draw_drapes,
    "erosion": draw_erosion,
    "flight": draw_errors,
    "kernels": _kernels,
    "landforms": draw_trade_offs,
    "live": draw_live,
    "pictures": draw_qualities,
    "points": draw_table_6_1,
    "roads": draw_roads,
    "scale": draw_scale,
    "speed": draw_rates,
    "splines": draw_splines,
    "world": draw_worlds,
}
"""How each benchmark that has a chart draws it, from the rows of its first table."""

MORE: dict[str, dict[str, Callable[[Sequence[Row]], Any]]] = {
    "accuracy": {"choices": draw_choices},
    "erosion": {"normals": draw_normals},
    "flight": {"generation": draw_generation},
    "landforms": {"terrains": draw_terrains, "stability": draw_stability},
    "live": {"view": draw_views},
    "pictures": {"parts": draw_parts, "motion": draw_motion, "previews": draw_previews},
    "points": {"room": draw_room, "spectra": draw_spectra},
    "scale": {"index": draw_index, "flight": draw_flight},
    "speed": {"tiles": draw_thesis},
}
"""Charts of its second table and so on, by how their files' names end."""
