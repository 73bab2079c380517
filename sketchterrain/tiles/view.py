"""Camera view as tile selection needs it, with frustum culling."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array

if TYPE_CHECKING:
    from sketchterrain.tiles.codes import Boxes


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
        gone = np.asarray(self.velocity) * seconds
        planes = self.planes.copy()
        planes[:, 3] -= planes[:, :3] @ gone
        x, y, z = (np.asarray(self.eye) + gone).tolist()
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
