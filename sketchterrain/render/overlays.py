"""Diagnostic overlays: tile levels, errors, materials and features drawn over a picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import moderngl
import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Bounds, Float64Array
from sketchterrain.caching import LRUCache
from sketchterrain.errors import InputError
from sketchterrain.landforms.placement.feature_types import FEATURE_TYPES, ShapeField
from sketchterrain.look.objects import shore_lines, terrain_objects
from sketchterrain.render.programs import build_program, fullscreen_pass, set_uniforms
from sketchterrain.render.scene import TerrainSource, sample_heights, visible_rectangle
from sketchterrain.roads.road_types import axis_points
from sketchterrain.schema.layers import LAYERS
from sketchterrain.schema.materials import Colour
from sketchterrain.tiles.tile_pool import DrawList

if TYPE_CHECKING:
    from sketchterrain.render.ground_stream import TerrainStream


FEATURE_COLOURS: Final = {
    name: layer.overlay or layer.colour
    for name, layer in LAYERS.items()
    if layer.is_points or layer.is_water or not layer.is_painted
}
"""Colours by layer; features that fill unpainted areas have half the opacity."""
_RING: Final = 96
_POST: Final = 0.12
"""Height of the post in the centre of a feature, in radii ..."""
_MIN_POST: Final = 4.0  # ... and at least, in m
_LIFT: Final = 0.004  # radii by which rings are lifted, otherwise ridges between two vertices hide them
_AXIS_TOLERANCE: Final = 0.1  # m that lines of axes of roads are off their arcs
_AXIS_LIFT: Final = 0.3  # m above the ground
_COAST: Final = 512  # samples along a side for the coastline
_HIDDEN_OPACITY: Final = 0.3  # opacity of lines hidden by the terrain
_LINE: Final = np.dtype([("from", "<f8", 3), ("to", "<f8", 3), ("colour", "u1", 4)])
_PACKED_LINE: Final = np.dtype([("from", "<f4", 3), ("to", "<f4", 3), ("colour", "u1", 4)])


class FeatureLines:
    """Feature lines of a terrain, hidden ones fainter."""

    def __init__(self, context: moderngl.Context, terrain: TerrainSource, heights: HeightCache) -> None:
        self._context = context
        lines = feature_lines(terrain, heights)
        self._count = len(lines)
        self._array: moderngl.VertexArray | None = None
        if not self._count:
            return
        self._anchor = lines["from"][0].copy()
        lines["from"] -= self._anchor
        lines["to"] -= self._anchor
        program = build_program(context, "overlay_line.vert.glsl", "overlay_line.frag.glsl")
        buffer = context.buffer(lines.astype(_PACKED_LINE).tobytes())
        self._array = context.vertex_array(program, [(buffer, "3f4 3f4 4f1/i", "from", "to", "colour")])

    def draw(self, eye: tuple[float, float, float], size: tuple[int, int], *, width: float) -> None:
        """Draw lines `width` px wide into the bound framebuffer of `size` (px) with the terrain's depth."""
        if self._array is None:
            return
        anchor = tuple((self._anchor - np.asarray(eye)).tolist())
        for hidden in (True, False):
            self._context.enable_only(moderngl.BLEND | (0 if hidden else moderngl.DEPTH_TEST))
            set_uniforms(
                self._array.program,
                {
                    "anchor": anchor,
                    "size": size,
                    "width": width,
                    "nearer": 0.0 if hidden else 0.003,
                    "opacity": _HIDDEN_OPACITY if hidden else 1.0,
                },
            )
            self._array.render(moderngl.TRIANGLES, vertices=6, instances=self._count)


class HeightCache:
    """Terrain heights at rings and centres of features, cached while the terrain is unchanged there."""

    def __init__(self) -> None:
        self._rows = LRUCache()  # boxes and heights by positions

    def invalidate(self, areas: Sequence[Bounds]) -> None:
        """Drop heights inside areas (W, S, E, N; m)."""
        self._rows = self._rows.retained(
            row
            for row, (box, _) in self._rows.items()
            if not any(w <= box[2] and e >= box[0] and s <= box[3] and n >= box[1] for w, s, e, n in areas)
        )

    def at(self, terrain: TerrainSource, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return heights (m) at rows of positions (m), (rows, n)."""
        names = [place.tobytes() for place in np.concatenate([x, y], axis=1)]
        new = [number for number, name in enumerate(names) if name not in self._rows]
        known = {name: self._rows.get(name)[1] for name in names if name in self._rows}
        heights = terrain.heights(x[new], y[new]).astype(np.float64)
        for number, row in zip(new, heights, strict=True):
            box = (x[number].min(), y[number].min(), x[number].max(), y[number].max())
            known[names[number]] = self._rows.store(names[number], (box, row))[1]
        return np.stack([known[name] for name in names])


def feature_lines(terrain: TerrainSource, heights: HeightCache | None = None) -> npt.NDArray[np.void]:
    """Return the lines of all features: from, to (m) and colour (RGBA)."""
    parts = [np.zeros(0, _LINE), *_rings(terrain, heights or HeightCache())]
    for each in terrain_objects(terrain.features):
        lines = each.lines() if each.level is None else _coast(terrain, each.level)
        parts.append(_lines_of(*lines, FEATURE_COLOURS[each.kind]))
    return np.concatenate([*parts, *_built(terrain)])


def _built(terrain: TerrainSource) -> list[npt.NDArray[np.void]]:
    """Return the lines of the axes of roads, the outlines of pads, and what stands along lines."""
    network = terrain.features.network
    lines = [(each.layer, axis_points(each, _AXIS_TOLERANCE).position) for each in network.roads]
    lines += [
        ("pad", np.insert(np.concatenate([each.outline, each.outline[:1]]), 2, each.level, axis=1))
        for each in network.pads
    ]
    lines += [
        (each.layer, np.column_stack([each.line, terrain.heights(*each.line.T).astype(np.float64)]))
        for each in network.standing
    ]
    above = np.array([0.0, 0.0, _AXIS_LIFT])
    return [_lines_of(line[:-1] + above, line[1:] + above, FEATURE_COLOURS[name]) for name, line in lines]


def _lines_of(
    start: Float64Array, end: Float64Array, colour: Colour, opacity: npt.ArrayLike = 255
) -> npt.NDArray[np.void]:
    start = np.reshape(start, (-1, 3))
    lines = np.empty(len(start), _LINE)
    lines["from"], lines["to"] = start, np.reshape(end, (-1, 3))
    lines["colour"][:, :3], lines["colour"][:, 3] = colour, opacity
    return lines


def _rings(terrain: TerrainSource, heights: HeightCache) -> list[npt.NDArray[np.void]]:
    points = terrain.features.points
    if not len(points):
        return []
    turn = np.arange(_RING + 1) * (2.0 * np.pi / _RING)
    radius = points["radius"].astype(np.float64)[:, None]
    x = points["x"][:, None] + radius * np.cos(turn)
    y = points["y"][:, None] + radius * np.sin(turn)
    # The last column is the centre.
    x, y = (np.column_stack([ring, points[axis]]) for ring, axis in ((x, "x"), (y, "y")))
    z = heights.at(terrain, x, y)
    z[:, :-1] += _LIFT * radius
    ring = np.stack([x, y, z], axis=-1)
    foot, ring = ring[:, -1], ring[:, :-1]
    head = foot + np.concatenate([np.zeros((len(points), 2)), np.maximum(_POST * radius, _MIN_POST)], axis=1)
    parts = []
    for code, name in enumerate(FEATURE_TYPES):
        of_type = points["type"] == code
        opacity = np.where(points["painted"][of_type], 255, 128)
        parts.append(
            _lines_of(ring[of_type, :-1], ring[of_type, 1:], FEATURE_COLOURS[name], np.repeat(opacity, _RING))
        )
        parts.append(_lines_of(foot[of_type], head[of_type], FEATURE_COLOURS[name], opacity))
    return parts


def _coast(terrain: TerrainSource, level: float) -> tuple[Float64Array, Float64Array]:
    """Return starts and ends of the coastline of a sea at a level (m)."""
    west, south, east, north = visible_rectangle(terrain)
    width = max(east - west, north - south)
    ground = sample_heights(terrain, ((west + east) / 2, (south + north) / 2), width, _COAST)
    half, inside = 0.5 * ground.texel, np.where(ground.heights > level, np.float32(-1.0), np.float32(1.0))
    return shore_lines(ShapeField(ground.west + half, ground.south + half, ground.texel, inside), level)


OVERLAYS: Final = {
    "wireframe": "triangles, coloured by tile level",
    "levels": "tiles, coloured by level",
    "error": "tiles, coloured by geometric error δ (m)",
    "screen-error": "tiles, coloured by screen-space error (px)",
    "materials": "material weights of the terrain",
    "features": "rings and centre posts of features, centrelines of rivers and roads, shores",
    "triplanar": "weights of the texture planes",
}
"""Help texts by name."""

_SAMPLES: Final = 2
_LEVELS: Final = np.array(
    [
        (230, 25, 75),
        (245, 130, 48),
        (255, 225, 25),
        (60, 180, 75),
        (70, 220, 240),
        (0, 130, 200),
        (145, 30, 180),
        (240, 50, 230),
    ]
)
"""Level colours, repeating after eight levels."""
_RAMP: Final = np.array([(48, 18, 130), (40, 140, 230), (60, 220, 130), (250, 220, 60), (210, 30, 20)])
_ERROR_RANGE: Final = (0.01, 100.0)  # m; ends of the logarithmic ramp
_MAX_PIXELS: Final = 2.0  # px; end of the ramp that starts at 0
_PLANES: Final = {"across x": (255, 0, 0), "across y": (0, 255, 0), "across z": (0, 0, 255)}
_TILES, _WEIGHTS, _TRIPLANAR, _PLAIN, _RELIEF = range(5)
_OPACITY: Final = 0.8
_WIRE_OPACITY: Final = 0.65  # opacity of wires: the relief stays visible where they are dense


class LegendEntry(NamedTuple):
    """Meaning of a colour of an overlay."""

    colour: tuple[int, int, int]
    meaning: str


class Overlay:
    """Draws overlays of the tiles that `stream` drew last."""

    def __init__(self, context: moderngl.Context, terrain: TerrainSource, stream: TerrainStream) -> None:
        self._context = context
        self._terrain = terrain
        self._materials = {each.name: each.colour for each in terrain.sketch.material_table}
        self._stream = stream
        self._tint_buffer = context.buffer(reserve=16 * stream.tiles.pool.slots, dynamic=True)
        program = stream.tile_renderer.create_program("overlay.vert.glsl", "overlay.frag.glsl")
        self._tiles = stream.tile_renderer.vertex_array(program, extra=(self._tint_buffer, "tint"))
        self._blend = fullscreen_pass(context, "overlay_blend.frag.glsl")
        self._lines: FeatureLines | None = None
        self._heights = HeightCache()
        self._target: moderngl.Framebuffer | None = None

    def set_terrain(self, terrain: TerrainSource, areas: Sequence[Bounds]) -> None:
        """Draw the features of another terrain, bit-equal outside `areas` (W, S, E, N; m)."""
        self._terrain, self._lines = terrain, None
        self._heights.invalidate(areas)

    def draw(
        self,
        name: str,
        eye: tuple[float, float, float],
        framebuffer: moderngl.Framebuffer,
        *,
        samples: int = _SAMPLES,
    ) -> None:
        """Draw an overlay onto a picture with samples² samples a pixel, the frame's camera at `eye` (m)."""
        draws = self._stream.draws
        check_overlays([name])
        if draws is None or not draws.keys:
            return
        target = self._target_for(framebuffer.size, samples)
        self._tint_buffer.write(_tile_tints(name, draws).tobytes())
        self._stream.tile_renderer.set_tiles(draws, eye)
        target.use()
        target.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)
        self._context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        if name == "wireframe":
            self._draw_wires()
        elif name == "features":
            self._draw_features(eye, target, samples)
        else:
            self._draw_tiles({"materials": _WEIGHTS, "triplanar": _TRIPLANAR}.get(name, _TILES), _OPACITY)
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        framebuffer.use()
        self._colour.use(0)
        set_uniforms(self._blend.program, {"overlay": 0, "samples": samples})
        self._blend.render(vertices=3)
        self._context.enable_only(moderngl.NOTHING)
        self._context.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA

    def legend(self, name: str) -> tuple[LegendEntry, ...]:
        """Return the legend of an overlay, for the tiles of the last frame."""
        check_overlays([name])
        if name in ("wireframe", "levels"):
            levels = sorted({key.level for key in self._stream.draws.keys}) if self._stream.draws else []
            return tuple(LegendEntry(_rgb(_LEVELS[level % 8]), f"level {level}") for level in levels)
        if name == "error":
            return _ramp_entries(np.geomspace(*_ERROR_RANGE, len(_RAMP)), "m")
        if name == "screen-error":
            return _ramp_entries(np.linspace(0.0, _MAX_PIXELS, len(_RAMP)), "px")
        named = {"materials": self._materials, "triplanar": _PLANES}.get(name, FEATURE_COLOURS)
        return tuple(LegendEntry(colour, meaning) for meaning, colour in named.items())

    def _draw_tiles(self, mode: int, opacity: float) -> None:
        palette = [tuple(np.divide(colour, 255.0).tolist()) for colour in self._materials.values()]
        palette += [(0.0, 0.0, 0.0)] * (-len(palette) % 4)
        set_uniforms(self._tiles.program, {"mode": mode, "opacity": opacity, "palette": palette})
        self._stream.tile_renderer.draw(self._tiles)

    def _draw_wires(self) -> None:
        """Draw the terrain with a depth offset, then the edges of its triangles."""
        context = self._context
        context.polygon_offset = 1.0, 1.0
        self._draw_tiles(_RELIEF, _OPACITY)
        context.polygon_offset = 0.0, 0.0
        context.enable(moderngl.BLEND)
        context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        context.wireframe = True
        self._draw_tiles(_PLAIN, _WIRE_OPACITY)
        context.wireframe = False

    def _draw_features(
        self, eye: tuple[float, float, float], target: moderngl.Framebuffer, samples: int
    ) -> None:
        if self._lines is None:
            self._lines = FeatureLines(self._context, self._terrain, self._heights)
        # Depth only: nothing is shaded without a colour mask.
        target.color_mask = (False, False, False, False)
        self._draw_tiles(_PLAIN, 0.0)
        target.color_mask = (True, True, True, True)
        self._context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        self._lines.draw(eye, target.size, width=2.0 * samples)

    def _target_for(self, size: tuple[int, int], samples: int) -> moderngl.Framebuffer:
        inner = (samples * size[0], samples * size[1])
        if self._target is None or self._target.size != inner:
            self._colour = self._context.texture(inner, 4)
            self._target = self._context.framebuffer([self._colour], self._context.depth_renderbuffer(inner))
        return self._target


def check_overlays(names: Sequence[str]) -> None:
    """Raise InputError for a name that is not in ``OVERLAYS``."""
    for name in names:
        if name not in OVERLAYS:
            raise InputError(f"no overlay {name!r}; there are: {', '.join(OVERLAYS)}")


def _tile_tints(name: str, draws: DrawList) -> npt.NDArray[np.float32]:
    """Return the colours of the tiles, (n, 4)."""
    if name == "error":
        low, high = np.log(_ERROR_RANGE)
        colours = _ramp((np.log(np.maximum(draws.errors, _ERROR_RANGE[0])) - low) / (high - low))
    elif name == "screen-error":
        colours = _ramp(draws.screen_errors / _MAX_PIXELS)
    else:
        colours = _LEVELS[draws.levels % 8].astype(np.float64)
    tints = np.ones((len(colours), 4), np.float32)
    tints[:, :3] = colours / 255.0
    return tints


def _ramp(at: Float64Array) -> Float64Array:
    """Return colours, (n, 3), for positions 0 … 1 on the ramp."""
    stops = np.linspace(0.0, 1.0, len(_RAMP))
    return np.stack([np.interp(at, stops, channel) for channel in _RAMP.T], axis=-1)


def _ramp_entries(values: Float64Array, unit: str) -> tuple[LegendEntry, ...]:
    return tuple(
        LegendEntry(_rgb(colour), f"{value:g} {unit}") for value, colour in zip(values, _RAMP, strict=True)
    )


def _rgb(colour: npt.NDArray[np.int64]) -> tuple[int, int, int]:
    red, green, blue = (int(part) for part in colour)
    return red, green, blue
