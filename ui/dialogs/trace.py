"""Dialog for importing a sketch from an image, layers or vectors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np
import numpy.typing as npt
from PIL import Image
from PyQt6.QtCore import QSignalBlocker, QSize, Qt, QTimer, pyqtSignal
from PyQt6.QtGui import QCloseEvent, QColor, QIcon, QImage, QPixmap, QResizeEvent
from PyQt6.QtWidgets import (
    QComboBox,
    QDialog,
    QFrame,
    QGridLayout,
    QGroupBox,
    QHBoxLayout,
    QLabel,
    QScrollArea,
    QSizePolicy,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from sketchterrain.document.parameters import LAYERS, SKETCH
from sketchterrain.document.sketch import DEFAULT_SIDE, Sketch
from sketchterrain.importing.image_colours import DetectedColour
from sketchterrain.importing.images import SPECKS, ColouredMap, Kind, coloured_map, detect_kind, read_picture
from sketchterrain.importing.layered import trace_folder, trace_mask, trace_open_raster
from sketchterrain.importing.legend import INK, NOTHING, Meaning
from sketchterrain.importing.traced_layers import DEFAULT_MAX_SIDE, TraceOptions, TraceResult, sketch_picture
from sketchterrain.ui.dialogs.form import EXTENT, NAME, Field, Form, button_row, column, form_layout, note
from sketchterrain.ui.look.layer_colours import swatch
from sketchterrain.ui.look.theme import MARGIN, SMALL, SPACING, tabular
from sketchterrain.ui.models.background import BackgroundReader

_SHOWN = 900  # px along the longer side of what is shown


@dataclass(frozen=True, eq=False)
class TraceSource:
    """A file that was read.

    Attributes
    ----------
    path : Path
    kind : {'picture', 'folder', 'open raster', 'vectors'}
    map : ColouredMap or None
        If it is a coloured map.
    shown : numpy.ndarray or None
        uint8, (height, width, 4): what it looks like, if it is a picture.
    """

    path: Path
    kind: Kind
    map: ColouredMap | None = None
    shown: npt.NDArray[np.uint8] | None = None


@dataclass(frozen=True, eq=False)
class TracedShown:
    """What was traced, and what it looks like: uint8, (height, width, 4)."""

    traced: TraceResult
    shown: npt.NDArray[np.uint8]


def read_source(path: Path) -> TraceSource:
    """Read a file; slow for large pictures."""
    kind = detect_kind(path)
    if kind != "picture":
        return TraceSource(path, kind)
    picture = read_picture(path)
    shown = _smaller(picture.rgba, Image.Resampling.BOX)
    return TraceSource(path, kind, None if picture.is_grey else coloured_map(picture, path), shown)


def trace_source(
    source: TraceSource,
    sheet: TraceOptions,
    *,
    meanings: Sequence[Meaning | None],
    layer: str,
    specks: int,
    narrow: float,
) -> TracedShown:
    """Trace what was read."""
    if source.map is not None:
        traced: TraceResult = source.map.traced(sheet, meanings=meanings, specks=specks, narrow=narrow)
    elif source.kind == "picture":
        traced = trace_mask(source.path, layer, sheet)
    elif source.kind == "folder":
        traced = trace_folder(source.path, sheet)
    elif source.kind == "open raster":
        traced = trace_open_raster(source.path, sheet)
    else:
        traced = _from_vectors(source.path, sheet)
    opaque = np.full((traced.sketch.height_px, traced.sketch.width_px, 4), 255, dtype=np.uint8)
    opaque[..., :3] = sketch_picture(traced.sketch)
    return TracedShown(traced, _smaller(opaque, Image.Resampling.NEAREST))


def _from_vectors(path: Path, sheet: TraceOptions) -> TraceResult:
    from sketchterrain.importing.vectors import sketch_from_vectors

    return sketch_from_vectors(path, name=sheet.name, size_px=sheet.size_px or DEFAULT_SIDE)


def _smaller(rgba: npt.NDArray[np.uint8], how: Image.Resampling) -> npt.NDArray[np.uint8]:
    image = Image.fromarray(rgba)
    scale = _SHOWN / max(image.size)
    if scale < 1.0:
        image = image.resize((max(1, round(image.width * scale)), max(1, round(image.height * scale))), how)
    return np.asarray(image)


_LEAST = QSize(320, 220)


class ShownPicture(QLabel):
    """A picture, as large as there is room."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self._pixels: QPixmap | None = None
        self.setAccessibleName(name)
        self.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.setMinimumSize(_LEAST)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Ignored)

    def show_pixels(self, rgba: npt.NDArray[np.uint8]) -> None:
        """Show uint8, (height, width, 4)."""
        height, width = rgba.shape[:2]
        image = QImage(rgba.tobytes(), width, height, 4 * width, QImage.Format.Format_RGBA8888)
        self._pixels = QPixmap.fromImage(image.copy())
        self._fit()

    def clear(self) -> None:
        """Show nothing."""
        self._pixels = None
        super().clear()

    def resizeEvent(self, event: QResizeEvent | None) -> None:
        """Fit the picture again."""
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        if self._pixels is not None:
            ratio = self.devicePixelRatioF()
            how = (Qt.AspectRatioMode.KeepAspectRatio, Qt.TransformationMode.SmoothTransformation)
            scaled = self._pixels.scaled(self.size() * ratio, *how)
            scaled.setDevicePixelRatio(ratio)
            self.setPixmap(scaled)


_SWATCH = 16  # px
_MOST = 24  # rows
_LABELS = 3  # of each layer that are offered
_TALLEST = 7  # rows seen at once


def meaning_box(*, special: bool = True) -> QComboBox:
    """Return a box with everything that a colour can stand for."""
    box = QComboBox()
    box.setIconSize(QSize(_SWATCH, _SWATCH))
    if special:
        box.addItem("Nothing", NOTHING)
        box.addItem("Lettering, outlines", INK)
    for label in range(1, _LABELS + 1):
        for name, layer in LAYERS.items():
            title = layer.title if label == 1 else f"{layer.title} {label}"
            box.addItem(QIcon(swatch(name, label, _SWATCH)), title, Meaning(name, label))
    box.setMaxVisibleItems(box.count())
    return box


class ColourTable(QScrollArea):
    """A row for each colour; `changed` tells that one became something else."""

    changed = pyqtSignal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setWidgetResizable(True)
        self.setAccessibleName("Colours of the map")
        self._rest: tuple[Meaning | None, ...] = ()
        self.boxes: list[QComboBox] = []

    @property
    def meanings(self) -> tuple[Meaning | None, ...]:
        """What each colour stands for."""
        return (*(box.currentData() for box in self.boxes), *self._rest)

    def show_colours(self, colours: Sequence[DetectedColour], meanings: Sequence[Meaning | None]) -> None:
        """Show the colours of another map."""
        self._rest = tuple(meanings[_MOST:])
        self.boxes = []
        page = QWidget()
        rows = QGridLayout(page)
        rows.setContentsMargins(0, 0, SPACING, 0)
        rows.setHorizontalSpacing(SPACING)
        rows.setVerticalSpacing(SMALL)
        for row, (colour, meaning) in enumerate(zip(colours[:_MOST], meanings, strict=False)):
            shown = QPixmap(2 * _SWATCH, _SWATCH)
            shown.fill(QColor(*colour.rgb))
            picture = QLabel()
            picture.setPixmap(shown)
            picture.setToolTip(colour.code)
            share = QLabel(f"{100.0 * colour.share:.1f}\u202f%")
            share.setFont(tabular(share.font()))
            box = meaning_box()
            box.setAccessibleName(f"What {colour.code} becomes")
            box.setToolTip(f"What {colour.code} becomes")
            box.setCurrentIndex(_place_of(box, meaning))
            box.currentIndexChanged.connect(self._tell)
            self.boxes.append(box)
            rows.addWidget(picture, row, 0)
            rows.addWidget(share, row, 1)
            rows.addWidget(box, row, 2)
        rows.setColumnStretch(2, 1)
        rows.setRowStretch(len(self.boxes), 1)
        self.setWidget(page)
        if self.boxes:
            height = self.boxes[0].sizeHint().height() + SMALL
            self.setMinimumHeight(min(len(self.boxes), _TALLEST) * height)

    def _tell(self, _: int) -> None:
        self.changed.emit()


def _place_of(box: QComboBox, meaning: Meaning | None) -> int:
    wanted = NOTHING if meaning is None else meaning
    # Not by findData: to Qt equal values of Python's are different ones.
    places = [place for place in range(box.count()) if box.itemData(place) == wanted]
    if not places:
        box.addItem(str(wanted), wanted)
    return places[0] if places else box.count() - 1


_PATIENCE = 150  # ms without a change until the picture is traced again
_NOTES = 3


class TraceDialog(QDialog):
    """Asks what a picture's colours become; see `sketch` when it was accepted."""

    def __init__(self, path: Path, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._source: TraceSource | None = None
        self._made: TracedShown | None = None
        self._reading = BackgroundReader(self)
        self._reading.failed.connect(self._refuse)
        self._rest = QTimer(self)
        self._rest.setSingleShot(True)
        self._rest.setInterval(_PATIENCE)
        self._rest.timeout.connect(self._trace)
        rows = column(self, f"New from {path.name}")
        self.before, self.after = ShownPicture("The picture"), ShownPicture("The sketch")
        pictures = QHBoxLayout()
        pictures.setSpacing(MARGIN)
        self._frame = _framed("Picture", self.before)
        pictures.addWidget(self._frame)
        pictures.addWidget(_framed("Sketch", self.after))
        rows.addLayout(pictures, 1)
        options = QHBoxLayout()
        options.setSpacing(2 * MARGIN)
        options.addWidget(self._meanings_page(), 1)
        options.addWidget(self._size_form(path), 1)
        rows.addLayout(options)
        self.told = note()
        rows.addWidget(self.told)
        box, self.agree = button_row(self, "Create")
        rows.addWidget(box)
        self.agree.setEnabled(False)
        self.told.setText("Reading …")
        self.resize(860, 720)
        self._reading.read(partial(read_source, path), self._take)

    def sketch(self) -> Sketch:
        """Return the new sketch."""
        if self._made is None:
            raise RuntimeError("expected a traced sketch")
        return self._made.traced.sketch

    def done(self, result: int) -> None:
        """Let go of what is being read."""
        self._rest.stop()
        self._reading.cancel()
        super().done(result)

    def closeEvent(self, event: QCloseEvent | None) -> None:
        """Let go of what is being read."""
        self._rest.stop()
        self._reading.cancel()
        super().closeEvent(event)

    def _meanings_page(self) -> QWidget:
        self.colours = ColourTable()
        self.colours.changed.connect(self._change)
        self.layer = meaning_box(special=False)
        self.layer.setAccessibleName("What is painted")
        self.layer.currentIndexChanged.connect(self._change)
        one = QWidget()
        fields = form_layout()
        fields.addRow("What is &painted", self.layer)
        one.setLayout(fields)
        self.pages = QStackedWidget()
        for page in (self.colours, one, note("What is in it says what it becomes.")):
            self.pages.addWidget(page)
        group = QGroupBox("What its colours become")
        inner = QVBoxLayout(group)
        inner.addWidget(self.pages)
        self._group = group
        return group

    def _size_form(self, path: Path) -> Form:
        self.form = Form(
            replace(NAME, default=path.stem),
            replace(EXTENT, tip="Length of the picture's longer side"),
            Field(
                "size_px",
                "&Size",
                512,
                "Pixels of the sketch along its longer side",
                range=(32, 16384),
                unit="px",
                decimals=0,
            ),
            Field(
                "specks",
                "Spec&ks",
                SPECKS,
                "Areas of fewer pixels vanish",
                range=(0, 10_000),
                unit="px",
                decimals=0,
            ),
            Field(
                "narrow",
                "Ri&vers up to",
                0,
                "Narrower water is a river, wider water a lake, whichever its colour",
                range=(0, 200),
                unit="px",
                decimals=0,
                words="by colour",
            ),
        )
        self.form["name"].setMaxLength(int(SKETCH["name"].high))
        self.form.changed.connect(self._change)
        return self.form

    def _take(self, result: object) -> None:
        source = cast(TraceSource, result)
        self._source = source
        if source.shown is not None:
            self.before.show_pixels(source.shown)
        if source.map is not None:
            self.colours.show_colours(source.map.colours, source.map.meanings)
            height, width = source.map.rgba.shape[:2]
            self._set_size(max(height, width))
        elif source.shown is not None:
            self._set_size(max(source.shown.shape[:2]))
            self._group.setTitle("What is painted in it becomes")
            self.pages.setCurrentIndex(1)
        else:
            self._group.setTitle("What it becomes")
            self.pages.setCurrentIndex(2)
            self._frame.hide()
        self.form.enable(source.kind != "vectors", "extent")
        self.form.enable(source.map is not None, "specks", "narrow")
        self._trace()

    def _set_size(self, longest: int) -> None:
        with QSignalBlocker(self.form):
            self.form["size_px"].setValue(min(longest, DEFAULT_MAX_SIDE))

    def _change(self, *_: object) -> None:
        if self._source is not None:
            self.agree.setEnabled(False)
            self._rest.start()

    def _trace(self) -> None:
        source = self._source
        if source is None:
            return
        values = self.form.values
        name = values["name"].strip() or "Untitled"
        sheet = TraceOptions(size_px=values["size_px"], extent=float(values["extent"]), name=name)
        layer = cast("Meaning", self.layer.currentData())
        work = partial(
            trace_source,
            source,
            sheet,
            meanings=self.colours.meanings,
            layer=str(layer),
            specks=values["specks"],
            narrow=values["narrow"],
        )
        self._reading.read(work, self._show)

    def _show(self, result: object) -> None:
        made = cast(TracedShown, result)
        self._made = made
        self.after.show_pixels(made.shown)
        sketch = made.traced.sketch
        if not self.form["extent"].isEnabled():  # vectors have a scale of their own
            with QSignalBlocker(self.form):
                self.form["extent"].setValue(sketch.extent)
        east, north = (side / 1000.0 for side in sketch.size)
        size = f"{sketch.width_px} × {sketch.height_px} px"
        told = [f"{size}, {east:.3g} km × {north:.3g} km of land, {sketch.pixel_size:.3g} m a pixel."]
        if self._source is not None and self._source.map is None:
            told += [f"{line}." for line in made.traced.notes[:_NOTES]]
        self.told.setText("\n".join(told))
        self.agree.setEnabled(True)
        self.agree.setDefault(True)

    def _refuse(self, line: str) -> None:
        self._made = None
        self.after.clear()
        self.agree.setEnabled(False)
        is_unnamed = self._source is not None and self._source.map is not None
        is_unnamed = is_unnamed and not any(each and each.label for each in self.colours.meanings)
        self.told.setText("Say what at least one of its colours becomes." if is_unnamed else line)


def _framed(title: str, shown: QWidget) -> QGroupBox:
    group = QGroupBox(title)
    rows = QVBoxLayout(group)
    rows.addWidget(shown)
    return group
