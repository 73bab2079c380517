"""Roads, pads and walls as vector layers, as splines of engines, and masks of the ground that they cover."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import shapely

from sketchterrain.array_types import BoolArray, Float64Array, UInt8Array
from sketchterrain.export.engines import EngineAxes, rounded_list, tile_path, tile_samples, write_water_json
from sketchterrain.export.files import write_json, write_values_png
from sketchterrain.export.sampled import SampleGrid, row_bands
from sketchterrain.export.target import Export
from sketchterrain.export.vectors import ExportLayer, Origin, id_texts
from sketchterrain.roads.road_types import (
    BRIDGE,
    GROUND,
    STRUCTURES,
    TUNNEL,
    AxisPoints,
    Road,
    RoadNetwork,
    axis_points,
    grades,
)
from sketchterrain.schema.layers import LAYERS, STANDING_LAYERS, WAY_LAYERS

TOLERANCE: Final = 0.05
"""Largest deviation (m) of exported lines from the arcs and vertical curves of roads."""

_MASK_TOLERANCE: Final = 0.05  # of a sample's cell
MASKS: Final = {
    "carriageway": "roads, railways and paths on the ground: 255 is all of a sample's cell",
    "built": "the same with shoulders and building pads",
}
"""Descriptions of the masks by name."""


def road_layers(network: RoadNetwork, origin: Origin) -> list[ExportLayer]:
    """Return the layers that are not empty: axes of each kind, edges, bridges, tunnels, pads, walls."""
    roads, pads = network.roads, network.pads
    points = [axis_points(road, TOLERANCE) for road in roads]
    fields = _columns(roads, **_ROAD_FIELDS)
    kinds, structures = (np.array([getattr(road, name) for road in roads]) for name in ("layer", "structure"))

    def moved(make: Callable[..., Any], places: Iterable[Float64Array]) -> npt.NDArray[np.object_]:
        return np.array([make(np.add(place, (*origin, 0.0)[: place.shape[1]])) for place in places], object)

    axes = moved(shapely.linestrings, (at.position for at in points))
    edges = moved(shapely.linestrings, (at.beside(side * at.half_width) for at in points for side in (1, -1)))
    decks = moved(shapely.polygons, (strip_outline(at, at.half_width + at.shoulder) for at in points))
    areas = moved(shapely.polygons, (np.insert(pad.outline, 2, pad.level, axis=1) for pad in pads))

    def chosen(name: str, kind: str, shapes: npt.NDArray[np.object_], own: BoolArray) -> ExportLayer:
        return ExportLayer(name, kind, shapes[own], {key: values[own] for key, values in fields.items()})

    sides = {"id": np.repeat(fields["id"], 2), "side": np.array(["left", "right"] * len(roads), object)}
    layers = [
        *(chosen(LAYERS[way].title.lower(), "LineString Z", axes, kinds == way) for way in WAY_LAYERS),
        ExportLayer("road_edges", "LineString Z", edges, sides),
        chosen("bridge_decks", "Polygon Z", decks, structures == BRIDGE),
        chosen("tunnels", "LineString Z", axes, structures == TUNNEL),
        ExportLayer("pads", "Polygon Z", areas, _columns(pads, **_PAD_FIELDS)),
    ]
    for name in STANDING_LAYERS:
        lines = [each for each in network.standing if each.layer == name]
        shapes = moved(shapely.linestrings, (each.line for each in lines))
        getters = {key: lambda each, key=key: each.values[key] for key in LAYERS[name].parameters}
        layers.append(ExportLayer(f"{name}s", "LineString", shapes, _columns(lines, **getters)))
    return [layer for layer in layers if len(layer.geometry)]


# Named as the properties of layers where they have these.
_ROAD_FIELDS: Final[dict[str, Callable[[Road], Any]]] = {
    "leg": lambda road: str(road.leg),
    "part": lambda road: road.part,
    "structure": lambda road: STRUCTURES[road.structure],
    "surface": lambda road: road.works.surface,
    "length": lambda road: road.along[-1] - road.along[0],
    "width": lambda road: 2.0 * float(road.half_width.mean()),
    "shoulder": lambda road: float(road.shoulder.mean()),
    "steepest": lambda road: float(np.abs(grades(road)).max()),
    "cut": lambda road: road.works.cut,
    "fill": lambda road: road.works.fill,
    "trees": lambda road: road.trees,
}
_PAD_FIELDS: Final = {name: attrgetter(name) for name in ("level", "building")}


def _columns(items: Sequence[Any], **fields: Callable[[Any], Any]) -> dict[str, npt.NDArray[Any]]:
    columns = {name: np.array([value(item) for item in items]) for name, value in fields.items()}
    texts = {name: values.astype(object) for name, values in columns.items() if values.dtype.kind == "U"}
    return {"id": id_texts(item.id for item in items), **columns, **texts}


def write_corridors(export: Export, axes: EngineAxes, *, splat: bool = False) -> dict[Path, str]:
    """Write waters, and roads as splines and as masks, if any; return the files with their descriptions."""
    files = write_water_json(export, axes) | write_road_masks(export, splat=splat)
    network = export.terrain.features.network
    if network.roads:
        path = export.folder / f"{export.name}_roads.json"
        write_json(path, road_content(network, axes))
        files[path] = f"roads, railways and paths as splines, {axes.title}"
    return files


def road_content(network: RoadNetwork, axes: EngineAxes) -> dict[str, Any]:
    """Return all roads in the program's coordinates and unit, each as the control points of a spline.

    Bank is in degrees, positive where the left edge is higher. Straight lines between the points deviate by
    at most `TOLERANCE` from the road.
    """

    def entry(road: Road) -> dict[str, Any]:
        at = axis_points(road, TOLERANCE)
        bank = np.degrees(np.arctan(0.5 * (at.crossfall[:, 0] - at.crossfall[:, 1])))
        return {
            "id": road.id,
            "type": road.layer,
            "leg": str(road.leg),
            "part": road.part,
            "structure": STRUCTURES[road.structure],
            "surface": road.works.surface,
            "points": rounded_list(axes.points(*at.position.T)),
            "width": rounded_list(2.0 * at.half_width * axes.per_metre),
            "shoulder": rounded_list(at.shoulder * axes.per_metre),
            "bank": rounded_list(bank),
        }

    return {"format": 1, "axes": axes.metadata, "roads": [entry(road) for road in network.roads]}


def write_road_masks(export: Export, *, splat: bool = False) -> dict[Path, str]:
    """Write masks of built ground of each tile as 8-bit grey images; return the files with descriptions.

    `splat` leaves out one row and column, as Unity's control textures do.
    """
    files: dict[Path, str] = {}
    for kind, outlines in built_ground(export.terrain.features.network, export.grid).items():
        for tile, samples in tile_samples(export):
            grid = samples.grid
            if splat:
                grid = replace(grid, columns=grid.columns - 1, rows=grid.rows - 1)
            path = tile_path(export, kind, tile, ".png")
            files[write_values_png(path, coverage(outlines, grid))] = MASKS[kind]
    return files


def built_ground(network: RoadNetwork, grid: SampleGrid) -> dict[str, list[Float64Array]]:
    """Return the borders of areas on the ground for each of `MASKS`, as exact as a grid can show."""
    tolerance = _MASK_TOLERANCE * min(grid.spacing)
    roads = [axis_points(road, tolerance) for road in network.roads if road.structure == GROUND]
    outlines = {
        "carriageway": [ring for road in roads for ring in _strip_areas(road, road.half_width)],
        "built": [ring for road in roads for ring in _strip_areas(road, road.half_width + road.shoulder)]
        + [pad.outline[::-1] for pad in network.pads],
    }
    return {kind: found for kind, found in outlines.items() if found}


def strip_outline(points: AxisPoints, half_width: Float64Array) -> Float64Array:
    """Return the border (n, 3; m) of a strip along a road, clockwise."""
    return np.concatenate([points.beside(half_width), points.beside(-half_width)[::-1]])


def _strip_areas(points: AxisPoints, half_width: Float64Array) -> list[Float64Array]:
    """Return a strip along a road as an area (n, 2; m), or as triangles where its inner edge turns back."""
    outline = strip_outline(points, half_width)[:, :2]
    left, right = outline[: len(half_width)], outline[: len(half_width) - 1 : -1]
    ahead = np.diff(points.position[:, :2], axis=0)
    if all((np.diff(edge, axis=0) * ahead).sum(axis=1).min() > 0.0 for edge in (left, right)):
        return [outline]
    halves = ((left[:-1], left[1:], right[1:]), (left[:-1], right[1:], right[:-1]))
    triangles = np.concatenate([np.stack(half, axis=1) for half in halves])
    (ax, ay), (bx, by) = (triangles[:, k].T - triangles[:, 0].T for k in (1, 2))
    counter = ax * by > ay * bx
    triangles[counter] = triangles[counter, ::-1]
    return list(triangles)


def coverage(outlines: Sequence[Float64Array], grid: SampleGrid) -> UInt8Array:
    """Return the share of each sample's cell that areas cover, 0 … 255.

    Borders (n, 2; m) are clockwise. Areas are exact; where several overlap inside of one cell, their shares
    are added. Each edge adds the area between it and the right edge of its cell; a sum along the row fills
    the cells to the right (signed-area accumulation, as in Levien's font-rs).
    """
    dx, dy = grid.spacing
    rows, columns = grid.rows, grid.columns
    corner, step = np.array([grid.west - 0.5 * dx, grid.north + 0.5 * dy]), np.array([dx, -dy])
    rings = [(ring - corner) / step for ring in outlines]
    size = (columns, rows)
    rings = [ring for ring in rings if (ring.max(axis=0) > 0.0).all() and (ring.min(axis=0) < size).all()]
    total = np.zeros((rows, columns + 1), np.float32)
    if rings:
        start = np.concatenate(rings)
        end = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
        _add_edges(total, start, end)
    mask = np.empty((rows, columns), np.uint8)
    for band in row_bands(rows):
        share = np.cumsum(total[band, :columns], axis=1)
        mask[band] = np.rint(255.0 * np.clip(share, 0.0, 1.0))
    return mask


def _add_edges(total: np.ndarray, start: Float64Array, end: Float64Array) -> None:
    """Add edges (n, 2; in cells: column, row) to sums, after cutting them at the borders of cells."""
    rows, columns = total.shape[0], total.shape[1] - 1
    edges, shares = [np.arange(len(start))], [np.zeros(len(start))]
    for axis in (0, 1):
        low, high = np.minimum(start[:, axis], end[:, axis]), np.maximum(start[:, axis], end[:, axis])
        count = np.maximum(np.ceil(high) - np.floor(low) - 1.0, 0.0).astype(np.intp)
        edge = np.repeat(np.arange(len(start)), count)
        border = np.floor(low)[edge] + 1.0 + np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
        edges.append(edge)
        shares.append((border - start[edge, axis]) / (end - start)[edge, axis])
    edge, share = np.concatenate(edges), np.concatenate(shares)
    order = np.lexsort((share, edge))
    edge, share = edge[order], share[order]
    following = np.append(np.where(edge[1:] == edge[:-1], share[1:], 1.0), 1.0)
    along = (end - start)[edge]
    middle = start[edge] + (0.5 * (share + following))[:, None] * along
    height = (following - share) * along[:, 1]
    x = np.maximum(middle[:, 0], 0.0)
    inside = (x < columns) & (middle[:, 1] >= 0.0) & (middle[:, 1] < rows)
    x, row, height = x[inside], middle[inside, 1].astype(np.intp), height[inside]
    cell = row * (columns + 1) + x.astype(np.intp)
    part = x - np.floor(x)
    np.add.at(total.reshape(-1), cell, (-height * (1.0 - part)).astype(np.float32))
    np.add.at(total.reshape(-1), cell + 1, (-height * part).astype(np.float32))
