"""Maps of the shadows that plants throw, seen from the sun: made in slices, kept until the eye moves on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import moderngl
import numpy as np

from sketchterrain.look.tree_levels import DETAILS
from sketchterrain.render.budgets import WorkRate
from sketchterrain.render.plant_cells import Place, cells_near, joined, reach_of
from sketchterrain.render.plant_meshes import KINDS, Instances, PlantMeshes, share_of, width_of
from sketchterrain.render.programs import build_program, set_uniforms
from sketchterrain.render.sky import Sun

if TYPE_CHECKING:
    from sketchterrain.array_types import Float64Array
    from sketchterrain.render.budgets import TimeBudget
    from sketchterrain.render.camera import Camera
    from sketchterrain.render.lit_ground import GroundLighting
    from sketchterrain.render.plant_cells import Cell, PlantCells
    from sketchterrain.render.quality import Quality


MAPS: Final = ((0.06, 0.075), (0.45, 0.60))
"""Near and far: where ahead its middle lies and half its side, in reaches of the woods."""
FINE: Final = (2, 5)
"""Detail of the plants in them, if there are both; a coarser one where the wide one is alone."""
FADE: Final = 0.5
"""s in which a map takes the place of the one before."""
STEPS: Final = 8
"""A map follows the eye in steps of one in so many of its sides."""
HALF_DEPTH: Final = 3000.0
"""m along the light, up and down from the ground in the middle."""
DEPTH_STEP: Final = 500.0
LEAST_ANGLE: Final = 1e-6
"""rad; before it is known how plants are thinned out, all throw shadows."""
ROOM: Final = 30.0
"""m beyond a map's border from where a plant's shadow may fall into it."""


class _Place(NamedTuple):
    """Where a map lies, in the sun's axes (m)."""

    centre: tuple[float, float, float]
    half: float
    sun: Sun


_NOWHERE: Final = _Place((0.0, 0.0, 0.0), 1e-3, Sun(0.0, 90.0))


class _Map:
    """One map: what is shown, what was shown before and fades, and what is drawn meanwhile."""

    def __init__(self, context: moderngl.Context, texels: int) -> None:
        self.shown, self.before, self.drawn = (_depth(context, texels) for _ in range(3))
        textures = (self.shown, self.before, self.drawn)
        self.targets = {id(each): context.framebuffer((), each) for each in textures}
        for target in self.targets.values():
            target.use()
            target.clear(depth=1.0)
        self.place = self.place_before = _NOWHERE
        self.share = 1.0  # of what is shown, against what was shown before
        self.coming: _Place | None = None
        self.changes = self.coming_changes = -1
        self.goes_on = 0

    def swap(self, place: _Place) -> None:
        """Show what is drawn, softly."""
        self.shown, self.before, self.drawn = self.drawn, self.shown, self.before
        self.place, self.place_before = place, self.place
        self.changes, self.coming, self.share = self.coming_changes, None, 0.0


class PlantShade:
    """The shadow maps of all plants: as many as the quality asks for, the wide one last.

    Parameters
    ----------
    context
        Where they are drawn.
    meshes
        Of the plants.
    cells
        Which plants stand where.
    sun
        From where it shines.
    quality
        How many maps, and their side.
    reach
        Distance at which the last plants stand (m).

    Attributes
    ----------
    angle : float
        rad, from which on plants are thinned out, see `Thinning`.
    """

    def __init__(
        self,
        context: moderngl.Context,
        meshes: PlantMeshes,
        cells: PlantCells,
        sun: Sun,
        *,
        quality: Quality,
        reach: float,
    ) -> None:
        self._cells, self._sun, self._reach = cells, sun, reach
        self.angle = LEAST_ANGLE
        self._axes = sun_axes(sun)
        self._context = context
        count = quality.shade_maps if quality.includes("shadows") else 0
        self._maps = [_Map(context, quality.shade_texels if count else 1) for _ in MAPS]
        self._details = FINE if count == len(MAPS) else (DETAILS - 1,) * len(MAPS)
        self._used = range(len(MAPS) - count, len(MAPS))
        program = build_program(context, "tree_shadow.vert.glsl", "nothing.frag.glsl")
        self._batches = [meshes.drawn_by(program) for _ in MAPS]
        self._program = program
        self._wanted: list[_Place | None] = [None] * len(MAPS)
        self._pace = WorkRate(1e-6)  # s a plant
        self._origins = [np.zeros(2) for _ in MAPS]

    def relight(self, sun: Sun) -> None:
        """Let another sun shine on the maps that are begun from now on."""
        self._sun, self._axes = sun, sun_axes(sun)

    @property
    def settled(self) -> bool:
        """Whether all maps show what stands there now, where the eye is now."""
        return all(not self._stale(index) and self._maps[index].share == 1.0 for index in self._used)

    @property
    def textures(self) -> dict[str, moderngl.Texture]:
        """By the names that shaders know them by."""
        near, far = self._maps
        return {
            "shade_near": near.shown,
            "shade_far": far.shown,
            "shade_near_before": near.before,
            "shade_far_before": far.before,
        }

    @property
    def shown_share(self) -> tuple[float, float]:
        """How much each map is shown, against the one before it, 0 … 1."""
        near, far = self._maps
        return near.share, far.share

    def matrices(self, eye: tuple[float, float, float]) -> list[Float64Array]:
        """Return the (4, 4) matrices from positions relative to the eye to the clip spaces of the maps.

        The near and the far one, then those of the maps before them.
        """
        places = [each.place for each in self._maps] + [each.place_before for each in self._maps]
        return [self._matrix(place, eye) for place in places]

    def places(self, camera: Camera, lit: GroundLighting) -> list[Place]:
        """Say where the maps should lie for a camera, and return the cells whose plants they show."""
        ahead = camera.forward[:2] / max(float(np.linalg.norm(camera.forward[:2])), 1e-6)
        cells: dict[Place, None] = {}
        for index in self._used:
            middle, half = MAPS[index]
            x, y = (np.asarray(camera.eye[:2]) + ahead * middle * self._reach).tolist()
            step = 2.0 * half * self._reach / STEPS
            sunward = self._axes @ np.array([x, y, lit.height_at(x, y)])
            steps = np.array([step, step, DEPTH_STEP])
            u, v, w = (np.round(sunward / steps) * steps).tolist()
            self._wanted[index] = _Place((u, v, w), half * self._reach, self._sun)
            cells.update(dict.fromkeys(cells_near(x, y, half * self._reach)))
        self._covered = list(cells)
        return self._covered

    def go_on(self, eye: tuple[float, float, float], elapsed: float, allowance: TimeBudget) -> None:
        """Go on by a frame: fade over, and draw what an allowance allows."""
        for index in self._used:
            each = self._maps[index]
            each.share = min(each.share + elapsed / FADE, 1.0)
            if each.coming is None and self._stale(index) and each.share == 1.0 and allowance.left > 0.0:
                self._begin(index, eye)
            while each.coming is not None:
                batch = self._batches[index]
                count = min(self._pace.steps_within(allowance), batch.count - each.goes_on)
                if not count and batch.count:
                    break
                before = allowance.spent
                self._draw(index, count)
                if count:
                    self._pace.record(count, allowance.spent - before)

    def finish(self, eye: tuple[float, float, float]) -> None:
        """Draw all that is missing at once."""
        for index in self._used:
            if self._stale(index):
                self._begin(index, eye)
                self._draw(index, self._batches[index].count)
            self._maps[index].share = 1.0

    def _stale(self, index: int) -> bool:
        each, wanted = self._maps[index], self._wanted[index]
        return wanted is not None and (each.place, each.changes) != (wanted, self._cells.changes)

    def _begin(self, index: int, eye: tuple[float, float, float]) -> None:
        """Choose the plants of a map that is drawn anew."""
        each = self._maps[index]
        each.coming, each.coming_changes, each.goes_on = self._wanted[index], self._cells.changes, 0
        found = (self._cells[place] for place in self._covered)
        cells: list[Cell] = [cell for cell in found if cell is not None]
        origin = cells[0].corner if cells else np.zeros(2)
        self._origins[index] = origin
        stand = joined(cells, origin, [cell.held(eye, self.angle) for cell in cells])
        place = _Place((0.0, 0.0, 0.0), 1.0, self._sun) if each.coming is None else each.coming
        world = stand.place + np.array([*origin, 0.0])
        level = np.hypot(world[:, 0] - eye[0], world[:, 1] - eye[1])
        away = np.hypot(level, world[:, 2] - eye[2])
        aside = np.abs(world @ sun_axes(place.sun)[:2].T - place.centre[:2]).max(axis=1, initial=0.0)
        stays = (level < reach_of(stand.whim, self._reach)) & (share_of(stand.hold, away, self.angle) > 0.0)
        chosen = np.flatnonzero(stays & (aside < place.half + ROOM))
        chosen = chosen[np.argsort(stand.kind[chosen], kind="stable")]
        rows = stand.rows[chosen]
        rows[:, 4:6] *= width_of(stand.bulk[chosen], away[chosen], self.angle)[:, None]
        counts = np.zeros((KINDS, DETAILS), np.int64)
        counts[:, self._details[index]] = np.bincount(stand.kind[chosen], minlength=KINDS)
        self._batches[index].put(Instances(rows, counts))
        target = each.targets[id(each.drawn)]
        target.use()
        target.clear(depth=1.0)

    def _draw(self, index: int, count: int) -> None:
        """Draw the next plants of a map; the last ones bring it into view."""
        each, batch = self._maps[index], self._batches[index]
        if each.coming is None:
            return
        if count:
            x, y = self._origins[index].tolist()
            self._context.enable_only(moderngl.DEPTH_TEST)
            each.targets[id(each.drawn)].use()
            to_map = self._matrix(each.coming, (x, y, 0.0)).astype(np.float32)
            set_uniforms(self._program, {"to_map": tuple(to_map.T.ravel().tolist())})
            batch.draw(each.goes_on, each.goes_on + count)
            self._context.finish()
            each.goes_on += count
        if each.goes_on == batch.count:
            each.swap(each.coming)

    def _matrix(self, place: _Place, eye: tuple[float, float, float]) -> Float64Array:
        centre = np.array(place.centre) @ sun_axes(place.sun) - eye
        return shade_matrix(place.sun, centre, place.half, HALF_DEPTH)


def sun_axes(sun: Sun) -> Float64Array:
    """Return the axes of a map seen from the sun: unit rows right, up and towards the sun."""
    back = sun.direction
    up = np.array([0.0, 0.0, 1.0]) if back[2] < 0.999 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(back, right), back])


def shade_matrix(sun: Sun, centre: Float64Array, half_width: float, half_depth: float) -> Float64Array:
    """Return the (4, 4) matrix from positions relative to a point to a map seen from the sun.

    Parameters
    ----------
    sun
        Its direction is the map's axis.
    centre
        (3,) middle of what the map covers, relative to that point (m).
    half_width, half_depth
        Half the map's side, and half the range of depth along the light (m).
    """
    matrix = np.eye(4)
    matrix[:3, :3] = sun_axes(sun) / np.array([half_width, half_width, -half_depth])[:, None]
    matrix[:3, 3] = -matrix[:3, :3] @ centre
    return matrix


def _depth(context: moderngl.Context, texels: int) -> moderngl.Texture:
    texture = context.depth_texture((texels, texels))
    texture.compare_func = "<="
    texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
    texture.repeat_x = texture.repeat_y = False
    return texture
