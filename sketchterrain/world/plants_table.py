"""Plants as columns of a table, for files that hold them column by column."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt
    import pyarrow as pa

    from sketchterrain.export.placed_layers import Origin

__all__ = ["FLOATS", "GEOMETRY", "batches_of", "plants_schema"]

GEOMETRY = "geometry"
"""The column of the places as points; ISO WKB, so the height is their z."""
FLOATS = ("x", "y", "z", "nx", "ny", "nz", "scale", "rotation", "tint")
"""Columns that hold fractions."""

_ROWS = 1 << 17  # at once: a row group, which a reader skips or reads as a whole
_POINT_Z = 1001  # ISO WKB's number
_POINT = np.dtype([("order", "u1"), ("kind", "<u4"), ("x", "<f8"), ("y", "<f8"), ("z", "<f8")])


def plants_schema() -> pa.Schema:
    """Return the columns.

    x, y, z: m, in the coordinate reference system; nx, ny, nz: the ground's normal; species: its name;
    scale: 1 is grown; rotation: degrees, counter-clockwise seen from above; tint: 0 to 1; level: those of
    it and above are evenly thinned.
    """
    import pyarrow as pa

    wide = {"x", "y"}
    columns = [(name, pa.float64() if name in wide else pa.float32()) for name in FLOATS]
    species = ("species", pa.dictionary(pa.int8(), pa.string()))
    return pa.schema([(GEOMETRY, pa.binary()), *columns[:6], species, *columns[6:], ("level", pa.int16())])


def batches_of(
    pieces: Iterator[npt.NDArray[np.void]], species: Sequence[str], origin: Origin
) -> Iterator[pa.RecordBatch]:
    """Return plants as rows of the table, in batches of bounded size.

    Parameters
    ----------
    pieces
        Of plants, as :meth:`sketchterrain.Terrain.foliage_pieces` returns them.
    species
        Names that their ``species`` points into.
    origin
    """
    kept: list[npt.NDArray[np.void]] = []
    for piece in pieces:
        rest = piece
        while len(rest):
            room = _ROWS - sum(map(len, kept))
            kept.append(rest[:room])
            rest = rest[room:]
            if sum(map(len, kept)) == _ROWS:
                yield _batch(np.concatenate(kept), species, origin)
                kept = []
    if kept:
        yield _batch(np.concatenate(kept), species, origin)


def _batch(plants: npt.NDArray[np.void], species: Sequence[str], origin: Origin) -> pa.RecordBatch:
    import pyarrow as pa

    x, y = plants["x"] + origin.east, plants["y"] + origin.north
    kinds = pa.DictionaryArray.from_arrays(
        pa.array(plants["species"].astype(np.int8)), pa.array(list(species), pa.string())
    )
    columns: dict[str, Any] = {
        GEOMETRY: _points(x, y, plants["z"]),
        "x": x,
        "y": y,
        "z": plants["z"],
        **{name: plants["normal"][:, axis] for axis, name in enumerate(("nx", "ny", "nz"))},
        "species": kinds,
        "scale": plants["scale"],
        "rotation": np.degrees(plants["rotation"]).astype(np.float32),
        "tint": plants["tint"],
        "level": plants["level"].astype(np.int16),
    }
    arrays = [
        pa.array(np.ascontiguousarray(column)) if isinstance(column, np.ndarray) else column
        for column in columns.values()
    ]
    return pa.RecordBatch.from_arrays(arrays, schema=plants_schema())


def _points(x: npt.NDArray[np.float64], y: npt.NDArray[np.float64], z: npt.NDArray[np.float32]) -> pa.Array:
    """Return places as ISO WKB, without an object for each."""
    import pyarrow as pa

    points = np.zeros(len(x), _POINT)
    points["order"], points["kind"] = 1, _POINT_Z  # little-endian
    points["x"], points["y"], points["z"] = x, y, z
    ends = np.arange(len(x) + 1, dtype=np.int32) * _POINT.itemsize
    buffers = [None, pa.py_buffer(ends), pa.py_buffer(points.tobytes())]
    return pa.Array.from_buffers(pa.binary(), len(x), buffers)
