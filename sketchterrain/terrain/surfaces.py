"""Results of an evaluation: tiles, rasters, and stores of surfaces on the device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from sketchterrain.errors import DeviceFailedError
from sketchterrain.terrain.materials import MATERIALS

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import StructuredArray
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.compute.device import Device
    from sketchterrain.placement.feature_types import Lake, River
    from sketchterrain.terrain.recipe import TerrainRecipe


@dataclass(frozen=True)
class Tile:
    """One tile of 64×64 quads; row 0 is its north edge.

    Attributes
    ----------
    level, column, row : int
        The tile covers [column, column + 1] × [row, row + 1] · extent/2^level metres.
    bounds : tuple of float
        West, south, east, north, m.
    cell_size : float
        Metres between vertices.
    detail_bound : float
        Upper bound (m) of the difference between heights at full detail and at this level within the tile.
    height : ndarray of float32, shape (65, 65)
        Metres.
    normal : ndarray of float32, shape (65, 65, 3)
        Unit vectors: east, north, up.
    materials : ndarray of float32, shape (65, 65, 8)
        Weights in the order of ``MATERIALS``; they sum to 1.
    parent_height, parent_normal : ndarray of float32, shapes (65, 65) and (65, 65, 3)
        Values of the parent tile at these vertices: bit-equal at shared vertices; between two of the
        parent's vertices half their sum, along its edges or its diagonals from north-west to south-east.
    """

    level: int
    column: int
    row: int
    bounds: tuple[float, float, float, float]
    cell_size: float
    detail_bound: float
    height: npt.NDArray[np.float32]
    normal: npt.NDArray[np.float32]
    materials: npt.NDArray[np.float32]
    parent_height: npt.NDArray[np.float32]
    parent_normal: npt.NDArray[np.float32]


@dataclass(frozen=True)
class Raster:
    """The whole sketch as images of rows × columns vertices; row 0 is the north edge."""

    spacing: tuple[float, float]  # m between columns and between rows
    height: npt.NDArray[np.float32]
    normal: npt.NDArray[np.float32]
    materials: npt.NDArray[np.float32]


@dataclass(frozen=True)
class Band:
    """Some rows of a grid of vertices, from row ``top`` of the grid; row 0 is the band's north edge."""

    top: int
    height: npt.NDArray[np.float32]
    normal: npt.NDArray[np.float32]
    materials: npt.NDArray[np.float32]


@dataclass(frozen=True)
class TerrainFeatures:
    """Placed features: points (mountains, hills, dunes, forests) in and near the sketch by id; rivers.

    Lakes.
    """

    points: StructuredArray
    rivers: tuple[River, ...]
    lakes: tuple[Lake, ...] = ()

    @classmethod
    def from_recipe(cls, recipe: TerrainRecipe, size: tuple[float, float]) -> TerrainFeatures:
        """Return a recipe's features: all painted ones, and the fill inside a sketch of a size (m)."""
        points = np.concatenate([recipe.painted, recipe.fill.within(0.0, 0.0, *size)])
        return cls(points[np.argsort(points["id"], kind="stable")], recipe.rivers, recipe.lakes)


def require_finite(values: npt.NDArray[Any], what: str, device: Device) -> None:
    """Raise DeviceFailedError if any value is not finite.

    No recipe gives such values, so the device failed.
    """
    bad = values.size - int(np.count_nonzero(np.isfinite(values)))
    if bad:
        raise non_finite(what, device, f"{bad} of {values.size}")


def non_finite(what: str, device: Device, count: str) -> DeviceFailedError:
    """Return the error for a count of non-finite values, for example ``"3 of 4225"`` ``"heights"``."""
    return DeviceFailedError(
        f"{device.name} ({device.platform}) produced non-finite {what} (NaN or Inf): {count}"
    )


@dataclass(frozen=True)
class Ground:
    """Heights and normals of patches of n×n vertices, as a device writes them.

    Attributes
    ----------
    whole : ndarray, shape (patches, n, n, 4)
        Unit normal (east, north, up), and the height (m).
    """

    whole: npt.NDArray[np.floating]

    @property
    def height(self) -> npt.NDArray[np.floating]:
        """Metres, shape (patches, n, n); a view."""
        return self.whole[..., 3]

    @property
    def normal(self) -> npt.NDArray[np.floating]:
        """Unit vectors, shape (patches, n, n, 3); a view."""
        return self.whole[..., :3]


@dataclass(frozen=True)
class Surface:
    """Ground and materials of patches of n×n vertices.

    Attributes
    ----------
    ground : Ground
    materials : ndarray, shape (patches, n, n, len(MATERIALS))
        Weights that sum to 1.
    parent : Ground
        What the parents of tiles hold at the tiles' vertices; of no patch where that was not asked for.
    """

    ground: Ground
    materials: npt.NDArray[np.floating]
    parent: Ground

    @property
    def height(self) -> npt.NDArray[np.floating]:
        """Metres, shape (patches, n, n)."""
        return self.ground.height

    @property
    def normal(self) -> npt.NDArray[np.floating]:
        """Unit vectors: east, north, up; shape (patches, n, n, 3)."""
        return self.ground.normal

    @classmethod
    def empty(cls, count: int, inner: int, *, real: npt.DTypeLike, parents: bool = False) -> Self:
        """Return uninitialised arrays for ``count`` patches of inner × inner vertices."""
        shape = (inner, inner)
        ground, parent = (
            Ground(np.empty((patches, *shape, 4), real)) for patches in (count, count if parents else 0)
        )
        return cls(ground, np.empty((count, *shape, len(MATERIALS)), real), parent)

    def part(self, part: slice) -> Surface:
        """Return views of some of the patches."""
        ground, parent = (Ground(each.whole[part]) for each in (self.ground, self.parent))
        return Surface(ground, self.materials[part], parent)


class SurfaceStore:
    """Buffers on a device with room for patches, in slots; kernels write each patch where it lives.

    Parameters
    ----------
    context : ComputeContext
    inner : int
        Vertices along a patch's side.
    slots : int
        How many patches there is room for.

    Attributes
    ----------
    ground : buffer
        Four REAL a vertex: unit normal (east, north, up), and the height (m).
    materials : buffer
        Eight REAL a vertex: weights in the order of ``MATERIALS``.
    parent : buffer
        As ``ground``: what the coarser tile holds here.
    """

    def __init__(self, context: ComputeContext, inner: int, slots: int) -> None:
        self.context = context
        self.inner = inner
        self.slots = slots
        vertices = slots * inner * inner
        self.ground, self.materials, self.parent = (
            context.empty(width * vertices, context.real_dtype) for width in (4, len(MATERIALS), 4)
        )

    def download(self, out: Surface) -> None:
        """Wait, and copy the first slots into arrays."""
        parts = {
            "normals and heights": (self.ground, out.ground.whole),
            "materials": (self.materials, out.materials),
            "parents' normals and heights": (self.parent, out.parent.whole),
        }
        for what, (buffer, array) in parts.items():
            self.context.download_into(buffer, array)
            require_finite(array, what, self.context.device)
