"""A recipe on an OpenCL device, and the kernels' arguments that it makes."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from sketchterrain.terrain.centrelines import tolerance_cell
from sketchterrain.terrain.culling import field_index, item_lists, river_index
from sketchterrain.terrain.field_packing import pack_covers, pack_fields, pack_lakes
from sketchterrain.terrain.material_rules import pack_rules
from sketchterrain.terrain.packing import effective_cell, pack_rivers, pack_world
from sketchterrain.terrain.sameness import of_the_world, same
from sketchterrain.terrain.surroundings import Surroundings

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Mapping, Sequence

    import numpy.typing as npt

    from sketchterrain.compute import ComputeContext
    from sketchterrain.terrain.changes import Box
    from sketchterrain.terrain.culling import Lists
    from sketchterrain.terrain.packing import PackedRivers
    from sketchterrain.terrain.reach_index import ReachIndex
    from sketchterrain.terrain.recipe import TerrainRecipe
    from sketchterrain.terrain.surroundings import Gathered

K = TypeVar("K", bound="Hashable")
V = TypeVar("V")

_PARTS = ("starts", "list")
# Lists of a block, as kernels/world.clh counts them.
_MOUNTAIN, _FOREST, _DUNES = 0, 2, slice(3, None)
_MOST_WORLDS = 64  # cell sizes
_MOST_RIVERS = 16  # tolerances


@dataclass(frozen=True, eq=False)
class Reaching:
    """What reaches blocks of ground.

    Attributes
    ----------
    features : Gathered
        Features, of which some do.
    rivers : PackedRivers
        Arcs of rivers, of which some do.
    lists : dict of str to ndarray of int32
        Which features, lakes and pieces of river reach which block, by the names of the kernels' arguments.
    """

    features: Gathered
    rivers: PackedRivers
    lists: dict[str, npt.NDArray[np.int32]]

    @property
    def absent(self) -> npt.NDArray[np.int32]:
        """Bits of the masks that are 0 on all of a block: mountain, dune, forest, water; shape (blocks,)."""
        kind = np.diff(self.lists["feature_starts"], axis=-1) > 0
        water = (np.diff(self.lists["lake_starts"]) > 0) | (np.diff(self.lists["river_starts"]) > 0)
        there = (kind[:, _MOUNTAIN], kind[:, _DUNES].any(axis=-1), kind[:, _FOREST], water)
        return np.asarray(sum(~mask << bit for bit, mask in enumerate(there)), np.int32)


class KernelArguments:
    """What a recipe puts on a device once, and what it adds for each launch.

    Parameters
    ----------
    recipe : TerrainRecipe
    context : ComputeContext
        An open device.
    """

    def __init__(self, recipe: TerrainRecipe, context: ComputeContext) -> None:
        self.recipe = recipe
        self.context = context
        self.rules = self._upload_rules()
        self._worlds: dict[float, dict[str, Any]] = {}
        self._put_rivers()
        self._put_lakes()
        self._put_covers()
        self._around = Surroundings(recipe, context)

    def with_strengths(self, strength: npt.NDArray[np.floating]) -> KernelArguments:
        """Return those of the same recipe but for the painted features' strengths, shape (n,).

        It shares what is on the device already, all of which stays the same.
        """
        painted = self.recipe.painted.copy()
        painted["strength"] = strength
        other = copy(self)
        other.recipe = replace(self.recipe, painted=painted)
        other._around = self._around.with_recipe(other.recipe)
        return other

    def after(self, recipe: TerrainRecipe, areas: Sequence[Box]) -> KernelArguments:
        """Return those of a changed recipe; what stays the same stays on the device.

        Parameters
        ----------
        recipe
            The changed one.
        areas
            Rectangles (m) that hold all that is another one, as `changed_areas` tells them.
        """
        before = self.recipe
        if of_the_world(before) != of_the_world(recipe):
            return KernelArguments(recipe, self.context)
        other = copy(self)
        other.recipe = recipe
        other._worlds = dict(self._worlds)
        if not same((before.rivers, before.river_reach), (recipe.rivers, recipe.river_reach)):
            other._put_rivers()
        if not same(before.lakes, recipe.lakes):
            other._put_lakes()
        if not same(before.covers, recipe.covers):
            other._put_covers()
        other._around = self._around.after(recipe, areas)
        return other

    def _put_rivers(self) -> None:
        self._river_sets: dict[float, _Rivers] = {}

    def _put_lakes(self) -> None:
        self._lakes = pack_fields(self.recipe, [lake.shape for lake in self.recipe.lakes])
        self._lake_index = field_index(self._lakes)
        self._lake_samples = self.context.upload(self._lakes.samples.astype(self.context.real_dtype))
        self._lake_worlds: dict[float, dict[str, Any]] = {}

    def _put_covers(self) -> None:
        self._covers = pack_fields(self.recipe, [cover.shape for cover in self.recipe.covers])
        self._cover_index = field_index(self._covers)
        self._cover_buffers = self._upload_covers()

    def world(self, cell_size: float) -> dict[str, Any]:
        """Return what does not depend on the place, by the names of the kernels' arguments; kept."""
        cell = effective_cell(cell_size)
        world = _kept(self._worlds, cell, self._upload_world, _MOST_WORLDS)
        lakes = _kept(self._lake_worlds, cell, self._upload_lakes, _MOST_WORLDS)
        return {**world, **lakes}

    def _rivers(self, tolerance: float) -> _Rivers:
        return _kept(self._river_sets, tolerance, self._upload_rivers, _MOST_RIVERS)

    def reaching(
        self,
        blocks: npt.NDArray[np.int64],
        cell_size: float,
        *,
        ground: npt.NDArray[np.int64] | None = None,
    ) -> Reaching:
        """Return what reaches blocks of ground.

        Parameters
        ----------
        blocks : (n, 4) int64
            West, south, east and north of the blocks of ground that are evaluated, lattice units.
        cell_size : float
            Metres between samples.
        ground : (m, 4) int64 or None
            Fewer blocks that hold all of them, if there are such.
        """
        shown = self.world(cell_size)["lakes_shown"]
        around = blocks if ground is None else ground
        gathered = self._around.gathered(around, effective_cell(cell_size))
        rivers = self._rivers(tolerance_cell(cell_size))
        lists = {
            "feature": gathered.lists(blocks),
            "lake": item_lists(self._lake_index, blocks, shown),
            "river": item_lists(rivers.index, blocks),
        }
        return Reaching(gathered, rivers.packed, _named(lists))

    def terrain(self, reaching: Reaching, cell_size: float, lists: Mapping[str, Any]) -> list[Any]:
        """Return the arguments that ``TERRAIN_ARGUMENTS`` in ``kernels/patches.clh`` names, in its order.

        Parameters
        ----------
        reaching
            Of the blocks that are evaluated.
        cell_size : float
            Metres between samples, as it was told there.
        lists
            Device buffers of ``reaching.lists``, by their names.
        """
        world = self.world(cell_size)
        return [
            world["scalars"],
            world["styles"],
            *world["octaves"],
            reaching.features.at,
            reaching.features.shape,
            lists["feature_starts"],
            lists["feature_list"],
            *world["lakes"],
            self._lake_samples,
            lists["lake_starts"],
            lists["lake_list"],
            *self._rivers(tolerance_cell(cell_size)).buffers,
            lists["river_starts"],
            lists["river_list"],
        ]

    def cover_lists(self, blocks: npt.NDArray[np.int64]) -> dict[str, npt.NDArray[np.int32]]:
        """Return which painted materials reach blocks of ground, by the names of the kernel's arguments."""
        return _named({"cover": item_lists(self._cover_index, blocks)})

    def covers(self, lists: Mapping[str, Any]) -> list[Any]:
        """Return the arguments that name painted materials, given buffers of :meth:`cover_lists`."""
        return [*self._cover_buffers, lists["cover_starts"], lists["cover_list"]]

    def _upload_world(self, cell: float) -> dict[str, Any]:
        upload, real = self.context.upload, self.context.real_dtype
        packed = pack_world(self.recipe, cell, real=real)
        octaves = packed.octaves
        return {
            "scalars": upload(packed.scalars),
            "styles": upload(packed.styles),
            "table": octaves,
            "octaves": [upload(octaves.form), upload(octaves.offset), upload(octaves.scale.astype(real))],
        }

    def _upload_lakes(self, cell: float) -> dict[str, Any]:
        upload, real = self.context.upload, self.context.real_dtype
        lakes = pack_lakes(self.recipe, self._lakes, cell)
        return {
            "lakes_shown": lakes.shown,
            "lakes": [
                upload(self._lakes.at),
                upload(self._lakes.form),
                upload(lakes.shape.astype(real)),
                upload(lakes.profile.astype(real)),
            ],
        }

    def _upload_rules(self) -> list[Any]:
        """Return what ``RULE_ARGUMENTS`` in ``kernels/materials.clh`` names, in its order."""
        upload, real, rules = self.context.upload, self.context.real_dtype, pack_rules(self.recipe)
        return [
            np.int32(rules.count),
            upload(rules.form),
            upload(rules.cover.astype(real)),
            upload(rules.ramp.astype(real)),
        ]

    def _upload_covers(self) -> list[Any]:
        upload, real = self.context.upload, self.context.real_dtype
        covers = pack_covers(self.recipe, self._covers)
        return [
            upload(self._covers.at),
            upload(covers.form),
            upload(covers.shape.astype(real)),
            upload(self._covers.samples.astype(real)),
        ]

    def _upload_rivers(self, cell: float) -> _Rivers:
        upload, real = self.context.upload, self.context.real_dtype
        rivers = pack_rivers(self.recipe, cell)
        parts = (rivers.along, rivers.up, rivers.down)
        buffers = [upload(rivers.start), *(upload(part.astype(real)) for part in parts)]
        return _Rivers(rivers, buffers, river_index(self.recipe, rivers))


@dataclass(frozen=True, eq=False)
class _Rivers:
    """Arcs of rivers for one tolerance: here, on the device, and where they lie."""

    packed: PackedRivers
    buffers: list[Any]
    index: ReachIndex


def _named(lists: Mapping[str, Lists]) -> dict[str, npt.NDArray[np.int32]]:
    return {
        f"{name}_{part}": array
        for name, pair in lists.items()
        for part, array in zip(_PARTS, pair, strict=True)
    }


def _kept(known: dict[K, V], key: K, make: Callable[[K], V], most: int) -> V:
    """Return what is known under a key, made of it where it is new; so many are known at most."""
    if key not in known:
        while len(known) >= most:
            del known[next(iter(known))]
        known[key] = make(key)
    return known[key]
