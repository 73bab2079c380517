"""Sketches of vector maps: waters, roads, buildings and land use as vectors, the rest rasterised."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from rasterio.crs import CRS
from rasterio.features import rasterize

from sketchterrain.array_types import BoolArray, Int64Array
from sketchterrain.document.label_layers import MAX_LABELS, MAX_SIDE, LabelImage
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError, did_you_mean, first_few, format_value, one_line
from sketchterrain.features.files import reproject, valid_areas
from sketchterrain.features.table import (
    AREA,
    KINDS,
    LINE,
    MAX_FEATURE_VERTICES,
    POINT,
    STEP,
    FeatureTable,
    Shapes,
    property_columns,
    single_parts,
)
from sketchterrain.importing.legend import (
    FeatureLabel,
    cluster_properties,
    feature_label,
    label_properties,
    parse_number,
    relevant_tags,
)
from sketchterrain.importing.traced_layers import TraceResult
from sketchterrain.importing.vector_files import (
    Box,
    SketchArea,
    SourceLayer,
    mean_longitude,
    metric_crs_at,
    read_vector_layers,
    sketch_area,
    to_longitude_latitude,
)
from sketchterrain.io.crs import crs_text, parse_crs, parse_metric_crs
from sketchterrain.schema.layers import LAYERS, PAINTED_LAYERS, VECTOR_LAYERS, WAY_LAYERS
from sketchterrain.schema.parameters import Properties, Value

_SIZE = 512  # px
_MARGIN = 0.5  # of the bounds' size, around them: wide lines there extend into them
_NO_AREAS = ("summits", "course", "way", "standing")  # kinds of layers whose closed lines are no areas
_JOINED = ("course", "way")  # kinds of layers whose lines are networks
_BORDER = 100.0  # m around a sketch, where its vectors end
_ON_ELEVATION = ("forest", "material")  # layers that are painted on real elevation: others change its heights
_MAX_WIDTH = 1e6  # m
_DEFAULT_WIDTH = 0.04  # of the longer side: lines and discs on layers of areas
_SIMPLIFICATION = 1 / 16  # px, tolerance for wide lines
_UNKNOWN = "without a known layer"
_JOIN = 1.5 * STEP  # m, distance of an end on a line from it after both were rounded


class _Features(NamedTuple):
    shapes: Shapes
    labels: npt.NDArray[np.object_]  # `FeatureLabel`
    widths: npt.NDArray[np.float64]  # m, NaN if unknown

    def where(self, mask: BoolArray | Int64Array) -> _Features:
        """Return the features of a mask, or in some order."""
        return _Features(self.shapes[mask], self.labels[mask], self.widths[mask])

    @property
    def kinds(self) -> npt.NDArray[np.int32]:
        """Return POINT, LINE or AREA of each."""
        return np.asarray(shapely.get_dimensions(self.shapes), dtype=np.int32)

    @property
    def names(self) -> npt.NDArray[np.str_]:
        """Return the layer of each."""
        return np.array([label.layer for label in self.labels], dtype=np.str_)

    @property
    def are_vectors(self) -> BoolArray:
        """Return whether each stays a vector."""
        return np.isin(self.names, VECTOR_LAYERS)


def sketch_from_vectors(
    path: Path,
    *,
    layer: str | None = None,
    width: float | None = None,
    bounds: Box | None = None,
    crs: str | None = None,
    size_px: int = _SIZE,
    name: str | None = None,
) -> TraceResult:
    """Return a sketch of a vector file: waters, what is built and land use as vectors, the rest painted.

    It has `size_px` along the longer side. `layer` and `width` (m, of lines) are defaults for features
    without one; `bounds` are west, south, east, north in the file's coordinates (None: all features); `crs`
    is metric (None: the file's if undistorted, else UTM).
    Raise `InputError` for invalid options or files, or without any usable feature.
    """
    _check(layer, width, bounds, size_px)
    target = None if crs is None else parse_metric_crs(crs)
    layers = read_vector_layers(path, untagged=layer is not None)
    skipped: Counter[str] = sum((source.skipped for source in layers), Counter())
    try:
        source, features = _collect(layers, layer, width, skipped)
        box, features = _clip(features, source, bounds, skipped)
        latitude: float | None = None
        if source is not None:
            middle = (0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3]))
            latitude = round(float(to_longitude_latitude(source, np.array([middle]))[0, 1]), 2)
            target = target or metric_crs_at(source, middle)
            features = features._replace(shapes=_reprojected(features.shapes, source, target))
            if bounds is not None:
                step = 0.05 * max(box[2] - box[0], box[3] - box[1])
                outline = shapely.segmentize(shapely.box(*box), step)
                box = shapely.bounds(_reprojected(outline, source, target)).tolist()
        elif target is not None:
            raise InputError("it has no coordinate reference system: expected no crs to transform it to")
        area = sketch_area(_bounds(features) if bounds is None else box, size_px, exact=bounds is not None)
        content = _content(features, area, width, skipped)
    except (InputError, shapely.errors.GEOSException) as error:
        raise InputError(f"{one_line(path)}: {one_line(error)}") from None
    sketch = Sketch(
        name=one_line(path.stem)[:200] if name is None else name,
        extent=area.extent,
        weather={} if latitude is None else {"latitude": latitude},
        frame={"crs": crs_text(target), "east": area.west, "north": area.south},
        layers=content.images,
        vectors=content.vectors,
        labels=content.labels,
    )
    notes = [*content.notes, *_reading_notes(layers, skipped)]
    notes.append(f"{sketch.width_px}×{sketch.height_px} px, {sketch.pixel_size:.4g} m each")
    return TraceResult(sketch, (*notes, _position_note(sketch.frame)))


def with_vectors_of(sketch: Sketch, path: Path) -> tuple[Sketch, tuple[str, ...]]:
    """Return a sketch on real elevation with the features of a vector file that lie in it, and notes.

    Ways, walls, buildings, land use, rivers and lakes are vectors up to 100 m around it, and materials are
    painted; what would change heights is left out. Raise `InputError` if the file cannot be read, or has
    nothing inside.
    """
    target = parse_metric_crs(sketch.frame["crs"]) if sketch.frame["crs"] else None
    west, south = sketch.frame["east"], sketch.frame["north"]
    area = SketchArea(west, south, sketch.pixel_size, sketch.width_px, sketch.height_px)
    around = shapely.box(west, south, *np.add((west, south), sketch.size)).buffer(_BORDER, join_style="mitre")
    outline = shapely.segmentize(around, 0.05 * around.length)
    degrees = None
    if target is not None:
        degrees = tuple(shapely.bounds(_reprojected(outline, target, parse_crs("OGC:CRS84"))).tolist())
    layers = read_vector_layers(path, untagged=False, degrees=degrees)
    skipped: Counter[str] = sum((source.skipped for source in layers), Counter())
    try:
        source, features = _collect(layers, None, None, skipped)
        if (source is None) != (target is None):
            raise InputError("expected a CRS of both the file and the elevation, or of neither")
        kept = features.are_vectors | np.isin(features.names, _ON_ELEVATION)
        skipped["that the elevation already has"] += int((~kept).sum())
        features = features.where(kept)
        if source is not None and target is not None:
            box = shapely.bounds(_reprojected(outline, target, source)).tolist()
            _, features = _clip(features, source, box, skipped)
            features = features._replace(shapes=_reprojected(features.shapes, source, target))
        features = _inside(features, around.bounds, skipped)
        content = _content(features, area, None, skipped)
    except (InputError, shapely.errors.GEOSException) as error:
        raise InputError(f"{one_line(path)}: {one_line(error)}") from None
    sketch = sketch.replace(
        layers={**sketch.layers, **content.images},
        vectors={**sketch.vectors, **content.vectors},
        labels={**sketch.labels, **{key: each for key, each in content.labels.items() if each}},
    )
    return sketch, (*content.notes, *_reading_notes(layers, skipped))


class _Content(NamedTuple):
    """What a sketch gets of features, and notes on them."""

    images: dict[str, LabelImage]
    vectors: dict[str, FeatureTable]
    labels: dict[tuple[str, int], dict[str, Value]]
    notes: list[str]


def _content(features: _Features, area: SketchArea, width: float | None, skipped: Counter[str]) -> _Content:
    """Return what features (m) become in a sketch's area; raise `InputError` if none is visible."""
    pixels = features._replace(shapes=shapely.transform(features.shapes, area.pixels))
    visible = _visible(pixels, area, skipped)
    drawn = _on_grid(features.where(visible & features.are_vectors), area, skipped)
    painted = pixels.where(visible & ~features.are_vectors)
    if not len(drawn.shapes) + len(painted.shapes):
        raise InputError(f"no visible features ({_skipped(skipped)})")
    images, labels, merged = _paint(painted, area, width)
    vectors = _vector_layers(drawn, width)
    for name, layer in vectors.items():
        labels |= {(name, label): _label(name, label, width) for label in {1, *layer.labels.tolist()}}
    return _Content(
        images, vectors, labels, [_used(drawn, painted), *merged, *_guess_notes(drawn, painted, area, width)]
    )


def _reading_notes(layers: Sequence[SourceLayer], skipped: Counter[str]) -> list[str]:
    repaired = sum(each.repaired for each in layers)
    notes = [f"areas that cross themselves ({repaired}): repaired"] if repaired else []
    notes += [note for each in layers for note in each.notes]
    return notes + ([f"skipped: {_skipped(skipped)}"] if +skipped else [])


def _check(layer: str | None, width: float | None, bounds: Box | None, size_px: int) -> None:
    if layer is not None and layer not in LAYERS:
        near = did_you_mean(layer, LAYERS)
        raise InputError(f"unknown layer {format_value(layer)}: expected {', '.join(LAYERS)}{near}")
    if width is not None and not (math.isfinite(width) and width >= 0.0):
        raise InputError(f"width: expected metres ≥ 0, got {width}")
    if bounds is not None:
        west, south, east, north = bounds
        if not (all(map(math.isfinite, bounds)) and west < east and south < north):
            raise InputError(f"bounds: expected west < east and south < north, got {format_value(bounds)}")
    if not 1 <= size_px <= MAX_SIDE:
        raise InputError(f"size: expected 1 to {MAX_SIDE} px, got {size_px}")


def _collect(
    layers: Sequence[SourceLayer], layer: str | None, width: float | None, skipped: Counter[str]
) -> tuple[CRS | None, _Features]:
    """Return the usable features of all layers, in the CRS of the first layer with any."""
    crs, collected = None, list[_Features]()
    for source in layers:
        features = _usable_features(source, layer, width, skipped)
        if not len(features.shapes):
            continue
        if not collected:
            crs = source.crs
        elif source.crs and crs:
            features = features._replace(shapes=_reprojected(features.shapes, source.crs, crs))
        elif source.crs or crs:
            raise InputError("some of its layers have a CRS and some do not: expected all or none")
        collected.append(features)
    if not collected:
        if set(+skipped) - {_UNKNOWN}:
            raise InputError(f"no usable feature ({_skipped(skipped)})")
        raise InputError(
            f"no feature has a layer: expected a property layer ({', '.join(LAYERS)}), "
            "tags such as waterway=river, or one layer for all"
        )
    return crs, _Features(*(np.concatenate(column) for column in zip(*collected, strict=True)))


def _usable_features(
    source: SourceLayer, layer: str | None, width: float | None, skipped: Counter[str]
) -> _Features:
    shapes, labels, widths = [], [], []
    for original, properties in zip(source.shapes, source.properties, strict=True):
        tags = relevant_tags(properties)
        label = feature_label(tags, source.name, layer)
        if label is None:
            skipped[_UNKNOWN] += 1
            continue
        shape, own_width = _shape(original, label, tags, width)
        if isinstance(shape, str) and label.properties.get("use") == "forest":  # rows of trees are painted
            label = feature_label({**tags, "layer": "forest"}, source.name, layer) or label
            shape, own_width = _shape(original, label, tags, width)
        if isinstance(shape, str):
            skipped[shape] += 1
            continue
        shapes.append(shape)
        labels.append(label)
        widths.append(math.nan if own_width is None else min(max(own_width, 0.0), _MAX_WIDTH))
    return _Features(np.array(shapes, object), np.array(labels, object), np.array(widths, float))


def _shape(
    shape: Any, label: FeatureLabel, tags: Mapping[str, Any], width: float | None
) -> tuple[Any, float | None]:
    """Return a feature's shape on its layer and its width, or a reason to skip it."""
    is_area = LAYERS[label.layer].kind not in _NO_AREAS or tags.get("waterway") == "riverbank"
    if shape.geom_type == "LineString" and is_area and shape.is_closed:
        rings = np.array([shapely.Polygon(shape.coords)]) if len(shape.coords) > 3 else np.array([shape])
        shape = valid_areas(rings)[0]
    takes = LAYERS[label.layer].vectors
    if shapely.get_dimensions(shape) == AREA and not shape.is_empty:
        if takes and "area" not in takes:
            is_open = LAYERS[label.layer].kind == "standing"
            return (shapely.LineString(shape.exterior.coords) if is_open else "that are areas of lines"), None
        return shape, None
    if shape.geom_type == "Point":
        if not LAYERS[label.layer].is_points:
            return "that are points of areas", None
        radius = parse_number(tags.get("radius"))
        return shape, None if radius is None else 2.0 * radius
    own_width = parse_number(tags.get("width"))
    if "line" not in takes if takes else is_area and own_width is None and width is None:
        return "that are open lines of areas", None
    return shape, own_width


def _clip(
    features: _Features, crs: CRS | None, bounds: Box | None, skipped: Counter[str]
) -> tuple[Box, _Features]:
    """Return the bounds, by default those of all features, and the features in and around them."""
    if crs is not None and crs.is_geographic:
        features = features._replace(shapes=_unwrapped(features.shapes, bounds))
    if bounds is None:
        return shapely.total_bounds(features.shapes).tolist(), features
    west, south, east, north = bounds
    dx, dy = _MARGIN * (east - west), _MARGIN * (north - south)
    # Points farther away may be outside of the target CRS.
    return bounds, _inside(features, (west - dx, south - dy, east + dx, north + dy), skipped)


def _inside(features: _Features, box: Box, skipped: Counter[str]) -> _Features:
    """Return features clipped to a rectangle."""
    shapes = shapely.clip_by_rect(features.shapes, *box)
    inside = ~shapely.is_empty(shapes) & (shapely.get_dimensions(shapes) == features.kinds)
    skipped["outside"] += int((~inside).sum())
    if not inside.any():
        raise InputError("no usable feature within the bounds")
    return features._replace(shapes=shapes).where(inside)


def _unwrapped(shapes: Shapes, bounds: Box | None) -> Shapes:
    """Return shapes in degrees without a jump at the antimeridian, around the bounds if given."""
    points, of = shapely.get_coordinates(shapes, return_index=True)
    invalid = (np.abs(points[:, 0]) > 360.0) | (np.abs(points[:, 1]) > 90.0)
    if invalid.any():
        x, y = points[np.argmax(invalid)]
        raise InputError(f"{x:g}, {y:g} is not a longitude and latitude: expected degrees, or another CRS")
    x = points[:, 0]
    if bounds is None:
        x -= 360.0 * np.rint((x - mean_longitude(x)) / 360.0)
    else:
        west, _, east, _ = shapely.bounds(shapes).T
        split = (shapely.get_dimensions(shapes) == LINE) & (east - west > 180.0)  # lines go the short way
        x[split[of]] %= 360.0
        west, _, east, _ = shapely.bounds(shapely.set_coordinates(shapes.copy(), points)).T
        x -= 360.0 * np.rint((0.5 * (west + east) - 0.5 * (bounds[0] + bounds[2])) / 360.0)[of]
    return np.asarray(shapely.set_coordinates(shapes.copy(), points))


def _reprojected(shapes: Any, source: CRS, target: CRS) -> Any:
    return shapely.transform(shapes, lambda points: reproject(points, source, target))


def _bounds(features: _Features) -> Box:
    """Return the bounds of features (m), including the radii of discs."""
    boxes = shapely.bounds(features.shapes)
    low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    radius = 0.5 * np.where(np.isnan(features.widths), _DEFAULT_WIDTH * (high - low).max(), features.widths)
    radius = np.where(features.kinds == POINT, radius, 0.0)[:, None]
    return [*(boxes[:, :2] - radius).min(axis=0).tolist(), *(boxes[:, 2:] + radius).max(axis=0).tolist()]


def _visible(features: _Features, area: SketchArea, skipped: Counter[str]) -> BoolArray:
    """Return which features, in pixels, are visible in the sketch."""
    boxes = shapely.bounds(features.shapes)
    is_area = features.kinds == AREA
    radius = np.where(is_area, 0.0, 0.5 * np.nan_to_num(features.widths) / area.pixel)[:, None]
    size = np.array([area.columns, area.rows])
    outside = ((boxes[:, 2:] < -radius) | (boxes[:, :2] > size + radius)).any(axis=1)
    tiny = is_area & (boxes[:, 2:] - boxes[:, :2] < 0.5).all(axis=1) & ~features.are_vectors & ~outside
    skipped["outside"] += int(outside.sum())
    skipped["smaller than half a pixel"] += int(tiny.sum())
    return np.asarray(~outside & ~tiny)


def _on_grid(features: _Features, area: SketchArea, skipped: Counter[str]) -> _Features:
    """Return single lines and areas in metres from the sketch's corner, as a vector layer rounds them."""
    outlines = np.where(features.kinds == AREA, shapely.get_exterior_ring(features.shapes), features.shapes)
    counts = shapely.get_num_coordinates(outlines)
    for label, count in zip(features.labels, counts.tolist(), strict=True):
        if count > MAX_FEATURE_VERTICES:
            title = format_value(label.properties.get("name", "without a name"))
            limit = f"expected at most {MAX_FEATURE_VERTICES}, simplify it first"
            raise InputError(f"{label.layer} {title}: {count} vertices: {limit}")
    exact = shapely.transform(features.shapes, lambda at: at - (area.west, area.south))
    shapes = shapely.transform(exact, lambda at: np.rint(at / STEP) * STEP)
    broken = (features.kinds == AREA) & ~shapely.is_valid(shapes)
    shapes[broken] = shapely.set_precision(valid_areas(exact[broken]), STEP)
    shapes, of = single_parts(shapes, np.arange(len(shapes)))
    same = shapely.get_dimensions(shapes) == features.kinds[of]  # clipped areas may have lines beside them
    shapes, of = shapes[same], of[same]
    lines = shapely.get_dimensions(shapes) == LINE
    kinds = np.array([LAYERS[label.layer].kind for label in features.labels[of]], dtype=np.str_)
    for network in (lines & (kinds == kind) for kind in _JOINED):
        shapes[network] = _joined(shapes[network])
    whole = shapely.is_valid(shapes) & ~shapely.is_empty(shapes)
    skipped["that collapse to a point"] += len(features.shapes) - len(np.unique(of[whole]))
    return _Features(shapes[whole], features.labels[of[whole]], features.widths[of[whole]])


def _joined(lines: Shapes) -> Shapes:
    """Return lines with a vertex wherever another one ends on them."""
    ends = shapely.points(np.unique(shapely.get_coordinates(shapely.boundary(lines)), axis=0))
    line, end = shapely.STRtree(ends).query(lines, predicate="dwithin", distance=_JOIN)
    joined, start = np.unique(line, return_index=True)
    places = [shapely.multipoints(each) for each in np.split(ends[end], start[1:])]
    lines = lines.copy()
    lines[joined] = shapely.snap(lines[joined], places[: len(joined)], _JOIN)
    return lines


def _vector_layers(features: _Features, width: float | None) -> dict[str, FeatureTable]:
    layers = {}
    for name in dict.fromkeys(features.names.tolist()):
        layer = features.where(features.names == name)
        if name == "landuse":  # the last one is on top
            layer = layer.where(np.argsort(-shapely.area(layer.shapes), kind="stable"))
        pairs = zip(layer.labels, layer.kinds.tolist(), strict=True)
        columns = property_columns([_properties(label, kind, width) for label, kind in pairs])
        labels = [label.label for label in layer.labels]
        layers[name] = FeatureTable.from_shapes(name, layer.shapes, labels=labels, columns=columns)
    return layers


def _properties(label: FeatureLabel, kind: int, width: float | None) -> Properties:
    """Return the properties of a feature itself; width 0 of a river's area means as drawn."""
    properties = dict(label.properties)
    if not LAYERS[label.layer].is_painted:  # its label has the others
        return {name: value for name, value in properties.items() if name not in label.guessed}
    if kind == AREA and "width" in LAYERS[label.layer].parameters:
        properties["width"] = 0.0
        properties.pop("directed", None)
    elif width is not None and "width" in label.guessed:
        del properties["width"]
    return properties


def _label(layer: str, label: int, width: float | None) -> dict[str, Value]:
    """Return the properties of a label of a layer's vectors."""
    parameter, properties = LAYERS[layer].parameters.get("width"), label_properties(layer, label)
    if width is not None and parameter is not None:
        properties["width"] = min(max(width, parameter.low), parameter.high)
    return properties


def _paint(
    features: _Features, area: SketchArea, width: float | None
) -> tuple[dict[str, LabelImage], dict[tuple[str, int], dict[str, Value]], list[str]]:
    """Return layer images, where the last label of overlapping shapes wins, label properties and notes."""
    size = (area.rows, area.columns)
    images: dict[str, LabelImage] = {PAINTED_LAYERS[0]: np.zeros(size, dtype=np.uint8)}  # the sketch's size
    labels: dict[tuple[str, int], dict[str, Value]] = {}
    notes = []
    for name in dict.fromkeys(features.names.tolist()):
        layer = features.where(features.names == name)
        is_area = layer.kinds == AREA
        cluster_of, clusters, error = cluster_properties(
            [label.properties for label in layer.labels], MAX_LABELS
        )
        images[name] = np.zeros(size, dtype=np.uint8)
        widths = _line_widths(layer, area, width) / area.pixel
        for label, properties in enumerate(clusters, start=1):
            members = np.array(cluster_of) == label - 1
            areas, lines = members & is_area, members & ~is_area
            mask = paint_areas(size, layer.shapes[areas], touched=False)
            mask |= paint_lines(size, layer.shapes[lines], widths[lines])
            images[name][mask] = label
            labels[name, label] = properties
        if error:
            effect = f"errors up to {100 * error:.2g} %" if math.isfinite(error) else "all have the defaults"
            notes.append(f"{name}: more than {MAX_LABELS} different labels, so some are merged; {effect}")
    return images, labels, notes


def _line_widths(features: _Features, area: SketchArea, width: float | None) -> npt.NDArray[np.float64]:
    """Return the widths (m) of painted lines and discs."""
    default = np.full(len(features.shapes), _DEFAULT_WIDTH * area.extent)
    if width is not None:
        default[features.kinds == LINE] = width
    return np.where(np.isnan(features.widths), default, features.widths)


def paint_areas(size: tuple[int, int], shapes: Shapes, *, touched: bool) -> BoolArray:
    """Return the pixels, (rows, columns), whose centres are in a shape, or all `touched` by one."""
    shapes = shapes[~shapely.is_empty(shapes)]
    if not len(shapes):
        return np.zeros(size, dtype=bool)
    return np.asarray(rasterize(shapes, out_shape=size, dtype="uint8", all_touched=touched), dtype=bool)


def paint_lines(size: tuple[int, int], shapes: Shapes, widths: npt.NDArray[np.float64]) -> BoolArray:
    """Return the pixels, (rows, columns), of lines and points of widths (px).

    Those with covered centres, and all on the centreline, so that thin lines are connected.
    """
    if not len(shapes):
        return np.zeros(size, dtype=bool)
    margin = 0.5 * float(widths.max()) + 1.0
    near = shapely.clip_by_rect(shapes, -margin, -margin, size[1] + margin, size[0] + margin)
    wide = widths > 1.0
    centrelines = shapely.simplify(near[wide], _SIMPLIFICATION)
    buffers = shapely.buffer(centrelines, 0.5 * widths[wide], quad_segs=32)
    return paint_areas(size, near, touched=True) | paint_areas(size, buffers, touched=False)


def _used(*parts: _Features) -> str:
    order = list(LAYERS)
    ranks = chain(*(zip(map(order.index, part.names), part.kinds.tolist(), strict=True) for part in parts))
    used = (
        f"{count} {KINDS[kind]}{'s' if count > 1 else ''} as {order[rank]}"
        for (rank, kind), count in sorted(Counter(ranks).items())
    )
    return f"used: {', '.join(used)}"


def _guess_notes(drawn: _Features, painted: _Features, area: SketchArea, width: float | None) -> list[str]:
    notes = []
    rivers = drawn.labels[(drawn.kinds == LINE) & (drawn.names == "river")].tolist()
    guessed_rivers = sum("width" not in label.properties or "width" in label.guessed for label in rivers)
    if guessed_rivers:
        default = f"{width:g} m" if width is not None else "by their kind: 12 m, streams 3 m, ditches 1.5 m"
        notes.append(f"lines of rivers without a width ({guessed_rivers} of {len(rivers)}): {default}")
    ways = drawn.labels[np.isin(drawn.names, WAY_LAYERS)].tolist()
    guessed_ways = sum(not {"width", "lanes"} & label.properties.keys() - label.guessed for label in ways)
    if guessed_ways:
        default = f"{width:g} m" if width is not None else "by their kind"
        notes.append(f"roads, railways and paths without a width ({guessed_ways} of {len(ways)}): {default}")
    guessed = int((np.isnan(painted.widths) & (painted.kinds != AREA)).sum())
    if guessed:
        notes.append(
            f"lines and points without a size ({guessed}): "
            f"{_DEFAULT_WIDTH * area.extent:.4g} m wide{'' if width is None else f', lines {width:g} m'}"
        )
    labels = {id(label): label for label in (*drawn.labels, *painted.labels)}.values()
    for what, key in (("clipped numbers out of range", "clipped"), ("invalid properties left out", "unread")):
        found = [text for label in labels for text in getattr(label, key)]
        notes += [f"{what} ({len(found)}): {first_few(found, 3)}"] if found else []
    return notes


def _skipped(skipped: Counter[str]) -> str:
    return ", ".join(f"{count} {why}" for why, count in sorted((+skipped).items()))


def _position_note(frame: Mapping[str, Any]) -> str:
    corner = f"{frame['east']:.10g},{frame['north']:.10g}"
    is_wkt = "[" in frame["crs"]
    name = "its own coordinate reference system" if is_wkt else frame["crs"] or "its own metres"
    return f"south-west corner: {corner} in {name}; exports return there"
