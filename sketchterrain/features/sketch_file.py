"""Tables of features as FlatGeobuf files: vector layers in the sketch's frame, and others."""

import io
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError, one_line
from sketchterrain.features.table import AREA, KINDS, LINE, Column, VectorLayer
from sketchterrain.schema.layers import VECTOR_LAYERS

SUFFIX = ".fgb"
EDITS = "drapes.fgb"
"""The file of edits of draped layers."""

_MAGIC = b"fgb\x03fgb"
_MULTI = {4: "points", 5: "lines", 6: "areas", 7: "shapes"}  # shapely's type ids
_LEAST_BYTES = 16  # of a feature
_ERRORS = (RuntimeError, ValueError, LookupError, OSError, MemoryError)  # of damaged files
_MAX_MESSAGE = 160  # characters of GDAL's


def vector_files() -> tuple[str, ...]:
    """Return the names of the files of vector layers, and of edits of draped ones."""
    return (*(f"{name}{SUFFIX}" for name in VECTOR_LAYERS), EDITS)


def encode_vectors(layer: VectorLayer, frame: Mapping[str, Any]) -> bytes:
    """Return a layer as a FlatGeobuf file with coordinates in the frame; equal layers give equal bytes."""
    import shapely

    corner = np.array([frame["east"], frame["north"]])
    columns = {"id": layer.ids, "label": layer.labels.astype(np.int32), **layer.columns}
    wkb = shapely.to_wkb(shapely.transform(layer.shapes(), lambda points: points + corner))
    return encode_table(layer.layer, wkb, columns, geometry_type=geometry_type(layer), crs=frame["crs"])


def encode_table(
    name: str,
    wkb: npt.NDArray[np.object_],
    columns: Mapping[str, Column],
    *,
    geometry_type: str = "Unknown",
    crs: str = "",
) -> bytes:
    """Return geometries, None for those without, and columns as a FlatGeobuf file in this order."""
    import pyogrio

    stream = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a layer without a CRS
        pyogrio.raw.write(
            stream,
            wkb,
            [
                np.array(column, dtype=object) if isinstance(column, tuple) else column
                for column in columns.values()
            ],
            list(columns),
            driver="FlatGeobuf",
            geometry_type=geometry_type,
            crs=crs or None,
            layer=name,
            layer_options={"SPATIAL_INDEX": "NO"},  # keeps the order
        )
    return stream.getvalue()


def geometry_type(layer: VectorLayer) -> str:
    """Return OGR's name of the type of all features."""
    kinds = set(layer.kinds.tolist())
    return {frozenset({LINE}): "LineString", frozenset({AREA}): "Polygon"}.get(frozenset(kinds), "Unknown")


def decode_vectors(data: bytes, name: str, frame: Mapping[str, Any]) -> VectorLayer:
    """Return the layer of a FlatGeobuf file; raise InputError if it is damaged, or not in the frame's CRS.

    The properties id and label may be missing; unknown ones are kept.
    """
    import shapely

    crs, shapes, columns = decode_table(data)
    _check_crs(crs, frame)
    kinds = shapely.get_type_id(shapes)
    if np.isin(kinds, list(_MULTI)).any():
        what = _MULTI[int(kinds[np.isin(kinds, list(_MULTI))][0])]
        raise InputError(f"expected single {' or '.join(KINDS)} features, not features of several {what}")
    ids, labels = (_whole(columns.pop(key, None), key) for key in ("id", "label"))
    corner = np.array([frame["east"], frame["north"]])
    with np.errstate(over="ignore"):  # checked by the layer
        shapes = shapely.transform(shapes, lambda points: points - corner)
        return VectorLayer.from_shapes(name, shapes, ids=ids, labels=labels, columns=columns)


def decode_table(data: bytes) -> tuple[str | None, npt.NDArray[np.object_], dict[str, Column]]:
    """Return CRS, geometries and columns of a FlatGeobuf file; raise InputError if it is damaged."""
    import pyogrio
    import shapely

    if not data.startswith(_MAGIC[:3]):
        raise InputError("expected a FlatGeobuf file")
    try:
        with warnings.catch_warnings(), np.errstate(invalid="ignore"):
            warnings.simplefilter("ignore")
            count = pyogrio.read_info(data, layer=0)["features"]
            if count > len(data) // _LEAST_BYTES:  # memory for as many is allocated
                raise InputError(f"not a whole FlatGeobuf file ({count} features in {len(data)} bytes)")
            meta, _, wkb, fields = pyogrio.raw.read(data, layer=0, force_2d=True, datetime_as_string=True)
            if len(wkb) < count:
                raise InputError(f"not a whole FlatGeobuf file ({len(wkb)} of {count} features)")
            shapes = np.asarray(shapely.from_wkb(wkb), dtype=object)
    except (*_ERRORS, shapely.errors.GEOSException) as error:
        raise InputError(f"not a whole FlatGeobuf file ({one_line(error)[:_MAX_MESSAGE]})") from None
    columns = {str(key): _column(values) for key, values in zip(meta["fields"], fields, strict=True)}
    return meta["crs"], shapes, columns


def _check_crs(found: str | None, frame: Mapping[str, Any]) -> None:
    if found is None or found == frame["crs"]:
        return
    from sketchterrain.io.crs import parse_crs

    if not frame["crs"] or parse_crs(found) != parse_crs(frame["crs"]):
        own = frame["crs"] or "no CRS"
        raise InputError(
            f"its CRS is {one_line(found)[:60]}: expected that of the sketch, {one_line(own)[:60]}"
        )


def _column(values: np.ndarray[Any, Any]) -> Column:
    if values.dtype.kind == "f":
        return values.astype(np.float64)
    if values.dtype.kind in "iub":
        return values.astype(np.int64)
    return tuple("" if value is None else str(value) for value in values.tolist())


def _whole(column: Column | None, name: str) -> np.ndarray[Any, Any] | None:
    if column is None:
        return None
    values = np.asarray(column)
    if values.dtype.kind not in "if" or (values != np.rint(values)).any() or (np.abs(values) > 2**31).any():
        raise InputError(f"property {name}: expected whole numbers")
    if name == "label" and ((values < 1) | (values > 255)).any():
        raise InputError("property label: expected whole numbers from 1 to 255")
    return values.astype(np.int64 if name == "id" else np.uint8)
