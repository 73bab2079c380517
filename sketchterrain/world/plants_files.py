"""Plants of one square as a file: GeoParquet, or FlatGeobuf."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.gdal_paths import plain_path
from sketchterrain.whole_files import whole_path
from sketchterrain.world.plants_table import FLOATS, GEOMETRY, plants_schema

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    import pyarrow as pa
    from rasterio.crs import CRS

__all__ = ["write_flatgeobuf", "write_parquet"]

_GEOPARQUET: Final = "1.1.0"
_KIND: Final = "Point Z"
_LAYER: Final = "plants"
_PLACE: Final = ("x", "y", "z")


def write_parquet(path: Path, batches: Iterator[pa.RecordBatch], crs: CRS) -> None:
    """Write plants as GeoParquet (its specification, version 1.1): a row group a batch.

    Fractions are stored byte by byte ("BYTE_STREAM_SPLIT"), which takes two thirds of the bytes. The same
    plants give the same bytes.

    Parameters
    ----------
    path
    batches
        With the columns of `plants_schema`; may be none.
    crs

    Raises
    ------
    SketchterrainError
        If the system cannot write it.
    """
    import pyarrow.parquet as pq

    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    with (
        whole_path(path) as temporary,
        pq.ParquetWriter(
            temporary,
            plants_schema(),
            compression="zstd",
            use_dictionary=["species"],
            use_byte_stream_split=list(FLOATS),
            write_statistics=[*FLOATS, "species", "level"],
        ) as file,
    ):
        for batch in batches:
            file.write_batch(batch)
            places = np.stack([batch[name].to_numpy() for name in _PLACE])
            low, high = np.minimum(low, places.min(axis=1)), np.maximum(high, places.max(axis=1))
        file.add_key_value_metadata({"geo": json.dumps(_geo(crs, [*low.tolist(), *high.tolist()]))})


def write_flatgeobuf(path: Path, batches: Iterator[pa.RecordBatch], crs: CRS) -> None:
    """Write plants as FlatGeobuf, with a spatial index.

    By GDAL's driver FlatGeobuf (its documentation: "FlatGeobuf"), in the order of the index. It keeps some
    tens of bytes a plant in memory, and for a while the file is on the disk twice. Places are points alone,
    not columns too. The same plants give the same bytes.

    Parameters
    ----------
    path
    batches
        With the columns of `plants_schema`; may be none.
    crs

    Raises
    ------
    SketchterrainError
        If the system cannot write it.
    """
    import pyarrow as pa
    import pyogrio
    from pyogrio.errors import DataLayerError, DataSourceError

    columns = [field for field in plants_schema() if field.name not in _PLACE]
    # GDAL takes no dictionaries.
    schema = pa.schema(
        pa.field("species", pa.string()) if field.name == "species" else field for field in columns
    )
    stream = _Stream(batches)
    with whole_path(path) as temporary:
        # The driver makes a folder unless the name ends so.
        named = temporary.with_suffix(".fgb")
        try:
            with plain_path(named.parent) as folder:
                place = folder / named.name
                pyogrio.write_arrow(
                    pa.RecordBatchReader.from_batches(
                        schema, (batch.select(schema.names).cast(schema) for batch in stream)
                    ),
                    place,
                    layer=_LAYER,
                    driver="FlatGeobuf",
                    geometry_name=GEOMETRY,
                    geometry_type=_KIND,
                    crs=crs.to_wkt(),
                    SPATIAL_INDEX="YES",
                )
                _check(place, stream.rows)
            named.replace(temporary)
        except Exception as error:
            if stream.error is not None:
                raise stream.error from None
            if isinstance(error, DataLayerError | DataSourceError | pa.ArrowException | OSError):
                raise SketchterrainError(
                    f"{one_line(path)}: cannot be written ({one_line(error)})"
                ) from error
            raise
        finally:
            named.unlink(missing_ok=True)


class _Stream:
    """Batches on their way through libraries that would change an error into one of theirs."""

    def __init__(self, batches: Iterator[pa.RecordBatch]) -> None:
        self._batches = batches
        self.rows = 0
        self.error: BaseException | None = None

    def __iter__(self) -> Iterator[pa.RecordBatch]:
        try:
            for batch in self._batches:
                self.rows += batch.num_rows
                yield batch
        except GeneratorExit:
            raise
        except BaseException as error:
            self.error = error
            raise


def _check(path: Path, rows: int) -> None:
    """Find out whether all came to the disk: what fails when a file is closed, GDAL does not tell."""
    import pyogrio

    last = {"skip_features": rows - 1, "max_features": 1} if rows else {}
    info = pyogrio.read_info(path)
    _, _, geometry, _ = pyogrio.raw.read(path, **last)
    if max(info["features"], 0) != rows or len(geometry) != min(rows, 1):  # −1 where there is none
        raise OSError("not all of it came to the disk")


def _geo(crs: CRS, box: list[float]) -> dict[str, Any]:
    """Return what GeoParquet says of the column of places; the box is west, south, low, east, north, high."""
    column: dict[str, Any] = {
        "encoding": "WKB",
        "geometry_types": [_KIND],
        "crs": crs.to_dict(projjson=True),
    }
    if np.isfinite(box).all():
        column["bbox"] = box
    return {"version": _GEOPARQUET, "primary_column": GEOMETRY, "columns": {GEOMETRY: column}}
