"""Rasters as PNG with JSON, raw numbers, NumPy files, OpenEXR and (Cloud-Optimised) GeoTIFF."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from rasterio import Affine, Env
from rasterio.crs import CRS
from rasterio.enums import ColorInterp
from rasterio.io import MemoryFile

from sketchterrain.array_types import Float32Array
from sketchterrain.export.files import write_json, write_png, write_values_png
from sketchterrain.export.sampled import (
    CHANNELS,
    ORIENTATION,
    SampleGrid,
    TerrainSamples,
    appearance_picture,
    quantise_normals,
    quantise_weights,
    rgba_weights,
)
from sketchterrain.io.files import atomic_file, atomic_path, wrap_os_errors, write_atomic
from sketchterrain.terrain.surfaces import Drainage, Raster

_STEPS = 65535
APPEARANCE: Final = "colour of roads, land use and draped layers, sRGB, and their share as opacity"


def write_height_png(folder: Path, raster: Raster) -> tuple[Path, ...]:
    """Write ``height.png``, 16-bit grey, and ``height.json`` with the meaning of its values.

    Height is minimum + value · metres_per_step, to half a step. A flat terrain has value 0 and a step of 0 m.
    """
    low, high = float(raster.height.min()), float(raster.height.max())
    step = (high - low) / _STEPS
    rows, columns = raster.height.shape
    values = np.zeros(raster.height.shape, np.uint16)
    if step > 0.0:
        steps = np.rint((raster.height.astype(np.float64) - low) / step)
        values = np.clip(steps, 0, _STEPS).astype(np.uint16)
    image = write_values_png(folder / "height.png", values)
    description = write_json(
        folder / "height.json",
        {
            "format": 1,
            "file": image.name,
            "units": "m",
            "minimum": low,
            "maximum": high,
            "metres_per_step": step,
            "width": columns,
            "height": rows,
            "spacing": {"x": raster.spacing[0], "y": raster.spacing[1]},
            "bounds": {
                "west": 0.0,
                "south": 0.0,
                "east": (columns - 1) * raster.spacing[0],
                "north": (rows - 1) * raster.spacing[1],
            },
            "orientation": ORIENTATION,
        },
    )
    return image, description


def write_normal_png(folder: Path, raster: Raster) -> tuple[Path, ...]:
    """Write ``normal.png``, 8-bit RGB in OpenGL's convention: red east, green north (Y+), blue up."""
    return (write_values_png(folder / "normal.png", quantise_normals(raster.normal)),)


def write_materials(folder: Path, raster: Raster, names: Sequence[str]) -> tuple[Path, ...]:
    """Write ``materials.png``, ``materials-2.png`` … (RGBA) and ``materials.json`` with their channels."""
    weights = quantise_weights(raster.materials)
    images = [
        write_values_png(folder / f"{weights_suffix(first)}.png", rgba_weights(weights, first))
        for first in range(0, len(names), len(CHANNELS))
    ]
    description = {
        "format": 1,
        "encoding": "value / 255 is the weight; the weights of a vertex sum to 255 over all files",
        "alpha": "a weight like the others, not opacity: do not premultiply",
        "orientation": ORIENTATION,
        "materials": [
            {
                "name": name,
                "index": index,
                "file": f"{weights_suffix(index)}.png",
                "channel": CHANNELS[index % len(CHANNELS)],
            }
            for index, name in enumerate(names)
        ],
    }
    return (*images, write_json(folder / "materials.json", description))


def write_appearance(folder: Path, painted: npt.NDArray[np.uint8]) -> tuple[Path, ...]:
    """Write ``appearance.png``: colour of what is painted, sRGB, and its share as opacity."""
    return (write_values_png(folder / "appearance.png", appearance_picture(painted)),)


def write_normals_and_weights(stem: Path, samples: TerrainSamples, names: Sequence[str]) -> dict[Path, str]:
    """Write ``STEM_normal.png``, ``STEM_materials.png``, ``STEM_materials-2.png`` … with descriptions."""
    path = stem.with_name(f"{stem.name}_normal.png")
    description = "normals, red east, green north (Y+), blue up; 0 is -1, 255 is 1"
    files = {write_values_png(path, samples.normal): description}
    for first in range(0, len(names), len(CHANNELS)):
        path = stem.with_name(f"{stem.name}_{weights_suffix(first)}.png")
        materials = ", ".join(names[first : first + len(CHANNELS)])
        write_values_png(path, rgba_weights(samples.weights, first))
        files[path] = f"weights of {materials}; no opacity"
    if samples.appearance is not None:
        path = stem.with_name(f"{stem.name}_appearance.png")
        files[write_values_png(path, appearance_picture(samples.appearance))] = APPEARANCE
    return files


def weights_suffix(index: int) -> str:
    """Return the end of the file name of a material's weights: ``materials``, ``materials-2`` and so on."""
    number = index // len(CHANNELS) + 1
    return f"materials-{number}" if number > 1 else "materials"


def write_picture(path: Path, pixels: npt.NDArray[np.uint8]) -> tuple[Path, ...]:
    """Write an image, (height, width, 3) uint8, as a PNG."""
    return (write_png(path, pixels),)


def write_raw(path: Path, values: npt.NDArray[np.generic], dtype: str) -> Path:
    """Write numbers row by row without a header, in a NumPy dtype such as ``<u2`` or ``>u2``."""
    with atomic_file(path) as stream:
        stream.write(np.ascontiguousarray(values, dtype).view(np.uint8).data)
    return path


def write_npy(path: Path, values: npt.NDArray[np.generic]) -> Path:
    """Write an array for ``numpy.load``, little-endian."""
    with atomic_file(path) as stream:
        np.save(stream, np.ascontiguousarray(values, values.dtype.newbyteorder("<")))
    return path


@contextmanager
def npy_rows(path: Path, dtype: np.dtype[np.void]) -> Iterator[Callable[[npt.NDArray[np.void]], None]]:
    """Yield a function that appends rows to a structured array in a file of any length."""
    count, dtype = 0, dtype.newbyteorder("<")
    head = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False}
    with atomic_file(path) as stream:
        # NumPy pads the header so that it is equally long for any number of rows.
        np.lib.format.write_array_header_1_0(stream, head | {"shape": (0,)})

        def add(rows: npt.NDArray[np.void]) -> None:
            nonlocal count
            with wrap_os_errors(path):
                stream.write(rows.astype(dtype, order="C").view(np.uint8).data)
            count += len(rows)

        yield add
        stream.seek(0)
        np.lib.format.write_array_header_1_0(stream, head | {"shape": (count,)})


def write_exr(path: Path, channels: Mapping[str, npt.NDArray[np.float32]]) -> Path:
    """Write named channels, (rows, columns) float32 each, losslessly, including the bits of NaN."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    # The library ignores strides.
    planes = {name: np.ascontiguousarray(plane, np.float32) for name, plane in channels.items()}
    with atomic_path(path) as temporary:
        try:
            OpenEXR.File(header, planes).write(str(temporary))
        except RuntimeError as error:  # 'Failed to … file "…". No space left on device.'
            raise OSError(str(error).rpartition('". ')[2].rstrip(".")) from error
    return path


NO_DATA = -9999.0  # m, of a missing height; none is missing

_FLOAT_PREDICTOR = 3
_LEVEL = 3  # level 6 takes twice as long to save a hundredth of the bytes
_BLOCK = 256  # samples along the side of a TIFF tile
# GIS programs then know the unit and do not ask for a CRS.
_LOCAL_METRES = (
    'LOCAL_CS["sketch, metres from its south-west corner",UNIT["metre",1],'
    'AXIS["Easting",EAST],AXIS["Northing",NORTH]]'
)
_RGB = (ColorInterp.red, ColorInterp.green, ColorInterp.blue)


def local_metres() -> CRS:
    """Return the coordinate reference system of a sketch without georeference."""
    return CRS.from_wkt(_LOCAL_METRES)


class Georeference(NamedTuple):
    """Position of the sketch's south-west corner, (0, 0), in a coordinate reference system."""

    crs: CRS
    east: float
    north: float

    def transform(self, grid: SampleGrid) -> Affine:
        """Return GDAL's transform for samples at a grid's vertices.

        It refers to the corners of pixels, so it starts half a spacing north-west of the first vertex.
        """
        dx, dy = grid.spacing
        west, north = self.east + grid.west - 0.5 * dx, self.north + grid.north + 0.5 * dy
        return Affine(dx, 0.0, west, 0.0, -dy, north)


def write_height_tif(folder: Path, raster: Raster) -> tuple[Path, ...]:
    """Write ``height.tif``: float32 metres, north up, in local metres, samples at vertices (Point)."""
    return (_write_float_tiff(folder / "height.tif", "height", raster.height, raster.spacing, "m"),)


def write_drainage(folder: Path, drainage: Drainage) -> tuple[Path, ...]:
    """Write ``drainage.tif``, float32 m² as ``height.tif``, and ``wetness.png``, 8-bit grey."""
    spacing = (drainage.spacing, drainage.spacing)
    area = _write_float_tiff(folder / "drainage.tif", "drainage_area", drainage.area, spacing, "m2")
    return area, write_values_png(folder / "wetness.png", drainage.wetness)


def _write_float_tiff(
    path: Path, name: str, values: Float32Array, spacing: tuple[float, float], unit: str
) -> Path:
    dx, dy = spacing
    corner = Affine(dx, 0.0, -0.5 * dx, 0.0, -dy, (len(values) - 1) * dy + 0.5 * dy)
    layout: dict[str, Any] = {
        "predictor": _FLOAT_PREDICTOR,
        "zlevel": _LEVEL,
        "tiled": True,
        "blockxsize": _BLOCK,
        "blockysize": _BLOCK,
    }
    return _write_tiff(path, {name: values}, "GTiff", local_metres(), corner, unit=unit, **layout)


def write_cloud_tiff(
    path: Path,
    bands: Mapping[str, npt.NDArray[np.generic]],
    *,
    grid: SampleGrid,
    georeference: Georeference,
    unit: str | None = None,
    no_data: float | None = None,
    rgb: bool = False,
    classes: Mapping[str, tuple[int, int, int]] | None = None,
) -> Path:
    """Write named bands of one size and dtype as a Cloud-Optimised GeoTIFF, samples at vertices (Point).

    By GDAL's driver COG: deflated blocks of 256 × 256, overviews by averaging. Deterministic. Needs twice the
    memory of the bands: for GDAL's copy and for the file. Numbers of a band may be `classes` with colours,
    of which overviews have the commonest.
    """
    layout: dict[str, Any] = {
        "nodata": no_data,
        "predictor": "yes",  # the one for its dtype: differences of floats or of integers
        "overview_resampling": "average" if classes is None else "mode",
        "blocksize": _BLOCK,
        "num_threads": "all_cpus",
        "statistics": "yes",
    }
    transform = georeference.transform(grid)
    layout |= {"unit": unit, "rgb": rgb, "classes": classes}
    return _write_tiff(path, bands, "COG", georeference.crs, transform, **layout)


def _write_tiff(
    path: Path,
    bands: Mapping[str, npt.NDArray[np.generic]],
    driver: str,
    crs: CRS,
    transform: Affine,
    *,
    unit: str | None = None,
    rgb: bool = False,
    classes: Mapping[str, tuple[int, int, int]] | None = None,
    **layout: Any,
) -> Path:
    first = next(iter(bands.values()))
    rows, columns = first.shape
    size = {"width": columns, "height": rows, "count": len(bands), "dtype": first.dtype.name}
    with Env(), MemoryFile() as memory:
        with memory.open(
            driver=driver, crs=crs, transform=transform, compress="deflate", **size, **layout
        ) as file:
            # GDAL writes the tie point on closing: for points it is the north-west vertex.
            file.update_tags(AREA_OR_POINT="Point")
            if rgb:
                file.colorinterp = _RGB
            for index, (name, band) in enumerate(bands.items(), start=1):
                file.set_band_description(index, name)
                if unit is not None:
                    file.set_band_unit(index, unit)
                file.write(band, index)
            if classes is not None:
                file.write_colormap(1, dict(enumerate(classes.values())))
                file.update_tags(1, **{f"CLASS_{number}": name for number, name in enumerate(classes)})
        return write_atomic(path, memory.getbuffer())
