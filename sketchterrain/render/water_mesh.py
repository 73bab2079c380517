"""Meshes of waters: a disc for the sea; rivers and lakes in chunks with levels of detail."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float32Array, Float64Array
from sketchterrain.look.objects import ACROSS, SEA, quads
from sketchterrain.render.vertex_memory import COMMAND
from sketchterrain.tiles.lod import inside_frustum

if TYPE_CHECKING:
    from sketchterrain.look.objects import WaterSurface
    from sketchterrain.render.camera import Camera

ATTRIBUTES: Final = (
    ("3f4", "local_position"),
    ("4f4", "flow_frame"),
    ("2f4", "shore"),
    ("4f4", "stream_params"),
)
NEAREST_RING: Final = 1e-4  # radius of the innermost ring of the sea in draw distances
RINGS, SECTORS = 60, 96
STATIONS: Final = 32  # stations of a river along a chunk
LEVELS: Final = ((1, 1), (2, 2), (4, 4), (8, 4), (16, 4), (32, 4))
"""Vertices along and across from one drawn vertex to the next, by level of detail."""
LONGEST: Final = 0.25  # length of a quad in distances from the eye: attributes aren't linear in perspective


@dataclass(frozen=True)
class WaterChunks:
    """Inland waters in chunks, and ranges of one index buffer by their levels of detail.

    The corners are (chunks, 3), all others (chunks, levels).
    """

    low: Float64Array  # corners of bounding boxes, m
    high: Float64Array
    error: Float64Array  # largest deviation from the finest level, m
    length: Float64Array  # longest quad, m
    first: npt.NDArray[np.uint32]  # index
    count: npt.NDArray[np.uint32]  # of indices

    def commands(self, camera: Camera, aspect: float, tolerance: float) -> npt.NDArray[np.void]:
        """Return draw commands of the chunks in view, deviating by `tolerance` m per metre of distance."""
        visible = np.flatnonzero(inside_frustum(camera.frustum(aspect), self.low, self.high))
        outside = np.maximum(self.low[visible] - camera.eye, camera.eye - self.high[visible])
        away = np.linalg.norm(np.maximum(outside, 0.0), axis=1)[:, None]
        fits = (self.error[visible] <= tolerance * away) & (self.length[visible] <= LONGEST * away)
        level = np.logical_and.accumulate(fits[:, 1:], axis=1).sum(axis=1)
        commands = np.zeros(len(visible), COMMAND)
        commands["first"], commands["count"] = self.first[visible, level], self.count[visible, level]
        commands["instances"] = 1
        return commands


def inland_mesh(
    meshes: Sequence[WaterSurface],
) -> tuple[Float32Array, npt.NDArray[np.uint32], WaterChunks]:
    """Return vertices of `ATTRIBUTES`, relative to the first vertex, indices, and their chunks."""
    anchor, vertices, indices, chunks = meshes[0].position[0], [], [], []
    base = first = 0
    for mesh in meshes:
        bank = np.full(len(mesh.position), max(-mesh.shore_distance.min(), 0.0))
        shore = np.column_stack([mesh.shore_distance, bank])
        vertices.append(np.column_stack([mesh.position - anchor, mesh.flow, shore, mesh.stream]))
        is_river = mesh.stream[0, 3] > 0.0
        chunks.append(_river_chunks(mesh) if is_river else _chunks(mesh.position[None]))
        for level, own in enumerate(_strip_indices(mesh) if is_river else [mesh.triangles[None]]):
            chunks[-1].first[:, level] = first + np.arange(len(own)) * own.shape[1]
            chunks[-1].count[:, level] = own.shape[1]
            indices.append((own + base).astype(np.uint32).ravel())
            first += own.size
        base += len(mesh.position)
    joined = {
        name: np.concatenate([getattr(each, name) for each in chunks])
        for name in WaterChunks.__dataclass_fields__
    }
    return np.concatenate(vertices).astype(np.float32), np.concatenate(indices), WaterChunks(**joined)


def _stations(mesh: WaterSurface) -> npt.NDArray[np.intp]:
    """Return the (chunks, STATIONS + 1) stations of a river; the last one is repeated."""
    last = len(mesh.position) // ACROSS - 1
    first = np.arange(0, last, STATIONS)
    return np.asarray(np.minimum(first[:, None] + np.arange(STATIONS + 1), last))


def _strip_indices(mesh: WaterSurface) -> list[npt.NDArray[np.uint32]]:
    """Return the (chunks, k) indices of a river by level of detail."""
    stations = _stations(mesh)
    vertices = (
        (stations[:, :, None] * ACROSS + np.arange(ACROSS)).astype(np.uint32).reshape(len(stations), -1)
    )
    places = np.arange((STATIONS + 1) * ACROSS, dtype=np.uint32).reshape(-1, ACROSS)
    return [vertices[:, quads(places[::along, ::across]).ravel()] for along, across in LEVELS]


def _river_chunks(mesh: WaterSurface) -> WaterChunks:
    """Return the chunks of a river without their indices."""
    stations = _stations(mesh)
    half = mesh.stream[:, 3]
    values = np.column_stack([mesh.position, mesh.shore_distance, mesh.stream[:, 2] * half])
    values = values.reshape(-1, ACROSS, 5)[stations]
    along = mesh.flow[::ACROSS, 1][stations]
    chunks = _chunks(values[..., :3].reshape(len(stations), -1, 3))
    for level, (step, _) in enumerate(LEVELS):
        chunks.length[:, level] = np.diff(along[:, ::step], axis=1).max(axis=1)
        before = np.arange(STATIONS) // step * step
        start, end = along[:, before], along[:, before + step]
        share = (along[:, :-1] - start) / np.maximum(end - start, 1e-9)
        kept = values[:, before] + share[..., None, None] * (values[:, before + step] - values[:, before])
        chunks.error[:, level] = np.linalg.norm(values[:, :-1] - kept, axis=-1).max(axis=(1, 2))
    return chunks


def _chunks(position: Float64Array) -> WaterChunks:
    """Return chunks of (n, k, 3) vertices (m) that have one level of detail, without indices."""
    shape = len(position), len(LEVELS)
    return WaterChunks(
        position.min(axis=1),
        position.max(axis=1),
        error=np.full(shape, np.inf),
        length=np.zeros(shape),
        first=np.zeros(shape, np.uint32),
        count=np.zeros(shape, np.uint32),
    )


def sea_mesh() -> tuple[Float32Array, npt.NDArray[np.uint32]]:
    """Return vertices of `ATTRIBUTES` and indices of a disc of radius 1, in rings that widen outward."""
    radius = np.concatenate([[0.0], np.geomspace(NEAREST_RING, 1.0, RINGS)])
    angle = np.linspace(0.0, 2.0 * np.pi, SECTORS + 1)
    vertices = np.zeros((len(radius), len(angle), 13), np.float32)
    vertices[..., 0], vertices[..., 1] = radius[:, None] * np.cos(angle), radius[:, None] * np.sin(angle)
    vertices[..., 6], vertices[..., 11], vertices[..., 12] = 1.0, 1.0, SEA
    index = np.arange(vertices[..., 0].size, dtype=np.uint32).reshape(vertices.shape[:2]).T
    return vertices.reshape(-1, 13), quads(index).ravel()
