"""Drawing of terrain tiles, and a map of the surface from above."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError
from sketchterrain.geometry.lattice import metres_per_unit
from sketchterrain.render.programs import Textures, build_program, clamped, set_uniforms
from sketchterrain.render.vertex_memory import COMMAND, clipping
from sketchterrain.tiles import quadtree as borders
from sketchterrain.tiles.stream import QUADS
from sketchterrain.tiles.tile_pool import DrawList

if TYPE_CHECKING:
    Eye = tuple[float, float, float]

_TILE: Final = np.dtype(
    [("corner", "<i4", 2), ("step", "<i4"), ("centre", "<f4"), ("west", "<f4", 4), ("east", "<f4", 4)]
)
_TILE_ATTRIBUTES: Final = ("4i4 4f4 4f4/i", "tile_corner", "morph_west", "morph_east")
_MAX_UNITS: Final = 2**31 - 1  # largest lattice distance from the eye to a vertex


class TileRenderer:
    """Draws tiles of quads² cells from a buffer with (quads + 1)² vertices per slot.

    Vertices have `words` of material weights (`surfaces.vertex_dtype`), `wooded` is an expression of the
    share of ground under trees in those, w (`textures.wooded_share`). `extent` is the width of a
    level-0 tile (m); nothing is drawn beyond `bounds` (W, S, E, N; m). `tiles` and `triangles` count those
    of the last `set_tiles`, `capacity` is that of slots.
    """

    def __init__(
        self,
        context: moderngl.Context,
        extent: float,
        vertices: moderngl.Buffer,
        words: int,
        *,
        wooded: str = "0.0",
        quads: int = QUADS,
        bounds: tuple[float, float, float, float] | None = None,
    ) -> None:
        self.tiles = self.triangles = 0
        self._context = context
        self._unit = metres_per_unit(extent)
        self._quads = quads
        self.words = words
        self._wooded = wooded
        self._bounds = bounds
        self._eye = np.zeros(2)
        self._vertices = vertices
        indices, self._first_index, self._index_count = borders.tile_indices(quads)
        self._indices = context.buffer(indices.tobytes())
        self.capacity = capacity = max(vertices.size // ((16 + 8 * words) * (quads + 1) ** 2), 1)
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
        first, more = min(2 * self.words, 4), 2 * self.words - 4
        vertex = (f"4u4 {first}u4" + (f" {more}u4" if more > 0 else ""), "ground", "weight_words")
        return ((self._vertices, *vertex, *(("more_words",) if more > 0 else ())), self.tile_bindings)

    @property
    def tile_bindings(self) -> tuple[object, ...]:
        """Buffer and attributes of the tiles, instances in the order of the draw list."""
        return self._tiles, *_TILE_ATTRIBUTES

    def create_program(
        self, vertex: str, fragment: str, *, macros: Mapping[str, int | str] = MappingProxyType({})
    ) -> moderngl.Program:
        """Build a program whose vertex shader includes ``render/ground.glsl``."""
        defines = {"TILE_QUADS": self._quads, "WEIGHT_WORDS": self.words, "WOODED(w)": self._wooded, **macros}
        if self._bounds is not None:
            defines["BOUNDED"] = 1
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
        if count:
            self.draw_commands(array or self._array, commands, count)

    def bind_vertices(self, binding: int) -> None:
        """Bind the vertices of all slots as a storage buffer."""
        self._vertices.bind_to_storage_buffer(binding)

    def draw_commands(self, array: moderngl.VertexArray, commands: moderngl.Buffer, count: int) -> None:
        """Draw by `count` commands of a buffer, whose instances are tiles of the draw list."""
        set_uniforms(array.program, {"metres_per_unit": self._unit, "eye_fraction": self._eye_fraction})
        if self._bounds is None:
            array.render_indirect(commands, moderngl.TRIANGLES, count=count)
            return
        relative = np.asarray(self._bounds) - np.tile(self._eye, 2)
        set_uniforms(array.program, {"bounds": tuple(relative.tolist())})
        with clipping(self._context):
            array.render_indirect(commands, moderngl.TRIANGLES, count=count)


NEAR_WIDTH: Final = 200.0  # m
STEP: Final = 16  # texels of the grid that squares snap to
INTERVAL: Final = 6  # frames of a moving picture between two updates of a square


class SurfaceMap:
    """Heights, normals and material weights of the drawn terrain on two squares around the eye.

    Each square has texels² texels; the far one covers `radius` m around the eye. `textures` are by
    sampler name.
    """

    def __init__(
        self, context: moderngl.Context, tile_renderer: TileRenderer, *, texels: int, radius: float
    ) -> None:
        self._context = context
        self._tile_renderer = tile_renderer
        size = (2 * texels, texels)
        drawn = clamped(context.texture(size, 4, dtype="f4"))
        weights = [clamped(context.texture(size, 4)) for _ in range(tile_renderer.words)]
        self.textures: dict[str, Textures] = {"surface": drawn, "surface_weights": weights}
        self._target = context.framebuffer([drawn, *weights])
        self._target.clear()
        self._array = tile_renderer.vertex_array(
            tile_renderer.create_program("surface_map.vert.glsl", "surface_map.frag.glsl")
        )
        self._near = _MapSquare(0, texels, NEAR_WIDTH)
        self._far = _MapSquare(texels, texels, max(2.0 * radius, 2.0 * NEAR_WIDTH))
        self._turn = 0
        self._invalid = False

    def update(self, eye: Eye, *, moving: bool) -> None:
        """Redraw squares whose content changed.

        The tile renderer and the frame's uniform block have the same `eye`; `moving` lets squares take turns.
        """
        self._turn = (self._turn + 1) % INTERVAL
        deferred = moving and not self._invalid
        for square, turn in ((self._far, 0), (self._near, INTERVAL // 2)):
            if not deferred or self._turn == turn or square.needs_recentring(eye):
                self._draw(square, eye)
        self._invalid = False

    def invalidate(self) -> None:
        """Update both squares in the next picture: the terrain changed."""
        self._invalid = True

    def uniforms(self, eye: Eye) -> dict[str, object]:
        """Return both squares relative to an eye (m), for surface_map.glsl."""
        return {"surface_near": self._near.uniform(eye), "surface_far": self._far.uniform(eye)}

    def _draw(self, square: _MapSquare, eye: Eye) -> None:
        west, south = square.corner_for(eye)
        x, y = west - eye[0], south - eye[1]
        tiles = self._tile_renderer.tiles_within(x, y, x + square.width, y + square.width)
        state = (west, south, self._tile_renderer.content_key(tiles))
        if state == square.state:
            return
        square.state, square.origin = state, (west, south, eye[2])
        part = (square.offset, 0, square.texels, square.texels)
        target = self._target
        target.viewport = target.scissor = part
        target.use()
        target.clear()
        self._context.enable_only(moderngl.NOTHING)
        set_uniforms(self._array.program, {"map_place": (x, y, 2.0 / square.width)})
        self._tile_renderer.draw(self._array, tiles=tiles)


class _MapSquare:
    """One of the two squares: its position in the world and in the textures, and its content."""

    def __init__(self, offset: int, texels: int, width: float) -> None:
        self.offset, self.texels, self.width = offset, texels, width
        self.state: object = None
        self.origin: Eye | None = None
        self._step = STEP * width / texels

    def corner_for(self, eye: Eye) -> tuple[float, float]:
        """Return the south-west corner (m) of the square around an eye, snapped to whole texels."""
        x, y = (np.floor((axis - 0.5 * self.width) / self._step) * self._step for axis in eye[:2])
        return float(x), float(y)

    def needs_recentring(self, eye: Eye) -> bool:
        """Return whether the eye is an eighth of the width off the centre, or nothing was drawn yet."""
        if self.origin is None:
            return True
        away = np.abs(np.array(self.origin[:2]) + 0.5 * self.width - eye[:2])
        return bool(away.max() > 0.125 * self.width)

    def uniform(self, eye: Eye) -> tuple[float, float, float, float]:
        """Return corner x and y relative to an eye (m), 1 / width, height origin relative to the eye."""
        west, south, up = self.origin or (*self.corner_for(eye), eye[2])
        return west - eye[0], south - eye[1], 1.0 / self.width, up - eye[2]
