"""Dialogs that start a sketch, a new one, a preset or a recovered one, and that save a picture."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PyQt6.QtCore import QDateTime, QLocale, QSize, Qt
from PyQt6.QtGui import QIcon, QImage
from PyQt6.QtWidgets import (
    QDialog,
    QDialogButtonBox,
    QListView,
    QListWidget,
    QListWidgetItem,
    QWidget,
)

from sketchterrain.document.sketch import Sketch
from sketchterrain.document.toml_format import starter_sketch
from sketchterrain.io.resources import preset_names, preset_picture
from sketchterrain.schema.layers import LAYERS
from sketchterrain.schema.parameters import SKETCH
from sketchterrain.ui.banner import ask_picture_path
from sketchterrain.ui.commands import random_seed
from sketchterrain.ui.dialogs.form import (
    EXTENT,
    NAME,
    Field,
    Form,
    add_button,
    button_row,
    dialog_column,
    headline,
    note,
)
from sketchterrain.ui.look.theme import MARGIN, SMALL, rounded_picture
from sketchterrain.ui.models.background import Recovery

_SIZES = {
    f"{width} × {height}": (width, height)
    for width, height in ((512, 512), (768, 512), (1024, 1024), (1536, 1024), (2048, 2048), (4096, 4096))
}
_OTHER = "Other"
_SIDES = (32, 16384)  # px
_PICTURES = ((1280, 720), (1920, 1080), (2560, 1440), (3840, 2160), (2048, 2048))


class NewSketchDialog(QDialog):
    """Asks for the size and extent of a new sketch."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        sizes = {title: title for title in (*_SIZES, _OTHER)}
        width_tip, height_tip = "Pixels from west to east", "Pixels from north to south"
        self.form = Form(
            NAME,
            Field("sheet", "&Sheet", next(iter(_SIZES)), "Pixels to paint on", choices=sizes),
            Field("width", "&Width", 512, width_tip, range=_SIDES, unit="px"),
            Field("height", "Hei&ght", 512, height_tip, range=_SIDES, unit="px"),
            EXTENT,
            Field("starter", "", False, text="With a mountain and a river to begin with"),
        )
        self.form["name"].setMaxLength(int(SKETCH["name"].high))
        self.form["name"].selectAll()
        dialog_column(self, "New sketch", self.form, 1, button_row(self, "Create")[0])
        self.form.changed.connect(self._refresh)
        self.setMinimumWidth(420)
        self._refresh()

    def sketch(self) -> Sketch:
        values = self.form.values
        if values["starter"] and self.form["starter"].isEnabled():
            sketch = starter_sketch()
        else:
            width, height = self._pixels()
            sketch = Sketch(layers={next(iter(LAYERS)): np.zeros((height, width), np.uint8)})
        name = values["name"].strip() or "Untitled"
        return sketch.replace(name=name, extent=float(values["extent"]), seed=random_seed())

    def _pixels(self) -> tuple[int, int]:
        values = self.form.values
        return _SIZES.get(values["sheet"], (values["width"], values["height"]))

    def _refresh(self) -> None:
        width, height = self._pixels()
        self.form.enable(self.form["sheet"].currentData() == _OTHER, "width", "height")
        self.form["width"].setValue(width)
        self.form["height"].setValue(height)
        self.form.enable((width, height) == (512, 512), "starter")
        pixel = self.form["extent"].value() / max(width, height)
        east, north = width * pixel / 1000.0, height * pixel / 1000.0
        self.form.note.setText(f"{east:.3g} km × {north:.3g} km, {pixel:.3g} m a pixel.")


class PictureDialog(QDialog):
    """Asks for the size of a picture and a file; `view_size` (px) is that of the displayed one."""

    def __init__(
        self, view_size: tuple[int, int], folder: Path, name: str, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self._start = folder / f"{name}.png"
        self.path: Path | None = None
        sizes = {"": f"As it is shown, {view_size[0]} × {view_size[1]}"} if all(view_size) else {}
        sizes |= {f"{w} {h}": f"Best quality, {w} × {h}" for w, h in _PICTURES}
        self.form = Form(Field("size", "&Picture", next(iter(sizes)), choices=sizes))
        self.form.note.setText("Best quality is rendered from the current viewpoint in some seconds.")
        buttons = button_row(self, "Save…", on_accept=self._ask_path)[0]
        dialog_column(self, "Save picture", self.form, 1, buttons)
        self.setMinimumWidth(420)

    @property
    def render_size(self) -> tuple[int, int] | None:
        """Width and height (px) to render; None for the displayed picture."""
        size = [int(side) for side in self.form.values["size"].split()]
        return (size[0], size[1]) if size else None

    def _ask_path(self) -> None:
        self.path = ask_picture_path(self, "Save picture", self._start)
        if self.path is not None:
            self.accept()


_THUMBNAIL = QSize(320, 180)
_PRESET_TIPS = {
    "alpine_range": "A serrated range, two valleys, a forest",
    "canyon_mesa": "Mesas, buttes and a canyon with a river",
    "desert_mountains": "A desert with distant mountains",
    "island_coast": "An island with mountains, a bay and beaches",
    "mountain_pass": "A road over a pass, a village, a railway",
    "rolling_hills": "Hills, groves and a stream",
    "valley_river": "A valley with a river between hills and mountains",
}


class PresetsDialog(QDialog):
    """Asks for a preset."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.list = QListWidget()
        self.list.setViewMode(QListView.ViewMode.IconMode)
        self.list.setIconSize(_THUMBNAIL)
        self.list.setMovement(QListView.Movement.Static)
        self.list.setResizeMode(QListView.ResizeMode.Adjust)
        self.list.setSpacing(MARGIN // 2)
        self.list.setUniformItemSizes(True)
        self.list.setWordWrap(True)
        self.list.setAccessibleName("Presets")
        self.list.setObjectName("gallery")
        for name in preset_names():
            title = name.replace("_", " ").capitalize()
            image = QImage.fromData(preset_picture(name), "JPG")
            picture = rounded_picture(image, _THUMBNAIL, self.devicePixelRatioF())
            thumbnail = QIcon(picture)
            thumbnail.addPixmap(picture, QIcon.Mode.Selected)  # not tinted
            item = QListWidgetItem(thumbnail, title)
            item.setData(Qt.ItemDataRole.UserRole, name)
            item.setToolTip(_PRESET_TIPS.get(name, title))
            item.setTextAlignment(Qt.AlignmentFlag.AlignHCenter)
            item.setSizeHint(QSize(_THUMBNAIL.width() + 2 * MARGIN, _THUMBNAIL.height() + 4 * MARGIN))
            self.list.addItem(item)
        self.list.setCurrentRow(self.list.count() - 1)
        self.list.itemActivated.connect(self.accept)
        line = note("Start from one of these and paint on it.")
        dialog_column(self, "Presets", line, (self.list, 1), button_row(self, "Open")[0])
        self.resize(2 * _THUMBNAIL.width() + 160, 2 * _THUMBNAIL.height() + 260)
        self.list.setFocus()

    @property
    def name(self) -> str:
        item = self.list.currentItem()
        return str(item.data(Qt.ItemDataRole.UserRole)) if item is not None else preset_names()[0]


class RecoveryDialog(QDialog):
    """Offers to recover sketches that were not saved when the program ended."""

    def __init__(self, recoveries: Sequence[Recovery], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._recoveries = tuple(recoveries)
        self.discarded = False
        title = headline("Unsaved work was found")
        line = note("The program ended before this was saved. Recover it?")
        self.list = QListWidget()
        self.list.setAccessibleName("Recoverable sketches")
        self.list.setSpacing(SMALL)
        for recovery in self._recoveries:
            path = recovery.original
            where = "Never saved" if path is None else str(path)
            where += " (changed later)" if recovery.was_saved_since else ""
            when = QDateTime.fromSecsSinceEpoch(int(recovery.when.timestamp()))
            time = QLocale().toString(when, QLocale.FormatType.ShortFormat)
            self.list.addItem(f"{recovery.name}    {time}\n{where}")
        self.list.setCurrentRow(0)
        self.list.itemActivated.connect(self.accept)
        self._hint = note()
        box, self.recover = button_row(self, "Recover", cancel="Later")
        role = QDialogButtonBox.ButtonRole.DestructiveRole
        self.discard = add_button(box, "Delete it", role, self._discard)
        dialog_column(self, "Sketchterrain", title, line, (self.list, 1), self._hint, box)
        self.list.currentRowChanged.connect(self._refresh)
        self._refresh()
        self.resize(460, 300)

    @property
    def selected(self) -> Recovery:
        return self._recoveries[max(self.list.currentRow(), 0)]

    def _refresh(self, *_: object) -> None:
        is_older = self.selected.was_saved_since
        self._hint.setText("The file was changed later." if is_older else "")
        (self.discard if is_older else self.recover).setDefault(True)

    def _discard(self) -> None:
        self.discarded = True
        self.accept()
