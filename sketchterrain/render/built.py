"""Drawing of what is built: meshes of bridges, tunnels, houses and walls."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Final, NamedTuple

import moderngl
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Bounds, Float64Array, StructuredArray
from sketchterrain.caching import LRUCache
from sketchterrain.io.resources import kernel_constants
from sketchterrain.look.built_meshes import BUILT, MOUTH, BuiltMaterial, BuiltObject, BuiltPart
from sketchterrain.look.road_meshes import built_objects
from sketchterrain.render.programs import build_program, set_uniforms
from sketchterrain.render.targets import bands
from sketchterrain.render.vertex_memory import COMMAND
from sketchterrain.roads.road_types import BRIDGE, Road, RoadNetwork, axis_points
from sketchterrain.schema.layers import LANE_WIDTHS
from sketchterrain.tiles.lod import inside_frustum

if TYPE_CHECKING:
    from sketchterrain.geometry.camera import Camera
    from sketchterrain.render.scene import TerrainSource
    from sketchterrain.render.targets import RenderTargets

CELL: Final = 256.0  # m, side of the squares whose objects are drawn together
FAR: Final = 10.0  # px, size of things that are lit at their vertices
UNIT: Final = 12.0  # m, size of meshes that counts for that
LEAST: Final = 0.25  # px; smaller objects are left out

_VERTEX: Final = np.dtype(
    [("position", "<f4", 3), ("normal", "u1", 4), ("colour", "u1", 4), ("uv", "<f4", 2), ("look", "<f4", 2)]
)
_VERTEX_FORMAT: Final = (
    *("3f4 4f1 4f1 2f4 2f4", "local_position", "local_normal"),
    *("vertex_colour", "vertex_uv", "vertex_look"),
)
MARKS: Final = {  # macros: constants of the marks of carriageways
    **{
        name: f"{kernel_constants('appearance.clh', name)[0]:f}"
        for name in ("DASH", "DASH_DUTY", "LINE_HALF", "LINE_INSET")
    },
    "LANE": f"{LANE_WIDTHS['road']:f}",
}
_PAINTED: Final = {"asphalt": BuiltMaterial("asphalt", (0.085, 0.085, 0.088))}  # as appearance.clh paints it
_TILES: Final = -1.0  # in place of the distance of railway tracks: rows of tiles


class BuiltScenery:
    """Everything built on a terrain.

    `changes` counts updates, `triangles` those of the last picture, `origin` (m) is that of its vertices.
    """

    def __init__(
        self, context: moderngl.Context, terrain: TerrainSource, *, defines: Mapping[str, int | str]
    ) -> None:
        self._context = context
        self.origin = np.array([0.5 * terrain.size[0], 0.5 * terrain.size[1], 0.0])
        self._shadow = build_program(context, "built_shadow.vert.glsl", "nothing.frag.glsl")
        self.changes = self.triangles = 0
        self._network = RoadNetwork()
        self._layers: dict[str, int] = {}
        self._objects: dict[object, list[_Block]] = {}
        self._drawn: dict[str, _Drawn] = {}
        self._decks = cKDTree(np.zeros((0, 3)))
        self.rebuild(defines)
        self.set_terrain(terrain, ())

    def __bool__(self) -> bool:
        return bool(self._drawn)

    def rebuild(self, defines: Mapping[str, int | str]) -> None:
        """Replace the programs by ones with other macros."""
        self._defines = defines
        self._programs: dict[str, moderngl.Program] = {}
        for each in self._drawn.values():
            each.arrays.clear()

    def set_terrain(self, terrain: TerrainSource, areas: Sequence[Bounds]) -> None:
        """Replace what has changed, or stands in `areas` (m) where the ground has."""
        network = terrain.features.network
        if network is self._network and not areas:
            return
        layers = {name: number for number, name in enumerate(terrain.sketch.material_table.layers)}
        if layers != self._layers:
            self._layers, self._objects = layers, {}
        self._network = network
        stations = [_deck_places(road) for road in network.roads if road.structure == BRIDGE]
        self._decks = cKDTree(np.concatenate([np.zeros((0, 3)), *stations]))
        if self._update_objects(terrain, areas):
            self.changes += 1

    def clearance(self, eye: Sequence[float]) -> float:
        """Return the distance (m) from an eye to the axis of the nearest bridge, inf without any."""
        return float(self._decks.query(eye)[0])

    def _update_objects(self, terrain: TerrainSource, areas: Sequence[Bounds]) -> bool:
        """Replace the meshes; return whether any has changed."""
        objects = built_objects(self._network, terrain.features.rivers)
        before, self._objects = self._objects, {}
        stays = ~_within([each.places for each in objects], areas)
        kept = {each.key for each, stay in zip(objects, stays.tolist(), strict=True) if stay} & before.keys()
        new = [each for each in objects if each.key not in kept]
        if not new and len(before) == len(objects):
            self._objects = before
            return False
        counts = np.cumsum([0, *(len(each.places) for each in new)])
        places = np.concatenate([np.zeros((0, 2)), *(each.places for each in new)])
        ground = terrain.heights(*places.T).astype(np.float64) if len(places) else np.zeros(0)
        made = {}
        for each, first, last in zip(new, counts[:-1], counts[1:], strict=True):
            own, place = ground[first:last], (self._layers, self.origin)
            key = each.key, own.tobytes(), *self._layers.items(), self.origin.tobytes()
            made[each.key] = _meshes.get_or_compute(key, partial(_blocks, each, own, *place))
        self._objects = {each.key: made.get(each.key) or before[each.key] for each in objects}
        self._upload()
        return True

    def _upload(self) -> None:
        """Upload the meshes, those of a square of `CELL` after each other, by the size of their parts."""
        groups: dict[tuple[bool, int, int, float], list[_Block]] = {}
        for block in (block for blocks in self._objects.values() for block in blocks):
            x, y = np.floor(block.low[:2] / CELL).astype(int).tolist()
            groups.setdefault((block.is_mouth, x, y, block.size), []).append(block)
        for name in ("meshes", "mouths"):
            self._drawn.pop(name, None)
            own = {key: blocks for key, blocks in groups.items() if key[0] == (name == "mouths")}
            if not own:
                continue
            blocks = [block for group in own.values() for block in group]
            base = np.cumsum([0, *(len(block.vertices) for block in blocks)])
            indices = [block.indices + first for block, first in zip(blocks, base[:-1], strict=True)]
            count = np.array([sum(len(block.indices) for block in group) for group in own.values()])
            chunks = np.zeros(len(own), _CHUNK)
            chunks["low"] = [np.min([block.low for block in group], axis=0) for group in own.values()]
            chunks["high"] = [np.max([block.high for block in group], axis=0) for group in own.values()]
            chunks["width"] = [key[-1] or max(each.extent for each in group) for key, group in own.items()]
            chunks["first"], chunks["count"] = np.cumsum(count) - count, count
            self._drawn[name] = _Drawn(
                self._context,
                self._context.buffer(np.concatenate([block.vertices for block in blocks]).tobytes()),
                self._context.buffer(np.concatenate(indices).astype(np.uint32).tobytes()),
                chunks,
            )

    def draw(
        self, camera: Camera, targets: RenderTargets, uniforms: Mapping[str, object], *, parts: int
    ) -> Iterator[None]:
        """Draw the meshes into ``targets.scene``, after what grows on the ground; yield between parts.

        What is behind the openings of tunnels is removed first.
        """
        self.triangles = 0
        context = self._context
        context.enable_only(moderngl.CULL_FACE | moderngl.DEPTH_TEST)
        if "mouths" in self._drawn and self._drawn["mouths"].select(camera, targets.size, far=False):
            targets.copy_scene()
            context.depth_func = "1"  # the shader tests
            for _ in self._draw("mouths", camera, targets.size, targets.scene, uniforms, 1):
                pass
            context.depth_func = "<"
        for name in ("meshes far", "meshes"):
            yield from self._draw(name, camera, targets.size, targets.scene, uniforms, parts)

    def _draw(
        self,
        name: str,
        camera: Camera,
        size: tuple[int, int],
        target: moderngl.Framebuffer,
        uniforms: Mapping[str, object],
        parts: int,
    ) -> Iterator[None]:
        """Draw what is in view of a picture of a size (px), near or far."""
        kind, _, far = name.partition(" ")
        drawn = self._drawn.get(kind)
        if drawn is None or not drawn.select(camera, size, far=bool(far)):
            return
        self.triangles += drawn.triangles
        array = drawn.array(name, self._program(name))
        anchor = tuple((self.origin - camera.eye).tolist())
        set_uniforms(array.program, {**uniforms, "anchor": anchor})
        for _ in bands(target, parts):
            array.render_indirect(drawn.commands, moderngl.TRIANGLES, count=drawn.count)
            yield

    def draw_shadow(self, to_map: Float64Array, place: npt.ArrayLike, radius: float) -> None:
        """Draw meshes within a radius (m) of a place into the bound shadow map.

        `to_map` maps positions relative to `origin` to clip space.
        """
        drawn = self._drawn.get("meshes")
        if drawn is None:
            return
        drawn.select_near(place, radius)
        if drawn.count:
            array = drawn.array("shadow", self._shadow)
            set_uniforms(self._shadow, {"to_map": tuple(to_map.T.astype(np.float32).ravel().tolist())})
            self._context.enable_only(moderngl.DEPTH_TEST)
            array.render_indirect(drawn.commands, moderngl.TRIANGLES, count=drawn.count)

    def _program(self, name: str) -> moderngl.Program:
        if name not in self._programs:
            files = {
                "mouths": ("built.vert.glsl", "built_mouth.frag.glsl"),
                "meshes": ("built.vert.glsl", "built.frag.glsl"),
                "meshes far": ("built.vert.glsl", "lit.frag.glsl"),
            }[name]
            defines = {**MARKS, **self._defines, "FAR": int(name.endswith("far"))}
            self._programs[name] = build_program(self._context, *files, defines=defines)
        return self._programs[name]


_CHUNK: Final = np.dtype(
    [("low", "f8", 3), ("high", "f8", 3), ("width", "f8"), ("first", "i8"), ("count", "i8")]
)
"""Box (m) of meshes that are drawn together, width (m) of the widest thing, and their range of indices."""


class _Drawn:
    """Vertices, indices, chunks, and the `count` commands that draw those in view."""

    def __init__(
        self,
        context: moderngl.Context,
        vertices: moderngl.Buffer,
        indices: moderngl.Buffer,
        chunks: StructuredArray,
    ) -> None:
        self._context, self._vertices, self._indices, self._chunks = context, vertices, indices, chunks
        self.commands = context.buffer(reserve=len(chunks) * COMMAND.itemsize, dynamic=True)
        self.arrays: dict[str, moderngl.VertexArray] = {}
        self.count = self.triangles = 0

    def array(self, name: str, program: moderngl.Program) -> moderngl.VertexArray:
        """Return the vertex array of a program."""
        if name not in self.arrays:
            self.arrays[name] = self._context.vertex_array(
                program, [(self._vertices, *_VERTEX_FORMAT)], index_buffer=self._indices, skip_errors=True
            )
        return self.arrays[name]

    def select(self, camera: Camera, size: tuple[int, int], *, far: bool) -> bool:
        """Select the near or far chunks in view; return whether there are any."""
        pixel = 2.0 * float(np.tan(np.radians(camera.fov) / 2.0)) / size[1]
        chunks = self._chunks
        outside = np.maximum(np.maximum(chunks["low"] - camera.eye, camera.eye - chunks["high"]), 0.0)
        away = np.linalg.norm(outside, axis=1)
        seen = inside_frustum(camera.frustum(size[0] / size[1]), chunks["low"], chunks["high"])
        seen &= (chunks["width"] > LEAST * pixel * away) & ((away * pixel * FAR > UNIT) == far)
        self._write(np.flatnonzero(seen))
        return self.count > 0

    def select_near(self, place: npt.ArrayLike, radius: float) -> None:
        """Select the chunks within a radius (m) of a place."""
        low, high, x = self._chunks["low"][:, :2], self._chunks["high"][:, :2], np.asarray(place)
        outside = np.maximum(np.maximum(low - x, x - high), 0.0)
        self._write(np.flatnonzero(np.hypot(*outside.T) < radius))

    def _write(self, index: npt.NDArray[np.int64]) -> None:
        commands, chunks = np.zeros(len(index), COMMAND), self._chunks[index]
        commands["first"], commands["count"], commands["instances"] = chunks["first"], chunks["count"], 1
        self.count = len(commands)
        self.triangles = int(chunks["count"].sum()) // 3
        self.commands.orphan()
        self.commands.write(commands.tobytes())


def _within(places: Sequence[Float64Array], areas: Sequence[Bounds]) -> BoolArray:
    """Return which of groups of places (n, 2) have one in one of the areas."""
    x, y = np.concatenate([np.zeros((0, 2)), *places]).T
    each_in = [(x >= w) & (x <= e) & (y >= s) & (y <= n) for w, s, e, n in areas]
    group = np.repeat(np.arange(len(places)), [len(each) for each in places])
    return np.bincount(group, np.any(each_in, axis=0) * np.ones(len(x)), len(places)) > 0


class _Block(NamedTuple):
    """Packed parts of an object that are left out at the same distance."""

    is_mouth: bool
    size: float  # as `BuiltPart.size`
    extent: float  # m, its longest side
    low: Float64Array  # (3,) m
    high: Float64Array
    vertices: npt.NDArray[np.void]
    indices: npt.NDArray[np.int64]


_meshes = LRUCache(1 << 12, max_bytes=1 << 26)  # stills have those of the moving picture


def _blocks(
    item: BuiltObject, ground: Float64Array, layers: Mapping[str, int], origin: Float64Array
) -> list[_Block]:
    """Return the parts of an object on the ground (m) packed, in as few blocks as possible."""
    groups: dict[tuple[bool, float], list[BuiltPart]] = {}
    for part in item.parts(ground):
        groups.setdefault((part.material == MOUTH, part.size), []).append(part)
    blocks = []
    for (is_mouth, size), group in groups.items():
        position = np.concatenate([part.position for part in group])
        low, high = position.min(axis=0), position.max(axis=0)
        vertices = np.zeros(len(position), _VERTEX)
        vertices["position"] = position - origin
        normal = np.concatenate([part.normal for part in group])
        tone = np.concatenate([part.tone for part in group])
        vertices["normal"] = np.rint(127.5 * np.column_stack([normal + 1.0, np.clip(tone, 0.0, 2.0)]))
        vertices["uv"] = np.concatenate([part.uv for part in group])
        counts = [len(part.position) for part in group]
        looks = []
        for part in group:
            built = BUILT.get(part.material) or _PAINTED.get(part.material)
            colour = [0.0] * 4 if built is None else [*np.sqrt(built.colour), 1.0]
            layer = layers.get(built.texture if built else part.material, 0)
            looks.append([*colour, layer, _TILES if part.material == "roof" else part.track])
        columns = np.repeat(looks, counts, axis=0)
        vertices["colour"], vertices["look"] = np.rint(255.0 * columns[:, :4]), columns[:, 4:]
        base = np.cumsum([0, *counts])
        indices = [part.triangles.ravel() + first for part, first in zip(group, base[:-1], strict=True)]
        extent = float((high - low).max())
        blocks.append(_Block(is_mouth, size, extent, low, high, vertices, np.concatenate(indices)))
    return blocks


@lru_cache(maxsize=1 << 12)
def _deck_places(road: Road) -> Float64Array:
    """Return places along the axis of a bridge (n, 3), m."""
    points = axis_points(road, 0.5)
    return points.at_distances(np.arange(points.along[0], points.along[-1], 3.0)).position
