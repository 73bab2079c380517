"""A VRT that joins the tiles of a level (GDAL's documentation: "VRT -- GDAL Virtual Format")."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final
from xml.sax.saxutils import escape, quoteattr

from sketchterrain.whole_files import telling_failure, whole_file
from sketchterrain.world.grid import CHUNK, SHARD, Shard
from sketchterrain.world.tiff_layers import DOMAIN
from sketchterrain.world.tile_names import tile_name, vrt_name

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from sketchterrain.world.grid import Level
    from sketchterrain.world.tiff_layers import Georeference, TiffLayer

__all__ = ["covering", "write_vrt"]

_TYPES: Final = {"float32": "Float32", "uint8": "Byte"}
_COLOURS: Final = ("Red", "Green", "Blue")


def write_vrt(path: Path, layer: TiffLayer, level: Level, place: Georeference) -> None:
    """Write the VRT of a layer's level; that of the finest has the coarser ones as its overviews.

    It is as long as there are tiles and bands, a few hundred bytes for each. No tile is opened.

    Parameters
    ----------
    path
    layer
    level
    place

    Raises
    ------
    SketchterrainError
        If the system cannot write it.
    """
    with telling_failure(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as stream:
        for line in _lines(layer, level, place):
            stream.write(f"{line}\n".encode())


def covering(level: Level, finest: Level) -> tuple[int, int]:
    """Return how many rows and columns of a coarser level lie over the finest one.

    GDAL takes an overview for the same rectangle at another size. A level's vertices lie on the finest's,
    and its last ones as far out or beyond: as many are shown as make the rectangles agree best. Then no
    vertex is drawn farther off than half a cell of its own level.
    """
    step = 1 << level.number

    def nearest(fine: int, coarse: int) -> int:
        # n pixels reach from half a coarse cell before the first vertex to n − ½ of them after it.
        return min(max(round((fine - 0.5) / step + 0.5), 1), coarse)

    return nearest(finest.rows, level.rows), nearest(finest.columns, level.columns)


def _lines(layer: TiffLayer, level: Level, place: Georeference) -> Iterator[str]:
    finest, *coarser = place.job.world.levels
    rows, columns = covering(level, finest)
    yield f'<VRTDataset rasterXSize="{columns}" rasterYSize="{rows}">'
    yield f'  <SRS dataAxisToSRSAxisMapping="1,2">{escape(place.crs.to_wkt())}</SRS>'
    corners = ", ".join(repr(float(number)) for number in place.transform(level).to_gdal())
    yield f"  <GeoTransform>{corners}</GeoTransform>"
    yield '  <Metadata><MDI key="AREA_OR_POINT">Point</MDI></Metadata>'
    yield f"  <Metadata domain={quoteattr(DOMAIN)}>"
    for key, text in place.facts().items():
        yield f"    <MDI key={quoteattr(key)}>{escape(text)}</MDI>"
    yield "  </Metadata>"
    for index, band in enumerate(layer.bands):
        kind = _TYPES[layer.dtype]
        blocks = f'blockXSize="{CHUNK}" blockYSize="{CHUNK}"'
        yield f'  <VRTRasterBand dataType="{kind}" band="{index + 1}" {blocks}>'
        yield f"    <Description>{escape(band)}</Description>"
        if layer.unit is not None:
            yield f"    <UnitType>{escape(layer.unit)}</UnitType>"
        colour = _COLOURS[index] if layer.picture else ("Undefined" if index else "Gray")
        yield f"    <ColorInterp>{colour}</ColorInterp>"
        yield from _sources(layer, level, index + 1, kind, (rows, columns))
        for other in coarser if level.number == 0 else ():
            yield "    <Overview>"
            yield f"      {_file(vrt_name(layer.name, other.number))}"
            yield f"      <SourceBand>{index + 1}</SourceBand>"
            yield "    </Overview>"
        yield "  </VRTRasterBand>"
    yield "</VRTDataset>"


def _sources(layer: TiffLayer, level: Level, band: int, kind: str, shown: tuple[int, int]) -> Iterator[str]:
    for row in range(-(-shown[0] // SHARD)):
        for column in range(-(-shown[1] // SHARD)):
            shard = Shard(level.number, row, column)
            top, left = row * SHARD, column * SHARD
            rows, columns = level.size_of(shard)
            size = f'xSize="{min(columns, shown[1] - left)}" ySize="{min(rows, shown[0] - top)}"'
            name = tile_name(layer.name, shard)
            yield "    <SimpleSource>"
            yield f"      {_file(name if level.number == 0 else name.partition('/')[2])}"
            yield f"      <SourceBand>{band}</SourceBand>"
            yield (
                f'      <SourceProperties RasterXSize="{columns}" RasterYSize="{rows}" DataType="{kind}" '
                f'BlockXSize="{CHUNK}" BlockYSize="{CHUNK}"/>'
            )
            yield f'      <SrcRect xOff="0" yOff="0" {size}/>'
            yield f'      <DstRect xOff="{left}" yOff="{top}" {size}/>'
            yield "    </SimpleSource>"


def _file(name: str) -> str:
    """Return the reference to a file by its name from the VRT's folder on."""
    return f'<SourceFilename relativeToVRT="1">{escape(name)}</SourceFilename>'
