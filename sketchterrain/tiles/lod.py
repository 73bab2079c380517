"""Level of detail: camera view, error metrics, horizon culling, geomorphing.

Horizon culling is conservative: terrain is nowhere lower than its tile's box, so in all bearings that lie
wholly within a tile, everything farther away and below the line over the box's bottom is hidden.

Morph weights, as in kernels/render/ground.vert.glsl: nine controls lie at a tile's corners, the middles of
its borders and its centre. Tiles of one level share those where they touch. A weight changes from a border's
control to the centre's within a quarter of the tile; so a border depends only on its own controls, and both
tiles along it compute the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.errors import InputError
from sketchterrain.host.library import host_function
from sketchterrain.tiles.quadtree import Boxes


@dataclass(frozen=True, eq=False)
class CameraView:
    """Camera of the tile selection."""

    eye: tuple[float, float, float]  # x, y, z, m
    planes: Float64Array  # (k, 4) a·x + b·y + c·z + d ≥ 0 is inside; unit normals, world coordinates
    pixels_per_radian: float  # at the image centre: height / (2 tan(fov / 2))
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m/s; tiles are fetched ahead of it
    draw_distance: float = np.inf  # horizontal, m

    def extrapolated(self, seconds: float) -> CameraView:
        """Return the view after some seconds of the same motion."""
        motion = np.asarray(self.velocity) * seconds
        planes = self.planes.copy()
        planes[:, 3] -= planes[:, :3] @ motion
        x, y, z = (np.asarray(self.eye) + motion).tolist()
        return replace(self, eye=(x, y, z), planes=planes)

    def sees(self, boxes: Boxes, *, margin: Float64Array | float = 0.0) -> npt.NDArray[np.bool_]:
        """Return which boxes, enlarged by `margin` (m), may be visible; shape (n,)."""
        more = np.broadcast_to(margin, len(boxes.low))[:, None]
        return inside_frustum(self.planes, boxes.low - more, boxes.high + more)


def inside_frustum(planes: Float64Array, low: Float64Array, high: Float64Array) -> npt.NDArray[np.bool_]:
    """Return which boxes (corners `low`, `high` (n, 3), m) are not wholly outside one of the planes (k, 4).

    Conservative: may be true for a box just outside an edge of the frustum, never false for a visible one.
    """
    inside = np.ones(len(low), dtype=np.bool_)
    for plane in planes:
        farthest = np.where(plane[:3] >= 0, high, low)
        inside &= farthest @ plane[:3] + plane[3] >= 0
    return inside


_NEAREST: Final = 0.5
"""Least distance, m."""
_LARGEST: Final = 2.0  # px of silhouettes, estimated and at most 3 by measurement, through any air ...
FAINT: Final = 0.05  # ... unless less of its contrast than this is left: it is hardly seen
_FADE: Final = (0.75, 0.98)  # of the draw distance, between which it fades: `through_air` of frame.glsl


@dataclass(frozen=True)
class ScreenError:
    """Split a tile while its error δ may cover more than τ pixels (Rocca et al. 2012, §5.1).

    δ is vertical, so it counts by the sine of the angle between the line of sight and the vertical. Normals
    and materials are stored at vertices too: quads are never wider than `quad` pixels. A cliff has a large δ
    however narrow its quads, yet is drawn as far off as one is wide: those narrower than `finest` are kept.
    Both count by the contrast that the air leaves at their distance; silhouettes in sight are off by 3 px at
    most.
    """

    tolerance: float = 1.0  # τ, px, > 0
    quad: float = 32.0  # greatest width of a quad, px, > 0, seen head on
    finest: float = 0.0  # width of quads that are not split, px, seen head on
    neighbour_limit: float = 2.0  # beside a coarser neighbour a tile's children show the parent's surface
    extinction: float = 0.0  # of the air, 1/m

    def __post_init__(self) -> None:
        if not (self.tolerance > 0 and self.quad > 0):
            raise InputError(
                f"expected a tolerance and a quad > 0 px, got {self.tolerance:g} and {self.quad:g}"
            )

    def excess(
        self, view: CameraView, boxes: Boxes, errors: Float64Array, cells: Float64Array
    ) -> Float64Array:
        """Return by how much tiles are too coarse, (n,): above 1 they are split.

        From geometric errors δ (m) and quad widths (m): error over tolerance or quad over its limit.
        """
        seen = screen_errors(view, boxes, errors) / self.tolerance
        distance, _ = eye_distances(view, boxes)
        width = cells * view.pixels_per_radian / distance
        contrast = self.contrast(distance, view.draw_distance)
        least = np.where(contrast < FAINT, 0.0, min(self.tolerance / _LARGEST, 1.0))
        visible = np.maximum(contrast, least) * np.minimum(seen, width / max(self.finest, 1e-9))
        return np.asarray(np.maximum(visible, width / self.quad))

    def contrast(self, distance: Float64Array, draw_distance: float) -> Float64Array:
        """Return the contrast, 0 … 1, that air and the fade at the draw distance leave at distances (m)."""
        fade = np.clip((distance / draw_distance - _FADE[0]) / (_FADE[1] - _FADE[0]), 0.0, 1.0)
        return np.asarray(np.exp(-self.extinction * distance) * (1.0 - fade**2 * (3.0 - 2.0 * fade)))

    def relaxed(self, factor: float) -> Self:
        """Return the metric with `factor` times the tolerance."""
        return replace(
            self, tolerance=self.tolerance * factor, quad=self.quad * factor, finest=self.finest * factor
        )


def eye_distances(view: CameraView, boxes: Boxes) -> tuple[Float64Array, Float64Array]:
    """Return distances (m) from the eye to boxes, at least 0.5 m, and their vertical part."""
    eye = np.asarray(view.eye)
    apart = np.maximum(np.maximum(boxes.low - eye, eye - boxes.high), 0.0)
    east, north, above = apart.T
    return np.maximum(np.sqrt(east * east + north * north + above * above), _NEAREST), above


def horizontal_distances(view: CameraView, boxes: Boxes) -> tuple[Float64Array, Float64Array]:
    """Return the horizontal distances (m) from the eye to the nearest and farthest points of boxes."""
    eye = np.asarray(view.eye[:2])
    apart = np.maximum(np.maximum(boxes.low[:, :2] - eye, eye - boxes.high[:, :2]), 0.0)
    away = np.maximum(np.abs(boxes.low[:, :2] - eye), np.abs(boxes.high[:, :2] - eye))
    return np.hypot(apart[:, 0], apart[:, 1]), np.hypot(away[:, 0], away[:, 1])


def screen_errors(view: CameraView, boxes: Boxes, errors: Float64Array) -> Float64Array:
    """Return an upper bound (px) of the projection of a vertical error (m) in each box, shape (n,).

    The error is as near as the box's nearest point, and seen as sideways as its farthest corner.
    """
    distance, above = eye_distances(view, boxes)
    _, farthest = horizontal_distances(view, boxes)
    sideways = farthest / np.hypot(farthest, above)
    return np.asarray(errors * view.pixels_per_radian * sideways / distance)


_BEARINGS: Final = 2048
"""Samples of the horizon."""
_SHELL: Final = 1.15
"""Ratio of distances within which tiles are tested against the same horizon."""


def occluded(view: CameraView, boxes: Boxes, ground: Boxes | None = None) -> npt.NDArray[np.bool_]:
    """Return which boxes, (n,), are hidden by `ground` boxes side by side (default: by each other)."""
    ground = boxes if ground is None else ground
    eye = np.asarray(view.eye)
    near, far = horizontal_distances(view, boxes)
    first, last = _bearings(eye, boxes)
    most = _tangent(boxes.high[:, 2] - eye[2], near, far)
    ground_near, ground_far = horizontal_distances(view, ground)
    ground_first, ground_last = _bearings(eye, ground)
    least = _tangent(ground.low[:, 2] - eye[2], ground_far, ground_near)
    beside = ground_near > 0.0
    raising = np.flatnonzero(beside)[np.argsort(ground_far[beside])]
    # Not the nearest of a shell: the result must not depend on which other tiles are tested.
    limit = _SHELL ** np.floor(np.log(np.maximum(near, 1e-3)) / np.log(_SHELL)) * (1 - 1e-9)
    tested = np.flatnonzero(near > 0.0)
    tested = tested[np.argsort(limit[tested], kind="stable")]
    hidden = np.zeros(len(near), np.bool_)
    host_function("test_against_horizon")(
        tested,
        limit,
        np.floor(first).astype(np.int64),
        np.ceil(last).astype(np.int64),
        most,
        raising,
        ground_far,
        # Only bearings wholly within a tile certainly meet it.
        np.ceil(ground_first).astype(np.int64),
        np.floor(ground_last).astype(np.int64),
        least,
        hidden,
        np.empty(_BEARINGS),
    )
    return hidden


def _bearings(eye: Float64Array, boxes: Boxes) -> tuple[Float64Array, Float64Array]:
    """Return first and last bearing, in horizon steps, of boxes that the eye is not in."""
    middle = 0.5 * (boxes.low + boxes.high) - eye
    to_middle = np.arctan2(middle[:, 1], middle[:, 0])
    west, east = boxes.low[:, 0] - eye[0], boxes.high[:, 0] - eye[0]
    south, north = boxes.low[:, 1] - eye[1], boxes.high[:, 1] - eye[1]
    to_corners = np.arctan2([south, south, north, north], [west, east, west, east])
    turn = (to_corners - to_middle + np.pi) % (2 * np.pi) - np.pi
    step = 2 * np.pi / _BEARINGS
    return (to_middle + turn.min(axis=0)) / step, (to_middle + turn.max(axis=0)) / step


def _tangent(height: Float64Array, when_above: Float64Array, when_below: Float64Array) -> Float64Array:
    """Return heights over one distance where above the eye, over the other where below."""
    distance = np.where(height > 0, when_above, when_below)
    return np.asarray(height / np.maximum(distance, 1e-9))


RAMP: Final = 0.25
"""Share of a tile's width in which weights change from border to centre; a power of two is exact."""


def morph_weights(controls: npt.NDArray[np.float32], quads: int) -> npt.NDArray[np.float32]:
    """Return the parent's weight at each vertex, (n, quads + 1, quads + 1) float32, row 0 north.

    `controls` is (n, 3, 3) in 0 … 1, row 0 north, column 0 west; 0 is the tile's own surface, 1 its parent's.
    """
    along = np.arange(quads + 1, dtype=np.float32) / np.float32(quads)
    near = np.minimum(along, 1 - along) * np.float32(1 / RAMP)
    centre = np.minimum(near, 1)
    border = np.where(along < 0.5, 0, 2)
    rows = (1 - centre) * controls[:, :, border] + centre * controls[:, :, 1:2]
    centre, rows = centre[:, None], np.asarray(rows, np.float32)
    return np.asarray((1 - centre) * rows[:, border] + centre * rows[:, 1:2], np.float32)
