"""The dialog for a new sketch from a picture: what it shows, what is read from it, what colours become."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import cast

from PyQt6.QtCore import QTimer
from PyQt6.QtGui import QCloseEvent
from PyQt6.QtWidgets import QDialog, QGroupBox, QHBoxLayout, QStackedWidget, QVBoxLayout, QWidget

from sketchterrain.sketch import Sketch
from sketchterrain.trace.coloured_map import SPECKS
from sketchterrain.trace.legend import Meaning
from sketchterrain.trace.sheet import LONGEST, Sheet
from sketchterrain.ui.dialogs.sheet import (
    add_rows,
    button_row,
    column,
    extent_box,
    form,
    name_line,
    note,
    pixel_box,
)
from sketchterrain.ui.dialogs.shown_picture import ShownPicture
from sketchterrain.ui.dialogs.trace_colours import ColourTable, meaning_box
from sketchterrain.ui.dialogs.trace_source import TracedShown, TraceSource, read_source, trace_source
from sketchterrain.ui.look.theme import MARGIN
from sketchterrain.ui.models.reading import Reading

_PATIENCE = 150  # ms that wishes rest until they are followed
_NOTES = 3


class TraceDialog(QDialog):
    """Asks what a picture's colours become; see `sketch` when it was accepted."""

    def __init__(self, path: Path, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._source: TraceSource | None = None
        self._made: TracedShown | None = None
        self._reading = Reading(self)
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
        wishes = QHBoxLayout()
        wishes.setSpacing(2 * MARGIN)
        wishes.addWidget(self._meanings_page(), 1)
        wishes.addLayout(self._sheet_form(path), 1)
        rows.addLayout(wishes)
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
        fields = form()
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

    def _sheet_form(self, path: Path) -> QVBoxLayout:
        self.name, self.extent = name_line(path.stem), extent_box()
        self.size_px = pixel_box(512)
        self.specks, self.narrow = pixel_box(SPECKS, 0, 10_000), pixel_box(0, 0, 200)
        self.narrow.setSpecialValueText("by colour")
        fields = form()
        controls: tuple[tuple[str, QWidget, str], ...] = (
            ("&Name", self.name, "What the sketch is called"),
            ("&Extent", self.extent, "Length of the picture's longer side"),
            ("&Size", self.size_px, "Pixels of the sketch along its longer side"),
            ("Spec&ks", self.specks, "Areas of fewer pixels vanish"),
            (
                "Ri&vers up to",
                self.narrow,
                "Narrower water is a river, wider water a lake, whichever its colour",
            ),
        )
        add_rows(fields, controls)
        for box in (self.size_px, self.specks, self.narrow):
            box.setKeyboardTracking(False)
            box.valueChanged.connect(self._change)
        self.extent.setKeyboardTracking(False)
        self.extent.valueChanged.connect(self._change)
        self.name.textEdited.connect(self._change)
        whole = QVBoxLayout()
        whole.addLayout(fields)
        whole.addStretch(1)
        return whole

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
        self.extent.setEnabled(source.kind != "vectors")
        for box in (self.specks, self.narrow):
            box.setEnabled(source.map is not None)
        self._trace()

    def _set_size(self, longest: int) -> None:
        self.size_px.blockSignals(True)
        self.size_px.setValue(min(longest, LONGEST))
        self.size_px.blockSignals(False)

    def _change(self, *_: object) -> None:
        if self._source is not None:
            self.agree.setEnabled(False)
            self._rest.start()

    def _trace(self) -> None:
        source = self._source
        if source is None:
            return
        sheet = Sheet(
            size_px=self.size_px.value(),
            extent=self.extent.value(),
            name=self.name.text().strip() or "Untitled",
        )
        layer = cast("Meaning", self.layer.currentData())
        work = partial(
            trace_source,
            source,
            sheet,
            meanings=self.colours.meanings,
            layer=str(layer),
            specks=self.specks.value(),
            narrow=self.narrow.value(),
        )
        self._reading.read(work, self._show)

    def _show(self, result: object) -> None:
        made = cast(TracedShown, result)
        self._made = made
        self.after.show_pixels(made.shown)
        sketch = made.traced.sketch
        if not self.extent.isEnabled():  # vectors have a scale of their own
            self.extent.blockSignals(True)
            self.extent.setValue(sketch.extent)
            self.extent.blockSignals(False)
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
