"""Draped features as geometry on the drawn triangles (Sun et al. 2008), exact under any morph."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple

import moderngl
import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.caching import IdentityKey, LRUCache
from sketchterrain.drape.items import Items
from sketchterrain.render.camera import Camera
from sketchterrain.render.draped_cutting import Pieces, cut, mesh_of
from sketchterrain.render.ground_stream import TerrainStream
from sketchterrain.render.programs import set_uniforms
from sketchterrain.render.vertex_memory import COMMAND
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.tiles.quadtree import Boxes
from sketchterrain.tiles.tile_pool import DrawList

if TYPE_CHECKING:
    from sketchterrain.drape.drapes import Drapes, LayerStyle

Held = tuple[int, int]
"""Number of a layer in `Drapes.layers`, id of a feature."""

CACHE_BYTES: Final = 32 << 20  # of cut features
LEAST_SINE: Final = 0.1  # of the angle at which ground is seen, for which the borders of strokes have room
BORDER: Final = 1.5  # px beyond a stroke, seen at that angle
_STYLE_ROWS: Final = 6  # vec4s a style, kernels/render/draped.glsl
_CAPS: Final = ("butt", "round", "square")
_JOINS: Final = ("bevel", "round", "mitre")
_HATCHES: Final = ("none", "lines", "cross")
_FORMAT: Final = ("4u2 2f4 2f4 1u4", "corners", "weights", "place", "part")


def root_albedo(colour: str) -> list[float]:
    """Return √albedo of a colour as ``#rrggbb``, (3,)."""
    srgb = np.frombuffer(bytes.fromhex(colour[1:]), np.uint8) / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return list(np.sqrt(linear).tolist())


def style_table(styles: Sequence[LayerStyle]) -> npt.NDArray[np.float32]:
    """Return the rows of styles that kernels/render/draped.glsl reads, (styles · _STYLE_ROWS, 4)."""
    table = np.zeros((max(len(styles), 1), _STYLE_ROWS, 4), np.float32)
    for row, style in zip(table, styles, strict=False):
        own, opacity = style.values, style.opacity
        if own["colour"]:
            row[0] = *root_albedo(own["colour"]), opacity
        if own["fill"]:
            row[1] = *root_albedo(own["fill"]), opacity * own["fill_opacity"]
        row[2] = own["width"], own["unit"] == "px", _CAPS.index(own["cap"]), _JOINS.index(own["join"])
        dashes = [float(length) for length in own["dash"].split()]
        row[3:5].reshape(-1)[: 2 * len(dashes) if len(dashes) % 2 else len(dashes)] = (
            dashes * 2 if len(dashes) % 2 else dashes
        )[:8]
        row[5, :2] = _HATCHES.index(own["hatch"]), own["hatch_spacing"]
    return table.reshape(-1, 4)


def reaches(styles: Sequence[LayerStyle], texel: float) -> Float64Array:
    """Return how far (m) from its line each style may draw where a pixel covers `texel` m, (styles,)."""
    width = np.array([each.values["width"] for each in styles])
    in_pixels = np.array([each.values["unit"] == "px" for each in styles])
    return 0.5 * width * np.where(in_pixels, texel, 1.0) + BORDER * texel / LEAST_SINE


def hatch_angles(styles: Sequence[LayerStyle]) -> Float64Array:
    """Return the direction (rad) of each style's hatch, (styles,)."""
    return np.radians([each.values["hatch_angle"] for each in styles])


class Cut(NamedTuple):
    """Features cut for a tile."""

    vertices: npt.NDArray[np.void]  # of VERTEX
    parts: npt.NDArray[np.void]  # of PART


class DrapedGeometry:
    """Draws features, cut at the triangles of the drawn tiles, into the bound framebuffer.

    `samples` are those of the G-buffer along each axis of a pixel. `nbytes` counts the memory of buffers,
    `triangles` those of the last picture, `cuts` the tiles that were cut.
    """

    def __init__(self, context: moderngl.Context, stream: TerrainStream, *, samples: int) -> None:
        self._context, self._stream = context, stream
        self._tiles = stream.tile_renderer
        macros = {"SAMPLES": samples, "HIDDEN": 1, "VERTEX_WORDS": 4 + 2 * self._tiles.words}
        self._program = self._tiles.create_program(
            "draped_geometry.vert.glsl", "draped_geometry.frag.glsl", macros=macros
        )
        self._cache = LRUCache(max_bytes=CACHE_BYTES)
        self._buffers = PartBuffers(context)
        self._slots = context.buffer(reserve=4 * self._tiles.capacity, dynamic=True)
        self._commands = context.buffer(reserve=COMMAND.itemsize * self._tiles.capacity, dynamic=True)
        self.triangles = self.cuts = 0

    @property
    def nbytes(self) -> int:
        """Bytes of buffers on the device and of cached arrays."""
        return self._buffers.nbytes + self._cache.nbytes

    def draw(
        self,
        drapes: Drapes,
        held: Held | None,
        camera: Camera,
        pixel: float,
        depth: moderngl.Texture,
        *,
        share: float = 1.0,
    ) -> None:
        """Draw all features, or the held one, with the camera of the frame's uniform block.

        `pixel` is the angle of a pixel (rad), `depth` that of the G-buffer, `share` a factor of opacities.
        """
        draws = self._stream.draws
        self.triangles = 0
        if draws is None or not len(draws.slots) or not drapes.styles:
            return
        near, far = self._texels(draws, camera, pixel)
        cuts = self._cuts_of(drapes, held, draws, near, far)
        which = np.array([number for number, each in cuts if len(each.vertices)], np.int64)
        found = [each for _, each in cuts if len(each.vertices)]
        if not found:
            return
        commands = np.zeros(len(found), COMMAND)  # of DrawArraysIndirect: the fourth field is the instance
        commands["count"] = [len(each.vertices) for each in found]
        commands["first"] = np.cumsum(commands["count"]) - commands["count"]
        commands["instances"], commands["base_vertex"] = 1, which
        self.triangles = int(commands["count"].sum()) // 3
        self._buffers.write(found, drapes.styles)
        for buffer, values in ((self._slots, draws.slots.astype(np.int32)), (self._commands, commands)):
            buffer.orphan()
            buffer.write(values.tobytes())
        array = self._buffers.array(
            self._program, _FORMAT, self._tiles.tile_bindings, (self._slots, "1i4/i", "slot")
        )
        self._tiles.bind_vertices(1)
        depth.use(1)
        set_uniforms(self._program, {"ground_depth": 1, "share": share})
        self._tiles.draw_commands(array, self._commands, len(found))

    def _texels(self, draws: DrawList, camera: Camera, pixel: float) -> tuple[Float64Array, Float64Array]:
        """Return the least and greatest width (m) of pixels on each tile, powers of two."""
        boxes, eye = self._boxes(draws), np.array(camera.eye)
        near = np.maximum(np.maximum(boxes.low - eye, eye - boxes.high), 0.0)
        far = np.maximum(np.abs(boxes.low - eye), np.abs(boxes.high - eye))
        near_texel, far_texel = (
            pixel * np.maximum(np.linalg.norm(each, axis=1), 1e-2) for each in (near, far)
        )
        return np.exp2(np.floor(np.log2(near_texel))), np.exp2(np.ceil(np.log2(far_texel)))

    def _boxes(self, draws: DrawList) -> Boxes:
        pool, unit = self._stream.tiles.pool, metres_per_unit(self._stream.tiles.extent)
        width = unit * draws.steps * self._stream.tiles.quads
        west, north = (unit * draws.corners).T
        low = np.stack([west, north - width, pool.bottom[draws.slots]], axis=1)
        return Boxes(low, np.stack([west + width, north, pool.top[draws.slots]], axis=1))

    def _cuts_of(
        self, drapes: Drapes, held: Held | None, draws: DrawList, near: Float64Array, far: Float64Array
    ) -> list[tuple[int, Cut]]:
        """Return the numbers of tiles with features in them, and these."""
        boxes = self._boxes(draws)
        flat = np.hstack([boxes.low[:, :2], boxes.high[:, :2]])
        shown = drapes.occupied(flat) if held is None else np.ones(len(flat), np.bool_)
        result = []
        for number in np.flatnonzero(shown).tolist():
            texels = float(near[number]), float(far[number])
            if held is not None:
                low, high = self._held(drapes, held, texels)[1]
                if (flat[number, :2] > high).any() or (flat[number, 2:] < low).any():
                    continue
            key = IdentityKey(drapes), held, draws.keys[number], int(draws.cases[number]), texels
            result.append(
                (
                    number,
                    self._cache.get_or_compute(
                        key, partial(self._cut, drapes, held, draws, number, flat[number].tolist(), texels)
                    ),
                )
            )
        return result

    def _held(self, drapes: Drapes, held: Held, texels: tuple[float, float]) -> tuple[Pieces, Float64Array]:
        """Return the pieces of one feature, and the corners of their box (m)."""

        def made() -> tuple[Pieces, Float64Array]:
            pieces = self._pieces(drapes, drapes.only(held, texels[1]), texels[1])
            inside = np.arange(pieces.corners.shape[1]) < pieces.count[:, None]
            corners = pieces.corners[inside]
            low, high = (
                (corners.min(axis=0), corners.max(axis=0))
                if len(corners)
                else (np.full(2, np.inf), np.full(2, -np.inf))
            )
            return pieces, np.stack([low, high])

        return self._cache.get_or_compute((IdentityKey(drapes), held, texels[1]), made)

    def _pieces(self, drapes: Drapes, items: Items, texel: float) -> Pieces:
        return Pieces.of_items(items, reaches(drapes.styles, texel), hatch_angles(drapes.styles))

    def _cut(
        self,
        drapes: Drapes,
        held: Held | None,
        draws: DrawList,
        number: int,
        box: tuple[float, float, float, float],
        texels: tuple[float, float],
    ) -> Cut:
        self.cuts += 1
        pieces = (
            self._pieces(drapes, drapes.items(box, texels[0]), texels[1])
            if held is None
            else self._held(drapes, held, texels)[0]
        )
        mesh, quads = mesh_of(self._stream.tiles.quads, int(draws.cases[number])), self._stream.tiles.quads
        return Cut(cut(pieces, mesh, box[0], box[3], (box[2] - box[0]) / quads), pieces.parts)


class PartBuffers:
    """Buffers of vertices, parts and styles, for programs with kernels/render/draped.glsl."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._buffers: dict[str, moderngl.Buffer] = {}
        self._arrays: dict[object, moderngl.VertexArray] = {}
        self._state: object = None

    @property
    def nbytes(self) -> int:
        """Bytes of all buffers."""
        return sum(buffer.size for buffer in self._buffers.values())

    def write(self, cuts: Sequence[Cut], styles: Sequence[LayerStyle]) -> None:
        """Upload all that is drawn, unless it is in the buffers, and bind parts and styles."""
        state = ([IdentityKey(each.vertices) for each in cuts], IdentityKey(styles))
        if state != self._state:
            offsets = np.cumsum([0, *(len(each.parts) for each in cuts)])
            vertices = np.concatenate([each.vertices for each in cuts])
            vertices["part"] += np.repeat(offsets[:-1], [len(each.vertices) for each in cuts]).astype(
                np.uint32
            )
            self._put("vertices", vertices.tobytes())
            self._put("parts", np.concatenate([each.parts for each in cuts]).tobytes())
            self._put("styles", style_table(styles).tobytes())
            self._state = state
        self._buffers["parts"].bind_to_storage_buffer(2)
        self._buffers["styles"].bind_to_storage_buffer(3)

    def array(
        self, program: moderngl.Program, form: tuple[str, ...], *others: tuple[object, ...]
    ) -> moderngl.VertexArray:
        """Return the vertices as a program's, with buffers of instances."""
        key = IdentityKey(program), IdentityKey(self._buffers["vertices"])
        if key not in self._arrays:
            bindings = [(self._buffers["vertices"], *form), *others]
            self._arrays = {key: self._context.vertex_array(program, bindings, skip_errors=True)}
        return self._arrays[key]

    def _put(self, name: str, content: bytes) -> None:
        old = self._buffers.get(name)
        if old is None or old.size < len(content):
            self._buffers[name] = self._context.buffer(reserve=max(2 * len(content), 1 << 12), dynamic=True)
        else:
            old.orphan()
        self._buffers[name].write(content)
