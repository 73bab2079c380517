"""What the 3-D view shows: light and weather, how good the picture is, what is laid over it."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from PyQt6.QtCore import QSignalBlocker, QTimer
from PyQt6.QtWidgets import QCheckBox, QVBoxLayout, QWidget

from sketchterrain.sketch import WEATHER, Parameter
from sketchterrain.sketch.parameter import Value
from sketchterrain.ui.commands.settings import reset_setting, set_setting, settings
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.look.theme import SMALL, SPACING
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.panels.form import NumberRow, ParameterForm
from sketchterrain.ui.panels.parts import Group, ScrollingPanel
from sketchterrain.ui.panels.wording import drag_title

# Names are those of `sketchterrain.render.OVERLAYS`, which a window does not import: it would load OpenGL.
OVERLAY_TITLES: Final = {
    "features": ("Placed features", "Rings about features, rivers' splines, lakes' shores"),
    "materials": ("Materials", "What covers the ground, each in a colour of its own"),
    "wireframe": ("Triangles", "The triangles that are drawn, coloured by their tile's level"),
    "levels": ("Levels of detail", "Tiles, coloured by level"),
    "error": ("Geometric error", "Tiles, coloured by how far they are from full detail (m)"),
    "screen-error": ("Error on the screen", "Tiles, coloured by what their error covers on the screen (px)"),
    "triplanar": ("Texture planes", "Which planes the ground is textured from"),
}
"""What can be laid over the view: its title and its help, by name."""

_TITLES: Final = {"hour": "Time of day", "wind_from": "Wind from"}
_AUTOMATIC: Final = -1.0
_QUALITY: Final = Parameter(
    "quality", float, _AUTOMATIC, _AUTOMATIC, 1.0, "", "0 is quick, 1 is as good as it gets"
)
_PAUSE: Final = (
    120  # ms that a slider of the quality rests before it is told: a change of it is no small work
)


class ViewPanel(ScrollingPanel):
    """Settings of the picture. The weather is the sketch's; the rest is forgotten with the program."""

    def __init__(self, document: Document, link: EngineLink, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._link = link
        self.weather = ParameterForm(WEATHER.values(), titles=_TITLES)
        self.quality = NumberRow(_QUALITY, title="Picture quality", decimals=2)
        self.plays = _box("Things &move", "Water runs, clouds drift and plants sway")
        self.overlays = {name: _box(*words) for name, words in OVERLAY_TITLES.items()}
        self._wanted: float | None = None
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(_PAUSE)
        self._lay_out()
        self._connect()
        self._fill_weather()
        self._fill_view()

    def _lay_out(self) -> None:
        self.add(Group("Light and weather", self.weather))
        picture = QWidget(self)
        down = QVBoxLayout(picture)
        down.setContentsMargins(0, 0, 0, 0)
        down.setSpacing(SPACING)
        down.addWidget(self.quality)
        down.addWidget(self.plays)
        self.add(Group("Picture", picture))
        shown = QWidget(self)
        column = QVBoxLayout(shown)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(SMALL)
        for box in self.overlays.values():
            column.addWidget(box)
        self.add(Group("Shown on the terrain", shown))

    def _connect(self) -> None:
        self.weather.edited.connect(self._set_weather)
        self.weather.reset_asked.connect(self._reset_weather)
        self.quality.edited.connect(self._want_quality)
        self.quality.reset_asked.connect(lambda: self._want_quality(_AUTOMATIC))
        self._timer.timeout.connect(self._show_quality)
        self.plays.toggled.connect(lambda on: self._link.set_view(replace(self._link.view, plays=on)))
        for name, box in self.overlays.items():
            box.toggled.connect(lambda on, name=name: self._show_overlay(name, on))
        self._document.sketch_changed.connect(self._fill_weather)
        self._link.view_changed.connect(self._fill_view)

    def _fill_weather(self) -> None:
        self.weather.show_values(settings(self._document.sketch, "weather"))

    def _fill_view(self) -> None:
        view = self._link.view
        if not self._timer.isActive():
            self.quality.show_value(_AUTOMATIC if view.quality is None else view.quality)
        for box, on in [(self.plays, view.plays)] + [
            (box, name in view.overlays) for name, box in self.overlays.items()
        ]:
            with QSignalBlocker(box):
                box.setChecked(on)

    def _set_weather(self, name: str, value: Value, key: object) -> None:
        changed = set_setting(self._document.sketch, "weather", name, value)
        self._document.do(f"Set {_words(name)}", changed, merge=key)

    def _reset_weather(self, name: str) -> None:
        changed = reset_setting(self._document.sketch, "weather", name)
        self._document.do(f"Reset {_words(name)}", changed)

    def _want_quality(self, quality: float) -> None:
        self._wanted = None if quality == _AUTOMATIC else quality
        self._timer.start()
        self.quality.show_value(quality)

    def _show_quality(self) -> None:
        self._link.set_view(replace(self._link.view, quality=self._wanted))

    def _show_overlay(self, name: str, on: bool) -> None:
        kept = [each for each in OVERLAY_TITLES if (on if each == name else each in self._link.view.overlays)]
        self._link.set_view(replace(self._link.view, overlays=tuple(kept)))


def _box(title: str, tip: str) -> QCheckBox:
    box = QCheckBox(title)
    box.setAccessibleName(title.replace("&", ""))
    box.setToolTip(tip)
    return box


def _words(name: str) -> str:
    return _TITLES.get(name, drag_title(name)).lower()
