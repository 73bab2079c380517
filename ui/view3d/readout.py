"""A scale bar or the eye's height, as text over the view."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sketchterrain.ui.engine.orders import Pose
    from sketchterrain.ui.view3d.draped import Ground
    from sketchterrain.ui.view3d.projection import Projection

__all__ = ["length_text", "round_length", "scale_bar", "standing_text"]


def round_length(metres: float) -> float:
    """Return the greatest of 1, 2, 5, 10, 20, 50 … m, or of 1, 0.5, 0.2 … m, that is no longer."""
    power = 10.0 ** math.floor(math.log10(metres))
    return next(step for step in (5.0 * power, 2.0 * power, power) if step <= metres * (1.0 + 1e-9))


def length_text(metres: float) -> str:
    """Return a length for a person: ``350 m``, ``2.4 km``."""
    if abs(metres) < 999.5:
        return f"{metres:.0f} m" if abs(metres) >= 9.95 else f"{metres:.1f} m"
    kilometres = metres / 1000.0
    return f"{kilometres:.1f} km" if abs(kilometres) < 99.95 else f"{kilometres:.0f} km"


def standing_text(pose: Pose, ground: Ground | None) -> str:
    """Return how high the eye is, and over the ground where that is known."""
    x, y, z = pose.eye
    if ground is None or not bool(ground.covers(x, y)):
        return f"eye at {length_text(z)}"
    return (
        f"eye at {length_text(z)} · {length_text(max(z - float(ground.height(x, y)), 0.0))} over the ground"
    )


def scale_bar(projection: Projection, pose: Pose, *, most: float) -> tuple[float, float] | None:
    """Return a round length (m) and how many px wide it is across the picture's middle; None if unknown.

    Parameters
    ----------
    projection, pose
    most
        px that it may be wide.
    """
    per_px = projection.metres_per_px([pose.target])
    if per_px <= 0.0:
        return None
    length = round_length(per_px * most)
    return length, length / per_px
