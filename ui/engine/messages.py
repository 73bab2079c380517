"""What the engine tells the window: plain values that travel between processes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    import numpy.typing as npt

    from sketchterrain.features import Lake, River
    from sketchterrain.features.catalogue import Points
    from sketchterrain.ui.engine.orders import Pose

__all__ = [
    "Adherence",
    "EngineFacts",
    "FrameFacts",
    "Picked",
    "Placed",
    "Relief",
    "Trouble",
    "Working",
]


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
