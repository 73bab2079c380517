"""The recipe: an immutable value of everything that a terrain depends on; where two differ."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Bounds, StructuredArray
from sketchterrain.document.material_rules import DEFAULT_RULES, MaterialRule
from sketchterrain.geometry.box_index import merge_boxes
from sketchterrain.landforms.placement.feature_types import Lake, River
from sketchterrain.landuse.areas import LandUse
from sketchterrain.roads.road_types import NO_ROADS, RoadNetwork
from sketchterrain.schema.geology import Strata
from sketchterrain.schema.materials import BUILT_IN, MaterialTable
from sketchterrain.schema.parameters import GEOLOGY, defaults
from sketchterrain.stages.digests import digest_of
from sketchterrain.terrain.layers.corridors import CorridorsLayer
from sketchterrain.terrain.layers.forests import COVER_NOISE
from sketchterrain.terrain.layers.lakes import LakesLayer
from sketchterrain.terrain.layers.landuse import LandUseLayer
from sketchterrain.terrain.layers.layer import LayerChange, Sampling, TerrainLayer, WorldSettings, no_boxes
from sketchterrain.terrain.layers.plateaus import PlateausLayer
from sketchterrain.terrain.layers.points import PointsLayer
from sketchterrain.terrain.layers.sea import SeaLayer
from sketchterrain.terrain.noise import FINEST_CELL, NoiseStack, octave_table
from sketchterrain.terrain.orthophotos import Orthophoto

if TYPE_CHECKING:
    from sketchterrain.landforms.hydrology.conflicts import Resolution
    from sketchterrain.landforms.placement.plateaus import Plateau


_Layer = TypeVar("_Layer", bound=TerrainLayer)

_COVER_NOISE_SHARE: Final = 1 / 12  # of the extent


@dataclass(frozen=True, eq=False)
class TerrainRecipe:
    """A terrain as a value: the same recipe gives the same heights wherever and however it is evaluated.

    Attributes
    ----------
    world : WorldSettings
        Extent (m), seed and fidelity.
    climate : mapping
        The sketch's [climate] parameters.
    strata : Strata
        The rock and its beds.
    layers : tuple of TerrainLayer
        What the heights are made of, in order; one of each kind.
    materials : MaterialTable
        Materials that rules and covers name.
    material_rules : tuple of MaterialRule
        Rules for materials under the painted ones, from bottom to top.
    resolutions : tuple of Resolution
        Decisions where layers contradict each other, one line and a position each.
    orphans : tuple of str
        Edits of features that no longer exist, one line each.
    orthophotos : tuple of Orthophoto
        Photographs of the ground, which change its colour only.
    network : RoadNetwork
        Roads, railways, paths, pads and walls.
    """

    world: WorldSettings
    climate: Mapping[str, float]
    layers: tuple[TerrainLayer, ...]
    materials: MaterialTable = BUILT_IN
    material_rules: tuple[MaterialRule, ...] = DEFAULT_RULES
    resolutions: tuple[Resolution, ...] = ()
    orphans: tuple[str, ...] = ()
    orthophotos: tuple[Orthophoto, ...] = ()
    network: RoadNetwork = NO_ROADS
    strata: Strata = field(default_factory=lambda: Strata.from_settings(defaults(GEOLOGY)))

    def key(self) -> bytes:
        """Return a digest of everything that heights and materials depend on everywhere."""
        layers = [(layer.name, layer.key()) for layer in self.layers]
        return digest_of((self.world, self.climate, self.strata, self.materials, self.material_rules, layers))

    def __getitem__(self, kind: type[_Layer]) -> _Layer:
        """Return the layer of a kind."""
        return next(layer for layer in self.layers if isinstance(layer, kind))

    def with_layers(self, layers: Iterable[TerrainLayer]) -> TerrainRecipe:
        """Return the recipe with these layers in place of those of the same kind."""
        given = {type(layer): layer for layer in layers}
        return replace(self, layers=tuple(given.get(type(layer), layer) for layer in self.layers))

    @property
    def extent(self) -> float:
        """Metres along the sketch's longer side."""
        return self.world.extent

    @property
    def seed(self) -> int:
        """Seed of all random numbers."""
        return self.world.seed

    @property
    def points(self) -> PointsLayer:
        """The point features."""
        return self[PointsLayer]

    @property
    def rivers(self) -> tuple[River, ...]:
        """The rivers."""
        return self[CorridorsLayer].rivers

    @property
    def plateaus(self) -> tuple[Plateau, ...]:
        """The plateaus."""
        return self[PlateausLayer].plateaus

    @property
    def lakes(self) -> tuple[Lake, ...]:
        """The lakes."""
        return self[LakesLayer].lakes

    @property
    def landuse(self) -> LandUse:
        """Fields, meadows, forests and built-up land."""
        return self[LandUseLayer].areas

    @property
    def sea_level(self) -> float | None:
        """The level of the sea (m), None without one."""
        return self[SeaLayer].level

    @property
    def stacks(self) -> tuple[NoiseStack, ...]:
        """Noise stacks of the terrain."""
        cover = NoiseStack(COVER_NOISE, self.extent * _COVER_NOISE_SHARE, 0.62, most=8)
        return (*(stack for layer in self.layers for stack in layer.stacks(self.world)), cover)

    def sampling(self, cell: float, real: npt.DTypeLike = np.float64) -> Sampling:
        """Return what layers are packed for at a cell size of at least `FINEST_CELL` (m)."""
        full, octaves = (
            octave_table(self.stacks, extent=self.extent, seed=self.seed, cell_size=size)
            for size in (FINEST_CELL, cell)
        )
        return Sampling(self.world, cell, octaves, full, np.dtype(real))

    def pack_world(self, sampling: Sampling) -> dict[str, npt.NDArray[Any]]:
        """Return the arrays of ``WORLD_ARGUMENTS`` in ``kernels/world.clh``."""
        scalars = {
            "metres_per_unit": sampling.unit,
            "units_per_metre": 1 / sampling.unit,
            "inverse_cell": 1 / sampling.cell,
        }
        world: StructuredArray = sampling.struct("world.clh", "World", scalars | sampling.ranges(COVER_NOISE))
        octaves = sampling.octaves
        return {
            "world": world,
            "octave_form": octaves.form,
            "octave_offset": octaves.offset,
            "octave_scale": octaves.scale,
        }


EVERYWHERE: Bounds = (-math.inf, -math.inf, math.inf, math.inf)
"""The whole world."""


@dataclass(frozen=True, eq=False)
class RecipeChange:
    """What differs between two recipes of the same extent."""

    recipe: TerrainRecipe  # the new one, whose unchanged layers are the old one's
    layers: dict[str, LayerChange]  # changes by layer, without unchanged ones
    areas: list[Bounds]  # m, outside which heights, normals and materials are bit-equal


def difference(old: TerrainRecipe, new: TerrainRecipe) -> RecipeChange | None:
    """Return what differs between two recipes; None if it may be everything everywhere."""
    if old is new:
        return RecipeChange(new, {}, [])
    if old.key() != new.key():
        return None
    changes: dict[str, LayerChange] = {}
    layers = []
    for before, now in zip(old.layers, new.layers, strict=True):
        same = before is now or digest_of(before) == digest_of(now)
        change = None if same else now.change(before, new.world)
        if not same and change is None:
            return None
        if change:
            changes[now.name] = change
        layers.append(now if change else before)
    areas = np.concatenate([no_boxes(), *(change.boxes for change in changes.values())]) * new.world.unit
    return RecipeChange(
        new.with_layers(layers), changes, merge_boxes((w, s, e, n) for w, s, e, n in areas.tolist())
    )


def changed_areas(old: TerrainRecipe, new: TerrainRecipe) -> list[Bounds]:
    """Return rectangles (west, south, east, north, m) outside which two terrains are bit-equal.

    Empty if nothing changed; `EVERYWHERE` if anything global did (a layer's key, the climate, material rules,
    seed, extent). A tile's normals read one vertex beyond its border: widen the areas by the cell size to
    select tiles.
    """
    change = difference(old, new)
    return [EVERYWHERE] if change is None else change.areas


def touches(areas: Sequence[Bounds], bounds: Bounds, *, margin: float = 0.0) -> bool:
    """Return whether a rectangle (west, south, east, north, m), widened by a margin, overlaps any area.

    A tile is unchanged unless its bounds, widened by its cell size, do.
    """
    west, south, east, north = bounds
    return any(
        w <= east + margin and e >= west - margin and s <= north + margin and n >= south - margin
        for w, s, e, n in areas
    )
