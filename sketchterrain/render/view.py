"""Choose a camera that shows a terrain: water or relief as the subject, ground before it, a high horizon."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sketchterrain.render.camera import Camera
from sketchterrain.render.relief import sample_heights

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.render.relief import HeightMap
    from sketchterrain.render.scene import Terrain

    Floats = npt.NDArray[np.float64]

__all__ = ["find_view", "water_map"]

FOV: Final = 36.0
STANDS: Final = 14
"""Candidate stands along each side of the sketch."""
RISES: Final = (0.010, 0.022, 0.038, 0.032)
"""Heights of the eye above the ground, in extents."""
RISE_LIMITS: Final = (20.0, 190.0)
"""m; over the trees, and not so high that they look like moss."""
BEARINGS: Final = 60
IN_VIEW: Final = 9
"""Neighbouring bearings that a picture shows: 54°."""
DISTANCES: Final = 56
MOST_WATER: Final = 0.15
"""Share of the ground in a picture, by its apparent size, that may be water for nothing."""
TYPES: Final = 4
"""Of point features: mountain, hill, dune, forest."""
_TYPE_WEIGHTS: Final = np.array([1.0, 1.0, 2.2, 1.0])
"""How much each type of point feature adds to a view; what lies flat needs more weight to be seen at all."""
HORIZON_AT: Final = 0.34
"""Where the horizon should lie, in half heights above the picture's middle."""


class _Panorama(NamedTuple):
    """What is seen all around from many stands, by stand, bearing and distance.

    A share is the tangent of the angle by which ground at a distance rises over all that is nearer.
    """

    horizon: Floats  # (stands, bearings) tangent of the skyline's elevation
    share: Floats  # (stands, bearings, distances)
    layers: Floats  # (stands, bearings) ridges one behind the other
    water: Floats  # (stands, bearings) apparent size of the visible water
    flooded: Floats  # (stands, bearings) share of the visible ground, by its apparent size, that is water
    painted: Floats  # (types, stands, bearings) share of what is seen that was painted so
    inside: Floats  # (stands, bearings) share of what is seen that lies in the sketch

    def horizon_of(self, distances: npt.NDArray[np.bool_]) -> Floats:
        """Return the tangent of the skyline's elevation that ground at the nearest distances makes."""
        return np.asarray(self.share[..., distances].sum(axis=-1) - 1.0)


def find_view(terrain: Terrain) -> Camera:
    """Choose a camera that shows a terrain. The same terrain always gives the same camera.

    Looks around from a regular grid of stands over coarse heights, and takes the stand and bearing with the
    best mix of relief, visible water, painted features and open foreground.
    """
    extent = terrain.extent
    size = np.asarray(terrain.size, dtype=np.float64)
    relief = sample_heights(terrain, (size[0] / 2, size[1] / 2), 3.4 * extent, 576)
    along = (np.arange(STANDS) + 0.5) / STANDS * 1.1 - 0.05
    x, y = (grid.ravel() for grid in np.meshgrid(along * size[0], along * size[1]))
    x, y = np.tile(x, len(RISES)), np.tile(y, len(RISES))
    rise = np.repeat(np.clip(np.array(RISES) * extent, *RISE_LIMITS), len(x) // len(RISES))
    z = relief.at(x, y) + rise
    bearings = np.linspace(0.0, 2.0 * np.pi, BEARINGS, endpoint=False)
    distances = np.asarray(extent * np.geomspace(0.012, 1.6, DISTANCES), dtype=np.float64)
    seen = _look_around(terrain, relief, np.stack([x, y, z], axis=1), bearings, distances)
    score = _score(seen, distances / extent)
    stand, bearing = np.unravel_index(int(np.argmax(score)), score.shape)
    eye_z = float(terrain.heights(x[stand], y[stand])) + float(rise[stand])
    place = (float(x[stand]), float(y[stand]), eye_z)
    return _aim(place, float(bearings[bearing]), _window(seen.horizon, IN_VIEW)[:, stand, bearing], extent)


def _look_around(
    terrain: Terrain, relief: HeightMap, eyes: Floats, bearings: Floats, distances: Floats
) -> _Panorama:
    east = eyes[:, 0, None, None] + np.sin(bearings)[None, :, None] * distances
    north = eyes[:, 1, None, None] + np.cos(bearings)[None, :, None] * distances
    slope = (relief.at(east, north) - eyes[:, 2, None, None]) / distances
    skyline = np.maximum.accumulate(slope, axis=-1)
    below = np.concatenate([np.full_like(skyline[..., :1], -1.0), skyline[..., :-1]], axis=-1)
    share = np.maximum(slope - below, 0.0)
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
    inside = (east > 0) & (east < terrain.size[0]) & (north > 0) & (north < terrain.size[1])
    return _Panorama(
        skyline[..., -1],
        share,
        appears.sum(axis=-1).astype(np.float64),
        apparent.sum(axis=-1),
        flooded,
        np.stack(painted),
        (inside * share * middle).sum(axis=-1),
    )


def water_map(terrain: Terrain, relief: HeightMap) -> HeightMap:
    """Return where rivers and lakes are, on the texels of a map: 1 there, 0 elsewhere."""
    rivers, lakes = terrain.features.rivers, [lake.shape for lake in terrain.features.lakes]
    places, widths = [river.centreline for river in rivers], [river.centreline_width for river in rivers]
    for lake in lakes:
        row, column = np.nonzero(lake.inside > 0)
        places.append(np.stack([column, row], axis=-1) * lake.spacing + [lake.west, lake.south])
        widths.append(np.full(len(row), lake.spacing, np.float32))
    return relief.marks_at(places, widths)


def _painted(terrain: Terrain, relief: HeightMap) -> list[HeightMap]:
    """Draw, for each type of point feature, where painted ones are: 1 there, 0 elsewhere."""
    points = terrain.features.points
    points = points[points["painted"]]
    masks = []
    for code in range(TYPES):
        of_type = points[points["type"] == code]
        places = np.stack([of_type["x"], of_type["y"]], axis=1)
        masks.append(relief.marks_at([places], [0.9 * of_type["radius"]]))
    return masks


def _window(values: Floats, width: int) -> Floats:
    """Stack the values of the `width` bearings around each bearing along a new first axis."""
    return np.stack([np.roll(values, shift, axis=1) for shift in range(-(width // 2), width // 2 + 1)])


def _score(seen: _Panorama, distance: Floats) -> Floats:
    """Rate each stand and bearing; distances are in extents."""
    horizon = _window(seen.horizon, IN_VIEW)
    peak = horizon.max(axis=0)
    middle = _window(seen.share[..., (distance > 0.10) & (distance < 1.2)].sum(axis=-1), IN_VIEW)
    # Ground that rises before the camera hides the rest.
    near = _window(seen.horizon_of(distance < 0.10), IN_VIEW)
    wall = np.maximum(near + 0.06, 0.0).mean(axis=0)
    painted = np.stack([_window(share, IN_VIEW).mean(axis=0) for share in seen.painted])
    return np.asarray(
        2.2 * np.exp(-(((peak - 0.18) / 0.10) ** 2))
        + 0.8 * np.tanh(horizon.std(axis=0) / 0.04)
        + 0.9 * np.tanh(middle.mean(axis=0) / 0.15)
        + 1.0 * np.tanh(_window(seen.layers, IN_VIEW).mean(axis=0) / 3.0)
        + 2.4 * np.tanh(_window(seen.water, 7).mean(axis=0) / 0.012)
        + np.tensordot(_TYPE_WEIGHTS, np.tanh(painted / 0.10), axes=1)
        + 0.8 * np.tanh(_window(seen.inside, IN_VIEW).mean(axis=0) / 0.15)
        - 14.0 * wall
        # A lake is a subject, but not all there is to see.
        - 6.0 * np.maximum(_window(seen.flooded, IN_VIEW).mean(axis=0) - MOST_WATER, 0.0)
    )


def _aim(eye: tuple[float, float, float], bearing: float, horizon: Floats, extent: float) -> Camera:
    """Pitch the camera so that the skyline lies in the upper third and no peak leaves the picture."""
    half = np.tan(np.radians(FOV) / 2.0)
    pitch = max(float(np.median(horizon)) - HORIZON_AT * half, float(horizon.max()) - 0.80 * half)
    ahead = 0.4 * extent
    target = (eye[0] + np.sin(bearing) * ahead, eye[1] + np.cos(bearing) * ahead, eye[2] + pitch * ahead)
    return Camera(
        eye, (float(target[0]), float(target[1]), float(target[2])), fov=FOV, near=1.5, far=20.0 * extent
    )
