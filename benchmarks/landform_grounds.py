"""Grounds to compare: painted sketches drained on other rasters, and with other solvers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from scipy import ndimage

from sketchterrain.array_types import BoolArray, Float64Array
from sketchterrain.benchmarks.timing import lap
from sketchterrain.document.sketch import Sketch
from sketchterrain.generation.building import make_recipe
from sketchterrain.geometry.lattice import to_lattice
from sketchterrain.landforms import drainage
from sketchterrain.landforms.drainage import BARE_ROUNDS, DrainageInput, Drained
from sketchterrain.landforms.mesh import SITE_BITS
from sketchterrain.landforms.node_raster import DrainedRaster, PaintedNodes
from sketchterrain.landforms.painted_uplift import (
    PaintedUplift,
    drain_painted,
    height_without,
    painted_uplift,
)
from sketchterrain.landforms.placement.placement import place
from sketchterrain.landforms.relief_fields import UnpaintedSettings
from sketchterrain.landforms.unpainted import UnpaintedGround
from sketchterrain.landforms.uplift import UpliftFeatures, painted_outline, uplift_features
from sketchterrain.landforms.wetness import wetness
from sketchterrain.stages.runner import Runner
from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.layers.relief import ReliefLayer, UnpaintedNodes

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext

SEED = 23
"""Of painted sketches and strokes."""
EXTENT, PIXELS, CELL, CELLS = 7680.0, 512, 30.0, 256
"""Of painted sketches, m and px; cells (m) in which they are judged, and their number along a side."""
BRUSH = PIXELS / 20
"""Radius (px): a tenth of the sketch is the width of the default brush."""
PAINTED = ("mountain", "hill")

# Of fastscapelib: years a step, steps, K (m^0.25 a year); the area's exponent is the program's.
_YEARS, _STEPS, _K, _AREA = 2e5, 25, 2e-5, 0.375

_LAPS = 3

_Result = TypeVar("_Result")


def painted_sketch(number: int) -> Sketch:
    """Return a random painted sketch: a range, two mountains and three hills, as high as a brush is wide."""
    rng = np.random.default_rng([SEED, number])
    images = {name: np.zeros((PIXELS, PIXELS), np.uint8) for name in ("mountain", "hill")}
    for name, count in (("mountain", 12), ("mountain", 1), ("mountain", 2), *[("hill", 2)] * 3):
        at, turn = rng.uniform(0.15, 0.85, 2) * PIXELS, rng.uniform(0.0, 2.0 * np.pi)
        for _ in range(count):
            images[name][dab(at, BRUSH * rng.uniform(0.7, 1.5))] = 1
            turn += rng.normal(0.0, 0.5)
            at = at + BRUSH * np.array([np.sin(turn), np.cos(turn)])
            if at.min() < 0.1 * PIXELS or at.max() > 0.9 * PIXELS:
                turn += 0.5 * np.pi
                at = np.clip(at, 0.1 * PIXELS, 0.9 * PIXELS)
    images["hill"][images["mountain"] > 0] = 0
    radius = BRUSH * EXTENT / PIXELS
    labels = {("mountain", 1): {"height": radius}, ("hill", 1): {"height": 0.25 * radius}}
    return Sketch(extent=EXTENT, seed=number, fidelity=0.8, layers=images, labels=labels)


def dab(at: Float64Array, radius: float, *, flat: float = 1.0) -> BoolArray:
    """Return an ellipse of pixels, `flat` times as wide as high."""
    down, across = np.mgrid[:PIXELS, :PIXELS] + 0.5
    return np.asarray(np.hypot(down - at[0], (across - at[1]) / flat) <= radius)


# Realism against time and adherence -----------------------------------------------------------------------


class _WideGround(UnpaintedGround):
    """Unpainted ground whose painted region spans so many nodes of a sketch, with a margin of cells."""

    def __init__(self, settings: UnpaintedSettings, nodes: int) -> None:
        super().__init__(settings)
        self._last = (nodes - 1) >> SITE_BITS

    @cached_property
    def painted_sites(self) -> tuple[tuple[int, int], ...]:
        """Sites of the cells that overlap the sketch, and some more."""
        span = range(-1, self._last + 2)
        return tuple((column, row) for column in span for row in span)


@dataclass(frozen=True, eq=False)
class DrainedSketch:
    """A painted sketch drained on a raster of any spacing, without rivers; levels are coarsest first."""

    sketch: Sketch
    settings: UnpaintedSettings
    features: UpliftFeatures
    plain: DrainageInput
    bare: Sequence[Drained]
    uplift: PaintedUplift
    drained: Sequence[Drained]
    carved: Drained  # level 0 without barriers
    factors: Float64Array
    seconds: float

    @property
    def spacing(self) -> float:
        """Metres between nodes of level 0."""
        return self.settings.spacing

    def read(self, nodes: Float64Array, cell: float, level: int = 0) -> Float64Array:
        """Return values of a level's nodes at the middles of the sketch's cells, row 0 in the north."""
        spacing = self.spacing * 2**level
        middle = (np.arange(round(EXTENT / cell)) + 0.5) * cell / spacing
        row, column = self.uplift.ground[-1 - level].origin
        at = np.meshgrid(middle[::-1] - row, middle - column, indexing="ij")
        known = np.where(np.isnan(nodes), 0.0, nodes)
        return np.asarray(ndimage.map_coordinates(known, at, order=2, mode="nearest", prefilter=False))

    def heights(self, cell: float = CELL, level: int = 0) -> Float64Array:
        """Return heights (m) of a level over the sketch, row 0 in the north."""
        drained = self.drained[-1 - level] if level else self.carved
        return self.read(drained.height, cell, level)

    def evaluated(self, context: ComputeContext, height: Float64Array | None = None) -> Float64Array:
        """Return heights (m) of the drained nodes, or of given ones, in cells of 30 m with all detail."""
        drained = self.carved
        height = drained.height if height is None else height
        wet = wetness(height, drained.area, self.spacing, self.spacing)
        rock, damp = (np.rint(255 * np.clip(each, 0, 1)).astype(np.uint8) for each in (self.uplift.rock, wet))
        row, column = self.plain.origin
        nodes = PaintedNodes(
            column, row, height.astype(np.float32), rock, damp, drained.area.astype(np.float32)
        )
        blank = Sketch(
            extent=self.settings.extent,
            seed=self.sketch.seed,
            density=self.sketch.density,
            ground=self.sketch.ground,
        )
        relief = ReliefLayer(UnpaintedNodes(self.settings), DrainedRaster.from_drained([nodes]))
        evaluator = Evaluator(make_recipe(blank).with_layers([relief]), context)
        middle = (np.arange(CELLS) + 0.5) * CELL
        x, y = (to_lattice(each.ravel(), self.settings.extent) for each in np.meshgrid(middle, middle[::-1]))
        found, _ = evaluator.points(x, y, cell_size=CELL)
        return np.asarray(found, np.float64).reshape(CELLS, CELLS)

    def effect(self, layer: str) -> Float64Array:
        """Return how much a layer raises the ground (m) at the sketch's pixels, on the same network."""
        removed = self.features.is_rock == (layer == "mountain")
        rest = self.features._replace(height=np.where(removed, 0.0, self.features.height))
        uplift = _uplift(self.sketch, rest, self.plain, self.bare, self.spacing)
        lower = height_without(uplift, self.drained[-1], self.factors, self.spacing)
        return self.read(self.carved.height - lower, EXTENT / PIXELS)


def drained(sketch: Sketch, nodes: int, rounds: Sequence[int]) -> DrainedSketch:
    """Drain a painted sketch as the program does, on a raster of so many nodes along it."""
    spacing = EXTENT / (nodes - 1)
    settings = replace(UnpaintedSettings.from_sketch(sketch), extent=CELLS * spacing)
    features = uplift_features(sketch, place(sketch, seed=sketch.seed))
    plain = _plain(_WideGround(settings, nodes))

    def work() -> tuple[Any, ...]:
        levels = [plain]
        while len(levels) < len(BARE_ROUNDS):
            levels.append(drainage.coarsened(levels[-1]))
        bare = drainage.drain(levels[::-1], spacing, BARE_ROUNDS)
        uplift = _uplift(sketch, features, plain, bare, spacing)
        painted, factors = drain_painted(uplift, spacing, bare, rounds=rounds)
        return bare, uplift, painted, _carved(plain, uplift, spacing, painted[-1].height), factors

    (bare, uplift, levels, carved, factors), seconds = timed(work, laps=_LAPS)
    return DrainedSketch(sketch, settings, features, plain, bare, uplift, levels, carved, factors, seconds)


def _plain(ground: UnpaintedGround) -> DrainageInput:
    """Return what the painted region is drained from without paint."""
    region = ground.painted_region(0)
    shape = region.inside.shape
    fields = ground.uplift(0, region.column, region.row, *shape)
    return DrainageInput(
        fields.uplift,
        fields.repose,
        np.where(region.inside, ground.settings.spacing**2, 0.0),
        region.border,
        region.inside,
        np.full(shape, -1, np.int32),
        (region.row, region.column),
    )


def _uplift(
    sketch: Sketch, features: UpliftFeatures, plain: DrainageInput, bare: Sequence[Drained], spacing: float
) -> PaintedUplift:
    """Return the uplift of features on ground that is drained around them."""
    outlines = {name: painted_outline(sketch, name, spacing, Runner()) for name in PAINTED}
    painted = {name: each for name, each in outlines.items() if each is not None}
    uplift = painted_uplift(features, plain, spacing, None, painted)
    levels = [
        drainage.confined(each, before, uplift.zone_of(k))
        for k, (each, before) in enumerate(zip(uplift.ground, bare, strict=True))
    ]
    return replace(uplift, ground=tuple(levels))


def timed(work: Callable[[], _Result], *, laps: int = 1) -> tuple[_Result, float]:
    """Return a result and the processor's seconds, the median of some laps."""
    found: list[_Result] = []
    seconds = [lap(lambda: found.append(work())).processor for _ in range(laps)]
    return found[-1], float(np.median(seconds))


def _carved(plain: DrainageInput, uplift: PaintedUplift, spacing: float, height: Float64Array) -> Drained:
    """Return level 0 with barriers cut through that splines would close valleys with."""
    repose = np.maximum(plain.repose, uplift.ground[-1].repose)
    return drainage.carved(replace(plain, repose=repose), spacing, height)


@dataclass(frozen=True, eq=False)
class Eroded:
    """A ground as fastscapelib erodes it: heights (m) of nodes, the effects of layers at pixels, seconds."""

    height: Float64Array
    effects: dict[str, Float64Array]
    seconds: float


def eroded(ground: DrainedSketch) -> Eroded:
    """Erode the ground's uplift with fastscapelib; it is scaled once to the heights asked for."""
    raised = {}
    for layer in ground.uplift.layers:
        name = PAINTED[not ground.features.is_rock[layer.members[0]]]
        raised[name] = layer.collar[-1] + layer.core[-1]
    first = _simulated(ground, raised)
    for name in raised:
        most = float((first - _simulated(ground, raised, name)).max())
        raised[name] = raised[name] * (ground.effect(name).max() / max(most, 1.0))
    height, seconds = timed(lambda: _simulated(ground, raised))
    effects = {
        name: ground.read(height - _simulated(ground, raised, name), EXTENT / PIXELS) for name in raised
    }
    inside = np.where(ground.plain.domain, height, np.nan)
    carved = _carved(ground.plain, ground.uplift, ground.spacing, inside)
    return Eroded(carved.height, effects, seconds)


def _simulated(ground: DrainedSketch, raised: Mapping[str, Float64Array], without: str = "") -> Float64Array:
    peer: Any = import_module("fastscapelib")
    plain, spacing = ground.plain, ground.spacing
    uplift = plain.uplift + sum(each for name, each in raised.items() if name != without)
    fixed = ~plain.domain | ~np.isnan(plain.base)
    known = ndimage.distance_transform_edt(np.isnan(plain.base), return_distances=False, return_indices=True)
    grid = peer.RasterGrid(list(fixed.shape), [spacing, spacing], peer.NodeStatus.FIXED_VALUE)
    graph = peer.FlowGraph(grid, [peer.SingleFlowRouter(), peer.MSTSinkResolver()])
    graph.base_levels = np.flatnonzero(fixed)
    eroder = peer.SPLEroder(graph, _K, _AREA, 1.0, 1e-5)
    rise = np.where(fixed, 0.0, uplift * _K * spacing ** (2.0 * _AREA) * _YEARS)
    noise = np.random.default_rng(SEED).uniform(0.0, 1.0, fixed.shape)
    height = plain.base[tuple(known)] + np.where(fixed, 0.0, noise)
    for _ in range(_STEPS):
        height += rise
        graph.update_routes(height)
        height -= np.where(fixed, 0.0, eroder.erode(height, graph.accumulate(1.0), _YEARS))
    return np.asarray(height)
