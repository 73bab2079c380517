"""Draped features as geometry on the drawn triangles (Sun et al. 2008), exact under any morph."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import moderngl
import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.caching import IdentityKey
from sketchterrain.drape.items import Items
from sketchterrain.drape.painting import WHITE, linear_colour
from sketchterrain.render.camera import Camera
from sketchterrain.render.draped_buffer import DrapedBuffer
from sketchterrain.render.draped_cutting import Mesh, Pieces, cut, mesh_of
from sketchterrain.render.ground_stream import TerrainStream
from sketchterrain.render.programs import set_uniforms
from sketchterrain.render.targets import RenderTargets
from sketchterrain.render.vertex_memory import COMMAND
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.tiles.quadtree import Boxes
from sketchterrain.tiles.tile_pool import DrawList

if TYPE_CHECKING:
    from sketchterrain.drape.drapes import Drapes, LayerStyle

Held = tuple[int, int]
"""Number of a layer in `Drapes.layers`, id of a feature."""

KEPT_BYTES: Final = 32 << 20  # of cut features; more only for one picture
LEAST_SINE: Final = (
    0.1  # of the angle at which ground is seen, for which strokes have room beyond their width
)
STEEPER: Final = 0.5  # of the sine at level ground: slopes may turn away
BORDER: Final = 0.75  # px beyond a stroke
_STYLE_ROWS: Final = 6  # vec4s a style, kernels/render/draped.glsl
_CODES: Final = {"butt": 0, "bevel": 1, "round": 1, "square": 2, "mitre": 2}  # of caps and joins
_FORMAT: Final = ("4u2 2f4 2f4 1u4", "corners", "weights", "place", "part")


def style_table(styles: Sequence[LayerStyle]) -> npt.NDArray[np.float32]:
    """Return the rows of styles that kernels/render/draped.glsl reads, (styles · _STYLE_ROWS, 4)."""
    table = np.zeros((len(styles), _STYLE_ROWS, 4), np.float32)
    for row, each in zip(table, styles, strict=True):
        style, opacity = each.style, each.opacity
        if style["colour"]:
            row[0] = *(WHITE * linear_colour(style["colour"])), opacity
        if style["fill"]:
            row[1] = *(WHITE * linear_colour(style["fill"])), opacity * style["fill_opacity"]
        row[2] = style["width"], style["unit"] == "px", *(_CODES[style[name]] for name in ("cap", "join"))
        lengths = np.array([float(length) for length in style["dash"].split()])
        lengths = np.tile(lengths, 1 + len(lengths) % 2)
        dashes = np.stack([np.cumsum(lengths) - lengths, lengths], axis=1)[::2].ravel()
        row[3:5].reshape(-1)[: len(dashes)] = dashes
        spacing, hatch = style["hatch_spacing"], style["hatch"]
        row[5] = (
            spacing * (hatch != "none"),
            min(style["width"] / spacing, 1.0),
            hatch == "cross",
            lengths.sum(),
        )
    return table.reshape(-1, 4)


def reaches(styles: Sequence[LayerStyle], texel: float, border: float) -> Float64Array:
    """Return how far (m) from its line each style may draw, (styles,).

    A pixel is at most `texel` m wide, and covers at most `border` m on the ground.
    """
    width = np.array([each.style["width"] for each in styles])
    in_pixels = np.array([each.style["unit"] == "px" for each in styles])
    return 0.5 * width * np.where(in_pixels, texel, 1.0) + BORDER * border


def hatch_angles(styles: Sequence[LayerStyle]) -> Float64Array:
    """Return the direction (rad) of each style's hatch, (styles,)."""
    return np.radians([each.style["hatch_angle"] for each in styles])


class DrapedView(NamedTuple):
    """The camera of a picture, and the angle (rad) of a pixel."""

    camera: Camera
    pixel: float


class Squares(NamedTuple):
    """Squares of ground with triangles on them, to which features are cut."""

    keys: Sequence[Hashable]  # (n,)
    boxes: Float64Array  # (n, 4) W, S, E, N, m
    quads: int  # along their sides
    cases: Int64Array  # (n,) of `mesh_of`
    near: Float64Array  # (n,) least and greatest width (m) of a pixel on each, ...
    far: Float64Array
    border: Float64Array  # ... and the longest part of the ground in it

    @classmethod
    def seen(
        cls, keys: Sequence[Hashable], boxes: Boxes, quads: int, cases: Int64Array, view: DrapedView
    ) -> Squares:
        """Return the squares of boxes."""
        eye, pixel = np.array(view.camera.eye), view.pixel
        apart = np.maximum(np.maximum(boxes.low - eye, eye - boxes.high), 0.0)
        away = np.maximum(np.abs(boxes.low - eye), np.abs(boxes.high - eye))
        near, far = (pixel * np.maximum(np.linalg.norm(each, axis=1), 1e-2) for each in (apart, away))
        sine = np.clip(STEEPER * pixel * apart[:, 2] / far, LEAST_SINE, 1.0)
        widths = (_stepped(near, np.floor), _stepped(far, np.ceil), _stepped(far / sine, np.ceil))
        return cls(keys, np.hstack([boxes.low[:, :2], boxes.high[:, :2]]), quads, cases, *widths)


def _stepped(widths: Float64Array, rounded: np.ufunc) -> Float64Array:
    """Return widths as powers of √2, so that what is cut for them stays."""
    return np.asarray(np.exp2(0.5 * rounded(2.0 * np.log2(widths))))


class Cut(NamedTuple):
    """Features cut for a square, and its number."""

    vertices: npt.NDArray[np.void]  # of VERTEX
    parts: npt.NDArray[np.void]  # of PART


class FeatureCutter:
    """Features cut for squares, kept until they or the squares' triangles change.

    `cuts` counts the squares that were cut.
    """

    def __init__(self) -> None:
        self._kept: dict[object, Cut] = {}
        self._items: tuple[object, Items] = (None, Items.empty())  # of the held feature
        self.cuts = 0

    @property
    def nbytes(self) -> int:
        """Bytes of what is kept."""
        return sum(each.vertices.nbytes + each.parts.nbytes for each in self._kept.values())

    def cut(self, drapes: Drapes, held: Held | None, squares: Squares) -> dict[int, Cut]:
        """Return what lies in squares, by their numbers: all features, or the held one."""
        shown = drapes.occupied(squares.boxes) if held is None else self._near_held(drapes, held, squares)
        found, names = dict[int, Cut](), list[object]()
        for number in np.flatnonzero(shown).tolist():
            case, box = int(squares.cases[number]), squares.boxes[number].tolist()
            texels = float(squares.near[number]), float(squares.far[number]), float(squares.border[number])
            name = IdentityKey(drapes), held, squares.keys[number], case, texels
            known = self._kept.get(name)
            mesh = mesh_of(squares.quads, case)
            found[number] = self._cut(drapes, held, mesh, box, texels) if known is None else known
            names.append(name)
        used = dict(zip(names, found.values(), strict=True))
        self._kept = used if self.nbytes > KEPT_BYTES else self._kept | used
        return {number: each for number, each in found.items() if len(each.vertices)}

    def _near_held(self, drapes: Drapes, held: Held, squares: Squares) -> BoolArray:
        """Return the squares that one feature may reach."""
        points = self._held_items(drapes, held).points
        low, high = points.min(axis=0, initial=np.inf), points.max(axis=0, initial=-np.inf)
        one, other = (reaches(drapes.styles, *each).max() for each in ((0.0, 0.0), (1.0, 0.0)))
        reach = (one + (other - one) * squares.far + BORDER * squares.border)[:, None]
        boxes = squares.boxes
        return np.asarray(((boxes[:, :2] <= high + reach) & (boxes[:, 2:] >= low - reach)).all(axis=1))

    def _held_items(self, drapes: Drapes, held: Held) -> Items:
        name = IdentityKey(drapes), held
        if name != self._items[0]:
            self._items = name, drapes.only(held, drapes.layers[held[0]]["finest"])  # at any scale
        return self._items[1]

    def _cut(
        self,
        drapes: Drapes,
        held: Held | None,
        mesh: Mesh,
        box: tuple[float, float, float, float],
        texels: tuple[float, float, float],
    ) -> Cut:
        self.cuts += 1
        near, far, border = texels
        items = drapes.items(box, near) if held is None else self._held_items(drapes, held)
        reach = reaches(drapes.styles, far, border)
        pieces = Pieces.of_items(items, reach, hatch_angles(drapes.styles))
        return Cut(cut(pieces, mesh, box), pieces.parts)


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

    def write(self, cuts: dict[int, Cut], styles: Sequence[LayerStyle]) -> moderngl.Buffer:
        """Upload features, unless they are there, and bind tables; return a draw command an instance."""
        state = ([(number, IdentityKey(each.vertices)) for number, each in cuts.items()], IdentityKey(styles))
        if state != self._state:
            parts, counts = ([len(each[k]) for each in cuts.values()] for k in (1, 0))
            vertices = np.concatenate([each.vertices for each in cuts.values()])
            vertices["part"] += np.repeat(np.cumsum([0, *parts[:-1]]), counts).astype(np.uint32)
            commands = np.zeros(len(cuts), COMMAND)  # of glDrawArrays: the fourth field is the instance
            commands["count"], commands["first"] = counts, np.cumsum([0, *counts[:-1]])
            commands["instances"], commands["base_vertex"] = 1, list(cuts)
            self._put("vertices", vertices.tobytes())
            self._put("parts", np.concatenate([each.parts for each in cuts.values()]).tobytes())
            self._put("styles", style_table(styles).tobytes())
            self._put("commands", commands.tobytes())
            self._state = state
        self._buffers["parts"].bind_to_storage_buffer(2)
        self._buffers["styles"].bind_to_storage_buffer(3)
        return self._buffers["commands"]

    def array(self, program: moderngl.Program, *instances: tuple[object, ...]) -> moderngl.VertexArray:
        """Return the vertices as a program's, with buffers of instances."""
        content = [(self._buffers["vertices"], *_FORMAT), *instances]
        key = tuple(IdentityKey(each[0]) for each in content)
        if key not in self._arrays:
            self._arrays = {key: self._context.vertex_array(program, content, skip_errors=True)}
        return self._arrays[key]

    def _put(self, name: str, content: bytes) -> None:
        old = self._buffers.get(name)
        if old is None or old.size < len(content):
            self._buffers[name] = self._context.buffer(reserve=max(2 * len(content), 1 << 12), dynamic=True)
        else:
            old.orphan()
        self._buffers[name].write(content)


class DrapedGeometry:
    """Draws features, cut at the triangles of the drawn tiles. Rasters are left out.

    `samples` are those of the G-buffer along each axis of a pixel. `triangles` counts those of the last
    picture, `cutter` has what is cut.
    """

    def __init__(self, context: moderngl.Context, stream: TerrainStream, *, samples: int) -> None:
        self._stream, self._tiles = stream, stream.tile_renderer
        macros = {"SAMPLES": samples, "VERTEX_WORDS": 4 + 2 * self._tiles.words}
        self._program = self._tiles.create_program(
            "draped_geometry.vert.glsl", "draped_geometry.frag.glsl", macros=macros
        )
        self.cutter = FeatureCutter()
        self._buffers = PartBuffers(context)
        self._slots = context.buffer(reserve=4 * self._tiles.capacity, dynamic=True)
        self.is_loaded, self.triangles = True, 0

    @property
    def nbytes(self) -> int:
        """Bytes of buffers on the device and of cached arrays."""
        return self._buffers.nbytes + self.cutter.nbytes

    def draw(
        self, drapes: Drapes, view: DrapedView, targets: RenderTargets, buffer: DrapedBuffer, *, moving: bool
    ) -> None:
        """Draw all features."""
        self.draw_features(drapes, None, view, targets.depth)

    def draw_features(
        self,
        drapes: Drapes,
        held: Held | None,
        view: DrapedView,
        depth: moderngl.Texture,
        *,
        share: float = 1.0,
    ) -> None:
        """Draw all features, or the held one, into the bound framebuffer; `share` scales their opacities."""
        self.triangles = 0
        if (draws := self._stream.draws) is None or not drapes.styles:
            return
        found = self.cutter.cut(drapes, held, self._squares(draws, view))
        if not found:
            return
        commands = self._buffers.write(found, drapes.styles)
        self.triangles = sum(len(each.vertices) for each in found.values()) // 3
        self._slots.orphan()
        self._slots.write(draws.slots.astype(np.int32).tobytes())
        array = self._buffers.array(self._program, self._tiles.tile_bindings, (self._slots, "1i4/i", "slot"))
        self._tiles.bind_vertices(1)
        depth.use(1)
        set_uniforms(self._program, {"ground_depth": 1, "share": share})
        self._tiles.draw_commands(array, commands, len(found))

    def _squares(self, draws: DrawList, view: DrapedView) -> Squares:
        tiles, unit = self._stream.tiles, metres_per_unit(self._stream.tiles.extent)
        width = unit * draws.steps * tiles.quads
        west, north = (unit * draws.corners).T
        low = np.stack([west, north - width, tiles.pool.bottom[draws.slots]], axis=1)
        boxes = Boxes(low, np.stack([west + width, north, tiles.pool.top[draws.slots]], axis=1))
        return Squares.seen(draws.keys, boxes, tiles.quads, draws.cases, view)
