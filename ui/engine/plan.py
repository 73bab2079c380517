"""What the processes behind the window tell each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sketchterrain.sketch import Sketch
    from sketchterrain.terrain.changes import Box
    from sketchterrain.ui.engine.messages import FrameFacts
    from sketchterrain.ui.engine.orders import Pose, SketchUpdate

__all__ = [
    "Coming",
    "Followed",
    "FrameThere",
    "MeasureJob",
    "PictureJob",
    "PictureWritten",
    "Plan",
    "StillPlaced",
    "StillRelief",
]


@dataclass(frozen=True)
class Coming:
    """The window to the engine: this version of the sketch is on its way; fresh: another was opened."""

    version: int
    fresh: bool = False


@dataclass(frozen=True, eq=False)
class Plan:
    """The placer to the engine: a terrain to show from now on.

    Attributes
    ----------
    update : SketchUpdate
        What changed of the sketch since the plan before.
    recipe : bytes or None
        A `TerrainRecipe`, `pickled` but its sketch; None: that of the plan before.
    areas : tuple of (west, south, east, north)
        m; everywhere else every height has the bits of the plan before.
    begun, placed, ready : float
        When placing began and ended, and when this was sent: s of the system's monotonic clock.
    """

    update: SketchUpdate
    recipe: bytes | None
    areas: tuple[Box, ...]
    begun: float
    placed: float
    ready: float


@dataclass(frozen=True)
class Followed:
    """The engine to the window: the view's tiles hold the heights of a version of the sketch.

    Attributes
    ----------
    version : int
    begun, placed, ready, received, shown : float
        When placing began and ended, when its recipe was sent, when the engine took it and when its tiles
        were written: s of the system's monotonic clock.
    """

    version: int
    begun: float
    placed: float
    ready: float
    received: float
    shown: float


@dataclass(frozen=True)
class FrameThere:
    """The engine to the window: a frame lies in the shared memory from a byte on, RGBX, row 0 on top."""

    facts: FrameFacts
    start: int
    capacity: int


@dataclass(frozen=True, eq=False)
class MeasureJob:
    """The engine to its side process: measure adherence."""

    version: int
    sketch: Sketch
    recipe: bytes


@dataclass(frozen=True, eq=False)
class PictureJob:
    """The engine to its side process: take a picture. Directions of the sun in degrees."""

    sketch: Sketch
    recipe: bytes
    path: str
    size: tuple[int, int]
    pose: Pose
    sun: tuple[float, float]
    overlays: tuple[str, ...] = ()


@dataclass(frozen=True)
class PictureWritten:
    """The side process to the engine, and on to the window: a picture lies there."""

    path: str


@dataclass(frozen=True)
class StillPlaced:
    """The placer to the window: for this version of the sketch all stays placed as it was."""

    version: int


@dataclass(frozen=True)
class StillRelief:
    """The engine to the window: for this version of the sketch the relief is the last one."""

    version: int
