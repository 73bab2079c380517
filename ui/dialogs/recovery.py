"""What to do with work that a crash left behind."""

from __future__ import annotations

from collections.abc import Sequence

from PyQt6.QtCore import QDateTime, QLocale, Qt
from PyQt6.QtWidgets import QDialog, QDialogButtonBox, QListWidget, QListWidgetItem, QWidget

from sketchterrain.ui.dialogs.sheet import add_button, button_row, column, heading, note
from sketchterrain.ui.look.theme import SMALL
from sketchterrain.ui.models.recovery import Recovery


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
    def chosen(self) -> Recovery:
        """The one that is marked."""
        item = self.list.currentItem()
        return self._found[0 if item is None else int(item.data(Qt.ItemDataRole.UserRole))]

    def _show(self, *_: object) -> None:
        later = self.chosen.was_saved_since
        self._said.setText("The file was saved after this was kept: it is newer." if later else "")
        (self.discard if later else self.recover).setDefault(True)

    def _discard(self) -> None:
        self.discarded = True
        self.accept()
