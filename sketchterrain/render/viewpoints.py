"""Viewpoints at eye level: candidates, visibility, scores; aiming of cameras."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.ndimage import maximum_filter, uniform_filter
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Float64Array
from sketchterrain.geometry.camera import Camera
from sketchterrain.landforms.placement.feature_types import FEATURE_TYPES, Lake, River
from sketchterrain.look.tree_species import HEIGHTS
from sketchterrain.render.scene import (
    HeightMap,
    TerrainSource,
    sample_heights,
    surface_heights,
    visible_rectangle,
)
from sketchterrain.render.sky import Weather, sun_at

if TYPE_CHECKING:
    from sketchterrain.landforms.placement.plateaus import Plateau

    LightScore = Callable[[Float64Array], Float64Array]
    """Score of views by bearing (rad)."""

HIGHEST: Final = 0.80  # upper limit of peaks, in half heights above the picture's centre
SIDE: Final = (75.0, 45.0)  # best angle between view and sun for relief shading, and its width (degrees)
SIDE_WEIGHT: Final = 1.4
BEHIND: Final = 140.0  # degrees above which the sun is behind the camera and the light flat …
FLAT_PENALTY: Final = 0.8  # … with this penalty


def sun_preference(weather: Weather | None) -> LightScore:
    """Return the score that the sun adds to views, by bearing: 0 without a visible sun."""
    if weather is None or weather.hour is None:
        return np.zeros_like
    sun = sun_at(weather.hour, weather.latitude)
    # A sun overhead or behind clouds gives no light from the side.
    weight = np.cos(np.radians(max(sun.elevation, 0.0))) * (1.0 - weather.cover**2)

    def light(bearings: Float64Array) -> Float64Array:
        off = np.abs((np.degrees(bearings) - sun.azimuth + 180.0) % 360.0 - 180.0)
        side = SIDE_WEIGHT * np.exp(-(((off - SIDE[0]) / SIDE[1]) ** 2))
        flat = FLAT_PENALTY * np.clip((off - BEHIND) / (180.0 - BEHIND), 0.0, 1.0)
        return np.asarray(weight * (side - flat))

    return light


def neighbouring_bearings(values: Float64Array, width: int) -> Float64Array:
    """Return the values of the `width` bearings around each bearing, stacked along a new first axis."""
    return np.stack([np.roll(values, shift, axis=-1) for shift in range(-(width // 2), width // 2 + 1)])


def grid_positions(terrain: TerrainSource, along: Float64Array) -> Float64Array:
    """Return positions (n, 2; m) of a grid at fractions `along` of the visible rectangle."""
    west, south, east, north = visible_rectangle(terrain)
    x, y = np.meshgrid(west + along * (east - west), south + along * (north - south))
    return np.column_stack([x.ravel(), y.ravel()])


def ray_positions(
    eyes: Float64Array, bearings: Float64Array, distances: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Return x and y (eyes, bearings, distances; m) along rays from eyes (n, 3)."""
    east = eyes[:, 0, None, None] + np.sin(bearings)[None, :, None] * distances
    return east, eyes[:, 1, None, None] + np.cos(bearings)[None, :, None] * distances


def is_inside(terrain: TerrainSource, x: Float64Array, y: Float64Array, *, margin: float = 0.0) -> BoolArray:
    """Return whether positions are inside the visible rectangle, less a margin (m)."""
    west, south, east, north = visible_rectangle(terrain)
    return np.asarray((x > west + margin) & (x < east - margin) & (y > south + margin) & (y < north - margin))


def aim(
    eye: tuple[float, float, float],
    bearing: float,
    horizon: Float64Array,
    extent: float,
    *,
    fov: float,
    horizon_at: float,
) -> Camera:
    """Return a camera pitched so that the skyline is at `horizon_at` and no peak leaves the picture.

    `horizon` has tangents of the skyline's elevation across the picture; `bearing` is in rad.
    """
    half = np.tan(np.radians(fov) / 2.0)
    pitch = max(float(np.median(horizon)) - horizon_at * half, float(horizon.max()) - HIGHEST * half)
    ahead = 0.4 * extent
    target = (eye[0] + np.sin(bearing) * ahead, eye[1] + np.cos(bearing) * ahead, eye[2] + pitch * ahead)
    return Camera(
        eye, (float(target[0]), float(target[1]), float(target[2])), fov=fov, near=1.5, far=20.0 * extent
    )


def painted_sums(
    terrain: TerrainSource, relief: HeightMap, east: Float64Array, north: Float64Array, size: Float64Array
) -> Float64Array:
    """Return sizes of samples along rays, summed by kind of painted feature (kinds, viewpoints, bearings)."""
    features = terrain.features
    points = features.points[features.points["painted"]]
    by_type = [points[points["type"] == code] for code in range(len(FEATURE_TYPES))]
    masks = [
        *(relief.rasterized_mask([np.stack([p["x"], p["y"]], axis=1)], [0.9 * p["radius"]]) for p in by_type),
        shape_mask(relief, features.plateaus),
        shape_mask(relief, features.lakes, [river for river in features.rivers if river.label]),
    ]
    cells = ((east - relief.west) / relief.texel, (north - relief.south) / relief.texel)
    column, row = (np.clip(cell, 0, len(relief.heights) - 1).astype(np.intp) for cell in cells)
    # One lookup for all kinds: a bit of each.
    bits = np.packbits([mask.heights > 0.0 for mask in masks], axis=0, bitorder="little")[0][row, column]
    return np.stack([(size * (bits >> kind & 1)).sum(axis=-1) for kind in range(len(masks))])


def shape_mask(relief: HeightMap, areas: Iterable[Lake | Plateau], rivers: Iterable[River] = ()) -> HeightMap:
    """Return a mask of areas and rivers on the texels of a map: 1 inside, 0 outside."""
    positions, widths = [river.centreline for river in rivers], [river.centreline_width for river in rivers]
    for shape in (area.shape for area in areas):
        row, column = np.nonzero(shape.inside > 0)
        positions.append(np.stack([column, row], axis=-1) * shape.spacing + [shape.west, shape.south])
        widths.append(np.full(len(row), shape.spacing, np.float32))
    return relief.rasterized_mask(positions, widths)


MAX_VIEWPOINTS: Final = 220
GRID: Final = 22  # candidates along each side of the sketch …
RISES: Final = 40  # … and for rises: the `TALL` highest of those that no neighbour overlooks
TALL: Final = 130
SHORE: Final = (9.0, 30.0)  # distances (m) of shore viewpoints from the water
SHORE_EVERY: Final = 1.0 / 50.0  # extents between them along a river
BEACH: Final = 0.1  # slope that distances from the sea are guessed by
SEA_SHORES: Final = 200  # positions beside the sea
STEEPEST: Final = 0.3
AROUND: Final = 0.09  # window of the topographic position, in extents
FOREST: Final = 3  # type code of forests
OBSTRUCTION_ANGLE: Final = 0.62  # rad to each side of the view in which crowns obstruct it
CROWN: Final = 0.47  # radius of the widest crowns, in heights
OBSTRUCTION_RADIUS: Final = 5.0  # m around the eye in which any plant does


class LandCover:
    """Distance to water, and `woods`: 1 in forests, 0 elsewhere."""

    def __init__(self, terrain: TerrainSource, relief: HeightMap) -> None:
        features, self.relief, self._sea_level = terrain.features, relief, terrain.sea_level
        forests = features.points[features.points["type"] == FOREST]
        positions = np.stack([forests["x"], forests["y"]], axis=1)
        self.woods = relief.rasterized_mask([positions], [1.8 * forests["radius"].astype(np.float64)])
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
                _padded_square(lake.shape.inside),
            )
            for lake in features.lakes
        ]

    def distance_to_water(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return the approximate distance (m) of positions to water, at most 60; negative inside."""
        far = np.full(np.shape(x), 60.0)
        for lake in self._lakes:
            far = np.minimum(far, -lake.at(x, y))
        if self._sea_level is not None:
            far = np.minimum(far, (self.relief.at(x, y) - self._sea_level) / BEACH)
        if self._rivers is not None and self._half is not None:
            positions = np.stack([np.ravel(x), np.ravel(y)], axis=-1)
            bound = 60.0 + float(self._half.max())
            distance, nearest = map(np.asarray, self._rivers.query(positions, distance_upper_bound=bound))
            half = np.append(self._half, 0.0)[nearest]
            far = np.minimum(far, np.where(np.isfinite(distance), distance - half, 60.0).reshape(far.shape))
        return far


def find_viewpoints(
    terrain: TerrainSource, relief: HeightMap, cover: LandCover, *, raised: bool
) -> Float64Array:
    """Return viewpoints (n, 2; m), n ≥ 1: rises only, or a grid and shores."""
    side = RISES if raised else GRID
    grid = grid_positions(terrain, (np.arange(side) + 0.5) / side)
    positions = grid if raised else np.concatenate([_shore_positions(terrain, relief), grid])
    suitable = _is_suitable(terrain, cover, positions)
    if not suitable.any():
        west, south, east, north = visible_rectangle(terrain)
        return np.array([[(west + east) / 2.0, (south + north) / 2.0]])
    if raised:
        rise = np.where(suitable, topographic_position(terrain, relief, grid), -np.inf)
        highest = maximum_filter(rise.reshape(side, side), 3).ravel()
        order = np.lexsort((-rise, ~suitable | (rise < highest)))
        return np.asarray(grid[order[: min(TALL, int(suitable.sum()))]])
    positions = positions[suitable]
    picked = np.unique(np.linspace(0, len(positions) - 1, MAX_VIEWPOINTS).round().astype(int))
    return np.asarray(positions[picked])


def topographic_position(terrain: TerrainSource, relief: HeightMap, positions: Float64Array) -> Float64Array:
    """Return the topographic position index (m) of positions (n, 2): height above the local mean."""
    texels = max(round(AROUND * terrain.extent / relief.texel), 3)
    mean = HeightMap(relief.west, relief.south, relief.width, uniform_filter(relief.heights, texels))
    return relief.at(*positions.T) - mean.at(*positions.T)


def unobstructed_distance(
    terrain: TerrainSource, eye: Float64Array, bearing: float, *, max_distance: float
) -> float:
    """Return the distance (m) to the nearest plant in view, up to `max_distance`; 0 for one at the eye."""
    x, y = float(eye[0]), float(eye[1])
    plants = terrain.foliage(x - max_distance, y - max_distance, x + max_distance, y + max_distance)
    east, north = plants["x"] - x, plants["y"] - y
    distance = np.hypot(east, north)
    off = np.abs((np.arctan2(east, north) - bearing + np.pi) % (2.0 * np.pi) - np.pi)
    if (distance < OBSTRUCTION_RADIUS).any():
        return 0.0
    crown = CROWN * np.array(HEIGHTS)[plants["species"]] * plants["scale"]
    ahead = distance[off < OBSTRUCTION_ANGLE + np.arctan2(crown, distance)]
    return float(min(ahead.min(initial=max_distance), max_distance))


def _shore_positions(terrain: TerrainSource, relief: HeightMap) -> Float64Array:
    """Return positions beside rivers, lakes and the sea."""
    positions = [np.zeros((0, 2))]
    for river in terrain.features.rivers:
        line = np.asarray(river.centreline)[:, :2]
        step = np.diff(line, axis=0)
        arc = np.concatenate([[0.0], np.cumsum(np.hypot(step[:, 0], step[:, 1]))])
        at = np.arange(0.0, arc[-1], SHORE_EVERY * terrain.extent)
        index = np.searchsorted(arc, at).clip(0, len(step) - 1)
        along = step[index] / np.maximum(np.hypot(*step[index].T), 1e-9)[:, None]
        sideways = np.stack([-along[:, 1], along[:, 0]], axis=-1)
        half = river.centreline_width[index, None] / 2.0
        positions += [line[index] + sign * (half + off) * sideways for off in SHORE for sign in (-1.0, 1.0)]
    for lake in terrain.features.lakes:
        field = lake.shape
        row, column = np.nonzero(
            (field.inside < -SHORE[0]) & (field.inside > -SHORE[0] - 1.5 * field.spacing)
        )
        picked = slice(None, None, max(len(row) // 60, 1))
        positions.append(
            np.stack([column[picked], row[picked]], axis=-1) * field.spacing + [field.west, field.south]
        )
    level = terrain.sea_level
    if level is not None:
        above = (relief.heights - level) / BEACH
        row, column = np.nonzero((above > SHORE[0]) & (above < SHORE[1]))
        place = np.stack([column, row], axis=-1)[:: max(len(row) // SEA_SHORES, 1)] + 0.5
        positions.append(place * relief.texel + [relief.west, relief.south])
    return np.concatenate(positions)


def _is_suitable(terrain: TerrainSource, cover: LandCover, positions: Float64Array) -> BoolArray:
    """Return whether positions are inside the sketch, level, dry and outside forests."""
    x, y = positions.T
    inside = is_inside(terrain, x, y, margin=0.02 * terrain.extent)
    z = [terrain.heights(x + dx, y + dy) for dx, dy in ((0.0, 0.0), (4.0, 0.0), (0.0, 4.0))]
    is_level = np.hypot(z[1] - z[0], z[2] - z[0]) / 4.0 < STEEPEST
    return np.asarray(
        inside & is_level & (cover.distance_to_water(x, y) > 3.0) & (cover.woods.at(x, y) < 0.5)
    )


def _padded_square(field: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return a distance raster padded to a square with its lowest value."""
    side = max(field.shape)
    result = np.full((side, side), float(field.min()), np.float32)
    result[: field.shape[0], : field.shape[1]] = field
    return result


EYE: Final = {False: 2.2, True: 4.0}  # eye height (m) on level terrain, and on a rise
FOV: Final = {False: 44.0, True: 40.0}
BEARINGS: Final = 60
IN_VIEW: Final = 13  # neighbouring bearings in a picture, with a margin: 78°
DISTANCES: Final = 60
NEAREST: Final = 5.0  # m to the nearest sampled terrain
CELL: Final = 4.0  # cell size (m) of the sampled heights
TREES: Final = 14.0  # height (m) of forests as occluders
PAINTED_FROM: Final = 0.12
"""Distance from which painted land counts, in extents: not the slope that the eye is on."""
NEAR: Final = 70.0  # m up to which terrain is foreground
RISE: Final = 0.012  # topographic position of a good rise, in extents …
RISE_WEIGHT: Final = 1.5  # … and its weight in the score
HORIZON_AT: Final = 0.36
WATER_LIMIT: Final = 0.45
"""Share of water in the visible terrain, by apparent size, above which it is penalised."""
HIGHEST_PEAK: Final = 0.32  # largest tangent of elevation of a skyline that fits into the picture
MAX_TESTED: Final = 40  # best viewpoints that are tested for plants in front of the eye
CLEAR: Final = 20.0  # m in front of the eye that must be free of plants
ASIDE: Final = {False: [0.0], True: [0.0, 15.0, -15.0, 30.0, -30.0]}  # m to the right of a viewpoint, tried


class Visibility(NamedTuple):
    """Visibility around viewpoints: arrays (viewpoints, bearings)."""

    horizon: Float64Array  # tangent of the skyline's elevation
    near: Float64Array  # the same of near terrain
    middle: Float64Array  # tangent covered by terrain between near and far
    layers: Float64Array  # number of ridges one behind the other
    water: Float64Array  # apparent size of the visible water
    flooded: Float64Array  # share of water in the visible terrain, by apparent size
    painted: Float64Array  # (kinds, viewpoints, bearings) apparent size of painted features
    inside: Float64Array  # visible share inside the sketch


def eye_level_view(terrain: TerrainSource, light: LightScore, *, raised: bool) -> Camera:
    """Return the best camera at eye level, or on a rise."""
    extent = terrain.extent
    west, south, east, north = visible_rectangle(terrain)
    relief = sample_heights(terrain, ((west + east) / 2, (south + north) / 2), 1.3 * extent, 640)
    cover = LandCover(terrain, relief)
    viewpoints = find_viewpoints(terrain, relief, cover, raised=raised)
    ground = surface_heights(terrain, viewpoints[:, 0], viewpoints[:, 1]).astype(np.float64)
    eyes = np.column_stack([viewpoints, ground + EYE[raised]])
    bearings = np.linspace(0.0, 2.0 * np.pi, BEARINGS, endpoint=False)
    visibility = _compute_visibility(terrain, cover, eyes, bearings)
    score = _score(visibility, raised=raised) + light(bearings)
    if raised:
        rise = topographic_position(terrain, relief, viewpoints) / (RISE * extent)
        score += RISE_WEIGHT * np.tanh(rise)[:, None]
    bearing = np.argmax(score, axis=1)
    best = score.max(axis=1)
    # Take the best viewpoint without plants in front of the eye, on a rise aside if need be, or the least
    # obstructed one.
    longest, best_viewpoint, eye = -1.0, 0, eyes[0]
    for viewpoint in np.argsort(-best, kind="stable")[:MAX_TESTED].tolist():
        angle = float(bearings[bearing[viewpoint]])
        for step in ASIDE[raised]:
            place = eyes[viewpoint] + step * np.array([np.cos(angle), -np.sin(angle), 0.0])
            if step:
                if not _is_suitable(terrain, cover, place[None, :2]).all():
                    continue
                place[2] = float(surface_heights(terrain, place[:1], place[1:2])[0]) + EYE[raised]
            distance = unobstructed_distance(terrain, place, angle, max_distance=CLEAR)
            if distance > longest:
                longest, best_viewpoint, eye = distance, viewpoint, place
            if distance >= CLEAR:
                break
        if longest >= CLEAR:
            break
    x, y, z = eye.tolist()
    skyline = neighbouring_bearings(visibility.horizon, IN_VIEW)[:, best_viewpoint, bearing[best_viewpoint]]
    angle = float(bearings[bearing[best_viewpoint]])
    return aim((x, y, z), angle, skyline, extent, fov=FOV[raised], horizon_at=HORIZON_AT)


def _compute_visibility(
    terrain: TerrainSource, cover: LandCover, eyes: Float64Array, bearings: Float64Array
) -> Visibility:
    extent = terrain.extent
    distance = np.geomspace(NEAREST, 1.5 * extent, DISTANCES)
    east, north = ray_positions(eyes, bearings, distance)
    ground = surface_heights(terrain, east, north, cell_size=CELL).astype(np.float64)
    woods, is_water = cover.woods.at(east, north), cover.distance_to_water(east, north) <= 0.0
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
    water = (is_water * size)[..., distance < 0.4 * extent].sum(axis=-1)
    flooded = (is_water * size).sum(axis=-1) / np.maximum(size.sum(axis=-1), 1e-9)
    inside = is_inside(terrain, east, north)
    return Visibility(
        skyline[..., -1],
        np.max(slope[..., distance < max(NEAR, 0.02 * extent)], axis=-1),
        share[..., middle].sum(axis=-1),
        appears.sum(axis=-1).astype(np.float64),
        water,
        flooded,
        painted_sums(
            terrain, cover.relief, east, north, share * (is_water | (distance > PAINTED_FROM * extent))
        ),
        (inside * share)[..., far].sum(axis=-1),
    )


def _score(visibility: Visibility, *, raised: bool) -> Float64Array:
    """Return the score of each viewpoint and bearing."""

    def mean(values: Float64Array, width: int = IN_VIEW) -> Float64Array:
        return np.asarray(neighbouring_bearings(values, width).mean(axis=0))

    horizon = neighbouring_bearings(visibility.horizon, IN_VIEW)
    peak = horizon.max(axis=0)
    near = neighbouring_bearings(visibility.near, IN_VIEW)
    wall = np.maximum(near - (-0.05 if raised else 0.0), 0.0).mean(axis=0)
    best, width = (0.08, 0.10) if raised else (0.16, 0.10)
    return np.asarray(
        2.2 * np.exp(-(((peak - best) / width) ** 2))
        + 0.8 * np.tanh(horizon.std(axis=0) / 0.04)
        + 1.0 * np.tanh(mean(visibility.layers) / 3.0)
        + 1.2 * np.tanh(mean(visibility.middle) / (0.08 if raised else 0.03))
        + 2.6 * np.tanh(mean(visibility.water, 7) / 0.02)
        + 2.0 * np.tanh(mean(visibility.painted, 9) / 0.03).sum(axis=0)
        + 0.8 * np.tanh(mean(visibility.inside) / 0.10)
        - 12.0 * wall
        - 6.0 * np.maximum(peak - HIGHEST_PEAK, 0.0)  # a skyline above the upper border is a wall, too
        - 4.0 * np.maximum(mean(visibility.flooded) - WATER_LIMIT, 0.0)
    )
