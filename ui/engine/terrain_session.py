"""The engine's terrain on an OpenCL device, from recipes or a stored world; failover to other devices."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, cast

from sketchterrain.array_types import Bounds
from sketchterrain.compute.device import Device
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import DeviceError, one_line
from sketchterrain.terrain.recipe import TerrainRecipe
from sketchterrain.ui.engine.channel import unpickle_with
from sketchterrain.ui.engine.protocol import RecipeUpdate, WorldFacts
from sketchterrain.ui.engine.sketch_updates import SketchMirror

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.terrain.terrain import Terrain
    from sketchterrain.world.viewed import StoredTerrain


class TerrainSession:
    """The terrain of the newest recipe."""

    def __init__(self, open_device: Callable[[Device], ComputeContext], *, device: str | None = None) -> None:
        from sketchterrain.compute.device import choose_device

        self._open_device = open_device
        self.terrain: Terrain | None = None
        self.sketch: Sketch | None = None
        self.recipe = b""
        self.device_error = ""  # one line, why there is no device
        self.dirty_areas: list[Bounds] = []  # m: where heights differ from the displayed ones
        self._mirror = SketchMirror()
        self._failed: list[Device] = []
        self._context: ComputeContext | None = None
        try:
            self._context = self._open_device(choose_device(device))
        except DeviceError as error:
            self.device_error = one_line(error)

    @property
    def version(self) -> int:
        """Version of the sketch; −1 before the first."""
        return self._mirror.version

    @property
    def device(self) -> Device | None:
        """The OpenCL device in use."""
        return None if self._context is None else self._context.device

    def apply(self, updates: list[RecipeUpdate]) -> None:
        """Apply updates; only the last one's terrain is created."""
        recipe = None
        for update in updates:
            self._mirror.apply(update.sketch)
            self.dirty_areas += update.areas
            recipe = update.recipe or recipe
        self.sketch = self._mirror.sketch()
        if recipe is not None:
            self.recipe = recipe
            self._set_recipe(unpickle_with(recipe, self.sketch))
        elif self.terrain is not None:
            self._set_recipe(self.terrain.recipe)

    def switch_device(self) -> str:
        """Re-create the terrain on another device after a failure; return a line that reports which."""
        from sketchterrain.compute.device import fallback_device

        failed = self.device
        self.terrain, self._context = None, None
        if failed is not None:
            self._failed.append(failed)
        while (spare := fallback_device(self._failed)) is not None:
            try:
                self._context = self._open_device(spare)
                self._rebuild()
            except DeviceError:
                self._failed.append(spare)
                continue
            return f"continuing on {spare.name} ({spare.platform})"
        self._context = None
        self.device_error = "every OpenCL device failed: start the program again, or install another driver"
        return "there is no other device"

    def _rebuild(self) -> None:
        if self.recipe:
            self._set_recipe(unpickle_with(self.recipe, self.sketch))

    def _set_recipe(self, recipe: TerrainRecipe) -> None:
        from sketchterrain.terrain.terrain import Terrain

        if self._context is None or self.sketch is None:
            return
        if self.terrain is None:
            self.terrain = Terrain(self.sketch, recipe, self._context)
        else:
            self.terrain = self.terrain.updated(self.sketch, recipe, self.dirty_areas)


class WorldSession(TerrainSession):
    """A stored world in place of an evaluated terrain, without recipe or updates."""

    version = 0

    def __init__(
        self,
        path: Path,
        report: Callable[[str], None],
        open_device: Callable[[Device], ComputeContext],
        *,
        device: str | None = None,
    ) -> None:
        from sketchterrain.world.opening import open_world

        self._stored, self._report = open_world(path), report
        self.world: StoredTerrain | None = None
        super().__init__(open_device, device=device)
        self._rebuild()

    def facts(self) -> WorldFacts:
        """Return the bounds and missing parts of the world."""
        world = self.world
        assert world is not None  # noqa: S101 # asked when there is a device
        west, south, east, north = world.bounds
        middle = float(world.heights((west + east) / 2, (south + north) / 2))
        return WorldFacts(world.corner, world.bounds, world.finest_cell, middle, tuple(world.missing_parts))

    def _rebuild(self) -> None:
        from sketchterrain.terrain.building import build
        from sketchterrain.world.viewed import StoredTerrain

        if self._context is not None:
            sketch = self._stored.sketch()
            features = None if sketch is None else build(sketch, device=self._context)
            self.world = StoredTerrain(self._stored, self._context, features, on_error=self._report)
            self.terrain = cast("Terrain", self.world)  # equivalent for the renderer
