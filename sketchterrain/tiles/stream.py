"""Tile streaming for a moving camera: which tiles to generate and to draw within a time budget."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.errors import InputError
from sketchterrain.tiles.displayed import (
    DisplayedTree,
    MorphTargets,
    create_batch,
    mark_stale,
    mark_written,
    rewrite_batch,
    with_stale_parents,
)
from sketchterrain.tiles.lod import (
    CameraView,
    ScreenError,
    eye_distances,
    horizontal_distances,
    occluded,
    screen_errors,
)
from sketchterrain.tiles.quadtree import UNBOUNDED, children_of, decode, intersects_bounds, keys_of, parent_of
from sketchterrain.tiles.refinement import ROOT_LEVEL, UNSEEN_URGENCY, TargetTree, TileSelector
from sketchterrain.tiles.tile_pool import Batch, DrawList, TilePool

_INITIAL_COST: Final = (0.0005, 0.0005, 0.0005, 0.004)
"""s per batch, level, tile and wide tile, before any measurement."""
_WIDE: Final = -2
"""Tiles of coarser levels are wide: culling takes longer over a large area."""
_HISTORY: Final = 64
_BUDGET_SHARE: Final = 0.8
"""Share of a budget that is planned."""
_COST_QUANTILE: Final = 0.97
"""Quantile of the measured costs that plans allow for."""
_MIN_SECONDS: Final = 1e-6
"""s."""


class CostModel:
    """Seconds of a batch: a constant, and costs per level in it, per tile and per wide tile.

    Fitted to the last batches by relative errors; plans allow for all but the slowest few of them.
    """

    def __init__(self) -> None:
        self._cost = np.array(_INITIAL_COST)
        self._batches: deque[tuple[npt.NDArray[np.float64], float]] = deque(maxlen=_HISTORY)
        self._slowdown = 1.0

    def expected(self, levels: Int64Array) -> float:
        """Return the expected seconds of a batch of tiles of these levels."""
        return float(_counts(levels)[-1] @ self._cost) if len(levels) else 0.0

    def count_within(self, levels: Int64Array, budget: float, *, usually: bool = False) -> int:
        """Return how many of the first tiles fit into a budget (s), at least one unless it is 0.

        They fit nearly always, or `usually`.
        """
        if not budget >= 0:
            raise InputError(f"expected a budget ≥ 0 s, got {budget:g}")
        if budget == 0 or not len(levels):
            return 0
        seconds = _counts(levels) @ self._cost * (1.0 if usually else self._slowdown)
        return max(1, int(np.searchsorted(seconds, _BUDGET_SHARE * budget, side="right")))

    def record(self, levels: Int64Array, seconds: float) -> None:
        """Record the seconds that a batch took."""
        self._batches.append((_counts(levels)[-1], max(seconds, _MIN_SECONDS)))
        counts = np.stack([each for each, _ in self._batches])
        seconds_taken = np.array([each for _, each in self._batches])
        # The previous costs count as one batch of each kind: identical batches can't separate them.
        shares = np.concatenate([counts / seconds_taken[:, None], np.diag(1.0 / self._cost)])
        fitted = np.linalg.lstsq(shares, np.ones(len(shares)), rcond=None)[0]
        self._cost = np.maximum(fitted, _MIN_SECONDS)
        self._slowdown = max(float(np.quantile(seconds_taken / (counts @ self._cost), _COST_QUANTILE)), 1.0)


def _counts(levels: Int64Array) -> npt.NDArray[np.float64]:
    """Return batches, levels, tiles and wide tiles among the first 1, 2, … n tiles: (n, 4)."""
    _, first = np.unique(levels, return_index=True)
    new = np.zeros(len(levels))
    new[first] = 1
    one = np.ones(len(levels))
    wide = np.asarray(levels) < _WIDE
    return np.stack([one, np.cumsum(new), np.cumsum(one), np.cumsum(wide)], axis=1)


QUADS: Final = 64
"""Default number of quads along a tile's side."""
LATTICE_BITS: Final = 24
"""A tile of level 0 is 2^24 lattice units wide."""

_MORPH: Final = (0.85, 1.15)
"""Excess of a parent below which its children show only it, and above which nothing of it; the limit is 1."""
_PIXELS_PER_SECOND: Final = 60.0
"""Greatest speed of the morphing surface on the screen …"""
MORPH_SECONDS: Final = (0.2, 0.4)
"""… and least and greatest duration of a transition (s)."""
_APPROACH_SHARE: Final = 0.25
"""Greatest duration as a share of the time in which the camera reaches the tile."""
_LOOKAHEAD: Final = (0.4, 1.2)
"""s ahead of the camera whose tiles are fetched when none is missing now."""
_PER_BATCH: Final = 256
_LEVELS_PER_BATCH: Final = 2
"""Each level has launches of its own."""
_MOST_BATCHES: Final = 8
"""Batches for a view at rest until its target tree is computed again."""
_TIGHTEN, _RELAX, _MAX_ERROR_FACTOR = 0.97, 1.1, 1e3
"""Factors on the tolerated error while the pool is too small for the view, and back; its upper bound."""


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
        metric: ScreenError | None = None,
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
        self.metric = metric or ScreenError()
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
        self._last_target: tuple[tuple[Any, ...], tuple[Any, ...], TargetTree] | None = None
        self._batches = 0  # since that target
        self._reuses_tree = False
        self._still = False  # what was planned last
        self._changes = 0
        self._needed: Int64Array = self._tree.codes
        self._lookahead = deque(_LOOKAHEAD)

    @property
    def converged(self) -> bool:
        """Whether nothing was missing or moving in the last frame."""
        return not self._missing and not self._tree.moving

    @property
    def has_still(self) -> bool:
        """Whether nothing visible was missing in the last frame's plan, and no tile is stale."""
        return self._complete and not self.pool.stale_tiles().size

    @property
    def complete(self) -> bool:
        """Whether nothing visible was missing in the last frame's plan."""
        return self._complete

    def plan(self, view: CameraView, *, budget: float, still: bool = False, in_sight: bool = False) -> Batch:
        """Return tiles to generate now within a budget (s); empty if none is missing.

        Most visible first, then those ahead of the camera's motion, unless only what is `in_sight` counts.
        A still needs only what it shows: see `jump`.
        """
        self._still = still
        # In motion every second frame reuses the target tree; in flight it looks ahead instead.
        turns = self._last_target is not None and self._last_target[0][0] == view.eye
        reuses = budget < np.inf and not (self._reuses_tree or still)
        self._reuses_tree = reuses and (any(view.velocity) or turns)
        target = self._target_tree(view)
        stale = self.pool.stale_tiles()
        seen = target.urgency > UNSEEN_URGENCY
        self._complete = not seen.any()
        self._protect(view, target)
        codes = target.missing[seen] if still or not self._complete else target.missing
        self._missing = bool((codes if still else target.missing).size or stale.size)
        if not codes.size and self._reuses_tree and any(view.velocity):
            codes = self._selector.target_tree(view.extrapolated(self._lookahead[0]), self.pool).missing
            self._lookahead.rotate()
        capacity = self.pool.available()
        if target.missing.size > capacity:
            self._error_factor = min(self._error_factor * _RELAX, _MAX_ERROR_FACTOR)
        elif self._error_factor > 1 and capacity > self.pool.slots // 4:
            self._error_factor = max(self._error_factor * _TIGHTEN, 1.0)
        codes = _limit_levels(codes)[: min(_PER_BATCH, capacity)]
        if self._complete:  # stale tiles first
            codes, budget = stale[:_PER_BATCH] if stale.size else codes, 0.0 if in_sight else budget
        elif stale.size:
            codes = with_stale_parents(self.pool, codes)
        count = self._cost.count_within(decode(codes)[0], budget, usually=still)
        if count and not self._complete and self.pool.find(codes[count - 1 : count])[0] >= 0:
            count += 1 if count == 1 else -1  # no parent is written without a child
        codes = codes[:count][np.argsort(decode(codes[:count])[0], kind="stable")]
        slots = self.pool.find(codes)
        slots[slots < 0] = self.pool.acquire(codes[slots < 0])
        return create_batch(self.pool, codes, slots)

    def mark_generated(self, batch: Batch, properties: npt.NDArray[Any], *, seconds: float | None) -> None:
        """Record ``low``, ``high``, ``error`` (m) of a batch, and its cost unless `seconds` is None."""
        self.pool.set_properties(batch.slots, properties)
        mark_written(self.pool, batch)
        if seconds is not None:
            self._cost.record(np.array([key.level for key in batch.keys]), seconds)
        self._batches += 1

    def invalidate(self, areas: Sequence[tuple[float, float, float, float]]) -> int:
        """Invalidate areas (west, south, east, north, m) of the terrain; return how many tiles were removed.

        Tiles in use stay and are rewritten before they are drawn (`stale_batch`), or when there is time
        (`plan`).
        """
        self._changes += 1
        return mark_stale(
            self.pool, areas, extent=self.extent, quads=self.quads, protected=np.sort(self._needed)
        )

    def stale_batch(self, draws: DrawList) -> Batch:
        """Return the tiles to rewrite, and to pass to `mark_generated`, before these are drawn."""
        codes = self.pool.codes_in(draws.slots[self.pool.stale[draws.slots]])
        return rewrite_batch(self.pool, codes)

    def advance(self, view: CameraView, *, elapsed: float) -> DrawList:
        """Advance by a frame and return what to draw; `elapsed` (s) may be infinite to finish all morphs."""
        target = self._target_tree(view)
        self._tree.step(self._selector.roots(view), target.splits, self.pool)
        self._tree.move(self._morph_targets(view, target), elapsed)
        return self.draw_list(view)

    def jump(self, view: CameraView) -> None:
        """Show the best that cached tiles allow at once: for a still, the first frame, and after a jump.

        A still's tree has tiles that are not in the picture and not cached: the next frame must jump.
        """
        target = self._target_tree(view)
        selection = self._selector
        roots = selection.roots(view)
        self._tree.jump(roots[self.pool.find(roots) >= 0], selection.reachable(view, target, self.pool))
        self._tree.move(self._morph_targets(view, target), np.inf)

    def generate_all(
        self, view: CameraView, generate: Callable[[Batch], npt.NDArray[Any]], *, still: bool = False
    ) -> DrawList:
        """Generate what a view shows, and return it; ``generate(batch)`` returns properties."""
        while batch := self._plan_or_relax(view, still=still):
            self.mark_generated(batch, generate(batch), seconds=None)
        self.jump(view)
        return self.advance(view, elapsed=np.inf)

    def _plan_or_relax(self, view: CameraView, *, still: bool) -> Batch:
        """Return the next batch; empty only if nothing is missing."""
        batch = self.plan(view, budget=np.inf, still=still)
        while self._missing and not batch and self._error_factor < _MAX_ERROR_FACTOR:
            batch = self.plan(view, budget=np.inf, still=still)
        return batch

    @property
    def _selector(self) -> TileSelector:
        metric = self.metric if self._error_factor == 1 else self.metric.relaxed(self._error_factor)
        return TileSelector(
            self.extent, self.quads, metric, self.finest, self._hide, self._bounds, self._still
        )

    def _target_tree(self, view: CameraView) -> TargetTree:
        seen = (view.eye, view.planes.tobytes(), view.draw_distance, view.pixels_per_radian)
        settings = (self._changes, self._error_factor, self.metric, self._still)
        last, count = self._last_target, self._batches
        if last is not None and last[1] == settings and (last[0] == seen or self._reuses_tree):
            if not count:
                return last[2]
            if count < _MOST_BATCHES:
                left = self.pool.find(last[2].missing) < 0
                tree = replace(last[2], missing=last[2].missing[left], urgency=last[2].urgency[left])
                if (tree.urgency > UNSEEN_URGENCY).any():  # or what is in sight may need more by now
                    return tree
        self._last_target, self._batches = (seen, settings, self._selector.target_tree(view, self.pool)), 0
        return self._last_target[2]

    def _protect(self, view: CameraView, target: TargetTree) -> None:
        """Mark tiles that must not be evicted: the target tree, the displayed one, and their ancestors."""
        codes = np.unique(np.concatenate([self._selector.roots(view), self._tree.codes, target.splits]))
        cached = codes
        while cached.size:
            cached = np.unique(parent_of(cached[decode(cached)[0] > ROOT_LEVEL]))
            codes = np.concatenate([codes, cached])
        self._needed = np.concatenate([codes, children_of(target.splits).ravel()])
        self.pool.touch(self._needed)

    def _morph_targets(self, view: CameraView, target: TargetTree) -> MorphTargets:
        """Return morph targets of the displayed tiles from the excess of their parents."""
        codes = self._tree.codes
        above, at = np.unique(parent_of(codes), return_inverse=True)
        excess = target.excess.lookup(above)[at]
        root = decode(codes)[0] == ROOT_LEVEL
        weights = np.where(root, 0.0, np.clip((_MORPH[1] - excess) / (_MORPH[1] - _MORPH[0]), 0.0, 1.0))
        visible = self._screen_error(view, above)[at]
        seconds = np.clip(visible / _PIXELS_PER_SECOND, *MORPH_SECONDS)
        speed = float(np.linalg.norm(view.velocity))
        if speed > 0:
            distance, _ = eye_distances(view, self.pool.boxes(codes, self.pool.find(codes), self.extent))
            seconds = np.minimum(seconds, _APPROACH_SHARE * distance / speed)
        return MorphTargets(target.splits, weights, 1 / seconds)

    def _screen_error(self, view: CameraView, codes: Int64Array) -> Float64Array:
        """Return the screen error (px) of tiles, 0 if not cached."""
        slots = self.pool.find(codes)
        cached = slots >= 0
        seen = np.zeros(len(codes))
        boxes = self.pool.boxes(codes[cached], slots[cached], self.extent)
        seen[cached] = screen_errors(view, boxes, self.pool.error[slots[cached]])
        return seen

    def draw_list(self, view: CameraView) -> DrawList:
        """Return what to draw of the displayed tree; every stale tile that may be visible."""
        slots = self.pool.find(self._tree.codes)
        cached = slots >= 0
        codes, slots = self._tree.codes[cached], slots[cached]
        boxes = self.pool.conservative_boxes(codes, slots, self.extent)
        distance, _ = horizontal_distances(view, boxes)
        visible = view.sees(boxes) & (distance <= view.draw_distance)
        visible &= intersects_bounds(codes, self.extent, self._bounds)
        if self._hide:
            visible[visible] = ~occluded(view, boxes.subset(visible))
        codes, slots = codes[visible], slots[visible]
        level, col, row = decode(codes)
        width = np.int64(1) << (LATTICE_BITS - level)
        return DrawList(
            tuple(keys_of(codes)),
            slots,
            np.stack([col * width, (row + 1) * width], axis=-1),
            width // self.quads,
            self._tree.cases[cached][visible],
            self._tree.controls[cached][visible].astype(np.float32),
            self.pool.error[slots],
            self._screen_error(view, codes),
        )


def _limit_levels(codes: Int64Array) -> Int64Array:
    """Return the tiles of the levels that come first, in their order."""
    level, _, _ = decode(codes)
    levels, first = np.unique(level, return_index=True)
    return codes[np.isin(level, levels[np.argsort(first)[:_LEVELS_PER_BATCH]])]


def finest_level(extent: float, quads: int, finest_cell: float) -> int:
    """Return the finest level whose quads are no narrower than a cell (m), within the lattice."""
    level = int(np.floor(np.log2(extent / quads / finest_cell)))
    # Errors are measured at the centres of quads, which must be on the lattice.
    return int(np.clip(level, ROOT_LEVEL + 1, LATTICE_BITS - quads.bit_length()))
