"""Automatic viewpoints: a camera that shows relief and water behind an open foreground."""

from typing import Final, NamedTuple

import numpy as np

from sketchterrain.array_types import BoolArray, Float64Array
from sketchterrain.errors import InputError
from sketchterrain.render.camera import Camera
from sketchterrain.render.scene import (
    BoundedTerrain,
    HeightMap,
    TerrainSource,
    sample_heights,
    visible_rectangle,
)
from sketchterrain.render.sky import Weather
from sketchterrain.render.viewpoints import (
    aim,
    eye_level_view,
    grid_positions,
    is_inside,
    neighbouring_bearings,
    ray_positions,
    sun_preference,
)

VIEWS: Final = ("auto", "ground", "hill", "air")  # view kinds; see `find_view`
VIEWPOINTS_PER_SIDE: Final = 14  # candidate viewpoints along each side of the sketch
BEARINGS: Final = 60
DISTANCES: Final = 56
WATER_LIMIT: Final = 0.15
"""Share of water in the visible terrain, by apparent size, above which it is penalised."""
TYPES: Final = 4  # point feature types: mountain, hill, dune, forest
_TYPE_WEIGHTS: Final = np.array([1.0, 1.0, 2.2, 1.0])
"""Weight of each type in the score; flat dunes need more to matter."""


class _ViewStyle(NamedTuple):
    """Eye height, framing and scoring parameters of a view kind."""

    rises: tuple[float, ...]  # heights of the eye above the terrain, in extents …
    limits: tuple[float, float]  # … limited in m
    fov: float
    horizon_at: float  # position of the horizon, in half heights above the picture's centre
    peak: tuple[float, float]  # best tangent of the highest skyline's elevation, and its width
    in_view: int  # neighbouring bearings in a picture
    clear: float  # least tangent of depression of near terrain, which otherwise occludes the rest
    near: float  # extents up to which terrain is near
    wall: float  # penalty of higher near terrain, per tangent
    inside: float  # weight of visible terrain being inside the sketch
    water: float  # apparent size of water that saturates its score


_STYLES: Final = {
    # Above the trees, but low enough that they are recognisable.
    "auto": _ViewStyle(
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
    "air": _ViewStyle(
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
    """Visibility around viewpoints: arrays (viewpoints, bearings).

    `share` is the tangent of the angle by which terrain at a distance rises above all nearer terrain.
    """

    horizon: Float64Array  # tangent of the skyline's elevation
    share: Float64Array  # (viewpoints, bearings, distances)
    layers: Float64Array  # number of ridges one behind the other
    water: Float64Array  # apparent size of the visible water
    flooded: Float64Array  # share of water in the visible terrain, by apparent size
    painted: Float64Array  # (types, viewpoints, bearings) visible share of painted features
    inside: Float64Array  # visible share inside the sketch

    def horizon_of(self, distances: BoolArray) -> Float64Array:
        """Return the tangent of the skyline's elevation of terrain at the nearest distances."""
        return np.asarray(self.share[..., distances].sum(axis=-1) - 1.0)


def find_view(terrain: TerrainSource, kind: str = "auto", *, weather: Weather | None = None) -> Camera:
    """Return the best-scoring camera over many viewpoints and bearings; deterministic.

    Kinds: ``ground`` eye level in the open; ``hill`` the same on a rise; ``air`` 250 to 700 m up; ``auto``
    above the trees, a hundredth of the extent up (20 to 190 m). The score combines relief, visible water,
    painted features, open foreground and, if the weather has an hour, light from the side.
    """
    check_view(kind)
    light = sun_preference(weather)
    if kind in ("ground", "hill"):
        return eye_level_view(terrain, light, raised=kind == "hill")
    style = _STYLES[kind]
    extent = terrain.extent
    west, south, east, north = visible_rectangle(terrain)
    relief = sample_heights(terrain, ((west + east) / 2, (south + north) / 2), 3.4 * extent, 576)
    along = (np.arange(VIEWPOINTS_PER_SIDE) + 0.5) / VIEWPOINTS_PER_SIDE
    if not isinstance(terrain, BoundedTerrain):  # a sketch is seen from a little outside, too
        along = along * 1.1 - 0.05
    rises = len(style.rises)
    x, y = np.tile(grid_positions(terrain, along), (rises, 1)).T
    rise = np.repeat(np.clip(np.array(style.rises) * extent, *style.limits), len(x) // rises)
    z = relief.at(x, y) + rise
    bearings = np.linspace(0.0, 2.0 * np.pi, BEARINGS, endpoint=False)
    distances = np.asarray(extent * np.geomspace(0.012, 1.6, DISTANCES), dtype=np.float64)
    seen = _compute_visibility(terrain, relief, np.stack([x, y, z], axis=1), bearings, distances)
    score = _score(seen, distances / extent, style) + light(bearings)
    viewpoint, bearing = np.unravel_index(int(np.argmax(score)), score.shape)
    eye_z = float(terrain.heights(x[viewpoint], y[viewpoint])) + float(rise[viewpoint])
    eye = (float(x[viewpoint]), float(y[viewpoint]), eye_z)
    skyline = neighbouring_bearings(seen.horizon, style.in_view)[:, viewpoint, bearing]
    angle = float(bearings[bearing])
    return aim(eye, angle, skyline, extent, fov=style.fov, horizon_at=style.horizon_at)


def check_view(kind: str) -> None:
    """Raise InputError for an unknown view kind."""
    if kind not in VIEWS:
        raise InputError(f"expected a view, one of {', '.join(VIEWS)}, got {kind!r}")


def _compute_visibility(
    terrain: TerrainSource,
    relief: HeightMap,
    eyes: Float64Array,
    bearings: Float64Array,
    distances: Float64Array,
) -> _Panorama:
    east, north = ray_positions(eyes, bearings, distances)
    slope = (relief.at(east, north) - eyes[:, 2, None, None]) / distances
    skyline = np.maximum.accumulate(slope, axis=-1)
    # Terrain steeper than 45° below the eye is outside any picture.
    below = np.concatenate([np.full_like(skyline[..., :1], -1.0), skyline[..., :-1]], axis=-1)
    share = np.maximum(slope - np.maximum(below, -1.0), 0.0)
    seen = share > 0.0
    far = distances > 0.06 * terrain.extent
    appears = np.diff(seen[..., far].astype(np.int8), axis=-1) > 0
    is_water = water_map(terrain, relief).at(east, north)
    size = seen * np.gradient(distances) / distances * np.clip(-slope, 0.0, 0.25)
    apparent = is_water * size * far
    flooded = (is_water * size).sum(axis=-1) / np.maximum(size.sum(axis=-1), 1e-9)
    middle = far & (distances < terrain.extent)
    visible = seen & middle
    count = np.maximum(visible.sum(axis=-1), 1.0)
    painted = [(mask.at(east, north) * visible).sum(axis=-1) / count for mask in _painted(terrain, relief)]
    inside = is_inside(terrain, east, north)
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
    """Return a mask of rivers and lakes on the texels of a map: 1 inside, 0 outside."""
    rivers, lakes = terrain.features.rivers, [lake.shape for lake in terrain.features.lakes]
    positions, widths = [river.centreline for river in rivers], [river.centreline_width for river in rivers]
    for lake in lakes:
        row, column = np.nonzero(lake.inside > 0)
        positions.append(np.stack([column, row], axis=-1) * lake.spacing + [lake.west, lake.south])
        widths.append(np.full(len(row), lake.spacing, np.float32))
    return relief.rasterized_mask(positions, widths)


def _painted(terrain: TerrainSource, relief: HeightMap) -> list[HeightMap]:
    """Return, for each type of point feature, a mask of the painted ones: 1 inside, 0 outside."""
    points = terrain.features.points
    points = points[points["painted"]]
    masks = []
    for code in range(TYPES):
        of_type = points[points["type"] == code]
        positions = np.stack([of_type["x"], of_type["y"]], axis=1)
        masks.append(relief.rasterized_mask([positions], [0.9 * of_type["radius"]]))
    return masks


def _score(seen: _Panorama, distance: Float64Array, style: _ViewStyle) -> Float64Array:
    """Return the score of each viewpoint and bearing; distances are in extents."""

    def mean(values: Float64Array, width: int = style.in_view) -> Float64Array:
        return np.asarray(neighbouring_bearings(values, width).mean(axis=0))

    horizon = neighbouring_bearings(seen.horizon, style.in_view)
    # Terrain that rises in front of the camera occludes the rest.
    near = neighbouring_bearings(seen.horizon_of(distance < style.near), style.in_view)
    wall = np.maximum(near + style.clear, 0.0).mean(axis=0)
    painted = np.stack([mean(share) for share in seen.painted])
    return np.asarray(
        2.2 * np.exp(-(((horizon.max(axis=0) - style.peak[0]) / style.peak[1]) ** 2))
        + 0.8 * np.tanh(horizon.std(axis=0) / 0.04)
        + 0.9 * np.tanh(mean(seen.share[..., (distance > 0.10) & (distance < 1.2)].sum(axis=-1)) / 0.15)
        + 1.0 * np.tanh(mean(seen.layers) / 3.0)
        + 2.4 * np.tanh(mean(seen.water, 7) / style.water)
        + np.tensordot(_TYPE_WEIGHTS, np.tanh(painted / 0.10), axes=1)
        + style.inside * np.tanh(mean(seen.inside) / 0.15)
        - style.wall * wall
        - 6.0 * np.maximum(mean(seen.flooded) - WATER_LIMIT, 0.0)  # a lake should not fill the picture
    )
