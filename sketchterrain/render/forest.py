"""Plants in the view, as instances in levels of detail that pass into each other."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

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
from sketchterrain.render.plant_meshes import KINDS, Instances, PlantMeshes
from sketchterrain.render.plant_shade import PlantShade
from sketchterrain.render.programs import build_program, build_transform
from sketchterrain.render.trees import CUT, DETAILS

if TYPE_CHECKING:
    from collections.abc import Mapping

    import moderngl
    import numpy.typing as npt

    from sketchterrain.render.allowance import Allowance
    from sketchterrain.render.camera import Camera
    from sketchterrain.render.lit_ground import LitGround
    from sketchterrain.render.quality import Quality
    from sketchterrain.render.scene import Terrain
    from sketchterrain.render.sky import Sun

    Floats = npt.NDArray[np.float64]

__all__ = ["Forest", "shares"]

PIXELS: Final = (170.0, 60.0, 30.0, 14.0, 6.0)
"""Height of a plant in pixels under which the next coarser detail does."""
HULL: Final = 20.0
"""px; the coarsest detail does for no higher plants, however low the quality."""
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
    """

    def __init__(
        self,
        context: moderngl.Context,
        terrain: Terrain,
        sun: Sun,
        *,
        quality: Quality,
        defines: Mapping[str, int],
    ) -> None:
        self.reach = min(quality.woods, 0.45 * terrain.extent)
        self._pixels = np.array(PIXELS) / quality.leaves
        self._pixels[-1] = min(self._pixels[-1], HULL)
        self._cells = PlantCells(terrain)
        meshes = PlantMeshes(context)
        standing = build_transform(context, "tree_stand.vert.glsl", ["ground", "sway"], defines=defines)
        programs = [
            build_program(context, "tree.vert.glsl", "tree.frag.glsl", defines={**defines, "SPRIGS": sprigs})
            for sprigs in (1, 0)
        ]
        self._batches = [meshes.drawn_by(program, standing=standing) for program in programs]
        self.shade = PlantShade(context, meshes, self._cells, sun, quality=quality, reach=self.reach)
        self._planted = quality.has("trees")
        self._asked = False
        self._seen: list[Place] = []
        self._shown: tuple[object, ...] = ()
        self._origin = np.zeros(2)
        self._stand: Stand | None = None

    @property
    def settled(self) -> bool:
        """Whether all plants and shadows that the last camera needs are there, fully grown."""
        grown = self._cells.complete and self._cells.youngest >= GROW
        return self._asked and grown and self.shade.settled

    @property
    def triangles(self) -> int:
        """Triangles that the last picture drew."""
        return sum(batch.triangles for batch in self._batches)

    @property
    def count(self) -> int:
        """Plants that the last picture drew."""
        return sum(batch.count for batch in self._batches)

    def update(
        self, camera: Camera, aspect: float, lit: LitGround, elapsed: float, allowance: Allowance
    ) -> None:
        """Go on by a frame: make a part of the plants and of the shadows that are missing."""
        self._want(camera, aspect, lit)
        self._cells.grow(elapsed)
        self.shade.go_on(camera.eye, elapsed, allowance.part(0.5))
        self._cells.go_on(allowance)

    def settle(self, camera: Camera, aspect: float, lit: LitGround) -> None:
        """Make all that a camera's picture needs."""
        self._want(camera, aspect, lit)
        self._cells.finish()
        self._want(camera, aspect, lit)  # what stands in a cell says whether it is seen
        self.shade.finish(camera.eye)

    def _want(self, camera: Camera, aspect: float, lit: LitGround) -> None:
        self._asked = True
        if not self._planted:
            return
        near = cells_near(camera.eye[0], camera.eye[1], self.reach)
        cells = [self._cells[place] for place in near]
        bounds = np.array([UNKNOWN if cell is None else (cell.low, cell.high) for cell in cells])
        seen = in_view(camera.frustum(aspect), near, bounds)
        self._seen = [place for place, is_seen in zip(near, seen.tolist(), strict=True) if is_seen]
        shading = [place for place in self.shade.places(camera, lit) if place not in set(self._seen)]
        self._cells.want(self._seen + shading)

    def draw(self, camera: Camera, size: tuple[int, int], uniforms: Mapping[str, object]) -> None:
        """Draw the plants that a camera sees in a picture of a size (px)."""
        if not self._planted:
            return
        self._choose(camera, size[0] / size[1], size[1])
        anchor = (*(self._origin - camera.eye[:2]).tolist(), -camera.eye[2])
        for batch in self._batches:
            batch.draw_all({**uniforms, "anchor": anchor})

    def _choose(self, camera: Camera, aspect: float, height: int) -> None:
        cells = [cell for cell in (self._cells[place] for place in self._seen) if cell is not None]
        shown = (tuple(id(cell) for cell in cells), self._cells.changes)
        if shown != self._shown or self._stand is None:
            self._shown = shown
            self._origin = cells[0].corner if cells else np.zeros(2)
            self._stand = joined(cells, self._origin)
        stand = self._stand
        age = np.repeat([cell.age for cell in cells], [len(cell.stand.tall) for cell in cells])
        eye = np.asarray(camera.eye, dtype=np.float64) - [*self._origin, 0.0]
        place = stand.place.astype(np.float64)
        away = np.hypot(place[:, 0] - eye[0], place[:, 1] - eye[1])
        scale = height / (2.0 * np.tan(np.radians(camera.fov) / 2.0))
        pixels = stand.tall * scale / np.maximum(away, 1.0)
        share = _present(stand.whim, away, age, self.reach)
        share *= _beside(camera.frustum(aspect), place - eye)
        drawn = shares(pixels, stand.whim, self._pixels) * share[:, None]
        # Only fine leaves are cut out: what may be cut hides nothing before it is shaded.
        for batch, details in zip(self._batches, (range(CUT), range(CUT, DETAILS)), strict=True):
            batch.put(_grouped(stand, drawn, details))


def shares(
    pixels: npt.NDArray[np.floating], whim: npt.NDArray[np.floating], steps: Floats
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
    at = steps * (0.85 + 0.3 * np.asarray(whim, np.float64)[:, None])
    finer = np.clip((np.asarray(pixels, np.float64)[:, None] / at - (1.0 - BAND)) / (2.0 * BAND), 0.0, 1.0)
    edges = np.concatenate([np.zeros((len(finer), 1)), finer, np.ones((len(finer), 1))], axis=1)
    return np.diff(edges, axis=1)


def _present(whim: npt.NDArray[np.float32], away: Floats, age: Floats, reach: float) -> Floats:
    """How much of each plant is there: it goes at its own distance and comes at its own time."""
    gone = (reach_of(whim, reach) - away) / (VANISH * reach)
    come = 2.0 * age / GROW - whim
    return np.asarray(np.clip(np.minimum(gone, come), 0.0, 1.0), dtype=np.float64)


def _beside(planes: Floats, place: Floats) -> npt.NDArray[np.bool_]:
    """Tell which places relative to the eye lie between the left and the right border of a view."""
    return np.asarray((place @ planes[:2, :3].T > -ROOM).all(axis=1))


def _grouped(stand: Stand, share: Floats, details: range) -> Instances:
    """Put plants in the order of kind and detail, those that are drawn in two of the details twice."""
    detail, plant = np.nonzero(share.T[details.start : details.stop] > 1.0 / 512.0)
    detail += details.start
    group = stand.kind[plant].astype(np.int64) * DETAILS + detail
    order = np.argsort(group, kind="stable")
    plant, detail = plant[order], detail[order]
    rows = np.empty((len(plant), 8), np.float32)
    rows[:, :3], rows[:, 3] = stand.place[plant], stand.tall[plant]
    rows[:, 4:7], rows[:, 7] = stand.manner[plant], share[plant, detail]
    counts = np.bincount(group, minlength=KINDS * DETAILS)
    return Instances(rows, counts.reshape(KINDS, DETAILS))
