"""Where evaluated patches live: arrays here, and buffers on a device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from sketchterrain.terrain.finite import require_finite
from sketchterrain.terrain.materials import MATERIALS

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.compute import ComputeContext

__all__ = ["ParentSurface", "Surface", "SurfaceStore"]


@dataclass(frozen=True)
class Surface:
    """Heights, normals and materials of patches of n×n vertices.

    Attributes
    ----------
    height : ndarray, shape (patches, n, n)
        Metres.
    normal : ndarray, shape (patches, n, n, 3)
        Unit vectors: east, north, up.
    materials : ndarray, shape (patches, n, n, len(MATERIALS))
        Weights that sum to 1.
    """

    height: npt.NDArray[np.floating]
    normal: npt.NDArray[np.floating]
    materials: npt.NDArray[np.floating]

    @classmethod
    def empty(cls, count: int, inner: int, *, real: npt.DTypeLike) -> Self:
        """Return uninitialised arrays for ``count`` patches of inner × inner vertices."""
        shape = (count, inner, inner)
        parts = (shape, (*shape, 3), (*shape, len(MATERIALS)))
        return cls(*(np.empty(part, real) for part in parts))

    def part(self, part: slice) -> Surface:
        """Return views of some of the patches."""
        return Surface(self.height[part], self.normal[part], self.materials[part])


@dataclass(frozen=True)
class ParentSurface:
    """What the parents of tiles hold at the tiles' vertices.

    Attributes
    ----------
    height : ndarray, shape (tiles, n, n)
        Metres.
    normal : ndarray, shape (tiles, n, n, 3)
        Unit vectors: east, north, up.
    """

    height: npt.NDArray[np.floating]
    normal: npt.NDArray[np.floating]

    @classmethod
    def empty(cls, count: int, inner: int, *, real: npt.DTypeLike) -> Self:
        """Return uninitialised arrays for ``count`` tiles of inner × inner vertices."""
        shape = (count, inner, inner)
        return cls(np.empty(shape, real), np.empty((*shape, 3), real))

    def part(self, part: slice) -> ParentSurface:
        """Return views of some of the tiles."""
        return ParentSurface(self.height[part], self.normal[part])


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
    height, normal, materials, parent_height, parent_normal
        Device buffers of REAL with 1, 3, 8, 1 and 3 values a vertex.
    """

    def __init__(self, context: ComputeContext, inner: int, slots: int) -> None:
        self.context = context
        self.inner = inner
        self.slots = slots
        vertices = slots * inner * inner
        widths = (1, 3, len(MATERIALS), 1, 3)
        self.height, self.normal, self.materials, self.parent_height, self.parent_normal = (
            context.empty(width * vertices, context.real_dtype) for width in widths
        )

    def download_surface(self, out: Surface) -> None:
        """Wait, and copy the first slots into arrays."""
        self._download(self.height, out.height, "heights")
        self._download(self.normal, out.normal, "normals")
        self._download(self.materials, out.materials, "materials")

    def download_parents(self, out: ParentSurface) -> None:
        """Wait, and copy what the parents of the first slots hold into arrays."""
        self._download(self.parent_height, out.height, "heights")
        self._download(self.parent_normal, out.normal, "normals")

    def _download(self, buffer: Any, out: npt.NDArray[Any], what: str) -> None:
        self.context.download_into(buffer, out)
        require_finite(out, what, self.context.device)
