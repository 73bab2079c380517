"""Draped features as geometry on the drawn triangles (Sun et al. 2008), exact under any morph."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import moderngl
import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.features.items import Items
from sketchterrain.geometry.lattice import metres_per_unit
from sketchterrain.render.camera import Camera
from sketchterrain.render.draped_cutting import PART, VERTEX, ConvexPieces, QuadMesh, cut, mesh_of
from sketchterrain.render.ground_stream import TerrainStream
from sketchterrain.render.programs import set_uniforms
from sketchterrain.render.targets import RenderTargets
from sketchterrain.render.vertex_memory import COMMAND
from sketchterrain.terrain.appearance import style_row
from sketchterrain.tiles.tile_pool import DrawList

if TYPE_CHECKING:
    from sketchterrain.drape.drapes import Drapes, LayerStyle

Held = tuple[int, int]
"""Number of a layer in `Drapes.layers`, id of a feature."""

KEPT_BYTES: Final = 32 << 20  # of cut features; more only for one picture
KEPT_SQUARES: Final = 1 << 12  # likewise
LEAST_SINE: Final = 0.1
"""Of the angle at which ground is seen, for which strokes have room beyond their width."""
STEEPER: Final = 0.5  # of the sine at level ground: slopes may turn away
NEAREST: Final = 0.01  # m, least distance for the width of pixels
BORDER: Final = 0.75  # px beyond a stroke
_FORMAT: Final = ("4u2 2f4 2f4 1u4", "corners", "weights", "place", "part")


def reaches(
    styles: Sequence[LayerStyle], texel: float | Float64Array, border: float | Float64Array
) -> Float64Array:
    """Return how far (m) from its line each style may draw, (styles,), for squares (n, 1) as (n, styles).

    A pixel is at most `texel` m wide, and covers at most `border` m on the ground.
    """
    width = np.array([each.style["width"] for each in styles])
    in_pixels = np.array([each.style["unit"] == "px" for each in styles])
    return np.asarray(0.5 * width * np.where(in_pixels, texel, 1.0) + BORDER * border)


class DrapedView(NamedTuple):
    """The camera of a picture, and the angle (rad) of a pixel."""

    camera: Camera
    pixel: float


class _Squares(NamedTuple):
    """Drawn tiles, to whose triangles features are cut."""

    keys: Sequence[Hashable]  # (n,) of what is cut: a tile's own, case and widths
    boxes: Float64Array  # (n, 4) W, S, E, N, m
    near: Float64Array  # (n,) least and greatest width (m) of a pixel on each, ...
    far: Float64Array
    border: Float64Array  # ... and the longest part of the ground in it


def _stepped(widths: Float64Array, rounded: np.ufunc) -> Float64Array:
    """Return widths as powers of √2, so that what is cut for them stays."""
    return np.asarray(np.exp2(0.5 * rounded(2.0 * np.log2(widths))))


class _Cut(NamedTuple):
    """Features cut for a tile."""

    vertices: npt.NDArray[np.void]  # of VERTEX
    parts: npt.NDArray[np.void]  # of PART


_NOTHING: Final = _Cut(np.zeros(0, VERTEX), np.zeros(0, PART))


class DrapedGeometry:
    """Draws features, cut at the triangles of the drawn tiles. Rasters are left out.

    Layers of blend modes other than normal are drawn as normal. `samples` are those of the G-buffer along
    each axis of a pixel. What is cut is kept until it or the tiles' triangles change.
    """

    def __init__(self, context: moderngl.Context, stream: TerrainStream, *, samples: int) -> None:
        self._context, self._stream, self._tiles = context, stream, stream.tile_renderer
        macros = {"SAMPLES": samples, "VERTEX_WORDS": 4 + 2 * self._tiles.words}
        self._program = self._tiles.create_program(
            "draped_geometry.vert.glsl", "draped_geometry.frag.glsl", macros=macros
        )
        self._slots = context.buffer(reserve=4 * self._tiles.capacity, dynamic=True)
        self._kept: dict[object, _Cut] = {}
        self._items: tuple[object, Items] = (None, Items.empty())  # of the held feature
        self._state: object = None  # of the buffers
        self._uploaded = 0  # bytes

    @property
    def nbytes(self) -> int:
        """Bytes of buffers on the device and of cut features."""
        return self._uploaded + sum(each.vertices.nbytes + each.parts.nbytes for each in self._kept.values())

    def draw(
        self,
        drapes: Drapes,
        view: DrapedView,
        targets: RenderTargets,
        *,
        held: Held | None = None,
        share: float = 1.0,
    ) -> None:
        """Draw all features, or the held one, into the bound framebuffer; `share` scales their opacities."""
        if (draws := self._stream.draws) is None or not drapes.styles:
            return
        found = self._found(drapes, held, draws, self._squares(draws, view))
        if not found:
            return
        self._upload(found, drapes.styles)
        self._slots.orphan()
        self._slots.write(draws.slots.astype(np.int32).tobytes())
        self._tiles.bind_vertices(1)
        targets.depth.use(1)
        set_uniforms(self._program, {"ground_depth": 1, "share": share})
        self._tiles.draw_commands(self._array, self._commands, len(found))

    def _squares(self, draws: DrawList, view: DrapedView) -> _Squares:
        tiles, unit = self._stream.tiles, metres_per_unit(self._stream.tiles.extent)
        width = unit * draws.steps * tiles.quads
        west, north = (unit * draws.corners).T
        low = np.stack([west, north - width, tiles.pool.bottom[draws.slots]], axis=1)
        high = np.stack([west + width, north, tiles.pool.top[draws.slots]], axis=1)
        eye, pixel = np.array(view.camera.eye), view.pixel
        apart = np.maximum(np.maximum(low - eye, eye - high), 0.0)
        away = np.maximum(np.abs(low - eye), np.abs(high - eye))
        near, far = (pixel * np.maximum(np.linalg.norm(each, axis=1), NEAREST) for each in (apart, away))
        sine = np.clip(STEEPER * pixel * apart[:, 2] / far, LEAST_SINE, 1.0)
        widths = (_stepped(near, np.floor), _stepped(far, np.ceil), _stepped(far / sine, np.ceil))
        keys = list(zip(draws.keys, draws.cases.tolist(), *(each.tolist() for each in widths), strict=True))
        return _Squares(keys, np.hstack([low[:, :2], high[:, :2]]), *widths)

    def _found(
        self, drapes: Drapes, held: Held | None, draws: DrawList, squares: _Squares
    ) -> dict[int, _Cut]:
        """Return what lies in tiles, by their numbers: all features, or the held one."""
        names = [(drapes, held, key) for key in squares.keys]
        new = np.flatnonzero([name not in self._kept for name in names])
        for number, shown in zip(new.tolist(), self._near(drapes, held, squares, new).tolist(), strict=True):
            mesh = mesh_of(self._stream.tiles.quads, int(draws.cases[number]))
            found = self._cut(drapes, held, squares, number, mesh) if shown else _NOTHING
            self._kept[names[number]] = found
        used: dict[object, _Cut] = {name: self._kept[name] for name in names}
        if len(self._kept) > KEPT_SQUARES or self.nbytes - self._uploaded > KEPT_BYTES:
            self._kept = used
        return {number: each for number, each in enumerate(used.values()) if len(each.vertices)}

    def _near(self, drapes: Drapes, held: Held | None, squares: _Squares, which: Int64Array) -> BoolArray:
        """Return whether features, or the held one, may reach some tiles."""
        reach = reaches(drapes.styles, squares.far[which, None], squares.border[which, None])
        reach, boxes = reach.max(axis=1, initial=0.0, keepdims=True), squares.boxes[which]
        low, high = boxes[:, :2] - reach, boxes[:, 2:] + reach
        if held is None:
            return drapes.occupied(np.hstack([low, high]))
        points = self._held_items(drapes, held).points
        first, last = points.min(axis=0, initial=np.inf), points.max(axis=0, initial=-np.inf)
        return np.asarray(((low <= last) & (high >= first)).all(axis=1))

    def _held_items(self, drapes: Drapes, held: Held) -> Items:
        name = drapes, held
        if name != self._items[0]:
            self._items = name, drapes.only(held, drapes.layers[held[0]]["finest"])  # at any scale
        return self._items[1]

    def _cut(self, drapes: Drapes, held: Held | None, squares: _Squares, number: int, mesh: QuadMesh) -> _Cut:
        west, south, east, north = squares.boxes[number].tolist()
        box = west, south, east, north
        near, far, border = (float(each[number]) for each in (squares.near, squares.far, squares.border))
        items = drapes.items(box, near) if held is None else self._held_items(drapes, held)
        hatches = np.radians([each.style["hatch_angle"] for each in drapes.styles])
        pieces = ConvexPieces.of_items(items, reaches(drapes.styles, far, border), hatches)
        return _Cut(cut(pieces, mesh, box), pieces.parts)

    def _upload(self, cuts: dict[int, _Cut], styles: Sequence[LayerStyle]) -> None:
        """Upload features unless they are there, with a draw command for each of the tiles; bind tables."""
        state = [(number, id(each.vertices)) for number, each in cuts.items()], id(styles)
        if state != self._state:
            parts, counts = ([len(each[k]) for each in cuts.values()] for k in (1, 0))
            vertices = np.concatenate([each.vertices for each in cuts.values()])
            vertices["part"] += np.repeat(np.cumsum([0, *parts[:-1]]), counts).astype(np.uint32)
            commands = np.zeros(len(cuts), COMMAND)  # of glDrawArrays: the fourth field is the instance
            commands["count"], commands["first"] = counts, np.cumsum([0, *counts[:-1]])
            commands["instances"], commands["base_vertex"] = 1, list(cuts)
            table = np.concatenate([each.parts for each in cuts.values()])
            looks = np.array([style_row(each) for each in styles], np.float32)
            content = [each.tobytes() for each in (vertices, table, looks, commands)]
            bound, self._parts, self._styles, self._commands = map(self._context.buffer, content)
            bindings = [(bound, *_FORMAT), self._tiles.tile_bindings, (self._slots, "1i4/i", "slot")]
            self._array = self._context.vertex_array(self._program, bindings, skip_errors=True)
            self._uploaded, self._state = sum(map(len, content)), state
            self._shown = cuts, styles  # of the ids
        self._parts.bind_to_storage_buffer(2)
        self._styles.bind_to_storage_buffer(3)
