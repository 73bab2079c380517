"""Terrain tiles in one vertex buffer, drawn by one indirect multi-draw.

Positions are integers until the vertex shader: tile corner and step on the lattice of extent/2²⁴ m, relative
to the lattice cell of the eye. Only the eye's offset within its cell is passed in floating point.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError
from sketchterrain.render.gl_functions import COMMAND, clipping
from sketchterrain.render.programs import build_program, set_uniforms
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.tiles import QUADS, borders

if TYPE_CHECKING:
    from sketchterrain.tiles import DrawList

_VERTEX_ATTRIBUTES: Final = ("4u4 4u4", "ground", "materials")
"""32 bytes: `sketchterrain.terrain.vertices.VERTEX`, kernels/render/ground.glsl."""
_TILE: Final = np.dtype(
    [("corner", "<i4", 2), ("step", "<i4"), ("centre", "<f4"), ("west", "<f4", 4), ("east", "<f4", 4)]
)
_TILE_ATTRIBUTES: Final = ("4i4 4f4 4f4/i", "place_of_tile", "morph_west", "morph_east")
_MAX_UNITS: Final = 2**31 - 1
"""Largest lattice distance from the eye to a vertex."""


class TileRenderer:
    """Draws tiles of quads² cells from a buffer with (quads + 1)² `VERTEX` per slot.

    `extent` is the width of a level-0 tile (m); nothing is drawn beyond `bounds` (W, S, E, N; m). `tiles` and
    `triangles` count those of the last `set_tiles`.
    """

    def __init__(
        self,
        context: moderngl.Context,
        extent: float,
        vertices: moderngl.Buffer,
        *,
        quads: int = QUADS,
        bounds: tuple[float, float, float, float] | None = None,
    ) -> None:
        self.tiles = self.triangles = 0
        self._context = context
        self._unit = metres_per_unit(extent)
        self._quads = quads
        self._bounds = bounds
        self._eye = np.zeros(2)
        self._vertices = vertices
        indices, self._first_index, self._index_count = borders.tile_indices(quads)
        self._indices = context.buffer(indices.tobytes())
        capacity = max(vertices.size // (32 * (quads + 1) ** 2), 1)
        self._tiles = context.buffer(reserve=_TILE.itemsize * capacity, dynamic=True)
        self._commands = context.buffer(reserve=COMMAND.itemsize * capacity, dynamic=True)
        self._eye_fraction = (0.0, 0.0)
        self._draw_list: DrawList | None = None
        self._write_counts = np.zeros(capacity, np.int64)
        self._corners = np.zeros((0, 2), np.int64)
        self._command_list = np.zeros(0, COMMAND)
        self._selected_commands = context.buffer(reserve=COMMAND.itemsize * capacity, dynamic=True)
        self._array = self.vertex_array(self.create_program("ground.vert.glsl", "ground.frag.glsl"))

    @property
    def vertex_bindings(self) -> tuple[tuple[object, ...], ...]:
        """Buffers and attributes of vertices and tiles, in the format of ``Context.vertex_array``."""
        return (
            (self._vertices, *_VERTEX_ATTRIBUTES),
            (self._tiles, *_TILE_ATTRIBUTES),
        )

    def create_program(self, vertex: str, fragment: str) -> moderngl.Program:
        """Build a program whose vertex shader includes ``render/ground.glsl``."""
        defines = {"TILE_QUADS": self._quads} | ({} if self._bounds is None else {"BOUNDED": 1})
        return build_program(self._context, vertex, fragment, defines=defines)

    def vertex_array(
        self, program: moderngl.Program, *, extra: tuple[moderngl.Buffer, str] | None = None
    ) -> moderngl.VertexArray:
        """Return a vertex array for `draw`, of a program that `create_program` built.

        `extra` is a buffer with one vec4 per tile, and the name of that attribute.
        """
        bindings = list(self.vertex_bindings)
        if extra is not None:
            bindings.append((extra[0], "4f4/i", extra[1]))
        return self._context.vertex_array(program, bindings, index_buffer=self._indices, skip_errors=True)

    def set_tiles(self, draw_list: DrawList, eye: tuple[float, float, float]) -> None:
        """Upload the tiles to draw relative to an eye (m); raise InputError for too many or too far ones."""
        count = len(draw_list.slots)
        self._eye = np.asarray(eye[:2])
        eye_units = np.floor(self._eye / self._unit)
        corners = draw_list.corners - eye_units.astype(np.int64)
        if count * _TILE.itemsize > self._tiles.size:
            raise InputError(f"expected at most {self._tiles.size // _TILE.itemsize} tiles, got {count}")
        ends = corners + np.multiply.outer(draw_list.steps * self._quads, [1, -1])
        if count and max(np.abs(corners).max(), np.abs(ends).max()) > _MAX_UNITS:
            raise InputError(f"expected tiles within {_MAX_UNITS * self._unit:.0f} m of the eye")
        self._eye_fraction = tuple((self._eye - eye_units * self._unit).tolist())
        tiles = np.empty(count, _TILE)
        tiles["corner"], tiles["step"] = corners, draw_list.steps
        tiles["west"][:, :3], tiles["west"][:, 3] = draw_list.morph[:, :, 0], draw_list.morph[:, 0, 1]
        tiles["east"][:, :3], tiles["east"][:, 3] = draw_list.morph[:, :, 2], draw_list.morph[:, 2, 1]
        tiles["centre"] = draw_list.morph[:, 1, 1]
        commands = np.empty(count, COMMAND)
        commands["count"] = self._index_count[draw_list.cases]
        commands["first"] = self._first_index[draw_list.cases]
        commands["instances"], commands["base_instance"] = 1, np.arange(count)
        commands["base_vertex"] = draw_list.slots * (self._quads + 1) ** 2
        self._draw_list, self._corners, self._command_list = draw_list, corners, commands
        self.tiles, self.triangles = count, int(commands["count"].sum()) // 3
        if count:
            self._tiles.orphan()
            self._tiles.write(tiles.tobytes())
            self._commands.orphan()
            self._commands.write(commands.tobytes())

    def tiles_within(self, west: float, south: float, east: float, north: float) -> npt.NDArray[np.intp]:
        """Return indices of the tiles that intersect a rectangle relative to the eye (m)."""
        if self._draw_list is None:
            return np.zeros(0, np.intp)
        low = self._corners * self._unit - self._eye_fraction
        width = self._draw_list.steps * (self._quads * self._unit)
        meets = (low[:, 0] < east) & (low[:, 0] + width > west)
        meets &= (low[:, 1] > south) & (low[:, 1] - width < north)
        return np.flatnonzero(meets)

    def mark_rewritten(self, slots: npt.NDArray[np.int64]) -> None:
        """Count a rewrite of the vertices of some slots; see `content_key`."""
        self._write_counts[slots] += 1

    def content_key(self, tiles: npt.NDArray[np.intp]) -> bytes:
        """Return bytes that are equal as long as the given tiles look the same."""
        draw_list = self._draw_list
        if draw_list is None:
            return b""
        parts = (
            draw_list.corners,
            draw_list.steps,
            draw_list.cases,
            draw_list.morph,
            self._write_counts[draw_list.slots],
        )
        return b"".join(part[tiles].tobytes() for part in parts)

    def draw(
        self, array: moderngl.VertexArray | None = None, *, tiles: npt.NDArray[np.intp] | None = None
    ) -> None:
        """Draw the tiles, or a subset of them, with the camera of the frame's uniform block.

        By default normals and material weights are drawn (ground.frag.glsl).
        """
        commands, count = self._commands, self.tiles
        if tiles is not None:
            commands, count = self._selected_commands, len(tiles)
            commands.orphan()
            commands.write(self._command_list[tiles].tobytes())
        if not count:
            return
        array = array or self._array
        set_uniforms(array.program, {"metres_per_unit": self._unit, "eye_fraction": self._eye_fraction})
        if self._bounds is None:
            array.render_indirect(commands, moderngl.TRIANGLES, count=count)
            return
        relative = np.asarray(self._bounds) - np.tile(self._eye, 2)
        set_uniforms(array.program, {"bounds": tuple(relative.tolist())})
        with clipping(self._context):
            array.render_indirect(commands, moderngl.TRIANGLES, count=count)
