"""Plants of a place as arrays, in the order in which they stay where they are thinned out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sketchterrain.look.plant_variants import plant_chances, plant_variants
from sketchterrain.look.tree_levels import VARIANTS
from sketchterrain.look.tree_species import HEIGHTS
from sketchterrain.render.thinning import bulk_of, hold_of, whim_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array


CELL: Final = 256.0
"""m. Smaller ones take as long, larger ones longer than a frame can spare."""
SINK: Final = 0.15
"""m; feet go so far into the ground."""
PATCH: Final = 32.0
"""m; side of the squares in which neighbours are counted."""
DENSE: Final = 0.02
"""Trees on a square metre of dense forest."""
LOW: Final = 3.5
"""m; lower plants shade no others."""


class Stand(NamedTuple):
    """Plants as arrays; those that stay longest where plants are thinned out come first.

    Attributes
    ----------
    rows : (n, 8) float32
        Foot, x and y from the cell's south-west corner (m), height (m), cosine and sine of the rotation,
        temper: crowding 0..15 + tint 0..1; the last is free.
    whim : (n,) float32
        Share of plants that go before it does, see `thinning`.
    bulk, hold : (n,) float32
        See `bulk_of` and `hold_of` (m).
    kind : (n,) uint8
        species · variants + variant
    """

    rows: npt.NDArray[np.float32]
    whim: npt.NDArray[np.float32]
    bulk: npt.NDArray[np.float32]
    hold: npt.NDArray[np.float32]
    kind: npt.NDArray[np.uint8]

    def some(self, index: npt.NDArray[np.intp]) -> Stand:
        """Return some of them."""
        rows, whim, bulk, hold, kind = self
        return Stand(rows[index], whim[index], bulk[index], hold[index], kind[index])

    @property
    def place(self) -> npt.NDArray[np.float32]:
        """(n, 3) feet (m)."""
        return self.rows[:, :3]

    @property
    def tall(self) -> npt.NDArray[np.float32]:
        """(n,) heights (m)."""
        return self.rows[:, 3]


def stand_of(plants: npt.NDArray[np.void], corner: Float64Array) -> Stand:
    """Return the plants (`PLANT`) of the cell with a south-west corner (m)."""
    place = np.stack([plants["x"] - corner[0], plants["y"] - corner[1], plants["z"] - SINK], axis=1)
    chance, second = plant_chances(plants)
    whim = whim_of(plants["level"], chance)
    tall = np.asarray(HEIGHTS)[plants["species"]] * plants["scale"]
    crowding = _crowding(place, tall)
    bulk = bulk_of(tall, crowding)
    hold = hold_of(bulk, whim)
    rows = np.zeros((len(plants), 8), np.float32)
    rows[:, :3], rows[:, 3] = place, tall
    rows[:, 4], rows[:, 5] = np.cos(plants["rotation"]), np.sin(plants["rotation"])
    rows[:, 6] = np.floor(15.0 * crowding) + 0.998 * plants["tint"]
    kind = plants["species"] * VARIANTS + plant_variants(second)
    order = np.argsort(-hold, kind="stable")
    single = [array.astype(np.float32)[order] for array in (whim, bulk, hold)]
    return Stand(rows[order], single[0], single[1], single[2], kind.astype(np.uint8)[order])


def joined_stands(
    stands: Sequence[Stand], offsets: Float64Array, counts: Sequence[int] | None = None
) -> Stand:
    """Join plants that are counted from different corners.

    Parameters
    ----------
    stands
    offsets
        (n, 2) of each one's corner from the common one (m).
    counts
        How many of each are taken, the first ones; all by default.
    """
    if not stands:
        return _EMPTY
    many = [len(stand.kind) for stand in stands] if counts is None else list(counts)
    parts = [[array[:count] for array in stand] for stand, count in zip(stands, many, strict=True)]
    whole = Stand(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
    whole.rows[:, :2] += np.repeat(offsets.astype(np.float32), many, axis=0)
    return whole


def _crowding(place: Float64Array, tall: Float64Array) -> Float64Array:
    """Tell how much other trees shade each plant, 0 alone … 1 in a dense forest."""
    trees = np.where(tall > LOW, 1.0, 0.0)
    column, row = np.clip(np.floor(place[:, :2] / PATCH), 0, CELL // PATCH - 1).astype(np.int64).T
    at = column + int(CELL / PATCH) * row
    many = np.bincount(at, trees, minlength=int(CELL / PATCH) ** 2)
    return np.asarray(np.clip((many[at] - 1.0) / (DENSE * PATCH**2), 0.0, 1.0))


_EMPTY: Final = Stand(
    np.zeros((0, 8), np.float32),
    np.zeros(0, np.float32),
    np.zeros(0, np.float32),
    np.zeros(0, np.float32),
    np.zeros(0, np.uint8),
)
