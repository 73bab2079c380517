"""Messages between the processes of the desktop program, and requests of an export."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from sketchterrain.array_types import StructuredArray
    from sketchterrain.document.drapes import DrapedLayer
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.export.target import ExportOptions
    from sketchterrain.geometry.camera import Camera
    from sketchterrain.landforms.placement.feature_types import Lake, River
    from sketchterrain.roads.road_types import Road
    from sketchterrain.schema.parameters import Properties
    from sketchterrain.terrain.recipe import TerrainRecipe
    from sketchterrain.world.options import WorldOptions


MODES = ("orbit", "fly", "walk")  # camera modes


@dataclass(frozen=True, eq=False)
class SketchUpdate:
    """The newest sketch, with the current stroke, without draped layers."""

    version: int  # increases; of several pending updates the newest is placed
    sketch: Sketch


@dataclass(frozen=True)
class UpdatePending:
    """A version of the sketch was sent to the placer; fresh: it belongs to another document."""

    version: int
    fresh: bool = False


@dataclass(frozen=True, eq=False)
class SetDrapes:
    """The sketch's draped layers, which the placer never receives, and its frame, size and extent (m).

    `held`: layer and feature that are being edited.
    """

    layers: tuple[DrapedLayer, ...]
    frame: Properties
    size: tuple[float, float]
    extent: float
    held: tuple[int, int] | None = None


@dataclass(frozen=True)
class ViewState:
    """Size, quality, mode and overlays of the 3-D view."""

    width: int = 0  # device px; 0: the view is hidden and nothing is drawn
    height: int = 0
    quality: float | None = None  # 0 … 1; None: the driver's default
    mode: str = "orbit"  # one of `MODES`
    overlays: tuple[str, ...] = ()  # names of `sketchterrain.render.overlays.OVERLAYS`
    plays: bool = True  # whether water, plants and clouds are animated
    refines: bool = True  # whether a view at rest is drawn again at the best quality, unless that is animated
    drape_method: str = "tiles"  # of drawing draped layers

    @property
    def aspect(self) -> float:
        """Width over height; 1.6 while the size is unknown."""
        return self.width / self.height if self.width and self.height else 1.6


@dataclass(frozen=True)
class Turn:
    """Orbit the pivot, or turn the camera (fly, walk): degrees."""

    right: float
    up: float


@dataclass(frozen=True)
class Pan:
    """Translate the camera over the terrain: fractions of the image height."""

    right: float
    up: float


@dataclass(frozen=True)
class Zoom:
    """Scale the distance about an image position (fractions from the upper left corner)."""

    factor: float
    x: float = 0.5
    y: float = 0.5


@dataclass(frozen=True)
class Fly:
    """Direction of continuous motion, −1 … 1 each, until the next one; all 0: stop."""

    forward: float = 0.0
    right: float = 0.0
    up: float = 0.0
    boost: float = 1.0


@dataclass(frozen=True)
class Look:
    """Set the camera pose at once; None: the automatic view that `render` picks."""

    pose: Camera | None = None


@dataclass(frozen=True)
class GoTo:
    """Glide until a terrain position (m) is in the image centre, at a distance (m; None: unchanged)."""

    x: float
    y: float
    distance: float | None = None


@dataclass(frozen=True)
class PickRequest:
    """Request the terrain position at an image position (fractions from the upper left corner)."""

    token: int
    x: float
    y: float


@dataclass(frozen=True)
class FrameAcknowledged:
    """The last frame was displayed; its slot in shared memory is free."""


@dataclass(frozen=True)
class MeasureAdherence:
    """Request a comparison of the terrain with the sketch."""


@dataclass(frozen=True)
class RenderPicture:
    """Request a PNG of the highest quality from the current camera."""

    path: str
    width: int
    height: int


@dataclass(frozen=True)
class Quit:
    """Terminate."""


@dataclass(frozen=True)
class EngineFacts:
    """Device, driver and OpenGL renderer of the engine."""

    device: str = ""  # OpenCL; empty: none
    platform: str = ""
    renderer: str = ""  # OpenGL; empty: none
    sharing: str = "none"  # path of heights to OpenGL: `extension`, `mapped`, `copy` or `none`
    device_error: str = ""  # one line each: what is missing and how to fix it
    opengl_error: str = ""


@dataclass(frozen=True)
class WorldFacts:
    """Properties of the displayed stored world."""

    corner: tuple[float, float]  # north-west corner, origin of displayed coordinates: m in the sketch
    bounds: tuple[float, float, float, float]  # west, south, east, north (m), displayed coordinates
    cell: float  # m between vertices
    middle: float  # elevation of the centre, m
    missing: tuple[str, ...] = ()  # a line for each absent part


@dataclass(frozen=True)
class Activity:
    """The running task, for the status line; empty: idle."""

    text: str


@dataclass(frozen=True)
class ErrorReport:
    """A one-line error and its source: `sketch`, `view`, `picture`, `engine` or `world`."""

    source: str
    line: str


@dataclass(frozen=True, eq=False)
class Placement:
    """Features placed for a version of the sketch; the displayed terrain follows at once."""

    version: int
    points: StructuredArray  # features of painted shapes and of the unpainted area
    rivers: tuple[River, ...]
    lakes: tuple[Lake, ...]
    resolutions: tuple[tuple[str, float, float], ...] = ()  # resolved contradictions: text, x, y (m)
    roads: tuple[Road, ...] = ()
    findings: tuple[tuple[str, tuple[float, float] | None], ...] = ()  # about roads: text, x and y if known
    orphans: tuple[str, ...] = ()  # a line for each edit whose feature no longer exists
    seconds: float = 0.0  # duration of the placement


@dataclass(frozen=True, eq=False)
class Relief:
    """Heights and hill-shading at the sketch's pixels."""

    version: int
    step: int  # sketch pixels along a side of a sample: 1, more for large sketches
    height: npt.NDArray[np.float32]  # m, at sample centres, row 0 north
    shade: npt.NDArray[np.uint8]  # hill-shading, light from the north-west
    sea_level: float | None = None  # m; None: no sea


@dataclass(frozen=True)
class Unchanged:
    """The last `placement` or `relief` is valid for this version of the sketch too."""

    kind: str
    version: int


@dataclass(frozen=True)
class FrameFacts:
    """Size, camera and statistics of a frame."""

    width: int  # px
    height: int
    version: int  # of the sketch
    pose: Camera
    seconds: float  # whole frame
    generation_seconds: float  # tiles, part of `seconds`
    tiles: int
    triangles: int
    converged: bool  # whether further frames would not improve the image
    memory: int  # bytes held by the engine's processes


@dataclass(frozen=True)
class FrameReady:
    """A frame lies in shared memory from byte `start`: RGBX, row 0 on top."""

    facts: FrameFacts
    start: int
    capacity: int


@dataclass(frozen=True)
class PickResult:
    """Answer to `PickRequest`: a terrain position (m); None: sky."""

    token: int
    place: tuple[float, float, float] | None


@dataclass(frozen=True)
class TerrainUpdated:
    """The view's tiles hold a version's heights. Times: s of the system's monotonic clock."""

    version: int
    started: float  # placement started
    placed: float  # placement finished, recipe sent to the engine
    received: float
    displayed: float  # tiles written
    draft: bool = False


@dataclass(frozen=True, eq=False)
class Agreement:
    """Agreement of the terrain with the sketch, and its realism."""

    version: int
    figures: Mapping[str, Any]  # `sketchterrain.measure.adherence.Adherence.as_dict`
    # by layer: painted, visible; (rows, columns) bool
    images: Mapping[str, tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]] = field(default_factory=dict)
    realism: Mapping[str, Any] | None = None  # `sketchterrain.measure.realism.Realism.as_dict`
    faults: npt.NDArray[np.uint8] | None = None  # (rows, columns) indices into `FAULTS`


@dataclass(frozen=True)
class PictureWritten:
    """The requested picture was written."""

    path: str


@dataclass(frozen=True, eq=False)
class RecipeUpdate:
    """The next terrain. Times as in `TerrainUpdated`."""

    version: int
    sketch: Sketch
    recipe: TerrainRecipe | None  # None: as before
    started: float
    placed: float
    draft: bool = False  # coarse: the version's own recipe follows, unless a newer sketch is waiting


@dataclass(frozen=True, eq=False)
class MeasureJob:
    """Measure adherence."""

    version: int
    sketch: Sketch
    recipe: TerrainRecipe


@dataclass(frozen=True, eq=False)
class PictureJob:
    """Render a picture; sun azimuth and elevation in degrees, clock in s."""

    sketch: Sketch
    recipe: TerrainRecipe
    path: str
    size: tuple[int, int]
    pose: Camera
    sun: tuple[float, float]
    clock: float
    overlays: tuple[str, ...] = ()


@dataclass(frozen=True)
class ExportRequest:
    """Files to write as `generate` does."""

    folder: Path
    size: int = 1025  # Vertices along the longer side
    foliage: str = "csv"
    grass: bool = False
    preview: bool = True
    view: str = "auto"  # Viewpoint of the preview: auto, ground, hill, air or layers
    map: str | None = None
    device: str | None = None


@dataclass(frozen=True)
class TargetRequest:
    """Files to write for a target, one of `sketchterrain.export.targets.TARGET_NAMES`."""

    folder: Path
    target: str
    options: ExportOptions
    device: str | None = None


@dataclass(frozen=True)
class WorldRequest:
    """World to write or resume; its form follows from the output's suffix."""

    output: Path
    options: WorldOptions
    workers: int = 0  # Worker processes; 0: in this process
    device: str | None = None
    only_estimate: bool = False


Request: TypeAlias = ExportRequest | TargetRequest | WorldRequest
