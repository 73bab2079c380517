"""Ground cover: grass and stones near the eye.

Stone meshes are spheres cut by planes, as frost and falls break rock, then weathered by noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Final, NamedTuple

import moderngl
import numpy as np

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.geometry.camera import Camera
from sketchterrain.look.tree_species import unit
from sketchterrain.render.grass import grass_layers
from sketchterrain.render.programs import build_program, set_uniforms
from sketchterrain.render.quality import Quality
from sketchterrain.render.scatter import (
    CoverLayer,
    CoverMesh,
    ScatteredInstances,
    ScatterLayer,
    ScatterPoints,
    VisiblePoints,
    hash32,
)

if TYPE_CHECKING:
    from sketchterrain.render.shading import Shading


VERTEX: Final = np.dtype([("local_position", "<f4", 3), ("local_normal", "<f4", 3)])
"""Position in radii of the stone; unit normal."""


class _Shape(NamedTuple):
    """Fracture and wear parameters."""

    axes: tuple[float, float, float]  # half widths, the last upward
    cuts: int  # planes
    depth: float  # radii that they cut off at most
    edge: float  # how sharp edges are left: the power by which cuts join
    waves: float  # radii that it is rough, of the size of a third
    grain: float  # radii that it is rough, ever finer


SHAPES: Final = (
    _Shape((1.0, 0.82, 0.72), 17, 0.42, 26.0, 0.05, 0.018),  # a block
    _Shape((1.0, 0.70, 0.60), 13, 0.46, 34.0, 0.04, 0.016),  # a sharp one
    _Shape((1.0, 0.88, 0.42), 14, 0.34, 26.0, 0.04, 0.015),  # a slab
    _Shape((1.0, 0.90, 0.76), 24, 0.26, 11.0, 0.07, 0.016),  # a worn boulder
    _Shape((1.0, 0.80, 0.58), 22, 0.20, 7.0, 0.04, 0.006),  # a river's
)
DETAILS: Final = 4  # levels of detail, 0 the finest
_SPLITS: Final = (4, 3, 2, 1)  # subdivisions of an icosahedron


def rock_mesh(shape: int, detail: int) -> CoverMesh:
    """Return one of `SHAPES`; all details are samples of the same surface."""
    directions, triangles = _ball(_SPLITS[detail])
    position = directions * _radius(directions, shape)[:, None] * np.array(SHAPES[shape].axes)
    a, b, c = (position[triangles[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    normal = np.zeros_like(position)
    for k in range(3):
        np.add.at(normal, triangles[:, k], across)
    vertices = np.empty(len(position), VERTEX)
    vertices["local_position"] = position
    vertices["local_normal"] = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    return CoverMesh(vertices, triangles.astype(np.uint32))


def _radius(directions: Float64Array, shape: int) -> Float64Array:
    """Return a stone's radius in unit directions."""
    rng = np.random.default_rng([11, shape])
    form = SHAPES[shape]
    normals = unit(rng.standard_normal((form.cuts, 3)))
    away = 1.0 - form.depth * rng.uniform(0.0, 1.0, form.cuts) ** 0.7
    facing = np.maximum(directions @ normals.T, 0.0) / away
    # A power mean of how near the planes are: the nearest wins, edges are rounded off a little.
    cut = (1.0 + np.sum(facing**form.edge, axis=1)) ** (-1.0 / form.edge)
    rough = form.waves * _waves(rng, directions, 3.1)
    for octave in range(4):
        rough += form.grain * 0.62**octave * _waves(rng, directions, 6.5 * 1.9**octave)
    return np.asarray(cut * (1.0 + rough))


def _waves(rng: np.random.Generator, directions: Float64Array, frequency: float) -> Float64Array:
    """Return band-limited noise of standard deviation 1: plane waves in all directions (rad a radius)."""
    wave_vectors = unit(rng.standard_normal((9, 3))) * frequency * rng.uniform(0.7, 1.3, (9, 1))
    phases = rng.uniform(0.0, 2.0 * np.pi, 9)
    return np.asarray(np.sin(directions @ wave_vectors.T + phases).sum(axis=1) * np.sqrt(2.0 / 9.0))


@cache
def _ball(splits: int) -> tuple[Float64Array, Int64Array]:
    """Return unit vectors and counter-clockwise triangles of a subdivided icosahedron."""
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    flat = np.array([[-1, golden], [1, golden], [-1, -golden], [1, -golden]])
    zero = np.zeros((4, 1))
    points = unit(
        np.concatenate(
            [np.hstack([flat, zero]), np.hstack([zero, flat]), np.hstack([flat[:, 1:], zero, flat[:, :1]])]
        )
    )
    near = np.linalg.norm(points[:, None] - points[None], axis=-1) < 1.1
    i, j, k = np.ogrid[:12, :12, :12]
    triangles = np.argwhere((i > j) & (j > k) & near[i, j] & near[j, k] & near[k, i])
    a, b, c = (points[triangles[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]
    for _ in range(splits):
        points, triangles = _split(points, triangles)
    return points, triangles


def _split(points: Float64Array, triangles: Int64Array) -> tuple[Float64Array, Int64Array]:
    edges = np.sort(
        np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1
    )
    single, where = np.unique(edges, axis=0, return_inverse=True)
    middle = unit(points[single[:, 0]] + points[single[:, 1]])
    ab, bc, ca = (len(points) + where.reshape(3, -1)).astype(np.int64)
    a, b, c = triangles.T
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([points, middle]), np.concatenate([np.column_stack(part) for part in parts])


@dataclass(frozen=True)
class _RockLayer:
    """Stones of a range of sizes, at the best quality."""

    layer: ScatterLayer
    sizes: tuple[float, float]  # m, smallest and largest radius
    coverage: float  # share of the points that hold one on scree
    max_tilt: float  # rad


ROCK_LAYERS: Final = (
    _RockLayer(ScatterLayer(11, 7.0, 3.0, 32.0, 4.0, (0.0, 0.0, 4.0)), (0.018, 0.10), 0.9, 3.0),
    _RockLayer(ScatterLayer(22, 0.8, 9.0, 120.0, 8.0, (0.0, 9.0, 28.0)), (0.09, 0.5), 0.8, 1.2),
    _RockLayer(ScatterLayer(33, 0.012, 50.0, 480.0, 40.0, (14.0, 45.0, 130.0)), (0.42, 2.6), 0.6, 0.7),
)
"""Pebbles, stones, boulders."""
CAPTURED: Final = ("centre_radius", "spin", "ground", "kind", "hue")  # outputs of rock_place.vert.glsl


def rock_layers(
    context: moderngl.Context, *, quality: Quality, defines: Mapping[str, int | str]
) -> Iterator[CoverLayer]:
    """Yield the stones around an eye, which share meshes and programs."""
    pool = ScatteredInstances(
        context,
        [rock_mesh(shape, detail) for detail in range(DETAILS) for shape in range(len(SHAPES))],
        transform=build_program(context, "rock_place.vert.glsl", captured=CAPTURED, defines=defines),
        captured=CAPTURED,
        program=build_program(context, "rock.vert.glsl", "rock.frag.glsl", defines=defines),
    )
    shade = build_program(context, "rock_shade.vert.glsl", "rock_shade.frag.glsl", defines=defines)
    content = (pool.instances, "4f4 16x 4f4 4f4 16x/i", "centre_radius", "ground", "kind")
    contact_shadows = context.vertex_array(shade, [content])
    for rocks in ROCK_LAYERS:
        layer = rocks.layer.scaled(quality.grass_distance, share=quality.ground_cover_density)
        own = {
            "scatter_layer": layer.uniform,
            "sizes": (*rocks.sizes, rocks.coverage),
            "max_tilt": rocks.max_tilt,
        }
        yield CoverLayer(VisiblePoints(layer, sort=sorted_by_mesh), pool, own, contact_shadows)


def sorted_by_mesh(points: ScatterPoints) -> ScatterPoints:
    """Sort points by detail and shape, which a point's hash selects: counts are (details · shapes,)."""
    rows = points.rows
    detail = np.repeat(np.arange(len(points.counts)), points.counts)
    shape = hash32(rows["seed"] ^ hash32(rows["rank"])).astype(np.int64) % len(SHAPES)
    mesh = detail * len(SHAPES) + shape
    counts: Int64Array = np.bincount(mesh, minlength=DETAILS * len(SHAPES)).astype(np.int64)
    return ScatterPoints(rows[np.argsort(mesh, kind="stable")], counts)


class GroundCover:
    """Stones and grass on the displayed ground around an eye; false if the quality asks for none.

    `triangles` are those of the last frame. `appearance` are macros of `AppearanceTextures`: crops have its
    colours, fields no stones.
    """

    def __init__(
        self,
        context: moderngl.Context,
        *,
        quality: Quality,
        shading: Shading,
        appearance: Mapping[str, int | str],
    ) -> None:
        self.triangles = 0
        self._context, self._shading = context, shading
        self.layers: list[CoverLayer] = []
        for part, layers in (("rocks", rock_layers), ("grass", grass_layers)):
            if quality.grass_distance > 0.0 and quality.includes(part):
                self.layers += layers(context, quality=quality, defines={**shading.defines, **appearance})

    def __bool__(self) -> bool:
        return bool(self.layers)

    def draw(
        self, camera: Camera, size: tuple[int, int], uniforms: Mapping[str, object], *, above: float
    ) -> Iterator[None]:
        """Draw for an eye `above` m over the ground, layer by layer.

        `uniforms` are those of all passes: textures, `clock`, `wind`, and the map of the displayed ground.
        ``scene`` and ``scene_depth`` hold the bare ground.
        """
        self.triangles, uniforms = 0, {**uniforms, **self._shading.tints}
        for layer in self.layers:
            points = layer.visible.points(camera, size[0] / size[1], above)
            if len(points.rows):
                layer.pool.evaluate(points, {**uniforms, **layer.uniforms})
                if layer.contact_shadows:
                    self._draw_contact_shadows(layer.contact_shadows, len(points.rows), uniforms)
                culled = moderngl.CULL_FACE if layer.contact_shadows else 0
                self._context.enable_only(moderngl.DEPTH_TEST | culled)
                layer.pool.draw(points, uniforms)
                self._context.enable_only(moderngl.DEPTH_TEST)
                self.triangles += layer.pool.triangles(points)
                yield

    def _draw_contact_shadows(
        self, array: moderngl.VertexArray, count: int, uniforms: Mapping[str, object]
    ) -> None:
        context = self._context
        context.enable_only(moderngl.DEPTH_TEST | moderngl.BLEND)
        context.blend_func = moderngl.DST_COLOR, moderngl.ZERO
        context.fbo.depth_mask = False
        set_uniforms(array.program, uniforms)
        array.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=count)
        context.fbo.depth_mask = True
        context.blend_func = moderngl.SRC_ALPHA, moderngl.ONE_MINUS_SRC_ALPHA
