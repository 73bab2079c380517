"""Colours and spacing, dark and light: Qt's colour scheme, a palette for Fusion and one style sheet."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Final

from PyQt6.QtCore import QObject, Qt, pyqtSignal
from PyQt6.QtGui import QColor, QFont, QGuiApplication, QPalette
from PyQt6.QtWidgets import QApplication

from sketchterrain.ui.look.icons import MARKS

SMALL: Final = 4
"""px between parts of one control."""
SPACING: Final = 8
"""px between controls."""
MARGIN: Final = 12
"""px around a group of controls."""
CHOICES: Final = {"system": "As the system", "light": "Light", "dark": "Dark"}
"""Titles of the themes that can be chosen."""
_SCHEMES: Final = {
    "system": Qt.ColorScheme.Unknown,
    "light": Qt.ColorScheme.Light,
    "dark": Qt.ColorScheme.Dark,
}


@dataclass(frozen=True)
class Theme:
    """The colours of one look.

    Attributes
    ----------
    name : {'light', 'dark'}
    window, base, raised : QColor
        Behind controls, behind text that is edited, of buttons.
    line : QColor
        Between things.
    text, faint, disabled : QColor
        Primary and secondary text, and text of disabled controls.
    accent, on_accent : QColor
        A selection, and text on it.
    warning, error, good : QColor
        Marks, told apart by their shapes too.
    canvas : QColor
        Neutral, around a sketch or a picture.
    """

    name: str
    window: QColor
    base: QColor
    raised: QColor
    line: QColor
    text: QColor
    faint: QColor
    disabled: QColor
    accent: QColor
    on_accent: QColor
    warning: QColor
    error: QColor
    good: QColor
    canvas: QColor


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
    """The theme that is shown; `changed` is emitted after another one was applied."""

    changed = pyqtSignal()

    def __init__(self) -> None:
        super().__init__()
        self.theme = LIGHT
        self._choice = ""

    def choose(self, app: QApplication, choice: str) -> None:
        """Apply a theme of `CHOICES`; ``system`` follows the desktop's colour scheme from now on."""
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
    """Return the theme that is shown."""
    return looks.theme


def apply_theme(app: QApplication, choice: str = "system") -> None:
    """Make an application look as a theme of `CHOICES` says, now and when the system changes."""
    looks.choose(app, choice)


def tabular(font: QFont) -> QFont:
    """Return a font whose digits have one width, so that changing numbers do not jump."""
    figures = QFont(font)
    figures.setFeature(QFont.Tag("tnum"), 1)
    return figures


def _palette(shown: Theme) -> QPalette:
    palette, role = QPalette(shown.raised, shown.window), QPalette.ColorRole
    for colour, roles in (
        (shown.window, (role.Window, role.AlternateBase)),
        (shown.base, (role.Base,)),
        (shown.raised, (role.Button, role.ToolTipBase)),
        (shown.text, (role.WindowText, role.Text, role.ButtonText, role.ToolTipText)),
        (shown.faint, (role.PlaceholderText, role.LinkVisited)),
        (shown.error, (role.BrightText,)),
        (shown.accent, (role.Highlight, role.Accent, role.Link)),
        (shown.on_accent, (role.HighlightedText,)),
        (shown.line, (role.Mid,)),
    ):
        for each in roles:
            palette.setColor(each, colour)
    for each in (role.WindowText, role.Text, role.ButtonText, role.HighlightedText):
        palette.setColor(QPalette.ColorGroup.Disabled, each, shown.disabled)
    palette.setColor(QPalette.ColorGroup.Disabled, role.Highlight, shown.line)
    return palette
