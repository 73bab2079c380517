"""Panel of the real elevation beneath the sketch: its grids, how they blend, and what was found in them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

from PyQt6.QtCore import pyqtSignal
from PyQt6.QtWidgets import QPushButton, QWidget

from sketchterrain.document.rasters import RASTER, RasterSource
from sketchterrain.errors import one_line
from sketchterrain.schema.parameters import Value
from sketchterrain.ui.commands import reported, settings, with_raster
from sketchterrain.ui.look.theme import SMALL, SPACING, clear, column, described, icon, row, tool_button
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.elevation import SketchElevation, with_flat_lakes, without_offsets
from sketchterrain.ui.panels.controls import CollapsibleGroup, ScrollingPanel, faint_label, title_from_key
from sketchterrain.ui.panels.form import ParameterForm
from sketchterrain.ui.panels.settings import table_form

_KEYS: Final = ("accuracy", "vertical", "offset")
_TITLES: Final = {"vertical": "Vertical datum"}
_LONGEST: Final = 30  # characters of a heading
_ADD_TIP: Final = "Put the ground on elevation files: GeoTIFF, VRT, HGT, ASC, NumPy or zip"
_NONE: Final = "The ground is generated. Add elevation files to paint on a real place."


class GridPage(QWidget):
    """What is known of one grid, and its settings."""

    def __init__(self, source: RasterSource) -> None:
        super().__init__()
        self.text = faint_label()
        self.form = ParameterForm([RASTER[name] for name in _KEYS], titles=_TITLES)
        tip = f"Remove {one_line(source.path)} from the sketch"
        self.remove = tool_button("delete", f"Remove {source.title}", tip=tip)
        column(self, row(None, (self.text, 1), self.remove, spacing=SMALL), self.form, spacing=SPACING)


class BasePanel(ScrollingPanel):
    """The elevation grids of a sketch, and how they blend into other ground."""

    add_requested = pyqtSignal()
    change_requested = pyqtSignal(str, object)  # title, and the change: fields of a sketch from it

    def __init__(self, document: Document, elevation: SketchElevation) -> None:
        super().__init__()
        self._document, self._elevation = document, elevation
        self.pages: list[GridPage] = []
        self._shown: tuple[str, ...] = ()  # paths
        self.add_button = described(QPushButton(icon("add"), "Add elevation…"), "Add elevation", _ADD_TIP)
        self.add_button.clicked.connect(lambda: self.add_requested.emit())
        self.text = faint_label()
        self.text.setMinimumWidth(1)  # paths do not widen the panel
        tips = "Raise and lower overlapping grids until they agree", "Add level areas of the data as lakes"
        self.offsets = described(QPushButton("Remove &offsets"), "Remove offsets", tips[0])
        self.lakes = described(QPushButton("Add &lakes found in the data"), "Add lakes", tips[1])
        self.offsets.clicked.connect(partial(self._request, "Remove offsets", without_offsets))
        self.lakes.clicked.connect(partial(self._request, "Add lakes", with_flat_lakes))
        self.form = table_form(document, "base")
        self._grids = QWidget()
        self._groups = column(self._grids)
        self.add(self.text, self._grids, self.add_button, self.offsets, self.lakes, self.form)
        document.sketch_changed.connect(self._refresh)
        elevation.changed.connect(self._show_facts)
        self._refresh()

    def _refresh(self) -> None:
        sketch = self._document.sketch
        sources = sketch.elevation_rasters
        if self._shown != tuple(each.path for each in sources):
            self._fill(sources)
        for page, source in zip(self.pages, sources, strict=True):
            page.form.show_values({name: getattr(source, name) for name in _KEYS})
        self.form.show_values(settings(sketch, "base"))
        for widget in (self.lakes, self.form):
            widget.setVisible(bool(sources))
        self.offsets.setVisible(len(sources) > 1)
        self._show_facts()

    def _request(self, title: str, change: Callable[..., object], _: bool = False) -> None:
        self.change_requested.emit(title, change)

    def _fill(self, sources: tuple[RasterSource, ...]) -> None:
        clear(self._groups)
        self._shown, self.pages = tuple(each.path for each in sources), []
        for place, source in enumerate(sources):
            page = GridPage(source)
            page.form.edited.connect(partial(self._set, place))
            page.remove.clicked.connect(partial(self._remove, place))
            self.pages.append(page)
            self._groups.addWidget(CollapsibleGroup(_short(source.title), page, is_open=place == 0))

    def _show_facts(self) -> None:
        facts, busy = self._elevation.facts, self._elevation.is_busy
        for page, path in zip(self.pages, self._shown, strict=True):
            page.text.setText("\n• ".join(facts.lines.get(path, ())) or ("Reading …" if busy else "Not read"))
        line = facts.problem or "\n".join(facts.findings)
        self.text.setText(line if self.pages else _NONE)
        self.text.setToolTip(facts.problem)
        self.text.setVisible(bool(self.text.text()))

    def _set(self, place: int, name: str, value: Value | None, key: object) -> None:
        source = self._document.sketch.elevation_rasters[place]
        title = _TITLES.get(name, title_from_key(name)).lower()
        with reported(self._document.message.emit):
            value = RASTER[name].default if value is None else value
            changed = replace(source, **{name: value})  # type: ignore[arg-type] # it checks every value
            self._document.do(
                f"Set {title} of {source.title}",
                with_raster(self._document.sketch, source, changed),
                merge=key,
            )

    def _remove(self, place: int, _: bool = False) -> None:
        source = self._document.sketch.elevation_rasters[place]
        self._document.do(f"Remove {source.title}", with_raster(self._document.sketch, source))


def _short(title: str) -> str:
    """Return a file's name with its middle left out if it is long."""
    return title if len(title) <= _LONGEST else f"{title[: _LONGEST - 13]}…{title[-12:]}"
