"""Choose a camera that shows a terrain: water or relief as the subject, ground before it, a high horizon."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.render.scene import BoundedTerrain, sample_heights, visible_rectangle
from sketchterrain.render.viewpoints import aim, standing_view, sun_preference, window

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array
    from sketchterrain.render.camera import Camera
    from sketchterrain.render.scene import HeightMap, TerrainSource
    from sketchterrain.render.sky import Weather


VIEWS: Final = ("auto", "ground", "hill", "air")
"""Kinds of views, see `find_view`."""
STANDS: Final = 14
"""Candidate stands along each side of the sketch."""
BEARINGS: Final = 60
DISTANCES: Final = 56
MOST_WATER: Final = 0.15
"""Share of the ground in a picture, by its apparent size, that may be water for nothing."""
TYPES: Final = 4
"""Of point features: mountain, hill, dune, forest."""
_TYPE_WEIGHTS: Final = np.array([1.0, 1.0, 2.2, 1.0])
"""How much each type of point feature adds to a view; what lies flat needs more weight to be seen at all."""


class _Height(NamedTuple):
    """How high over the ground a camera is put, and how it looks from there."""

    rises: tuple[float, ...]  # heights of the eye above the ground, in extents …
    limits: tuple[float, float]  # … and m
    fov: float
    horizon_at: float  # where the horizon should lie, in half heights above the picture's middle
    peak: tuple[float, float]  # tangent of the highest skyline's elevation that is best, and its width
    in_view: int  # neighbouring bearings that a picture shows
    clear: float  # tangent by which near ground lies under the eye at least, or it hides the rest
    near: float  # extents up to which ground is near
    wall: float  # what near ground costs that rises higher, by the tangent
    inside: float  # what it is worth that what is seen lies in the sketch
    water: float  # apparent size of water that counts for much


_HEIGHTS: Final = {
    # Over the trees, and not so high that they look like moss.
    "auto": _Height(
        rises=(0.010,),
        limits=(20.0, 190.0),
        fov=36.0,
        horizon_at=0.34,
        peak=(0.18, 0.10),
        in_view=9,
        clear=0.06,
        near=0.10,
        wall=14.0,
        inside=0.8,
        water=0.012,
    ),
    "air": _Height(
        rises=(0.035, 0.05, 0.07),
        limits=(250.0, 700.0),
        fov=40.0,
        horizon_at=0.40,
        peak=(0.06, 0.07),
        in_view=13,
        clear=0.30,
        near=0.22,
        wall=30.0,
        inside=2.0,
        water=0.004,
    ),
}


class _Panorama(NamedTuple):
    """What is seen all around from many stands, by stand, bearing and distance.

    A share is the tangent of the angle by which ground at a distance rises over all that is nearer.
    """

    horizon: Float64Array  # (stands, bearings) tangent of the skyline's elevation
    share: Float64Array  # (stands, bearings, distances)
    layers: Float64Array  # (stands, bearings) ridges one behind the other
    water: Float64Array  # (stands, bearings) apparent size of the visible water
    flooded: (
        Float64Array  # (stands, bearings) share of the visible ground, by its apparent size, that is water
    )
    painted: Float64Array  # (types, stands, bearings) share of what is seen that was painted so
    inside: Float64Array  # (stands, bearings) share of what is seen that lies in the sketch

    def horizon_of(self, distances: npt.NDArray[np.bool_]) -> Float64Array:
        """Return the tangent of the skyline's elevation that ground at the nearest distances makes."""
        return np.asarray(self.share[..., distances].sum(axis=-1) - 1.0)


def find_view(terrain: TerrainSource, kind: str = "auto", *, weather: Weather | None = None) -> Camera:
    """Choose a camera that shows a terrain. The same input always gives the same camera.

    Looks around from many stands, and takes the stand and bearing with the best mix of relief, visible water,
    painted features and open foreground.
    """
    check_view(kind)
    light = sun_preference(weather)
    if kind in ("ground", "hill"):
        return standing_view(terrain, light, raised=kind == "hill")
    height = _HEIGHTS[kind]
    extent = terrain.extent
    west, south, east, north = visible_rectangle(terrain)
    relief = sample_heights(terrain, ((west + east) / 2, (south + north) / 2), 3.4 * extent, 576)
    along = (np.arange(STANDS) + 0.5) / STANDS
    if not isinstance(terrain, BoundedTerrain):  # a sketch is seen from a little outside, too
        along = along * 1.1 - 0.05
    x, y = (
        grid.ravel() for grid in np.meshgrid(west + along * (east - west), south + along * (north - south))
    )
    rises = len(height.rises)
    x, y = np.tile(x, rises), np.tile(y, rises)
    rise = np.repeat(np.clip(np.array(height.rises) * extent, *height.limits), len(x) // rises)
    z = relief.at(x, y) + rise
    bearings = np.linspace(0.0, 2.0 * np.pi, BEARINGS, endpoint=False)
    distances = np.asarray(extent * np.geomspace(0.012, 1.6, DISTANCES), dtype=np.float64)
    seen = _look_around(terrain, relief, np.stack([x, y, z], axis=1), bearings, distances)
    score = _score(seen, distances / extent, height) + light(bearings)
    stand, bearing = np.unravel_index(int(np.argmax(score)), score.shape)
    eye_z = float(terrain.heights(x[stand], y[stand])) + float(rise[stand])
    place = (float(x[stand]), float(y[stand]), eye_z)
    skyline = window(seen.horizon, height.in_view)[:, stand, bearing]
    return aim(
        place,
        float(bearings[bearing]),
        skyline,
        extent,
        fov=height.fov,
        horizon_at=height.horizon_at,
    )


def check_view(kind: str) -> None:
    """Refuse a kind of view that there is not."""
    if kind not in VIEWS:
        raise InputError(f"expected a view, one of {', '.join(VIEWS)}, got {kind!r}")


def _look_around(
    terrain: TerrainSource,
    relief: HeightMap,
    eyes: Float64Array,
    bearings: Float64Array,
    distances: Float64Array,
) -> _Panorama:
    east = eyes[:, 0, None, None] + np.sin(bearings)[None, :, None] * distances
    north = eyes[:, 1, None, None] + np.cos(bearings)[None, :, None] * distances
    slope = (relief.at(east, north) - eyes[:, 2, None, None]) / distances
    skyline = np.maximum.accumulate(slope, axis=-1)
    # What lies steeper than 45° under the eye is in no picture.
    below = np.concatenate([np.full_like(skyline[..., :1], -1.0), skyline[..., :-1]], axis=-1)
    share = np.maximum(slope - np.maximum(below, -1.0), 0.0)
    seen = share > 0.0
    far = distances > 0.06 * terrain.extent
    appears = np.diff(seen[..., far].astype(np.int8), axis=-1) > 0
    water = water_map(terrain, relief)
    wet = water.at(east, north)
    size = seen * np.gradient(distances) / distances * np.clip(-slope, 0.0, 0.25)
    apparent = wet * size * far
    flooded = (wet * size).sum(axis=-1) / np.maximum(size.sum(axis=-1), 1e-9)
    middle = far & (distances < terrain.extent)
    shown = seen & middle
    count = np.maximum(shown.sum(axis=-1), 1.0)
    painted = [(mask.at(east, north) * shown).sum(axis=-1) / count for mask in _painted(terrain, relief)]
    west, south, *end = visible_rectangle(terrain)
    inside = (east > west) & (east < end[0]) & (north > south) & (north < end[1])
    return _Panorama(
        skyline[..., -1],
        share,
        appears.sum(axis=-1).astype(np.float64),
        apparent.sum(axis=-1),
        flooded,
        np.stack(painted),
        (inside * share * middle).sum(axis=-1),
    )


def water_map(terrain: TerrainSource, relief: HeightMap) -> HeightMap:
    """Return where rivers and lakes are, on the texels of a map: 1 there, 0 elsewhere."""
    rivers, lakes = terrain.features.rivers, [lake.shape for lake in terrain.features.lakes]
    places, widths = [river.centreline for river in rivers], [river.centreline_width for river in rivers]
    for lake in lakes:
        row, column = np.nonzero(lake.inside > 0)
        places.append(np.stack([column, row], axis=-1) * lake.spacing + [lake.west, lake.south])
        widths.append(np.full(len(row), lake.spacing, np.float32))
    return relief.rasterized_mask(places, widths)


def _painted(terrain: TerrainSource, relief: HeightMap) -> list[HeightMap]:
    """Draw, for each type of point feature, where painted ones are: 1 there, 0 elsewhere."""
    points = terrain.features.points
    points = points[points["painted"]]
    masks = []
    for code in range(TYPES):
        of_type = points[points["type"] == code]
        places = np.stack([of_type["x"], of_type["y"]], axis=1)
        masks.append(relief.rasterized_mask([places], [0.9 * of_type["radius"]]))
    return masks


def _score(seen: _Panorama, distance: Float64Array, height: _Height) -> Float64Array:
    """Rate each stand and bearing; distances are in extents."""
    horizon = window(seen.horizon, height.in_view)
    peak = horizon.max(axis=0)
    middle = window(seen.share[..., (distance > 0.10) & (distance < 1.2)].sum(axis=-1), height.in_view)
    # Ground that rises before the camera hides the rest.
    near = window(seen.horizon_of(distance < height.near), height.in_view)
    wall = np.maximum(near + height.clear, 0.0).mean(axis=0)
    painted = np.stack([window(share, height.in_view).mean(axis=0) for share in seen.painted])
    return np.asarray(
        2.2 * np.exp(-(((peak - height.peak[0]) / height.peak[1]) ** 2))
        + 0.8 * np.tanh(horizon.std(axis=0) / 0.04)
        + 0.9 * np.tanh(middle.mean(axis=0) / 0.15)
        + 1.0 * np.tanh(window(seen.layers, height.in_view).mean(axis=0) / 3.0)
        + 2.4 * np.tanh(window(seen.water, 7).mean(axis=0) / height.water)
        + np.tensordot(_TYPE_WEIGHTS, np.tanh(painted / 0.10), axes=1)
        + height.inside * np.tanh(window(seen.inside, height.in_view).mean(axis=0) / 0.15)
        - height.wall * wall
        # A lake is a subject, but not all there is to see.
        - 6.0 * np.maximum(window(seen.flooded, height.in_view).mean(axis=0) - MOST_WATER, 0.0)
    )
