"""Messages between the window, the engine and its other processes: plain values that are pickled."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    import numpy.typing as npt

    from sketchterrain.features import Lake, River
    from sketchterrain.features.catalogue import Points
    from sketchterrain.sketch import Sketch
    from sketchterrain.terrain.changes import Box

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
    """The newest sketch, as what changed since the update before."""

    version: int  # Counted up; of several that wait, all patches are applied and the newest is worked out
    # Rows and columns of its layers; another one than before, or the first: all layers begin empty
    shape: tuple[int, int]
    settings: Mapping[str, Any]  # Every field of the sketch but its layers
    layers: Mapping[str, LayerPatch]


@dataclass(frozen=True)
class ViewState:
    """What the 3-D view shall show."""

    width: int = 0  # px of the screen; 0: the view is hidden, nothing is drawn
    height: int = 0
    quality: float | None = None  # 0 … 1; None: what suits the driver
    mode: str = "orbit"  # One of `MODES`
    overlays: tuple[str, ...] = ()  # Names of `sketchterrain.render.OVERLAYS`
    plays: bool = True  # Whether water, plants and clouds move

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
class FrameAcknowledged:
    """The last frame was shown; the next may be sent."""


@dataclass(frozen=True)
class MeasureAdherence:
    """Ask how far the terrain does what the sketch says."""


@dataclass(frozen=True)
class RenderPicture:
    """Write a picture of the best quality, from where the eye is, as a PNG."""

    path: str
    width: int
    height: int


@dataclass(frozen=True)
class Quit:
    """No more is wanted."""


@dataclass(frozen=True)
class EngineFacts:
    """What the engine runs on."""

    device: str = ""  # Of OpenCL; empty where there is none
    platform: str = ""
    renderer: str = ""  # Of OpenGL; empty where there is none
    sharing: str = "none"  # How heights reach OpenGL: `extension`, `mapped`, `copy` or `none`
    no_device: str = ""  # One line each, what is missing and what to do; empty where all is well
    no_picture: str = ""


@dataclass(frozen=True)
class WorldFacts:
    """A stored world that is shown."""

    corner: tuple[float, float]  # its north-west corner, the origin of what is shown: m in the sketch
    bounds: tuple[float, float, float, float]  # west, south, east, north (m) of what is shown
    cell: float  # m between its vertices
    middle: float  # height of the ground in its middle, m
    lacks: tuple[str, ...] = ()  # a line for each thing that it does not hold


@dataclass(frozen=True)
class Activity:
    """What the engine is busy with, for a person; empty: nothing."""

    what: str


@dataclass(frozen=True, eq=False)
class Placement:
    """What was placed for a version of the sketch. The terrain that is shown follows at once."""

    version: int  # Of the `SketchUpdate`
    points: Points  # Painted features, and those that fill the sketch's unpainted ground
    rivers: tuple[River, ...]
    lakes: tuple[Lake, ...]
    # What was decided where layers contradict each other, and where (m)
    resolutions: tuple[tuple[str, float, float], ...] = ()
    orphans: tuple[str, ...] = ()  # A line for each edit whose feature is gone
    seconds: float = 0.0  # s that placing took


@dataclass(frozen=True, eq=False)
class Relief:
    """The terrain at the sketch's pixels, for a version of the sketch."""

    version: int
    step: int  # Pixels of the sketch along a side of a sample: 1, or more for a large sketch
    height: npt.NDArray[np.float32]  # m, at the samples' middles, row 0 north
    shade: npt.NDArray[np.uint8]  # Of a hill-shading from the north-west


@dataclass(frozen=True)
class FrameFacts:
    """A frame that lies in the shared memory."""

    width: int  # px
    height: int
    version: int  # Of the sketch that it shows
    pose: Pose
    to_clip: tuple[float, ...]  # 16 numbers, row by row: from metres relative to the eye to clip space
    seconds: float  # s that the frame took, all of it
    generation_seconds: float  # s of that, for tiles
    tiles: int
    triangles: int
    settled: bool  # Whether the picture is as good as it gets
    memory: int  # Bytes that the engine's processes hold


@dataclass(frozen=True)
class PickResult:
    """The answer to `Pick`: a place on the ground (m), None for the sky."""

    token: int
    place: tuple[float, float, float] | None


@dataclass(frozen=True, eq=False)
class Adherence:
    """How far the terrain does what the sketch says."""

    version: int
    figures: Mapping[str, Any]  # As `sketchterrain.terrain.Adherence.as_dict` returns them
    # By layer, (rows, columns) bool each
    images: Mapping[str, tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]] = field(default_factory=dict)


@dataclass(frozen=True)
class ErrorReport:
    """Something failed: a line for a person, and of what: `sketch`, `view`, `picture`, `engine`, `world`."""

    what: str
    line: str


@dataclass(frozen=True)
class UpdatePending:
    """The window to the engine: this version of the sketch is on its way; fresh: another was opened."""

    version: int
    fresh: bool = False


@dataclass(frozen=True, eq=False)
class Plan:
    """The placer to the engine: the next terrain. Times are s of the system's monotonic clock."""

    update: SketchUpdate  # What changed of the sketch since the plan before
    recipe: bytes | None  # A `TerrainRecipe`, `pickled` but its sketch; None: that of the plan before
    areas: tuple[Box, ...]  # m; everywhere else every height has the bits of the plan before
    begun: float  # when placing began
    placed: float  # when it ended
    ready: float  # when this was sent


@dataclass(frozen=True)
class TerrainUpdated:
    """The engine to the window: the view's tiles hold the heights of a version. Times as in `Plan`."""

    version: int
    begun: float
    placed: float
    ready: float
    received: float  # when the engine took the plan
    shown: float  # when the tiles were written


@dataclass(frozen=True)
class FrameReady:
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
class PlacementUnchanged:
    """The placer to the window: for this version of the sketch all stays placed as it was."""

    version: int


@dataclass(frozen=True)
class ReliefUnchanged:
    """The engine to the window: for this version of the sketch the relief is the last one."""

    version: int
