"""A sketch of vector maps: rivers, lakes, forests and summits of GIS files, painted on its layers."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from rasterio.crs import CRS
from rasterio.features import rasterize

from sketchterrain.array_types import BoolArray
from sketchterrain.document.label_layers import MAX_LABELS, MAX_SIDE, LabelImage
from sketchterrain.document.parameter_types import Value
from sketchterrain.document.parameters import LAYERS
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError, did_you_mean, format_value, one_line
from sketchterrain.importing import vector_files as vector_place
from sketchterrain.importing.traced_layers import Traced
from sketchterrain.importing.vector_files import (
    Area,
    Box,
    Shapes,
    VectorLayer,
    read_vector_layers,
    valid_areas,
)
from sketchterrain.importing.vector_kinds import Wanted, classed, number_in, tags_of, wanted_by
from sketchterrain.io.crs import parse_metric_crs

_SIZE = 512  # px
_AROUND = 0.5  # of the bounds' size that is kept around them: wide lines there reach in
_DISCS = ("mountain", "hill", "dune", "forest")  # a point can stand for
_AREAS = ("dune", "forest", "lake", "material")  # lines only bound
_WIDEST = 1e6  # m
_WIDE = 0.04  # of the longer side: a line or disc on a layer of areas without a width
_SIMPLER = 1 / 16  # px that a wide line's course may be simplified by
_POINT, _LINE, _AREA = 0, 1, 2  # dimensions
_KINDS = ("point", "line", "area")


class _Features(NamedTuple):
    """Features of a sketch: shapes, what each becomes (`Wanted`), widths (m, NaN where unknown)."""

    shapes: Shapes
    wanted: npt.NDArray[np.object_]
    widths: npt.NDArray[np.float64]

    def where(self, mask: BoolArray) -> _Features:
        """Return the features of a mask."""
        return _Features(self.shapes[mask], self.wanted[mask], self.widths[mask])

    @property
    def dimensions(self) -> npt.NDArray[np.int32]:
        """0 of points, 1 of lines, 2 of areas."""
        return np.asarray(shapely.get_dimensions(self.shapes), dtype=np.int32)


def sketch_from_vectors(
    path: Path,
    *,
    layer: str | None = None,
    width: float | None = None,
    bounds: Box | None = None,
    crs: str | None = None,
    size_px: int = _SIZE,
    name: str | None = None,
) -> Traced:
    """Make a sketch of the lines, areas and summits of a map.

    They are brought into metres, cut to a rectangle and painted on the layers that their properties ask for.
    """
    _check(layer, width, bounds, size_px)
    target = None if crs is None else parse_metric_crs(crs)
    layers = read_vector_layers(path)
    skipped: Counter[str] = sum((each.skipped for each in layers), Counter())
    try:
        home, features = _chosen(layers, layer, width, skipped)
        box, features = _cut(features, home, bounds, skipped)
        latitude: float | None = None
        if home is not None:
            middle = (0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3]))
            latitude = round(float(vector_place.to_degrees(home, np.array([middle]))[0, 1]), 2)
            target = target or vector_place.metric(home, middle)
            features = features._replace(shapes=_reprojected(features.shapes, home, target))
            if bounds is not None:
                step = 0.05 * max(box[2] - box[0], box[3] - box[1])
                outline = shapely.segmentize(shapely.box(*box), step)
                box = shapely.bounds(_reprojected(outline, home, target)).tolist()
        elif target is not None:
            raise InputError("its metres lie nowhere on Earth: expected no crs to bring it into")
        area = vector_place.area_of(
            _extent(features) if bounds is None else box, size_px, chosen=bounds is not None
        )
        features = features._replace(shapes=shapely.transform(features.shapes, area.pixels))
        features = _visible(features, area, skipped)
        images, labels, notes = _painted(features, area, width)
    except (InputError, shapely.errors.GEOSException) as error:
        raise InputError(f"{one_line(path)}: {one_line(error)}") from None
    sketch = Sketch(
        name=one_line(path.stem)[:200] if name is None else name,
        extent=area.extent,
        weather={} if latitude is None else {"latitude": latitude},
        layers=images,
        labels=labels,
    )
    notes += [f"left out: {_left_out(skipped)}"] if +skipped else []
    notes.append(f"{sketch.width_px}×{sketch.height_px} px, {sketch.pixel_size:.4g} m each")
    return Traced(sketch, (*notes, _place_note(area, target)))


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


def _chosen(
    layers: Sequence[VectorLayer], layer: str | None, width: float | None, skipped: Counter[str]
) -> tuple[CRS | None, _Features]:
    """Return the features that belong to a sketch, all in the CRS of the first layer that has some."""
    home, chosen = None, list[_Features]()
    for each in layers:
        features = _wanted(each, layer, width, skipped)
        if not len(features.shapes):
            continue
        if not chosen:
            home = each.crs
        elif each.crs and home:
            features = features._replace(shapes=_reprojected(features.shapes, each.crs, home))
        elif each.crs or home:
            raise InputError("some of its layers lie on Earth and some do not: expected one or the other")
        chosen.append(features)
    if not chosen:
        raise InputError(
            f"nothing in it says what it is: expected a property layer ({', '.join(LAYERS)}), "
            "tags such as waterway=river or natural=water, or one layer for all"
        )
    return home, _Features(*(np.concatenate(each) for each in zip(*chosen, strict=True)))


def _wanted(source: VectorLayer, layer: str | None, width: float | None, skipped: Counter[str]) -> _Features:
    shapes, wanted, widths = [], [], []
    for given, properties in zip(source.shapes, source.properties, strict=True):
        tags = tags_of(properties)
        wish = wanted_by(tags, source.name, layer)
        if wish is None:
            skipped["that say nothing a sketch knows"] += 1
            continue
        shape, wide = _shape(given, wish, tags, width)
        if isinstance(shape, str):
            skipped[shape] += 1
            continue
        shapes.append(shape)
        wanted.append(wish)
        widths.append(math.nan if wide is None else min(max(wide, 0.0), _WIDEST))
    return _Features(np.array(shapes, object), np.array(wanted, object), np.array(widths, float))


def _shape(
    shape: Any, wanted: Wanted, tags: Mapping[str, Any], width: float | None
) -> tuple[Any, float | None]:
    """Return a feature's shape on its layer and its width, or the reason why it has none."""
    if shape.geom_type == "LineString" and wanted.layer in _AREAS and shape.is_closed:
        rings = np.array([shapely.Polygon(shape.coords)]) if len(shape.coords) > 3 else np.array([shape])
        shape = valid_areas(rings)[0]
    if shapely.get_dimensions(shape) == _AREA and not shape.is_empty:
        return shape, None
    if shape.geom_type == "Point":
        if wanted.layer not in _DISCS:
            return "that are points, where no area is known", None
        radius = number_in(tags.get("radius"))
        return shape, None if radius is None else 2.0 * radius
    wide = number_in(tags.get("width"))
    if wanted.layer in _AREAS and wide is None and width is None:
        return "that are lines around nothing", None
    return shape, wide


def _cut(
    features: _Features, home: CRS | None, bounds: Box | None, skipped: Counter[str]
) -> tuple[Box, _Features]:
    """Return the chosen rectangle, else that around all, and the features in and around it."""
    if home is not None and home.is_geographic:
        features = features._replace(shapes=_unwrapped(features.shapes, bounds))
    if bounds is None:
        return shapely.total_bounds(features.shapes).tolist(), features
    west, south, east, north = bounds
    more = (_AROUND * (east - west), _AROUND * (north - south))
    # Farther away, places may have no other coordinates.
    box = (west - more[0], south - more[1], east + more[0], north + more[1])
    shapes = shapely.clip_by_rect(features.shapes, *box)
    inside = ~shapely.is_empty(shapes) & (shapely.get_dimensions(shapes) == features.dimensions)
    skipped["outside"] += int((~inside).sum())
    if not inside.any():
        raise InputError("nothing that belongs to a sketch lies in these bounds")
    return bounds, features._replace(shapes=shapes).where(inside)


def _unwrapped(shapes: Shapes, bounds: Box | None) -> Shapes:
    """Return shapes in degrees on one side of the antimeridian, around the bounds if there are any."""
    places, of = shapely.get_coordinates(shapes, return_index=True)
    odd = (np.abs(places[:, 0]) > 360.0) | (np.abs(places[:, 1]) > 90.0)
    if odd.any():
        x, y = places[np.argmax(odd)]
        raise InputError(
            f"{x:g}, {y:g} is no longitude and latitude: expected degrees, or a CRS that says what it is"
        )
    x = places[:, 0]
    if bounds is None:
        x -= 360.0 * np.rint((x - vector_place.middle_longitude(x)) / 360.0)
    else:
        west, _, east, _ = shapely.bounds(shapes).T
        torn = (shapely.get_dimensions(shapes) == _LINE) & (east - west > 180.0)  # lines run the short way
        x[torn[of]] %= 360.0
        west, _, east, _ = shapely.bounds(shapely.set_coordinates(shapes.copy(), places)).T
        x -= 360.0 * np.rint((0.5 * (west + east) - 0.5 * (bounds[0] + bounds[2])) / 360.0)[of]
    return np.asarray(shapely.set_coordinates(shapes.copy(), places))


def _reprojected(shapes: Any, source: CRS, target: CRS) -> Any:
    return shapely.transform(shapes, lambda places: vector_place.reprojected(places, source, target))


def _extent(features: _Features) -> Box:
    """Return the rectangle around features (m), with discs as wide as they will be."""
    boxes = shapely.bounds(features.shapes)
    low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    half = 0.5 * np.where(np.isnan(features.widths), _WIDE * (high - low).max(), features.widths)
    half = np.where(features.dimensions == _POINT, half, 0.0)[:, None]
    return [*(boxes[:, :2] - half).min(axis=0).tolist(), *(boxes[:, 2:] + half).max(axis=0).tolist()]


def _visible(features: _Features, area: Area, skipped: Counter[str]) -> _Features:
    """Return the features, in pixels, that leave a mark."""
    boxes = shapely.bounds(features.shapes)
    is_area = features.dimensions == _AREA
    reach = np.where(is_area, 0.0, 0.5 * np.nan_to_num(features.widths) / area.pixel)[:, None]
    size = np.array([area.columns, area.rows])
    outside = ((boxes[:, 2:] < -reach) | (boxes[:, :2] > size + reach)).any(axis=1)
    tiny = ~outside & is_area & (boxes[:, 2:] - boxes[:, :2] < 0.5).all(axis=1)
    skipped["outside"] += int(outside.sum())
    skipped["smaller than half a pixel"] += int(tiny.sum())
    if (outside | tiny).all():
        raise InputError(f"nothing of it is to be seen ({_left_out(skipped)})")
    return features.where(~outside & ~tiny)


def _painted(
    features: _Features, area: Area, width: float | None
) -> tuple[dict[str, LabelImage], dict[tuple[str, int], dict[str, Value]], list[str]]:
    """Return layers' images, labels' properties and notes.

    Where shapes of a layer overlap, an area of a river or else the widest line counts, and elsewhere the
    label that appears last.
    """
    images: dict[str, LabelImage] = {}
    labels: dict[tuple[str, int], dict[str, Value]] = {}
    taken, notes = [], []
    names = np.array([each.layer for each in features.wanted])
    for name in (each for each in LAYERS if each in names):
        ones = features.where(names == name)
        kinds = Counter(_KINDS[dimension] for dimension in ones.dimensions)
        taken += [f"{count} {kind}{'s' if count > 1 else ''} as {name}" for kind, count in kinds.items()]
        wanted = zip(ones.wanted, ones.dimensions, strict=True)
        stated = [_properties(each, dimension, width) for each, dimension in wanted]
        of, classes, error = classed(stated, MAX_LABELS)
        order = list(range(len(classes)))
        if name == "river":
            # As wide as painted is wider than any: maps have a line in the middle of a river's area too.
            order.sort(key=[_river_width(each) or math.inf for each in classes].__getitem__)
        size = (area.rows, area.columns)
        images[name] = np.zeros(size, dtype=np.uint8)
        widths, is_area = (
            _line_widths(ones, [classes[index] for index in of], area, width) / area.pixel,
            ones.dimensions == _AREA,
        )
        for label, index in enumerate(order, start=1):
            mine = np.array(of) == index
            areas, lines = mine & is_area, mine & ~is_area
            mask = paint_areas(size, ones.shapes[areas], touched=name == "river")
            mask |= paint_lines(size, ones.shapes[lines], widths[lines])
            images[name][mask] = label
            labels[name, label] = classes[index]
        if error:
            off = f"their numbers are off by up to {100 * error:.2g} %"
            told = off if math.isfinite(error) else "all have the defaults, for even so there were more"
            notes.append(f"{name}: {MAX_LABELS} labels at most, so some share one; {told}")
    return images, labels, [f"taken: {', '.join(taken)}", *notes, *_guesses(features, area, width)]


def _properties(wanted: Wanted, dimension: int, width: float | None) -> dict[str, Value]:
    """Return the properties of a feature's label; a river's area, of width 0, is as wide as it is painted."""
    said = dict(wanted.properties)
    if wanted.layer == "river":
        table = LAYERS["river"].parameters["width"]
        if dimension == _AREA:
            said["width"] = 0.0
        elif width is not None and ("width" not in said or "width" in wanted.guessed):
            said["width"] = min(width, table.high)
        said.setdefault("width", table.default)
    return said


def _river_width(properties: Mapping[str, Value]) -> float:
    return float(properties.get("width", LAYERS["river"].parameters["width"].default))


def _line_widths(
    features: _Features, labels: Sequence[Mapping[str, Value]], area: Area, width: float | None
) -> npt.NDArray[np.float64]:
    """Return the widths (m) of a layer's lines and discs: a river's is its label's."""
    if features.wanted[0].layer == "river":
        return np.array([_river_width(each) for each in labels])
    default = np.full(len(features.shapes), _WIDE * area.extent)
    if width is not None:
        default[features.dimensions == _LINE] = width
    return np.where(np.isnan(features.widths), default, features.widths)


def paint_areas(size: tuple[int, int], shapes: Shapes, *, touched: bool) -> BoolArray:
    """Return the (rows, columns) pixels whose middles lie in a shape, or all that a shape touches."""
    shapes = shapes[~shapely.is_empty(shapes)]
    if not len(shapes):
        return np.zeros(size, dtype=bool)
    return np.asarray(rasterize(shapes, out_shape=size, dtype="uint8", all_touched=touched), dtype=bool)


def paint_lines(size: tuple[int, int], shapes: Shapes, widths: npt.NDArray[np.float64]) -> BoolArray:
    """Return the (rows, columns) pixels of lines and points of widths (px).

    These are the pixels whose middles a line covers and all that its course touches: however thin it is, it
    does not break.
    """
    if not len(shapes):
        return np.zeros(size, dtype=bool)
    reach = 0.5 * float(widths.max()) + 1.0
    near = shapely.clip_by_rect(shapes, -reach, -reach, size[1] + reach, size[0] + reach)
    wide = widths > 1.0
    broad = shapely.buffer(shapely.simplify(near[wide], _SIMPLER), 0.5 * widths[wide], quad_segs=32)
    return paint_areas(size, near, touched=True) | paint_areas(size, broad, touched=False)


def _guesses(features: _Features, area: Area, width: float | None) -> list[str]:
    """Return notes on what was not in the file, and what of it was not taken as it stands."""
    notes = []
    no_area = features.dimensions != _AREA
    is_river = np.array([each.layer == "river" for each in features.wanted])
    rivers = features.wanted[is_river & no_area].tolist()
    bare = sum("width" not in each.properties or "width" in each.guessed for each in rivers)
    if bare:
        default = f"{width:g} m" if width is not None else "by their kind: 12 m, streams 3 m, ditches 1.5 m"
        notes.append(f"lines of rivers that say no width ({bare} of {len(rivers)}): {default}")
    guessed = int((np.isnan(features.widths) & no_area & ~is_river).sum())
    if guessed:
        notes.append(
            f"lines and points that say nothing of their size ({guessed}): "
            f"{_WIDE * area.extent:.4g} m wide{'' if width is None else f', lines {width:g} m'}"
        )
    clipped, unread = (sum(getattr(each, key) for each in features.wanted) for key in ("clipped", "unread"))
    notes += [f"{clipped} numbers were out of range and went to its end"] if clipped else []
    notes += [f"{unread} properties could not be read and have their defaults"] if unread else []
    return notes


def _left_out(skipped: Counter[str]) -> str:
    return ", ".join(f"{count} {why}" for why, count in sorted((+skipped).items()))


def _place_note(area: Area, crs: CRS | None) -> str:
    corner = f"{area.west:.10g},{area.south:.10g}"
    code = crs and crs.to_authority()
    name = "its own metres" if crs is None else "its own coordinate reference system"
    back = f"--crs {':'.join(code)} --origin {corner}" if code else f"--origin {corner}"
    return (
        f"south-west corner: {corner} in {':'.join(code) if code else name}; export with {back} puts it back"
    )
