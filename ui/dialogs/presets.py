"""The gallery of sketches that come with the program."""

from __future__ import annotations

from PyQt6.QtCore import QSize, Qt
from PyQt6.QtGui import QIcon, QPainter, QPainterPath, QPixmap
from PyQt6.QtWidgets import QAbstractItemView, QDialog, QListView, QListWidget, QListWidgetItem, QWidget

from sketchterrain.resources import preset_names, preset_picture
from sketchterrain.ui.dialogs.sheet import button_row, column, note
from sketchterrain.ui.look.theme import MARGIN

_PICTURE = QSize(320, 180)
_ROUND = 6.0
_SAID = {
    "alpine_range": "A serrated range, two valleys, a forest",
    "desert_mountains": "A desert with distant mountains",
    "rolling_hills": "Hills, groves and a stream",
    "valley_river": "A valley with a river between hills and mountains",
}


class PresetsDialog(QDialog):
    """Asks which preset to begin with; see `name` when it was accepted."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        rows = column(self, "Presets")
        rows.addWidget(note("Begin with one of these, and paint it into your own."))
        self.list = QListWidget()
        self.list.setViewMode(QListView.ViewMode.IconMode)
        self.list.setIconSize(_PICTURE)
        self.list.setMovement(QListView.Movement.Static)
        self.list.setResizeMode(QListView.ResizeMode.Adjust)
        self.list.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.list.setSpacing(MARGIN // 2)
        self.list.setUniformItemSizes(True)
        self.list.setWordWrap(True)
        self.list.setAccessibleName("Presets")
        self.list.setObjectName("gallery")
        for name in preset_names():
            title = name.replace("_", " ").capitalize()
            picture = _picture(name, self.devicePixelRatioF())
            shown = QIcon(picture)
            shown.addPixmap(picture, QIcon.Mode.Selected)  # as it is, not tinted
            item = QListWidgetItem(shown, title)
            item.setData(Qt.ItemDataRole.UserRole, name)
            item.setToolTip(_SAID.get(name, title))
            item.setTextAlignment(Qt.AlignmentFlag.AlignHCenter)
            item.setSizeHint(QSize(_PICTURE.width() + 2 * MARGIN, _PICTURE.height() + 4 * MARGIN))
            self.list.addItem(item)
        self.list.setCurrentRow(self.list.count() - 1)
        self.list.itemActivated.connect(self.accept)
        rows.addWidget(self.list, 1)
        rows.addWidget(button_row(self, "Open")[0])
        self.resize(2 * _PICTURE.width() + 160, 2 * _PICTURE.height() + 260)
        self.list.setFocus()

    @property
    def name(self) -> str:
        """The preset that is chosen."""
        item = self.list.currentItem()
        return str(item.data(Qt.ItemDataRole.UserRole)) if item is not None else preset_names()[0]


def _picture(name: str, dpr: float) -> QPixmap:
    """Return a preset's picture with round corners."""
    loaded = QPixmap()
    loaded.loadFromData(preset_picture(name), "JPG")
    size = _PICTURE * dpr
    scaled = loaded.scaled(
        size, Qt.AspectRatioMode.KeepAspectRatioByExpanding, Qt.TransformationMode.SmoothTransformation
    )
    rounded = QPixmap(size)
    rounded.fill(Qt.GlobalColor.transparent)
    painter = QPainter(rounded)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    frame = QPainterPath()
    frame.addRoundedRect(rounded.rect().toRectF(), _ROUND * dpr, _ROUND * dpr)
    painter.setClipPath(frame)
    painter.drawPixmap(0, 0, scaled)
    painter.end()
    rounded.setDevicePixelRatio(dpr)
    return rounded
