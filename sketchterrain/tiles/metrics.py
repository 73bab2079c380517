"""Level-of-detail metrics: screen-space error or quad length."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final, Protocol, Self

import numpy as np

from sketchterrain.errors import InputError

if TYPE_CHECKING:
    from sketchterrain.array_types import Float64Array
    from sketchterrain.tiles.codes import Boxes
    from sketchterrain.tiles.view import CameraView


_NEAREST: Final = 0.5
"""m; nothing is looked at from nearer."""


class Metric(Protocol):
    """Returns the excess of tiles: above 1 a tile is too coarse."""

    @property
    def neighbour_limit(self) -> float:
        """Excess above which a tile's neighbours are split too."""
        ...

    def excess(
        self, view: CameraView, boxes: Boxes, errors: Float64Array, cells: Float64Array
    ) -> Float64Array:
        """Return the excess of tiles, (n,), from geometric errors δ (m) and quad widths (m)."""
        ...

    def relaxed(self, factor: float) -> Self:
        """Return the metric with `factor` times the tolerance."""
        ...


@dataclass(frozen=True)
class ScreenError:
    """Split a tile while its error δ may cover more than τ pixels (Rocca et al. 2012, §5.1).

    δ is vertical, so it counts by the sine of the angle between the line of sight and the vertical. Normals
    and materials are stored at vertices too: quads are never wider than `quad` pixels.
    """

    tolerance: float = 1.0  # τ, px, > 0
    quad: float = 32.0  # greatest width of a quad, px, > 0, seen head on
    neighbour_limit: float = 2.0  # beside a coarser neighbour a tile's children show the parent's surface

    def __post_init__(self) -> None:
        if not (self.tolerance > 0 and self.quad > 0):
            raise InputError(
                f"expected a tolerance and a quad > 0 px, got {self.tolerance:g} and {self.quad:g}"
            )

    def excess(
        self, view: CameraView, boxes: Boxes, errors: Float64Array, cells: Float64Array
    ) -> Float64Array:
        """Return the larger of error over tolerance and quad over its limit; see :class:`Metric`."""
        seen = screen_errors(view, boxes, errors) / self.tolerance
        distance, _ = eye_distances(view, boxes)
        return np.maximum(seen, cells * view.pixels_per_radian / distance / self.quad)

    def relaxed(self, factor: float) -> Self:
        """Return the metric with `factor` times the tolerance."""
        return replace(self, tolerance=self.tolerance * factor, quad=self.quad * factor)


@dataclass(frozen=True)
class QuadLength:
    """No quad is longer than √d / (T · F), d being the distance in m (Zaaijer 2013, §2.2)."""

    factor: float = 1.0  # tessellation T times the features' value F, > 0
    neighbour_limit: ClassVar[float] = np.inf

    def __post_init__(self) -> None:
        if not self.factor > 0:
            raise InputError(f"expected a tessellation factor > 0, got {self.factor:g}")

    def excess(
        self, view: CameraView, boxes: Boxes, errors: Float64Array, cells: Float64Array
    ) -> Float64Array:
        """Return length over its limit; see :class:`Metric`."""
        distance, _ = eye_distances(view, boxes)
        return np.asarray(cells * self.factor / np.sqrt(distance))

    def relaxed(self, factor: float) -> Self:
        """Return the metric with `factor` times the tolerance."""
        return replace(self, factor=self.factor / factor)


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
    _, reach = horizontal_distances(view, boxes)
    sideways = reach / np.hypot(reach, above)
    return np.asarray(errors * view.pixels_per_radian * sideways / distance)
