"""What the window tells the engine: plain values that travel between processes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    import numpy.typing as npt

__all__ = [
    "MODES",
    "Fly",
    "FrameTaken",
    "GoTo",
    "LayerPatch",
    "Look",
    "MeasureAdherence",
    "Pan",
    "Pick",
    "Pose",
    "Quit",
    "SketchUpdate",
    "TakePicture",
    "Turn",
    "ViewState",
    "Zoom",
]

MODES = ("orbit", "fly", "walk")
"""How the eye moves: around a point, freely, on foot."""


@dataclass(frozen=True, eq=False)
class LayerPatch:
    """Pixels of a layer that are others now: labels, and the row and column of the first."""

    row: int
    column: int
    pixels: npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class SketchUpdate:
    """The newest sketch, as what changed since the update before.

    Attributes
    ----------
    version : int
        Counted up; of several that wait, all patches are applied and the newest is worked out.
    shape : (int, int)
        Rows and columns of its layers; another one than before, or the first: all layers begin empty.
    settings : mapping
        Every field of the sketch but its layers.
    layers : mapping of str to LayerPatch
    """

    version: int
    shape: tuple[int, int]
    settings: Mapping[str, Any]
    layers: Mapping[str, LayerPatch]


@dataclass(frozen=True)
class ViewState:
    """What the 3-D view shall show.

    Attributes
    ----------
    width, height : int
        px of the screen; 0: the view is hidden, nothing is drawn.
    quality : float or None
        0 … 1; None: what suits the driver.
    mode : str
        One of `MODES`.
    overlays : tuple of str
        Names of `sketchterrain.render.OVERLAYS`.
    plays : bool
        Whether water, plants and clouds move.
    """

    width: int = 0
    height: int = 0
    quality: float | None = None
    mode: str = "orbit"
    overlays: tuple[str, ...] = ()
    plays: bool = True

    @property
    def aspect(self) -> float:
        """Width over height of the picture; a usual one while there is none."""
        return self.width / self.height if self.width and self.height else 1.6


@dataclass(frozen=True)
class Turn:
    """Go around the pivot (orbit) or look elsewhere (fly, walk): degrees."""

    right: float
    up: float


@dataclass(frozen=True)
class Pan:
    """Move over the ground: shares of the picture's height."""

    right: float
    up: float


@dataclass(frozen=True)
class Zoom:
    """Multiply the distance; `x`, `y`, shares of the picture from its upper left corner, keep their place."""

    factor: float
    x: float = 0.5
    y: float = 0.5


@dataclass(frozen=True)
class Fly:
    """Which way to go from now on, −1 … 1 each, until another one comes; all 0: stop."""

    forward: float = 0.0
    right: float = 0.0
    up: float = 0.0
    boost: float = 1.0


@dataclass(frozen=True)
class Pose:
    """Where a camera is and what it looks at (m), its vertical field of view (degrees)."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    fov: float = 50.0


@dataclass(frozen=True)
class Look:
    """Be somewhere else at once. None: the view that shows the terrain best, as `render` finds it."""

    pose: Pose | None = None


@dataclass(frozen=True)
class GoTo:
    """Glide until a place of the ground (m) is in the middle, from a distance (m; None: as it is)."""

    x: float
    y: float
    distance: float | None = None


@dataclass(frozen=True)
class Pick:
    """Ask what ground is seen at a place of the picture, shares from its upper left corner."""

    token: int
    x: float
    y: float


@dataclass(frozen=True)
class FrameTaken:
    """The last frame was shown; the next may be sent."""


@dataclass(frozen=True)
class MeasureAdherence:
    """Ask how far the terrain does what the sketch says."""


@dataclass(frozen=True)
class TakePicture:
    """Write a picture of the best quality, from where the eye is, as a PNG."""

    path: str
    width: int
    height: int


@dataclass(frozen=True)
class Quit:
    """No more is wanted."""
