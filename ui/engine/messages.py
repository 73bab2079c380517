"""What the window and the engine tell each other: plain values that travel between processes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    import numpy.typing as npt

    from sketchterrain.features import Lake, River
    from sketchterrain.features.catalogue import Points

__all__ = [
    "MODES",
    "Adherence",
    "EngineFacts",
    "Fly",
    "FrameFacts",
    "FrameTaken",
    "GoTo",
    "LayerPatch",
    "Look",
    "MeasureAdherence",
    "Pan",
    "Pick",
    "Picked",
    "Placed",
    "Pose",
    "Quit",
    "Relief",
    "SketchUpdate",
    "TakePicture",
    "Trouble",
    "Turn",
    "ViewState",
    "Working",
    "Zoom",
]

MODES = ("orbit", "fly", "walk")
"""How the eye moves: around a point, freely, on foot."""


# ── what the window tells the engine ─────────────────────────────────────────────────────────────────────


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


# ── what the engine tells the window ─────────────────────────────────────────────────────────────────────


@dataclass(frozen=True)
class EngineFacts:
    """What the engine runs on.

    Attributes
    ----------
    device, platform : str
        Of OpenCL; empty where there is none.
    renderer : str
        Of OpenGL; empty where there is none.
    sharing : str
        How heights reach OpenGL: ``extension``, ``mapped``, ``copy`` or ``none``.
    no_device, no_picture : str
        One line each, what is missing and what to do; empty where all is well.
    """

    device: str = ""
    platform: str = ""
    renderer: str = ""
    sharing: str = "none"
    no_device: str = ""
    no_picture: str = ""


@dataclass(frozen=True)
class Working:
    """What the engine is busy with, for a person; empty: nothing."""

    what: str


@dataclass(frozen=True, eq=False)
class Placed:
    """What was placed for a version of the sketch. The terrain that is shown follows at once.

    Attributes
    ----------
    version : int
        Of the `SketchUpdate`.
    points : array of FEATURE
        Painted features, and those that fill the sketch's unpainted ground.
    rivers, lakes : tuple
    resolutions : tuple of (str, float, float)
        What was decided where layers contradict each other, and where (m).
    orphans : tuple of str
        A line for each edit whose feature is gone.
    seconds : float
        s that placing took.
    """

    version: int
    points: Points
    rivers: tuple[River, ...]
    lakes: tuple[Lake, ...]
    resolutions: tuple[tuple[str, float, float], ...] = ()
    orphans: tuple[str, ...] = ()
    seconds: float = 0.0


@dataclass(frozen=True, eq=False)
class Relief:
    """The terrain at the sketch's pixels, for a version of the sketch.

    Attributes
    ----------
    version : int
    step : int
        Pixels of the sketch along a side of a sample: 1, or more for a large sketch.
    height : (rows, columns) float32
        m, at the samples' middles, row 0 north.
    shade : (rows, columns) uint8
        Of a hill-shading from the north-west.
    """

    version: int
    step: int
    height: npt.NDArray[np.float32]
    shade: npt.NDArray[np.uint8]


@dataclass(frozen=True)
class FrameFacts:
    """A frame that lies in the shared memory.

    Attributes
    ----------
    width, height : int
        px.
    version : int
        Of the sketch that it shows.
    pose : Pose
    to_clip : tuple of float
        16 numbers, row by row: from metres relative to the eye to clip space.
    seconds : float
        s that the frame took, all of it.
    generation_seconds : float
        s of that, for tiles.
    tiles, triangles : int
    settled : bool
        Whether the picture is as good as it gets.
    memory : int
        Bytes that the engine's processes hold.
    """

    width: int
    height: int
    version: int
    pose: Pose
    to_clip: tuple[float, ...]
    seconds: float
    generation_seconds: float
    tiles: int
    triangles: int
    settled: bool
    memory: int


@dataclass(frozen=True)
class Picked:
    """The answer to `Pick`: a place on the ground (m), None for the sky."""

    token: int
    place: tuple[float, float, float] | None


@dataclass(frozen=True, eq=False)
class Adherence:
    """How far the terrain does what the sketch says.

    Attributes
    ----------
    version : int
    figures : mapping
        As `sketchterrain.terrain.Adherence.as_dict` returns them.
    images : mapping of str to (painted, shown)
        By layer, (rows, columns) bool each.
    """

    version: int
    figures: Mapping[str, Any]
    images: Mapping[str, tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]] = field(default_factory=dict)


@dataclass(frozen=True)
class Trouble:
    """Something failed: a line for a person, and of what: ``sketch``, ``view``, ``picture``, ``engine``."""

    what: str
    line: str
