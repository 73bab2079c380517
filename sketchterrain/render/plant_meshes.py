"""All plants' meshes in one buffer, drawn as instances by one indirect call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import moderngl
import numpy as np
import numpy.typing as npt

from sketchterrain.look.tree_levels import DETAILS, VARIANTS
from sketchterrain.look.tree_species import SPECIES
from sketchterrain.look.trees import plant_mesh
from sketchterrain.render.programs import set_uniforms

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
