"""Shadow maps of plants and of what is built, drawn in slices and reused until the eye moves on."""

from functools import lru_cache, partial
from typing import Final, NamedTuple, cast

import moderngl
import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.geometry.camera import Camera
from sketchterrain.look.tree_levels import DETAILS
from sketchterrain.render.built import BuiltScenery
from sketchterrain.render.lit_ground import GroundLighting
from sketchterrain.render.plant_cells import (
    Cell,
    CellKey,
    PlantCells,
    cells_near,
    join_cells,
    vanish_distance,
)
from sketchterrain.render.plant_meshes import (
    KINDS,
    MeshInstances,
    PlantBatch,
    PlantMeshes,
    visible_share,
    width_scale,
)
from sketchterrain.render.programs import build_program, clamped, set_uniforms
from sketchterrain.render.quality import UNLIMITED, Quality, TimeBudget, WorkRate
from sketchterrain.render.sky import Sun

MAPS: Final = ((0.06, 0.075), (0.45, 0.60))
"""Near and far map: offset of its middle ahead of the eye and half its side, in draw distances."""
HULL: Final = 5  # detail of the plants in a wide map, ...
FINE: Final = (2, HULL)  # ... and in both maps
FADE: Final = 0.5  # cross-fade to a new map, s
STEPS: Final = 8  # A map moves in steps of its side over this number
HALF_DEPTH: Final = 3000.0  # m along the light, up and down from the ground in the middle
DEPTH_STEP: Final = 500.0
LEAST_ANGLE: Final = 1e-6  # rad; before the culling angle is known, all plants throw shadows
MARGIN: Final = 30.0  # m beyond a map's border from where a plant's shadow may fall into it


class _Placement(NamedTuple):
    """Position of a map in the sun's axes (m)."""

    centre: tuple[float, float, float]
    half: float
    sun: Sun


_NOWHERE: Final = _Placement((0.0, 0.0, 0.0), 1e-3, Sun(0.0, 90.0))


class _ShadowMap:
    """One map with three targets: displayed, fading out, and being drawn; an empty one has one texel."""

    def __init__(self, context: moderngl.Context, texels: int) -> None:
        self._context, self._texels = context, texels
        self.current = self.previous = self.next = _depth_target(context, 1)
        self.placement = self.previous_placement = _NOWHERE
        self.share = 1.0  # weight of the current buffer against the previous one
        self.pending: _Placement | None = None
        self.changes = self.pending_changes = (-1, -1)  # of the plant cells, and of what is built
        self.drawn = 0  # instances

    def clear(self) -> None:
        """Clear the target to be drawn."""
        if self.next.width < self._texels:
            self.next = _depth_target(self._context, self._texels)
        self.next.use()  # what is cleared is clipped by the scissor of the bound framebuffer
        self.next.clear(depth=1.0)

    def swap(self, placement: _Placement) -> None:
        """Display the drawn target, cross-fading."""
        self.current, self.previous, self.next = self.next, self.current, self.previous
        self.placement, self.previous_placement = placement, self.placement
        self.changes, self.pending, self.share = self.pending_changes, None, 0.0


class PlantShadows:
    """The shadow maps of all plants, and of what is `built`, as the quality asks for.

    `angle` (rad) is as in `PlantDensity`.
    """

    def __init__(
        self,
        context: moderngl.Context,
        meshes: PlantMeshes,
        cells: PlantCells,
        sun: Sun,
        *,
        quality: Quality,
        draw_distance: float,
        built: BuiltScenery | None = None,
    ) -> None:
        self._cells, self._sun, self._draw_distance = cells, sun, draw_distance
        self._built = built
        self.angle = LEAST_ANGLE
        self._axes = sun_axes(sun)
        self._context = context
        count = quality.shade_maps if quality.includes("shadows") else 0
        self._maps = [_ShadowMap(context, quality.shade_texels) for _ in MAPS]
        self._details = FINE if count == len(MAPS) else (HULL,) * len(MAPS)
        self._used = range(len(MAPS) - count, len(MAPS))
        self._program = build_program(context, "tree_shadow.vert.glsl", "nothing.frag.glsl")
        self._batches = [PlantBatch(meshes, self._program) for _ in MAPS]
        self._requested: list[_Placement | None] = [None] * len(MAPS)
        self._rate = WorkRate(1e-6)  # s a plant
        self._origins = [np.zeros(2) for _ in MAPS]

    def relight(self, sun: Sun) -> None:
        """Replace the sun for maps that are started from now on."""
        self._sun, self._axes = sun, sun_axes(sun)

    @property
    def converged(self) -> bool:
        """Whether all maps show the current plants around the current eye."""
        return all(not self._stale(index) and self._maps[index].share == 1.0 for index in self._used)

    @property
    def textures(self) -> dict[str, moderngl.Texture]:
        """Textures by sampler name."""
        near, far = self._maps
        targets = {
            "shade_near": near.current,
            "shade_far": far.current,
            "shade_near_before": near.previous,
            "shade_far_before": far.previous,
        }
        return {name: cast("moderngl.Texture", each.depth_attachment) for name, each in targets.items()}

    @property
    def fade_shares(self) -> tuple[float, float]:
        """Weight of each map against its predecessor, 0 … 1."""
        near, far = self._maps
        return near.share, far.share

    def matrices(self, eye: tuple[float, float, float]) -> list[Float64Array]:
        """Return (4, 4) matrices from eye-relative positions to clip space: near, far, their predecessors."""
        placements = [shadow_map.placement for shadow_map in self._maps] + [
            shadow_map.previous_placement for shadow_map in self._maps
        ]
        return [self._matrix(placement, eye) for placement in placements]

    def request(self, camera: Camera, lit: GroundLighting) -> list[CellKey]:
        """Place the maps for a camera, and return the cells whose plants they need."""
        ahead = camera.forward[:2] / max(float(np.linalg.norm(camera.forward[:2])), 1e-6)
        cells: dict[CellKey, None] = {}
        for index in self._used:
            offset, half = MAPS[index][0], MAPS[index][1] * self._draw_distance
            x, y = (np.asarray(camera.eye[:2]) + ahead * offset * self._draw_distance).tolist()
            step = 2.0 * half / STEPS
            sunward = self._axes @ np.array([x, y, lit.height_at(x, y)])
            steps = np.array([step, step, DEPTH_STEP])
            u, v, w = (np.round(sunward / steps) * steps).tolist()
            self._requested[index] = _Placement((u, v, w), half, self._sun)
            cells.update(dict.fromkeys(cells_near(x, y, half)))
        self._covered = list(cells)
        return self._covered

    def advance(
        self, eye: tuple[float, float, float], elapsed: float, budget: TimeBudget = UNLIMITED
    ) -> None:
        """Advance by a frame time (s; infinite for a still): cross-fade, and draw within the time budget."""
        for index in self._used:
            shadow_map, batch = self._maps[index], self._batches[index]
            shadow_map.share = min(shadow_map.share + elapsed / FADE, 1.0)
            idle = shadow_map.pending is None and shadow_map.share == 1.0
            if idle and self._stale(index) and budget.left > 0.0:
                self._start(index, eye)
            while shadow_map.pending is not None:
                draw = partial(self._draw, index, shadow_map.pending)
                drawn = self._rate.run(budget, draw, count=batch.count - shadow_map.drawn)
                if shadow_map.drawn == batch.count:
                    shadow_map.swap(shadow_map.pending)
                elif not drawn:
                    break
            if elapsed == np.inf:
                shadow_map.share = 1.0

    def _stale(self, index: int) -> bool:
        shadow_map, requested = self._maps[index], self._requested[index]
        current = (shadow_map.placement, shadow_map.changes)
        return requested is not None and current != (requested, self._changes)

    @property
    def _changes(self) -> tuple[int, int]:
        return self._cells.changes, self._built.changes if self._built else 0

    def _start(self, index: int, eye: tuple[float, float, float]) -> None:
        """Select the plants of a map and clear its target."""
        shadow_map, placement = self._maps[index], self._requested[index]
        shadow_map.pending, shadow_map.pending_changes, shadow_map.drawn = placement, self._changes, 0
        if placement is None:
            return
        found = (self._cells[key] for key in self._covered)
        cells: list[Cell] = [cell for cell in found if cell is not None]
        self._origins[index] = origin = cells[0].corner if cells else np.zeros(2)
        plants = join_cells(cells, origin, [cell.count_above(eye, self.angle) for cell in cells])
        world = plants.position + np.array([*origin, 0.0])
        level = np.hypot(world[:, 0] - eye[0], world[:, 1] - eye[1])
        away = np.hypot(level, world[:, 2] - eye[2])
        lateral = np.abs(world @ sun_axes(placement.sun)[:2].T - placement.centre[:2]).max(
            axis=1, initial=0.0
        )
        visible = level < vanish_distance(plants.rank, self._draw_distance)
        visible &= visible_share(plants.cull, away, self.angle) > 0.0
        selected = np.flatnonzero(visible & (lateral < placement.half + MARGIN))
        selected = selected[np.argsort(plants.kind[selected], kind="stable")]
        rows = plants.rows[selected]
        rows[:, 4:6] *= width_scale(plants.importance[selected], away[selected], self.angle)[:, None]
        counts = np.zeros((KINDS, DETAILS), np.int64)
        counts[:, self._details[index]] = np.bincount(plants.kind[selected], minlength=KINDS)
        self._batches[index].set_instances(MeshInstances(rows, counts))
        shadow_map.clear()
        if self._built:
            to_map = self._matrix(placement, tuple(self._built.origin.tolist()))
            middle = np.array(placement.centre) @ sun_axes(placement.sun)
            # The depth step moves the middle along the sun's rays.
            self._built.draw_shadow(to_map, middle[:2], np.sqrt(2.0) * placement.half + MARGIN + DEPTH_STEP)

    def _draw(self, index: int, placement: _Placement, count: int) -> None:
        """Draw the next plants of a map."""
        shadow_map = self._maps[index]
        x, y = self._origins[index].tolist()
        self._context.enable_only(moderngl.DEPTH_TEST)
        shadow_map.next.use()
        to_map = self._matrix(placement, (x, y, 0.0)).astype(np.float32)
        set_uniforms(self._program, {"to_map": tuple(to_map.T.ravel().tolist())})
        self._batches[index].draw(shadow_map.drawn, shadow_map.drawn + count)
        self._context.finish()
        shadow_map.drawn += count

    def _matrix(self, placement: _Placement, eye: tuple[float, float, float]) -> Float64Array:
        centre = np.array(placement.centre) @ sun_axes(placement.sun) - eye
        return shadow_matrix(placement.sun, centre, placement.half, HALF_DEPTH)


@lru_cache(8)
def sun_axes(sun: Sun) -> Float64Array:
    """Return the axes of a shadow map: unit rows right, up and towards the sun; read-only."""
    back = sun.direction
    up = np.array([0.0, 0.0, 1.0]) if back[2] < 0.999 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(back, right), back])
    axes.flags.writeable = False
    return axes


def shadow_matrix(sun: Sun, centre: Float64Array, half_width: float, half_depth: float) -> Float64Array:
    """Return the (4, 4) orthographic matrix of a map with a centre and half sizes (m)."""
    matrix = np.eye(4)
    matrix[:3, :3] = sun_axes(sun) / np.array([half_width, half_width, -half_depth])[:, None]
    matrix[:3, 3] = -matrix[:3, :3] @ centre
    return matrix


def _depth_target(context: moderngl.Context, texels: int) -> moderngl.Framebuffer:
    target = context.framebuffer((), clamped(context.depth_texture((texels, texels))))
    target.use()
    target.clear(depth=1.0)
    return target
