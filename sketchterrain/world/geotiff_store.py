"""GeoTIFF output of worlds: a folder of tiles joined by VRTs, or one file per layer, all Cloud-Optimised.

GDAL's driver COG copies the overviews of its source VRT bit for bit, so separately evaluated levels become
the overviews of a file (GDAL documentation of the drivers COG and VRT).
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

from sketchterrain.document.store import pack_sketch
from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.export.files import prepare_folder
from sketchterrain.io.files import atomic_path, wrap_os_errors, write_atomic
from sketchterrain.world.grid import CHUNK, LAYER_SPECS, SHARD, GridLevel, Shard, ShardData
from sketchterrain.world.job import (
    SKETCH,
    TAGS,
    Job,
    WorldFrame,
    layer_file,
    tile_name,
    vrt_name,
    write_if_changed,
)

_OVERVIEWS: Final = (4, 8)  # of a tile; a factor of 2 would take 25 % more disk space
_SMALL: Final = 2 * CHUNK  # tiles up to this size have no overviews
# Level 6 takes twice the time and saves 2 %.
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
# Fast compression of shards until they are joined.
_PART: Final = {"compress": "zstd", "zstd_level": 1, "interleave": "pixel"}
_COPY: Final = "import json, sys, rasterio.shutil as s; s.copy(*sys.argv[1:3], **json.loads(sys.argv[3]))"


class TileStore:
    """Store of a tile per layer, level and shard; the coarser levels are the overviews of a layer's VRT.

    A tile's own overviews, for readers of single tiles, are means of its vertices.
    """

    shards_are_final = True  # False: `join` replaces them

    def __init__(self, job: Job) -> None:
        self._job, self._georeference = job, WorldFrame(job)
        self.folder, self._tiles = job.layout.folder, job.layout.journal.parent

    def create(self) -> tuple[str, ...]:
        """Create the folder of the tiles and write the sketch if changed; return names of final files."""
        prepare_folder(self._tiles)
        write_if_changed(self._tiles / SKETCH, pack_sketch(self._job.sketch))
        return (SKETCH,) if self.shards_are_final else ()

    def write(self, shard: ShardData) -> tuple[str, ...]:
        """Write the tiles of a shard atomically and return their names; thread-safe."""
        paths = {layer: self._tiles / tile_name(layer, shard.shard) for layer in self._job.layers}
        for layer, path in paths.items():
            _write_tile(path, layer, shard, self._georeference, optimised=self.shards_are_final)
        return tuple(path.relative_to(self.folder).as_posix() for path in paths.values())

    def join(self, *, progress: Callable[[float], None]) -> tuple[str, ...]:
        """Write the files that combine all shards, the VRTs, and return their names."""
        names = _write_vrts(self._tiles, self._georeference)
        progress(1.0)
        return names

    def close(self, ledger: str) -> None:
        """Write the ledger's text, then delete the journal and temporary files."""
        write_atomic(self._job.layout.ledger, ledger.encode())
        journal = self._job.layout.journal
        with wrap_os_errors(journal):
            journal.unlink(missing_ok=True)
            if not self.shards_are_final:
                shutil.rmtree(self._tiles)


class TiffStore(TileStore):
    """Store of one file per layer, with coarser levels as overviews and the sketch in the metadata.

    Tiles are stored in a hidden folder until they are joined, which takes twice the disk space.
    """

    shards_are_final = False

    def join(self, *, progress: Callable[[float], None]) -> tuple[str, ...]:
        """Write the files; see `TileStore.join`."""
        paths = [layer_file(self._job.output, layer) for layer in self._job.layers]
        sketch = b64encode((self._tiles / SKETCH).read_bytes()).decode()
        _write_vrts(self._tiles, self._georeference, sketch)
        for done, (layer, path) in enumerate(zip(self._job.layers, paths, strict=True)):
            self._join(layer, path, done / len(paths), progress)
        progress(1.0)
        return tuple(path.name for path in paths)

    def _join(self, layer: str, path: Path, start: float, progress: Callable[[float], None]) -> None:
        """Copy a layer's VRT in a child process, which is killed if `progress` raises."""
        options = _COG | {"OVERVIEWS": "FORCE_USE_EXISTING", "NUM_THREADS": "ALL_CPUS"}
        options["PREDICTOR"] = LAYER_SPECS[layer].predictor
        expected = sum(file.stat().st_size for file in (self._tiles / layer).rglob("*.tif"))
        source = self._tiles / vrt_name(layer, 0)
        with atomic_path(path) as temporary:
            command = [sys.executable, "-P", "-c", _COPY, str(source), str(temporary), json.dumps(options)]
            environment = os.environ | {"GDAL_CACHEMAX": "128"}  # MB
            pipe: dict[str, Any] = {"stderr": subprocess.PIPE, "text": True, "errors": "replace"}
            with subprocess.Popen(command, env=environment, **pipe) as process:  # noqa: S603
                try:
                    while process.poll() is None:
                        time.sleep(0.05)
                        written = temporary.stat().st_size if temporary.exists() else 0
                        share = min(written / max(expected, 1), 0.99)
                        progress(start + share / len(self._job.layers))
                finally:
                    process.kill()
                _, errors = process.communicate()
            if process.returncode != 0:
                reason = (errors.strip().splitlines() or ["GDAL exited early"])[-1].rpartition("Error: ")[2]
                raise SketchterrainError(f"{one_line(path)}: cannot be written ({one_line(reason)})")


def _write_tile(
    path: Path, layer: str, shard: ShardData, georeference: WorldFrame, *, optimised: bool
) -> None:
    """Write a layer of a shard atomically; with overviews if it is optimised and large."""
    spec, values = georeference.job.specs[layer], getattr(shard, layer)
    values = values[None] if values.ndim == 2 else values
    level = georeference.job.world.levels[shard.shard.level]
    count, height, width = values.shape
    profile = _TILE | {"dtype": spec.dtype, "count": count, "height": height, "width": width}
    profile |= {"crs": georeference.crs, "transform": georeference.transform(level, shard.shard)}
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
                overviews = "FORCE_USE_EXISTING" if max(values.shape) > _SMALL else "NONE"
                options = _COG | {"OVERVIEWS": overviews, "PREDICTOR": spec.predictor, "NUM_THREADS": "1"}
                rasterio.shutil.copy(plain.name, packed.name, **options)
            content = bytes((packed if optimised else plain).getbuffer())
    except RasterioError as error:
        raise SketchterrainError(f"{one_line(path)}: cannot be written ({one_line(error)})") from None
    write_if_changed(path, content)


def _write_vrts(folder: Path, georeference: WorldFrame, sketch: str | None = None) -> tuple[str, ...]:
    names = []
    for layer, level in product(georeference.job.layers, reversed(georeference.job.world.levels)):
        names.append(vrt_name(layer, level.number))
        lines = _vrt(layer, level, georeference, sketch if names[-1] == vrt_name("height", 0) else None)
        write_if_changed(folder / names[-1], "".join(f"{line}\n" for line in lines).encode())
    return tuple(names)


def _vrt(layer: str, level: GridLevel, georeference: WorldFrame, sketch: str | None) -> Iterator[str]:
    """Return the lines of a VRT, a few hundred bytes per tile and band; no tile is opened."""
    spec = georeference.job.specs[layer]
    kind = {"float32": "Float32", "uint8": "Byte"}[spec.dtype]
    yield f'<VRTDataset rasterXSize="{level.columns}" rasterYSize="{level.rows}">'
    yield f'  <SRS dataAxisToSRSAxisMapping="1,2">{escape(georeference.crs.to_wkt())}</SRS>'
    corners = ", ".join(repr(float(number)) for number in georeference.transform(level).to_gdal())
    yield f"  <GeoTransform>{corners}</GeoTransform>"
    yield '  <Metadata><MDI key="AREA_OR_POINT">Point</MDI></Metadata>'
    yield f"  <Metadata domain={quoteattr(TAGS)}>"
    world = georeference.job.world
    facts = {name: repr(float(getattr(world, name))) for name in ("west", "south", "east", "north", "cell")}
    facts |= {
        "layers": ",".join(georeference.job.layers),
        "materials": ",".join(georeference.job.specs["materials"].bands),
    }
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
        for other in georeference.job.world.levels[1:] if level.number == 0 else ():
            name = _file(vrt_name(layer, other.number))
            yield f"    <Overview>{name}<SourceBand>{index + 1}</SourceBand></Overview>"
        yield "  </VRTRasterBand>"
    yield "</VRTDataset>"


def _sources(layer: str, level: GridLevel, band: int, kind: str) -> Iterator[str]:
    for row, column in product(*map(range, level.shards)):
        shard = Shard(level.number, row, column)
        rows, columns = level.size_of(shard)
        size, name = f'xSize="{columns}" ySize="{rows}"', tile_name(layer, shard)
        raster = f'RasterXSize="{columns}" RasterYSize="{rows}" DataType="{kind}"'
        yield "    <SimpleSource>"
        yield f"      {_file(name if level.number == 0 else name.partition('/')[2])}"
        yield f"      <SourceBand>{band}</SourceBand>"
        yield f'      <SourceProperties {raster} BlockXSize="{CHUNK}" BlockYSize="{CHUNK}"/>'
        yield f'      <SrcRect xOff="0" yOff="0" {size}/>'
        yield f'      <DstRect xOff="{column * SHARD}" yOff="{row * SHARD}" {size}/>'
        yield "    </SimpleSource>"


def _file(name: str) -> str:
    return f'<SourceFilename relativeToVRT="1">{escape(name)}</SourceFilename>'
