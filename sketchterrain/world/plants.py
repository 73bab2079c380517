"""Plants of a world: a GeoParquet or FlatGeobuf file per shard of the finest level."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq
import pyogrio
import shapely
from pyogrio.errors import DataLayerError, DataSourceError
from rasterio.crs import CRS

from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.export.vectors import Origin
from sketchterrain.generation.terrain import Terrain
from sketchterrain.io.crs import plain_path
from sketchterrain.io.files import atomic_path, wrap_os_errors
from sketchterrain.world.grid import SHARD, World
from sketchterrain.world.job import Job, Task, WorldFrame

_GEOMETRY: Final = "geometry"  # points as ISO WKB, with the height as z
_FLOATS: Final = ("x", "y", "z", "nx", "ny", "nz", "scale", "rotation", "tint")
_POSITION: Final = ("x", "y", "z")
_KIND: Final = "Point Z"
_ROWS = 1 << 17  # per row group, the unit that readers skip


class PlantStore:
    """Writer of a job's plants, ``tile_row=3/tile_column=12/plants.parquet`` or ``r0003_c0012.fgb``.

    A square without plants has a file without rows.
    """

    def __init__(self, job: Job) -> None:
        self.folder = job.layout.plants
        self._job = job

    def write(self, task: Task, terrain: Terrain) -> tuple[str, ...]:
        """Write the plants of a square in batches of bounded memory; return the relative names of files."""
        is_parquet = self._job.plants == "parquet"
        name = (
            f"tile_row={task.row}/tile_column={task.column}/plants.parquet"
            if is_parquet
            else f"r{task.row:04d}_c{task.column:04d}.fgb"
        )
        path = self.folder / name
        with wrap_os_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        write = _write_parquet if is_parquet else _write_flatgeobuf
        rows = _batches(self._plants(task, terrain), terrain.species_names, Origin(*self._job.origin))
        write(path, rows, WorldFrame(self._job).crs)
        return (name,)

    def _plants(self, task: Task, terrain: Terrain) -> Iterator[npt.NDArray[np.void]]:
        square = plant_square(self._job.world, task.row, task.column)
        for storey in ("woody", "grass") if self._job.grass else ("woody",):
            yield from terrain.foliage_pieces(*square, storey=storey)


def plant_square(world: World, row: int, column: int) -> tuple[float, float, float, float]:
    """Return west, south, east and north (m) of a shard's plants; east and north are exclusive.

    Edges are bit-equal to those of neighbours; the last shards end at their last vertices.
    """
    level = world.levels[0]

    def edge(number: int, vertices: int) -> float:
        return min(number * SHARD, vertices - 1) * level.cell

    return (
        world.west + edge(column, level.columns),
        world.north - edge(row + 1, level.rows),
        world.west + edge(column + 1, level.columns),
        world.north - edge(row, level.rows),
    )


def _schema() -> pa.Schema:
    columns = [(name, pa.float64() if name in ("x", "y") else pa.float32()) for name in _FLOATS]
    species = ("species", pa.dictionary(pa.int8(), pa.string()))
    return pa.schema([(_GEOMETRY, pa.binary()), *columns[:6], species, *columns[6:], ("level", pa.int16())])


def _batches(
    pieces: Iterator[npt.NDArray[np.void]], species: Sequence[str], origin: Origin
) -> Iterator[pa.RecordBatch]:
    buffered: list[npt.NDArray[np.void]] = []
    for piece in pieces:
        rest = piece
        while len(rest):
            missing = _ROWS - sum(map(len, buffered))
            buffered.append(rest[:missing])
            rest = rest[missing:]
            if sum(map(len, buffered)) == _ROWS:
                yield _batch(np.concatenate(buffered), species, origin)
                buffered = []
    if buffered:
        yield _batch(np.concatenate(buffered), species, origin)


def _batch(plants: npt.NDArray[np.void], species: Sequence[str], origin: Origin) -> pa.RecordBatch:
    x, y = plants["x"] + origin.east, plants["y"] + origin.north
    columns: dict[str, Any] = {
        _GEOMETRY: pa.array(shapely.to_wkb(shapely.points(x, y, plants["z"]), flavor="iso"), pa.binary()),
        "x": x,
        "y": y,
        "z": plants["z"],
        **{name: plants["normal"][:, axis] for axis, name in enumerate(("nx", "ny", "nz"))},
        "species": pa.DictionaryArray.from_arrays(plants["species"].astype(np.int8), list(species)),
        "scale": plants["scale"],
        "rotation": np.degrees(plants["rotation"]).astype(np.float32),
        "tint": plants["tint"],
        "level": plants["level"].astype(np.int16),
    }
    arrays = [
        pa.array(np.ascontiguousarray(column)) if isinstance(column, np.ndarray) else column
        for column in columns.values()
    ]
    return pa.RecordBatch.from_arrays(arrays, schema=_schema())


def _write_parquet(path: Path, batches: Iterator[pa.RecordBatch], crs: CRS) -> None:
    """Write GeoParquet 1.1, one row group per batch; BYTE_STREAM_SPLIT saves a third of the bytes."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    with (
        atomic_path(path) as temporary,
        pq.ParquetWriter(
            temporary,
            _schema(),
            compression="zstd",
            use_dictionary=["species"],
            use_byte_stream_split=list(_FLOATS),
            write_statistics=[*_FLOATS, "species", "level"],
        ) as file,
    ):
        for batch in batches:
            file.write_batch(batch)
            points = np.stack([batch[name].to_numpy() for name in _POSITION])
            low, high = np.minimum(low, points.min(axis=1)), np.maximum(high, points.max(axis=1))
        column = {"encoding": "WKB", "geometry_types": [_KIND], "crs": crs.to_dict(projjson=True)}
        if np.isfinite(low).all():
            column["bbox"] = [*low.tolist(), *high.tolist()]
        geo = {"version": "1.1.0", "primary_column": _GEOMETRY, "columns": {_GEOMETRY: column}}
        file.add_key_value_metadata({"geo": json.dumps(geo)})


def _write_flatgeobuf(path: Path, batches: Iterator[pa.RecordBatch], crs: CRS) -> None:
    """Write FlatGeobuf in the order of its index: all rows in memory, and temporarily twice on the disk."""
    table = pa.Table.from_batches(batches, _schema()).drop_columns(list(_POSITION))
    species = table["species"].cast(pa.string())  # GDAL does not support dictionaries
    table = table.set_column(table.schema.get_field_index("species"), "species", species)
    with atomic_path(path) as temporary:
        named = temporary.with_suffix(".fgb")  # with another extension the driver creates a folder
        try:
            with plain_path(named.parent) as folder:
                pyogrio.write_arrow(
                    table,
                    folder / named.name,
                    layer="plants",
                    driver="FlatGeobuf",
                    geometry_name=_GEOMETRY,
                    geometry_type=_KIND,
                    crs=crs.to_wkt(),
                    SPATIAL_INDEX="YES",
                )
                _check_rows(folder / named.name, table.num_rows)
            named.replace(temporary)
        except (DataLayerError, DataSourceError, pa.ArrowException) as error:
            raise SketchterrainError(f"{one_line(path)}: cannot be written ({one_line(error)})") from error
        finally:
            named.unlink(missing_ok=True)


def _check_rows(path: Path, rows: int) -> None:
    """Raise OSError unless all rows are on the disk: GDAL does not report errors on closing."""
    last = {"skip_features": rows - 1, "max_features": 1} if rows else {}
    info = pyogrio.read_info(path)
    _, _, geometry, _ = pyogrio.raw.read(path, **last)
    if max(info["features"], 0) != rows or len(geometry) != min(rows, 1):  # −1 without rows
        raise OSError("incomplete file on the disk")
