"""Tile streaming for a moving camera."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.tiles.displayed import (
    DisplayedTree,
    MorphTargets,
    create_batch,
    mark_stale,
    mark_written,
    rewrite_batch,
    stale_ancestors,
)
from sketchterrain.tiles.lod import ScreenError, eye_distances, horizontal_distances, occluded, screen_errors
from sketchterrain.tiles.quadtree import UNBOUNDED, children_of, decode, intersects_bounds, keys_of, parent_of
from sketchterrain.tiles.refinement import ROOT_LEVEL, UNSEEN_URGENCY, TargetTree, TileSelector
from sketchterrain.tiles.tile_pool import Batch, DrawList, TilePool

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array, Int64Array
    from sketchterrain.tiles.lod import CameraView, Metric


_FIRST_GUESS: Final = (0.0005, 0.0005, 0.0005, 0.004)
"""s a batch, a level, a tile and a wide tile, before anything is known."""
_WIDE: Final = -2
"""Tiles of coarser levels are wide: so much of the world takes longer to look through."""
_REMEMBERED: Final = 64
_AIM: Final = 0.8
"""Share of a budget that is planned with."""
_CAUTION: Final = 0.97
"""Share of what was remembered that stayed below what is planned with."""
_LEAST: Final = 1e-6
"""s."""


class CostModel:
    """Seconds of a batch: a constant, and costs per level in it, per tile and per wide tile.

    Fitted to the last batches by relative errors; plans allow for all but the slowest few of them.
    """

    def __init__(self) -> None:
        self._cost = np.array(_FIRST_GUESS)
        self._seen: deque[tuple[npt.NDArray[np.float64], float]] = deque(maxlen=_REMEMBERED)
        self._slow = 1.0

    def expected(self, levels: Int64Array) -> float:
        """Return the expected seconds of a batch of tiles of these levels."""
        return float(_counts(levels)[-1] @ self._cost) if len(levels) else 0.0

    def count_within(self, levels: Int64Array, budget: float) -> int:
        """Return how many of the first tiles fit into a budget (s); at least one unless it is 0."""
        if not budget >= 0:
            raise InputError(f"expected a budget ≥ 0 s, got {budget:g}")
        if budget == 0 or not len(levels):
            return 0
        seconds = _counts(levels) @ self._cost * self._slow
        return max(1, int(np.searchsorted(seconds, _AIM * budget, side="right")))

    def record(self, levels: Int64Array, seconds: float) -> None:
        """Record the seconds that a batch took."""
        self._seen.append((_counts(levels)[-1], max(seconds, _LEAST)))
        counts = np.stack([each for each, _ in self._seen])
        took = np.array([each for _, each in self._seen])
        # What was known counts as one batch of each kind: batches that are all alike can't tell them apart.
        shares = np.concatenate([counts / took[:, None], np.diag(1.0 / self._cost)])
        fitted = np.linalg.lstsq(shares, np.ones(len(shares)), rcond=None)[0]
        self._cost = np.maximum(fitted, _LEAST)
        self._slow = max(float(np.quantile(took / (counts @ self._cost), _CAUTION)), 1.0)


def _counts(levels: Int64Array) -> npt.NDArray[np.float64]:
    """Return batches, levels, tiles and wide tiles among the first 1, 2, … n tiles: (n, 4)."""
    _, first = np.unique(levels, return_index=True)
    new = np.zeros(len(levels))
    new[first] = 1
    one = np.ones(len(levels))
    wide = np.asarray(levels) < _WIDE
    return np.stack([one, np.cumsum(new), np.cumsum(one), np.cumsum(wide)], axis=1)


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
    """Selects the tiles to generate and to draw, frame by frame; does neither itself.

    Each frame: `plan` returns what to generate, `mark_generated` records the result, `advance` returns what
    to draw. After a change of the terrain call `invalidate`, and per frame `stale_batch`: tiles to rewrite
    before they are drawn.

    `extent` is the width (m) of a tile of level 0, `quads` a power of two, 2 … 256, along a tile's side,
    `slots` the capacity of the pool, `finest_cell` the least width (m) of a quad; `hide` culls tiles behind
    nearer terrain. No tile beyond `bounds` (west, south, east, north, m) is drawn or refined, though one with
    a sibling inside is generated.
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
        bounds: tuple[float, float, float, float] = UNBOUNDED,
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
        self._tree = DisplayedTree(
            None if bounds == UNBOUNDED else lambda codes: intersects_bounds(codes, extent, bounds)
        )
        self._cost = CostModel()
        self._error_factor = 1.0
        self._missing = True
        self._complete = False
        self._wanted: tuple[tuple[Any, ...], tuple[Any, ...], TargetTree] | None = None
        self._reuses_tree = False
        self._changes = 0
        self._needed: Int64Array = self._tree.codes
        self._ahead = deque(_AHEAD)

    @property
    def converged(self) -> bool:
        """Whether nothing was missing or moving in the last frame."""
        return not self._missing and not self._tree.moving

    @property
    def complete(self) -> bool:
        """Whether nothing visible was missing in the last frame's plan."""
        return self._complete

    @property
    def error_factor(self) -> float:
        """Factor on the tolerated error while the pool is too small for the view; normally 1."""
        return self._error_factor

    def plan(self, view: CameraView, *, budget: float) -> Batch:
        """Return tiles to generate now within a budget (s); empty if none is missing.

        Most visible first, then those ahead of the camera's motion.
        """
        # In flight the tree of the last frame does for every second one, and that one looks ahead.
        self._reuses_tree = any(view.velocity) and not self._reuses_tree
        wanted = self._target(view)
        stale = self.pool.stale_tiles()
        self._missing = bool(wanted.missing.size or stale.size)
        seen = wanted.urgency > UNSEEN_URGENCY
        self._complete = not seen.any()
        self._protect(view, wanted)
        codes = wanted.missing if self._complete else wanted.missing[seen]
        if not codes.size and self._reuses_tree:
            codes = self._selector.wanted(view.extrapolated(self._ahead[0]), self.pool).missing
            self._ahead.rotate()
        room = self.pool.available()
        if wanted.missing.size > room:
            self._error_factor = min(self._error_factor * _LOOSER, _MOST_RELAXED)
        elif self._error_factor > 1 and room > self.pool.slots // 4:
            self._error_factor = max(self._error_factor * _STRICTER, 1.0)
        codes = _of_few_levels(codes)[: min(_PER_BATCH, room)]
        # What new tiles lie in comes first, and where nothing is lacking, whatever is out of date.
        renewed = stale_ancestors(self.pool, codes) if stale.size and not self._complete else stale
        renewed = renewed[:_PER_BATCH]
        codes = codes[: 0 if self._complete and renewed.size else None]
        both = np.concatenate([renewed, codes])
        both = both[: self._cost.count_within(decode(both)[0], budget)]
        renewed, codes = both[: len(renewed)], both[len(renewed) :]
        slots = np.concatenate([self.pool.find(renewed), self.pool.acquire(codes)])
        return create_batch(self.pool, both, slots)

    def mark_generated(self, batch: Batch, facts: npt.NDArray[Any], *, seconds: float | None) -> None:
        """Record ``low``, ``high``, ``error`` (m) of a batch, and its cost unless `seconds` is None."""
        self.pool.set_properties(batch.slots, facts)
        mark_written(self.pool, batch)
        if seconds is not None:
            self._cost.record(np.array([key.level for key in batch.keys]), seconds)
        self._changes += 1

    def invalidate(self, areas: Sequence[tuple[float, float, float, float]]) -> int:
        """Invalidate areas (west, south, east, north, m) of the terrain; return how many tiles were removed.

        Tiles in use stay and are rewritten before they are drawn (`stale_batch`), or when there is time
        (`plan`).
        """
        self._changes += 1
        return mark_stale(self.pool, areas, extent=self.extent, quads=self.quads, kept=np.sort(self._needed))

    def stale_batch(self, draws: DrawList) -> Batch:
        """Return the tiles to rewrite, and to pass to `mark_generated`, before these are drawn."""
        codes = self.pool.codes_in(draws.slots[self.pool.stale[draws.slots]])
        return rewrite_batch(self.pool, codes)

    def advance(self, view: CameraView, *, elapsed: float) -> DrawList:
        """Advance by a frame and return what to draw; `elapsed` (s) may be infinite to finish all morphs."""
        wanted = self._target(view)
        self._tree.step(self._selector.roots(view), wanted.splits, self.pool)
        self._tree.move(self._goals(view, wanted), elapsed)
        return self.draw_list(view)

    def jump(self, view: CameraView) -> None:
        """Show the best that cached tiles allow at once: for the first frame, and after a jump."""
        wanted = self._target(view)
        selection = self._selector
        roots = selection.roots(view)
        self._tree.jump(
            roots[self.pool.find(roots) >= 0], selection.reachable(view, wanted.splits, self.pool)
        )
        self._tree.move(self._goals(view, wanted), np.inf)

    def generate_all(self, view: CameraView, generate: Callable[[Batch], npt.NDArray[Any]]) -> DrawList:
        """Generate all tiles of a still view and return them; ``generate(batch)`` returns properties."""
        while batch := self._plan_or_relax(view):
            self.mark_generated(batch, generate(batch), seconds=None)
        self.jump(view)
        return self.advance(view, elapsed=np.inf)

    def _plan_or_relax(self, view: CameraView) -> Batch:
        """Return the next batch; empty only if nothing is missing."""
        batch = self.plan(view, budget=np.inf)
        while self._missing and not batch and self._error_factor < _MOST_RELAXED:
            batch = self.plan(view, budget=np.inf)
        return batch

    @property
    def _selector(self) -> TileSelector:
        metric = self.metric if self._error_factor == 1 else self.metric.relaxed(self._error_factor)
        return TileSelector(
            self.extent, self.quads, metric, self.finest, hide=self._hide, bounds=self._bounds
        )

    def _target(self, view: CameraView) -> TargetTree:
        seen = (view.eye, view.planes.tobytes(), view.draw_distance, view.pixels_per_radian)
        held = (self._changes, self._error_factor, self.pool.count, self.metric)
        known = self._wanted
        if known is None or known[1] != held or (known[0] != seen and not self._reuses_tree):
            self._wanted = known = seen, held, self._selector.wanted(view, self.pool)
        return known[2]

    def _protect(self, view: CameraView, wanted: TargetTree) -> None:
        """Mark tiles that must not be evicted: the target tree, the displayed one, and their ancestors."""
        codes = np.unique(np.concatenate([self._selector.roots(view), self._tree.codes, wanted.splits]))
        held = codes
        while held.size:
            held = np.unique(parent_of(held[decode(held)[0] > ROOT_LEVEL]))
            codes = np.concatenate([codes, held])
        self._needed = np.concatenate([codes, children_of(wanted.splits).ravel()])
        self.pool.touch(self._needed)

    def _goals(self, view: CameraView, wanted: TargetTree) -> MorphTargets:
        """Return morph targets of the displayed tiles from the excess of their parents."""
        codes = self._tree.codes
        above, at = np.unique(parent_of(codes), return_inverse=True)
        excess = wanted.excess.lookup(above)[at]
        root = decode(codes)[0] == ROOT_LEVEL
        weights = np.where(root, 0.0, np.clip((_MORPH[1] - excess) / (_MORPH[1] - _MORPH[0]), 0.0, 1.0))
        shown = self._seen(view, above)[at]
        seconds = np.clip(shown / _PIXELS_A_SECOND, *MORPH_SECONDS)
        speed = float(np.linalg.norm(view.velocity))
        if speed > 0:
            distance, _ = eye_distances(view, self.pool.boxes(codes, self.pool.find(codes), self.extent))
            seconds = np.minimum(seconds, _OF_THE_WAY * distance / speed)
        return MorphTargets(wanted.splits, weights, 1 / seconds)

    def _seen(self, view: CameraView, codes: Int64Array) -> Float64Array:
        """Return the screen error (px) of tiles, 0 if not cached."""
        slots = self.pool.find(codes)
        held = slots >= 0
        seen = np.zeros(len(codes))
        boxes = self.pool.boxes(codes[held], slots[held], self.extent)
        seen[held] = screen_errors(view, boxes, self.pool.error[slots[held]])
        return seen

    def draw_list(self, view: CameraView) -> DrawList:
        """Return what to draw of the displayed tree; every stale tile that may be visible."""
        codes = self._tree.codes
        slots = self.pool.find(codes)
        boxes = self.pool.conservative_boxes(codes, slots, self.extent)
        distance, _ = horizontal_distances(view, boxes)
        shown = view.sees(boxes) & (distance <= view.draw_distance)
        shown &= intersects_bounds(codes, self.extent, self._bounds)
        if self._hide:
            shown[shown] = ~occluded(view, boxes.subset(shown))
        codes, slots = codes[shown], slots[shown]
        level, col, row = decode(codes)
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


def _of_few_levels(codes: Int64Array) -> Int64Array:
    """Return the tiles of the levels that come first, in their order."""
    level, _, _ = decode(codes)
    levels, first = np.unique(level, return_index=True)
    return codes[np.isin(level, levels[np.argsort(first)[:_LEVELS_A_BATCH]])]


def finest_level(extent: float, quads: int, finest_cell: float) -> int:
    """Return the finest level whose quads are no narrower than a cell (m), within the lattice."""
    level = int(np.floor(np.log2(extent / quads / finest_cell)))
    # Errors are measured in the middles of quads, which must lie on the lattice.
    return int(np.clip(level, ROOT_LEVEL + 1, LATTICE_BITS - quads.bit_length()))
