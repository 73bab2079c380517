"""Rivers as strips of water, lakes as sheets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sketchterrain.look.waters import Features, Field, Pool, Reach

    Floats = npt.NDArray[np.float64]

ACROSS: Final = 9
"""Vertices from bank to bank."""
OVERLAP: Final = 1.7
"""Width of the strip in widths of the water, so that it ends inside the banks."""
SHEET_CELLS: Final = 400
"""Quads along a lake's longer side, at most."""
ROUGHNESS: Final = 0.042
"""Manning's n of a bed of gravel, s/m^(1/3)."""
SHALLOWNESS: Final = 18.0
"""Width of a river over the radius of its flow."""
PEAK: Final = 4.0 / 3.0
"""Speed in the middle over the mean: of the profile 1 - x³ (water_waves.glsl: stream_profile)."""
SPEEDS: Final = (0.25, 3.2)
"""m/s."""
FALL_WIDTHS: Final = 4.0
"""Length in widths over which a river's fall is measured."""
MOUTH: Final = 9.0
"""m into a lake over which a river's surface becomes the lake's."""
LEVEL: Final = 0.4
"""m by which two waters' levels differ at most where they are one."""


class Surface(NamedTuple):
    """A water's surface as triangles.

    Attributes
    ----------
    place : (n, 3) float64
        World coordinates, m.
    course : (n, 4) float64
        m across and along, unit vector downstream.
    inside : (n,) float64
        m from the shore, negative in the bank.
    nature : (n, 4) float64
        Speed in the middle (m/s), fall (m a metre), share that is shown, half width (m; 0 for a lake).
    triangles : (k,) uint32
        Indices, three a triangle, counter-clockwise from above.
    """

    place: Floats
    course: Floats
    inside: Floats
    nature: Floats
    triangles: npt.NDArray[np.uint32]


def surfaces(features: Features) -> list[Surface]:
    """Return the surfaces of all waters, lakes first: where two lie in one place, one of them is shown."""
    rivers = [river for river in features.rivers if len(river.centreline) > 1]
    found = [sheet(lake.shape, lake.level) for lake in features.lakes]
    for number, river in enumerate(rivers):
        wider = [
            other
            for k, other in enumerate(rivers)
            if (other.centreline_width.mean(), -k) > (river.centreline_width.mean(), -number)
        ]
        surface = strip(river.centreline, river.centreline_width)
        surface.nature[:, 2] = _beside_lakes(surface.place, features.lakes) * _beside(surface.place, wider)
        found.append(surface)
    return found


def current(centreline: Floats, width: npt.NDArray[np.float32]) -> tuple[Floats, Floats]:
    """Return how fast a river runs in its middle and how steeply it falls.

    Parameters
    ----------
    centreline
        (m, 3) x, y, z of the water in m, downstream, m ≥ 2.
    width
        (m,) of the water, m.

    Returns
    -------
    speed : (m,) float64
        m/s: Manning's formula, R^(2/3) √fall / n, with a radius R that the width tells, within `SPEEDS`.
    fall : (m,) float64
        m a metre, over `FALL_WIDTHS` widths.
    """
    gone = _gone(centreline)
    wide = width.astype(np.float64)
    half = 0.5 * FALL_WIDTHS * wide
    before, after = np.maximum(gone - half, 0.0), np.minimum(gone + half, gone[-1])
    level = centreline[:, 2]
    drop = np.interp(before, gone, level) - np.interp(after, gone, level)
    fall = np.maximum(drop / np.maximum(after - before, 1e-9), 0.0)
    mean = (wide / SHALLOWNESS) ** (2.0 / 3.0) * np.sqrt(fall) / ROUGHNESS
    return np.clip(PEAK * mean, *SPEEDS), fall


def strip(centreline: Floats, width: npt.NDArray[np.float32]) -> Surface:
    """Widen a centreline to a strip of triangles.

    Parameters
    ----------
    centreline
        (m, 3) x, y, z in m, downstream, m ≥ 2.
    width
        (m,) of the water, m.

    Returns
    -------
    Surface
        With m · ACROSS vertices, all of it shown.
    """
    flat = centreline[:, :2]
    downstream = np.gradient(flat, axis=0)
    downstream /= np.maximum(np.linalg.norm(downstream, axis=1, keepdims=True), 1e-9)
    to_right = np.stack([downstream[:, 1], -downstream[:, 0]], axis=1)
    across = np.linspace(-0.5, 0.5, ACROSS)[None, :] * (OVERLAP * width.astype(np.float64) + 1.0)[:, None]
    place = np.empty((len(flat), ACROSS, 3))
    place[..., :2] = flat[:, None, :] + across[..., None] * to_right[:, None, :]
    place[..., 2] = centreline[:, 2:3]
    course = np.empty((len(flat), ACROSS, 4))
    course[..., 0] = across
    course[..., 1] = _gone(centreline)[:, None]
    course[..., 2:] = downstream[:, None, :]
    half = 0.5 * width.astype(np.float64)
    nature = np.empty((len(flat), ACROSS, 4))
    for k, value in enumerate((*current(centreline, width), np.ones(len(flat)), half)):
        nature[..., k] = value[:, None]
    triangles = _quads(np.arange(len(flat) * ACROSS, dtype=np.uint32).reshape(len(flat), ACROSS))
    inside = half[:, None] - np.abs(across)
    return Surface(
        place.reshape(-1, 3), course.reshape(-1, 4), inside.ravel(), nature.reshape(-1, 4), triangles.ravel()
    )


def sheet(shape: Field, level: float) -> Surface:
    """Cover a lake with a flat grid that ends inside its banks.

    Parameters
    ----------
    shape
        Where the lake is.
    level
        Height of the water, m.

    Returns
    -------
    Surface
        Across and along are east and north; it does not flow.
    """
    rows, columns = shape.inside.shape
    step = -(-max(rows, columns) // SHEET_CELLS)
    # The last row and column once more, so that a coarse grid reaches the rim.
    row = np.minimum(np.arange(0, rows + step - 1, step), rows - 1)
    column = np.minimum(np.arange(0, columns + step - 1, step), columns - 1)
    inside = shape.inside[np.ix_(row, column)]
    x, y = np.meshgrid(column * shape.spacing, row * shape.spacing)
    place = np.stack([x + shape.west, y + shape.south, np.full(x.shape, level)], axis=-1)
    course = np.stack([x, y, np.zeros(x.shape), np.ones(x.shape)], axis=-1)
    index = np.arange(x.size, dtype=np.uint32).reshape(x.shape)
    wet = np.maximum.reduce([inside[:-1, :-1], inside[:-1, 1:], inside[1:, :-1], inside[1:, 1:]])
    used, triangles = np.unique(_quads(index)[wet > -0.25 * shape.spacing], return_inverse=True)
    nature = np.tile([0.0, 0.0, 1.0, 0.0], (len(used), 1))
    return Surface(
        place.reshape(-1, 3)[used],
        course.reshape(-1, 4)[used],
        inside.ravel()[used].astype(np.float64),
        nature,
        triangles.ravel().astype(np.uint32),
    )


def _quads(index: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
    """Return two triangles a quad, (rows − 1, columns − 1, 6); rows go north and columns east."""
    sw, se, nw, ne = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    return np.stack([sw, se, ne, sw, ne, nw], axis=-1)


def _gone(centreline: Floats) -> Floats:
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(centreline[:, :2], axis=0).T))])


def _beside_lakes(place: Floats, lakes: Sequence[Pool]) -> Floats:
    """Return how little of a lake there is at places: 1 on land, 0 from `MOUTH` inside its shore on."""
    shown = np.ones(len(place))
    for lake in lakes:
        field = lake.shape
        at = np.stack([place[:, 1] - field.south, place[:, 0] - field.west]) / field.spacing
        inside = map_coordinates(field.inside.astype(np.float64), at, order=1, mode="nearest")
        share = np.clip(inside / MOUTH, 0.0, 1.0)
        shown *= np.where(np.abs(place[:, 2] - lake.level) < LEVEL, 1.0 - share, 1.0)
    return shown


def _beside(place: Floats, rivers: Sequence[Reach]) -> Floats:
    """Return how little of other rivers there is at places: 1 at their banks, 0 halfway to their middle."""
    shown = np.ones(len(place))
    for river in rivers:
        line = river.centreline
        distance, nearest = cKDTree(line[:, :2]).query(place[:, :2])
        half = 0.5 * river.centreline_width[nearest].astype(np.float64)
        share = np.clip(2.0 * (1.0 - distance / half), 0.0, 1.0)
        beside = np.abs(place[:, 2] - line[nearest, 2]) < LEVEL
        # Before its beginning and beyond its end a river is not there.
        for end, towards in ((0, 1), (len(line) - 1, len(line) - 2)):
            inward = (place[:, :2] - line[end, :2]) @ (line[towards, :2] - line[end, :2])
            beside &= (nearest != end) | (inward > 0.0)
        shown *= np.where(beside, 1.0 - share, 1.0)
    return shown
