"""What tiles must cost at least: their octaves, evaluations of features, materials' rules and bytes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.benchmarks.grounds import BARE, central_keys, open_ground
from sketchterrain.placement.feature_types import FEATURE, FEATURE_TYPES, Lake, River, ShapeField
from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.kernel_arguments import KernelArguments
from sketchterrain.terrain.lattice import QUADS, metres_per_unit
from sketchterrain.terrain.packing import support_radii
from sketchterrain.terrain.patch_layout import tile_patches
from sketchterrain.terrain.patches import PatchLauncher
from sketchterrain.terrain.surfaces import SurfaceStore

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt

    from sketchterrain.benchmarks.grounds import TileKey
    from sketchterrain.benchmarks.timing import Lap, TimedContext
    from sketchterrain.terrain.kernel_arguments import CulledInputs
    from sketchterrain.terrain.patch_layout import Patches
    from sketchterrain.terrain.recipe import TerrainRecipe
    from sketchterrain.terrain.terrain import Terrain

BYTES = 64
"""Of a tile's vertex: height, normal, eight weights, its parent's height and normal."""

WATERS = ("lake", "river")
KINDS = (*FEATURE_TYPES, *WATERS)
"""What is evaluated at each vertex that it may reach."""

_SLOTS = ("mountain", "hill", "forest")  # then dunes, one slot a style
_LEVEL = 5
_TILES = 16
_COPIES = (4, 12)
_EVERY = 6  # vertices: where it is looked what is cut and what is rock


@dataclass(frozen=True)
class Counts:
    """What is evaluated for some tiles and what their parents hold of them, of all vertices together.

    Attributes
    ----------
    octaves, slopes, gullies : float
        Octaves of noise, of noise with its slope, and of gullies.
    evaluations : dict of str to int
        Features, lakes and arcs of rivers, by their kind.
    vertices : int
        Of the tiles.
    """

    octaves: float
    slopes: float
    gullies: float
    evaluations: Mapping[str, int]
    vertices: int


def counted(terrain: Terrain, context: TimedContext, keys: Sequence[TileKey]) -> Counts:
    """Count what tiles of one level need, with the border of one vertex that their normals are made of.

    Gullies count on vertices that surely lie in a feature that water cuts, crags on those of mountains.
    """
    recipe, arguments = terrain.recipe, KernelArguments(terrain.recipe, context)
    octaves = slopes = gullies = 0.0
    evaluations = dict.fromkeys(KINDS, 0)
    for up, side in ((0, QUADS + 3), (1, QUADS // 2 + 3)):
        patches = tile_patches(keys[0][0], [key[1:] for key in keys], recipe.extent, up=up)
        reaching = arguments.cull(patches.blocks, patches.cell_size)
        lists = reaching.lists
        table = arguments.world(patches.cell_size)["table"]
        length = {name: last - first for name, (first, last) in table.ranges.items()}
        of_slot = np.diff(lists["feature_starts"], axis=-1)
        there = of_slot > 0
        cut, rocky = _cut(recipe, reaching, patches), _rocky(terrain, patches)
        plane = side * side
        octaves += plane * (
            len(keys) * (length["ground"] + (length["mottle"] if up == 0 else 0))
            + int(there[:, len(_SLOTS) :].sum()) * length["crest"]
            + rocky * length["crag"]
        )
        slopes += plane * int(there.any(axis=-1).sum()) * (length["warp_u"] + length["warp_v"])
        slopes += plane * int(there[:, 0].sum()) * length["ridge"]
        gullies += plane * cut * length["gully"]
        number = dict(zip(_SLOTS, of_slot.sum(axis=0), strict=False))
        number |= {"dune": of_slot[:, len(_SLOTS) :].sum()}
        number |= {name: lists[f"{name}_starts"][-1] for name in WATERS}
        if up == 1:
            number["forest"] = 0
        for name in KINDS:
            evaluations[name] += int(number[name]) * plane
    return Counts(octaves, slopes, gullies, evaluations, len(keys) * (QUADS + 1) ** 2)


def _sampled(patches: Patches) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return some vertices of each patch, lattice units, two arrays of shape (patches, n)."""
    x, y = patches.axis_x[:, 2:-1:_EVERY], patches.axis_y[:, 2:-1:_EVERY]
    shape = (patches.count, y.shape[1], x.shape[1])
    east, north = np.broadcast_to(x[:, None], shape), np.broadcast_to(y[:, :, None], shape)
    return east.reshape(patches.count, -1), north.reshape(patches.count, -1)


def _cut(recipe: TerrainRecipe, reaching: CulledInputs, patches: Patches) -> float:
    """Tiles' worth of vertices that surely lie in a hill or mountain that water cuts."""
    features, lists = reaching.features, reaching.lists
    at, shape = features.packed.at, features.packed.shape
    unit = metres_per_unit(recipe.extent)
    sure = max(1 - (support_radii(recipe) - 1), 0.0)
    east, north = _sampled(patches)
    whole = 0.0
    for patch, starts in enumerate(lists["feature_starts"]):
        near = lists["feature_list"][starts[0] : starts[2]]
        near = near[(shape[near, 4] > 0) & (shape[near, 1] > 0)]
        away = np.stack([east[patch], north[patch]], axis=-1)[:, None] - at[near]
        radii = np.hypot(away[..., 0] * unit, away[..., 1] * unit) * shape[near, 0]
        whole += float(np.mean((radii < sure).any(axis=-1)))
    return whole


def _rocky(terrain: Terrain, patches: Patches) -> float:
    """Tiles' worth of vertices that are of a mountain."""
    east, north = _sampled(patches)
    _, masks = Evaluator(terrain.recipe, terrain.context).points(
        east.ravel(), north.ravel(), cell_size=patches.cell_size
    )
    return patches.count * float(np.mean(masks[:, 0] > 0))


class Probe:
    """Heights of some tiles that lie under so many copies of one thing.

    Parameters
    ----------
    kind
        One of :data:`KINDS`, or ``"gully"``: the octaves that cut some hills.
    many
        Few copies or many; of gullies none or all.
    context

    Attributes
    ----------
    evaluations : int
        How many there are, of all vertices together, the border included.
    """

    def __init__(self, kind: str, context: TimedContext, *, many: bool) -> None:
        bare = open_ground(BARE, context).recipe
        self._context = context
        arguments = KernelArguments(_probed(bare, kind, many=many), context)
        keys = [key[1:] for key in central_keys(_LEVEL, _TILES)]
        self._patches = tile_patches(_LEVEL, keys, bare.extent, up=0)
        lists = arguments.cull(self._patches.blocks, self._patches.cell_size).lists
        if kind == "gully":
            first, last = arguments.world(self._patches.cell_size)["table"].ranges["gully"]
            number = _TILES * (last - first) * many
        else:
            number = int(lists[f"{kind if kind in WATERS else 'feature'}_starts"].reshape(-1)[-1])
        self.evaluations = number * (QUADS + 3) ** 2
        self._launcher = PatchLauncher(arguments)
        self._store = SurfaceStore(context, QUADS + 1, _TILES)

    def lap(self) -> Lap:
        """Evaluate them once; the launch of `patches` is what counts."""
        slots = np.arange(_TILES)
        return self._context.lap(lambda: self._launcher.surfaces(self._patches, self._store, slots))


def probes(context: TimedContext) -> dict[tuple[str, bool], Probe]:
    """Return two probes a kind, and of gullies: few and many."""
    return {
        (kind, many): Probe(kind, context, many=many) for kind in (*KINDS, "gully") for many in (False, True)
    }


def slope(few: Probe, many: Probe, laps: tuple[Sequence[Lap], Sequence[Lap]]) -> float:
    """Return the seconds that one evaluation more costs, from the medians of two probes; 0 or more."""
    less, more = (
        float(np.median([one.seconds for lap in each for one in lap.launches if one.kernel == "patches"]))
        for each in laps
    )
    return max(more - less, 0.0) / float(many.evaluations - few.evaluations)


def _probed(bare: TerrainRecipe, kind: str, *, many: bool) -> TerrainRecipe:
    middle, reach = 0.5 * bare.extent, 0.4 * bare.extent
    copies = _COPIES[many and kind != "gully"]
    if kind == "lake":
        return replace(bare, lakes=(_lake(middle, 0.1 * bare.extent),) * copies)
    if kind == "river":
        rivers = tuple(_river(bare.extent, middle + 10.0 * number) for number in range(copies))
        return replace(
            bare, rivers=rivers, valley_radii=(np.full(len(rivers[0].centreline), reach),) * copies
        )
    painted = np.zeros(copies, FEATURE)
    painted["id"] = np.arange(copies)
    painted["type"] = FEATURE_TYPES.index("hill" if kind == "gully" else kind)
    painted["x"] = painted["y"] = middle
    painted["radius"], painted["strength"], painted["peakiness"] = reach, 100.0, 0.5
    painted["wavelength"], painted["painted"] = 150.0, True
    if kind == "gully":
        painted["erosion"], painted["gullies"] = float(many), 0.5
    return replace(bare, painted=painted)


def _lake(middle: float, radius: float) -> Lake:
    step = np.linspace(-1.5, 1.5, 49) * radius
    inside = (radius - np.hypot(step, step[:, None])).astype(np.float32)
    spacing = float(step[1] - step[0])
    return Lake(1, 1, ShapeField(middle - 1.5 * radius, middle - 1.5 * radius, spacing, inside), 0.0, 8.0)


def _river(length: float, y: float) -> River:
    x = np.linspace(0.05, 0.95, 40) * length
    line = np.column_stack([x, y + 0.03 * length * np.sin(x * (6 / length)), 10 - 20 * x / length])
    points, ones = line[::3], np.ones(len(line), np.float32)
    few = ones[: len(points)]
    return River(1, 1, points, 20 * few, 2 * few, line, 20 * ones, 2 * ones)
