"""Viewpoints: places near the ground that give a good view."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter
from scipy.spatial import cKDTree

from sketchterrain.render.camera import Camera
from sketchterrain.render.scene import HeightMap, sample_heights, visible_rectangle
from sketchterrain.render.sunlight import sun_at

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from sketchterrain.array_types import BoolArray, Float64Array
    from sketchterrain.render.scene import TerrainSource
    from sketchterrain.render.sky import Weather

    Light = Callable[[Float64Array], Float64Array]
    """What the light adds to views along bearings (rad)."""

HIGHEST: Final = 0.80
"""Half heights above the picture's middle that no peak rises over."""
SIDE: Final = (75.0, 45.0)
"""Degrees between the view and the sun that model the ground best, and how far from it they still do."""
LIGHT_WORTH: Final = 1.4
BEHIND: Final = 140.0
"""Degrees from which on the sun stands behind the camera, and the light is flat …"""
FLAT: Final = 0.8
"""… and what that costs."""


def sun_preference(weather: Weather | None) -> Light:
    """Return the score that the sun adds to views, by bearing: 0 without a visible sun."""
    if weather is None or weather.hour is None:
        return np.zeros_like
    sun = sun_at(weather.hour, weather.latitude)
    # A sun overhead or behind clouds has no side.
    weight = np.cos(np.radians(max(sun.elevation, 0.0))) * (1.0 - weather.clouds**2)

    def light(bearings: Float64Array) -> Float64Array:
        off = np.abs((np.degrees(bearings) - sun.azimuth + 180.0) % 360.0 - 180.0)
        side = LIGHT_WORTH * np.exp(-(((off - SIDE[0]) / SIDE[1]) ** 2))
        flat = FLAT * np.clip((off - BEHIND) / (180.0 - BEHIND), 0.0, 1.0)
        return np.asarray(weight * (side - flat))

    return light


def window(values: Float64Array, width: int) -> Float64Array:
    """Stack the values of the `width` bearings around each bearing along a new first axis."""
    return np.stack([np.roll(values, shift, axis=1) for shift in range(-(width // 2), width // 2 + 1)])


def aim(
    eye: tuple[float, float, float],
    bearing: float,
    horizon: Float64Array,
    extent: float,
    *,
    fov: float,
    horizon_at: float,
) -> Camera:
    """Pitch a camera so that the skyline lies high and no peak leaves the picture."""
    half = np.tan(np.radians(fov) / 2.0)
    pitch = max(float(np.median(horizon)) - horizon_at * half, float(horizon.max()) - HIGHEST * half)
    ahead = 0.4 * extent
    target = (eye[0] + np.sin(bearing) * ahead, eye[1] + np.cos(bearing) * ahead, eye[2] + pitch * ahead)
    return Camera(
        eye, (float(target[0]), float(target[1]), float(target[2])), fov=fov, near=1.5, far=20.0 * extent
    )


MOST: Final = 220
"""Stands that are looked from."""
GRID: Final = 22
"""Stands along each side of the sketch, wherever they are …"""
RISES: Final = 40
"""… and for a rise, of which only the `TALL` highest over their surroundings are taken."""
TALL: Final = 130
SHORE: Final = (9.0, 30.0)
"""m from the water to those at its shores."""
SHORE_EVERY: Final = 1.0 / 50.0
"""Extents along a river between them."""
STEEPEST: Final = 0.3
AROUND: Final = 0.09
"""Extents: over how wide surroundings a rise rises."""
FOREST: Final = 3  # code of forests among the types of point features
WIDE: Final = 0.6  # rad to each side of a view in which plants are in the way
ROUND: Final = 5.0  # m around the eye in which they always are


class Cover:
    """Where water and forests are."""

    def __init__(self, terrain: TerrainSource, relief: HeightMap) -> None:
        features = terrain.features
        forests = features.points[features.points["type"] == FOREST]
        places = np.stack([forests["x"], forests["y"]], axis=1)
        self._woods = relief.rasterized_mask([places], [1.8 * forests["radius"].astype(np.float64)])
        lines = [np.asarray(river.centreline) for river in features.rivers]
        self._rivers = cKDTree(np.concatenate(lines)[:, :2]) if lines else None
        self._half = (
            np.concatenate([river.centreline_width for river in features.rivers]) / 2.0 if lines else None
        )
        self._lakes = [
            HeightMap(
                lake.shape.west - lake.shape.spacing / 2,
                lake.shape.south - lake.shape.spacing / 2,
                lake.shape.spacing * max(lake.shape.inside.shape),
                _squared(lake.shape.inside),
            )
            for lake in features.lakes
        ]

    def woods(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return 1 in forests, 0 elsewhere, at places (m)."""
        return self._woods.at(x, y)

    def wet(self, x: Float64Array, y: Float64Array) -> BoolArray:
        """Tell which places (m) are on a river or a lake."""
        return self.shore(x, y) <= 0.0

    def shore(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return about how far places are from water (m), up to 60; negative on it."""
        far = np.full(np.shape(x), 60.0)
        for lake in self._lakes:
            far = np.minimum(far, -lake.at(x, y))
        if self._rivers is not None and self._half is not None:
            places = np.stack([np.ravel(x), np.ravel(y)], axis=-1)
            bound = 60.0 + float(self._half.max())
            found = self._rivers.query(places, distance_upper_bound=bound)
            distance, nearest = np.asarray(found[0]), np.asarray(found[1])
            half = np.append(self._half, 0.0)[nearest]
            far = np.minimum(far, np.where(np.isfinite(distance), distance - half, 60.0).reshape(far.shape))
        return far


def find_viewpoints(terrain: TerrainSource, relief: HeightMap, cover: Cover, *, raised: bool) -> Float64Array:
    """Return places (n, 2) x, y (m) where one could stand, at least one."""
    west, south, east, north = visible_rectangle(terrain)
    side = RISES if raised else GRID
    along = (np.arange(side) + 0.5) / side
    grid = np.stack(
        [each.ravel() for each in np.meshgrid(west + along * (east - west), south + along * (north - south))],
        axis=-1,
    )
    if raised:
        places = grid[np.argsort(-topographic_position(terrain, relief, grid), kind="stable")]
    else:
        places = np.concatenate([_shores(terrain), grid])
    kept = places[_stands_well(terrain, cover, places)]
    if not len(kept):
        return np.array([[(west + east) / 2.0, (south + north) / 2.0]])
    if raised:
        return np.asarray(kept[:TALL])
    few = np.unique(np.linspace(0, len(kept) - 1, MOST).round().astype(int))
    return np.asarray(kept[few])


def topographic_position(terrain: TerrainSource, relief: HeightMap, places: Float64Array) -> Float64Array:
    """Return how high places (n, 2) lie over the mean of what surrounds them (m)."""
    texels = max(round(AROUND * terrain.extent / relief.texel), 3)
    mean = HeightMap(relief.west, relief.south, relief.width, uniform_filter(relief.heights, texels))
    return relief.at(*places.T) - mean.at(*places.T)


def unobstructed_distance(
    terrain: TerrainSource, eye: Float64Array, bearing: float, *, reach: float
) -> float:
    """Return how far ahead the nearest plant is in a view (m), `reach` at most; 0 for one around the eye."""
    x, y = float(eye[0]), float(eye[1])
    plants = terrain.foliage(x - reach, y - reach, x + reach, y + reach)
    east, north = plants["x"] - x, plants["y"] - y
    distance = np.hypot(east, north)
    off = np.abs((np.arctan2(east, north) - bearing + np.pi) % (2.0 * np.pi) - np.pi)
    if (distance < ROUND).any():
        return 0.0
    ahead = distance[off < WIDE]
    return float(min(ahead.min(initial=reach), reach))


def _shores(terrain: TerrainSource) -> Float64Array:
    """Return places beside rivers and lakes."""
    found = [np.zeros((0, 2))]
    for river in terrain.features.rivers:
        line = np.asarray(river.centreline)[:, :2]
        step = np.diff(line, axis=0)
        arc = np.concatenate([[0.0], np.cumsum(np.hypot(step[:, 0], step[:, 1]))])
        at = np.arange(0.0, arc[-1], SHORE_EVERY * terrain.extent)
        index = np.searchsorted(arc, at).clip(0, len(step) - 1)
        along = step[index] / np.maximum(np.hypot(*step[index].T), 1e-9)[:, None]
        aside = np.stack([-along[:, 1], along[:, 0]], axis=-1)
        half = river.centreline_width[index, None] / 2.0
        found += [line[index] + sign * (half + off) * aside for off in SHORE for sign in (-1.0, 1.0)]
    for lake in terrain.features.lakes:
        field = lake.shape
        row, column = np.nonzero(
            (field.inside < -SHORE[0]) & (field.inside > -SHORE[0] - 1.5 * field.spacing)
        )
        few = slice(None, None, max(len(row) // 60, 1))
        found.append(np.stack([column[few], row[few]], axis=-1) * field.spacing + [field.west, field.south])
    return np.concatenate(found)


def _stands_well(terrain: TerrainSource, cover: Cover, places: Float64Array) -> BoolArray:
    """Tell where one stands well."""
    x, y = places.T
    west, south, east, north = visible_rectangle(terrain)
    margin = 0.02 * terrain.extent
    here = (x > west + margin) & (x < east - margin) & (y > south + margin) & (y < north - margin)
    z = [terrain.heights(x + dx, y + dy) for dx, dy in ((0.0, 0.0), (4.0, 0.0), (0.0, 4.0))]
    even = np.hypot(z[1] - z[0], z[2] - z[0]) / 4.0 < STEEPEST
    return np.asarray(here & even & (cover.shore(x, y) > 3.0) & (cover.woods(x, y) < 0.5))


def _squared(field: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return a field as a square one; what is added lies as far outside as its farthest sample."""
    side = max(field.shape)
    result = np.full((side, side), float(field.min()), np.float32)
    result[: field.shape[0], : field.shape[1]] = field
    return result


EYE: Final = {False: 2.2, True: 4.0}
"""m above the ground, of one who stands there, and on a rise (of one who climbed a rock)."""
FOV: Final = {False: 44.0, True: 40.0}
BEARINGS: Final = 60
IN_VIEW: Final = 13
"""Neighbouring bearings that a picture shows, and a little more: 78°."""
DISTANCES: Final = 60
NEAREST: Final = 5.0
"""m to the nearest ground that is looked at."""
CELL: Final = 4.0
"""m of detail by which sight is judged."""
TREES: Final = 14.0
"""m that a forest stands in the way."""
NEAR: Final = 70.0
"""m up to which ground is foreground."""
RISE: Final = 0.012
"""Extents over its surroundings that make a good rise …"""
RISE_WORTH: Final = 2.5
"""… and what it is worth."""
HORIZON_AT: Final = 0.36
MOST_WATER: Final = 0.45
"""Share of the ground in a picture, by its apparent size, that may be water for nothing."""
HIGHEST_PEAK: Final = 0.32
"""Tangent of the elevation up to which a skyline fits into the picture."""
TRIED: Final = 40
"""Stands, the best first, at which trees are looked for."""
CLEAR: Final = 14.0
"""m before the eye that plants must leave free."""


class _Sight(NamedTuple):
    """What is seen all around, by stand and bearing."""

    horizon: Float64Array  # tangent of the skyline's elevation
    near: Float64Array  # the same of what is near
    middle: Float64Array  # share of the picture's height that ground between near and far takes
    layers: Float64Array  # ridges one behind the other
    water: Float64Array  # apparent size of the water
    flooded: Float64Array  # share of water in the ground that is seen
    woods: Float64Array  # share of what is seen that is forest
    inside: Float64Array  # share of the skyline's rise that lies in the sketch


def standing_view(terrain: TerrainSource, light: Light, *, raised: bool) -> Camera:
    """Choose a camera near the ground."""
    extent = terrain.extent
    west, south, east, north = visible_rectangle(terrain)
    relief = sample_heights(terrain, ((west + east) / 2, (south + north) / 2), 1.3 * extent, 640)
    cover = Cover(terrain, relief)
    stands = find_viewpoints(terrain, relief, cover, raised=raised)
    ground = terrain.heights(stands[:, 0], stands[:, 1]).astype(np.float64)
    eyes = np.column_stack([stands, ground + EYE[raised]])
    bearings = np.linspace(0.0, 2.0 * np.pi, BEARINGS, endpoint=False)
    sight = _look_around(terrain, cover, eyes, bearings)
    score = _score(sight, raised=raised) + light(bearings)
    if raised:
        over = topographic_position(terrain, relief, stands) / (RISE * extent)
        score += RISE_WORTH * np.tanh(over)[:, None]
    bearing = np.argmax(score, axis=1)
    best = score.max(axis=1)
    # Some stands are behind a tree: the best one that is not, or the one that sees farthest.
    farthest, chosen = -1.0, 0
    for stand in np.argsort(-best, kind="stable")[:TRIED].tolist():
        free = unobstructed_distance(terrain, eyes[stand], float(bearings[bearing[stand]]), reach=CLEAR)
        if free > farthest:
            farthest, chosen = free, stand
        if free >= CLEAR:
            break
    x, y, z = eyes[chosen].tolist()
    skyline = window(sight.horizon, IN_VIEW)[:, chosen, bearing[chosen]]
    angle = float(bearings[bearing[chosen]])
    return aim((x, y, z), angle, skyline, extent, fov=FOV[raised], horizon_at=HORIZON_AT)


def _look_around(terrain: TerrainSource, cover: Cover, eyes: Float64Array, bearings: Float64Array) -> _Sight:
    extent = terrain.extent
    distance = np.geomspace(NEAREST, 1.5 * extent, DISTANCES)
    east = eyes[:, 0, None, None] + np.sin(bearings)[None, :, None] * distance
    north = eyes[:, 1, None, None] + np.cos(bearings)[None, :, None] * distance
    ground = terrain.heights(east, north, cell_size=CELL).astype(np.float64)
    woods, wet = cover.woods(east, north), cover.wet(east, north)
    level = eyes[:, 2, None, None]
    slope = (ground + TREES * woods * (distance > 2.0 * TREES) - level) / distance
    skyline = np.maximum.accumulate(slope, axis=-1)
    below = np.concatenate([np.full_like(skyline[..., :1], -0.5), skyline[..., :-1]], axis=-1)
    share = np.maximum(slope - below, 0.0)
    seen = share > 0.0
    far = distance > 0.03 * extent
    middle = (distance > NEAR) & (distance < 0.25 * extent)
    appears = np.diff(seen[..., far].astype(np.int8), axis=-1) > 0
    size = seen * np.gradient(distance) / distance * np.clip(-slope, 0.0, 0.25)
    water = (wet * size)[..., distance < 0.4 * extent].sum(axis=-1)
    flooded = (wet * size).sum(axis=-1) / np.maximum(size.sum(axis=-1), 1e-9)
    west, south, *end = visible_rectangle(terrain)
    inside = (east > west) & (east < end[0]) & (north > south) & (north < end[1])
    count = np.maximum(seen.sum(axis=-1), 1.0)
    return _Sight(
        skyline[..., -1],
        np.max(slope[..., distance < NEAR], axis=-1),
        share[..., middle].sum(axis=-1),
        appears.sum(axis=-1).astype(np.float64),
        water,
        flooded,
        (woods * seen * (distance > NEAR)).sum(axis=-1) / count,
        (inside * share)[..., far].sum(axis=-1),
    )


def _score(sight: _Sight, *, raised: bool) -> Float64Array:
    """Rate each stand and bearing."""
    horizon = window(sight.horizon, IN_VIEW)
    peak = horizon.max(axis=0)
    wall = np.maximum(window(sight.near, IN_VIEW) - (-0.05 if raised else 0.0), 0.0).mean(axis=0)
    best, width = (0.08, 0.10) if raised else (0.16, 0.10)
    return np.asarray(
        2.2 * np.exp(-(((peak - best) / width) ** 2))
        + 0.8 * np.tanh(horizon.std(axis=0) / 0.04)
        + 1.0 * np.tanh(window(sight.layers, IN_VIEW).mean(axis=0) / 3.0)
        + 1.2 * np.tanh(window(sight.middle, IN_VIEW).mean(axis=0) / (0.08 if raised else 0.03))
        + 2.6 * np.tanh(window(sight.water, 7).mean(axis=0) / 0.02)
        + 0.8 * np.tanh(window(sight.woods, IN_VIEW).mean(axis=0) / 0.10)
        + 0.8 * np.tanh(window(sight.inside, IN_VIEW).mean(axis=0) / 0.10)
        - 12.0 * wall
        # Ground that rises far over the picture's upper border is a wall, too.
        - 6.0 * np.maximum(peak - HIGHEST_PEAK, 0.0)
        - 4.0 * np.maximum(window(sight.flooded, IN_VIEW).mean(axis=0) - MOST_WATER, 0.0)
    )
