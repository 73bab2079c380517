"""Conflicts between painted layers and their resolution (Zaaijer 2013, section 4.3).

Precedence of layers: mountains, hills and dunes add up, plateaus raise them; lakes lie in the result;
rivers cut into all of it, and flow through lakes at the lakes' level. Covers change no height. A plateau
keeps clear of painted rivers: they flow in canyons, at the level of the ground below it.

So a river painted across a mountain cuts a valley: its bed stays below the straight line from where it enters
the mountain to where it leaves it. One that begins in a mountain has its spring there, one that ends in a
mountain ends there. A lake in a mountain is a tarn: its rim is raised where the mountain falls away.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.landforms.hydrology.lakes import runs_inside
from sketchterrain.landforms.placement.feature_types import Lake, River, lake_centre
from sketchterrain.landforms.placement.shapes import find_regions, region_numbers
from sketchterrain.stages.runner import Runner

if TYPE_CHECKING:
    from sketchterrain.document.label_layers import LabelImage
    from sketchterrain.document.sketch import Sketch


class MountainRun(NamedTuple):
    """Run of a centreline inside a painted mountain."""

    first: int  # first point inside
    last: int  # last point inside
    mountain: int  # number from 1, in reading order of the shapes' first pixels


class Resolution(NamedTuple):
    """Resolution of a conflict between layers."""

    line: str  # for the user
    x: float  # m; amid a river's run through a mountain or lake, at its spring or end, or at a tarn's centre
    y: float  # m


def label_mountains(image: LabelImage, run: Runner) -> Int64Array:
    """Return the number of the mountain, or of another layer's shape, at each pixel, from 1; 0 for none."""
    return region_numbers(image, run(find_regions, image, hashed=False)) + 1


def mountain_crossings(sketch: Sketch, numbers: Int64Array, line: Float64Array) -> list[MountainRun]:
    """Return the runs of a centreline (m, 2) inside mountains, upstream first."""
    labels = _labels_along(sketch, numbers, line)
    changes = np.flatnonzero(np.diff(labels)) + 1
    firsts, ends = np.concatenate([[0], changes]), np.concatenate([changes, [len(line)]])
    return [
        MountainRun(int(first), int(end) - 1, int(labels[first]))
        for first, end in zip(firsts, ends, strict=True)
        if labels[first]
    ]


def resolve_conflicts(
    sketch: Sketch,
    numbers: Int64Array,
    rivers: Sequence[River],
    grounds: Sequence[Float64Array],
    lakes: Sequence[Lake],
) -> tuple[Resolution, ...]:
    """Describe each conflict between layers and its resolution in one line.

    `rivers` are sorted by id; `grounds` (m,) each are terrain heights (m) without rivers along the
    centrelines; `lakes` have the painted ones first. Rivers and lakes are counted from 1.
    """
    found: list[Resolution] = []
    for number, (river, ground) in enumerate(zip(rivers, grounds, strict=True), 1):
        line = river.centreline[:, :2]
        for run in mountain_crossings(sketch, numbers, line):
            text = f"river {number} {_describe_crossing(run, river, ground, rivers)}"
            found.append(_resolution_along(text, line, run.first, run.last))
        for first, last, at in runs_inside(lakes, line):
            verb = "springs from" if first == 0 else "runs through"
            verb = "ends in" if last == len(line) - 1 else verb
            text = f"river {number} {verb} lake {at + 1}: water at {lakes[at].level:.1f} m"
            found.append(_resolution_along(text, line, first, last))
    for number, lake in enumerate(lakes, 1):
        centre = lake_centre(lake)
        mountain = int(_labels_along(sketch, numbers, centre[None])[0])
        if mountain and lake.label:
            text = f"lake {number} lies in mountain {mountain}: a tarn at {lake.level:.0f} m"
            found.append(Resolution(text, *centre.tolist()))
    return tuple(found)


def canyon_resolutions(sketch: Sketch, rivers: Sequence[River], run: Runner) -> tuple[Resolution, ...]:
    """Describe the canyons that rivers cut through plateaus."""
    if not (rivers and sketch.layers["plateau"].any()):
        return ()
    numbers = label_mountains(sketch.layers["plateau"], run)
    found = []
    for number, river in enumerate(rivers, 1):
        line = river.centreline[:, :2]
        for crossing in mountain_crossings(sketch, numbers, line):
            text = f"river {number} cuts a canyon through plateau {crossing.mountain}"
            found.append(_resolution_along(text, line, crossing.first, crossing.last))
    return tuple(found)


def _resolution_along(text: str, line: Float64Array, first: int, last: int) -> Resolution:
    """Return a resolution amid a run of a line, or at its loose end if it has just one."""
    at = (first + last) // 2
    if (first == 0) != (last == len(line) - 1):
        at = first if first == 0 else last
    return Resolution(text, *line[at].tolist())


def _describe_crossing(run: MountainRun, river: River, ground: Float64Array, rivers: Sequence[River]) -> str:
    inside = slice(run.first, run.last + 1)
    cut = max(float((ground[inside] - river.centreline[inside, 2]).max()), 0.0)
    if run.first == 0:
        return f"begins in mountain {run.mountain}: springs there at {river.centreline[0, 2]:.0f} m"
    if run.last == len(river.centreline) - 1:
        end = river.centreline[-1]
        joins = any((other.centreline == end).all(axis=1).any() for other in rivers if other is not river)
        text = "joins a river in" if joins else "ends in"
        return f"{text} mountain {run.mountain}: valley cut {cut:.0f} m"
    return f"crosses mountain {run.mountain}: valley cut {cut:.0f} m"


def _labels_along(sketch: Sketch, numbers: Int64Array, line: Float64Array) -> Int64Array:
    column = np.floor(line[:, 0] / sketch.pixel_size).astype(np.int64)
    row = np.floor(sketch.height_px - line[:, 1] / sketch.pixel_size).astype(np.int64)
    inside = (row >= 0) & (row < sketch.height_px) & (column >= 0) & (column < sketch.width_px)
    found = numbers[np.where(inside, row, 0), np.where(inside, column, 0)]
    return np.asarray(np.where(inside, found, 0), dtype=np.int64)
