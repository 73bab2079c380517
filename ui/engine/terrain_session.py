"""The engine's terrain on an OpenCL device, from recipes or a stored world; relief images for the canvas."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final, cast

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Bounds
from sketchterrain.compute.device import Device
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import DeviceError, one_line
from sketchterrain.terrain.recipe import TerrainRecipe
from sketchterrain.ui.engine.protocol import RecipeUpdate, Relief, WorldFacts

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.generation.terrain import Terrain
    from sketchterrain.world.viewed import StoredTerrain


LARGEST: Final = 1024  # samples along the longer side
_POINTS: Final = 16384  # samples evaluated at once
_BAND: Final = 32  # rows
_INTERVAL: Final = 0.4  # s between reliefs during a stroke
_LIGHT: Final = np.array([-0.5, 0.5, 0.75]) / np.linalg.norm([-0.5, 0.5, 0.75])
_EXAGGERATION: Final = 1.6  # of slopes, so that gentle terrain shows its shape too


class ReliefBuilder:
    """Computes the relief in slices; each one that it returns is of a single version."""

    def __init__(self) -> None:
        self._terrain: Terrain | None = None
        self._version = -1
        self._step = 0
        self._height = np.zeros((0, 0), np.float32)
        self._shade = np.zeros((0, 0), np.uint8)
        self._stale = np.zeros((0, 0), np.bool_)
        self._work: Iterator[Relief | None] | None = None
        self._returned_at = 0.0

    def set_terrain(self, terrain: Terrain, version: int, areas: list[Bounds]) -> None:
        """Compute this terrain next, which differs from the previous one in areas (m) only."""
        sketch = terrain.sketch
        step = max(-(-max(sketch.width_px, sketch.height_px) // LARGEST), 1)
        shape = (-(-sketch.height_px // step), -(-sketch.width_px // step))
        rescaled = self._terrain is None or self._terrain.sketch.pixel_size != sketch.pixel_size
        if rescaled or shape != self._height.shape:
            self._height, self._shade = np.zeros(shape, np.float32), np.zeros(shape, np.uint8)
            self._stale = np.ones(shape, np.bool_)
            self._work = None
        self._terrain, self._version, self._step = terrain, version, step
        cell = step * sketch.pixel_size
        north = sketch.height_px * sketch.pixel_size
        for west, south, east, top in areas:
            rows = _samples((north - top) / cell, (north - south) / cell, shape[0])
            self._stale[rows, _samples(west / cell, east / cell, shape[1])] = True

    @property
    def busy(self) -> bool:
        return self._work is not None or bool(self._stale.any())

    def due(self, *, update_pending: bool) -> float | None:
        """Return the s until work is resumed; None: up to date. Tiles of a pending terrain go first."""
        if not self.busy:
            return None
        return max(_INTERVAL - (time.monotonic() - self._returned_at), 0.0) if update_pending else 0.0

    def work(self, seconds: float) -> Relief | None:
        """Compute for about this long; return the relief once it is complete."""
        until = time.perf_counter() + seconds
        while self.busy:
            if self._work is None:
                assert self._terrain is not None  # noqa: S101 # otherwise nothing is stale
                stale, self._stale = self._stale, np.zeros_like(self._stale)
                self._work = self._steps(self._terrain, self._version, stale)
            relief = next(self._work)
            if relief is not None:
                self._work, self._returned_at = None, time.monotonic()
                return relief
            if time.perf_counter() >= until:
                break
        return None

    def _steps(self, terrain: Terrain, version: int, stale: npt.NDArray[np.bool_]) -> Iterator[Relief | None]:
        """Compute stale samples of this terrain even if it is replaced meanwhile; yield the relief last."""
        cell, height = self._step * terrain.sketch.pixel_size, self._height
        north = terrain.sketch.height_px * terrain.sketch.pixel_size
        for top in range(0, len(stale), _BAND):
            columns = np.flatnonzero(stale[top : top + _BAND].any(axis=0))
            if not columns.size:
                continue
            left, right = int(columns[0]), int(columns[-1]) + 1
            x = (np.arange(left, right) + 0.5) * cell
            deep = max(_POINTS // len(x), 1)
            for row in range(top, min(top + _BAND, len(stale)), deep):
                end = min(row + deep, top + _BAND, len(stale))
                y = north - (np.arange(row, end) + 0.5) * cell
                height[row:end, left:right] = terrain.heights(x[None, :], y[:, None], cell_size=cell)
                yield None
        rows = np.flatnonzero(stale.any(axis=1))
        first, last = (int(rows[0]), int(rows[-1]) + 1) if rows.size else (0, 0)
        for top in range(max(first - 1, 0), last + 1, 4 * _BAND):
            end = min(top + 4 * _BAND, last + 1, len(stale))
            above, below = max(top - 1, 0), min(end + 1, len(stale))
            self._shade[top:end] = hill_shade(height[above:below], cell)[top - above : end - above]
            yield None
        if not self._stale.any():  # a newer terrain is equal everywhere
            version = self._version
        yield Relief(version, self._step, height.copy(), self._shade.copy(), terrain.sea_level)


def hill_shade(height: npt.NDArray[np.float32], cell: float) -> npt.NDArray[np.uint8]:
    """Return Lambertian hill-shading, light from the north-west, 0 … 255; level terrain is about 185."""
    east = np.gradient(height, cell / _EXAGGERATION, axis=1) if height.shape[1] > 1 else np.zeros_like(height)
    south = (
        np.gradient(height, cell / _EXAGGERATION, axis=0) if height.shape[0] > 1 else np.zeros_like(height)
    )
    light = (_LIGHT[2] - east * _LIGHT[0] + south * _LIGHT[1]) / np.sqrt(1.0 + east**2 + south**2)
    return np.asarray(np.clip(light, 0.0, 1.0) * 255.0, np.uint8)


def _samples(low: float, high: float, count: int) -> slice:
    """Return the samples in a range of positions (in samples), rounded outwards."""
    first = 0 if low < 0 else min(math.floor(low), count)
    last = count if high > count else max(math.ceil(high), 0)
    return slice(first, last)


class TerrainSession:
    """The terrain of the newest recipe."""

    def __init__(self, open_device: Callable[[Device], ComputeContext], *, device: str | None = None) -> None:
        from sketchterrain.compute.device import choose_device

        self._open_device = open_device
        self.terrain: Terrain | None = None
        self.sketch: Sketch | None = None
        self.recipe: TerrainRecipe | None = None  # of the last version but drafts
        self._shown: TerrainRecipe | None = None
        self.version = -1  # of the sketch
        self.device_error = ""  # one line, why there is no device
        self.dirty_areas: list[Bounds] = []  # m: where heights differ from the displayed ones
        self._failed: list[Device] = []
        self._context: ComputeContext | None = None
        try:
            self._context = self._open_device(choose_device(device))
        except DeviceError as error:
            self.device_error = one_line(error)

    @property
    def device(self) -> Device | None:
        return None if self._context is None else self._context.device

    def build_kernels(self) -> None:
        """Build the kernels of a terrain of built-in materials on a thread."""
        from sketchterrain.generation.building import TERRAIN_KERNELS, build_kernels
        from sketchterrain.schema.materials import BUILT_IN

        if self._context is not None:
            build_kernels(self._context, BUILT_IN, ("terrain.cl", *TERRAIN_KERNELS))

    def apply(self, updates: list[RecipeUpdate]) -> None:
        """Apply updates; only the last one's terrain is created."""
        for update in updates:
            self._shown = update.recipe or self.recipe
            if not update.draft:
                self.recipe, self.version, self.sketch = self._shown, update.version, update.sketch
        self._update_terrain(updates[-1].sketch)

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
                self._update_terrain()
            except DeviceError:
                self._failed.append(spare)
                continue
            return f"continuing on {spare.name} ({spare.platform})"
        self._context = None
        self.device_error = "every OpenCL device failed: start the program again, or install another driver"
        return "there is no other device"

    def _update_terrain(self, sketch: Sketch | None = None) -> None:
        from sketchterrain.generation.terrain import Terrain
        from sketchterrain.terrain.recipe import EVERYWHERE

        sketch, recipe = sketch or self.sketch, self._shown
        if self._context is None or sketch is None or recipe is None:
            return
        if self.terrain is None:
            self.terrain, self.dirty_areas = Terrain(sketch, recipe, self._context), [EVERYWHERE]
        else:
            self.terrain, areas = self.terrain.updated(sketch, recipe)
            self.dirty_areas += areas


class WorldSession(TerrainSession):
    """A stored world in place of an evaluated terrain, without recipe or updates."""

    def __init__(
        self,
        path: Path,
        report: Callable[[str], None],
        open_device: Callable[[Device], ComputeContext],
        *,
        device: str | None = None,
    ) -> None:
        from sketchterrain.world.stored_world import open_world

        self._stored, self._report = open_world(path), report
        self.world: StoredTerrain | None = None
        super().__init__(open_device, device=device)
        self.version = 0
        self._update_terrain()

    def facts(self) -> WorldFacts:
        """Return the bounds and missing parts of the world."""
        world = self.world
        assert world is not None  # noqa: S101 # asked when there is a device
        west, south, east, north = world.bounds
        middle = float(world.heights((west + east) / 2, (south + north) / 2))
        return WorldFacts(world.corner, world.bounds, world.finest_cell, middle, tuple(world.missing_parts))

    def _update_terrain(self, _: Sketch | None = None) -> None:
        from sketchterrain.generation.building import build
        from sketchterrain.world.viewed import StoredTerrain

        if self._context is not None:
            sketch = self._stored.sketch()
            features = None if sketch is None else build(sketch, device=self._context)
            self.world = StoredTerrain(self._stored, self._context, features, on_error=self._report)
            self.terrain = cast("Terrain", self.world)  # equivalent for the renderer
