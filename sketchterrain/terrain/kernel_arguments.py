"""Arguments of the terrain kernels, uploaded and cached."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Bounds, FloatArray, LatticeArray
from sketchterrain.caching import LRUCache
from sketchterrain.terrain.centrelines import tolerance_cell
from sketchterrain.terrain.culling import BoxIndex, field_index, item_lists, river_index
from sketchterrain.terrain.feature_cache import FeatureBatch, FeatureCache
from sketchterrain.terrain.materials import pack_rules
from sketchterrain.terrain.packing import (
    SLOT_DUNE,
    SLOT_FOREST,
    SLOT_MOUNTAIN,
    PackedRivers,
    effective_cell,
    pack_covers,
    pack_fields,
    pack_lakes,
    pack_rivers,
    pack_world,
)
from sketchterrain.terrain.recipe import TerrainRecipe

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.terrain.culling import Lists

_MAX_CELL_SIZES = 64
_MAX_TOLERANCES = 16


def global_key(recipe: TerrainRecipe) -> tuple[object, ...]:
    """Return everything on the device that depends on the whole world."""
    settings = (dict(recipe.ground), dict(recipe.climate), recipe.materials, recipe.material_rules)
    noises = (recipe.stacks, recipe.warp, recipe.ridge_depth)
    return recipe.extent, recipe.seed, recipe.fidelity, settings, noises, recipe.dune_styles


def bit_equal(one: object, other: object) -> bool:
    """Return whether two values of dataclasses, tuples and arrays are bit-equal."""
    if one is other:
        return True
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()
    if isinstance(one, tuple | list) and isinstance(other, tuple | list):
        return len(one) == len(other) and all(map(bit_equal, one, other))
    if is_dataclass(one) and type(one) is type(other):
        return all(bit_equal(getattr(one, each.name), getattr(other, each.name)) for each in fields(one))
    return bool(one == other)


@dataclass(frozen=True, eq=False)
class CulledInputs:
    """Features and arcs near some blocks, and which of them affect which block."""

    features: FeatureBatch
    rivers: PackedRivers
    lists: dict[str, npt.NDArray[np.int32]]  # by the names of the kernels' arguments

    @property
    def empty_masks(self) -> npt.NDArray[np.int32]:
        """Bits of the masks that are 0 on all of a block: mountain, dune, forest, water; shape (blocks,)."""
        kind = np.diff(self.lists["feature_starts"], axis=-1) > 0
        water = (np.diff(self.lists["lake_starts"]) > 0) | (np.diff(self.lists["river_starts"]) > 0)
        present = (kind[:, SLOT_MOUNTAIN], kind[:, SLOT_DUNE:].any(axis=-1), kind[:, SLOT_FOREST], water)
        return np.asarray(sum(~mask << bit for bit, mask in enumerate(present)), np.int32)


class KernelArguments:
    """A recipe's buffers on an open device, and the arguments of each launch."""

    def __init__(self, recipe: TerrainRecipe, context: ComputeContext) -> None:
        self.recipe = recipe
        self.context = context
        rules = pack_rules(recipe)
        # The arguments of ``RULE_ARGUMENTS`` in ``kernels/materials.clh``, in order.
        self.rules = [np.int32(rules.count), *self._upload(rules.form, rules.cover, rules.ramp)]
        self._worlds = LRUCache(_MAX_CELL_SIZES)
        self._river_sets = LRUCache(_MAX_TOLERANCES)
        self._reset_lakes()
        self._reset_covers()
        self._feature_cache = FeatureCache(recipe, context)

    def with_strengths(self, strength: FloatArray) -> KernelArguments:
        """Return the arguments with other strengths (n,) of painted features; other buffers are shared."""
        painted = self.recipe.painted.copy()
        painted["strength"] = strength
        other = copy(self)
        other.recipe = replace(self.recipe, painted=painted)
        other._feature_cache = self._feature_cache.with_recipe(other.recipe)
        return other

    def updated(self, recipe: TerrainRecipe, areas: Sequence[Bounds]) -> KernelArguments:
        """Return the arguments of a changed recipe, sharing buffers outside the `changed_areas` (m)."""
        before = self.recipe
        if global_key(before) != global_key(recipe):
            return KernelArguments(recipe, self.context)
        other = copy(self)
        other.recipe = recipe
        if not bit_equal((before.rivers, before.valley_radii), (recipe.rivers, recipe.valley_radii)):
            other._river_sets = LRUCache(_MAX_TOLERANCES)
        if not bit_equal(before.lakes, recipe.lakes):
            other._reset_lakes()
        if not bit_equal(before.covers, recipe.covers):
            other._reset_covers()
        other._feature_cache = self._feature_cache.updated(recipe, areas)
        return other

    def _reset_lakes(self) -> None:
        self._lakes = pack_fields(self.recipe, [lake.shape for lake in self.recipe.lakes])
        self._lake_index = field_index(self._lakes)
        self._lake_samples = self._upload(self._lakes.samples)
        self._lake_worlds = LRUCache(_MAX_CELL_SIZES)

    def _reset_covers(self) -> None:
        self._covers = pack_fields(self.recipe, [cover.shape for cover in self.recipe.covers])
        self._cover_index = field_index(self._covers)
        covers = pack_covers(self.recipe, self._covers)
        self._cover_buffers = self._upload(self._covers.at, covers.form, covers.shape, self._covers.samples)

    def world(self, cell_size: float) -> dict[str, Any]:
        """Return the arguments that do not depend on the position, by name; cached."""
        cell = effective_cell(cell_size)
        world = self._worlds.get_or_compute(cell, lambda: self._upload_world(cell))
        return world | self._lake_worlds.get_or_compute(cell, lambda: self._upload_lakes(cell))

    def _rivers(self, cell_size: float) -> _Rivers:
        cell = tolerance_cell(cell_size)
        return self._river_sets.get_or_compute(cell, lambda: self._upload_rivers(cell))

    def cull(
        self, blocks: LatticeArray, cell_size: float, *, ground: LatticeArray | None = None
    ) -> CulledInputs:
        """Return what affects blocks (n, 4) of west, south, east and north, lattice units.

        ``ground`` (m, 4): fewer, larger blocks that contain all of them, to select features by.
        """
        visible = self.world(cell_size)["lakes_visible"]
        around = blocks if ground is None else ground
        features = self._feature_cache.batch(around, effective_cell(cell_size))
        rivers = self._rivers(cell_size)
        lists = {
            "feature": features.lists(blocks),
            "lake": item_lists(self._lake_index, blocks, visible),
            "river": item_lists(rivers.index, blocks),
        }
        return CulledInputs(features, rivers.packed, _named(lists))

    def terrain(self, culled: CulledInputs, cell_size: float, lists: Mapping[str, Any]) -> list[Any]:
        """Return the arguments of ``TERRAIN_ARGUMENTS`` in ``kernels/surface.clh``, in order.

        ``lists`` are device buffers of ``culled.lists``, by name.
        """
        world = self.world(cell_size)
        return [
            world["scalars"],
            world["styles"],
            *world["octaves"],
            culled.features.at,
            culled.features.row,
            lists["feature_starts"],
            lists["feature_list"],
            *world["lakes"],
            *self._lake_samples,
            lists["lake_starts"],
            lists["lake_list"],
            *self._rivers(cell_size).buffers,
            lists["river_starts"],
            lists["river_list"],
        ]

    def cover_lists(self, blocks: LatticeArray) -> dict[str, npt.NDArray[np.int32]]:
        """Return which painted materials affect blocks, by the names of the kernel's arguments."""
        return _named({"cover": item_lists(self._cover_index, blocks)})

    def covers(self, lists: Mapping[str, Any]) -> list[Any]:
        """Return the arguments of painted materials, given buffers of :meth:`cover_lists`."""
        return [*self._cover_buffers, lists["cover_starts"], lists["cover_list"]]

    def _upload(self, *arrays: npt.NDArray[Any]) -> list[Any]:
        """Return buffers of arrays, float64 ones converted to the kernels' REAL."""
        real = self.context.real_dtype
        return [
            self.context.upload(each.astype(real) if each.dtype == np.float64 else each) for each in arrays
        ]

    def _upload_world(self, cell: float) -> dict[str, Any]:
        packed = pack_world(self.recipe, cell, real=self.context.real_dtype)
        scalars, styles = self._upload(packed.scalars, packed.styles)
        octaves = packed.octaves
        buffers = self._upload(octaves.form, octaves.offset, octaves.scale)
        return {"scalars": scalars, "styles": styles, "table": octaves, "octaves": buffers}

    def _upload_lakes(self, cell: float) -> dict[str, Any]:
        lakes = pack_lakes(self.recipe, self._lakes, cell)
        buffers = self._upload(self._lakes.at, self._lakes.form, lakes.row[:, :4], lakes.row[:, 4:])
        return {"lakes_visible": lakes.visible, "lakes": buffers}

    def _upload_rivers(self, cell: float) -> _Rivers:
        rivers = pack_rivers(self.recipe, cell)
        buffers = self._upload(rivers.start, rivers.arc, rivers.up, rivers.down)
        return _Rivers(rivers, buffers, river_index(self.recipe, rivers))


@dataclass(frozen=True, eq=False)
class _Rivers:
    """Arcs of rivers for one tolerance: packed, on the device, and indexed."""

    packed: PackedRivers
    buffers: list[Any]
    index: BoxIndex


def _named(lists: Mapping[str, Lists]) -> dict[str, npt.NDArray[np.int32]]:
    parts = ("starts", "list")
    return {f"{name}_{part}": pair[i] for name, pair in lists.items() for i, part in enumerate(parts)}
