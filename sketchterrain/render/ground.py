"""The ground: tiles in one vertex buffer, drawn by one indirect multi-draw.

Positions are integers until the vertex shader: a tile's corner and its step on the lattice of extent/2²⁴ m,
relative to the lattice place of the eye. Only what is left of the eye beyond that place, less than a unit,
goes along in floating point.
"""

from __future__ import annotations

from typing import Final, Protocol

import moderngl
import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError
from sketchterrain.render.gl_functions import COMMAND, clipping
from sketchterrain.render.programs import build_program, set_uniforms
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.tiles import QUADS, borders

_VERTEX_ATTRIBUTES: Final = ("4u4 4u4", "ground", "materials")
"""32 bytes, `sketchterrain.terrain.vertices.VERTEX`; kernels/render/ground.glsl."""
_TILE: Final = np.dtype(
    [("corner", "<i4", 2), ("step", "<i4"), ("centre", "<f4"), ("west", "<f4", 4), ("east", "<f4", 4)]
)
_TILE_ATTRIBUTES: Final = ("4i4 4f4 4f4/i", "place_of_tile", "morph_west", "morph_east")
_FARTHEST_UNIT: Final = 2**31 - 1
"""From the eye to a tile's vertices."""


class Draws(Protocol):
    """Which tiles to draw and how far each is morphed; see `sketchterrain.tiles`."""

    @property
    def slots(self) -> npt.NDArray[np.int64]:
        """(n,) place in the vertex buffer, in tiles."""
        ...

    @property
    def corners(self) -> npt.NDArray[np.int64]:
        """(n, 2) north-west corner, lattice units from the world's origin."""
        ...

    @property
    def steps(self) -> npt.NDArray[np.int64]:
        """(n,) lattice units a quad."""
        ...

    @property
    def cases(self) -> npt.NDArray[np.int64]:
        """(n,) which borders lie at a coarser tile: bits north, south, west, east."""
        ...

    @property
    def morph(self) -> npt.NDArray[np.float32]:
        """(n, 3, 3) share of the parent, row 0 north, column 0 west."""
        ...


class TileRenderer:
    """Draws tiles out of one buffer of vertices.

    Parameters
    ----------
    context
        Where they are drawn.
    extent
        Width of a level-0 tile (m).
    vertices
        `sketchterrain.terrain.vertices.VERTEX`, (quads + 1)² a slot.
    quads
        Along a tile's side: a power of two ≥ 4.
    bounds
        West, south, east, north (m), beyond which nothing is drawn; None: it goes on for ever.

    Attributes
    ----------
    tiles : int
        Tiles of the last `place`.
    triangles : int
        Their triangles.
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
        indices, self._first, self._count = borders.tile_indices(quads)
        self._indices = context.buffer(indices.tobytes())
        room = max(vertices.size // (32 * (quads + 1) ** 2), 1)
        self._tiles = context.buffer(reserve=_TILE.itemsize * room, dynamic=True)
        self._commands = context.buffer(reserve=COMMAND.itemsize * room, dynamic=True)
        self._fraction = (0.0, 0.0)
        self._draws: Draws | None = None
        self._writings = np.zeros(room, np.int64)
        self._corners = np.zeros((0, 2), np.int64)
        self._listed = np.zeros(0, COMMAND)
        self._part = context.buffer(reserve=COMMAND.itemsize * room, dynamic=True)
        self._array = self.array(self.build("ground.vert.glsl", "ground.frag.glsl"))

    @property
    def content(self) -> tuple[tuple[object, ...], ...]:
        """Buffers of the vertices' and of the tiles' attributes, as a vertex array wants them."""
        return (
            (self._vertices, *_VERTEX_ATTRIBUTES),
            (self._tiles, *_TILE_ATTRIBUTES),
        )

    def build(self, vertex: str, fragment: str) -> moderngl.Program:
        """Build a program whose vertex shader includes ``render/ground.glsl``."""
        defines = {"TILE_QUADS": self._quads} | ({} if self._bounds is None else {"BOUNDED": 1})
        return build_program(self._context, vertex, fragment, defines=defines)

    def array(
        self, program: moderngl.Program, *, values: tuple[moderngl.Buffer, str] | None = None
    ) -> moderngl.VertexArray:
        """Return the tiles as a program draws them, for :meth:`draw`.

        Parameters
        ----------
        program
            Of :meth:`build`.
        values
            One more attribute a tile, a vec4: a buffer, in the order of the tiles placed, and its name.
        """
        content = list(self.content)
        if values is not None:
            content.append((values[0], "4f4/i", values[1]))
        return self._context.vertex_array(program, content, index_buffer=self._indices, skip_errors=True)

    def place(self, draws: Draws, eye: tuple[float, float, float]) -> None:
        """Say which tiles to draw, and from where.

        Raises
        ------
        InputError
            If there are more than slots, or one reaches farther than 2³¹ lattice units (128 extents) away.
        """
        count = len(draws.slots)
        self._eye = np.asarray(eye[:2])
        here = np.floor(self._eye / self._unit)
        corners = draws.corners - here.astype(np.int64)
        if count * _TILE.itemsize > self._tiles.size:
            raise InputError(f"expected at most {self._tiles.size // _TILE.itemsize} tiles, got {count}")
        ends = corners + np.multiply.outer(draws.steps * self._quads, [1, -1])
        if count and max(np.abs(corners).max(), np.abs(ends).max()) > _FARTHEST_UNIT:
            raise InputError(f"expected tiles within {_FARTHEST_UNIT * self._unit:.0f} m of the eye")
        self._fraction = tuple((self._eye - here * self._unit).tolist())
        tiles = np.empty(count, _TILE)
        tiles["corner"], tiles["step"] = corners, draws.steps
        tiles["west"][:, :3], tiles["west"][:, 3] = draws.morph[:, :, 0], draws.morph[:, 0, 1]
        tiles["east"][:, :3], tiles["east"][:, 3] = draws.morph[:, :, 2], draws.morph[:, 2, 1]
        tiles["centre"] = draws.morph[:, 1, 1]
        commands = np.empty(count, COMMAND)
        commands["count"], commands["first"] = self._count[draws.cases], self._first[draws.cases]
        commands["instances"], commands["base_instance"] = 1, np.arange(count)
        commands["base_vertex"] = draws.slots * (self._quads + 1) ** 2
        self._draws, self._corners, self._listed = draws, corners, commands
        self.tiles, self.triangles = count, int(commands["count"].sum()) // 3
        if count:
            self._tiles.orphan()
            self._tiles.write(tiles.tobytes())
            self._commands.orphan()
            self._commands.write(commands.tobytes())

    def tiles_within(self, west: float, south: float, east: float, north: float) -> npt.NDArray[np.intp]:
        """Return which of the placed tiles meet a rectangle, relative to the eye (m)."""
        if self._draws is None:
            return np.zeros(0, np.intp)
        low = self._corners * self._unit - self._fraction
        width = self._draws.steps * (self._quads * self._unit)
        meets = (low[:, 0] < east) & (low[:, 0] + width > west)
        meets &= (low[:, 1] > south) & (low[:, 1] - width < north)
        return np.flatnonzero(meets)

    def rewritten(self, slots: npt.NDArray[np.int64]) -> None:
        """Note that other vertices are written into slots."""
        self._writings[slots] += 1

    def state_of(self, tiles: npt.NDArray[np.intp]) -> bytes:
        """Return bytes that are equal as long as some of the placed tiles look the same."""
        draws = self._draws
        if draws is None:
            return b""
        parts = (draws.corners, draws.steps, draws.cases, draws.morph, self._writings[draws.slots])
        return b"".join(part[tiles].tobytes() for part in parts)

    def draw(
        self, array: moderngl.VertexArray | None = None, *, tiles: npt.NDArray[np.intp] | None = None
    ) -> None:
        """Draw what was placed; the camera stands in the frame's uniform block.

        Parameters
        ----------
        array
            Of :meth:`array`; by default normals and material weights are drawn, ground.frag.glsl.
        tiles
            Which of the placed ones, in their order; all by default.
        """
        commands, count = self._commands, self.tiles
        if tiles is not None:
            commands, count = self._part, len(tiles)
            commands.orphan()
            commands.write(self._listed[tiles].tobytes())
        if not count:
            return
        array = array or self._array
        set_uniforms(array.program, {"metres_per_unit": self._unit, "eye_fraction": self._fraction})
        if self._bounds is None:
            array.render_indirect(commands, moderngl.TRIANGLES, count=count)
            return
        relative = np.asarray(self._bounds) - np.tile(self._eye, 2)
        set_uniforms(array.program, {"bounds": tuple(relative.tolist())})
        with clipping(self._context):
            array.render_indirect(commands, moderngl.TRIANGLES, count=count)
