"""A handle that is dragged in a picture: it stays under the mouse, on the level where it was taken."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain.ui.models.drags import FeatureDrag

if TYPE_CHECKING:
    from sketchterrain.ui.engine.messages import Placed
    from sketchterrain.ui.models.document import Document
    from sketchterrain.ui.models.handles import Handle
    from sketchterrain.ui.view3d.marks import Grip
    from sketchterrain.ui.view3d.projection import Projection

__all__ = ["GripDrag"]

_FARTHEST = 3.0  # extents from the sketch's middle


class GripDrag:
    """Drags a handle by lines of sight.

    It moves on the level plane of the place where it was taken, not on the ground that is seen: that ground
    is what it changes, and a mountain would come nearer the more it is dragged.

    Parameters
    ----------
    document
    placed
    grip
        What was taken hold of.
    projection
        Of the picture then.
    x, y
        Where, px.
    """

    def __init__(
        self, document: Document, placed: Placed, grip: Grip, projection: Projection, x: float, y: float
    ) -> None:
        self._level = grip.z
        self._middle = (0.5 * document.sketch.size[0], 0.5 * document.sketch.size[1])
        self._reach = _FARTHEST * document.sketch.extent
        self._grab = (x, y)
        self._moved = False
        start = projection.on_level(x, y, grip.z)
        self._drag = FeatureDrag(document, placed, grip.handle, grab=start)

    @property
    def now(self) -> tuple[Handle, float, float]:
        """The handle, and where it is (m)."""
        return self._drag.handle, self._drag.x, self._drag.y

    @property
    def problem(self) -> str:
        """Why the last motion changed nothing."""
        return self._drag.problem

    def to(self, projection: Projection, x: float, y: float) -> None:
        """Drag it on, to a place (px) of a picture; over the horizon it stays where it was."""
        if not self._moved and max(abs(x - self._grab[0]), abs(y - self._grab[1])) < 2.0:
            return
        self._moved = True
        place = projection.on_level(x, y, self._level)
        if place is None:
            return
        if max(abs(place[0] - self._middle[0]), abs(place[1] - self._middle[1])) <= self._reach:
            self._drag.to(*place)

    def finish(self) -> None:
        """Let go."""
        self._drag.finish()

    def cancel(self) -> None:
        """Let go and leave everything as it was."""
        self._drag.cancel()
