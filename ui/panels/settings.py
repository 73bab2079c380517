"""Panels of settings: those of the sketch as a whole, and those of the 3-D view."""

from functools import partial
from typing import Final

from PyQt6.QtCore import QRegularExpression, QSignalBlocker, pyqtSignal
from PyQt6.QtGui import QRegularExpressionValidator
from PyQt6.QtWidgets import QLabel, QLineEdit, QMenu, QToolButton, QWidget

from sketchterrain.document.rasters import RasterSource, embedded
from sketchterrain.errors import InputError, one_line
from sketchterrain.schema.layers import LAYERS
from sketchterrain.schema.parameters import SKETCH, Parameter, Sentinel, Value
from sketchterrain.ui.commands import (
    DECLARED,
    WORLD,
    random_seed,
    set_setting,
    settings,
    with_raster,
)
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.look.theme import SMALL, SPACING, clear, column, described, row, tabular, tool_button
from sketchterrain.ui.models.background import single_shot
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.panels.controls import (
    CollapsibleGroup,
    ScrollingPanel,
    check_box,
    faint_label,
    help_text,
    number,
    status_label,
    title_from_key,
    tool_tip,
)
from sketchterrain.ui.panels.form import NumberRow, ParameterForm

_SEED: Final[Parameter] = SKETCH["seed"]
_MAX_USED_SEEDS: Final = 20


class SeedRow(QWidget):
    """The seed of a sketch and its previous seeds."""

    edited = pyqtSignal(object)

    def __init__(self) -> None:
        super().__init__()
        self._seed = 0
        self.used: tuple[int, ...] = ()  # seeds that the sketch had, the newest first
        self.field = described(QLineEdit(), "Seed", tool_tip(_SEED))
        self.field.setFont(tabular(self.field.font()))
        self.field.setValidator(QRegularExpressionValidator(QRegularExpression("[0-9]{0,19}"), self.field))
        self.field.editingFinished.connect(self._finish)
        self.dice = tool_button("dice", "Random seed", tip="Another seed: another terrain of the same sketch")
        self.dice.clicked.connect(lambda: self.edited.emit(random_seed(self._seed)))
        self.previous = tool_button("undo", "Previous seeds", tip="Return to a previous seed")
        self.previous.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        self._menu = QMenu(self.previous)
        self.previous.setMenu(self._menu)
        title = QLabel("&Seed")
        title.setBuddy(self.field)
        title.setContentsMargins(0, 0, SPACING, 0)
        line = row(None, title, (self.field, 1), self.dice, self.previous, spacing=SMALL)
        column(self, line, faint_label(help_text(_SEED)), spacing=SMALL)

    def show_seed(self, seed: int) -> None:
        """Show a seed and add it to the previous ones."""
        self._seed = seed
        if self.field.text() != str(seed):
            self.field.setText(str(seed))
        if self.used[:1] != (seed,):
            self.used = (seed, *(each for each in self.used if each != seed))[:_MAX_USED_SEEDS]
            self._menu.clear()
            for each in self.used[1:]:
                action = self._menu.addAction(f"Seed {each}")
                if action is not None:
                    action.triggered.connect(lambda _, seed=each: self.edited.emit(seed))
            self.previous.setEnabled(len(self.used) > 1)

    def clear_used(self) -> None:
        self.used = ()

    def _finish(self) -> None:
        try:
            seed = int(_SEED.check(int(self.field.text() or "0")))
        except InputError:
            seed = int(_SEED.high)  # nineteen digits can exceed it
        self.field.setText(str(seed))
        if seed != self._seed:
            self.edited.emit(seed)


_GROUPS: Final = {
    "ground": "Ground between",
    "geology": "Rock",
    "climate": "Climate",
    "coast": "Sea and coast",
    "density": "Unpainted land",
    "frame": "Place on Earth",
}
"""Titles of the displayed tables."""
_TITLES: Final = {
    "density": {layer.name: layer.fill.split()[0].capitalize() for layer in LAYERS.values() if layer.fill},
    "weather": {"hour": "Time of day", "wind_from": "Wind from"},
    "frame": {"crs": "CRS", "east": "Easting", "north": "Northing", "vertical": "Vertical datum"},
}


class RasterRows(QWidget):
    """The raster sources of a sketch, each to be stored in it or removed."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        self._shown: tuple[RasterSource, ...] = ()
        self.buttons: list[tuple[QToolButton, QToolButton]] = []  # to store and to remove each source
        self._column = column(self, spacing=SMALL)
        document.sketch_changed.connect(self._refresh)
        self._refresh()

    def _refresh(self) -> None:
        rasters = self._document.sketch.rasters
        if rasters == self._shown:
            return
        clear(self._column)
        self._shown, self.buttons = rasters, []
        for place, source in enumerate(rasters):
            line, label = QWidget(), status_label(one_line(source.path))
            label.setText(f"{source.title}, {source.role}")
            store = tool_button("save", f"Store {source.title}", tip="Store a copy in the sketch")
            store.setEnabled(source.content is None)
            store.clicked.connect(partial(self._store, place))
            remove = tool_button("delete", f"Remove {source.title}", tip="Remove from the sketch")
            remove.clicked.connect(partial(self._remove, place))
            row(line, (label, 1), store, remove, spacing=SMALL)
            self.buttons.append((store, remove))
            self._column.addWidget(line)

    def _store(self, place: int, _: bool = False) -> None:
        source = self._document.sketch.rasters[place]
        changed = with_raster(self._document.sketch, source, embedded(source))
        self._document.do(f"Store {source.title}", changed)

    def _remove(self, place: int, _: bool = False) -> None:
        source = self._document.sketch.rasters[place]
        self._document.do(f"Remove {source.title}", with_raster(self._document.sketch, source))


class WorldPanel(ScrollingPanel):
    """The settings of a sketch as a whole."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        self.fidelity = NumberRow(SKETCH["fidelity"], title="Follow the paint", decimals=2)
        self.seed = SeedRow()
        self.top = ParameterForm([SKETCH["name"], SKETCH["extent"]])
        self._size = faint_label()
        self.forms = {table: table_form(document, table) for table in _GROUPS}
        self.add(self.fidelity, self.seed, self.top, self._size)
        for table, title in _GROUPS.items():
            self.add(CollapsibleGroup(title, self.forms[table], is_open=table == "ground"))
        self.rasters = RasterRows(document)
        self.add(CollapsibleGroup("Rasters", self.rasters))
        self.fidelity.edited.connect(partial(_set, document, WORLD, "fidelity"))
        self.seed.edited.connect(lambda seed: _set(document, WORLD, "seed", seed, object()))
        _connect(document, WORLD, self.top)
        document.opened.connect(self.seed.clear_used)
        document.sketch_changed.connect(self._refresh)
        self._refresh()

    def _refresh(self) -> None:
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


def table_form(document: Document, table: str) -> ParameterForm:
    """Return a form for a table of the sketch file whose changes are undo steps."""
    form = ParameterForm(DECLARED[table].values(), titles=_TITLES.get(table))
    _connect(document, table, form)
    return form


def _connect(document: Document, table: str, form: ParameterForm) -> None:
    form.edited.connect(partial(_set, document, table))


def _set(document: Document, table: str, name: str, value: Value | None, key: object) -> None:
    verb, changed = "Reset" if value is None else "Set", set_setting(document.sketch, table, name, value)
    document.do(f"{verb} {_setting_title(table, name)}", changed, merge=key)


def _setting_title(table: str, name: str) -> str:
    title = _TITLES.get(table, {}).get(name, title_from_key(name)).lower()
    return f"density of {title}" if table == "density" else title


# Names are those of `sketchterrain.render.OVERLAYS`, whose import would load OpenGL.
OVERLAY_TITLES: Final = {
    "features": ("Placed features", "Outlines of features, splines of rivers, shores of lakes"),
    "materials": ("Materials", "Ground materials, each in its own colour"),
    "wireframe": ("Triangles", "Rendered triangles, coloured by the level of their tile"),
    "levels": ("Levels of detail", "Tiles, coloured by level"),
    "error": ("Geometric error", "Tiles, coloured by their geometric error (m)"),
    "screen-error": ("Error on the screen", "Tiles, coloured by their screen-space error (px)"),
    "triplanar": ("Texture planes", "Planes of the triplanar textures"),
}
"""Title and help of the 3-D view's overlays."""

_AUTOMATIC: Final = -1.0
_QUALITY: Final = Parameter(
    *("quality", float, _AUTOMATIC, _AUTOMATIC, 1.0, "", "0 is fastest, 1 is best"),
    sentinel=Sentinel(_AUTOMATIC, "Automatic", 0.5),
    soft_range=(0.0, 1.0),
)
_QUALITY_DELAY: Final = 120  # ms of rest until the quality changes, which is slow


class ViewPanel(ScrollingPanel):
    """Weather, which is the sketch's, and picture settings, which are not stored."""

    def __init__(self, document: Document, link: EngineLink) -> None:
        super().__init__()
        self._document, self._link = document, link
        self.weather = table_form(document, "weather")
        self.quality = NumberRow(_QUALITY, title="Picture quality", decimals=2)
        self.plays = check_box("Things &move", "Animate water, clouds and plants")
        self.refines = check_box("&Refine at rest", "Draw a view that stands still at the best quality")
        self.overlays = {name: check_box(*texts) for name, texts in OVERLAY_TITLES.items()}
        self._timer = single_shot(self, _QUALITY_DELAY, self._send_quality)
        picture, overlays = QWidget(), QWidget()
        column(picture, self.quality, self.plays, self.refines)
        column(overlays, *self.overlays.values(), spacing=SMALL)
        for title, page in (
            ("Light and weather", self.weather),
            ("Picture", picture),
            ("Shown on the terrain", overlays),
        ):
            self.add(CollapsibleGroup(title, page))
        self._quality = _AUTOMATIC
        self.quality.edited.connect(
            lambda quality, _: self._set_quality(_AUTOMATIC if quality is None else quality)
        )
        self.plays.toggled.connect(lambda on: link.change_view(plays=on))
        self.refines.toggled.connect(lambda on: link.change_view(refines=on))
        for name, box in self.overlays.items():
            box.toggled.connect(partial(self._show_overlay, name))
        document.sketch_changed.connect(self._show_weather)
        link.view_changed.connect(self._show_view)
        self._show_weather()
        self._show_view()

    def _show_weather(self) -> None:
        self.weather.show_values(settings(self._document.sketch, "weather"))

    def _show_view(self, *_: object) -> None:
        view = self._link.view
        if not self._timer.isActive():
            self.quality.show_value(_AUTOMATIC if view.quality is None else view.quality)
        states = [(box, name in view.overlays) for name, box in self.overlays.items()]
        for box, on in [(self.plays, view.plays), (self.refines, view.refines), *states]:
            with QSignalBlocker(box):
                box.setChecked(on)

    def _set_quality(self, quality: float) -> None:
        self._quality = quality
        self._timer.start()
        self.quality.show_value(quality)

    def _send_quality(self) -> None:
        quality = None if self._quality == _AUTOMATIC else self._quality
        self._link.change_view(quality=quality)

    def _show_overlay(self, name: str, on: bool) -> None:
        visible = {*self._link.view.overlays, name} if on else {*self._link.view.overlays} - {name}
        overlays = tuple(each for each in OVERLAY_TITLES if each in visible)
        self._link.change_view(overlays=overlays)
