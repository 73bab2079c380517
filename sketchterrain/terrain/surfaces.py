"""Where evaluated patches live: arrays here, and buffers on a device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from sketchterrain.terrain.finite import require_finite
from sketchterrain.terrain.materials import MATERIALS

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.compute import ComputeContext


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
