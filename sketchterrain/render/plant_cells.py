"""Cells of plant instances around the eye."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sketchterrain.look.tree_levels import VARIANTS, plant_chances, plant_variants
from sketchterrain.look.tree_species import HEIGHTS
from sketchterrain.render.budgets import WorkRate
from sketchterrain.render.plant_meshes import bulk_of, hold_of, whim_of

if TYPE_CHECKING:
    from collections.abc import Generator, Sequence

    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array
    from sketchterrain.render.budgets import TimeBudget
    from sketchterrain.render.scene import TerrainSource


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


KEPT: Final = 640
"""Cells that are held at most."""
ROOM: Final = 12.0
"""m about a plant's foot that its crown may take."""
FADE: Final = 0.55
"""Share of the reach from which on plants are thinned out, to end in a seam that nobody sees."""

TOUCHED: Final = 300.0
"""m from where the ground changes within which plants may be others: they keep their distances."""

Place = tuple[int, int]


@dataclass
class Cell:
    """The plants of one cell.

    Attributes
    ----------
    corner : (2,) float64
        South-west, m.
    stand : Stand
        Its plants.
    low, high : float
        Bounds of all they fill (m).
    age : float
        Seconds since they were made.
    new : (n,) bool or None
        Which of them came then, the others stood there before; None: all.
    version : int
        Of the terrain they were made for; see `PlantCells.change`.
    outdated : bool
        Whether they may be others by now.
    """

    corner: Float64Array
    stand: Stand
    low: float
    high: float
    age: float = 0.0
    new: npt.NDArray[np.bool_] | None = None
    version: int = 0
    outdated: bool = False

    def ages(self, count: int) -> npt.NDArray[np.float32]:
        """Return the ages of the first plants (s), of those that stood there before without end."""
        if self.new is None:
            return np.full(count, self.age, np.float32)
        return np.where(self.new[:count], np.float32(self.age), np.float32(np.inf))

    def held(self, eye: tuple[float, float, float], angle: float) -> int:
        """Return how many of its first plants may be above an angle (rad) for an eye (m), see `hold_of`."""
        x, y = np.maximum(np.abs(self.corner + 0.5 * CELL - eye[:2]) - 0.5 * CELL, 0.0).tolist()
        z = max(eye[2] - self.high, self.low - eye[2], 0.0)
        nearest = max(math.hypot(x, y, z), 1.0)
        return int(np.searchsorted(-self.stand.hold, -angle * nearest, side="right"))


class PlantCells:
    """The cells that were made.

    Parameters
    ----------
    terrain
        Whose plants.
    """

    def __init__(self, terrain: TerrainSource) -> None:
        self._terrain = terrain
        self._made: dict[Place, Cell] = {}  # least recently wanted first
        self._wanted: list[Place] = []
        self._job: tuple[Place, Generator[None, None, npt.NDArray[np.void]]] | None = None
        self._step = 0
        self._version = self._begun = 0
        self._paces: list[WorkRate] = []
        self.changes = 0
        """Counts the cells that came."""

    @property
    def complete(self) -> bool:
        """Whether all cells that were asked for last are made."""
        return not self._missing()

    @property
    def youngest(self) -> float:
        """Least age (s) of the cells that were asked for last."""
        return min((self._made[place].age for place in self._wanted if place in self._made), default=np.inf)

    def __getitem__(self, place: Place) -> Cell | None:
        return self._made.get(place)

    def want(self, places: Sequence[Place]) -> None:
        """Say which cells are needed, the most urgent one first."""
        self._wanted = list(places)
        for place in reversed(self._wanted):
            if place in self._made:
                self._made[place] = self._made.pop(place)
        for place in list(self._made)[: max(len(self._made) - KEPT, 0)]:
            del self._made[place]

    def change(self, terrain: TerrainSource, areas: Sequence[tuple[float, float, float, float]]) -> None:
        """Show the plants of another terrain from now on.

        Those that are wanted stay until others are made in their place, the rest is forgotten.

        Parameters
        ----------
        terrain
            The other one.
        areas
            West, south, east, north (m): farther than `TOUCHED` from them every plant is the same.
        """
        self._terrain = terrain
        self._version += 1
        wanted = set(self._wanted)
        for place in [place for place in self._made if _near_any(place, areas)]:
            if place in wanted:
                self._made[place].outdated = True
            else:
                del self._made[place]
        up_to_date = self._begun == self._version - 1
        if self._job is not None and up_to_date and not _near_any(self._job[0], areas):
            self._begun = self._version

    def grow(self, elapsed: float) -> None:
        """Let all cells grow older (s)."""
        for cell in self._made.values():
            cell.age += elapsed

    def go_on(self, allowance: TimeBudget) -> None:
        """Make what an allowance allows."""
        while True:
            if self._job is None:
                missing = self._missing()
                if not missing:
                    return
                self._job, self._step = (missing[0], self._begin(missing[0])), 0
                self._begun = self._version
            while len(self._paces) <= self._step:
                self._paces.append(WorkRate(0.004))
            pace = self._paces[self._step]
            if not pace.steps_within(allowance):
                return
            before = allowance.spent
            place, steps = self._job
            try:
                next(steps)
                self._step += 1
            except StopIteration as end:
                self._put(place, end.value)
                self._job = None
            pace.record(1, allowance.spent - before)

    def finish(self) -> None:
        """Make all that is missing at once; it does not grow in any more."""
        self._job, self._begun = None, self._version
        missing = np.array(self._missing(), dtype=np.int64).reshape(-1, 2)
        if len(missing):
            low, high = missing.min(axis=0), missing.max(axis=0) + 1
            west, south = (CELL * low).tolist()
            east, north = (CELL * high).tolist()
            plants = self._terrain.foliage(west, south, east, north)
            col, row = (np.floor(plants[axis] / CELL).astype(np.int64) for axis in ("x", "y"))
            for place in missing.tolist():
                self._put((place[0], place[1]), plants[(col == place[0]) & (row == place[1])])
        for cell in self._made.values():
            cell.age = np.inf

    def _missing(self) -> list[Place]:
        """Return what is to be made: what is not there, then what is outdated, for the longest time first."""
        lacking = [place for place in self._wanted if place not in self._made]
        old = [place for place in self._wanted if place in self._made and self._made[place].outdated]
        return lacking + sorted(old, key=lambda place: self._made[place].version)

    def _begin(self, place: Place) -> Generator[None, None, npt.NDArray[np.void]]:
        col, row = place
        return self._terrain.foliage_steps(CELL * col, CELL * row, CELL * (col + 1), CELL * (row + 1))

    def _put(self, place: Place, plants: npt.NDArray[np.void]) -> None:
        corner = CELL * np.array(place, dtype=np.float64)
        stand = stand_of(plants, corner)
        top = stand.place[:, 2] + stand.tall
        low, high = (float(stand.place[:, 2].min()), float(top.max())) if len(top) else (0.0, 0.0)
        before = self._made.get(place)
        new = None if before is None else ~np.isin(_names(stand), _names(before.stand))
        # What the ground's next change found half made is right for the one before.
        outdated = self._begun != self._version
        self._made[place] = Cell(corner, stand, low, high, new=new, version=self._begun, outdated=outdated)
        self.changes += 1


def _names(stand: Stand) -> npt.NDArray[np.uint64]:
    """Return a number for each plant that tells it from the others of its cell: its place and its kind."""
    place = np.ascontiguousarray(stand.rows[:, :2]).view(np.uint64)[:, 0]
    return np.asarray(place * np.uint64(0x9E3779B97F4A7C15) + stand.kind.astype(np.uint64))


def _near_any(place: Place, areas: Sequence[tuple[float, float, float, float]]) -> bool:
    """Tell whether plants of a cell may depend on the ground in some areas (m)."""
    west, south = (CELL * axis - TOUCHED for axis in place)
    east, north = (CELL * (axis + 1) + TOUCHED for axis in place)
    return any(w <= east and e >= west and s <= north and n >= south for w, s, e, n in areas)


def in_view(planes: Float64Array, places: Sequence[Place], bounds: Float64Array) -> npt.NDArray[np.bool_]:
    """Tell which cells a view may show.

    Parameters
    ----------
    planes
        (k, 4) of the view, see `Camera.frustum`.
    places
        The cells.
    bounds
        (n, 2) lowest and highest point of what stands in them (m).
    """
    corner = CELL * np.array(places, dtype=np.float64).reshape(-1, 2)
    low = np.concatenate([corner - ROOM, bounds[:, :1]], axis=1)
    high = np.concatenate([corner + CELL + ROOM, bounds[:, 1:]], axis=1)
    inside = np.ones(len(corner), dtype=np.bool_)
    for plane in planes:
        normal = plane[:3]
        inside &= np.where(normal >= 0.0, high, low) @ normal + plane[3] >= 0.0
    return inside


def cells_near(x: float, y: float, reach: float) -> list[Place]:
    """Return the cells that lie within a distance (m) of a place, nearest first."""
    col = np.arange(np.floor((x - reach) / CELL), np.floor((x + reach) / CELL) + 1)
    row = np.arange(np.floor((y - reach) / CELL), np.floor((y + reach) / CELL) + 1)
    cols, rows = (each.ravel() for each in np.meshgrid(col, row))
    away = np.hypot(
        np.maximum(np.abs(CELL * (cols + 0.5) - x) - CELL / 2, 0.0),
        np.maximum(np.abs(CELL * (rows + 0.5) - y) - CELL / 2, 0.0),
    )
    order = np.argsort(away, kind="stable")
    order = order[away[order] < reach]
    return [(int(c), int(r)) for c, r in zip(cols[order], rows[order], strict=True)]


def reach_of(whim: npt.NDArray[np.float32], reach: float) -> Float64Array:
    """Return the distances (m) at which plants go, if the last of all go at `reach`."""
    return np.asarray(reach * (FADE + (1.0 - FADE) * whim), dtype=np.float64)


def joined(cells: Sequence[Cell], origin: Float64Array, counts: Sequence[int] | None = None) -> Stand:
    """Join the plants of cells: x and y from `origin` (m) instead of from each cell's corner.

    With `counts`, only so many of each, the first ones.
    """
    offsets = np.array([cell.corner - origin for cell in cells])
    return joined_stands([cell.stand for cell in cells], offsets, counts)
