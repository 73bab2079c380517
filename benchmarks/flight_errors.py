"""Screen error against triangles and time: the points of every way, and where each reaches one pixel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.benchmarks.flight_meshes import View, measured
from sketchterrain.benchmarks.flight_scene import PICTURE, stops
from sketchterrain.benchmarks.flight_ways import OURS, THESIS, ways
from sketchterrain.benchmarks.outcome import Column, Row, Table, value_of
from sketchterrain.benchmarks.screen_error import ErrorSummary

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.terrain.terrain import Terrain

MOST = "most_px"
"""The key of the measured error that ways are compared at: what 99.9 % of the samples stay within, px."""

_HALF = 0.5
"""The share of the thesis's triangles that this program may draw at the same error."""

_COLUMNS = (
    Column("way", "way"),
    Column("shown", "setting"),
    Column("triangles", "triangles in view"),
    Column("ms", "ms from nothing"),
    Column("within", "samples within 1 px, %"),
    Column(MOST, "99.9 % within, px"),
    Column("worst_px", "worst, px"),
    Column("note", "note"),
)
_REACHING = (
    Column("way", "way"),
    Column("triangles", "triangles at 1 px"),
    Column("of_thesis", "of the thesis's metric's best"),
    Column("asked", "asked: at most"),
    Column("ms", "ms from nothing"),
)


def points(terrain: Terrain, effort: Effort) -> Table:
    """Measure every way at each of its settings over views of the flight."""
    views = [View(stop, PICTURE) for stop in stops(terrain, effort.flight_views)]
    found, absent = ways(terrain, effort)
    rows: list[Row] = []
    for way in found:
        way.draw(views[0], way.settings[0])  # warms up
        for setting in way.settings:
            triangles, seconds, distances, whole = [], [], [], True
            for view in views:
                shown = way.draw(view, setting)
                triangles.append(shown.triangles)
                seconds.append(shown.seconds)
                whole &= shown.whole
                distances.append(measured(terrain, shown.meshes, view, every=effort.flight_every))
            error = ErrorSummary.of(np.concatenate(distances))
            rows.append(
                {
                    "way": way.name,
                    "setting": setting,
                    "shown": way.unit.format(setting),
                    "triangles": round(float(np.mean(triangles))),
                    "ms": float(np.median(seconds)) * 1e3,
                    "within": error.within * 100,
                    MOST: error.most,
                    "worst_px": error.worst,
                    "samples": error.samples,
                    "note": None if whole else "pool too small",
                    "triangles_each": triangles,
                    "seconds_each": seconds,
                }
            )
    rows += [{"way": one.name, "note": f"absent: {one.reason}"} for one in absent]
    return Table(f"Screen error at {len(views)} places of the flight", _COLUMNS, tuple(rows))


def at_one_pixel(rows: Sequence[Row]) -> Table:
    """Return where each way reaches one pixel of measured error, from its points."""
    names = list(dict.fromkeys(str(row["way"]) for row in rows if row.get(MOST) is not None))
    triangles = {name: reaching(rows, name, "triangles") for name in names}
    theirs = [each for name, each in triangles.items() if name.startswith(THESIS) and each is not None]
    thesis = min(theirs, default=None)
    found: list[Row] = []
    for name in names:
        here = triangles[name]
        found.append(
            {
                "way": name,
                "triangles": None if here is None else round(here),
                "of_thesis": None if here is None or thesis is None else here / thesis,
                "asked": _HALF if name.startswith(OURS) else None,
                "ms": reaching(rows, name, "ms"),
                "setting": reaching(rows, name, "setting"),
            }
        )
    return Table("Triangles where 99.9 % of the samples are within 1 px", _REACHING, tuple(found))


def reaching(rows: Sequence[Row], way: str, key: str, *, pixels: float = 1.0) -> float | None:
    """Return a way's value at an error, on straight lines between its points in logarithms.

    None where its points don't lie to both sides of the error.
    """
    known = sorted(
        (value_of(row, MOST), value_of(row, key))
        for row in rows
        if row["way"] == way and value_of(row, MOST) > 0
    )
    errors = np.log([error for error, _ in known])
    if not known or not errors[0] <= np.log(pixels) <= errors[-1]:
        return None
    return float(np.exp(np.interp(np.log(pixels), errors, np.log([value for _, value in known]))))
