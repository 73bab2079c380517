"""Dialogs for preferences, first steps, keyboard shortcuts and about."""

from __future__ import annotations

import json
import sys
from collections.abc import Collection, Iterable
from html import escape
from importlib.metadata import version

from PyQt6.QtCore import PYQT_VERSION_STR, QEvent, QObject, QProcess, QSize, Qt, qVersion
from PyQt6.QtGui import QAction, QFont, QIcon, QKeyEvent, QKeySequence, QPixmap
from PyQt6.QtWidgets import (
    QDialog,
    QHeaderView,
    QLabel,
    QLineEdit,
    QTextBrowser,
    QTreeWidget,
    QTreeWidgetItem,
    QWidget,
)

from sketchterrain.ui.actions import COMMANDS
from sketchterrain.ui.dialogs.form import (
    Field,
    Form,
    button_row,
    dialog_column,
    fix_width,
    form_layout,
    headline,
    note,
)
from sketchterrain.ui.engine.protocol import EngineFacts
from sketchterrain.ui.look.theme import (
    CHOICES,
    MARGIN,
    SMALL,
    SPACING,
    app_icon,
    column,
    heading,
    icon,
    row,
    theme,
)
from sketchterrain.ui.models.workspace import Preferences

# In a process of its own, for drivers can crash.
_LIST_DEVICES = (
    "import json\n"
    "from sketchterrain.compute.device import list_devices\n"
    "print(json.dumps([[each.name, each.platform] for each in list_devices()]))"
)


class PreferencesDialog(QDialog):
    """Shows the preferences and sets them when accepted."""

    def __init__(self, preferences: Preferences, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._preferences = preferences
        devices = {"": "Automatic"}
        if preferences.device:
            devices[preferences.device] = preferences.device
        tip = "Which OpenCL device computes the terrain"
        self.form = Form(
            Field("theme", "&Theme", preferences.theme, choices=CHOICES),
            Field("device", "&Device", preferences.device or "", tip, choices=devices),
        )
        self.form.note.setText("Searching for devices …")
        dialog_column(self, "Preferences", self.form, 1, button_row(self, "Apply")[0])
        self.setMinimumWidth(440)
        self._process = QProcess(self)
        self._process.finished.connect(self._show_devices)
        self._process.start(sys.executable, ["-P", "-c", _LIST_DEVICES])
        self.finished.connect(self._stop_search)

    def accept(self) -> None:
        self._preferences.theme = self.form.values["theme"]
        self._preferences.device = self.form.values["device"] or None
        super().accept()

    def _show_devices(self, code: int) -> None:
        text = self._process.readAllStandardOutput().data().decode(errors="replace")
        lines = text.strip().splitlines()
        try:
            found = json.loads(lines[-1]) if code == 0 and lines else []
        except ValueError:
            found = []
        devices = self.form["device"]
        for name, platform in found:
            if devices.findData(name) < 0:
                devices.addItem("", name)
            devices.setItemText(devices.findData(name), f"{name} ({platform})")
        self.form.note.setText(
            "Every device computes the same terrain; another one restarts the engine."
            if found
            else "No OpenCL device was found: pip install 'sketchterrain[cpu]' brings drivers."
        )

    def _stop_search(self, *_: object) -> None:
        if self._process.state() != QProcess.ProcessState.NotRunning:
            self._process.finished.disconnect(self._show_devices)
            self._process.kill()
            self._process.waitForFinished(1000)


_SUMMARY = "Paint a rough sketch, get a seamless terrain that follows it."
_PAPERS = (
    "S. Zaaijer, Semi-procedural terrain from sketches, thesis, 2013",
    "E. Bruneton, F. Neyret, Real-time rendering and editing of vector-based terrains, 2008",
    "K. Perlin, Noise hardware (simplex noise), 2001",
    "F. Losasso, H. Hoppe, Geometry clipmaps, 2004",
    "R. Bridson, Fast Poisson disk sampling in arbitrary dimensions, 2007",
)


class AboutDialog(QDialog):
    """Version, device, licences, papers."""

    def __init__(self, facts: EngineFacts, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        picture = QLabel()
        picture.setPixmap(app_icon().pixmap(72, 72))
        title = headline(f"Sketchterrain {version('sketchterrain')}")
        head = row(None, picture, spacing=MARGIN)
        head.addLayout(column(None, 1, title, note(_SUMMARY), 1, spacing=SMALL), 1)
        environment = form_layout()
        for name, text in _environment(facts).items():
            label = QLabel(text)
            label.setWordWrap(True)
            label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
            title = note(name)
            title.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignTop)
            environment.addRow(title, label)
        licence = note(
            "Free software under the GNU General Public License, version 3 or later. Its window uses "
            "PyQt (GPL 3) and Qt (LGPL 3)."
        )
        items = "".join(f"<li>{paper}</li>" for paper in _PAPERS)
        papers = note(f"Based on<ul style='margin-left: -18px'>{items}</ul>")
        buttons = button_row(self, "", cancel="Close")[0]
        dialog_column(self, "About Sketchterrain", head, environment, licence, papers, 1, buttons)
        fix_width(self, 520)


def _environment(facts: EngineFacts) -> dict[str, str]:
    """Return device, driver and library versions by title."""
    sharing = {
        "extension": "shared memory of OpenCL and OpenGL",
        "mapped": "memory that both map",
        "copy": "a copy in main memory",
    }
    texts = {
        "OpenCL": f"{facts.device} ({facts.platform})"
        if facts.device
        else facts.device_error or "not yet known",
        "OpenGL": facts.renderer or facts.opengl_error or "not yet known",
        "Transfer of heights": sharing.get(facts.sharing, ""),
        "Python, Qt": f"PyQt {PYQT_VERSION_STR}, Qt {qVersion()}",
    }
    return {title: text for title, text in texts.items() if text}


_STEPS = (
    ("layers", "Select a layer", "Mountains, hills, rivers and others, at the left or with 1 … 9."),
    ("brush", "Paint where it should be", "The terrain follows at the right. Draw rivers and lakes with L."),
    ("settings", "Set its properties", "Height, sharpness, width. A new label has its own."),
    ("target", "Follow the sketch closely or loosely", "World: fidelity; another seed, another terrain."),
    ("select", "Move what was generated", "With V, drag mountains, points of rivers, or handles, in a view."),
    ("export", "Export it", "File ▸ Export terrain writes heights, materials, plants and maps."),
)


class FirstStepsDialog(QDialog):
    """First steps in six lines."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        steps = column(None, spacing=MARGIN)
        for name, title, text in _STEPS:
            symbol = QLabel()
            symbol.setPixmap(icon(name).pixmap(28, 28))
            symbol.setFixedWidth(28)
            lines = column(None, heading(title, weight=QFont.Weight.Bold), note(text), spacing=2)
            steps.addLayout(row(None, symbol, lines, spacing=MARGIN))
        buttons = button_row(self, "", cancel="Start")[0]
        dialog_column(self, "First steps", headline("A terrain in a minute"), steps, 1, buttons)
        fix_width(self, 500)


_MOUSE = {
    "On the sketch": (
        ("Paint", "left button"),
        ("Erase", "right button"),
        ("Pick a label", "Alt + click"),
        ("Size of the brush", "[ and ], or Shift + wheel"),
        ("Zoom", "wheel"),
        ("Move the sketch", "Space + drag, or middle button"),
        ("Finish a line, remove its last point", "Enter, Backspace"),
        ("Cancel a stroke", "Esc"),
        ("Delete the selection, of a line or area its vertex", "Delete"),
        ("Insert a vertex in the selected line or area", "double click"),
    ),
    "In the 3-D view": (
        ("Turn", "left drag"),
        ("Pan", "right drag, or Shift + left drag"),
        ("Zoom", "wheel"),
        ("Centre a place", "double click"),
        ("Orbit, fly, walk", "1, 2, 3"),
        ("Fly and walk", "W A S D, Q E; Shift is faster"),
        ("View the selection, view all", "F, Home"),
    ),
}


class KeysDialog(QDialog):
    """Lists all keys."""

    def __init__(self, parent: QWidget | None = None, names: Collection[str] = COMMANDS) -> None:
        super().__init__(parent)
        text = QTextBrowser()
        text.setAccessibleName("All keys")
        text.setHtml(_page(names))
        dialog_column(self, "Keys", (text, 1), button_row(self, "", cancel="Close")[0])
        self.resize(520, 620)


def _page(names: Collection[str]) -> str:
    """Return the keys of commands and the mouse as HTML."""
    rows = [
        (command.text.replace("&", "").rstrip("…"), ", ".join(_key(key) for key in command.keys))
        for name, command in COMMANDS.items()
        if command.keys and name in names
    ]
    parts = {**_MOUSE, "Everywhere": tuple(rows)}
    if "fit" not in names:  # a window without a sketch
        del parts["On the sketch"]
    faint = theme().faint.name()
    page = ""
    for title, lines in parts.items():
        cells = "".join(
            f"<tr><td width='56%' style='padding: 2px 12px 2px 0'>{escape(what)}</td>"
            f"<td style='color: {faint}'>{escape(keys)}</td></tr>"
            for what, keys in lines
        )
        page += f"<h3>{title}</h3><table width='100%'>{cells}</table>"
    return page


def _key(key: str) -> str:
    return QKeySequence(key).toString(QKeySequence.SequenceFormat.NativeText)


class FindDialog(QDialog):
    """Search for a command; `selected` is its action."""

    def __init__(self, actions: Iterable[QAction], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("Find a command")
        self._actions = [action for action in actions if action.isEnabled()]
        empty = QPixmap(16, 16)
        empty.fill(Qt.GlobalColor.transparent)
        self._empty = QIcon(empty)  # aligns titles without an icon
        self.text = QLineEdit()
        self.text.setPlaceholderText("What do you want to do?")
        self.text.setAccessibleName("What do you want to do?")
        self.list = QTreeWidget()
        self.list.setColumnCount(2)
        self.list.setHeaderHidden(True)
        self.list.setRootIsDecorated(False)
        self.list.setIconSize(QSize(16, 16))
        header = self.list.header()
        if header is not None:
            header.setStretchLastSection(False)
            header.setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
            header.setSectionResizeMode(1, QHeaderView.ResizeMode.ResizeToContents)
        self.list.setAccessibleName("Commands")
        self.list.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        column(self, self.text, self.list, margins=SPACING)
        self.text.textChanged.connect(self._fill)
        self.text.returnPressed.connect(self.accept)
        self.text.installEventFilter(self)
        self.list.itemClicked.connect(self.accept)
        self._fill("")
        self.resize(440, 360)

    @property
    def selected(self) -> QAction | None:
        item = self.list.currentItem()
        return None if item is None else self._actions[int(item.data(0, Qt.ItemDataRole.UserRole))]

    def eventFilter(self, watched: QObject | None, event: QEvent | None) -> bool:
        if isinstance(event, QKeyEvent) and event.type() == QEvent.Type.KeyPress:
            step = {Qt.Key.Key_Down: 1, Qt.Key.Key_Up: -1}.get(Qt.Key(event.key()), 0)
            count = self.list.topLevelItemCount()
            if step and count:
                self._select((self.list.indexOfTopLevelItem(self.list.currentItem()) + step) % count)
                return True
        return super().eventFilter(watched, event)

    def _fill(self, pattern: str) -> None:
        self.list.clear()
        words = pattern.lower().split()
        for index, action in enumerate(self._actions):
            text = f"{_plain(action)} {action.statusTip()}".lower()
            if all(word in text for word in words):
                keys = action.shortcut().toString(QKeySequence.SequenceFormat.NativeText)
                item = QTreeWidgetItem([_plain(action), keys])
                item.setIcon(0, action.icon() if not action.icon().isNull() else self._empty)
                item.setToolTip(0, action.statusTip())
                item.setData(0, Qt.ItemDataRole.UserRole, index)
                item.setForeground(1, theme().faint)
                item.setSizeHint(0, QSize(0, 26))
                self.list.addTopLevelItem(item)
        self._select(0)

    def _select(self, row: int) -> None:
        item = self.list.topLevelItem(row)
        if item is not None:
            self.list.setCurrentItem(item)


def _plain(action: QAction) -> str:
    return action.text().replace("&", "").rstrip("…")
