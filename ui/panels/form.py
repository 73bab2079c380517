"""A form made from the declaration of parameters: a row for each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from PyQt6.QtCore import pyqtSignal
from PyQt6.QtWidgets import QVBoxLayout, QWidget

from sketchterrain.sketch import Parameter
from sketchterrain.sketch.parameter import Value
from sketchterrain.ui.look.theme import SPACING
from sketchterrain.ui.panels.number_row import NumberRow
from sketchterrain.ui.panels.parameter_row import ChoiceRow, ParameterRow, TextRow


def row_of(parameter: Parameter, *, title: str = "", explains: bool = True) -> ParameterRow:
    """Return a row that suits a parameter."""
    if parameter.choices:
        return ChoiceRow(parameter, title=title, explains=explains)
    if parameter.kind is str:
        return TextRow(parameter, title=title, explains=explains)
    return NumberRow(parameter, title=title, explains=explains)


class ParameterForm(QWidget):
    """Parameters, one beneath the other."""

    edited = pyqtSignal(str, object, object)
    """A person gave a parameter another value: its name, the value, the key of the gesture."""
    reset_asked = pyqtSignal(str)
    """A person wants the default of a parameter back."""

    def __init__(
        self,
        parameters: Iterable[Parameter],
        *,
        titles: Mapping[str, str] | None = None,
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent)
        self.rows: dict[str, ParameterRow] = {}
        down = QVBoxLayout(self)
        down.setContentsMargins(0, 0, 0, 0)
        down.setSpacing(SPACING)
        for parameter in parameters:
            title = (titles or {}).get(parameter.name, "")
            row = row_of(parameter, title=title, explains=parameter.name != "name")  # a name needs no word
            self._connect(parameter.name, row)
            down.addWidget(row)

    def show_values(self, values: Mapping[str, Value]) -> None:
        """Show what is set, by name; tells nobody."""
        for name, row in self.rows.items():
            row.show_value(values[name])

    def finish(self) -> None:
        """Take what is being typed as it stands."""
        for row in self.rows.values():
            if isinstance(row, NumberRow):
                row.finish()

    def _connect(self, name: str, row: ParameterRow) -> None:
        self.rows[name] = row
        row.edited.connect(lambda value, key: self.edited.emit(name, value, key))
        row.reset_asked.connect(lambda: self.reset_asked.emit(name))
