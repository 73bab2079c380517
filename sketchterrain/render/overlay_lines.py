"""Line overlay of features: rings and posts of point features, river centrelines, lake shores."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import moderngl
import numpy as np

from sketchterrain.features.catalogue import FEATURE_TYPES
from sketchterrain.render.programs import build_program, set_uniforms

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sketchterrain.array_types import Bounds, Float64Array
    from sketchterrain.look.waters import DistanceRaster, PlacedFeatures
    from sketchterrain.render.scene import TerrainSource

    Colour = tuple[int, int, int]

FEATURE_COLOURS: Final[dict[str, Colour]] = {
    "mountain": (230, 60, 40),
    "hill": (250, 190, 40),
    "dune": (225, 90, 220),
    "forest": (60, 200, 80),
    "river": (40, 120, 255),
    "lake": (30, 220, 240),
}
"""Colours by feature type; features that fill unpainted areas have half the opacity."""
_RING: Final = 96
_POST: Final = 0.12
"""Height of the post in the centre of a feature, in radii ..."""
_MIN_POST: Final = 4.0
"""... and at least, in m."""
_LIFT: Final = 0.004
"""Radii by which rings are lifted, otherwise ridges between two vertices hide them."""
_HIDDEN_OPACITY: Final = 0.3
"""Opacity of lines hidden by the terrain."""
_LINE: Final = np.dtype([("from", "<f4", 3), ("to", "<f4", 3), ("colour", "u1", 4)])


class FeatureLines:
    """Feature lines of a terrain, hidden ones fainter."""

    def __init__(
        self, context: moderngl.Context, terrain: TerrainSource, *, heights: HeightCache | None = None
    ) -> None:
        self._context = context
        lines = feature_lines(terrain, heights)
        self._count = len(lines[0])
        self._array: moderngl.VertexArray | None = None
        if not self._count:
            return
        start, end, colour = lines
        self._anchor = start[0].copy()
        packed = np.empty(self._count, _LINE)
        packed["from"], packed["to"], packed["colour"] = start - self._anchor, end - self._anchor, colour
        program = build_program(context, "overlay_line.vert.glsl", "overlay_line.frag.glsl")
        buffer = context.buffer(packed.tobytes())
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
    """Heights of features' rings and middles, kept while the ground under them stays as it is."""

    def __init__(self) -> None:
        self._rows: dict[bytes, tuple[Bounds, Float64Array]] = {}

    def invalidate(self, areas: Sequence[Bounds]) -> None:
        """Drop heights inside areas (W, S, E, N; m)."""
        self._rows = {
            row: (box, heights)
            for row, (box, heights) in self._rows.items()
            if not any(w <= box[2] and e >= box[0] and s <= box[3] and n >= box[1] for w, s, e, n in areas)
        }

    def at(self, terrain: TerrainSource, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return heights (m) at rows of positions (m), (rows, n), which replace the cached rows."""
        names = [place.tobytes() for place in np.concatenate([x, y], axis=1)]
        new = [number for number, name in enumerate(names) if name not in self._rows]
        heights = terrain.heights(x[new], y[new]).astype(np.float64)
        for number, row in zip(new, heights, strict=True):
            box = (x[number].min(), y[number].min(), x[number].max(), y[number].max())
            self._rows[names[number]] = box, row
        self._rows = {name: self._rows[name] for name in names}
        return np.stack([self._rows[name][1] for name in names])


def feature_lines(
    terrain: TerrainSource, heights: HeightCache | None = None
) -> tuple[Float64Array, Float64Array, npt.NDArray[np.uint8]]:
    """Return starts and ends (n, 3; m) and colours (n, 4) of the lines of all features."""
    parts = [*_rings(terrain, heights or HeightCache()), *_centrelines(terrain.features), *_shores(terrain)]
    starts = [np.zeros((0, 3)), *(part[0] for part in parts)]
    ends = [np.zeros((0, 3)), *(part[1] for part in parts)]
    colours = [np.zeros((0, 4), np.uint8), *(part[2] for part in parts)]
    return np.concatenate(starts), np.concatenate(ends), np.concatenate(colours)


_Lines = tuple["Float64Array", "Float64Array", "npt.NDArray[np.uint8]"]


def _lines_of(start: Float64Array, end: Float64Array, colour: Colour, opacity: npt.ArrayLike = 255) -> _Lines:
    start, end = (np.reshape(each, (-1, 3)) for each in (start, end))
    colours = np.empty((len(start), 4), np.uint8)
    colours[:, :3], colours[:, 3] = colour, opacity
    return start, end, colours


def _rings(terrain: TerrainSource, heights: HeightCache) -> list[_Lines]:
    points = terrain.features.points
    if not len(points):
        return []
    turn = np.arange(_RING + 1) * (2.0 * np.pi / _RING)
    radius = points["radius"].astype(np.float64)[:, None]
    x = points["x"][:, None] + radius * np.cos(turn)
    y = points["y"][:, None] + radius * np.sin(turn)
    # The last of each row is its middle.
    x, y = (np.column_stack([ring, points[axis]]) for ring, axis in ((x, "x"), (y, "y")))
    z = heights.at(terrain, x, y)
    z[:, :-1] += _LIFT * radius
    ring = np.stack([x, y, z], axis=-1)
    foot, ring = ring[:, -1], ring[:, :-1]
    head = foot + np.concatenate([np.zeros((len(points), 2)), np.maximum(_POST * radius, _MIN_POST)], axis=1)
    parts = []
    for code, name in enumerate(FEATURE_TYPES):
        of_type = points["type"] == code
        strong = np.where(points["painted"][of_type], 255, 128)
        parts.append(
            _lines_of(ring[of_type, :-1], ring[of_type, 1:], FEATURE_COLOURS[name], np.repeat(strong, _RING))
        )
        parts.append(_lines_of(foot[of_type], head[of_type], FEATURE_COLOURS[name], strong))
    return parts


def _centrelines(features: PlacedFeatures) -> list[_Lines]:
    lines = [river.centreline for river in features.rivers if len(river.centreline) > 1]
    return [_lines_of(line[:-1], line[1:], FEATURE_COLOURS["river"]) for line in lines]


def _shores(terrain: TerrainSource) -> list[_Lines]:
    return [
        _lines_of(*_shore(lake.shape, lake.level), FEATURE_COLOURS["lake"]) for lake in terrain.features.lakes
    ]


def _shore(shape: DistanceRaster, level: float) -> tuple[Float64Array, Float64Array]:
    """Return starts and ends of the sample edges between inside and outside of a shape."""
    inside = np.pad(shape.inside > 0, 1)
    starts: list[Float64Array] = []
    ends: list[Float64Array] = []
    for axis, side in ((0, (0.5, 0.0)), (1, (0.0, 0.5))):
        cut = np.argwhere(np.diff(inside.astype(np.int8), axis=axis) != 0).astype(np.float64)
        cut[:, axis] += 0.5
        row, column = (cut - 1.0).T
        for into, sign in ((starts, -1.0), (ends, 1.0)):
            x = shape.west + (column + sign * side[0]) * shape.spacing
            y = shape.south + (row + sign * side[1]) * shape.spacing
            into.append(np.stack([x, y, np.full(len(x), level)], axis=-1))
    return np.concatenate(starts), np.concatenate(ends)
