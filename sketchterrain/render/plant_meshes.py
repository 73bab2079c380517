"""Plant meshes, and how many instances are drawn at a distance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import moderngl
import numpy as np
import numpy.typing as npt

from sketchterrain.look.tree_levels import DETAILS, VARIANTS, plant_mesh
from sketchterrain.look.tree_species import SPECIES
from sketchterrain.render.programs import set_uniforms

if TYPE_CHECKING:
    from sketchterrain.array_types import FloatArray


LEVELS_KEEP: Final = 0.25
"""Share of a level's plants that are of a higher one: as many as stand at twice the distance."""
TALL: Final = 12.0
"""m, of a plant that counts as large as it is; lower ones count for more, higher ones for less."""
LONE: Final = 1.5
"""By how much more a plant counts that stands alone: nothing covers its place when it goes."""
SOFT: Final = 0.15
"""Share of the distance at which a plant goes over which it does."""
WIDEST: Final = 1.8
"""Times its own width that a plant is drawn at most."""
FILL: Final = 0.85
"""Of the budget, what is aimed at: the rest is for what comes while the scale follows."""
PACE: Final = 0.8
"""s in which the scale covers two thirds of its way."""
STEP: Final = 0.8
"""The scale falls to no less of itself in a frame: plants that come then are looked for only so far."""
NEAR: Final = 1e-3
"""Share by which the scale may be off when it has arrived."""


def whim_of(level: npt.NDArray[np.integer], chance: FloatArray) -> npt.NDArray[np.float64]:
    """Return the share of plants, 0..1, that go before plants of some levels do.

    Parameters
    ----------
    level
        (n,) of the Poisson-disk sets, a quarter of the plants in each set are in the next.
    chance
        (n,) 0..1, decides within a level.
    """
    return 1.0 - LEVELS_KEEP ** level.astype(np.float64) * (1.0 - (1.0 - LEVELS_KEEP) * chance)


def bulk_of(tall: FloatArray, crowding: FloatArray) -> npt.NDArray[np.float64]:
    """Return how large plants count (m), by their heights (m) and how much others crowd them (0..1)."""
    return np.asarray(np.sqrt(tall * TALL) * (1.0 + LONE * (1.0 - crowding)), np.float64)


def hold_of(bulk: FloatArray, whim: FloatArray) -> npt.NDArray[np.float64]:
    """Return at what distance (m) plants go if those of whim 0 go where their bulk is 1 rad."""
    return np.asarray(bulk / np.sqrt(np.maximum(1.0 - whim, 1e-9)), np.float64)


def share_of(hold: FloatArray, away: FloatArray, angle: float) -> npt.NDArray[np.float64]:
    """Return how much of plants is there, 0..1, where those of whim 0 go at an angle (rad) of their bulk."""
    return np.clip((hold / (np.maximum(away, 1.0) * angle) - 1.0) / SOFT, 0.0, 1.0)


def width_of(bulk: FloatArray, away: FloatArray, angle: float) -> npt.NDArray[np.float64]:
    """Return how many times as wide plants are that stay, so that they cover what all did."""
    return np.clip(np.maximum(away, 1.0) * angle / bulk, 1.0, WIDEST)


class Thinning:
    """The angle of a plant's bulk below which it may go: what is asked for, more where a budget needs it.

    It follows what is in view softly, so that no crowd of plants comes or goes at once.

    Parameters
    ----------
    most
        Instances that may be drawn.

    Attributes
    ----------
    angle : float
        rad; 0 before the first view.
    settled : bool
        Whether it is where the last view wants it.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self.angle = 0.0
        self.settled = False

    def floor(self, least: float, *, still: bool) -> float:
        """Return the angle (rad), `least` or more, under which no plants need to be looked for."""
        return least if still else max(least, STEP * self.angle)

    def follow(
        self, held: FloatArray, copies: npt.NDArray[np.integer], *, least: float, elapsed: float | None
    ) -> None:
        """Go on to what a view needs.

        Parameters
        ----------
        held
            (n,) rad, holds over distances of all plants in view that are above the floor of `least`.
        copies
            (n,) how many instances each of them is drawn as.
        least
            rad, the angle wherever the budget allows it.
        elapsed
            s since the last view; None: be there at once.
        """
        still = elapsed is None or self.angle == 0.0
        floor = self.floor(least, still=still)
        aimed, allowed = _fitting(held, copies, [FILL * self._most, self._most])
        wanted = max(aimed, floor)
        if elapsed is None or still:
            self.angle, self.settled = wanted, True
            return
        angle = wanted + (self.angle - wanted) * float(np.exp(-elapsed / PACE))
        arrived = abs(angle - wanted) < NEAR * wanted
        self.settled = arrived and (wanted > floor or floor == least)
        self.angle = max(wanted if arrived else angle, allowed)


def _fitting(held: FloatArray, copies: npt.NDArray[np.integer], budgets: list[float]) -> list[float]:
    """Return the angles above which no more instances are than budgets, rising ones, allow; 0 for all."""
    most = int(budgets[-1])
    if copies.sum() <= budgets[0]:
        return [0.0] * len(budgets)
    if len(held) > most + 1:  # each plant is an instance at least
        first = np.argpartition(-held, most)[: most + 1]
        held, copies = held[first], copies[first]
    order = np.argsort(-held, kind="stable")
    kept = np.searchsorted(np.cumsum(copies[order]), np.floor(budgets), side="right")
    angles = np.append(held[order], 0.0)[kept]
    return [float(angle) for angle in angles]


KINDS: Final = len(SPECIES) * VARIANTS
"""Of plants: every species' first variant, second, … follow each other."""


VECTOR: Final = 4 * 4
"""Bytes of each vector that is found of a plant."""


class Instances(NamedTuple):
    """Plants to draw, by kind and detail.

    Attributes
    ----------
    rows : (n, 8) float32
        Foot from an anchor and height (m); cosine and sine, times as wide as it is drawn; temper (see
        `Stand`), and the share of its triangles that is drawn.
    counts : (kinds, details) int64
        How many of each mesh; rows follow in this order.
    """

    rows: npt.NDArray[np.float32]
    counts: npt.NDArray[np.int64]


class PlantMeshes:
    """Vertices of all kinds in all details.

    Attributes
    ----------
    first, vertices : (kinds, details) int64
        Where each mesh begins, and how many vertices it has.
    """

    def __init__(self, context: moderngl.Context) -> None:
        meshes = [
            plant_mesh(name, variant, detail)
            for name in SPECIES
            for variant in range(VARIANTS)
            for detail in range(DETAILS)
        ]
        sizes = np.array([len(mesh) for mesh in meshes], dtype=np.int64)
        self.vertices = sizes.reshape(KINDS, DETAILS)
        self.first = (np.cumsum(sizes) - sizes).reshape(self.vertices.shape)
        self._context = context
        self._buffer = context.buffer(np.concatenate(meshes).tobytes())

    def drawn_by(
        self,
        program: moderngl.Program,
        *,
        standing: moderngl.Program | None = None,
        found: Sequence[str] = (),
    ) -> PlantBatch:
        """Return what draws plants by a program.

        Parameters
        ----------
        program
            Of tree.vert.glsl, or of tree_shadow.vert.glsl.
        standing
            For the first, of tree_stand.vert.glsl.
        found
            Names of what that finds of a plant, four floats each.
        """
        form: tuple[str, ...] = ("3f4 12x", "place")
        if standing is not None:
            form = ("3f4 4f1 4f1 4f1", "place", "outward", "colour", "sprig_at")
        return PlantBatch(self._context, self, program, (self._buffer, *form), standing, found)

    def commands(self, counts: npt.NDArray[np.int64], start: int, stop: int) -> npt.NDArray[np.uint32]:
        """Return indirect draws of the instances from `start` to `stop`: one row a mesh."""
        last = np.cumsum(counts.ravel())
        begin = np.clip(last - counts.ravel(), start, stop)
        end = np.clip(last, start, stop)
        commands = np.zeros((counts.size, 5), np.uint32)
        commands[:, 0] = self.vertices.ravel()
        commands[:, 1] = end - begin
        commands[:, 2] = self.first.ravel()
        commands[:, 3] = begin
        return np.asarray(commands[end > begin])


class PlantBatch:
    """Instances on the GPU, and the programs that draw them."""

    def __init__(
        self,
        context: moderngl.Context,
        meshes: PlantMeshes,
        program: moderngl.Program,
        vertices: tuple[object, ...],
        standing: moderngl.Program | None,
        found: Sequence[str],
    ) -> None:
        self._program, self._standing = program, standing
        self._meshes = meshes
        self._instances = context.buffer(reserve=32 * 1024, dynamic=True)
        self._ground = context.buffer(reserve=32 * 1024, dynamic=True)
        self._commands = context.buffer(reserve=20 * meshes.vertices.size, dynamic=True)
        self._counts = np.zeros_like(meshes.vertices)
        parts = [vertices, (self._instances, "4f4 4f4/i", "stand", "manner")]
        self._stands = None
        if standing is not None:
            self._found = VECTOR * len(found)
            parts.append((self._ground, " ".join(["4f4"] * len(found)) + "/i", *found))
            self._stands = context.vertex_array(standing, [(self._instances, "4f4 16x", "stand")])
        self._array = context.vertex_array(program, parts)

    def draw_all(self, uniforms: Mapping[str, object]) -> None:
        """Find out what each plant's vertices share, and draw all."""
        if self.count:
            if self._standing is not None and self._stands is not None:
                set_uniforms(self._standing, uniforms)
                self._ground.orphan(max(self._found * self.count, self._ground.size))
                self._stands.transform(self._ground, vertices=self.count)
            set_uniforms(self._program, uniforms)
            self.draw()

    @property
    def count(self) -> int:
        """How many plants are held."""
        return int(self._counts.sum())

    @property
    def triangles(self) -> int:
        """How many triangles all of them have."""
        return int((self._counts * self._meshes.vertices).sum()) // 3

    def put(self, instances: Instances) -> None:
        """Hold other plants."""
        self._counts = instances.counts
        if self.count:
            size = max(instances.rows.nbytes, self._instances.size)
            self._instances.orphan(size)
            self._instances.write(instances.rows.tobytes())

    def draw(self, start: int = 0, stop: int | None = None) -> None:
        """Draw those from `start` to `stop`, all by default."""
        commands = self._meshes.commands(self._counts, start, self.count if stop is None else stop)
        if len(commands):
            self._commands.write(commands.tobytes())
            self._array.render_indirect(self._commands, moderngl.TRIANGLES, count=len(commands))
