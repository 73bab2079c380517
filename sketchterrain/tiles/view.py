"""What tiles need to know of a camera."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from sketchterrain.tiles.codes import Boxes

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CameraView:
    """A camera as the choice of tiles sees it.

    Attributes
    ----------
    eye : (x, y, z) in m
    planes : (k, 4) float64
        a·x + b·y + c·z + d ≥ 0 is inside; unit normals, world coordinates.
    pixels_per_radian : float
        Pixels that an angle of 1 covers in the middle of the picture: its height / (2 tan(fov / 2)).
    velocity : (x, y, z) in m/s
        How the eye moves: tiles are fetched ahead of it.
    draw_distance : float
        Horizontal distance (m) beyond which nothing is drawn.
    """

    eye: tuple[float, float, float]
    planes: Floats
    pixels_per_radian: float
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    draw_distance: float = np.inf

    def extrapolated(self, seconds: float) -> CameraView:
        """Return the view that the same motion leads to."""
        gone = np.asarray(self.velocity) * seconds
        planes = self.planes.copy()
        planes[:, 3] -= planes[:, :3] @ gone
        x, y, z = (np.asarray(self.eye) + gone).tolist()
        return replace(self, eye=(x, y, z), planes=planes)

    def sees(self, boxes: Boxes, *, margin: Floats | float = 0.0) -> npt.NDArray[np.bool_]:
        """Tell which boxes, `margin` (m) larger on all sides, may be seen; shape (n,)."""
        more = np.broadcast_to(margin, len(boxes.low))[:, None]
        return inside_frustum(self.planes, boxes.low - more, boxes.high + more)


def inside_frustum(planes: Floats, low: Floats, high: Floats) -> npt.NDArray[np.bool_]:
    """Tell which boxes are not wholly outside one of the planes.

    Parameters
    ----------
    planes
        (k, 4); a·x + b·y + c·z + d ≥ 0 is inside.
    low, high
        (n, 3) opposite corners (m).

    Returns
    -------
    (n,) bool
        May be true for a box just outside an edge of the frustum, never false for one that can be seen.
    """
    inside = np.ones(len(low), dtype=np.bool_)
    for plane in planes:
        farthest = np.where(plane[:3] >= 0, high, low)
        inside &= farthest @ plane[:3] + plane[3] >= 0
    return inside
