"""Panels of the view and of the world's settings."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import Final

from PyQt6.QtCore import QRegularExpression, QSignalBlocker, QTimer, pyqtSignal
from PyQt6.QtGui import QRegularExpressionValidator
from PyQt6.QtWidgets import (
    QCheckBox,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QMenu,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from sketchterrain.document.parameter_types import Parameter, Value
from sketchterrain.document.parameters import SKETCH, WEATHER
from sketchterrain.errors import InputError
from sketchterrain.ui.commands.settings import WORLD, declared, reset_setting, set_setting, settings
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.look.theme import SMALL, SPACING, tabular, tool_button
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.panels.form import NumberRow, ParameterForm
from sketchterrain.ui.panels.numbers import help_of, number, setting_title, tool_tip
from sketchterrain.ui.panels.parts import Group, ScrollingPanel, faint_label

# Names are those of `render.overlays.OVERLAYS`, which a window does not import: it would load OpenGL.
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
    return _TITLES.get(name, setting_title(name)).lower()


_SEED: Final[Parameter] = SKETCH["seed"]
_REMEMBERED: Final = 20
_FACES: Final = 1_000_000
"""Dice show fewer seeds than there are: numbers that one can tell another person."""


class SeedRow(QWidget):
    """The seed of a sketch, and those that it had before."""

    edited = pyqtSignal(object)
    """A person wants another seed."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._seed = 0
        self._used: list[int] = []
        self.field = self._make_field()
        self.dice = tool_button(
            "dice", "Throw a seed", tip="Another seed: another terrain of the same sketch", parent=self
        )
        self.dice.clicked.connect(lambda: self.edited.emit(_other_than(self._seed)))
        self.earlier = tool_button(
            "undo", "Seeds used before", tip="Go back to a seed that was used before", parent=self
        )
        self.earlier.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        self._menu = QMenu(self.earlier)
        self.earlier.setMenu(self._menu)
        self._lay_out()

    @property
    def used(self) -> tuple[int, ...]:
        """Seeds that the sketch had, the newest first."""
        return tuple(self._used)

    def show_seed(self, seed: int) -> None:
        """Show the seed and remember it."""
        self._seed = seed
        if self.field.text() != str(seed):
            self.field.setText(str(seed))
        if not self._used or self._used[0] != seed:
            self._used = [seed, *(each for each in self._used if each != seed)][:_REMEMBERED]
            self._fill_menu()

    def forget(self) -> None:
        """Forget which seeds were used: it is another sketch."""
        self._used = []

    def _finish(self) -> None:
        text = self.field.text()
        try:
            seed = int(_SEED.check(int(text or "0")))
        except InputError:
            seed = int(_SEED.high)  # nineteen digits can say more than a seed holds
        self.field.setText(str(seed))
        if seed != self._seed:
            self.edited.emit(seed)

    def _fill_menu(self) -> None:
        self._menu.clear()
        for seed in self._used[1:]:
            action = self._menu.addAction(f"Seed {seed}")
            if action is not None:
                action.triggered.connect(lambda _, seed=seed: self.edited.emit(seed))
        self.earlier.setEnabled(len(self._used) > 1)

    def _make_field(self) -> QLineEdit:
        field = QLineEdit(self)
        field.setFont(tabular(field.font()))
        field.setValidator(QRegularExpressionValidator(QRegularExpression("[0-9]{0,19}"), field))
        field.setAccessibleName("Seed")
        field.setToolTip(tool_tip(_SEED))
        field.editingFinished.connect(self._finish)
        return field

    def _lay_out(self) -> None:
        title = QLabel("&Seed", self)
        title.setBuddy(self.field)
        across = QHBoxLayout()
        across.setSpacing(SMALL)
        across.addWidget(title)
        across.addSpacing(SPACING)
        across.addWidget(self.field, 1)
        across.addWidget(self.dice)
        across.addWidget(self.earlier)
        down = QVBoxLayout(self)
        down.setContentsMargins(0, 0, 0, 0)
        down.setSpacing(SMALL)
        down.addLayout(across)
        down.addWidget(faint_label(help_of(_SEED), self))


def _other_than(seed: int) -> int:
    thrown = random.randrange(_FACES - 1)  # noqa: S311 # a terrain, no secret
    return thrown + (thrown >= seed)


_GROUPS: Final = {"ground": "Ground between", "climate": "Climate", "density": "Unpainted land"}
"""Tables that are shown here, in this order, and what they are called."""
_WORLD_TITLES: Final = {
    "density": {"mountain": "Mountains", "hill": "Hills", "dune": "Dunes", "forest": "Groves"}
}


class WorldPanel(ScrollingPanel):
    """The settings of a sketch as a whole."""

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self.fidelity = NumberRow(SKETCH["fidelity"], title="Follow the paint", decimals=2, parent=self)
        self.seed = SeedRow(self)
        self.top = ParameterForm([SKETCH["name"], SKETCH["extent"]])
        self._size = faint_label()
        self.forms = {
            table: ParameterForm(declared(table).values(), titles=_WORLD_TITLES.get(table))
            for table in _GROUPS
        }
        self._lay_out()
        self.fidelity.edited.connect(lambda value, key: self._set(WORLD, "fidelity", value, key))
        self.fidelity.reset_asked.connect(lambda: self._reset(WORLD, "fidelity"))
        self.seed.edited.connect(lambda seed: self._set(WORLD, "seed", seed, object()))
        for table, form in {WORLD: self.top, **self.forms}.items():
            self._connect(table, form)
        document.opened.connect(self.seed.forget)
        document.sketch_changed.connect(self._fill)
        self._fill()

    def _lay_out(self) -> None:
        self.add(self.fidelity)
        self.add(self.seed)
        self.add(self.top)
        self.add(self._size)
        for table, title in _GROUPS.items():
            self.add(Group(title, self.forms[table], is_open=table == "ground"))

    def _connect(self, table: str, form: ParameterForm) -> None:
        form.edited.connect(lambda name, value, key: self._set(table, name, value, key))
        form.reset_asked.connect(lambda name: self._reset(table, name))

    def _fill(self) -> None:
        sketch = self._document.sketch
        self.fidelity.show_value(sketch.fidelity)
        self.seed.show_seed(sketch.seed)
        self.top.show_values(settings(sketch, WORLD))
        east, north = (number(metres / 1000, decimals=2) for metres in sketch.size)
        self._size.setText(
            f"{sketch.width_px} × {sketch.height_px} px, {number(sketch.pixel_size, decimals=2)} m a pixel: "
            f"{east} × {north} km"
        )
        for table, form in self.forms.items():
            form.show_values(settings(sketch, table))

    def _set(self, table: str, name: str, value: Value, key: object) -> None:
        changed = set_setting(self._document.sketch, table, name, value)
        self._document.do(_title(table, name), changed, merge=key)

    def _reset(self, table: str, name: str) -> None:
        self._document.do(
            f"Reset {_world_words(table, name)}", reset_setting(self._document.sketch, table, name)
        )


def _world_words(table: str, name: str) -> str:
    word = _WORLD_TITLES.get(table, {}).get(name, setting_title(name)).lower()
    return f"density of {word}" if table == "density" else word


def _title(table: str, name: str) -> str:
    return f"Set {_world_words(table, name)}"
