"""Draped features as geometry on the drawn triangles, cut at their sides (Sun et al. 2008, 3.2 and 3.3).

Strokes become one convex piece a segment, divided from its neighbours along the bisectors of their corners,
and areas the triangles of a constrained Delaunay triangulation. Pieces are clipped to the triangles that they
meet, which are found row by row of the triangles' grid.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import moderngl
import numpy as np
import numpy.typing as npt
import shapely

from sketchterrain.array_types import BoolArray, Bounds, Float64Array, Int64Array
from sketchterrain.features.items import AFTER, BEFORE, ENDS, FILL, POINT, STARTS, Items
from sketchterrain.geometry.box_index import expanded
from sketchterrain.geometry.camera import Camera
from sketchterrain.geometry.lattice import metres_per_unit
from sketchterrain.host.library import host_function
from sketchterrain.render.ground_stream import TerrainStream
from sketchterrain.render.programs import set_uniforms
from sketchterrain.render.targets import RenderTargets
from sketchterrain.render.vertex_memory import COMMAND
from sketchterrain.terrain.appearance import style_row
from sketchterrain.tiles.quadtree import tile_indices
from sketchterrain.tiles.tile_pool import DrawList

if TYPE_CHECKING:
    from sketchterrain.drape.drapes import Drapes, LayerStyle


VERTEX: Final = np.dtype([("corners", "<u2", 4), ("weights", "<f4", 2), ("place", "<f4", 2), ("part", "<u4")])
"""A vertex on a triangle: numbers of its corners, weights of the second and third, place in its part."""
PART: Final = np.dtype([("length", "<f4"), ("along", "<f4"), ("style", "<f4"), ("flags", "<f4")])
"""What a piece is part of: a segment (m), how far along its line it starts (m), its style, and flags."""
IS_FILL, IS_POINT = 16, 32  # flags beside those of `Items.ends`
_MOST: Final = 16  # corners of a clipped piece
_TOUCH: Final = 1e-3  # of a quad, by which triangles that meet it reach into it at least


class ConvexPieces(NamedTuple):
    """Convex pieces of features in the order in which they are drawn."""

    corners: Float64Array  # (n, _MOST, 2) m
    counts: Int64Array  # (n,) corners
    frame: Float64Array  # (n, 4) m: origin and direction of the piece's own coordinates
    parts: npt.NDArray[np.void]  # (n,) of PART

    @classmethod
    def of_items(cls, items: Items, reach: Float64Array, angles: Float64Array) -> ConvexPieces:
        """Return the pieces of items, strokes and points within `reach` (m) of theirs (styles,).

        Places in areas are along and across `angles` (styles,), the directions (rad) of their hatches.
        """
        fills = items.kind == FILL
        # Runs of fills of one feature are one area.
        other = np.diff([items.feature, items.style, fills], axis=1).any(axis=0)
        starts = np.flatnonzero(np.append(True, other | ~fills[1:])[: len(fills)])
        strokes, owner = _strokes(items.taken(~fills), reach)
        found, owners = [strokes], [np.flatnonzero(~fills)[owner]]
        for start, end in pairwise([*starts.tolist(), len(fills)]):
            if fills[start]:
                found.append(_area(items, start, end, float(angles[items.style[start]])))
                owners.append(np.full(len(found[-1].counts), start))
        order = np.argsort(np.concatenate(owners), kind="stable")
        return cls(*(np.concatenate(each)[order] for each in zip(*found, strict=True)))


def _area(items: Items, start: int, end: int, angle: float) -> ConvexPieces:
    """Return the triangles of an area: shells less holes."""
    sides: tuple[list[shapely.Geometry], list[shapely.Geometry]] = ([], [])
    for first, last in pairwise(items.first[start : end + 1]):
        ring = items.points[first:last]
        if len(ring) > 3:
            turn = np.sum(ring[:-1, 0] * ring[1:, 1] - ring[1:, 0] * ring[:-1, 1])
            sides[int(turn < 0.0)].append(shapely.make_valid(shapely.Polygon(ring)))
    covered = shapely.difference(*map(shapely.union_all, sides))
    found = shapely.orient_polygons(shapely.get_parts(shapely.constrained_delaunay_triangles(covered)))
    triangles = shapely.get_coordinates(found).reshape(-1, 4, 2)[:, :3]
    corners = np.zeros((len(triangles), _MOST, 2))
    corners[:, :3] = triangles
    parts = np.zeros(len(triangles), PART)
    parts["style"], parts["flags"] = items.style[start], IS_FILL
    frame = np.tile([0.0, 0.0, np.cos(angle), np.sin(angle)], (len(triangles), 1))
    return ConvexPieces(corners, np.full(len(triangles), 3), frame, parts)


def _strokes(items: Items, reach: Float64Array) -> tuple[ConvexPieces, Int64Array]:
    """Return the pieces of lines and points, all within `reach` that is nearest to a segment; their items."""
    is_new = np.ones(len(items.points), bool)
    is_new[1:] = (items.points[1:] != items.points[:-1]).any(axis=1)
    is_new[items.first[:-1]] = True
    first = np.append(0, np.cumsum(is_new))[items.first]  # without repeated points
    size = np.diff(first)
    ends = np.where(items.kind == POINT, IS_POINT, items.ends).astype(np.int64)
    before = ((ends & BEFORE) > 0) & (size > 2)
    after = ((ends & AFTER) > 0) & (size - before > 2)
    owner, place = expanded(np.maximum(size - before - after - 1, 1))
    place += before[owner]
    n = len(owner)
    corners, count, frame = np.empty((n, _MOST, 2)), np.empty(n, np.int64), np.empty((n, 4))
    length, along, reaches = np.empty(n), np.empty(n), reach[items.style]
    lines = items.points[is_new], first, reaches, owner, place
    host_function("stroke_pieces")(*lines, corners, count, frame, length, along)
    parts = np.zeros(n, PART)
    parts["length"], parts["along"], parts["style"] = length, along + items.along[owner], items.style[owner]
    ends, size = ends[owner], size[owner]
    parts["flags"] = ends & (IS_POINT | STARTS * (place == 0) | ENDS * (place >= size - 2))
    return ConvexPieces(corners, count, frame, parts), owner


class QuadMesh(NamedTuple):
    """Triangles on a grid of quads, and those that meet each quad."""

    numbers: Int64Array  # (t, 3) vertices, in rows from north to south
    corners: Float64Array  # (t, 3, 2) columns eastward and rows southward
    first: Int64Array  # (quads² + 1,) into `met`
    met: Int64Array


@cache
def mesh_of(quads: int, case: int) -> QuadMesh:
    """Return the triangles of a tile in a border case of `tile_indices`."""
    indices, starts, counts = tile_indices(quads)
    numbers = indices[starts[case] : starts[case] + counts[case]].astype(np.int64).reshape(-1, 3)
    corners = np.stack([numbers % (quads + 1), numbers // (quads + 1)], axis=-1).astype(np.float64)
    count, border = np.full(len(corners), 3), np.full(len(corners), -_TOUCH)
    cell, met = cells_met(corners, count, border, quads)
    order = np.argsort(cell, kind="stable")
    first = np.searchsorted(cell[order], np.arange(quads * quads + 1))
    return QuadMesh(numbers, corners, first, met[order])


def cut(pieces: ConvexPieces, mesh: QuadMesh, box: Bounds) -> npt.NDArray[np.void]:
    """Return pieces cut at the sides of a mesh that fills a box (m), as triangles (n,) of VERTEX."""
    quads = round(np.sqrt(len(mesh.first) - 1))
    west, north, cell = box[0], box[3], (box[2] - box[0]) / quads
    local = (pieces.corners - [west, north]) * [1.0 / cell, -1.0 / cell]
    met = cells_met(local, pieces.counts, np.zeros(len(local)), quads)
    triangle, part, columns, rows = _cut(local, pieces.counts, *met, mesh)
    a, b, c = (mesh.corners[triangle, k].T for k in range(3))
    (p, q), (s, t), (x, y) = b - a, c - a, (columns, rows) - a
    vertices = np.empty(len(part), VERTEX)
    vertices["corners"][:, :3], vertices["corners"][:, 3] = mesh.numbers[triangle], 0
    weights = np.stack([x * t - y * s, p * y - q * x]) / (p * t - q * s)
    vertices["weights"], vertices["part"] = weights.T, part
    frame = pieces.frame[part]
    x, y = west + cell * columns - frame[:, 0], north - cell * rows - frame[:, 1]
    vertices["place"][:, 0] = x * frame[:, 2] + y * frame[:, 3]
    vertices["place"][:, 1] = y * frame[:, 2] - x * frame[:, 3]
    return vertices


def cells_met(
    polygons: Float64Array, count: Int64Array, border: Float64Array, cells: int
) -> tuple[Int64Array, Int64Array]:
    """Return the cells of a grid that polygons meet, and the polygons' numbers, ascending.

    Polygons are widened by a border (n,). All lengths are in cells, `cells` along a side.
    """
    kinds = np.int64, np.int64
    found, number = _all_found("cells_met", kinds, 4 * len(polygons), polygons, count, border, cells)
    return found, number


def _cut(
    polygons: Float64Array, count: Int64Array, cells: Int64Array, owners: Int64Array, mesh: QuadMesh
) -> list[npt.NDArray[Any]]:
    """Clip polygons to triangles that meet their cells: each vertex's triangle, polygon, column and row."""
    stamp = np.empty(len(mesh.corners), np.int64)
    fixed = polygons, count, cells, owners, mesh.corners, mesh.first, mesh.met, stamp
    return _all_found("cut_polygons", (np.int64, np.int64, np.float64, np.float64), 16 * len(cells), *fixed)


def _all_found(name: str, kinds: tuple[type, ...], room: int, *arguments: Any) -> list[npt.NDArray[Any]]:
    """Return all that a loop finds, which fits into arrays of a size or tells a size that it needs."""
    while True:
        found: list[npt.NDArray[Any]] = [np.empty(room, kind) for kind in kinds]
        count = host_function(name)(*arguments, *found)
        if count <= room:
            return [each[:count] for each in found]
        room = count


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
