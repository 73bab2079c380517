"""Pictures of raster sources beneath the paint, read in the background, and problems of the sources."""

from __future__ import annotations

from functools import partial
from typing import TypeAlias, cast

from PyQt6.QtCore import QObject, QRectF, pyqtSignal
from PyQt6.QtGui import QImage

from sketchterrain.document.rasters import raster_problem
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.ui.application import single_shot
from sketchterrain.ui.models.background import BackgroundReader
from sketchterrain.ui.models.document import Document

_DELAY = 150  # ms of rest until pictures are read again, as while the extent is dragged

Pictures: TypeAlias = tuple[tuple[QImage, QRectF], ...]
"""Images, and the shares of the sketch's width and height from its north-west corner that they cover."""


class RasterUnderlay(QObject):
    """The pictures of a document's raster sources, and a line for each source with a problem."""

    changed = pyqtSignal()

    def __init__(self, document: Document, parent: QObject) -> None:
        super().__init__(parent)
        self._document = document
        self.pictures: Pictures = ()
        self.problems: tuple[str, ...] = ()
        self._key: tuple[object, ...] = ()
        self._reader = BackgroundReader(self)
        self._reader.failed.connect(lambda line: self._show(((), (line,))))
        self._timer = single_shot(self, _DELAY, self._read)
        document.opened.connect(self._forget)
        document.sketch_changed.connect(self._update)
        self._update()

    @property
    def is_busy(self) -> bool:
        return self._reader.is_busy or self._timer.isActive()

    def _forget(self) -> None:
        self._key = ()

    def _update(self) -> None:
        sketch = self._document.sketch
        key = sketch.rasters, sketch.size, *(sketch.frame[name] for name in ("crs", "east", "north"))
        if key == self._key:
            return
        self._key = key
        if sketch.rasters:
            self._timer.start()
        else:
            self._timer.stop()
            self._reader.cancel()
            self._show(((), ()))

    def _read(self) -> None:
        self._reader.read(partial(_read_pictures, self._document.sketch), self._show)

    def _show(self, found: object) -> None:
        before = self.pictures, self.problems
        self.pictures, self.problems = cast("tuple[Pictures, tuple[str, ...]]", found)
        if before != (self.pictures, self.problems):
            self.changed.emit()


def _read_pictures(sketch: Sketch) -> tuple[Pictures, tuple[str, ...]]:
    """Return the pictures of a sketch, and a line for each source that is missing, changed or unreadable."""
    from sketchterrain.importing.rasters import read_picture  # GDAL

    pictures, problems = list[tuple[QImage, QRectF]](), list[str]()
    east, north = sketch.size
    for source in sketch.rasters:
        problem = raster_problem(source)
        if source.role == "picture":
            try:
                pixels, (left, bottom, right, top) = read_picture(source, sketch)
            except InputError as error:
                problem = str(error)
            else:
                rows, columns = pixels.shape[:2]
                image = QImage(pixels.tobytes(), columns, rows, 4 * columns, QImage.Format.Format_RGBA8888)
                image = image.convertToFormat(QImage.Format.Format_ARGB32_Premultiplied)
                place = QRectF(left / east, 1.0 - top / north, (right - left) / east, (top - bottom) / north)
                pictures.append((image, place))
        if problem:
            problems.append(problem)
    return tuple(pictures), tuple(problems)
