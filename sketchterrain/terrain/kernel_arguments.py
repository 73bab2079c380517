"""A recipe on an OpenCL device, and the kernels' arguments that it makes."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.terrain.culling import feature_lists, features_near, field_lists, river_lists
from sketchterrain.terrain.field_packing import pack_covers, pack_fields, pack_lakes
from sketchterrain.terrain.material_rules import pack_rules
from sketchterrain.terrain.packing import effective_cell, pack_features, pack_rivers, pack_world

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.compute import ComputeContext
    from sketchterrain.terrain.recipe import TerrainRecipe

__all__ = ["KernelArguments"]


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
        self._rivers = pack_rivers(recipe)
        self._river_buffers = self._upload_rivers()
        self._lakes = pack_fields(recipe, [lake.shape for lake in recipe.lakes])
        self._lake_samples = context.upload(self._lakes.samples.astype(context.real_dtype))
        self._covers = pack_fields(recipe, [cover.shape for cover in recipe.covers])
        self._cover_buffers = self._upload_covers()
        self.rules = self._upload_rules()
        self._world = lru_cache(maxsize=64)(self._upload_world)

    def with_strengths(self, strength: npt.NDArray[np.floating]) -> KernelArguments:
        """Return those of the same recipe but for the painted features' strengths, shape (n,).

        It shares what is on the device already, all of which stays the same.
        """
        painted = self.recipe.painted.copy()
        painted["strength"] = strength
        other = copy(self)
        other.recipe = replace(self.recipe, painted=painted)
        return other

    def world(self, cell_size: float) -> dict[str, Any]:
        """Return what does not depend on the place, by the names of the kernels' arguments; kept."""
        return self._world(effective_cell(cell_size))

    def terrain(self, blocks: npt.NDArray[np.int64], cell_size: float) -> list[Any]:
        """Return the arguments that ``TERRAIN_ARGUMENTS`` in ``kernels/patches.clh`` names, in its order.

        Parameters
        ----------
        blocks : (n, 4) int64
            West, south, east and north of the blocks of ground that are evaluated, lattice units.
        cell_size : float
            Metres between samples.
        """
        context, real = self.context, self.context.real_dtype
        world = self.world(cell_size)
        near = features_near(self.recipe, blocks, min_radius=effective_cell(cell_size))
        packed = pack_features(self.recipe, near, cell_size)
        starts, members = feature_lists(self.recipe, packed, blocks)
        lake_starts, lake_members = field_lists(self._lakes, world["lakes_shown"], blocks)
        river_starts, river_members = river_lists(self.recipe, self._rivers, blocks)
        return [
            world["scalars"],
            world["styles"],
            *world["octaves"],
            context.upload(packed.at),
            context.upload(packed.shape.astype(real)),
            context.upload(starts),
            context.upload(members),
            *world["lakes"],
            self._lake_samples,
            context.upload(lake_starts),
            context.upload(lake_members),
            *self._river_buffers,
            context.upload(river_starts),
            context.upload(river_members),
        ]

    def covers(self, blocks: npt.NDArray[np.int64]) -> list[Any]:
        """Return the arguments that name the painted materials in blocks as in :meth:`terrain`."""
        everywhere = np.ones(len(self.recipe.covers), np.bool_)
        starts, members = field_lists(self._covers, everywhere, blocks)
        return [*self._cover_buffers, self.context.upload(starts), self.context.upload(members)]

    def _upload_world(self, cell: float) -> dict[str, Any]:
        upload, real = self.context.upload, self.context.real_dtype
        packed = pack_world(self.recipe, cell, real=real)
        lakes = pack_lakes(self.recipe, self._lakes, cell)
        octaves = packed.octaves
        return {
            "scalars": upload(packed.scalars),
            "styles": upload(packed.styles),
            "lakes_shown": lakes.shown,
            "lakes": [
                upload(self._lakes.at),
                upload(self._lakes.form),
                upload(lakes.shape.astype(real)),
                upload(lakes.profile.astype(real)),
            ],
            "table": octaves,
            "octaves": [upload(octaves.form), upload(octaves.offset), upload(octaves.scale.astype(real))],
        }

    def _upload_rules(self) -> list[Any]:
        """Return what ``RULE_ARGUMENTS`` in ``kernels/materials.clh`` names, in its order."""
        upload, real, rules = self.context.upload, self.context.real_dtype, pack_rules(self.recipe)
        return [
            np.int32(rules.count),
            upload(rules.form),
            upload(rules.cover.astype(real)),
            upload(rules.input),
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

    def _upload_rivers(self) -> list[Any]:
        upload, real, rivers = self.context.upload, self.context.real_dtype, self._rivers
        return [
            upload(rivers.start),
            *(upload(part.astype(real)) for part in (rivers.along, rivers.up, rivers.down)),
        ]
