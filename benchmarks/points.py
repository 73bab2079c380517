"""Blue noise: rate, remaining space and spectra of Poisson-disk methods."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Final, TypeVar

from sketchterrain.benchmarks.baselines.points import throw_darts
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.plotting import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SMALL,
    VERMILION,
    Curves,
    draw_curves,
    new_figure,
)
from sketchterrain.benchmarks.point_methods import (
    OURS,
    SIDE,
    THESIS,
    TURNS,
    ScatterMethod,
    Spectrum,
    fill_of,
    own,
    peers,
    room_of,
    spectrum_of,
    thesis,
)
from sketchterrain.benchmarks.poisson_disk import TRIALS
from sketchterrain.benchmarks.report import Row, Table, Tables, samples_of, value_of
from sketchterrain.benchmarks.timing import Lap, TimedContext, alternate, spread
from sketchterrain.vegetation.poisson_grids import GREATEST_DENSITY

Key = TypeVar("Key")

SEED = 7
GTX_580: Final[Mapping[tuple[int, int], float]] = {
    (r, k): rate
    for k, rates in {
        4: (8.03, 6.31, 2.00, 0.57),
        8: (5.51, 4.72, 1.40, 0.40),
        12: (4.29, 3.86, 1.09, 0.32),
    }.items()
    for r, rate in zip((1, 2, 4, 8), rates, strict=True)
}
"""Million points a second in table 6.1 of the thesis, by r and k, on 512 × 512."""
ASKED: Final[Mapping[str, float]] = {"Bridson, numba": 10.0, "scipy": 1000.0}
"""How many times as fast as each the program shall be at the same density."""
DARTS = "darts one by one, float64"

_FULLER = "fills more than any of the above"

_QUICK = 0.1  # s a lap
_MORE = 2  # times as many rounds of quick laps
_AROUND = 8.0  # distances more than the spectrum's square: its middle is taken

_TABLE_6_1_HEADINGS = {"distance": "r", "trials": "k"}
_ROOM_HEADINGS = {
    "trials": "k",
    "side": "side, r",
    "room": "room left, %",
    "ours_over_it": "so many times as fast",
}
_LARGE_HEADINGS = {"side": "side, r", "trials": "k"}
_SPECTRUM_HEADINGS = {"trials": "k", "worst": "worst band's anisotropy, dB"}


def measure(context: TimedContext, effort: Effort) -> Tables:
    """Points a second, fill, free area and spectrum of Poisson-disk methods.

    Time is by the clock, from call to points in memory, with buffers created before; laps below 0.1 s have
    twice as many rounds again. Fill is the density relative to that of a maximal set, 0.6966 points a squared
    distance, two distances away from the border. Room is the share of the area where another point would
    still fit, by random places.

    First, table 6.1 of the thesis: r, k darts a cell, its method (phase groups, three levels, all darts of a
    cell in one turn) on the same device, and the thesis's own figures for a GTX 580.

    Second, r = 1: fill and room against k and time, and libraries in one thread; scipy on a smaller square,
    because it is slow. A library is compared with this program at the fewest darts that fill as much, or at
    the most darts measured.

    Third, the spectrum (benchmarks/point_methods.py): power averaged over the angle, and anisotropy, whose
    limit for n sets is -10 log n dB. The power is compared with that of equally many darts thrown one after
    another, or of a maximal set if a method fills more.

    Fourth, larger squares by this program; the launches alone, by profiling events.
    """
    tables = (_table_6_1(context, effort), _room(context, effort), _spectra(context, effort))
    return (*tables, _large(context, effort))


def _table_6_1(context: TimedContext, effort: Effort) -> Table:
    cells = [(r, k) for r in effort.point_distances for k in effort.point_trials]
    methods = {(*cell, OURS): own(context, effort.point_side / cell[0], cell[1]) for cell in cells}
    methods |= {(*cell, THESIS): thesis(context, effort.point_side / cell[0], cell[1]) for cell in cells}
    laps = _laps(methods, effort.rounds)
    rows = []
    for r, k in cells:
        row, there = (_rate(methods[r, k, name], laps[r, k, name]) for name in (OURS, THESIS))
        # On a square of another size the figures are those for the same r, k and way.
        known = GTX_580.get((r, k))
        rows.append(
            {
                "distance": r,
                **row,
                "thesis_points": there["points"],
                "thesis_million_per_s": there["million_per_s"],
                "thesis_fill": there["fill"],
                "thesis_seconds": there["seconds"],
                "gtx_million_per_s": known,
                "over_thesis": _times_as_fast(row, there),
                "over_gtx": value_of(row, "million_per_s") / known if known else None,
            }
        )
    return Table(f"Table 6.1 of the thesis on {effort.point_side:g}²", tuple(rows), _TABLE_6_1_HEADINGS)


def _room(context: TimedContext, effort: Effort) -> Table:
    side = effort.room_side
    ladder = sorted({*effort.room_trials, TRIALS})
    libraries, absent = peers(side, effort.peer_trials, scipy_side=effort.scipy_side)
    methods = [
        *(own(context, side, k) for k in ladder),
        *(thesis(context, side, k) for k in effort.room_trials),
        *libraries,
    ]
    laps = _laps({(method.name, method.trials): method for method in methods}, effort.rounds)
    rows: list[Row] = []
    for method in methods:
        _, points = method.run(0)
        room = room_of(points, method.side, places=effort.room_places, seed=SEED)
        rate = _rate(method, laps[method.name, method.trials])
        rows.append({"way": method.name, "side": method.side, **rate, "room": room * 100.0})
    ours, others = rows[: len(ladder)], rows[len(ladder) :]
    rows = [{**row, "note": "the default" if row["trials"] == TRIALS else None} for row in ours]
    rows += [{**row, **_compared(row, ours)} for row in others]
    rows += [{"way": one.name, "note": f"absent: {one.reason}"} for one in absent]
    return Table(f"Room left on {side:g} × {side:g} distances", tuple(rows), _ROOM_HEADINGS)


def _compared(row: Row, ours: Sequence[Row]) -> Row:
    """Return how this program compares at the fewest darts that fill as much."""
    as_full = [one for one in ours if value_of(one, "fill") >= value_of(row, "fill")]
    equal = as_full[0] if as_full else ours[-1]
    asked = next((times for name, times in ASKED.items() if str(row["way"]).startswith(name)), None)
    return {
        "equal_trials": equal["trials"],
        "ours_over_it": _times_as_fast(equal, row),
        "asked": asked,
        "note": None if as_full else _FULLER,
    }


def _spectra(context: TimedContext, effort: Effort) -> Table:
    seeds = range(effort.spectrum_sets)
    side = SIDE + _AROUND
    darts = [throw_darts(side, seed=seed) for seed in seeds]
    libraries, _ = peers(side, effort.peer_trials[-1:])
    methods = [
        own(context, side, TRIALS),
        *(thesis(context, side, effort.point_trials[0], turns=turns) for turns in (False, True)),
        *libraries,
    ]
    maximal = spectrum_of(darts)
    rows = [_spectrum_row(DARTS, None, maximal, maximal, effort)]
    for method in methods:
        # Seen from a place away from the border.
        found = spectrum_of([method.run(seed)[1] - 0.5 * _AROUND for seed in seeds])
        count = round(found.points / SIDE**2 * side**2)
        as_many = spectrum_of([thrown[:count] for thrown in darts])
        rows.append(_spectrum_row(method.name, method.trials, found, as_many, effort))
    return Table(f"Spectrum of {len(seeds)} sets", tuple(rows), _SPECTRUM_HEADINGS)


def _large(context: TimedContext, effort: Effort) -> Table:
    cells = [(side, k) for side in effort.point_sides for k in (effort.point_trials[0], TRIALS)]
    methods = {(side, k): own(context, side, k) for side, k in cells}
    laps = _laps(methods, effort.rounds)
    rows = []
    for cell, method in methods.items():
        row, device = _rate(method, laps[cell]), spread([lap.device for lap in laps[cell]]).median
        rate = value_of(row, "points") / device * 1e-6
        rows.append({"side": method.side, **row, "launch_million_per_s": rate})
    return Table("More points", tuple(rows), _LARGE_HEADINGS)


def _spectrum_row(name: str, trials: int | None, found: Spectrum, darts: Spectrum, effort: Effort) -> Row:
    middle, power, anisotropy = found.bands()
    return {
        "way": name,
        "trials": trials,
        "sets": effort.spectrum_sets,
        "points": found.points,
        "fill": found.points / (GREATEST_DENSITY * SIDE**2),
        "worst": found.worst,
        "worst_frequency": found.worst_frequency,
        "power_difference": found.power_difference(darts),
        "frequency": middle.tolist(),
        "power": power.tolist(),
        "anisotropy": anisotropy.tolist(),
    }


def _laps(methods: Mapping[Key, ScatterMethod], rounds: int) -> dict[Key, list[Lap]]:
    return alternate(
        {key: method.lap for key, method in methods.items()}, rounds=rounds, quick=_QUICK, more=_MORE
    )


def _times_as_fast(one: Row, other: Row) -> float:
    """Return the ratio of points a second in the rounds that both took part in."""
    laps, others = samples_of(one, "seconds"), samples_of(other, "seconds")
    shared = min(len(laps), len(others))
    ratio = spread(others[:shared]).median / spread(laps[:shared]).median
    return ratio * value_of(one, "points") / value_of(other, "points")


def _rate(method: ScatterMethod, laps: Sequence[Lap]) -> Row:
    _, points = method.run(0)
    samples = [lap.wall for lap in laps]
    times = spread(samples)
    return {
        "trials": method.trials,
        "points": len(points),
        **times.cells(),
        "million_per_s": len(points) / times.median * 1e-6,
        "us_per_point": times.median / len(points) * 1e6,
        "fill": fill_of(points, method.side),
        "seconds": samples,
    }


_LIBRARY_HUES = (ORANGE, PURPLE, GREEN, INK)
_IDEAL, _ASKED = -13.0, -11.0  # dB, of twenty sets; the worst that is asked for


def draw_spectra(rows: Sequence[Row]) -> Any:
    """Draw power and anisotropy against frequency, a line a way; the first row is the reference."""
    figure = new_figure(11.0, 4.2, "Spectra; the grey line is darts thrown one after another")
    power, anisotropy = figure.subplots(1, 2)
    colours = {OURS: BLUE, THESIS: GREY, TURNS: VERMILION}
    more = iter(_LIBRARY_HUES)
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
    power.legend(fontsize=SMALL)
    anisotropy.axhline(_IDEAL, color="#000000", linestyle=":", linewidth=1.0)
    anisotropy.axhline(_ASKED, color=VERMILION, linestyle=":", linewidth=1.0)
    anisotropy.set(
        xlabel="waves a distance",
        ylabel="dB; dotted: best of twenty sets, asked",
        title="anisotropy",
    )
    return figure


_RATES = {OURS: "million_per_s", f"{THESIS} here": "thesis_million_per_s", "GTX 580": "gtx_million_per_s"}
_TABLE_6_1 = [Curves("", "distance", _RATES, units=("r", "million points a second"))]
draw_table_6_1 = partial(draw_curves, "Table 6.1 of the thesis, by darts a cell", _TABLE_6_1, each="trials")
_ROOM = [
    Curves("", key, {"": "room"}, by="way", units=(unit, "room left, % of the ground"), asked=(1.0,))
    for key, unit in (("trials", "darts, k"), ("us_per_point", "µs a point"))
]
draw_room = partial(draw_curves, "Ground where another point would still fit", _ROOM)
