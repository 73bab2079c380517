"""A world written as GeoTIFF: a folder of tiles joined by VRTs, or one file a layer. All are Cloud-Optimised.

GDAL's driver COG takes the overviews of the VRT that it copies, to the bit: so the levels, each evaluated for
itself, are the overviews of a file (its documentation: "COG -- Cloud Optimized GeoTIFF generator" and "VRT --
GDAL Virtual Format").
"""

import json
import os
import shutil
import subprocess
import sys
import time
from base64 import b64encode
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import escape, quoteattr

import rasterio
import rasterio.shutil
from rasterio.enums import Resampling
from rasterio.errors import RasterioError
from rasterio.io import MemoryFile

from sketchterrain.document.parameters import MATERIALS
from sketchterrain.document.store import pack_sketch
from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.export.files import prepare_folder
from sketchterrain.io.files import atomic_path, wrap_os_errors, write_atomic
from sketchterrain.world import store
from sketchterrain.world.grid import CHUNK, LAYER_SPECS, SHARD, Ground, Level, Shard
from sketchterrain.world.job import Georeference, Job

# Of a tile. What is smaller needs none; one of half the size would take a quarter more of the disk.
_OVERVIEWS: Final = (4, 8)
_SMALL: Final = 2 * CHUNK
# A level of 6 takes twice the time to save a fiftieth.
_COG: Final = {
    "driver": "COG",
    "COMPRESS": "DEFLATE",
    "LEVEL": "1",
    "BLOCKSIZE": str(CHUNK),
    "BIGTIFF": "IF_SAFER",
    "COPY_SRC_MDD": "YES",
}
_COLOURS: Final = ("Red", "Green", "Blue")
_TILE: Final = {"driver": "GTiff", "tiled": True, "blockxsize": CHUNK, "blockysize": CHUNK}
# Until they are joined, shards are packed for speed.
_PART: Final = {"compress": "zstd", "zstd_level": 1, "interleave": "pixel"}
_COPY: Final = "import json, sys, rasterio.shutil as s; s.copy(*sys.argv[1:3], **json.loads(sys.argv[3]))"


class TileStore:
    """Tiles of each layer and level; see `sketchterrain.world.store.Store`.

    A layer's VRT joins the finest level; the coarser levels, each evaluated for itself, are its overviews. A
    tile's own overviews, for whoever opens it alone, are means of its vertices.
    """

    keeps_shards = True

    def __init__(self, job: Job) -> None:
        self._job, self._place = job, Georeference(job)
        self.folder, self._tiles, self._ledger = self._paths(job.output)
        self.journal, self.mark = self._tiles / store.JOURNAL, self._tiles / store.SKETCH

    @staticmethod
    def _paths(output: Path) -> tuple[Path, Path, Path]:
        """Return the folder that names of files begin in, that of the tiles, and the ledger."""
        return output, output, output / store.LEDGER

    def create(self) -> tuple[str, ...]:
        """Make the folder of the tiles and write the sketch; see `Store.create`."""
        prepare_folder(self._tiles)
        store.write_if_changed(self.mark, pack_sketch(self._job.sketch))
        return (store.SKETCH,) if self.keeps_shards else ()

    def write(self, ground: Ground) -> tuple[str, ...]:
        """Write the tiles of a shard; see `Store.write`."""
        paths = {layer: self._tiles / store.tile_name(layer, ground.shard) for layer in self._job.layers}
        for layer, path in paths.items():
            _write_tile(path, layer, ground, self._place, optimised=self.keeps_shards)
        return tuple(path.relative_to(self.folder).as_posix() for path in paths.values())

    def join(self, *, progress: Callable[[float], None]) -> tuple[str, ...]:
        """Write the VRTs; see `Store.join`."""
        names = _write_vrts(self._tiles, self._place)
        progress(1.0)
        return names

    def close(self, ledger: str) -> None:
        """Write the ledger, delete what is needed no more; see `Store.close`."""
        write_atomic(self._ledger, ledger.encode())
        with wrap_os_errors(self.journal):
            self.journal.unlink(missing_ok=True)
            if not self.keeps_shards:
                shutil.rmtree(self._tiles)

    def ledger_text(self) -> str | None:
        """Return the ledger of a finished world; see `Store.ledger_text`."""
        return store.text_of(self._ledger)


class TiffStore(TileStore):
    """One file a layer, ``world.tif``, ``world_normal.tif`` and ``world_materials.tif``; see `Store`.

    Each has the coarser levels as its overviews; the sketch is in the metadata of the heights. Until they are
    joined, tiles are kept in a hidden folder beside the file: for that time the disk holds everything twice.
    """

    keeps_shards = False

    @staticmethod
    def _paths(output: Path) -> tuple[Path, Path, Path]:
        return output.parent, store.parts_folder(output), store.ledger_file(output)

    def join(self, *, progress: Callable[[float], None]) -> tuple[str, ...]:
        """Write the files; see `Store.join`."""
        paths = [store.layer_file(self._job.output, layer) for layer in self._job.layers]
        sketch = b64encode(self.mark.read_bytes()).decode()
        _write_vrts(self._tiles, self._place, sketch)
        for done, (layer, path) in enumerate(zip(self._job.layers, paths, strict=True)):
            self._join(layer, path, done / len(paths), progress)
        progress(1.0)
        return tuple(path.name for path in paths)

    def _join(self, layer: str, path: Path, begun: float, progress: Callable[[float], None]) -> None:
        """Copy a layer's VRT in a process of its own, which ends at once if `progress` raises."""
        options = _COG | {"OVERVIEWS": "FORCE_USE_EXISTING", "NUM_THREADS": "ALL_CPUS"}
        options["PREDICTOR"] = LAYER_SPECS[layer].predictor
        expected = sum(file.stat().st_size for file in (self._tiles / layer).rglob("*.tif"))
        source = self._tiles / store.vrt_name(layer, 0)
        with atomic_path(path) as temporary:
            command = [sys.executable, "-c", _COPY, str(source), str(temporary), json.dumps(options)]
            environment = os.environ | {"GDAL_CACHEMAX": "128"}  # MB
            pipe: dict[str, Any] = {"stderr": subprocess.PIPE, "text": True, "errors": "replace"}
            with subprocess.Popen(command, env=environment, **pipe) as process:  # noqa: S603
                try:
                    while process.poll() is None:
                        time.sleep(0.05)
                        written = temporary.stat().st_size if temporary.exists() else 0
                        share = min(written / max(expected, 1), 0.99)
                        progress(begun + share / len(self._job.layers))
                finally:
                    process.kill()
                _, told = process.communicate()
            if process.returncode != 0:
                reason = (told.strip().splitlines() or ["GDAL ended early"])[-1].rpartition("Error: ")[2]
                raise SketchterrainError(f"{one_line(path)}: cannot be written ({one_line(reason)})")


def _write_tile(path: Path, layer: str, ground: Ground, place: Georeference, *, optimised: bool) -> None:
    """Write a shard of a layer, whole or not at all; a large one that is optimised has overviews."""
    spec, values = LAYER_SPECS[layer], getattr(ground, layer)
    values = values[None] if values.ndim == 2 else values
    level = place.job.world.levels[ground.shard.level]
    count, height, width = values.shape
    profile = _TILE | {"dtype": spec.dtype, "count": count, "height": height, "width": width}
    profile |= {"crs": place.crs, "transform": place.transform(level, ground.shard)}
    profile |= {"photometric": "rgb" if layer == "normal" else "minisblack"}
    profile |= {} if optimised else _PART
    try:
        with rasterio.Env(), MemoryFile() as plain, MemoryFile() as packed:
            with plain.open(**profile) as file:
                file.write(values)
                file.update_tags(AREA_OR_POINT="Point")
                file.descriptions = spec.bands
                if layer == "height":
                    file.units = ("m",)
                if optimised and max(values.shape) > _SMALL:
                    file.build_overviews(_OVERVIEWS, Resampling.average)
            if optimised:
                kept = "FORCE_USE_EXISTING" if max(values.shape) > _SMALL else "NONE"
                options = _COG | {"OVERVIEWS": kept, "PREDICTOR": spec.predictor, "NUM_THREADS": "1"}
                rasterio.shutil.copy(plain.name, packed.name, **options)
            content = bytes((packed if optimised else plain).getbuffer())
    except RasterioError as error:
        raise SketchterrainError(f"{one_line(path)}: cannot be written ({one_line(error)})") from None
    store.write_if_changed(path, content)


def _write_vrts(folder: Path, place: Georeference, sketch: str | None = None) -> tuple[str, ...]:
    """Write the VRT of each layer and level, the coarsest first; return their names."""
    names = []
    for layer, level in product(place.job.layers, reversed(place.job.world.levels)):
        names.append(store.vrt_name(layer, level.number))
        lines = _vrt(layer, level, place, sketch if names[-1] == store.vrt_name("height", 0) else None)
        store.write_if_changed(folder / names[-1], "".join(f"{line}\n" for line in lines).encode())
    return tuple(names)


def _vrt(layer: str, level: Level, place: Georeference, sketch: str | None) -> Iterator[str]:
    """Return the lines of a VRT, a few hundred bytes for each tile and band. No tile is opened."""
    spec = LAYER_SPECS[layer]
    kind = {"float32": "Float32", "uint8": "Byte"}[spec.dtype]
    yield f'<VRTDataset rasterXSize="{level.columns}" rasterYSize="{level.rows}">'
    yield f'  <SRS dataAxisToSRSAxisMapping="1,2">{escape(place.crs.to_wkt())}</SRS>'
    corners = ", ".join(repr(float(number)) for number in place.transform(level).to_gdal())
    yield f"  <GeoTransform>{corners}</GeoTransform>"
    yield '  <Metadata><MDI key="AREA_OR_POINT">Point</MDI></Metadata>'
    yield f"  <Metadata domain={quoteattr(store.TAGS)}>"
    world = place.job.world
    facts = {name: repr(float(getattr(world, name))) for name in ("west", "south", "east", "north", "cell")}
    facts |= {"layers": ",".join(place.job.layers), "materials": ",".join(MATERIALS)}
    for key, text in (facts if sketch is None else facts | {"sketch": sketch}).items():
        yield f"    <MDI key={quoteattr(key)}>{escape(text)}</MDI>"
    yield "  </Metadata>"
    blocks = f'blockXSize="{CHUNK}" blockYSize="{CHUNK}"'
    for index, band in enumerate(spec.bands):
        yield f'  <VRTRasterBand dataType="{kind}" band="{index + 1}" {blocks}>'
        yield f"    <Description>{escape(band)}</Description>"
        if layer == "height":
            yield "    <UnitType>m</UnitType>"
        colour = _COLOURS[index] if layer == "normal" else ("Undefined" if index else "Gray")
        yield f"    <ColorInterp>{colour}</ColorInterp>"
        yield from _sources(layer, level, index + 1, kind)
        for other in place.job.world.levels[1:] if level.number == 0 else ():
            name = _file(store.vrt_name(layer, other.number))
            yield f"    <Overview>{name}<SourceBand>{index + 1}</SourceBand></Overview>"
        yield "  </VRTRasterBand>"
    yield "</VRTDataset>"


def _sources(layer: str, level: Level, band: int, kind: str) -> Iterator[str]:
    for row, column in product(*map(range, level.shards)):
        shard = Shard(level.number, row, column)
        rows, columns = level.size_of(shard)
        size, name = f'xSize="{columns}" ySize="{rows}"', store.tile_name(layer, shard)
        raster = f'RasterXSize="{columns}" RasterYSize="{rows}" DataType="{kind}"'
        yield "    <SimpleSource>"
        yield f"      {_file(name if level.number == 0 else name.partition('/')[2])}"
        yield f"      <SourceBand>{band}</SourceBand>"
        yield f'      <SourceProperties {raster} BlockXSize="{CHUNK}" BlockYSize="{CHUNK}"/>'
        yield f'      <SrcRect xOff="0" yOff="0" {size}/>'
        yield f'      <DstRect xOff="{column * SHARD}" yOff="{row * SHARD}" {size}/>'
        yield "    </SimpleSource>"


def _file(name: str) -> str:
    """Return the reference to a file by its name from the VRT's folder on."""
    return f'<SourceFilename relativeToVRT="1">{escape(name)}</SourceFilename>'
