"""The world that a sketch lies in: its name, size, seed and fidelity, its ground and its climate."""

from __future__ import annotations

from typing import Final

from PyQt6.QtWidgets import QWidget

from sketchterrain.sketch import SKETCH
from sketchterrain.sketch.parameter import Value
from sketchterrain.ui.commands.settings import (
    WORLD,
    declared,
    reset_setting,
    set_setting,
    settings,
)
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.panels.fidelity_row import FidelityRow
from sketchterrain.ui.panels.form import ParameterForm
from sketchterrain.ui.panels.group import Group, ScrollingPanel
from sketchterrain.ui.panels.seed_row import SeedRow
from sketchterrain.ui.panels.text import faint_label
from sketchterrain.ui.panels.wording import number, title_of

_GROUPS: Final = {"ground": "Ground between", "climate": "Climate", "density": "Unpainted land"}
"""Tables that are shown here, in this order, and what they are called."""
_TITLES: Final = {"density": {"mountain": "Mountains", "hill": "Hills", "dune": "Dunes", "forest": "Groves"}}


class WorldPanel(ScrollingPanel):
    """The settings of a sketch as a whole."""

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self.fidelity = FidelityRow(self)
        self.seed = SeedRow(self)
        self.top = ParameterForm([SKETCH["name"], SKETCH["extent"]])
        self._size = faint_label()
        self.forms = {
            table: ParameterForm(declared(table).values(), titles=_TITLES.get(table)) for table in _GROUPS
        }
        self._lay_out()
        self.fidelity.edited.connect(lambda value, key: self._set(WORLD, "fidelity", value, key))
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
        self.fidelity.show_fidelity(sketch.fidelity)
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
        self._document.do(f"Reset {_words(table, name)}", reset_setting(self._document.sketch, table, name))


def _words(table: str, name: str) -> str:
    word = _TITLES.get(table, {}).get(name, title_of(name)).lower()
    return f"density of {word}" if table == "density" else word


def _title(table: str, name: str) -> str:
    return f"Set {_words(table, name)}"
