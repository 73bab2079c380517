"""Features, waters, land use and plants as JSON and as vector layers of a GeoPackage."""

from __future__ import annotations

import json
import sqlite3
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from rasterio.features import rasterize
from rasterio.transform import Affine
from skimage.measure import find_contours

from sketchterrain.array_types import StructuredArray
from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.export.sampled import TerrainSamples
from sketchterrain.features import table as vectors
from sketchterrain.geometry.splines import arc_length
from sketchterrain.io.crs import plain_path
from sketchterrain.io.files import write_atomic
from sketchterrain.landforms.placement.feature_types import (
    FEATURE_TYPES,
    Lake,
    River,
    ShapeField,
    conifer_share,
    has_parameter,
    style_of,
)
from sketchterrain.roads.road_types import STRUCTURES, LineObject, Pad, Road
from sketchterrain.schema.layers import LAND_USES, layer_of
from sketchterrain.terrain.surfaces import TerrainFeatures

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch

_OUTLINE_DECIMALS = 2  # centimetres
_RIM = -1e9  # m of depth around a raster, so that the sea ends at its outermost samples


def write_features(
    folder: Path, features: TerrainFeatures, areas: Iterable[dict[str, Any]] = ()
) -> tuple[Path, ...]:
    """Write ``features.json``: point features by id, rivers as splines, lakes, roads, pads, walls, the sea.

    Ids are 64-bit unsigned integers, lengths metres, angles degrees. Roads, pads, what stands along lines
    and `areas`, the entries of land use, are left out if there are none.
    """
    lists: dict[str, Iterable[dict[str, Any]]] = {
        "features": map(_point_entry, features.points),
        "splines": map(_river_entry, features.rivers),
        "lakes": map(_lake_entry, features.lakes),
    }
    for name, built in features.network.lists.items():
        if built:
            lists[name] = map(_built_entry, built)
    if entries := list(areas):
        lists["landuse"] = entries
    text = '{"format": 1' + "".join(f',\n"{name}": [\n{_lines(entries)}]' for name, entries in lists.items())
    text += "}\n" if features.sea_level is None else f',\n"sea": {{"level": {features.sea_level}}}}}\n'
    return (write_atomic(folder / "features.json", text.encode()),)


def _lines(entries: Iterable[dict[str, Any]]) -> str:
    """Return one entry a line, so that files can be read and compared."""
    text = ",\n".join(json.dumps(entry, allow_nan=False) for entry in entries)
    return text and f"{text}\n"


def _point_entry(point: np.void) -> dict[str, Any]:
    name = FEATURE_TYPES[int(point["type"])]
    entry = {
        "id": int(point["id"]),
        "type": name,
        "x": float(point["x"]),
        "y": float(point["y"]),
        "radius": _shortest(point["radius"]),
        "strength": _shortest(point["strength"]),
    }
    for key, value in style_of(point).items():
        entry[key] = _shortest(value) if isinstance(value, np.float32) else round(value, 4)
    return entry | {"painted": bool(point["painted"])}


def _river_entry(river: River) -> dict[str, Any]:
    return {
        "id": river.id,
        "type": layer_of(river.id),
        "label": river.label,
        "points": river.points.tolist(),
        "width": [_shortest(width) for width in river.width],
        "depth": [_shortest(depth) for depth in river.depth],
        "centreline": river.centreline.tolist(),
        "centreline_width": [_shortest(width) for width in river.centreline_width],
        "centreline_depth": [_shortest(depth) for depth in river.centreline_depth],
    }


def _lake_entry(lake: Lake) -> dict[str, Any]:
    return {
        "id": lake.id,
        "type": layer_of(lake.id),
        "label": lake.label,
        "level": lake.level,
        "depth": lake.depth,
        "outline": [ring.tolist() for ring in lake_outline(lake.shape)],
    }


def _built_entry(built: Road | Pad | LineObject) -> dict[str, Any]:
    """Return all values, those of its earthworks among them."""
    if isinstance(built, LineObject):
        return {"id": built.id, "line": built.line.tolist(), **built.values}
    values = vars(built) | built.works._asdict()
    if isinstance(built, Road):
        values |= {"leg": str(built.leg), "structure": STRUCTURES[built.structure]}
    arrays = {name: value.tolist() for name, value in values.items() if isinstance(value, np.ndarray)}
    return {name: value for name, value in (values | arrays).items() if name != "works"}


def lake_outline(shape: ShapeField) -> list[npt.NDArray[np.float64]]:
    """Return closed rings (n, 2) of x, y (m) along the shore, islands included."""
    rings = find_contours(shape.inside.astype(np.float64), 0.0, positive_orientation="high")
    corner = np.array([shape.west, shape.south])
    return [np.round(ring[:, ::-1] * shape.spacing + corner, _OUTLINE_DECIMALS) for ring in rings]


def _shortest(value: np.float32) -> float:
    """Return the number with the fewest digits that rounds to this float32: 0.6, not 0.6000000238418579."""
    return float(str(value))


# GDAL writes the time into the file; a fixed one makes files deterministic.
_FIXED_TIME = {"OGR_CURRENT_DATE": "2000-01-01T00:00:00.000Z"}


class Origin(NamedTuple):
    """Offset of the world's x and y (m)."""

    east: float
    north: float


class ExportLayer(NamedTuple):
    """Features of a layer."""

    name: str
    geometry_type: str  # as OGR names it: ``Point Z``, ``LineString Z``, ``MultiPolygon Z``
    geometry: npt.NDArray[np.object_]  # (n,) shapely geometries of that type
    fields: Mapping[str, npt.NDArray[Any]]  # attributes, (n,) each: numbers, bool, or object arrays of str


class GeoPackage:
    """A GeoPackage open for writing, see `geopackage`."""

    def __init__(self, path: Path, crs: str) -> None:
        self._path, self._crs = path, crs
        self.counts = Counter[str]()  # features of each layer
        self.indexed = Counter[str]()  # those with a geometry, in its spatial index

    def add(self, layer: ExportLayer) -> None:
        """Append features to a layer, which is created even if empty."""
        from sketchterrain.features.files import write_table  # loads GDAL

        exists, wkb = self._path.exists(), shapely.to_wkb(layer.geometry, flavor="iso")
        with plain_path(self._path) as path:
            write_table(
                path,
                layer.name,
                wkb,
                layer.fields,
                driver="GPKG",
                geometry_type=layer.geometry_type,
                crs=self._crs,
                append=exists,
                dataset_options={} if exists else {"VERSION": "1.2"},  # of GDAL before 3.7
            )
        self.counts[layer.name] += len(layer.geometry)
        self.indexed[layer.name] += int((~shapely.is_empty(layer.geometry)).sum())


@contextmanager
def geopackage(path: Path, crs: str) -> Iterator[GeoPackage]:
    """Yield a GeoPackage to add layers to, each with a spatial index; deterministic.

    A layer's first million points take 10 s, later ones 16 s.
    """
    import pyogrio
    from pyogrio.errors import DataLayerError, DataSourceError

    before = {key: pyogrio.get_gdal_config_option(key) for key in _FIXED_TIME}
    pyogrio.set_gdal_config_options(_FIXED_TIME)
    file = GeoPackage(path, crs)
    try:
        yield file
        _check_complete(path, file)
    except (DataLayerError, DataSourceError, sqlite3.Error, OSError) as error:
        raise SketchterrainError(f"{one_line(path)}: cannot be written ({one_line(error)})") from error
    finally:
        pyogrio.set_gdal_config_options(before)


def _check_complete(path: Path, file: GeoPackage) -> None:
    """Check that all rows are on disk: GDAL does not report failures on closing a layer."""
    rows = {f"rtree_{name}_geom_rowid": count for name, count in file.indexed.items()} | dict(file.counts)
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as connection:
        tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
        for table, count in rows.items():
            counted = f'SELECT count(*) FROM "{table}"'  # noqa: S608 # our own names
            if table not in tables or connection.execute(counted).fetchone() != (count,):
                raise OSError("incomplete on disk")


def lake_layer(lakes: Sequence[Lake], origin: Origin) -> ExportLayer:
    """Return the lakes as areas at their level, without islands."""
    areas = [_area([ring + origin for ring in lake_outline(lake.shape)], lake.level) for lake in lakes]
    return ExportLayer(
        "lakes",
        "MultiPolygon Z",
        np.array(areas, object),
        {
            "id": id_texts(lake.id for lake in lakes),
            "label": np.array([lake.label for lake in lakes], np.int32),
            "level": np.array([lake.level for lake in lakes], np.float64),
            "depth": np.array([lake.depth for lake in lakes], np.float64),
        },
    )


def sketch_layer(layer: vectors.FeatureTable, origin: Origin) -> ExportLayer:
    """Return the vectors of a sketch's layer as they were drawn."""
    fields: dict[str, npt.NDArray[Any]] = {"id": layer.ids, "label": layer.labels.astype(np.int32)}
    taken = {"fid", "geom", *fields}  # a GeoPackage ignores case
    for name, column in layer.columns.items():
        values = np.array(column, object) if isinstance(column, tuple) else column
        fields[distinct_name(name, taken)] = values
    from sketchterrain.features.files import geometry_type  # loads GDAL

    shapes = shapely.transform(layer.shapes(), lambda at: at + origin)
    return ExportLayer(f"sketch_{layer.layer}", geometry_type(layer), shapes, fields)


def distinct_name(name: str, taken: set[str]) -> str:
    """Return a name, with underscores if it is taken in lower case, and take it."""
    while name.lower() in taken:
        name += "_"
    taken.add(name.lower())
    return name


def sea_layer(level: float, samples: TerrainSamples, origin: Origin) -> ExportLayer:
    """Return the ground below the sea's level as areas at it."""
    grid = samples.grid
    depth = np.pad(level - samples.height.astype(np.float64), 1, constant_values=_RIM)
    corner = np.array([grid.west + origin.east, grid.north + origin.north])
    step = np.array([1.0, -1.0]) * grid.spacing
    rings = [corner + (ring[:, ::-1] - 1.0) * step for ring in find_contours(depth, 0.0)]
    areas = [_area([np.round(ring, _OUTLINE_DECIMALS) for ring in rings], level)] if rings else []
    fields = {"level": np.full(len(areas), level)}
    return ExportLayer("sea", "MultiPolygon Z", np.array(areas, object), fields)


def river_layer(rivers: Sequence[River], origin: Origin) -> ExportLayer:
    """Return the rivers' centrelines from the spring on, at the height of the water."""
    ends, along = {"spring": 0, "mouth": -1}, [arc_length(river.centreline) for river in rivers]
    fields: dict[str, npt.NDArray[Any]] = {
        "id": id_texts(river.id for river in rivers),
        "label": np.array([river.label for river in rivers], np.int32),
        "length": np.array([each[-1] for each in along], np.float64),
    }
    for name in ("width", "depth"):
        values = [getattr(river, f"centreline_{name}") for river in rivers]
        fields[name] = np.array([*map(_mean, values, along)], np.float64)
        fields |= {
            f"{name}_{end}": np.array([value[at] for value in values], np.float32) for end, at in ends.items()
        }
    lines = [shapely.linestrings(_moved(river.centreline, origin)) for river in rivers]
    return ExportLayer("rivers", "LineString Z", np.array(lines, object), fields)


def station_layer(rivers: Sequence[River], origin: Origin) -> ExportLayer:
    """Return every point of the centrelines with the river's width and depth."""
    counts = [len(river.centreline) for river in rivers]
    widths, depths = (
        np.concatenate([np.zeros(0), *(getattr(river, name) for river in rivers)], dtype=np.float32)
        for name in ("centreline_width", "centreline_depth")
    )
    places = np.concatenate([np.zeros((0, 3)), *(_moved(river.centreline, origin) for river in rivers)])
    return ExportLayer(
        "river_stations",
        "Point Z",
        shapely.points(places),
        {
            "river": id_texts(chain.from_iterable([r.id] * n for r, n in zip(rivers, counts, strict=True))),
            "distance": np.concatenate([np.zeros(0), *(arc_length(river.centreline) for river in rivers)]),
            "width": widths,
            "depth": depths,
        },
    )


def feature_layer(points: StructuredArray, height: npt.NDArray[np.float32], origin: Origin) -> ExportLayer:
    """Return mountains, hills, dunes and forests as points with their parameters."""
    names = np.array(FEATURE_TYPES, dtype=object)
    has_conifers = has_parameter(points, "conifers")
    columns = ("peakiness", "wavelength", "wind", "erosion", "strata")
    fields: dict[str, npt.NDArray[Any]] = {
        "id": id_texts(points["id"]),
        "type": names[points["type"]],
        "radius": points["radius"],
        "strength": points["strength"],
    }
    fields |= {name: np.where(has_conifers, np.float32(0.0), points[name]) for name in columns}
    fields["conifers"] = np.where(has_conifers, conifer_share(points["peakiness"]), -1.0).astype(np.float32)
    fields["painted"] = points["painted"]
    places = np.stack([points["x"] + origin.east, points["y"] + origin.north, height], axis=-1)
    return ExportLayer("features", "Point Z", shapely.points(places), fields)


def plant_layer(
    name: str, plants: npt.NDArray[np.void], species: Sequence[str], origin: Origin
) -> ExportLayer:
    """Return plants as points."""
    places = np.stack([plants["x"] + origin.east, plants["y"] + origin.north, plants["z"]], axis=-1)
    return ExportLayer(
        name,
        "Point Z",
        shapely.points(places),
        {
            "species": np.array(species, dtype=object)[plants["species"]],
            "scale": np.ascontiguousarray(plants["scale"]),
            "rotation": np.degrees(plants["rotation"]).astype(np.float32),
            "tint": np.ascontiguousarray(plants["tint"]),
            "level": plants["level"].astype(np.int16),
        },
    )


def _mean(values: npt.NDArray[np.float32], along: npt.NDArray[np.float64]) -> float:
    return (
        float(np.trapezoid(values.astype(np.float64), along) / along[-1]) if along[-1] else float(values[0])
    )


def _moved(places: npt.NDArray[np.float64], origin: Origin) -> npt.NDArray[np.float64]:
    return np.add(places, (origin.east, origin.north, 0.0))


def _area(rings: Sequence[npt.NDArray[np.float64]], level: float) -> Any:
    """Return the area of rings (n, 2; m) by the even-odd rule, at a level (m)."""
    # Rings do not cross, but may touch themselves and each other.
    lines = shapely.multilinestrings([shapely.linestrings(ring) for ring in rings])
    area = shapely.make_valid(shapely.build_area(shapely.node(lines)))
    parts = [part for part in shapely.get_parts(area) if part.geom_type == "Polygon"]
    return shapely.force_3d(shapely.multipolygons(parts), level)


def id_texts(numbers: Iterable[Any]) -> npt.NDArray[np.object_]:
    """Return 64-bit unsigned ids as texts: a GeoPackage has no such numbers."""
    return np.array([str(int(number)) for number in numbers], object)


_PARTS = 4  # of a sample, along each side, whose middles are inside an area or not
_TEXTS, _NUMBERS = ("use", "crop"), ("direction", "parcels", "density", "conifers")
LAND_FIELDS: Final = (
    "direction: degrees of rows, -1 along contours; parcels: m; density, conifers: shares; -1 by elevation"
)


def land_layer(sketch: Sketch, origin: Origin) -> ExportLayer:
    """Return the areas of land use with their properties, their labels' included, the lowest one first."""
    layer = sketch.vectors["landuse"]
    fields: dict[str, npt.NDArray[Any]] = {
        "id": layer.ids,
        "label": layer.labels.astype(np.int32),
        **_land_properties(sketch),
    }
    shapes = shapely.transform(layer.shapes(), lambda at: at + origin)
    order = np.argsort(layer.ids, kind="stable")
    return ExportLayer(
        "landuse", "Polygon", shapes[order], {name: each[order] for name, each in fields.items()}
    )


def land_entries(sketch: Sketch) -> Iterator[dict[str, Any]]:
    """Yield the entries of areas in features.json: properties, and the border and holes (m)."""
    layer = sketch.vectors["landuse"]
    columns = {name: values.tolist() for name, values in _land_properties(sketch).items()}
    for index in np.argsort(layer.ids, kind="stable").tolist():
        rings = [layer.ring(ring).tolist() for ring in range(*layer.parts[index : index + 2])]
        own = {name: values[index] for name, values in columns.items()}
        yield {"id": int(layer.ids[index]), "type": "landuse", **own, "rings": rings}


def land_facts(sketch: Sketch) -> dict[str, Any]:
    """Return a report's entry for each use: the number of areas, and their size (ha)."""
    use, size = (
        np.array(sketch.vector_texts("landuse", "use")),
        shapely.area(sketch.vectors["landuse"].shapes()),
    )
    return {
        name: {"areas": int((use == name).sum()), "hectares": round(float(size[use == name].sum()) / 1e4, 2)}
        for name in LAND_USES
        if (use == name).any()
    }


def land_shares(
    sketch: Sketch, spacing: tuple[float, float], size: tuple[int, int]
) -> npt.NDArray[np.float32]:
    """Return the share of each use around samples (rows, columns) at vertices, row 0 north: (…, uses)."""
    use = [1 + LAND_USES.index(name) for name in sketch.vector_texts("landuse", "use")]
    shapes, (rows, columns), (east, north) = sketch.vectors["landuse"].shapes(), size, spacing
    order = np.argsort(sketch.vectors["landuse"].ids, kind="stable").tolist()
    fine = Affine(east / _PARTS, 0.0, -0.5 * east, 0.0, -north / _PARTS, (rows - 0.5) * north)
    found = rasterize(
        ((shapes[each], use[each]) for each in order),  # the last one is on top
        (_PARTS * rows, _PARTS * columns),
        transform=fine,
        dtype="uint8",
    ).reshape(rows, _PARTS, columns, _PARTS)
    shares = [
        (found == number).mean(axis=(1, 3), dtype=np.float32) for number in range(1, len(LAND_USES) + 1)
    ]
    return np.stack(shares, axis=-1)


def _land_properties(sketch: Sketch) -> dict[str, npt.NDArray[Any]]:
    texts = {name: np.array(sketch.vector_texts("landuse", name), object) for name in _TEXTS}
    return texts | {name: sketch.vector_values("landuse", name) for name in _NUMBERS}
