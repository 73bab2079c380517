"""Raster sources beneath the paint, read in the background: pictures, elevation, and their problems."""

from __future__ import annotations

from collections.abc import Collection
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

from PyQt6.QtCore import QObject, QRectF, pyqtSignal
from PyQt6.QtGui import QImage

from sketchterrain.document.rasters import raster_problem
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.ui.models.background import BackgroundReader, single_shot
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.elevation import Hillshade, SketchElevation

if TYPE_CHECKING:
    from sketchterrain.elevation.pictures import RasterPicture

_DELAY = 150  # ms of rest until pictures are read again, as while the extent is dragged

Pictures: TypeAlias = tuple[tuple[QImage, QRectF], ...]
"""Images, and the shares of the sketch's width and height from its north-west corner that they cover."""


class RasterUnderlay(QObject):
    """The pictures of a document's raster sources, a hillshade of its elevation, and problems of both."""

    changed = pyqtSignal()

    def __init__(self, document: Document, parent: QObject) -> None:
        super().__init__(parent)
        self._document = document
        self.elevation = SketchElevation(document, self)
        self.pictures: Pictures = ()
        self.hillshade: Pictures = ()  # at most one
        self._elevation: tuple[Hillshade | None, str] = (None, "")  # the shown one and its problem
        self._problems: tuple[str, ...] = ()
        self._key: tuple[object, ...] = ()
        self._reader = BackgroundReader(self)
        self._reader.failed.connect(lambda line: self._show(((), (line,))))
        self._timer = single_shot(self, _DELAY, self._read)
        document.opened.connect(self._forget)
        document.sketch_changed.connect(self._update)
        self.elevation.changed.connect(self._show_elevation)
        self._update()

    @property
    def is_busy(self) -> bool:
        return self._reader.is_busy or self._timer.isActive() or self.elevation.is_busy

    @property
    def problems(self) -> tuple[str, ...]:
        """A line for each source that is missing, changed or unreadable."""
        problem = self.elevation.facts.problem
        return tuple(dict.fromkeys((*self._problems, *((problem,) if problem else ()))))

    def visible(self, overlays: Collection[str]) -> Pictures:
        """Return the visible pictures from bottom to top."""
        hillshade = self.hillshade if "elevation" in overlays else ()
        return (*hillshade, *(self.pictures if "pictures" in overlays else ()))

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

    def _show(self, found: tuple[Pictures, tuple[str, ...]]) -> None:
        before = self.pictures, self._problems
        self.pictures, self._problems = found
        if before != (self.pictures, self._problems):
            self.changed.emit()

    def _show_elevation(self) -> None:
        facts = self.elevation.facts
        shaded, problem = self._elevation
        if facts.hillshade is not shaded or facts.problem != problem:
            self._elevation = facts.hillshade, facts.problem
            picture = facts.hillshade and _picture(facts.hillshade, self._document.sketch)
            self.hillshade = (picture,) if picture else ()
            self.changed.emit()


def _read_pictures(sketch: Sketch) -> tuple[Pictures, tuple[str, ...]]:
    """Return the pictures of a sketch, and a line for each source that is missing, changed or unreadable."""
    from sketchterrain.elevation.pictures import read_picture  # GDAL

    pictures, problems = list[tuple[QImage, QRectF]](), list[str]()
    for source in sketch.rasters:
        problem = raster_problem(source)
        if source.role != "elevation":
            try:
                pictures.append(_picture(read_picture(source, sketch), sketch))
            except InputError as error:
                problem = str(error)
        if problem:
            problems.append(problem)
    return tuple(pictures), tuple(problems)


def _picture(picture: RasterPicture | Hillshade, sketch: Sketch) -> tuple[QImage, QRectF]:
    """Return a picture's image and its place in a sketch."""
    pixels, (left, bottom, right, top) = picture
    (east, north), (rows, columns) = sketch.size, pixels.shape[:2]
    image = QImage(pixels.tobytes(), columns, rows, 4 * columns, QImage.Format.Format_RGBA8888)
    image = image.convertToFormat(QImage.Format.Format_ARGB32_Premultiplied)
    return image, QRectF(left / east, 1.0 - top / north, (right - left) / east, (top - bottom) / north)
