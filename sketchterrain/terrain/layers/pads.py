"""Building pads: level ground within outlines."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, StructuredArray
from sketchterrain.geometry.box_index import BoxIndex, content_items
from sketchterrain.geometry.lattice import to_lattice
from sketchterrain.io.resources import kernel_constants
from sketchterrain.roads.road_types import Pad
from sketchterrain.terrain.layers.earthworks import Strips, with_strips
from sketchterrain.terrain.layers.layer import (
    ITEMS,
    Culled,
    DetailState,
    HostSamples,
    HostSite,
    Packed,
    Sampling,
    TerrainLayer,
    WorldSettings,
)

_HEADER: Final = "layers/pads.clh"
(_HALF,) = kernel_constants(_HEADER, "PAD_HALF")
(_COVERAGE_MOST,) = kernel_constants("layers/earthworks.clh", "COVERAGE_MOST")


@dataclass(frozen=True, eq=False)
class PadsLayer(TerrainLayer):
    """Building pads, by id."""

    name: ClassVar[str] = "pads"
    varies_with_cell: ClassVar[bool] = False

    materials: tuple[str, ...]  # names, in the order of their weights
    pads: tuple[Pad, ...] = field(metadata=ITEMS)

    def _boxes(self, world: WorldSettings) -> npt.NDArray[np.int64]:
        corners = [
            np.concatenate([pad.outline.min(axis=0) - pad.reach, pad.outline.max(axis=0) + pad.reach])
            for pad in self.pads
        ]
        boxes = np.array(corners).reshape(-1, 4) / world.unit
        return np.concatenate([np.floor(boxes[:, :2]) - 2, np.ceil(boxes[:, 2:]) + 2], axis=1).astype(
            np.int64
        )

    def items(self, world: WorldSettings) -> StructuredArray:
        """Return the pads by their contents."""
        boxes = self._boxes(world)
        contents = [
            (pad.outline.tobytes(), repr((pad.id, pad.level, pad.reach, pad.works)).encode())
            for pad in self.pads
        ]
        return content_items(contents, boxes[:, :2], boxes[:, 2:])

    def pack(self, sampling: Sampling) -> Packed:
        """Return levels and outlines."""
        count, world = len(self.pads), sampling.world
        sides = np.array([len(pad.outline) for pad in self.pads], np.int64)
        form = np.zeros((count, 4), np.int32)
        form[:, 0], form[:, 1] = np.cumsum(sides) - sides, sides
        form[:, 2] = [self.materials.index(pad.works.surface) for pad in self.pads]
        row = np.array([[pad.level, pad.works.cut, pad.works.fill, pad.reach] for pad in self.pads])
        first = np.array([pad.outline[0] for pad in self.pads]).reshape(-1, 2)
        arrays: dict[str, npt.NDArray[np.generic]] = {
            "pad_at": to_lattice(first, world.extent),
            "pad_form": form,
            "pad_row": row.reshape(-1, 4),
            "pad_edge": np.concatenate([np.zeros((0, 4)), *map(_edges, self.pads)]),
        }
        return Packed(arrays, self._boxes(world), "pad")

    def omitted(self, state: DetailState, culled: Culled, sampling: Sampling) -> None:
        """Nothing is omitted; note the heights that pads bring."""
        del culled
        if not self.pads:
            return
        world = sampling.world
        index = self.cache.get_or_compute(world.extent, lambda: BoxIndex(self._boxes(world)))
        block, pad = index.touching(state.blocks)
        level = np.array([each.level for each in self.pads])[pad]
        np.minimum.at(state.low, block, level)
        np.maximum.at(state.high, block, level)

    def heights(self, ground: HostSamples, site: HostSite) -> HostSamples:
        """Return the ground with pads."""
        world, cell = site.sampling.world, site.sampling.cell
        if not self.pads:
            return ground
        boxes = self._boxes(world)
        points, numbers, distances = [], [], []
        for number, pad in enumerate(self.pads):
            west, south, east, north = boxes[number]
            inside = (site.x >= west) & (site.x <= east) & (site.y >= south) & (site.y <= north)
            near = np.flatnonzero(inside)
            corner = to_lattice(pad.outline[0], world.extent)
            offset = np.stack([site.x[near], site.y[near]], axis=1) - corner
            at: Float64Array = np.asarray(offset * world.unit, np.float64)
            distance = outline_distance(_edges(pad), at)
            own = np.maximum(distance, 0.0) < pad.reach
            points.append(near[own])
            numbers.append(np.full(int(own.sum()), number))
            distances.append(distance[own])
        order = np.argsort(np.concatenate(points), kind="stable")
        point, own_pad = (np.concatenate(each)[order] for each in (points, numbers))
        distance = np.concatenate(distances)[order]
        level, cut, fill, reach = np.array(
            [[pad.level, pad.works.cut, pad.works.fill, pad.reach] for pad in self.pads]
        )[own_pad].T
        beyond, one = np.maximum(distance, 0.0), np.ones(len(point))
        covered = np.clip(0.5 - distance / cell, 0.0, _COVERAGE_MOST)
        clear = np.clip(1.5 - 0.5 * distance, 0.0, 1.0)
        shown = np.ones(len(point), np.bool_)
        strips = Strips(
            point, level, beyond, reach, cut, fill, (beyond / _HALF) ** 2, one, one, shown, clear, covered
        )
        return with_strips(ground, strips)


def _edges(pad: Pad) -> Float64Array:
    """Return starts and vectors of an outline's edges, (n, 4), m from its first vertex."""
    start = pad.outline - pad.outline[0]
    return np.concatenate([start, np.roll(start, -1, axis=0) - start], axis=1)


def outline_distance(edges: Float64Array, at: Float64Array) -> Float64Array:
    """Return distances (m) of positions (n, 2) from an outline, negative inside."""
    nearest, inside = np.full(len(at), np.inf), np.zeros(len(at), np.bool_)
    for x, y, east, north in edges:
        px, py = at[:, 0] - x, at[:, 1] - y
        t = np.clip((px * east + py * north) / (east**2 + north**2), 0.0, 1.0)
        nearest = np.minimum(nearest, (px - t * east) ** 2 + (py - t * north) ** 2)
        is_east = px * north < py * east
        inside ^= ((py < 0.0) != (py < north)) & (is_east == (north > 0.0))
    distance = np.sqrt(nearest)
    return np.asarray(np.where(inside, -distance, distance))
