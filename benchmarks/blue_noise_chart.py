"""Charts of Poisson-disk points: table 6.1 of the thesis, the room that is left, and spectra."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sketchterrain.benchmarks.outcome import samples_of, value_of
from sketchterrain.benchmarks.point_ways import OURS, THESIS, TURNS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.benchmarks.outcome import Row

_OWN, _THESIS, _GTX = "#0072B2", "#777777", "#D55E00"
_MORE = ("#E69F00", "#AA5586", "#009E73", "#333333")
_SMALL = 8.0
_RATES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000)
_IDEAL, _ASKED = -13.0, -11.0  # dB, of twenty sets; the worst that is asked for
_ASKED_ROOM = 1.0  # %
_LEAST_ROOM = 1e-3  # %; what is less stands there


def draw_table_6_1(rows: Sequence[Row]) -> Any:
    """Draw points a second against r, a panel a number of darts: of both ways, and the thesis's figures."""
    trials = list(dict.fromkeys(row["trials"] for row in rows))
    figure = _figure(10.0, 4.0)
    panels = figure.subplots(1, len(trials), squeeze=False, sharey=True)[0]
    series = (
        ("million_per_s", OURS, _OWN, "o-"),
        ("thesis_million_per_s", f"{THESIS} here", _THESIS, "s-"),
        ("gtx_million_per_s", "its figure, GTX 580", _GTX, "D--"),
    )
    for k, axes in zip(trials, panels, strict=True):
        of_k = [row for row in rows if row["trials"] == k]
        distances = [value_of(row, "distance") for row in of_k]
        for key, name, colour, style in series:
            rates = [value_of(row, key) or float("nan") for row in of_k]
            axes.plot(distances, rates, style, color=colour, markersize=4.5, linewidth=1.4, label=name)
        axes.set(xscale="log", yscale="log", title=f"k = {k}", xlabel="r")
        axes.set_xticks(distances, [f"{distance:g}" for distance in distances])
        axes.xaxis.set_minor_locator(_no_ticks())
    rates = [value_of(row, key) for row in rows for key, *_ in series if value_of(row, key)]
    low, high = min(rates) / 1.5, max(rates) * 1.5
    ticks = [tick for tick in _RATES if low < tick < high]
    panels[0].set_ylim(low, high)
    panels[0].set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    panels[0].yaxis.set_minor_locator(_no_ticks())
    panels[0].set_ylabel("million points a second")
    panels[-1].legend(fontsize=_SMALL, frameon=False)
    figure.suptitle(
        "Table 6.1 of the thesis: up is better. r: the least distance; k: darts a cell.", x=0.01, ha="left"
    )
    return figure


def draw_room(rows: Sequence[Row]) -> Any:
    """Draw the room that is left against darts a cell and against time, with the default in a ring."""
    known = [row for row in rows if row.get("room") is not None]
    figure = _figure(10.0, 4.4)
    panels = figure.subplots(1, 2, sharey=True)
    names = list(dict.fromkeys(str(row["way"]) for row in known))
    colours = {OURS: _OWN, THESIS: _THESIS}
    colours |= dict(zip((name for name in names if name not in colours), _MORE, strict=False))
    default = next(row for row in known if row.get("note"))
    for axes, key, label in zip(panels, ("trials", "us_per_point"), ("darts, k", "µs a point"), strict=True):
        for name in names:
            of_way = [row for row in known if row["way"] == name]
            room = [max(value_of(row, "room"), _LEAST_ROOM) for row in of_way]
            style = "o-" if len(of_way) > 1 else "o"
            axes.plot(
                [_abscissa(row, key) for row in of_way],
                room,
                style,
                color=colours[name],
                markersize=4.5,
                linewidth=1.4,
                label=name,
            )
        place = _abscissa(default, key), max(value_of(default, "room"), _LEAST_ROOM)
        axes.plot(*place, "o", color=_OWN, markersize=11, fillstyle="none")
        label_style: Any = {"textcoords": "offset points", "color": _OWN, "fontsize": _SMALL, "ha": "right"}
        axes.annotate("default", place, (-7, -12), **label_style)
        axes.axhline(_ASKED_ROOM, color=_GTX, linestyle=":", linewidth=1.2)
        axes.set(xscale="log", yscale="log", xlabel=label)
        axes.xaxis.set_major_formatter(_plain())
        axes.xaxis.set_minor_formatter(_none())
        axes.yaxis.set_major_formatter(_plain())
    panels[0].set_ylabel("room left, % of the ground; dotted: asked")
    panels[1].legend(fontsize=_SMALL, frameon=False)
    figure.suptitle("Ground where another point would still fit. Down and left is better.", x=0.01, ha="left")
    return figure


def draw_spectra(rows: Sequence[Row]) -> Any:
    """Draw power and anisotropy against frequency, a line a way; the first row is the reference."""
    figure = _figure(11.0, 4.2)
    power, anisotropy = figure.subplots(1, 2)
    colours = {OURS: _OWN, THESIS: _THESIS, TURNS: _GTX}
    more = iter(_MORE)
    for number, row in enumerate(rows):
        name = str(row["way"])
        colour = colours[name] if name in colours else next(more) if number else "#BBBBBB"
        style = {"color": colour, "linewidth": 1.3 if number else 3.0}
        frequency = samples_of(row, "frequency")
        power.plot(
            frequency, samples_of(row, "power"), label=f"{name}, fill {value_of(row, 'fill'):.2f}", **style
        )
        anisotropy.plot(frequency, samples_of(row, "anisotropy"), **style)
    power.set(xlabel="waves a distance", ylabel="power, 1 by chance", title="radial power")
    power.legend(fontsize=_SMALL, frameon=False)
    anisotropy.axhline(_IDEAL, color="#000000", linestyle=":", linewidth=1.0)
    anisotropy.axhline(_ASKED, color=_GTX, linestyle=":", linewidth=1.0)
    anisotropy.set(
        xlabel="waves a distance",
        ylabel="dB; dotted: best of twenty sets, asked",
        title="anisotropy",
    )
    figure.suptitle("Spectra; the grey line is darts thrown one after another", x=0.01, ha="left")
    return figure


def _abscissa(row: Row, key: str) -> float:
    return 1.0 / value_of(row, "million_per_s") if key == "us_per_point" else value_of(row, key)


def _figure(width: float, height: float) -> Any:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _plain() -> Any:
    from matplotlib.ticker import FormatStrFormatter

    return FormatStrFormatter("%g")


def _none() -> Any:
    from matplotlib.ticker import NullFormatter

    return NullFormatter()


def _no_ticks() -> Any:
    from matplotlib.ticker import NullLocator

    return NullLocator()
