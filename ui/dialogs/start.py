"""Start dialog and new sketches."""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PyQt6.QtCore import QDateTime, QLocale, QSize, Qt
from PyQt6.QtGui import QIcon, QPainter, QPainterPath, QPixmap
from PyQt6.QtWidgets import (
    QAbstractItemView,
    QDialog,
    QDialogButtonBox,
    QFileDialog,
    QListView,
    QListWidget,
    QListWidgetItem,
    QWidget,
)

from sketchterrain.document.parameters import SKETCH
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.toml_format import starter_sketch
from sketchterrain.io.resources import preset_names, preset_picture
from sketchterrain.ui.dialogs.form import (
    EXTENT,
    NAME,
    Field,
    Form,
    add_button,
    button_row,
    column,
    heading,
    note,
)
from sketchterrain.ui.look.theme import MARGIN, SMALL
from sketchterrain.ui.models.autosave import Recovery

_SIZES = {
    f"{width} × {height}": (width, height)
    for width, height in ((512, 512), (768, 512), (1024, 1024), (1536, 1024), (2048, 2048), (4096, 4096))
}
_OTHER = "Other"
_SIDES = (32, 16384)  # px
_SEEDS = 1_000_000
_PICTURES = ((1280, 720), (1920, 1080), (2560, 1440), (3840, 2160), (2048, 2048))


class NewSketchDialog(QDialog):
    """Asks for the size and extent of a new sketch; see `sketch` when it was accepted."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        rows = column(self, "New sketch")
        sizes = {title: title for title in (*_SIZES, _OTHER)}
        self.form = Form(
            NAME,
            Field("sheet", "&Sheet", next(iter(_SIZES)), "Pixels that you paint on", choices=sizes),
            Field("width", "&Width", 512, "Pixels from west to east", range=_SIDES, unit="px", decimals=0),
            Field(
                "height", "Hei&ght", 512, "Pixels from north to south", range=_SIDES, unit="px", decimals=0
            ),
            EXTENT,
            Field("starter", "", False, words="With a mountain and a river to begin with"),
        )
        self.form["name"].setMaxLength(int(SKETCH["name"].high))
        self.form["name"].selectAll()
        rows.addWidget(self.form)
        rows.addStretch(1)
        rows.addWidget(button_row(self, "Create")[0])
        self.form.changed.connect(self._show)
        self.setMinimumWidth(420)
        self._show()

    def sketch(self) -> Sketch:
        """Return the new sketch, with a seed of its own."""
        values = self.form.values
        if values["starter"] and self.form["starter"].isEnabled():
            begun = starter_sketch()
        else:
            width, height = self._pixels()
            begun = Sketch(layers={"mountain": np.zeros((height, width), np.uint8)})
        return begun.replace(
            name=values["name"].strip() or "Untitled",
            extent=float(values["extent"]),
            seed=random.randrange(_SEEDS),  # noqa: S311 - a terrain, no secret
        )

    def _pixels(self) -> tuple[int, int]:
        values = self.form.values
        return _SIZES.get(values["sheet"], (values["width"], values["height"]))

    def _show(self) -> None:
        width, height = self._pixels()
        self.form.enable(self.form["sheet"].currentData() == _OTHER, "width", "height")
        self.form["width"].setValue(width)
        self.form["height"].setValue(height)
        self.form.enable((width, height) == (512, 512), "starter")
        pixel = self.form["extent"].value() / max(width, height)
        east, north = width * pixel / 1000.0, height * pixel / 1000.0
        self.form.note.setText(f"{east:.3g} km × {north:.3g} km of land, {pixel:.3g} m a pixel.")


class PictureDialog(QDialog):
    """Asks how large a picture shall be (`shown`: the size of the view, px), then where to save it."""

    def __init__(
        self, shown: tuple[int, int], folder: Path, name: str, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self._start = folder / f"{name}.png"
        self.path: Path | None = None
        rows = column(self, "Save picture")
        sizes = {"": f"As it is shown, {shown[0]} × {shown[1]}"} if all(shown) else {}
        sizes |= {f"{w} {h}": f"Best quality, {w} × {h}" for w, h in _PICTURES}
        self.form = Form(Field("size", "&Picture", next(iter(sizes)), choices=sizes))
        self.form.note.setText(
            "The best quality is drawn anew from where the eye is; that takes some seconds."
        )
        rows.addWidget(self.form)
        rows.addStretch(1)
        rows.addWidget(button_row(self, "Save…", on_accept=self._ask)[0])
        self.setMinimumWidth(420)

    @property
    def render_size(self) -> tuple[int, int] | None:
        """Width and height of a new picture, px; None: as it is shown."""
        size = [int(side) for side in self.form.values["size"].split()]
        return (size[0], size[1]) if size else None

    def _ask(self) -> None:
        name, _ = QFileDialog.getSaveFileName(self, "Save picture", str(self._start), "Pictures (*.png)")
        if name:
            path = Path(name)
            self.path = path if path.suffix.lower() == ".png" else path.with_name(path.name + ".png")
            self.accept()


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
