"""Real elevation beneath the document's sketch: read in the background, with a hillshade of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt
from PyQt6.QtCore import QObject, pyqtSignal

from sketchterrain.document.rasters import RasterSource, raster_source
from sketchterrain.document.sketch import Sketch
from sketchterrain.stages.parts import part_of
from sketchterrain.stages.runner import Results, Runner
from sketchterrain.ui.models.background import BackgroundReader, single_shot
from sketchterrain.ui.models.document import Document

if TYPE_CHECKING:
    from sketchterrain.elevation.base import BaseElevation

_DELAY = 150  # ms of rest until elevation is read again, as while a slider is dragged
_SIDE = 2048  # px of a hillshade along the sketch's longer side
_ROWS = 128  # evaluated at a time
_LIGHT = (-0.5, 0.5, 0.5**0.5)  # eastward, northward and up: from the north-west, 45° high
_LEAST_RELIEF = 0.35  # rms slope to which gentler land is exaggerated, at most tenfold
_DARKEST = 0.35
_TINTS = np.array([[196, 209, 190], [231, 225, 204], [247, 245, 240]], np.float32)  # low to high ground


class Hillshade(NamedTuple):
    """A picture of elevation in a sketch."""

    pixels: npt.NDArray[np.uint8]  # (rows, columns, 4): sRGB and opacity, not premultiplied
    box: tuple[float, float, float, float]  # west, south, east, north, m from the sketch's south-west corner


class ElevationFacts(NamedTuple):
    """What was read of the elevation beneath a sketch."""

    lines: Mapping[str, tuple[str, ...]] = {}  # of each raster by path: its size, then what was found
    findings: tuple[str, ...] = ()  # in all of them together
    problem: str = ""  # why they cannot be read, one line
    hillshade: Hillshade | None = None


class SketchElevation(QObject):
    """The elevation beneath a document's sketch."""

    changed = pyqtSignal()  # `facts`, or whether they are being read

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.document = document
        self.facts = ElevationFacts()
        self.memory = Results()  # of grids of the document
        self._key: tuple[object, ...] = ()
        self._reader = BackgroundReader(self)
        self._reader.failed.connect(lambda line: self._show(ElevationFacts(problem=line)))
        self._timer = single_shot(self, _DELAY, self._read)
        document.opened.connect(self._forget)
        document.sketch_changed.connect(self._update)
        self._update()

    @property
    def is_busy(self) -> bool:
        return self._reader.is_busy or self._timer.isActive()

    def _forget(self) -> None:
        self._key, self.memory = (), Results()
        self._clear()

    def _clear(self) -> None:
        self._timer.stop()
        self._reader.cancel()
        self._show(ElevationFacts())

    def _update(self) -> None:
        sketch = self.document.sketch
        sources = sketch.elevation_rasters
        key = sources, sketch.size, tuple(sketch.frame.values()), sketch.base["margin"]
        if key == self._key or not (sources or self._key):
            return
        self._key = key if sources else ()
        if sources:
            self._timer.start()
            self.changed.emit()
        else:
            self._clear()

    def _read(self) -> None:
        self._reader.read(partial(_read_facts, self.document.sketch, self.memory), self._show)

    def _show(self, facts: ElevationFacts) -> None:
        self.facts = facts
        self.changed.emit()


def new_on_elevation(paths: Sequence[Path]) -> tuple[Sketch, BaseElevation]:
    """Return an empty sketch on elevation files and its base, as `sketchterrain new --dem` does."""
    from sketchterrain.importing.elevation import sketch_on_elevation

    return sketch_on_elevation([raster_source(path, "elevation") for path in paths])


def added_elevation(
    paths: Sequence[Path], sketch: Sketch, memory: Results
) -> tuple[tuple[RasterSource, ...], dict[str, Any]]:
    """Return elevation files as rasters that a sketch can read, and its frame, which they may give it."""
    from sketchterrain.elevation.base import load_base
    from sketchterrain.importing.elevation import sketch_on_elevation

    sources, frame = tuple(raster_source(path, "elevation") for path in paths), {**sketch.frame}
    if not (frame["crs"] or sketch.elevation_rasters):
        frame = {**sketch_on_elevation(sources, extent=sketch.extent, vertical=frame["vertical"])[0].frame}
    load_base(sketch.replace(rasters=(*sketch.rasters, *sources), frame=frame), Runner(memory))
    return sources, frame


def without_offsets(sketch: Sketch) -> dict[str, Any]:
    """Return the rasters of a sketch, corrected so that overlapping elevation agrees."""
    from sketchterrain.importing.elevation import aligned

    return {"rasters": aligned(sketch).rasters}


def with_flat_lakes(sketch: Sketch) -> dict[str, Any]:
    """Return the vectors of a sketch with the lakes that its elevation has as level areas."""
    from sketchterrain.importing.elevation import with_lakes

    return {"vectors": with_lakes(sketch)[0].vectors}


def _read_facts(sketch: Sketch, memory: Results) -> ElevationFacts:
    from sketchterrain.elevation.base import load_base  # GDAL

    base, sources = load_base(sketch, Runner(memory)), sketch.elevation_rasters
    if base is None:
        return ElevationFacts()
    grids = {each.name: each for each in base.grids}
    lines, rest = dict[str, tuple[str, ...]](), list(base.findings)
    for place, source in enumerate(sources):
        # Equal grids are among those of the base once.
        grid = base.grids[place] if len(base.grids) == len(sources) else grids[source.title]
        own = [each for each in base.findings if each.startswith(f"{source.title}: ")]
        rest = [each for each in rest if each not in own]
        rows, columns = grid.patches.shape
        size = f"{columns} × {rows} samples, {grid.patches.step:.4g} m apart"
        lines[source.path] = (size, *(each.removeprefix(f"{source.title}: ") for each in own))
    shade = Runner(memory)(hillshade, base, part_of(sketch, "extent", "size"))
    return ElevationFacts(lines, tuple(rest), hillshade=shade)


def hillshade(base: BaseElevation, sketch: Sketch) -> Hillshade | None:
    """Return a hillshade of the data inside a sketch, lit from the north-west and tinted by height."""
    west, south = np.maximum(base.patchwork.box[:2], 0.0).tolist()
    east, north = np.minimum(base.patchwork.box[2:], sketch.size).tolist()
    if west >= east or south >= north:
        return None
    cell = max(sketch.extent / _SIDE, 0.5 * min(each.patches.step for each in base.grids))
    rows, columns = (max(int((high - low) / cell), 1) for low, high in ((south, north), (west, east)))
    x = west + (np.arange(columns) + 0.5) * ((east - west) / columns)
    y = north - (np.arange(rows) + 0.5) * ((north - south) / rows)
    found = np.empty((4, rows, columns), np.float32)  # height, slopes and weight
    for top in range(0, rows, _ROWS):
        across, down = np.meshgrid(x, y[top : top + _ROWS])
        found[:, top : top + _ROWS] = base.heights(across, down, cell)[:4]
    height, *slopes, weight = np.nan_to_num(found)
    return Hillshade(_shaded(height, np.stack(slopes), weight), (west, south, east, north))


def _shaded(
    height: npt.NDArray[np.float32], slopes: npt.NDArray[np.float32], weight: npt.NDArray[np.float32]
) -> npt.NDArray[np.uint8]:
    """Return the pixels of heights (m), slopes eastward and northward, and opacity; 0 where no data are."""
    known = weight > 0.0
    if not known.any():
        return np.zeros((*weight.shape, 4), np.uint8)
    rms = float(np.sqrt(2.0 * np.mean(np.square(slopes[:, known]))))
    east, north = slopes * np.clip(_LEAST_RELIEF / max(rms, 1e-9), 1.0, 10.0)
    light = (_LIGHT[2] - _LIGHT[0] * east - _LIGHT[1] * north) / np.sqrt(1.0 + east**2 + north**2)
    grey = _DARKEST + (1.0 - _DARKEST) * np.clip(light / 0.9, 0.0, 1.0)
    low, high = np.quantile(height[known], (0.01, 0.99))
    share = np.clip((height - low) / max(high - low, 1e-9), 0.0, 1.0)
    stops = np.linspace(0.0, 1.0, len(_TINTS))
    bands = [np.interp(share, stops, tint) * grey for tint in _TINTS.T]
    return np.stack([*bands, 255.0 * weight], axis=-1).astype(np.uint8)
