"""Light and dark themes (palette and style sheet for Fusion), and box layouts with standard spacing."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Final, TypeVar

from PyQt6.QtCore import QObject, Qt, pyqtSignal
from PyQt6.QtGui import QColor, QFont, QGuiApplication, QPalette
from PyQt6.QtWidgets import QApplication, QBoxLayout, QHBoxLayout, QLayout, QVBoxLayout, QWidget

from sketchterrain.ui.look.icons import MARKS

SMALL: Final = 4
"""px between parts of one control."""
SPACING: Final = 8
"""px between controls."""
MARGIN: Final = 12
"""px around a group of controls."""
CHOICES: Final = {"system": "As the system", "light": "Light", "dark": "Dark"}
"""Titles of the selectable themes."""
_SCHEMES: Final = {
    "system": Qt.ColorScheme.Unknown,
    "light": Qt.ColorScheme.Light,
    "dark": Qt.ColorScheme.Dark,
}

_Box = TypeVar("_Box", bound=QBoxLayout)


@dataclass(frozen=True)
class Theme:
    """The colours of a theme."""

    name: str  # "light" or "dark"
    window: QColor
    base: QColor  # Background of editable text
    raised: QColor  # Buttons
    line: QColor  # Borders and separators
    text: QColor
    faint: QColor  # Secondary text
    disabled: QColor
    accent: QColor  # Background of a selection
    on_accent: QColor
    warning: QColor
    error: QColor
    good: QColor
    canvas: QColor  # Neutral surround of a sketch or a picture


def _theme(name: str, colours: str) -> Theme:
    return Theme(name, *(QColor(f"#{colour}") for colour in colours.split()))


LIGHT: Final = _theme(
    "light",
    "f3f3f1 ffffff fbfbfa d4d4cf 23262a 63686e aaadae 1d756b ffffff 9a6200 b3312b 1d756b c9cac8",
)
DARK: Final = _theme(
    "dark",
    "25282b 1c1e20 32363a 3f444a e4e6e8 9aa1a8 5b6065 4cb8a8 0f1f1d e3b04b f08379 4cb8a8 17191b",
)


class Looks(QObject):
    """The active theme; `changed` is emitted after another theme was applied."""

    changed = pyqtSignal()

    def __init__(self) -> None:
        super().__init__()
        self.theme = LIGHT
        self._choice = ""

    def choose(self, app: QApplication, choice: str) -> None:
        """Apply a theme of `CHOICES`; ``system`` follows the desktop's colour scheme."""
        if choice not in CHOICES:
            raise ValueError(f"expected a theme, one of {', '.join(CHOICES)}, got {choice!r}")
        hints = QGuiApplication.styleHints()
        if not self._choice and hints is not None:
            hints.colorSchemeChanged.connect(self._follow)
            app.setStyle("Fusion")
        self._choice = choice
        if hints is not None:
            hints.setColorScheme(_SCHEMES[choice])
        self._apply(app)

    def _follow(self) -> None:
        app = QApplication.instance()
        if isinstance(app, QApplication) and self._choice == "system":
            self._apply(app)

    def _apply(self, app: QApplication) -> None:
        hints = QGuiApplication.styleHints()
        is_dark = hints is not None and hints.colorScheme() == Qt.ColorScheme.Dark
        self.theme = {"light": LIGHT, "dark": DARK}.get(self._choice, DARK if is_dark else LIGHT)
        app.setPalette(_palette(self.theme))
        names = {name: colour.name() for name, colour in vars(self.theme).items() if name != "name"}
        sheet = Template(Path(__file__).with_name("style.qss").read_text(encoding="utf-8"))
        app.setStyleSheet(sheet.substitute(names, name=self.theme.name, marks=MARKS.as_posix()))
        self.changed.emit()


looks: Final = Looks()


def theme() -> Theme:
    """Return the active theme."""
    return looks.theme


def apply_theme(app: QApplication, choice: str = "system") -> None:
    """Apply a theme of `CHOICES` to an application, now and when the system's scheme changes."""
    looks.choose(app, choice)


LayoutItem = QWidget | QLayout | int | tuple[QWidget, int]
"""A widget, a layout, the factor of a stretch, or a widget and its stretch factor."""
Margins = int | tuple[int, int, int, int]


def column(
    owner: QWidget | None, *items: LayoutItem, margins: Margins = 0, spacing: int = SPACING
) -> QVBoxLayout:
    """Return a vertical layout of items (px; a spacing of -1 is the style's)."""
    return _filled(QVBoxLayout(owner), items, margins, spacing)


def row(
    owner: QWidget | None, *items: LayoutItem, margins: Margins = 0, spacing: int = SPACING
) -> QHBoxLayout:
    """Return a horizontal layout of items (px; a spacing of -1 is the style's)."""
    return _filled(QHBoxLayout(owner), items, margins, spacing)


def _filled(box: _Box, items: Iterable[LayoutItem], margins: Margins, spacing: int) -> _Box:
    box.setContentsMargins(*((margins,) * 4 if isinstance(margins, int) else margins))
    box.setSpacing(spacing)
    for item in items:
        if isinstance(item, int):
            box.addStretch(item)
        elif isinstance(item, QLayout):
            box.addLayout(item)
        elif isinstance(item, QWidget):
            box.addWidget(item)
        else:
            box.addWidget(*item)
    return box


def tabular(font: QFont) -> QFont:
    """Return a font with tabular figures, so that changing numbers keep their width."""
    figures = QFont(font)
    figures.setFeature(QFont.Tag("tnum"), 1)
    return figures


def _palette(colours: Theme) -> QPalette:
    palette, role = QPalette(colours.raised, colours.window), QPalette.ColorRole
    for colour, roles in (
        (colours.window, (role.Window, role.AlternateBase)),
        (colours.base, (role.Base,)),
        (colours.raised, (role.Button, role.ToolTipBase)),
        (colours.text, (role.WindowText, role.Text, role.ButtonText, role.ToolTipText)),
        (colours.faint, (role.PlaceholderText, role.LinkVisited)),
        (colours.error, (role.BrightText,)),
        (colours.accent, (role.Highlight, role.Accent, role.Link)),
        (colours.on_accent, (role.HighlightedText,)),
        (colours.line, (role.Mid,)),
    ):
        for each in roles:
            palette.setColor(each, colour)
    for each in (role.WindowText, role.Text, role.ButtonText, role.HighlightedText):
        palette.setColor(QPalette.ColorGroup.Disabled, each, colours.disabled)
    palette.setColor(QPalette.ColorGroup.Disabled, role.Highlight, colours.line)
    return palette
