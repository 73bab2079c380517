"""Instances scattered around the eye by hashed cells: selection, level of detail, and drawing.

A cell's points depend on the cell alone, in a sequence of which every beginning is spread evenly (Roberts
2018): a moving eye finds each point where it was, and farther cells use a shorter beginning. Positions and
instances are evaluated on the GPU: kernels/render/scatter.glsl.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import moderngl
import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array, StructuredArray
from sketchterrain.geometry.camera import Camera
from sketchterrain.render.programs import set_uniforms
from sketchterrain.render.vertex_memory import COMMAND
from sketchterrain.tiles.lod import inside_frustum

BAND: Final = 0.3  # relative range of a density over which its last points fade in; as in scatter.glsl
STEEPEST: Final = 1.5  # largest slope of the ground between an eye and nearby points
HIGHEST: Final = 1.0  # largest height of what stands in a cell, m
BEST_DISTANCE: Final = 110.0
"""Draw distance of grass at the best quality, m; all other distances scale with it."""
SEED: Final = np.dtype([("corner", "<f4", 2), ("seed", "<u4"), ("rank", "<u4")])
"""A point: its cell's corner from the eye (m), its cell's hash, and its rank in the cell's sequence."""
VECTOR: Final = 4 * 4  # bytes of a captured vec4


@dataclass(frozen=True)
class ScatterLayer:
    """Density and draw distances of one kind of scattered instances."""

    salt: int  # makes its points independent of other layers'
    density: float  # points a m², near the eye
    full_distance: float  # m up to which all points are used; beyond, the inverse distance's share
    draw_distance: float  # m
    cell_size: float  # m
    details: tuple[float, ...]  # m at which each coarser mesh takes over, nearest first

    @property
    def capacity(self) -> int:
        """Largest number of points of a cell."""
        return max(round(self.density * self.cell_size**2), 1)

    @property
    def uniform(self) -> tuple[float, float, float, float]:
        """Value of the shaders' ``scatter_layer``."""
        return float(self.capacity), self.full_distance, self.draw_distance, self.cell_size

    def scaled(self, grass: float, *, share: float) -> ScatterLayer:
        """Scale density by a share, and distances to a draw distance of grass (m)."""
        scale = grass / BEST_DISTANCE
        return replace(
            self,
            density=self.density * share,
            draw_distance=self.draw_distance * scale,
            details=tuple(scale * detail for detail in self.details),
        )


class ScatterPoints(NamedTuple):
    """Points (n,) of SEED, nearest cells first, and their number in each detail."""

    rows: StructuredArray
    counts: Int64Array


def hash32(x: npt.ArrayLike) -> npt.NDArray[np.uint32]:
    """Hash 32 bits (Wellons' lowbias32); the same in kernels/render/scatter.glsl."""
    h = np.asarray(x, dtype=np.uint32)
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B), (16, 1)):
        h = (h ^ (h >> np.uint32(shift))) * np.uint32(factor)
    return np.asarray(h, dtype=np.uint32)


def cells_within(eye: Sequence[float], distance: float, size: float) -> Int64Array:
    """Return (n, 2) columns and rows of the cells within a distance (m) of an eye, nearest first."""
    low, high = (np.floor((np.asarray(eye[:2]) + side * distance) / size) for side in (-1.0, 1.0))
    cols, rows = np.meshgrid(*(np.arange(low[k], high[k] + 1) for k in range(2)))
    cells = np.stack([cols.ravel(), rows.ravel()], axis=1).astype(np.int64)
    away = cell_distances(eye, cells, size)
    order = np.argsort(away, kind="stable")
    return cells[order[away[order] < distance]]


def cell_distances(eye: Sequence[float], cells: Int64Array, size: float) -> Float64Array:
    """Return the horizontal distance (m) of cells' nearest points from an eye."""
    outside = np.maximum(np.abs(size * (cells + 0.5) - np.asarray(eye[:2])) - 0.5 * size, 0.0)
    return np.asarray(np.hypot(outside[:, 0], outside[:, 1]))


def cells_in_frustum(
    planes: Float64Array, cells: Int64Array, size: float, eye: Sequence[float], above: float
) -> BoolArray:
    """Return which cells may be in view for slopes up to `STEEPEST`, from `above` m over the ground."""
    off = STEEPEST * (cell_distances(eye, cells, size) + 1.5 * size)
    foot = eye[2] - above
    low = np.column_stack([cells * size, foot - off])
    high = np.column_stack([(cells + 1) * size, foot + off + HIGHEST])
    return inside_frustum(planes, low, high)


def scatter_points(
    layer: ScatterLayer, cells: Int64Array, eye: Sequence[float], above: float
) -> ScatterPoints:
    """Return the points in cells (nearest first) that an eye `above` m over the ground may need."""
    away = np.hypot(cell_distances(eye, cells, layer.cell_size), above)
    share = np.minimum((1.0 + BAND) * layer.full_distance / np.maximum(away, layer.full_distance), 1.0)
    count = np.where(away < layer.draw_distance, np.ceil(layer.capacity * share), 0.0).astype(np.int64)
    detail = np.searchsorted(layer.details, away, side="right")
    counts = np.bincount(detail, count, minlength=len(layer.details) + 1).astype(np.int64)
    ends = np.cumsum(count)
    rows = np.empty(int(ends[-1]) if len(ends) else 0, SEED)
    salted = hash32(cells[:, 1].astype(np.uint32) ^ np.uint32(layer.salt))
    seeds = hash32(cells[:, 0].astype(np.uint32) ^ salted)
    rows["corner"] = np.repeat(layer.cell_size * cells - np.asarray(eye[:2]), count, axis=0)
    rows["seed"] = np.repeat(seeds, count)
    rows["rank"] = np.arange(len(rows)) - np.repeat(ends - count, count)
    return ScatterPoints(rows, counts)


class VisiblePoints:
    """The points of a layer in a view, computed again only when the view changes; `sort` orders them."""

    def __init__(
        self, layer: ScatterLayer, *, sort: Callable[[ScatterPoints], ScatterPoints] | None = None
    ) -> None:
        self._layer, self._sort = layer, sort
        self._view: tuple[Camera, float, float] | None = None
        self._points = ScatterPoints(np.zeros(0, SEED), np.zeros(len(layer.details) + 1, np.int64))

    def points(self, camera: Camera, aspect: float, above: float) -> ScatterPoints:
        """Return the points in a picture of an aspect ratio, by an eye `above` m over the ground."""
        if self._view != (camera, aspect, above):
            self._view = (camera, aspect, above)
            layer, eye = self._layer, camera.eye
            cells = cells_within(eye, layer.draw_distance, layer.cell_size)
            cells = cells[cells_in_frustum(camera.frustum(aspect), cells, layer.cell_size, eye, above)]
            points = scatter_points(layer, cells, eye, above)
            self._points = self._sort(points) if self._sort else points
        return self._points


class CoverMesh(NamedTuple):
    """Structured vertices of float32 vectors, and (m, 3) triangles."""

    vertices: StructuredArray
    triangles: npt.NDArray[np.uint32]


class ScatteredInstances:
    """Meshes of one vertex type, and the instances at the current points.

    `transform` computes the vec4s named in `captured` from ``corner`` and ``seed`` (`SEED`) into the buffer
    `instances`; `program` draws a mesh's vertices by them.
    """

    def __init__(
        self,
        context: moderngl.Context,
        meshes: Sequence[CoverMesh],
        *,
        transform: moderngl.Program,
        captured: Sequence[str],
        program: moderngl.Program,
    ) -> None:
        self._sizes = np.array([mesh.triangles.size for mesh in meshes])
        vertex_counts = np.array([len(mesh.vertices) for mesh in meshes])
        self._commands = np.zeros(len(meshes), COMMAND)
        self._commands["count"], self._commands["first"] = self._sizes, np.cumsum(self._sizes) - self._sizes
        self._commands["base_vertex"] = np.cumsum(vertex_counts) - vertex_counts
        self._transform, self._program = transform, program
        self._bytes = VECTOR * len(captured)
        self._seeds = context.buffer(reserve=SEED.itemsize, dynamic=True)
        self.instances = context.buffer(reserve=self._bytes, dynamic=True)
        self._command_buffer = context.buffer(reserve=self._commands.nbytes, dynamic=True)
        self._evaluation = context.vertex_array(transform, [(self._seeds, "2f4 2u4", "corner", "seed")])
        vertices = np.concatenate([mesh.vertices for mesh in meshes])
        triangles = np.concatenate([mesh.triangles.ravel() for mesh in meshes])
        names = vertices.dtype.names or ()
        layout = " ".join(f"{vertices.dtype[name].shape[0]}f4" for name in names)
        self._array = context.vertex_array(
            program,
            [
                (context.buffer(vertices.tobytes()), layout, *names),
                (self.instances, " ".join(["4f4"] * len(captured)) + "/i", *captured),
            ],
            index_buffer=context.buffer(triangles.tobytes()),
        )

    def evaluate(self, points: ScatterPoints, uniforms: Mapping[str, object]) -> None:
        """Compute the instances at points (at least one), in the order of their meshes."""
        count = len(points.rows)
        for buffer, size in ((self._seeds, SEED.itemsize), (self.instances, self._bytes)):
            if buffer.size < size * count:
                buffer.orphan(size * max(count, 2 * (buffer.size // size)))
        self._seeds.write(points.rows.tobytes())
        set_uniforms(self._transform, uniforms)
        self._evaluation.transform(self.instances, moderngl.POINTS, vertices=count)

    def draw(self, points: ScatterPoints, uniforms: Mapping[str, object]) -> None:
        """Draw the instances computed for points."""
        commands = self._commands.copy()
        commands["instances"] = points.counts
        commands["base_instance"] = np.cumsum(points.counts) - points.counts
        commands = commands[commands["instances"] > 0]
        self._command_buffer.write(commands.tobytes())
        set_uniforms(self._program, uniforms)
        self._array.render_indirect(self._command_buffer, moderngl.TRIANGLES, count=len(commands))

    def triangles(self, points: ScatterPoints) -> int:
        """Return the number of triangles drawn at points."""
        return int((points.counts * self._sizes).sum()) // 3


class CoverLayer(NamedTuple):
    """A layer of what lies or grows on the ground, and the uniforms of its own."""

    visible: VisiblePoints
    pool: ScatteredInstances
    uniforms: Mapping[str, object]
    contact_shadows: moderngl.VertexArray | None = None
