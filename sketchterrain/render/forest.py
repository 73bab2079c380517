"""Plants as instances in cross-fading levels of detail."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import moderngl
import numpy as np

from sketchterrain.array_types import BoolArray, Bounds, Float32Array, Float64Array, FloatArray
from sketchterrain.geometry.camera import Camera
from sketchterrain.look.tree_levels import DETAILS, MASKED_DETAILS
from sketchterrain.render.built import BuiltScenery
from sketchterrain.render.lit_ground import GroundLighting
from sketchterrain.render.plant_cells import (
    CROWN_MARGIN,
    CellKey,
    PlantCells,
    PlantInstances,
    cells_in_view,
    cells_near,
    join_cells,
    vanish_distance,
)
from sketchterrain.render.plant_meshes import (
    KINDS,
    MeshInstances,
    PlantBatch,
    PlantDensity,
    PlantMeshes,
    visible_share,
    width_scale,
)
from sketchterrain.render.plant_shade import PlantShadows
from sketchterrain.render.programs import build_program
from sketchterrain.render.quality import UNLIMITED, Quality, TimeBudget
from sketchterrain.render.scene import TerrainSource
from sketchterrain.render.sky import Sun

BLOCK: Final = 8  # cells along the side of a block of plants that a still generates at once
PIXELS: Final = (170.0, 60.0, 30.0, 14.0, 6.0, 3.0)
"""Height of a plant (px) below which the next coarser detail is used."""
COARSEST: Final = (20.0, 12.0)
"""Largest heights (px) of plants in the two coarsest details, however low the quality."""
VERTEX_LIT: Final = 4
"""First detail that is lit at its vertices, with shadows and air sampled once an instance."""
BATCHES: Final = (range(MASKED_DETAILS), range(MASKED_DETAILS, VERTEX_LIT), range(VERTEX_LIT, DETAILS))
"""Details drawn together; only masked leaves need a fragment shader that discards: no early depth test."""
BAND: Final = 0.08  # relative range of such a height over which one detail cross-fades into the next
VANISH: Final = 0.05  # share of the draw distance over which a single plant fades
UNKNOWN: Final = (-1e5, 1e5)  # vertical bounds of a cell that is not generated yet (m)
GROW: Final = 1.0  # seconds in which the plants of a new cell fade in


class Forest:
    """The plants around an eye up to `draw_distance` (m), their `density` LOD and their `shadows`."""

    def __init__(
        self,
        context: moderngl.Context,
        terrain: TerrainSource,
        sun: Sun,
        *,
        quality: Quality,
        defines: Mapping[str, int | str],
        built: BuiltScenery | None = None,
    ) -> None:
        self.draw_distance = min(quality.plant_distance, 0.45 * terrain.extent)
        self._pixels = np.array(PIXELS) / quality.plant_lod_scale
        self._pixels[-2:] = np.minimum(self._pixels[-2:], COARSEST)
        self._cells = PlantCells(terrain)
        self._context, self._meshes = context, PlantMeshes(context)
        self.rebuild(defines)
        self.shadows = PlantShadows(
            *(context, self._meshes, self._cells, sun),
            quality=quality,
            draw_distance=self.draw_distance,
            built=built,
        )
        self._enabled = quality.includes("trees")
        self._requested = self._grown = False
        self._visible: list[CellKey] = []
        self._requested_view: tuple[object, ...] = ()
        self._height = 1
        self._elapsed: float | None = None
        self._thin = quality.thinning_pixels
        self.density = PlantDensity(quality.max_plants)
        self._origin = np.zeros(2)

    def rebuild(self, defines: Mapping[str, int | str]) -> None:
        """Replace the programs by ones with other macros."""
        self._batches = [_batch(self._context, self._meshes, details, defines) for details in BATCHES]
        self._selected_view: tuple[object, ...] = ()

    @property
    def converged(self) -> bool:
        """Whether all plants and shadows of the last camera are complete and fully grown."""
        return self.loaded and (not self._enabled or self.density.converged)

    @property
    def loaded(self) -> bool:
        """Whether nothing is left to do for that but to draw frames."""
        grown = self._cells.complete and self._cells.youngest >= GROW
        return self._requested and grown and self.shadows.converged

    @property
    def triangles(self) -> int:
        """Triangles of the last frame."""
        return sum(batch.triangles for batch in self._batches)

    def update(
        self,
        camera: Camera,
        size: tuple[int, int],
        lit: GroundLighting,
        elapsed: float,
        budget: TimeBudget,
    ) -> None:
        """Advance by a frame: generate plants and shadows within a time budget.

        `size` is that of the whole picture (px), even where a smaller one is drawn and enlarged.
        """
        self._elapsed = elapsed
        self._request(camera, size, lit)
        self._cells.grow(elapsed)
        self.shadows.advance(camera.eye, elapsed, budget.fraction(0.5))
        self._cells.advance(budget)

    def refine(
        self, camera: Camera, size: tuple[int, int], lit: GroundLighting, budget: TimeBudget = UNLIMITED
    ) -> bool:
        """Generate plants and shadows of a still within a budget; return whether they are complete."""
        self._elapsed = None
        self._request(camera, size, lit)
        self._cells.advance(budget, block=BLOCK)
        if not self._cells.complete:
            return False
        self._cells.grow(np.inf)
        self._request(camera, size, lit)  # visibility depends on the cells' vertical bounds
        if self._enabled:
            self._select(camera, size)
        self.shadows.advance(camera.eye, np.inf, budget)
        return self._cells.complete and self.shadows.converged

    def set_terrain(self, terrain: TerrainSource, areas: Sequence[Bounds]) -> None:
        """Replace the terrain; plants follow over the next frames, see `PlantCells.set_terrain`."""
        self._cells.set_terrain(terrain, areas)
        self._requested_view = ()

    def relight(self, sun: Sun) -> None:
        """Replace the sun; shadow maps stay until new ones are ready."""
        self.shadows.relight(sun)
        self._requested_view = ()

    def _request(self, camera: Camera, size: tuple[int, int], lit: GroundLighting) -> None:
        self._requested, self._height = True, size[1]
        view = (camera, size, self._cells.changes)
        if not self._enabled or (view == self._requested_view and lit.converged):
            return
        self._requested_view = view
        near = cells_near(camera.eye[0], camera.eye[1], self.draw_distance)
        cells = [self._cells[key] for key in near]
        bounds = np.array(
            [UNKNOWN if cell is None or cell.stale else (cell.low, cell.high) for cell in cells]
        )
        visible = cells_in_view(camera.frustum(size[0] / size[1]), near, bounds)
        self._visible = [key for key, is_visible in zip(near, visible.tolist(), strict=True) if is_visible]
        shading = [key for key in self.shadows.request(camera, lit) if key not in set(self._visible)]
        self._cells.request(self._visible + shading)

    def draw(
        self, camera: Camera, size: tuple[int, int], uniforms: Mapping[str, object], *, parts: int
    ) -> Iterator[None]:
        """Draw the plants in a camera's view of a size (px); yield between parts."""
        if not self._enabled:
            return
        self._select(camera, size)
        anchor = (*(self._origin - camera.eye[:2]).tolist(), -camera.eye[2])
        for batch in self._batches:
            yield from batch.evaluate_and_draw({**uniforms, "anchor": anchor}, parts=parts)

    def _select(self, camera: Camera, size: tuple[int, int]) -> None:
        """Select the instances and their details; skipped for a view at rest."""
        cells = [cell for cell in (self._cells[key] for key in self._visible) if cell is not None]
        view = (camera, size, tuple(self._visible), self._cells.changes)
        grown = all(cell.age >= GROW for cell in cells)
        if view == self._selected_view and self._grown and self.density.converged:
            return
        self._selected_view, self._grown = view, grown
        self._origin = cells[0].corner if cells else np.zeros(2)
        tangent = 2.0 * np.tan(np.radians(camera.fov) / 2.0)
        least = self._thin * tangent / self._height
        floor = self.density.floor(least, still=self._elapsed is None)
        counts = [cell.count_above(camera.eye, floor) for cell in cells]
        plants = join_cells(cells, self._origin, counts)
        position = plants.position - (np.asarray(camera.eye) - [*self._origin, 0.0]).astype(np.float32)
        level = np.hypot(position[:, 0], position[:, 1])
        away = np.maximum(np.hypot(level, position[:, 2]), 1.0)
        ages = [cell.ages(count) for cell, count in zip(cells, counts, strict=True)]
        age = np.concatenate([np.zeros(0, np.float32), *ages])
        presence = _presence(plants.rank, level, age, self.draw_distance)
        presence *= _between_sides(camera.frustum(size[0] / size[1]), position)
        angles = plants.cull / away
        visible = np.flatnonzero((angles > floor) & (presence > 0.0))
        plants, away, presence, angles = (
            plants.subset(visible),
            away[visible],
            presence[visible],
            angles[visible],
        )
        shares = detail_shares(plants.height * (size[1] / tangent) / away, plants.rank, self._pixels)
        copies = np.count_nonzero(shares, axis=1)
        self.density.update(angles, copies, least=least, elapsed=self._elapsed)
        self.shadows.angle = angle = self.density.angle
        shares *= (presence * visible_share(plants.cull, away, angle))[:, None]
        plants.rows[:, 4:6] *= width_scale(plants.importance, away, angle)[:, None]
        for batch, details in zip(self._batches, BATCHES, strict=True):
            batch.set_instances(_sorted_by_mesh(plants, shares, details))


def _batch(
    context: moderngl.Context, meshes: PlantMeshes, details: range, defines: Mapping[str, int | str]
) -> PlantBatch:
    far = details.start >= VERTEX_LIT
    own = {**defines, "SPRIGS": int(details.start < MASKED_DETAILS), "FAR": int(far)}
    captured = ("ground", "sway", "veil", "clear") if far else ("ground", "sway")
    return PlantBatch(
        meshes,
        build_program(context, "tree.vert.glsl", "lit.frag.glsl" if far else "tree.frag.glsl", defines=own),
        transform=build_program(context, "tree_stand.vert.glsl", captured=captured, defines=own),
        captured=captured,
    )


def detail_shares(pixels: FloatArray, rank: FloatArray, steps: Float64Array) -> Float64Array:
    """Return (n, details) cross-fade weights for plants of (n,) heights (px), each row's sum 1.

    `rank` 0..1 shifts a plant's thresholds, so that no ring of switching plants is visible; `steps` are the
    falling heights of the next coarser detail (px).
    """
    height = np.asarray(pixels, np.float64) / (0.85 + 0.3 * np.asarray(rank, np.float64))
    finer = np.clip((height[:, None] / steps - (1.0 - BAND)) / (2.0 * BAND), 0.0, 1.0)
    edges = np.concatenate([np.zeros((len(finer), 1)), finer, np.ones((len(finer), 1))], axis=1)
    return np.diff(edges, axis=1)


def _presence(rank: Float32Array, away: FloatArray, age: FloatArray, draw_distance: float) -> FloatArray:
    """Return plants' opacity: each vanishes at its own distance and appears at its own time."""
    vanished = (vanish_distance(rank, draw_distance) - away) / (VANISH * draw_distance)
    appeared = 2.0 * age / GROW - (1.0 - rank)
    return np.asarray(np.clip(np.minimum(vanished, appeared), 0.0, 1.0))


def _between_sides(planes: Float64Array, position: FloatArray) -> BoolArray:
    """Return which eye-relative positions are between the left and right plane of a view."""
    return np.asarray((position @ planes[:2, :3].T.astype(position.dtype) > -CROWN_MARGIN).all(axis=1))


def _sorted_by_mesh(plants: PlantInstances, shares: Float64Array, details: range) -> MeshInstances:
    """Sort instances by kind and detail, cross-fading ones twice."""
    detail, plant = np.nonzero(shares.T[details.start : details.stop] > 1.0 / 512.0)
    detail += details.start
    group = plants.kind[plant] * DETAILS + detail
    order = np.argsort(group.astype(np.uint8), kind="stable")  # bytes: radix sort, three times as fast
    plant, detail = plant[order], detail[order]
    rows = plants.rows[plant]
    rows[:, 7] = shares[plant, detail]
    counts = np.bincount(group, minlength=KINDS * DETAILS)
    return MeshInstances(rows, counts.reshape(KINDS, DETAILS))
