"""All keys of the program on one page, made from the declared commands."""

from __future__ import annotations

from collections.abc import Collection
from html import escape

from PyQt6.QtGui import QKeySequence
from PyQt6.QtWidgets import QDialog, QTextBrowser, QWidget

from sketchterrain.ui.action_list import COMMANDS
from sketchterrain.ui.dialogs.sheet import button_row, column
from sketchterrain.ui.look.theme import theme

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
