"""Worlds of GeoTIFFs, read back."""

from __future__ import annotations

import tempfile
import threading
from base64 import b64decode
from collections import OrderedDict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import rasterio
from rasterio.errors import RasterioError
from rasterio.windows import Window

from sketchterrain.errors import InputError, one_line
from sketchterrain.sketch.files import load_sketch
from sketchterrain.world.grid import SHARD, Shard, World
from sketchterrain.world.ground import LAYERS
from sketchterrain.world.tiff_layers import DOMAIN, TIFF_LAYERS
from sketchterrain.world.tile_names import SKETCH, layer_file, tile_name, vrt_name

if TYPE_CHECKING:
    import numpy.typing as npt
    from rasterio.io import DatasetReader

    from sketchterrain.sketch import Sketch
    from sketchterrain.world.grid import Level

__all__ = ["StoredTiff", "StoredTiles", "open_tiffs"]

_OPEN: Final = 24  # files that a thread keeps open
_QUIET: Final = {"GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR"}  # no looking for files beside each


def open_tiffs(path: Path) -> StoredTiff | StoredTiles:
    """Open a world of GeoTIFFs: a folder of tiles, or the file of the heights.

    Raises
    ------
    InputError
        If it is none, or is not finished.
    """
    if not path.is_dir():
        return StoredTiff(path)
    joined = vrt_name("height", 0)
    if (path / joined).exists():
        return StoredTiles(path)
    if (path / SKETCH).exists():
        raise InputError(f"{one_line(path)}: is not finished; world --resume goes on with it")
    raise InputError(f"{one_line(path)}: no world: it holds neither zarr.json nor {joined}")


class _Files:
    """Files that are open: GDAL's are for one thread alone."""

    def __init__(self) -> None:
        self._mine = threading.local()

    def read(self, path: Path, overview: int | None, window: Window) -> npt.NDArray[Any]:
        """Return a window of all bands.

        Raises
        ------
        InputError
            If the file is missing or broken.
        """
        try:
            with rasterio.Env(**_QUIET):
                values: npt.NDArray[Any] = self._file(path, overview).read(window=window)
        except (RasterioError, OSError) as error:
            self._kept.pop((path, overview), None)
            raise _broken(path, error) from None
        return values

    @property
    def _kept(self) -> OrderedDict[tuple[Path, int | None], DatasetReader]:
        if not hasattr(self._mine, "kept"):
            self._mine.kept = OrderedDict()
        kept: OrderedDict[tuple[Path, int | None], DatasetReader] = self._mine.kept
        return kept

    def _file(self, path: Path, overview: int | None) -> DatasetReader:
        key = (path, overview)
        if key not in self._kept:
            options = {} if overview is None else {"overview_level": overview}
            self._kept[key] = rasterio.open(path, **options)
        self._kept.move_to_end(key)
        while len(self._kept) > _OPEN:
            self._kept.popitem(last=False)[1].close()
        return self._kept[key]


class _StoredGeotiffs:
    """What both forms share: see :class:`~sketchterrain.world.stored.StoredWorld`."""

    def __init__(self, heights: Path) -> None:
        self._facts = _facts(heights)
        try:
            numbers = [float(self._facts[name]) for name in ("west", "south", "east", "north", "cell")]
            self._world = World(*numbers)
            self.layers: tuple[str, ...] = tuple(self._facts["layers"].split(","))
            self.material_names: tuple[str, ...] = tuple(self._facts["materials"].split(","))
        except (KeyError, ValueError, InputError) as error:
            raise _broken(heights, error) from None
        if "height" not in self.layers or not set(self.layers) <= set(LAYERS):
            raise _broken(heights, f"layers {','.join(self.layers)}")
        self.levels: tuple[Level, ...] = self._world.levels
        self._files = _Files()

    @property
    def west(self) -> float:
        """Of column 0, m."""
        return self._world.west

    @property
    def north(self) -> float:
        """Of row 0, m."""
        return self._world.north

    def _checked(self, layer: str, level: int, window: Window) -> Level:
        """Return the level that is read.

        Raises
        ------
        InputError
            If there is no such layer, level or window.
        """
        if layer not in self.layers:
            raise InputError(f"expected a layer, {', '.join(self.layers)}, got {one_line(layer)!r}")
        if not 0 <= level < len(self.levels):
            raise InputError(f"expected a level, 0 to {len(self.levels) - 1}, got {level}")
        found = self.levels[level]
        right, bottom = window.col_off + window.width, window.row_off + window.height
        inside = min(window.col_off, window.row_off) >= 0 and right <= found.columns and bottom <= found.rows
        if not inside or window.width < 1 or window.height < 1:
            raise InputError(
                f"expected a window inside {found.columns} × {found.rows} vertices, got columns "
                f"{window.col_off} to {right}, rows {window.row_off} to {bottom}"
            )
        return found


class StoredTiff(_StoredGeotiffs):
    """A world of one GeoTIFF a layer, as :class:`~sketchterrain.world.stored.StoredWorld` says.

    Parameters
    ----------
    path
        Of the heights; the other layers lie beside it.

    Raises
    ------
    InputError
        If it is none, or broken.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._path = path

    def sketch(self) -> Sketch | None:
        """Return the sketch in the file's metadata; see `StoredWorld.sketch`."""
        packed = self._facts.get("sketch")
        if packed is None:
            return None
        with tempfile.TemporaryDirectory(prefix="sketchterrain-") as folder:
            file = Path(folder) / SKETCH
            try:
                file.write_bytes(b64decode(packed, validate=True))
                return load_sketch(file)
            except (ValueError, InputError) as error:
                raise _broken(self._path, f"its sketch: {one_line(error)}") from None

    def read(
        self, layer: str, level: int, *, top: int, left: int, rows: int, columns: int
    ) -> npt.NDArray[Any]:
        """Return a window of a layer; see `StoredWorld.read`."""
        window = Window(left, top, columns, rows)
        self._checked(layer, level, window)
        values = self._files.read(layer_file(self._path, layer), level - 1 if level else None, window)
        return values[0] if layer == "height" else values


class StoredTiles(_StoredGeotiffs):
    """A world of tiles, as :class:`~sketchterrain.world.stored.StoredWorld` says.

    Parameters
    ----------
    folder
        Of the world.

    Raises
    ------
    InputError
        If it is none, or is not finished.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__(folder / vrt_name("height", 0))
        self._folder = folder

    def sketch(self) -> Sketch | None:
        """Return the sketch in the folder; see `StoredWorld.sketch`."""
        path = self._folder / SKETCH
        return load_sketch(path) if path.exists() else None

    def read(
        self, layer: str, level: int, *, top: int, left: int, rows: int, columns: int
    ) -> npt.NDArray[Any]:
        """Return a window of a layer, of as many tiles as it lies in; see `StoredWorld.read`."""
        self._checked(layer, level, Window(left, top, columns, rows))
        form = TIFF_LAYERS[layer]
        whole = np.empty((len(form.bands), rows, columns), form.dtype)
        for row in range(top // SHARD, (top + rows - 1) // SHARD + 1):
            for column in range(left // SHARD, (left + columns - 1) // SHARD + 1):
                first, last = max(top, row * SHARD), min(top + rows, (row + 1) * SHARD)
                start, end = max(left, column * SHARD), min(left + columns, (column + 1) * SHARD)
                window = Window(start - column * SHARD, first - row * SHARD, end - start, last - first)
                path = self._folder / tile_name(layer, Shard(level, row, column))
                whole[:, first - top : last - top, start - left : end - left] = self._files.read(
                    path, None, window
                )
        return whole[0] if layer == "height" else whole


def _facts(heights: Path) -> dict[str, str]:
    """Return what a file of heights tells of its world."""
    try:
        with rasterio.Env(**_QUIET), rasterio.open(heights) as file:
            facts: dict[str, str] = file.tags(ns=DOMAIN)
    except (RasterioError, OSError) as error:
        raise _broken(heights, error) from None
    if not facts:
        raise InputError(f"{one_line(heights)}: expected the heights of a world, it tells of none")
    return facts


def _broken(path: Path, reason: object) -> InputError:
    if not path.exists():
        return InputError(f"{one_line(path)}: expected a part of a world, it is missing")
    return InputError(f"{one_line(path)}: expected a part of a world, it is broken ({one_line(reason)})")
