"""Dialog to trace a sketch from a picture: picture, meaning of its colours, preview of the sketch."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image
from PyQt6.QtCore import QSignalBlocker, QSize, Qt, pyqtSignal
from PyQt6.QtGui import QColor, QIcon, QImage, QPainter, QPaintEvent, QPixmap
from PyQt6.QtWidgets import (
    QComboBox,
    QDialog,
    QFrame,
    QGridLayout,
    QGroupBox,
    QLabel,
    QScrollArea,
    QStackedWidget,
    QStyle,
    QVBoxLayout,
    QWidget,
)

from sketchterrain.document.sketch import DEFAULT_SIDE, Sketch
from sketchterrain.importing.image_colours import DetectedColour
from sketchterrain.importing.images import SPECKS, ColouredMap, Kind, coloured_map, detect_kind, read_picture
from sketchterrain.importing.layered import trace_folder, trace_mask, trace_open_raster
from sketchterrain.importing.legend import INK, NOTHING, Meaning
from sketchterrain.importing.traced_layers import DEFAULT_MAX_SIDE, TraceOptions, TraceResult, sketch_picture
from sketchterrain.schema.layers import LAYERS, PAINTED_LAYERS
from sketchterrain.schema.parameters import SKETCH
from sketchterrain.ui.dialogs.form import (
    EXTENT,
    NAME,
    Field,
    Form,
    button_row,
    dialog_column,
    form_layout,
    note,
)
from sketchterrain.ui.look.layer_colours import swatch
from sketchterrain.ui.look.theme import MARGIN, SMALL, SPACING, described, row, tabular
from sketchterrain.ui.models.background import BackgroundReader, single_shot

_PREVIEW = 900  # px along the longer side
Rgba = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class TraceSource:
    """A file read once and traced whenever options change."""

    path: Path
    kind: Kind
    map: ColouredMap | None = None  # If it is a coloured map
    preview: Rgba | None = None  # (height, width, 4), if it is a picture


def read_source(path: Path) -> TraceSource:
    """Read a file; slow for large pictures."""
    kind = detect_kind(path)
    if kind != "picture":
        return TraceSource(path, kind)
    picture = read_picture(path)
    preview = _preview(picture.rgba, Image.Resampling.BOX)
    return TraceSource(path, kind, None if picture.is_grey else coloured_map(picture, path), preview)


def trace_source(
    source: TraceSource,
    options: TraceOptions,
    *,
    meanings: Sequence[Meaning | None],
    layer: str,
    specks: int,
    narrow: float,
) -> tuple[TraceResult, Rgba]:
    """Trace a file; return the sketch and its preview, (height, width, 4)."""
    if source.map is not None:
        traced: TraceResult = source.map.traced(options, meanings=meanings, specks=specks, narrow=narrow)
    elif source.kind == "picture":
        traced = trace_mask(source.path, layer, options)
    elif source.kind == "folder":
        traced = trace_folder(source.path, options)
    elif source.kind == "open raster":
        traced = trace_open_raster(source.path, options)
    else:
        from sketchterrain.importing.vectors import sketch_from_vectors

        size_px = options.size_px or DEFAULT_SIDE
        traced = sketch_from_vectors(source.path, name=options.name, size_px=size_px)
    opaque = np.full((traced.sketch.height_px, traced.sketch.width_px, 4), 255, dtype=np.uint8)
    opaque[..., :3] = sketch_picture(traced.sketch)
    return traced, _preview(opaque, Image.Resampling.NEAREST)


def _preview(rgba: Rgba, resampling: Image.Resampling) -> Rgba:
    image = Image.fromarray(rgba)
    scale = _PREVIEW / max(image.size)
    if scale < 1.0:
        size = (max(1, round(image.width * scale)), max(1, round(image.height * scale)))
        image = image.resize(size, resampling)
    return np.asarray(image)


_MIN_SIZE = QSize(320, 220)


class ScaledPicture(QWidget):
    """A picture scaled to the available room."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.image = QImage()
        self.setAccessibleName(name)
        self.setMinimumSize(_MIN_SIZE)

    def show_pixels(self, rgba: Rgba | None) -> None:
        height, width = (0, 0) if rgba is None else rgba.shape[:2]
        data = b"" if rgba is None else rgba.tobytes()
        self.image = QImage(data, width, height, 4 * width, QImage.Format.Format_RGBA8888).copy()
        self.update()

    def paintEvent(self, event: QPaintEvent | None) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        size = self.image.size().scaled(self.size(), Qt.AspectRatioMode.KeepAspectRatio)
        painter.drawImage(
            QStyle.alignedRect(self.layoutDirection(), Qt.AlignmentFlag.AlignCenter, size, self.rect()),
            self.image,
        )


_SWATCH = 16  # px
_MAX_ROWS = 24
_MAX_VISIBLE = 7  # rows without scrolling
_LABELS = 3  # offered for each layer


def meaning_box(*, special: bool = True) -> QComboBox:
    """Return a combo box of all meanings of a colour."""
    box = QComboBox()
    box.setIconSize(QSize(_SWATCH, _SWATCH))
    if special:
        box.addItem("Nothing", NOTHING)
        box.addItem("Lettering, outlines", INK)
    for label in range(1, _LABELS + 1):
        for name in PAINTED_LAYERS:
            title = LAYERS[name].title if label == 1 else f"{LAYERS[name].title} {label}"
            box.addItem(QIcon(swatch(name, label, _SWATCH)), title, Meaning(name, label))
    box.setMaxVisibleItems(box.count())
    return box


class ColourTable(QScrollArea):
    """A row with the meaning of each colour; emits `changed` when one changes."""

    changed = pyqtSignal()

    def __init__(self) -> None:
        super().__init__()
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setWidgetResizable(True)
        self.setAccessibleName("Colours of the map")
        self._rest: tuple[Meaning | None, ...] = ()  # of colours without a row
        self.boxes: list[QComboBox] = []

    @property
    def meanings(self) -> tuple[Meaning | None, ...]:
        return (*(box.currentData() for box in self.boxes), *self._rest)

    def show_colours(self, colours: Sequence[DetectedColour], meanings: Sequence[Meaning | None]) -> None:
        self._rest = tuple(meanings[_MAX_ROWS:])
        self.boxes = []
        page = QWidget()
        grid = QGridLayout(page)
        grid.setContentsMargins(0, 0, SPACING, 0)
        grid.setHorizontalSpacing(SPACING)
        grid.setVerticalSpacing(SMALL)
        for index, (colour, meaning) in enumerate(zip(colours[:_MAX_ROWS], meanings, strict=False)):
            pixels = QPixmap(2 * _SWATCH, _SWATCH)
            pixels.fill(QColor(*colour.rgb))
            picture = QLabel()
            picture.setPixmap(pixels)
            picture.setToolTip(colour.code)
            share = QLabel(f"{100.0 * colour.share:.1f}\u202f%")
            share.setFont(tabular(share.font()))
            box = described(meaning_box(), f"What {colour.code} becomes", f"What {colour.code} becomes")
            box.setCurrentIndex(_index_of(box, meaning))
            box.currentIndexChanged.connect(lambda _: self.changed.emit())
            self.boxes.append(box)
            for column, widget in enumerate((picture, share, box)):
                grid.addWidget(widget, index, column)
        grid.setColumnStretch(2, 1)
        grid.setRowStretch(len(self.boxes), 1)
        self.setWidget(page)
        if self.boxes:
            height = self.boxes[0].sizeHint().height() + SMALL
            self.setMinimumHeight(min(len(self.boxes), _MAX_VISIBLE) * height)


def _index_of(box: QComboBox, meaning: Meaning | None) -> int:
    data = NOTHING if meaning is None else meaning
    # `findData` compares Python objects by identity.
    indices = [index for index in range(box.count()) if box.itemData(index) == data]
    if not indices:
        box.addItem(str(data), data)
    return indices[0] if indices else box.count() - 1


_DELAY = 150  # ms without a change until the picture is traced again
_MAX_NOTES = 3


class TraceDialog(QDialog):
    """Asks for the meaning of a picture's colours and traces a sketch from it."""

    def __init__(self, path: Path, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._source: TraceSource | None = None
        self._result: TraceResult | None = None
        self._reading = BackgroundReader(self)
        self._reading.failed.connect(self._show_error)
        self._timer = single_shot(self, _DELAY, self._trace)
        self.finished.connect(self._cancel)
        self.before, self.after = ScaledPicture("The picture"), ScaledPicture("The sketch")
        self._picture_group = _framed("Picture", self.before)
        pictures = row(None, self._picture_group, _framed("Sketch", self.after), spacing=MARGIN)
        self._add_meanings()
        self._add_form(path)
        options = row(None, (self._meanings_group, 1), (self.form, 1), spacing=2 * MARGIN)
        self.status = note("Reading …")
        box, self.create_button = button_row(self, "Create")
        dialog_column(self, f"New from {path.name}", pictures, options, self.status, box).setStretch(0, 1)
        self.create_button.setEnabled(False)
        self.resize(860, 720)
        self._reading.read(partial(read_source, path), self._show_source)

    def sketch(self) -> Sketch:
        if self._result is None:
            raise RuntimeError("expected a traced sketch")
        return self._result.sketch

    def _cancel(self, *_: object) -> None:
        self._timer.stop()
        self._reading.cancel()

    def _add_meanings(self) -> None:
        self.colours = ColourTable()
        self.colours.changed.connect(self._trace_later)
        self.layer = meaning_box(special=False)
        self.layer.setAccessibleName("What is painted")
        self.layer.currentIndexChanged.connect(self._trace_later)
        one = QWidget()
        fields = form_layout()
        fields.addRow("What is &painted", self.layer)
        one.setLayout(fields)
        self.pages = QStackedWidget()
        for page in (self.colours, one, note("The file itself says what its parts become.")):
            self.pages.addWidget(page)
        self._meanings_group = _framed("What its colours become", self.pages)

    def _add_form(self, path: Path) -> None:
        size_tip = "Pixels of the sketch along its longer side"
        rivers_tip = "Narrower water becomes a river, wider water a lake, whatever its colour"
        rivers = Field("narrow", "Ri&vers up to", 0, rivers_tip, range=(0, 200), unit="px", text="by colour")
        self.form = Form(
            replace(NAME, default=path.stem),
            replace(EXTENT, tip="Length of the picture's longer side"),
            Field("size_px", "&Size", 512, size_tip, range=(32, 16384), unit="px"),
            Field("specks", "Spec&ks", SPECKS, "Smaller areas are removed", range=(0, 10_000), unit="px"),
            rivers,
        )
        self.form["name"].setMaxLength(int(SKETCH["name"].high))
        self.form.changed.connect(self._trace_later)

    def _show_source(self, source: TraceSource) -> None:
        self._source = source
        if source.preview is not None:
            self.before.show_pixels(source.preview)
        if source.map is not None:
            self.colours.show_colours(source.map.colours, source.map.meanings)
            self._set_size(max(source.map.rgba.shape[:2]))
        elif source.preview is not None:
            self._set_size(max(source.preview.shape[:2]))
            self._meanings_group.setTitle("What is painted in it becomes")
            self.pages.setCurrentIndex(1)
        else:
            self._meanings_group.setTitle("What it becomes")
            self.pages.setCurrentIndex(2)
            self._picture_group.hide()
        self.form.enable(source.kind != "vectors", "extent")
        self.form.enable(source.map is not None, "specks", "narrow")
        self._trace()

    def _set_size(self, longest: int) -> None:
        with QSignalBlocker(self.form):
            self.form["size_px"].setValue(min(longest, DEFAULT_MAX_SIDE))

    def _trace_later(self, *_: object) -> None:
        if self._source is not None:
            self.create_button.setEnabled(False)
            self._timer.start()

    def _trace(self) -> None:
        if self._source is None:
            return
        values = self.form.values
        name = values["name"].strip() or "Untitled"
        trace = partial(
            trace_source,
            self._source,
            TraceOptions(size_px=values["size_px"], extent=float(values["extent"]), name=name),
            meanings=self.colours.meanings,
            layer=str(self.layer.currentData()),
            specks=values["specks"],
            narrow=values["narrow"],
        )
        self._reading.read(trace, self._show_result)

    def _show_result(self, result: tuple[TraceResult, Rgba]) -> None:
        traced, preview = result
        self._result = traced
        self.after.show_pixels(preview)
        sketch = traced.sketch
        if not self.form["extent"].isEnabled():  # vectors have a scale of their own
            with QSignalBlocker(self.form):
                self.form["extent"].setValue(sketch.extent)
        east, north = (side / 1000.0 for side in sketch.size)
        size = f"{sketch.width_px} × {sketch.height_px} px"
        lines = [f"{size}, {east:.3g} km × {north:.3g} km, {sketch.pixel_size:.3g} m a pixel."]
        if self._source is not None and self._source.map is None:
            lines += [f"{line}." for line in traced.notes[:_MAX_NOTES]]
        self.status.setText("\n".join(lines))
        self.create_button.setEnabled(True)
        self.create_button.setDefault(True)

    def _show_error(self, line: str) -> None:
        self._result = None
        self.after.show_pixels(None)
        self.create_button.setEnabled(False)
        is_map = self._source is not None and self._source.map is not None
        is_unnamed = is_map and not any(each and each.label for each in self.colours.meanings)
        self.status.setText("Choose what at least one of its colours becomes." if is_unnamed else line)


def _framed(title: str, content: QWidget) -> QGroupBox:
    group = QGroupBox(title)
    QVBoxLayout(group).addWidget(content)
    return group
