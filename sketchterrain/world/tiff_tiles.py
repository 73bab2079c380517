"""A world as a folder of Cloud-Optimised GeoTIFF tiles, and a VRT a layer that joins them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sketchterrain.export.files import prepare_folder
from sketchterrain.sketch.files import packed_sketch
from sketchterrain.whole_files import telling_failure, whole_file, write_whole
from sketchterrain.world.cloud_layout import cloud_optimised
from sketchterrain.world.grid import CHUNK
from sketchterrain.world.settled import settle, text_of
from sketchterrain.world.tiff_blocks import means, packed
from sketchterrain.world.tiff_layers import TIFF_LAYERS, Georeference
from sketchterrain.world.tile_names import JOURNAL, LEDGER, SKETCH, tile_name, vrt_name
from sketchterrain.world.vrt import write_vrt

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    import numpy.typing as npt

    from sketchterrain.world.ground import Ground
    from sketchterrain.world.job import Job
    from sketchterrain.world.tiff_layers import TiffLayer

__all__ = ["TileStore", "layer_values", "written_tile"]

# What is smaller needs none; one of half the size would take a quarter more of the disk.
_OVERVIEWS: Final = (4, 8)
_SMALL: Final = 2 * CHUNK


def layer_values(ground: Ground, layer: str) -> npt.NDArray[Any]:
    """Return a layer of a shard as bands, (bands, rows, columns)."""
    values: npt.NDArray[Any] = getattr(ground, layer)
    return values[None] if values.ndim == 2 else values


def written_tile(
    path: Path,
    layer: TiffLayer,
    ground: Ground,
    place: Georeference,
    *,
    overviews: bool,
) -> None:
    """Write a shard of a layer as a Cloud-Optimised GeoTIFF, whole or not at all.

    Parameters
    ----------
    path
    layer
    ground
    place
    overviews
        Whether a large one gets images of its means at a quarter and an eighth of the size.

    Raises
    ------
    SketchterrainError
        If the system cannot write it.
    """
    values = layer_values(ground, layer.name)
    sheets = [packed(layer, values)]
    if overviews and max(values.shape[1:]) > _SMALL:
        sheets += [packed(layer, means(layer, values, factor)) for factor in _OVERVIEWS]
    tags = place.tags(layer, place.of_shard(ground.shard))
    with telling_failure(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as stream:
        for piece in cloud_optimised(sheets, tags):
            stream.write(piece)


class TileStore:
    """Tiles of each layer and level, as :class:`~sketchterrain.world.store.Store` says.

    A layer's folder has a folder a level, of tiles that join without a gap: pixels are vertices. Its VRT
    joins the finest level; the coarser levels, each evaluated for itself, are its overviews. A tile's own
    overviews, for whoever opens it alone, are means of its vertices.

    Parameters
    ----------
    job
    """

    keeps_shards = True

    def __init__(self, job: Job) -> None:
        self.folder = job.output
        self.journal = self.folder / JOURNAL
        self.mark = self.folder / SKETCH
        self._job = job
        self._place = Georeference(job)

    def create(self) -> tuple[str, ...]:
        """Make the folder and write the sketch; see `Store.create`."""
        prepare_folder(self.folder)
        settle(self.mark, packed_sketch(self._job.sketch))
        return (SKETCH,)

    def write(self, ground: Ground) -> tuple[str, ...]:
        """Write the tiles of a shard; see `Store.write`."""
        names = {layer: tile_name(layer, ground.shard) for layer in self._job.layers}
        for layer, name in names.items():
            written_tile(self.folder / name, TIFF_LAYERS[layer], ground, self._place, overviews=True)
        return tuple(names.values())

    def join(self, *, progress: Callable[[float], None]) -> tuple[str, ...]:
        """Write the VRTs; see `Store.join`."""
        levels = self._job.world.levels
        wanted = [(layer, level) for layer in self._job.layers for level in reversed(levels)]
        names = []
        for done, (layer, level) in enumerate(wanted):
            names.append(vrt_name(layer, level.number))
            write_vrt(self.folder / names[-1], TIFF_LAYERS[layer], level, self._place)
            progress((done + 1) / len(wanted))
        return tuple(names)

    def close(self, ledger: str) -> None:
        """Write the ledger, delete the journal; see `Store.close`."""
        write_whole(self.folder / LEDGER, ledger.encode())
        with telling_failure(self.journal):
            self.journal.unlink(missing_ok=True)

    def ledger_text(self) -> str | None:
        """Return the ledger of a finished world; see `Store.ledger_text`."""
        return text_of(self.folder / LEDGER)
