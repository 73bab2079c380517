"""Plants in the view, as instances in levels of detail that pass into each other."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.look.tree_levels import DETAILS, MASKED_DETAILS
from sketchterrain.render.plant_cells import (
    ROOM,
    Place,
    PlantCells,
    Stand,
    cells_near,
    in_view,
    joined,
    reach_of,
)
from sketchterrain.render.plant_meshes import (
    KINDS,
    Instances,
    PlantBatch,
    PlantMeshes,
    Thinning,
    share_of,
    width_of,
)
from sketchterrain.render.plant_shade import PlantShade
from sketchterrain.render.programs import build_program, build_transform

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import moderngl
    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array
    from sketchterrain.render.budgets import TimeBudget
    from sketchterrain.render.camera import Camera
    from sketchterrain.render.lit_ground import GroundLighting
    from sketchterrain.render.quality import Quality
    from sketchterrain.render.scene import TerrainSource
    from sketchterrain.render.sky import Sun


PIXELS: Final = (170.0, 60.0, 30.0, 14.0, 6.0)
"""Height of a plant in pixels under which the next coarser detail does."""
HULL: Final = 20.0
"""px; the coarsest detail does for no higher plants, however low the quality."""
LIT: Final = 4
"""Detail from which on plants are lit at their vertices, by what is found once for each."""
DRAWN: Final = (range(MASKED_DETAILS), range(MASKED_DETAILS, LIT), range(LIT, DETAILS))
"""Details that are drawn together. Only fine leaves are cut out: what may be cut hides nothing before it is
shaded."""
BAND: Final = 0.08
"""Share of such a height, up and down, over which one detail passes into the next."""
VANISH: Final = 0.05
"""Share of the reach over which a single plant goes."""
UNKNOWN: Final = (-1e5, 1e5)
"""m; lowest and highest point of a cell that is not made yet."""
GROW: Final = 1.0
"""s in which the plants of a new cell come."""


class Forest:
    """The plants around an eye.

    Parameters
    ----------
    context
        Where they are drawn.
    terrain
        Whose plants.
    sun
        What they stand before.
    quality
        How far and how finely they are drawn.
    defines
        Macros of the shading, see `Shading.defines`.

    Attributes
    ----------
    reach : float
        Distance at which the last plants stand (m).
    shade : PlantShade
        The shadows that they throw.
    thinning : Thinning
        From what angle on they go.
    """

    def __init__(
        self,
        context: moderngl.Context,
        terrain: TerrainSource,
        sun: Sun,
        *,
        quality: Quality,
        defines: Mapping[str, int],
    ) -> None:
        self.reach = min(quality.woods, 0.45 * terrain.extent)
        self._pixels = np.array(PIXELS) / quality.leaves
        self._pixels[-1] = min(self._pixels[-1], HULL)
        self._cells = PlantCells(terrain)
        self._context, self._meshes = context, PlantMeshes(context)
        self.build(defines)
        self.shade = PlantShade(context, self._meshes, self._cells, sun, quality=quality, reach=self.reach)
        self._planted = quality.includes("trees")
        self._asked = self._grown = False
        self._seen: list[Place] = []
        self._wanted: tuple[object, ...] = ()
        self._height = 1
        self._elapsed: float | None = None
        self._thin = quality.thin
        self.thinning = Thinning(quality.plants)
        self._origin = np.zeros(2)

    def build(self, defines: Mapping[str, int]) -> None:
        """Draw plants by programs with other macros from now on."""
        self._batches = [_batch(self._context, self._meshes, details, defines) for details in DRAWN]
        self._chosen: tuple[object, ...] = ()

    @property
    def settled(self) -> bool:
        """Whether all plants and shadows that the last camera needs are there, fully grown."""
        grown = self._cells.complete and self._cells.youngest >= GROW
        return self._asked and grown and self.thinning.settled and self.shade.settled

    @property
    def triangles(self) -> int:
        """Triangles that the last picture drew."""
        return sum(batch.triangles for batch in self._batches)

    @property
    def count(self) -> int:
        """Plants that the last picture drew."""
        return sum(batch.count for batch in self._batches)

    def update(
        self,
        camera: Camera,
        size: tuple[int, int],
        lit: GroundLighting,
        elapsed: float,
        allowance: TimeBudget,
    ) -> None:
        """Go on by a frame: make a part of the plants and of the shadows that are missing.

        Parameters
        ----------
        camera
            From where.
        size
            Of the whole picture (px), even where a smaller one is drawn and enlarged.
        lit
            The ground.
        elapsed
            Since the last frame (s).
        allowance
            What may be spent.
        """
        self._elapsed = elapsed
        self._want(camera, size, lit)
        self._cells.grow(elapsed)
        self.shade.go_on(camera.eye, elapsed, allowance.fraction(0.5))
        self._cells.go_on(allowance)

    def change(self, terrain: TerrainSource, areas: Sequence[tuple[float, float, float, float]]) -> None:
        """Show the plants of another terrain from now on, by and by; see `PlantCells.change`."""
        self._cells.change(terrain, areas)
        self._wanted = ()

    def relight(self, sun: Sun) -> None:
        """Let another sun shine from now on: shadows stay until there are new ones."""
        self.shade.relight(sun)
        self._wanted = ()

    def settle(self, camera: Camera, size: tuple[int, int], lit: GroundLighting) -> None:
        """Make all that a camera's picture of a size (px) needs."""
        self._elapsed = None
        self._want(camera, size, lit)
        self._cells.finish()
        self._want(camera, size, lit)  # what stands in a cell says whether it is seen
        if self._planted:
            self._choose(camera, size)
        self.shade.finish(camera.eye)

    def _want(self, camera: Camera, size: tuple[int, int], lit: GroundLighting) -> None:
        self._asked, self._height = True, size[1]
        view = (camera, size, self._cells.changes)
        if not self._planted or (view == self._wanted and lit.settled):
            return
        self._wanted = view
        near = cells_near(camera.eye[0], camera.eye[1], self.reach)
        cells = [self._cells[place] for place in near]
        bounds = np.array(
            [UNKNOWN if cell is None or cell.outdated else (cell.low, cell.high) for cell in cells]
        )
        seen = in_view(camera.frustum(size[0] / size[1]), near, bounds)
        self._seen = [place for place, is_seen in zip(near, seen.tolist(), strict=True) if is_seen]
        shading = [place for place in self.shade.places(camera, lit) if place not in set(self._seen)]
        self._cells.want(self._seen + shading)

    def draw(self, camera: Camera, size: tuple[int, int], uniforms: Mapping[str, object]) -> None:
        """Draw the plants that a camera sees in a picture of a size (px)."""
        if not self._planted:
            return
        self._choose(camera, size)
        anchor = (*(self._origin - camera.eye[:2]).tolist(), -camera.eye[2])
        for batch in self._batches:
            batch.draw_all({**uniforms, "anchor": anchor})

    def _choose(self, camera: Camera, size: tuple[int, int]) -> None:
        """Choose the plants that are drawn, and how; nothing changes for an eye at rest."""
        cells = [cell for cell in (self._cells[place] for place in self._seen) if cell is not None]
        view = (camera, size, tuple(self._seen), self._cells.changes)
        grown = all(cell.age >= GROW for cell in cells)
        if view == self._chosen and self._grown and self.thinning.settled:
            return
        self._chosen, self._grown = view, grown
        self._origin = cells[0].corner if cells else np.zeros(2)
        tangent = 2.0 * np.tan(np.radians(camera.fov) / 2.0)
        least = self._thin * tangent / self._height
        floor = self.thinning.floor(least, still=self._elapsed is None)
        counts = [cell.held(camera.eye, floor) for cell in cells]
        stand = joined(cells, self._origin, counts)
        place = stand.place - (np.asarray(camera.eye) - [*self._origin, 0.0]).astype(np.float32)
        level = np.hypot(place[:, 0], place[:, 1])
        away = np.maximum(np.hypot(level, place[:, 2]), 1.0)
        ages = [cell.ages(count) for cell, count in zip(cells, counts, strict=True)]
        age = np.concatenate([np.zeros(0, np.float32), *ages])
        there = _present(stand.whim, level, age, self.reach)
        there *= _beside(camera.frustum(size[0] / size[1]), place)
        held = stand.hold / away
        seen = np.flatnonzero((held > floor) & (there > 0.0))
        stand, away, there, held = stand.some(seen), away[seen], there[seen], held[seen]
        drawn = shares(stand.tall * (size[1] / tangent) / away, stand.whim, self._pixels)
        self.thinning.follow(held, np.count_nonzero(drawn, axis=1), least=least, elapsed=self._elapsed)
        self.shade.angle = angle = self.thinning.angle
        drawn *= (there * share_of(stand.hold, away, angle))[:, None]
        stand.rows[:, 4:6] *= width_of(stand.bulk, away, angle)[:, None]
        for batch, details in zip(self._batches, DRAWN, strict=True):
            batch.put(_grouped(stand, drawn, details))


def _batch(
    context: moderngl.Context, meshes: PlantMeshes, details: range, defines: Mapping[str, int]
) -> PlantBatch:
    far = details.start >= LIT
    own = {**defines, "SPRIGS": int(details.start < MASKED_DETAILS), "FAR": int(far)}
    found = ("ground", "sway", "veil", "clear") if far else ("ground", "sway")
    return meshes.drawn_by(
        build_program(context, "tree.vert.glsl", "lit.frag.glsl" if far else "tree.frag.glsl", defines=own),
        standing=build_transform(context, "tree_stand.vert.glsl", found, defines=own),
        found=found,
    )


def shares(
    pixels: npt.NDArray[np.floating], whim: npt.NDArray[np.floating], steps: Float64Array
) -> npt.NDArray[np.float64]:
    """Return how much of each detail is drawn of plants.

    Parameters
    ----------
    pixels
        (n,) their heights, px.
    whim
        (n,) 0..1, moves the heights at which a plant changes, so that no ring of them shows.
    steps
        (details - 1,) heights at which the next coarser detail does, px, falling.

    Returns
    -------
    (n, details) float64
        0..1, sum 1; more than one of them is above 0 only near a step.
    """
    height = np.asarray(pixels, np.float64) / (0.85 + 0.3 * np.asarray(whim, np.float64))
    finer = np.clip((height[:, None] / steps - (1.0 - BAND)) / (2.0 * BAND), 0.0, 1.0)
    edges = np.concatenate([np.zeros((len(finer), 1)), finer, np.ones((len(finer), 1))], axis=1)
    return np.diff(edges, axis=1)


def _present(
    whim: npt.NDArray[np.float32], away: npt.NDArray[np.floating], age: npt.NDArray[np.floating], reach: float
) -> npt.NDArray[np.floating]:
    """How much of each plant is there: it goes at its own distance and comes at its own time."""
    gone = (reach_of(whim, reach) - away) / (VANISH * reach)
    come = 2.0 * age / GROW - (1.0 - whim)
    return np.asarray(np.clip(np.minimum(gone, come), 0.0, 1.0))


def _beside(planes: Float64Array, place: npt.NDArray[np.floating]) -> npt.NDArray[np.bool_]:
    """Tell which places relative to the eye lie between the left and the right border of a view."""
    return np.asarray((place @ planes[:2, :3].T.astype(place.dtype) > -ROOM).all(axis=1))


def _grouped(stand: Stand, share: Float64Array, details: range) -> Instances:
    """Put plants in the order of kind and detail, those that are drawn in two of the details twice."""
    detail, plant = np.nonzero(share.T[details.start : details.stop] > 1.0 / 512.0)
    detail += details.start
    group = stand.kind[plant] * DETAILS + detail
    order = np.argsort(
        group.astype(np.uint8), kind="stable"
    )  # of a byte: sorted by its digits, thrice as fast
    plant, detail = plant[order], detail[order]
    rows = stand.rows[plant]
    rows[:, 7] = share[plant, detail]
    counts = np.bincount(group, minlength=KINDS * DETAILS)
    return Instances(rows, counts.reshape(KINDS, DETAILS))
