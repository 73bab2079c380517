"""Stores of a world: what each form of output does, the names of its files, and its small files."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol

from sketchterrain.errors import InputError, SketchterrainError, one_line
from sketchterrain.io.files import wrap_os_errors, write_atomic
from sketchterrain.world.grid import Ground, Shard
from sketchterrain.world.job import Job

if TYPE_CHECKING:  # it loads OpenCL
    from sketchterrain.world.plants import PlantStore

SKETCH: Final = "sketch.sketch"
"""The sketch that a world of GeoTIFFs was made from."""
LEDGER: Final = "ledger.jsonl"
"""All other files, with their hashes."""
JOURNAL: Final = "journal.jsonl"
"""The same while they are being written; of a Zarr store, too."""
TAGS: Final = "sketchterrain"
"""GDAL's metadata domain of what describes a world."""


class Store(Protocol):
    """One form of output of a `Job`, created in each process from the job alone.

    Names of files begin in `folder`. `journal` lists what is done while the world is being written, in a
    folder that `create` makes; whoever writes the world makes it and holds its lock, and `close` deletes it.
    `create` writes the file `mark` first: where it is, a world was begun. `keeps_shards` is whether what
    `write` writes stays, or goes once `join` has made something else of it. Methods raise SketchterrainError
    where the system cannot write a file.
    """

    folder: Path
    journal: Path
    mark: Path
    keeps_shards: bool

    def create(self) -> tuple[str, ...]:
        """Write all that does not depend on any ground, and return the names of its files.

        Again does no harm: a file that is missing or has other bytes is written, whole; no other one is.
        """

    def write(self, ground: Ground) -> tuple[str, ...]:
        """Write one shard, its files whole or not there, and return their names; any number at once."""

    def join(self, *, progress: Callable[[float], None]) -> tuple[str, ...]:
        """Write what joins all shards, once they are there; return the names of its files, if any."""

    def close(self, ledger: str) -> None:
        """Write the ledger's text where it stays, then delete the journal and what is needed no more."""

    def ledger_text(self) -> str | None:
        """Return the ledger of a finished world; None where there is none."""


def require(what: str, modules: Iterable[str]) -> None:
    """Raise SketchterrainError if a module of the extra ``world`` is not installed; none is imported."""
    missing = [module for module in modules if find_spec(module) is None]
    if missing:
        raise SketchterrainError(
            f"{what} needs {' and '.join(missing)}: not installed, "
            "get it with pip install 'sketchterrain[world]'"
        )


def store_of(job: Job) -> Store:
    """Return the store of a job's ground; raise SketchterrainError if a library that it needs is missing."""
    if job.form == "zarr":
        from sketchterrain.world.zarr_store import ZarrStore

        return ZarrStore(job)
    from sketchterrain.world.geotiff_store import TiffStore, TileStore

    return TileStore(job) if job.form == "tiles" else TiffStore(job)


def plants_of(job: Job) -> PlantStore | None:
    """Return the store of a job's plants, None where it has none; see `store_of`."""
    if job.plants == "none":
        return None
    require(f"plants as {job.plants}", ["pyarrow"])
    from sketchterrain.world.plants import PlantStore

    return PlantStore(job)


def tile_name(layer: str, shard: Shard) -> str:
    """Return the name of a shard's GeoTIFF, from the world's folder on."""
    return f"{layer}/level{shard.level}/r{shard.row:04d}_c{shard.column:04d}.tif"


def vrt_name(layer: str, level: int) -> str:
    """Return the name of the file that joins the tiles of a level."""
    return f"{layer}/level{level}.vrt" if level else f"{layer}.vrt"


def layer_file(world: Path, layer: str) -> Path:
    """Return the file of a layer where a world is one file a layer: heights have the world's own name."""
    return world if layer == "height" else world.with_name(f"{world.stem}_{layer}{world.suffix}")


def ledger_file(world: Path) -> Path:
    """Return the ledger of a world that is one file a layer."""
    return world.with_name(f"{world.stem}.{LEDGER}")


def parts_folder(world: Path) -> Path:
    """Return the hidden folder that such a world's shards lie in until they are joined."""
    return world.with_name(f".{world.name}.parts")


def write_if_changed(path: Path, content: bytes) -> None:
    """Write a file, whole, and its folder, unless it is there with just these bytes."""
    with wrap_os_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        same = path.is_file() and path.stat().st_size == len(content) and path.read_bytes() == content
    if not same:
        write_atomic(path, content)


def text_of(path: Path) -> str | None:
    """Return the text of a file, None if there is none."""
    try:
        return path.read_bytes().decode(errors="replace")
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise InputError(f"{one_line(path)}: cannot be read ({one_line(error.strerror or error)})") from None
