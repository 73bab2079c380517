"""A camera at the height of someone's eyes: in the open or on a rise, with nothing in the way."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sketchterrain.render.relief import sample_heights
from sketchterrain.render.scene import visible_rectangle
from sketchterrain.render.stands import Cover, find_viewpoints, topographic_position, unobstructed_distance
from sketchterrain.render.view_aim import aim, window

if TYPE_CHECKING:
    from sketchterrain.array_types import Float64Array
    from sketchterrain.render.camera import Camera
    from sketchterrain.render.scene import TerrainSource
    from sketchterrain.render.view_aim import Light


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
