"""Painted courses of rivers against their centrelines, and the ground along these."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.features import label_shapes
from sketchterrain.features.skeleton import skeletons
from sketchterrain.terrain.water import standing_water

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.features import Shape
    from sketchterrain.terrain.terrain import Terrain

    Reals = npt.NDArray[np.float64]

_STEP = 1.0  # m along a centreline
_MOST_STEPS = 50_000
_RISE = 0.01  # m: what still counts as not rising
_REACH = 8.0  # px: how far from a painted stroke a centreline can lie and still be its own


@dataclass(frozen=True)
class RiverAdherence:
    """One painted river network (a connected region of the river layer) and its centrelines.

    Attributes
    ----------
    label, id, area : int
        As in :class:`~sketchterrain.features.Shape`.
    lost : bool
        Whether no centreline runs near it.
    mean_distance, greatest_distance : float or None
        Sketch pixels from the painted skeleton to the centreline and back.
    descending : float or None
        Share of the centreline, in steps of a metre, along which the bed rises by no more than a centimetre.
    deepest_pit : float or None
        Metres that the bed lies below a place farther downstream; lakes are meant and do not count.
    """

    label: int
    id: int
    area: int
    lost: bool
    mean_distance: float | None
    greatest_distance: float | None
    descending: float | None
    deepest_pit: float | None


def measure_rivers(terrain: Terrain) -> tuple[RiverAdherence, ...]:
    """Measure every painted river; labels that touch are one network, told by the label of its first pixel.

    What a river does beyond the sketch's edge is not measured: nothing is painted there.
    """
    sketch = terrain.sketch
    painted = sketch.layers["river"] > 0
    lines = [_inside(terrain, along(river.centreline[:, :2])) for river in terrain.recipe.rivers]
    beds = [_beds(terrain, line) for line in lines]
    bones = [
        (bone.rows[0] * sketch.width_px + bone.columns[0], _places(terrain, bone.rows, bone.columns))
        for bone in skeletons(painted)
    ]
    result = []
    for network in label_shapes("river", painted.astype(np.uint8)):
        own = set(
            (network.pixels(network.mask)[0] * sketch.width_px + network.pixels(network.mask)[1]).tolist()
        )
        skeleton = np.concatenate([at for first, at in bones if int(first) in own])
        label = int(sketch.layers["river"].flat[network.id])
        near = [i for i, line in enumerate(lines) if _is_near(line, skeleton, _REACH * sketch.pixel_size)]
        result.append(
            _measured(network, label, skeleton, [(lines[i], beds[i]) for i in near], sketch.pixel_size)
        )
    return tuple(result)


def along(points: Reals, step: float = _STEP) -> Reals:
    """Return places in even steps (m) along a line through points of shape (n, 2)."""
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    count = min(int(lengths[-1] / step) + 2, _MOST_STEPS)
    at = np.linspace(0.0, lengths[-1], count)
    return np.stack([np.interp(at, lengths, points[:, axis]) for axis in (0, 1)], axis=-1)


def _beds(terrain: Terrain, line: Reals) -> list[Reals]:
    """Heights (m) along a line, without what lies in a lake: its bed is a hollow that is meant."""
    height = terrain.heights(line[:, 0], line[:, 1])
    dry = ~standing_water(terrain.recipe, "lake", line[:, 0], line[:, 1], height)
    starts = np.flatnonzero(np.diff(dry.astype(np.int8), prepend=0) == 1)
    ends = np.flatnonzero(np.diff(dry.astype(np.int8), append=0) == -1) + 1
    return [height[start:end].astype(np.float64) for start, end in zip(starts, ends, strict=True)]


def _measured(
    network: Shape, label: int, skeleton: Reals, courses: list[tuple[Reals, list[Reals]]], pixel_size: float
) -> RiverAdherence:
    if not courses:
        return RiverAdherence(label, network.id, network.area, True, None, None, None, None)
    line = np.concatenate([line for line, _ in courses])
    to = np.asarray(cKDTree(line).query(skeleton)[0])
    back = np.asarray(cKDTree(skeleton).query(line)[0])
    beds = [bed for _, pieces in courses for bed in pieces]
    steps = np.concatenate([np.zeros(0), *(np.diff(bed) for bed in beds)])
    return RiverAdherence(
        label=label,
        id=network.id,
        area=network.area,
        lost=False,
        mean_distance=float(max(to.mean(), back.mean()) / pixel_size),
        greatest_distance=float(max(to.max(), back.max()) / pixel_size),
        descending=float(np.mean(steps <= _RISE)) if steps.size else 1.0,
        deepest_pit=max((float((bed - np.minimum.accumulate(bed)).max()) for bed in beds), default=0.0),
    )


def _is_near(line: Reals, skeleton: Reals, reach: float) -> bool:
    """Whether most of a line lies near a painted skeleton."""
    if len(line) == 0:
        return False
    distance, _ = cKDTree(skeleton).query(line, distance_upper_bound=reach)
    return bool(np.mean(np.isfinite(distance)) > 0.5)


def _inside(terrain: Terrain, line: Reals) -> Reals:
    east, north = terrain.size
    x, y = line.T
    inside = (x >= 0.0) & (x <= east) & (y >= 0.0) & (y <= north)
    return np.asarray(line[inside])


def _places(terrain: Terrain, rows: npt.NDArray[np.int64], columns: npt.NDArray[np.int64]) -> Reals:
    sketch = terrain.sketch
    x, y = columns + 0.5, sketch.height_px - rows - 0.5
    return np.stack([x, y], axis=-1) * sketch.pixel_size
