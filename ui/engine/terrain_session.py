"""The terrain on a device, of the placer's plans or of a stored world; it changes devices when one fails."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from sketchterrain.errors import DeviceError, one_line
from sketchterrain.ui.engine.channel import unpickled
from sketchterrain.ui.engine.sketch_updates import SketchMirror

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from sketchterrain.compute import ComputeContext, Device
    from sketchterrain.sketch import Sketch
    from sketchterrain.terrain import Terrain, TerrainRecipe
    from sketchterrain.terrain.changes import Box
    from sketchterrain.ui.engine.protocol import Plan
    from sketchterrain.world.viewed import StoredTerrain


class TerrainSession:
    """What the newest plan makes of the sketch."""

    def __init__(self, open_device: Callable[[Device], ComputeContext], *, device: str | None = None) -> None:
        self._open_device = open_device
        self.terrain: Terrain | None = None
        self.sketch: Sketch | None = None
        self.recipe = b""
        self.lacks = ""  # one line, why there is no device
        self.dirty_areas: list[Box] = []  # m: heights that differ from what was shown last
        self._mirror = SketchMirror()
        self._failed: list[Device] = []
        self._context: ComputeContext | None = None
        self._open(device)

    @property
    def version(self) -> int:
        """Of the sketch that it shows; −1 before the first."""
        return self._mirror.version

    @property
    def device(self) -> Device | None:
        """What it is computed on; None where there is none."""
        return None if self._context is None else self._context.device

    def take(self, plans: list[Plan]) -> None:
        """Take plans over, of which only the last one's terrain is made."""
        recipe = None
        for plan in plans:
            self._mirror.apply(plan.update)
            self.dirty_areas += plan.areas
            recipe = plan.recipe or recipe
        self.sketch = self._mirror.sketch()
        if recipe is not None:
            self.recipe = recipe
            self._make(unpickled(recipe, but=self.sketch))
        elif self.terrain is not None:
            self._make(self.terrain.recipe)

    def switch_device(self) -> str:
        """Leave the device, which failed, for another one; return a line that says so.

        The terrain is made anew there; without another device there is none any more.
        """
        from sketchterrain.compute import fallback_device

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
            return f"goes on with {spare.name} ({spare.platform})"
        self._context = None
        self.lacks = "every OpenCL device failed: start the program again, or install another driver"
        return "there is no other device"

    def _open(self, selector: str | None) -> None:
        from sketchterrain.compute import choose_device

        try:
            self._context = self._open_device(choose_device(selector))
        except DeviceError as error:
            self.lacks = one_line(error)

    def _rebuild(self) -> None:
        if self.recipe:
            self._make(unpickled(self.recipe, but=self.sketch))

    def _make(self, recipe: TerrainRecipe) -> None:
        from sketchterrain.terrain import Terrain

        if self._context is None or self.sketch is None:
            return
        if self.terrain is None:
            self.terrain = Terrain(self.sketch, recipe, self._context)
        else:
            self.terrain = self.terrain.after(self.sketch, recipe, self.dirty_areas)


class WorldSession(TerrainSession):
    """A stored world in place of a terrain that is evaluated; there is no recipe and no sketch to update."""

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

    @property
    def version(self) -> int:
        """Always the same: nothing is edited."""
        return 0

    def _rebuild(self) -> None:
        from sketchterrain.terrain import build
        from sketchterrain.world.viewed import StoredTerrain

        if self._context is not None:
            sketch = self._stored.sketch()
            features = None if sketch is None else build(sketch, device=self._context)
            self.world = StoredTerrain(self._stored, self._context, features, told=self._report)
            self.terrain = cast("Terrain", self.world)  # for the renderer they are the same
