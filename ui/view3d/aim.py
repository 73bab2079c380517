"""Where to look from so that something selected, or all of the sketch, fills the picture."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.features.lakes import lake_centre
from sketchterrain.ui.commands.chosen_parts import lake_of, point_of, river_of
from sketchterrain.ui.engine.orders import GoTo, Pose

if TYPE_CHECKING:
    from sketchterrain.ui.engine.messages import Placed
    from sketchterrain.ui.models.workspace import Chosen

__all__ = ["going_to", "overview"]

_DISTANCE = 1.6  # of its diameter
_NEAREST = 40.0  # m
_FOV = 50.0  # degrees, as the engine's
_ELEVATION = 26.0  # degrees: just below a horizon that is seen
_FILLED = 0.94  # of the picture, by the sketch's corners


def overview(size: tuple[float, float], height: float, *, aspect: float) -> Pose:
    """Return the pose from which all of a sketch is seen from the south.

    Parameters
    ----------
    size
        Metres of the sketch.
    height
        m, of the ground in its middle.
    aspect
        Width of the picture over its height.
    """
    east, north = 0.5 * size[0], 0.5 * size[1]
    rise = math.radians(_ELEVATION)
    upright = _FILLED * math.tan(math.radians(_FOV) / 2.0)
    # The near corners are the widest, and all four must lie inside; each says how far away the eye must be.
    distance = max(
        max(east / (upright * aspect), abs(corner) * math.sin(rise) / upright) - corner * math.cos(rise)
        for corner in (-north, north)
    )
    eye = (east, north - distance * math.cos(rise), height + distance * math.sin(rise))
    return Pose(eye, (east, north, height), _FOV)


def going_to(placed: Placed | None, chosen: Chosen | None, *, size: tuple[float, float]) -> GoTo | None:
    """Return the motion that shows what is selected; None if nothing is, or it is gone.

    Parameters
    ----------
    placed, chosen
    size
        Metres of the sketch; of a river, what lies in it counts.
    """
    if placed is None or chosen is None:
        return None
    point, river, lake = point_of(placed, chosen), river_of(placed, chosen), lake_of(placed, chosen)
    if point is not None:
        return _goto(float(point["x"]), float(point["y"]), 2.0 * float(point["radius"]))
    if river is not None:
        line = river.points[:, :2]
        if chosen.index is not None and chosen.index < len(line):
            x, y = line[chosen.index].tolist()
            return _goto(x, y, 8.0 * float(river.width[chosen.index]))
        inside = ((line >= 0.0) & (line <= np.array(size))).all(axis=1)
        line = line[inside] if inside.any() else line
        x, y = (0.5 * (line.min(axis=0) + line.max(axis=0))).tolist()
        return _goto(x, y, float(np.ptp(line, axis=0).max()))
    if lake is not None:
        x, y = lake_centre(lake).tolist()
        return _goto(x, y, lake.shape.spacing * max(lake.shape.inside.shape))
    return None


def _goto(x: float, y: float, across: float) -> GoTo:
    return GoTo(x, y, max(_DISTANCE * across, _NEAREST))
