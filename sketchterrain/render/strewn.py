"""What is strewn over the ground: asked for at its places once a thing, drawn as instances of its meshes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import moderngl
import numpy as np

from sketchterrain.render.gl_functions import COMMAND
from sketchterrain.render.programs import set_uniforms
from sketchterrain.render.scatter import SEED

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt

    from sketchterrain.render.scatter import Places

VECTOR: Final = 4 * 4
"""Bytes of each vector that is captured."""


class Mesh(NamedTuple):
    """Vertices and triangles.

    Attributes
    ----------
    vertices : (n,) structured
        Of vectors of float32.
    triangles : (m, 3) uint32
    """

    vertices: npt.NDArray[np.void]
    triangles: npt.NDArray[np.uint32]


class Strewn:
    """Meshes, the things that stand at places now, and the programs that find them out and draw them.

    Parameters
    ----------
    context
        Where they are drawn.
    meshes
        With vertices of one type.
    finding
        Asks what is at a place, from ``corner`` and ``seed`` (`SEED`).
    found
        Names of its outputs, each of four floats.
    drawing
        Draws a mesh's vertices by them.

    Attributes
    ----------
    found : moderngl.Buffer
        What was found last, a thing after the other.
    """

    def __init__(
        self,
        context: moderngl.Context,
        meshes: Sequence[Mesh],
        *,
        finding: moderngl.Program,
        found: Sequence[str],
        drawing: moderngl.Program,
    ) -> None:
        self._sizes = np.array([mesh.triangles.size for mesh in meshes])
        many = np.array([len(mesh.vertices) for mesh in meshes])
        self._commands = np.zeros(len(meshes), COMMAND)
        self._commands["count"], self._commands["first"] = self._sizes, np.cumsum(self._sizes) - self._sizes
        self._commands["base_vertex"] = np.cumsum(many) - many
        self._finding, self._drawing = finding, drawing
        self._bytes = VECTOR * len(found)
        self._seeds = context.buffer(reserve=SEED.itemsize, dynamic=True)
        self.found = context.buffer(reserve=self._bytes, dynamic=True)
        self._orders = context.buffer(reserve=self._commands.nbytes, dynamic=True)
        self._asked = context.vertex_array(finding, [(self._seeds, "2f4 2u4", "corner", "seed")])
        vertices = np.concatenate([mesh.vertices for mesh in meshes])
        names = vertices.dtype.names or ()
        form = " ".join(f"{vertices.dtype[name].shape[0]}f4" for name in names)
        self._array = context.vertex_array(
            drawing,
            [
                (context.buffer(vertices.tobytes()), form, *names),
                (self.found, " ".join(["4f4"] * len(found)) + "/i", *found),
            ],
            index_buffer=context.buffer(
                np.concatenate([mesh.triangles.ravel() for mesh in meshes]).tobytes()
            ),
        )

    def find_out(self, places: Places, uniforms: Mapping[str, object]) -> None:
        """Ask what is at some places, at least one, in the order of their meshes."""
        many = len(places.rows)
        for buffer, size in ((self._seeds, SEED.itemsize), (self.found, self._bytes)):
            if buffer.size < size * many:
                buffer.orphan(size * max(many, 2 * (buffer.size // size)))
        self._seeds.write(places.rows.tobytes())
        set_uniforms(self._finding, uniforms)
        self._asked.transform(self.found, moderngl.POINTS, vertices=many)

    def draw(self, places: Places, uniforms: Mapping[str, object]) -> None:
        """Draw what was found at them."""
        commands = self._commands.copy()
        commands["instances"] = places.counts
        commands["base_instance"] = np.cumsum(places.counts) - places.counts
        commands = commands[commands["instances"] > 0]
        self._orders.write(commands.tobytes())
        set_uniforms(self._drawing, uniforms)
        self._array.render_indirect(self._orders, moderngl.TRIANGLES, count=len(commands))

    def triangles(self, places: Places) -> int:
        """Return how many triangles are drawn at places."""
        return int((places.counts * self._sizes).sum()) // 3
