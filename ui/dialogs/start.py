"""Where to start from: a preset, or work that a crash left behind."""

from __future__ import annotations

from collections.abc import Sequence

from PyQt6.QtCore import QDateTime, QLocale, QSize, Qt
from PyQt6.QtGui import QIcon, QPainter, QPainterPath, QPixmap
from PyQt6.QtWidgets import (
    QAbstractItemView,
    QDialog,
    QDialogButtonBox,
    QListView,
    QListWidget,
    QListWidgetItem,
    QWidget,
)

from sketchterrain.resources import preset_names, preset_picture
from sketchterrain.ui.dialogs.form import add_button, button_row, column, heading, note
from sketchterrain.ui.look.theme import MARGIN, SMALL
from sketchterrain.ui.models.autosave import Recovery

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


class RecoveryDialog(QDialog):
    """Offers sketches that were not saved when the program ended."""

    def __init__(self, found: Sequence[Recovery], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._found = tuple(found)
        self.discarded = False
        rows = column(self, "Sketchterrain")
        rows.addWidget(heading("Your work was kept"))
        rows.addWidget(note("The program ended before this was saved. Recover it?"))
        self.list = QListWidget()
        self.list.setAccessibleName("Sketches that were kept")
        self.list.setSpacing(SMALL)
        when = QLocale().toString
        for place, recovery in enumerate(self._found):
            path = recovery.original
            where = f"\n{path}" if path is not None else "\nNever saved"
            if recovery.was_saved_since:
                where += " (saved later)"
            kept = QDateTime.fromSecsSinceEpoch(int(recovery.when.timestamp()))
            time = when(kept, QLocale.FormatType.ShortFormat)
            item = QListWidgetItem(f"{recovery.name}    {time}{where}")
            item.setData(Qt.ItemDataRole.UserRole, place)
            self.list.addItem(item)
        self.list.setCurrentRow(0)
        self.list.itemActivated.connect(self.accept)
        rows.addWidget(self.list, 1)
        self._said = note()
        rows.addWidget(self._said)
        box, self.recover = button_row(self, "Recover", cancel="Later")
        role = QDialogButtonBox.ButtonRole.DestructiveRole
        self.discard = add_button(box, "Delete it", role, self._discard)
        rows.addWidget(box)
        self.list.currentRowChanged.connect(self._show)
        self._show()
        self.resize(460, 300)

    @property
    def selected(self) -> Recovery:
        """The one that is marked."""
        item = self.list.currentItem()
        return self._found[0 if item is None else int(item.data(Qt.ItemDataRole.UserRole))]

    def _show(self, *_: object) -> None:
        later = self.selected.was_saved_since
        self._said.setText("The file was saved after this was kept: it is newer." if later else "")
        (self.discard if later else self.recover).setDefault(True)

    def _discard(self) -> None:
        self.discarded = True
        self.accept()
