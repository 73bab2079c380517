"""Plant meshes in one vertex buffer, drawn by indirect calls, and the density LOD of their instances.

A plant's removal rank is the share of plants removed before it: one level of the Poisson-disk sets after the
other, in random order within a level, so that the remaining plants are evenly spaced. Of plants n times as
small on screen one in n² remains, widened to preserve the cover.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Final, NamedTuple

import moderngl
import numpy as np
import numpy.typing as npt

from sketchterrain.io.disk_cache import cached_bytes
from sketchterrain.look.tree_levels import DETAILS, VARIANTS, plant_mesh
from sketchterrain.look.tree_species import SPECIES
from sketchterrain.render.programs import set_uniforms

if TYPE_CHECKING:
    from sketchterrain.array_types import Float32Array, Float64Array, FloatArray, Int64Array

LEVEL_RATIO: Final = 0.25
"""Share of a level's plants that are in the next level: twice the distance between plants."""
TALL: Final = 12.0
"""Height of a plant that counts as large as it is (m); lower ones count for more, higher ones for less."""
LONE: Final = 1.5  # added importance of a solitary plant: nothing covers its place when it is removed
SOFT: Final = 0.15  # share of its distance over which a plant fades
WIDEST: Final = 1.8  # largest factor of a plant's width
FILL: Final = 0.85  # share of the budget that is aimed at; the rest is a reserve while the scale follows
PACE: Final = 0.8  # time constant of the scale, s
STEP: Final = 0.8  # smallest factor of the scale between frames: plants are searched only that far
NEAR: Final = 1e-3  # relative tolerance of convergence
KINDS: Final = len(SPECIES) * VARIANTS  # species times variants; a species' variants follow each other
VECTOR: Final = 4 * 4  # bytes of a captured vec4


def removal_rank(level: npt.NDArray[np.integer], chance: FloatArray) -> Float64Array:
    """Return the share of plants removed before those of a Poisson-disk level; `chance` orders within it."""
    return 1.0 - LEVEL_RATIO ** level.astype(np.float64) * (1.0 - (1.0 - LEVEL_RATIO) * chance)


def plant_importance(height: FloatArray, crowding: FloatArray) -> Float64Array:
    """Return plants' importance (m) by their heights (m) and how crowded they are (0..1)."""
    return np.asarray(np.sqrt(height * TALL) * (1.0 + LONE * (1.0 - crowding)), np.float64)


def cull_distance(importance: FloatArray, rank: FloatArray) -> Float64Array:
    """Return the culling distances (m) of plants if rank 0 is culled at 1 rad of importance."""
    return np.asarray(importance / np.sqrt(np.maximum(1.0 - rank, 1e-9)), np.float64)


def visible_share(cull: FloatArray, away: FloatArray, angle: float) -> Float64Array:
    """Return plants' opacity, 0..1, by `cull_distance`, if those of rank 0 go at an angle (rad)."""
    return np.clip((cull / (np.maximum(away, 1.0) * angle) - 1.0) / SOFT, 0.0, 1.0)


def width_scale(importance: FloatArray, away: FloatArray, angle: float) -> Float64Array:
    """Return the width factor of remaining plants that preserves the covered area."""
    return np.clip(np.maximum(away, 1.0) * angle / importance, 1.0, WIDEST)


class PlantDensity:
    """Culling angle (rad) of plants' importance, raised where an instance budget needs it; follows softly."""

    def __init__(self, budget: int) -> None:
        self._budget = budget
        self.angle = 0.0
        self.converged = False

    def floor(self, least: float, *, still: bool) -> float:
        """Return the angle (rad) below which no plants need to be searched."""
        return least if still else max(least, STEP * self.angle)

    def update(
        self, angles: FloatArray, copies: npt.NDArray[np.integer], *, least: float, elapsed: float | None
    ) -> None:
        """Adapt to a view, gradually over `elapsed` (s); at once if it is None.

        `angles` are cull distances over distances (rad) of all plants in view above the floor of `least`, the
        angle wherever the budget allows it; `copies` the instances each is drawn as.
        """
        still = elapsed is None or self.angle == 0.0
        floor = self.floor(least, still=still)
        aimed, allowed = _fitting_angles(angles, copies, [FILL * self._budget, self._budget])
        target = max(aimed, floor)
        if elapsed is None or still:
            self.angle, self.converged = target, True
            return
        angle = target + (self.angle - target) * float(np.exp(-elapsed / PACE))
        arrived = abs(angle - target) < NEAR * target
        self.converged = arrived and (target > floor or floor == least)
        self.angle = max(target if arrived else angle, allowed)


def _fitting_angles(angles: FloatArray, copies: npt.NDArray[np.integer], budgets: list[float]) -> list[float]:
    """Return the angles above which instances fit into rising budgets; 0 for all."""
    most = int(budgets[-1])
    if copies.sum() <= budgets[0]:
        return [0.0] * len(budgets)
    if len(angles) > most + 1:  # each plant is an instance at least
        first = np.argpartition(-angles, most)[: most + 1]
        angles, copies = angles[first], copies[first]
    order = np.argsort(-angles, kind="stable")
    fitting = np.searchsorted(np.cumsum(copies[order]), np.floor(budgets), side="right")
    return [float(angle) for angle in np.append(angles[order], 0.0)[fitting]]


class MeshInstances(NamedTuple):
    """Instances (`PlantInstances.rows`, with their visible share last) sorted by mesh."""

    rows: Float32Array  # (n, 8)
    counts: Int64Array  # (kinds, details)


@cache
def all_plant_meshes() -> tuple[Int64Array, bytes | memoryview]:
    """Return vertex counts (kinds, details) and the vertices of all plants; cached on disk."""
    sources = [each for each in files("sketchterrain.look").iterdir() if each.name.endswith(".py")]
    recipe = "".join(each.read_text("utf-8") for each in sorted(sources, key=str))

    def compute() -> bytes:
        kinds = [(name, variant) for name in SPECIES for variant in range(VARIANTS)]
        meshes = [plant_mesh(*kind, detail) for kind in kinds for detail in range(DETAILS)]
        counts = np.array([len(mesh) for mesh in meshes], np.int64)
        return counts.tobytes() + np.concatenate(meshes).tobytes()

    content = cached_bytes("plants", recipe, compute)
    counts = np.frombuffer(content, np.int64, KINDS * DETAILS).reshape(KINDS, DETAILS)
    return counts, memoryview(content)[counts.nbytes :]


class PlantMeshes:
    """Vertex buffer of all kinds in all details: first vertex and vertex count of each, (kinds, details)."""

    def __init__(self, context: moderngl.Context) -> None:
        self.vertices, content = all_plant_meshes()
        self.first = np.cumsum(self.vertices).reshape(self.vertices.shape) - self.vertices
        self.context = context
        self.buffer = context.buffer(content)

    def commands(self, counts: Int64Array, start: int, stop: int) -> npt.NDArray[np.uint32]:
        """Return indirect draw commands of the instances from `start` to `stop`, one row a mesh."""
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
    """Instances, drawn by a program of tree.vert.glsl or tree_shadow.vert.glsl.

    For the former, `transform` (tree_stand.vert.glsl) computes the vec4s named in `captured` once a plant.
    """

    def __init__(
        self,
        meshes: PlantMeshes,
        program: moderngl.Program,
        *,
        transform: moderngl.Program | None = None,
        captured: Sequence[str] = (),
    ) -> None:
        context = meshes.context
        self._program, self._transform = program, transform
        self._meshes = meshes
        self._instances = context.buffer(reserve=32 * 1024, dynamic=True)
        self._captured = context.buffer(reserve=32 * 1024, dynamic=True)
        self._captured_bytes = VECTOR * len(captured)
        self._commands = context.buffer(reserve=20 * meshes.vertices.size, dynamic=True)
        self._counts = np.zeros_like(meshes.vertices)
        vertex = ("3f4 4f1 4f1 4f1", "local_position", "local_normal", "vertex_colour", "leaf_uv")
        parts = [(meshes.buffer, *vertex), (self._instances, "4f4 4f4/i", "foot_height", "appearance")]
        if transform is not None:
            parts.append((self._captured, " ".join(["4f4"] * len(captured)) + "/i", *captured))
            self._evaluation = context.vertex_array(transform, [(self._instances, "4f4 16x", "foot_height")])
        self._array = context.vertex_array(program, parts, skip_errors=True)

    @property
    def count(self) -> int:
        """Number of instances."""
        return int(self._counts.sum())

    @property
    def triangles(self) -> int:
        """Triangles of all instances."""
        return int((self._counts * self._meshes.vertices).sum()) // 3

    def set_instances(self, instances: MeshInstances) -> None:
        """Replace the instances."""
        self._counts = instances.counts
        if self.count:
            self._instances.orphan(max(instances.rows.nbytes, self._instances.size))
            self._instances.write(instances.rows.tobytes())

    def evaluate_and_draw(self, uniforms: Mapping[str, object], *, parts: int) -> Iterator[None]:
        """Compute the attributes shared by an instance's vertices, and draw instances, some at a time."""
        if self.count:
            if self._transform is not None:
                set_uniforms(self._transform, uniforms)
                self._captured.orphan(max(self._captured_bytes * self.count, self._captured.size))
                self._evaluation.transform(self._captured, vertices=self.count)
            set_uniforms(self._program, uniforms)
            for number in range(parts):
                self.draw(self.count * number // parts, self.count * (number + 1) // parts)
                yield

    def draw(self, start: int, stop: int) -> None:
        """Draw instances from `start` to `stop`."""
        commands = self._meshes.commands(self._counts, start, stop)
        if len(commands):
            self._commands.write(commands.tobytes())
            self._array.render_indirect(self._commands, moderngl.TRIANGLES, count=len(commands))
