"""What the files of a world of GeoTIFFs are called."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.world.grid import Shard

SKETCH: Final = "sketch.sketch"
"""The sketch that the world was made from."""
LEDGER: Final = "ledger.jsonl"
"""All other files, with their hashes."""
JOURNAL: Final = "journal.jsonl"
"""The same while they are being written; of a Zarr store, too."""
TAGS: Final = "sketchterrain"
"""GDAL's metadata domain of what describes a world."""


def tile_name(layer: str, shard: Shard) -> str:
    """Return the name of a shard's file, from the world's folder on."""
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
