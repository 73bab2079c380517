"""Charts: error against time, kernels' times, tiles' rates. matplotlib comes with the extra ``bench``."""

import io
import math
from collections.abc import Callable, Iterable, Sequence
from importlib.util import find_spec
from typing import Any

from sketchterrain.benchmarks.accuracy import DOUBLE, FLOAT, NUMPY
from sketchterrain.benchmarks.choices import draw_choices
from sketchterrain.benchmarks.clipped_tree import draw_index
from sketchterrain.benchmarks.culling import draw_culling
from sketchterrain.benchmarks.drapes import draw_drapes
from sketchterrain.benchmarks.erosion import draw_erosion, draw_normals
from sketchterrain.benchmarks.flight_chart import draw_errors, draw_generation
from sketchterrain.benchmarks.landforms import draw_stability, draw_terrains, draw_trade_offs
from sketchterrain.benchmarks.live import draw_live, draw_views
from sketchterrain.benchmarks.low_flight import draw_flight
from sketchterrain.benchmarks.pictures import draw_motion, draw_parts, draw_previews, draw_qualities
from sketchterrain.benchmarks.plotting import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PURPLE,
    SMALL,
    STYLE,
    VERMILION,
    new_figure,
)
from sketchterrain.benchmarks.points import draw_room, draw_spectra, draw_table_6_1
from sketchterrain.benchmarks.report import Outcome, Row, value_of
from sketchterrain.benchmarks.roads import draw_roads
from sketchterrain.benchmarks.speed import draw_rates, draw_thesis
from sketchterrain.benchmarks.splines import draw_splines
from sketchterrain.benchmarks.vector_scale import draw_scale
from sketchterrain.benchmarks.worlds import draw_worlds


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
