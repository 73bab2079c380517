"""Which groups and arrays a world is in a Zarr store, and their metadata, by Zarr core specification 3."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sketchterrain.terrain.materials import MATERIALS
from sketchterrain.world.grid import CHUNK, SHARD
from sketchterrain.world.zarr_shards import Packing

if TYPE_CHECKING:
    from sketchterrain.world.grid import Level, Shard

__all__ = [
    "COORDINATE",
    "COORDINATES_AT_ONCE",
    "LAYERS",
    "METADATA",
    "StoredLayer",
    "bytes_document",
    "coordinate_document",
    "encoded",
    "group_document",
    "layer_document",
    "scalar_document",
    "shard_file",
]

METADATA: Final = "zarr.json"
"""The file of a group's or array's metadata, in its folder."""
COORDINATES_AT_ONCE: Final = 65536
"""Of an array of coordinates, in a chunk at most."""
COORDINATE: Final = Packing("float64", "shuffle", 5)
"""How coordinates are packed."""


class StoredLayer(NamedTuple):
    """An array of each level.

    Attributes
    ----------
    name : str
    bands : tuple of str
        What its first dimension holds, one by one; empty: it has rows and columns alone.
    band : str
        The name of that dimension.
    packing : Packing
        Chosen by what the benchmark ``packing`` shows: bytes against time.
    fill : float
        Of vertices beyond the array; NaN for heights, so that what is lost is no sea level.
    attributes : dict
    """

    name: str
    bands: tuple[str, ...]
    band: str
    packing: Packing
    fill: float
    attributes: dict[str, Any]

    def shape(self, rows: int, columns: int) -> tuple[int, ...]:
        """Return the shape of so many vertices."""
        return (len(self.bands), rows, columns) if self.bands else (rows, columns)


LAYERS: Final = {
    "height": StoredLayer(
        "height",
        (),
        "",
        Packing("float32", "shuffle", 3, block=4 * CHUNK * CHUNK),
        float("nan"),
        {"long_name": "height of the ground", "units": "m"},
    ),
    "normal": StoredLayer(
        "normal",
        ("east", "north", "up"),
        "axis",
        Packing("uint8", "bitshuffle", 1, block=3 * CHUNK * CHUNK),
        0,
        {
            "long_name": "unit vector up from the ground: east, north, up",
            "axes": ["east", "north", "up"],
            "units": "1",
            "scale_factor": 1 / 127.5,
            "add_offset": -1.0,
        },
    ),
    "materials": StoredLayer(
        "materials",
        MATERIALS,
        "material",
        Packing("uint8", "noshuffle", 1, block=len(MATERIALS) * CHUNK * CHUNK),
        0,
        {
            "long_name": "share of each material, of 1 in all",
            "materials": list(MATERIALS),
            "units": "1",
            "scale_factor": 1 / 255,
        },
    ),
}
"""By name; what they hold is told in `Ground`."""


def encoded(document: dict[str, Any]) -> bytes:
    """Return metadata as the content of its file; the same metadata gives the same bytes."""
    return (json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()


def group_document(
    attributes: dict[str, Any], members: dict[str, dict[str, Any]] | None = None
) -> dict[str, Any]:
    """Return the metadata of a group.

    Parameters
    ----------
    attributes
    members
        Metadata of all that is in it, by path, to be read at once: consolidated, as zarr-python has it
        (its user guide: "Consolidated metadata"); xarray asks for that.
    """
    document = {"zarr_format": 3, "node_type": "group", "attributes": attributes}
    if members is not None:
        kind = {"kind": "inline", "must_understand": False}
        document["consolidated_metadata"] = kind | {"metadata": members}
    return document


def layer_document(layer: StoredLayer, level: Level, attributes: dict[str, Any]) -> dict[str, Any]:
    """Return the metadata of a layer of a level."""
    sharding = {
        "chunk_shape": layer.shape(CHUNK, CHUNK),
        "codecs": layer.packing.codecs,
        "index_codecs": [{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "crc32c"}],
        "index_location": "end",
    }
    return _array_document(
        layer.shape(level.rows, level.columns),
        layer.packing.dtype,
        chunk=layer.shape(SHARD, SHARD),
        fill="NaN" if layer.packing.dtype == "float32" else 0,
        codecs=[{"name": "sharding_indexed", "configuration": sharding}],
        dimensions=(layer.band, "y", "x") if layer.bands else ("y", "x"),
        attributes=layer.attributes | attributes,
    )


def coordinate_document(name: str, count: int, attributes: dict[str, Any]) -> dict[str, Any]:
    """Return the metadata of the coordinates along a dimension of that name."""
    return _array_document(
        (count,),
        COORDINATE.dtype,
        chunk=(min(count, COORDINATES_AT_ONCE),),
        fill="NaN",
        codecs=COORDINATE.codecs,
        dimensions=(name,),
        attributes=attributes,
    )


def bytes_document(name: str, count: int, attributes: dict[str, Any]) -> dict[str, Any]:
    """Return the metadata of an array that is so many bytes as they are: its chunk is a file of their own."""
    return _array_document(
        (count,),
        "uint8",
        chunk=(max(count, 1),),
        fill=0,
        codecs=[{"name": "bytes"}],
        dimensions=(f"{name}_byte",),
        attributes=attributes,
    )


def scalar_document(attributes: dict[str, Any]) -> dict[str, Any]:
    """Return the metadata of a 32-bit number that carries attributes."""
    return _array_document(
        (),
        "int32",
        chunk=(),
        fill=0,
        codecs=[{"name": "bytes", "configuration": {"endian": "little"}}],
        dimensions=(),
        attributes=attributes,
    )


def shard_file(layer: str, shard: Shard) -> str:
    """Return the name of a shard's file of a layer, from the store's folder on."""
    first = "0/" if LAYERS[layer].bands else ""
    return f"{shard.level}/{layer}/c/{first}{shard.row}/{shard.column}"


def _array_document(
    shape: tuple[int, ...],
    dtype: str,
    *,
    chunk: tuple[int, ...],
    fill: float | str,
    codecs: list[dict[str, Any]],
    dimensions: tuple[str, ...],
    attributes: dict[str, Any],
) -> dict[str, Any]:
    return {
        "zarr_format": 3,
        "node_type": "array",
        "shape": list(shape),
        "data_type": dtype,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": list(chunk)}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "fill_value": fill,
        "codecs": codecs,
        "dimension_names": list(dimensions),
        "attributes": attributes,
    }
