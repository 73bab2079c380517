"""Help: the program, first steps, keys, and finding a command."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from html import escape
from importlib.metadata import PackageNotFoundError, version

from PyQt6.QtCore import PYQT_VERSION_STR, QEvent, QObject, QSize, Qt, qVersion
from PyQt6.QtGui import QAction, QIcon, QKeyEvent, QKeySequence, QPixmap
from PyQt6.QtWidgets import (
    QDialog,
    QGridLayout,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QLineEdit,
    QTextBrowser,
    QTreeWidget,
    QTreeWidgetItem,
    QVBoxLayout,
    QWidget,
)

from sketchterrain.ui.actions import COMMANDS
from sketchterrain.ui.dialogs.form import button_row, column, fix_width, form_layout, heading, note
from sketchterrain.ui.engine.protocol import EngineFacts
from sketchterrain.ui.look.theme import MARGIN, SMALL, SPACING, app_picture, icon, theme

_SAID = "Paint a rough sketch, get a seamless terrain that does what the sketch says."
_PAPERS = (
    "R. Zaaijer, Semi-procedural terrain from sketches, thesis, 2013",
    "E. Bruneton, F. Neyret, Real-time rendering and editing of vector-based terrains, 2008",
    "K. Perlin, Noise hardware (simplex noise), 2001",
    "F. Losasso, H. Hoppe, Geometry clipmaps, 2004",
    "R. Bridson, Fast Poisson disk sampling in arbitrary dimensions, 2007",
)


class AboutDialog(QDialog):
    """Version, device, licences, papers."""

    def __init__(self, facts: EngineFacts, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        rows = column(self, "About Sketchterrain")
        head = QHBoxLayout()
        head.setSpacing(MARGIN)
        picture = QLabel()
        picture.setPixmap(app_picture(72, self.devicePixelRatioF()))
        head.addWidget(picture)
        words = QVBoxLayout()
        words.setSpacing(SMALL)
        words.addStretch(1)
        words.addWidget(heading(f"Sketchterrain {_version('sketchterrain')}"))
        words.addWidget(note(_SAID))
        words.addStretch(1)
        head.addLayout(words, 1)
        rows.addLayout(head)
        runs_on = form_layout()
        for title, said in _facts(facts).items():
            label = QLabel(said)
            label.setWordWrap(True)
            label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
            name = note(title)
            name.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignTop)
            runs_on.addRow(name, label)
        rows.addLayout(runs_on)
        rows.addWidget(
            note(
                "Free software under the GNU General Public License, version 3 or later. Its window is made "
                "with PyQt (GPL 3) and Qt (LGPL 3)."
            )
        )
        papers = "".join(f"<li>{paper}</li>" for paper in _PAPERS)
        rows.addWidget(note(f"It builds on<ul style='margin-left: -18px'>{papers}</ul>"))
        rows.addStretch(1)
        rows.addWidget(button_row(self, "", cancel="Close")[0])
        fix_width(self, 520)


def _facts(facts: EngineFacts) -> dict[str, str]:
    """Return what the program runs on, by what it is."""
    sharing = {
        "extension": "shared memory of OpenCL and OpenGL",
        "mapped": "memory that both map",
        "copy": "a copy in main memory",
    }
    said = {
        "OpenCL": f"{facts.device} ({facts.platform})"
        if facts.device
        else facts.device_error or "not yet known",
        "OpenGL": facts.renderer or facts.opengl_error or "not yet known",
        "Heights travel by": sharing.get(facts.sharing, ""),
        "Python, Qt": f"PyQt {PYQT_VERSION_STR}, Qt {qVersion()}",
    }
    return {title: text for title, text in said.items() if text}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:  # run from a folder that was never installed
        return ""


_STEPS = (
    (
        "layers",
        "Choose a layer",
        "Mountains, hills, rivers, dunes, forests, lakes or materials, at the left or with 1 … 7.",
    ),
    (
        "brush",
        "Paint where it should be",
        "The terrain follows at the right. Rivers: a line (L) along their course.",
    ),
    (
        "settings",
        "Say what it is like",
        "Properties: how high, how sharp, how wide. A new label is another kind.",
    ),
    (
        "target",
        "Make it hold to the sketch",
        "World: fidelity from loose to exact; another seed is another terrain.",
    ),
    (
        "select",
        "Move what was generated",
        "With V, click a mountain or a river and drag it or its handles, in either view.",
    ),
    ("export", "Take it with you", "File ▸ Export terrain writes heights, materials, plants and maps."),
)


class FirstStepsDialog(QDialog):
    """Six steps."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        rows = column(self, "First steps")
        rows.addWidget(heading("A terrain in a minute"))
        grid = QGridLayout()
        grid.setHorizontalSpacing(MARGIN)
        grid.setVerticalSpacing(2)
        grid.setColumnStretch(1, 1)
        for number, (name, title, said) in enumerate(_STEPS):
            mark = QLabel()
            mark.setPixmap(icon(name).pixmap(28, 28))
            words = QLabel(title)
            font = words.font()
            font.setBold(True)
            words.setFont(font)
            grid.addWidget(mark, 3 * number, 0, 2, 1)
            grid.addWidget(words, 3 * number, 1)
            grid.addWidget(note(said), 3 * number + 1, 1)
            grid.setRowMinimumHeight(3 * number + 2, MARGIN)
        rows.addLayout(grid)
        rows.addStretch(1)
        rows.addWidget(button_row(self, "", cancel="Start")[0])
        fix_width(self, 500)


_MOUSE = {
    "On the sketch": (
        ("Paint", "left button"),
        ("Erase", "right button"),
        ("Take a label", "Alt + click"),
        ("Size of the brush", "[ and ], or Shift + wheel"),
        ("Zoom", "wheel"),
        ("Move the sheet", "Space + drag, or middle button"),
        ("End a line, take back its last point", "Enter, Backspace"),
        ("Give up a stroke", "Esc"),
        ("Delete what is selected", "Delete"),
    ),
    "In the 3-D view": (
        ("Turn", "left drag"),
        ("Move over the ground", "right drag, or Shift + left drag"),
        ("Nearer, farther", "wheel"),
        ("Go there", "double click"),
        ("Orbit, fly, walk", "1, 2, 3"),
        ("Fly and walk", "W A S D, Q E; Shift is faster"),
        ("See the selection, see all", "F, Home"),
    ),
}


class KeysDialog(QDialog):
    """Shows every key."""

    def __init__(self, parent: QWidget | None = None, names: Collection[str] = COMMANDS) -> None:
        super().__init__(parent)
        rows = column(self, "Keys")
        text = QTextBrowser()
        text.setAccessibleName("All keys")
        text.setHtml(_page(names))
        rows.addWidget(text, 1)
        rows.addWidget(button_row(self, "", cancel="Close")[0])
        self.resize(520, 620)


def _page(names: Collection[str]) -> str:
    """Return the keys of commands, and of the mouse, as a page."""
    keys = [
        (command.text.replace("&", "").rstrip("…"), ", ".join(_key(key) for key in command.keys))
        for name, command in COMMANDS.items()
        if command.keys and name in names
    ]
    parts = {**_MOUSE, "Everywhere": tuple(keys)}
    if "fit" not in names:  # there is no sketch
        del parts["On the sketch"]
    faint = theme().faint.name()
    page = ""
    for title, lines in parts.items():
        cells = "".join(
            f"<tr><td width='56%' style='padding: 2px 12px 2px 0'>{escape(what)}</td>"
            f"<td style='color: {faint}'>{escape(how)}</td></tr>"
            for what, how in lines
        )
        page += f"<h3>{title}</h3><table width='100%'>{cells}</table>"
    return page


def _key(key: str) -> str:
    return QKeySequence(key).toString(QKeySequence.SequenceFormat.NativeText)


class FindDialog(QDialog):
    """Asks for a command; `chosen` is its action when it was accepted."""

    def __init__(self, actions: Iterable[QAction], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("Find a command")
        self._actions = [action for action in actions if action.isEnabled()]
        none = QPixmap(16, 16)
        none.fill(Qt.GlobalColor.transparent)
        self._none = QIcon(none)  # keeps words in line
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
        rows = QVBoxLayout(self)
        rows.setContentsMargins(SPACING, SPACING, SPACING, SPACING)
        rows.setSpacing(SPACING)
        rows.addWidget(self.text)
        rows.addWidget(self.list)
        self.text.textChanged.connect(self._fill)
        self.text.returnPressed.connect(self.accept)
        self.text.installEventFilter(self)
        self.list.itemClicked.connect(self.accept)
        self._fill("")
        self.resize(440, 360)

    @property
    def selected(self) -> QAction | None:
        """The action that is marked."""
        item = self.list.currentItem()
        return None if item is None else self._actions[int(item.data(0, Qt.ItemDataRole.UserRole))]

    def eventFilter(self, watched: QObject | None, event: QEvent | None) -> bool:
        """Let the arrows choose in the list while one types."""
        if isinstance(event, QKeyEvent) and event.type() == QEvent.Type.KeyPress:
            step = {Qt.Key.Key_Down: 1, Qt.Key.Key_Up: -1}.get(Qt.Key(event.key()), 0)
            count = self.list.topLevelItemCount()
            if step and count:
                self._mark((self.list.indexOfTopLevelItem(self.list.currentItem()) + step) % count)
                return True
        return super().eventFilter(watched, event)

    def _fill(self, text: str) -> None:
        self.list.clear()
        words = text.lower().split()
        for place, action in enumerate(self._actions):
            said = f"{_plain(action)} {action.statusTip()}".lower()
            if all(word in said for word in words):
                keys = action.shortcut().toString(QKeySequence.SequenceFormat.NativeText)
                item = QTreeWidgetItem([_plain(action), keys])
                item.setIcon(0, action.icon() if not action.icon().isNull() else self._none)
                item.setToolTip(0, action.statusTip())
                item.setData(0, Qt.ItemDataRole.UserRole, place)
                item.setForeground(1, theme().faint)
                item.setSizeHint(0, QSize(0, 26))
                self.list.addTopLevelItem(item)
        self._mark(0)

    def _mark(self, row: int) -> None:
        item = self.list.topLevelItem(row)
        if item is not None:
            self.list.setCurrentItem(item)


def _plain(action: QAction) -> str:
    return action.text().replace("&", "").rstrip("…")
