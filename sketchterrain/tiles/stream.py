"""Tiles for a moving camera: what to generate now, what to draw now."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.tiles.bounds import EVERYWHERE, meets
from sketchterrain.tiles.codes import children_of, keys_of, parent_of, place_of
from sketchterrain.tiles.drawn import DrawnTree, Goals
from sketchterrain.tiles.horizon import behind_ground
from sketchterrain.tiles.metrics import ScreenError, across, nearest, screen_errors
from sketchterrain.tiles.orders import Batch, DrawList
from sketchterrain.tiles.outdated import batch_of, outdate, outdated_above, rewriting, written
from sketchterrain.tiles.pool import TilePool
from sketchterrain.tiles.schedule import CostModel
from sketchterrain.tiles.wanted import ROOT_LEVEL, UNSEEN, Selection, Wanted

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from sketchterrain.tiles.codes import Codes
    from sketchterrain.tiles.metrics import Metric
    from sketchterrain.tiles.view import View

    Floats = npt.NDArray[np.float64]
    Ints = npt.NDArray[np.int64]

QUADS: Final = 64
"""Along a tile's side, unless another number is asked for."""
LATTICE_BITS: Final = 24
"""A tile of level 0 is 2^24 lattice units wide."""

_MORPH: Final = (0.85, 1.15)
"""Excess of a parent up to which its children show nothing else, and from which on nothing of it; they come
and go at 1."""
_PIXELS_A_SECOND: Final = 60.0
"""How quickly the ground may move on the screen while it morphs …"""
MORPH_SECONDS: Final = (0.2, 0.4)
"""… in so many seconds from parent to child at least and at most."""
_OF_THE_WAY: Final = 0.25
"""They take no longer than this share of the way to them does: a quick eye would be there before they are."""
_AHEAD: Final = (0.4, 1.2)
"""s; for where the eye will be then tiles are fetched beforehand, where now none is lacking."""
_PER_BATCH: Final = 64
_LEVELS_A_BATCH: Final = 2
"""Each level costs launches of its own."""
_STRICTER, _LOOSER, _MOST_RELAXED = 0.97, 1.1, 1e3
"""How the metric is relaxed when the pool is too small for the view, and back."""


class TileStream:
    """Which tiles to generate and to draw, frame by frame; it generates and draws none itself.

    Each frame: `plan` says what to generate, `arrived` takes what became of it, `advance` says what to draw.
    After a change of the ground, `change` and whenever a frame's tiles are known: `overdue` says what must be
    written anew before it is drawn.

    Parameters
    ----------
    extent : float
        Width of a tile of level 0, m.
    quads : int
        Along a tile's side: a power of two, 2 … 256.
    slots : int
        How many tiles may be held.
    finest_cell : float
        No quad is made narrower than this, m.
    metric : Metric
        Which tiles are too coarse; τ = 1 px by default.
    hide : bool
        Whether tiles that lie behind nearer ground are left out of what is drawn.
    bounds : (float, float, float, float)
        West, south, east, north (m) of the ground; beyond them no tile is drawn, and none is looked at
        closely, though one that has a brother within is generated.
    """

    def __init__(
        self,
        extent: float,
        *,
        quads: int = QUADS,
        slots: int = 1024,
        finest_cell: float = 0.2,
        metric: Metric | None = None,
        hide: bool = True,
        bounds: tuple[float, float, float, float] = EVERYWHERE,
    ) -> None:
        if quads < 2 or quads > 256 or quads & (quads - 1):
            raise InputError(f"expected quads to be a power of two, 2 … 256, got {quads}")
        if not (extent > 0 and finest_cell > 0):
            raise InputError(
                f"expected an extent and a finest cell > 0 m, got {extent:g} and {finest_cell:g}"
            )
        self.extent = extent
        self._hide = hide
        self.quads = quads
        self.metric: Metric = metric or ScreenError()
        self.pool = TilePool(slots, bounds=bounds)
        self._bounds = bounds
        self.finest = finest_level(extent, quads, finest_cell)
        self._tree = DrawnTree(None if bounds == EVERYWHERE else lambda codes: meets(codes, extent, bounds))
        self._cost = CostModel()
        self._relaxed = 1.0
        self._lacking = True
        self._complete = False
        self._wanted: tuple[tuple[Any, ...], tuple[Any, ...], Wanted] | None = None
        self._coasts = False
        self._changes = 0
        self._needed: Codes = self._tree.codes
        self._ahead = deque(_AHEAD)

    @property
    def settled(self) -> bool:
        """Whether nothing was missing or moving in the last frame."""
        return not self._lacking and not self._tree.moving

    @property
    def complete(self) -> bool:
        """Whether in the last frame's plan nothing was missing that would be seen."""
        return self._complete

    @property
    def relaxed(self) -> float:
        """How much more error than asked for is allowed because the pool is too small; 1 is none."""
        return self._relaxed

    def plan(self, view: View, *, budget: float) -> Batch:
        """Choose tiles to generate now.

        Parameters
        ----------
        view
            The camera.
        budget
            Seconds that they may take.

        Returns
        -------
        Batch
            Most visible first, then what the camera's motion leads to; empty when nothing is lacking.
        """
        # In flight the tree of the last frame does for every second one, and that one looks ahead.
        self._coasts = any(view.velocity) and not self._coasts
        wanted = self._want(view)
        outdated = self.pool.all_outdated()
        self._lacking = bool(wanted.missing.size or outdated.size)
        seen = wanted.urgency > UNSEEN
        self._complete = not seen.any()
        self._hold(view, wanted)
        codes = wanted.missing if self._complete else wanted.missing[seen]
        if not codes.size and self._coasts:
            codes = self._selection.wanted(view.after(self._ahead[0]), self.pool).missing
            self._ahead.rotate()
        room = self.pool.room()
        if wanted.missing.size > room:
            self._relaxed = min(self._relaxed * _LOOSER, _MOST_RELAXED)
        elif self._relaxed > 1 and room > self.pool.slots // 4:
            self._relaxed = max(self._relaxed * _STRICTER, 1.0)
        codes = _of_few_levels(codes)[: min(_PER_BATCH, room)]
        # What new tiles lie in comes first, and where nothing is lacking, whatever is out of date.
        renewed = outdated_above(self.pool, codes) if outdated.size and not self._complete else outdated
        renewed = renewed[:_PER_BATCH]
        codes = codes[: 0 if self._complete and renewed.size else None]
        both = np.concatenate([renewed, codes])
        both = both[: self._cost.fitting(place_of(both)[0], budget)]
        renewed, codes = both[: len(renewed)], both[len(renewed) :]
        slots = np.concatenate([self.pool.find(renewed), self.pool.take(codes)])
        return batch_of(self.pool, both, slots)

    def arrived(self, batch: Batch, facts: npt.NDArray[Any], *, seconds: float | None) -> None:
        """Take note of tiles that were generated.

        Parameters
        ----------
        batch
            As `plan` gave it.
        facts
            (n,) fields ``low``, ``high`` and ``error``, m.
        seconds
            What they took; None where that says nothing about what others will.
        """
        self.pool.describe(batch.slots, facts)
        written(self.pool, batch)
        if seconds is not None:
            self._cost.learn(np.array([key.level for key in batch.keys]), seconds)
        self._changes += 1

    def change(self, areas: Sequence[tuple[float, float, float, float]]) -> int:
        """Note that the ground is another one; return how many tiles are forgotten for it.

        What is drawn, or soon will be, is kept and written anew: before it is drawn (`overdue`), or when
        there is time (`plan`).

        Parameters
        ----------
        areas
            West, south, east and north (m); elsewhere no vertex is another one.
        """
        self._changes += 1
        return outdate(self.pool, areas, extent=self.extent, quads=self.quads, kept=np.sort(self._needed))

    def overdue(self, draws: DrawList) -> Batch:
        """Return what must be written anew, and told to `arrived`, before these tiles are drawn."""
        codes = self.pool.of(draws.slots[self.pool.outdated[draws.slots]])
        return rewriting(self.pool, codes)

    def advance(self, view: View, *, elapsed: float) -> DrawList:
        """Go on by a frame.

        Parameters
        ----------
        view
            The camera.
        elapsed
            Seconds since the last frame; infinite to let all weights arrive at once.

        Returns
        -------
        DrawList
            What to draw now.
        """
        wanted = self._want(view)
        self._tree.step(self._selection.roots(view), wanted.splits, self.pool)
        self._tree.move(self._goals(view, wanted), elapsed)
        return self.draws(view)

    def jump(self, view: View) -> None:
        """Show at once the best that what is held allows: for the first picture, and after a leap."""
        wanted = self._want(view)
        selection = self._selection
        roots = selection.roots(view)
        self._tree.jump(
            roots[self.pool.find(roots) >= 0], selection.reachable(view, wanted.splits, self.pool)
        )
        self._tree.move(self._goals(view, wanted), np.inf)

    def settle(self, view: View, generate: Callable[[Batch], npt.NDArray[Any]]) -> DrawList:
        """Generate all that a still picture wants, and return it.

        Parameters
        ----------
        view
            The camera.
        generate
            Makes a batch and returns its facts, as `arrived` takes them.
        """
        while batch := self._plan_or_relax(view):
            self.arrived(batch, generate(batch), seconds=None)
        self.jump(view)
        return self.advance(view, elapsed=np.inf)

    def _plan_or_relax(self, view: View) -> Batch:
        """Return the next batch; an empty one only where nothing is lacking."""
        batch = self.plan(view, budget=np.inf)
        while self._lacking and not batch and self._relaxed < _MOST_RELAXED:
            batch = self.plan(view, budget=np.inf)
        return batch

    @property
    def _selection(self) -> Selection:
        metric = self.metric if self._relaxed == 1 else self.metric.coarser(self._relaxed)
        return Selection(self.extent, self.quads, metric, self.finest, hide=self._hide, bounds=self._bounds)

    def _want(self, view: View) -> Wanted:
        seen = (view.eye, view.planes.tobytes(), view.draw_distance, view.pixels_per_radian)
        held = (self._changes, self._relaxed, self.pool.held, self.metric)
        known = self._wanted
        if known is None or known[1] != held or (known[0] != seen and not self._coasts):
            self._wanted = known = seen, held, self._selection.wanted(view, self.pool)
        return known[2]

    def _hold(self, view: View, wanted: Wanted) -> None:
        """Note which tiles may not go: the wanted tree, what is drawn, and all above it."""
        codes = np.unique(np.concatenate([self._selection.roots(view), self._tree.codes, wanted.splits]))
        held = codes
        while held.size:
            held = np.unique(parent_of(held[place_of(held)[0] > ROOT_LEVEL]))
            codes = np.concatenate([codes, held])
        self._needed = np.concatenate([codes, children_of(wanted.splits).ravel()])
        self.pool.use(self._needed)

    def _goals(self, view: View, wanted: Wanted) -> Goals:
        """Say how much of its parent each tile should show in its middle, by how much too coarse that is."""
        codes = self._tree.codes
        above, at = np.unique(parent_of(codes), return_inverse=True)
        excess = wanted.excess.of(above)[at]
        root = place_of(codes)[0] == ROOT_LEVEL
        weights = np.where(root, 0.0, np.clip((_MORPH[1] - excess) / (_MORPH[1] - _MORPH[0]), 0.0, 1.0))
        shown = self._seen(view, above)[at]
        seconds = np.clip(shown / _PIXELS_A_SECOND, *MORPH_SECONDS)
        speed = float(np.linalg.norm(view.velocity))
        if speed > 0:
            distance, _ = nearest(view, self.pool.boxes(codes, self.pool.find(codes), self.extent))
            seconds = np.minimum(seconds, _OF_THE_WAY * distance / speed)
        return Goals(wanted.splits, weights, 1 / seconds)

    def _seen(self, view: View, codes: Codes) -> Floats:
        """Return the screen error of tiles, 0 of those that are not held (px)."""
        slots = self.pool.find(codes)
        held = slots >= 0
        seen = np.zeros(len(codes))
        boxes = self.pool.boxes(codes[held], slots[held], self.extent)
        seen[held] = screen_errors(view, boxes, self.pool.error[slots[held]])
        return seen

    def draws(self, view: View) -> DrawList:
        """Return what to draw as the tree is; of outdated tiles all that may be seen."""
        codes = self._tree.codes
        slots = self.pool.find(codes)
        boxes = self.pool.possible_boxes(codes, slots, self.extent)
        distance, _ = across(view, boxes)
        shown = view.sees(boxes) & (distance <= view.draw_distance)
        shown &= meets(codes, self.extent, self._bounds)
        if self._hide:
            shown[shown] = ~behind_ground(view, boxes.some(shown))
        codes, slots = codes[shown], slots[shown]
        level, col, row = place_of(codes)
        width = np.int64(1) << (LATTICE_BITS - level)
        return DrawList(
            tuple(keys_of(codes)),
            slots,
            np.stack([col * width, (row + 1) * width], axis=-1),
            width // self.quads,
            self._tree.cases[shown],
            self._tree.controls[shown].astype(np.float32),
            self.pool.error[slots],
            self._seen(view, codes),
        )


def _of_few_levels(codes: Codes) -> Codes:
    """Return the tiles of those levels that come first, in their order."""
    level, _, _ = place_of(codes)
    levels, first = np.unique(level, return_index=True)
    return codes[np.isin(level, levels[np.argsort(first)[:_LEVELS_A_BATCH]])]


def finest_level(extent: float, quads: int, finest_cell: float) -> int:
    """Return the finest level whose quads are no narrower than a cell (m), as far as the lattice goes."""
    level = int(np.floor(np.log2(extent / quads / finest_cell)))
    # Errors are measured in the middles of quads, which must lie on the lattice.
    return int(np.clip(level, ROOT_LEVEL + 1, LATTICE_BITS - quads.bit_length()))
