"""How closely the terrain follows the paint: one wide slider between two words."""

from __future__ import annotations

from PyQt6.QtCore import QSignalBlocker, QSize, Qt, pyqtSignal
from PyQt6.QtWidgets import QHBoxLayout, QLabel, QVBoxLayout, QWidget

from sketchterrain.sketch import SKETCH
from sketchterrain.ui.look.theme import SMALL, tabular
from sketchterrain.ui.panels.gesture import Gesture
from sketchterrain.ui.panels.number_box import WAY, PatientSlider
from sketchterrain.ui.panels.text import faint_label, heading
from sketchterrain.ui.panels.wording import number, tool_tip


class FidelityRow(QWidget):
    """The fidelity of a sketch."""

    edited = pyqtSignal(object, object)
    """A person wants another fidelity; and the key of the gesture."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._gesture = Gesture()
        self._fidelity = -1.0
        self._figure = QLabel(self)
        self._figure.setFont(tabular(self._figure.font()))
        self._figure.setAlignment(Qt.AlignmentFlag.AlignRight)
        self.slider = PatientSlider(self)
        self.slider.setAccessibleName("Fidelity")
        self.slider.setToolTip(tool_tip(SKETCH["fidelity"]))
        self.slider.sliderPressed.connect(self._gesture.begin)
        self.slider.sliderReleased.connect(self._gesture.end)
        self.slider.valueChanged.connect(self._tell)
        self._lay_out()

    def show_fidelity(self, fidelity: float) -> None:
        """Show how closely the terrain follows the paint."""
        self._fidelity = fidelity
        self._figure.setText(number(fidelity, decimals=2))
        if _fidelity_at(self.slider) != fidelity:
            with QSignalBlocker(self.slider):
                self.slider.setValue(round(fidelity * WAY))

    def sizeHint(self) -> QSize:
        """Return room for it in a narrow panel."""
        return QSize(220, super().sizeHint().height())

    def _tell(self) -> None:
        fidelity = _fidelity_at(self.slider)
        if fidelity != self._fidelity:
            self.edited.emit(fidelity, self._gesture.key)

    def _lay_out(self) -> None:
        title = QHBoxLayout()
        title.addWidget(heading("Follow the paint", self), 1)
        title.addWidget(self._figure)
        ends = QHBoxLayout()
        ends.addWidget(faint_label("A loose guideline", self))
        exact = faint_label("Exactly", self)
        exact.setAlignment(Qt.AlignmentFlag.AlignRight)
        ends.addWidget(exact)
        down = QVBoxLayout(self)
        down.setContentsMargins(0, 0, 0, 0)
        down.setSpacing(SMALL)
        down.addLayout(title)
        down.addWidget(self.slider)
        down.addLayout(ends)


def _fidelity_at(slider: PatientSlider) -> float:
    return round(slider.share, 2)
