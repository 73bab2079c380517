"""How the program looks, dark and light: colours, spacing, and a small style sheet over Fusion."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

from PyQt6.QtCore import QObject, Qt, pyqtSignal
from PyQt6.QtGui import QColor, QFont, QGuiApplication, QPalette
from PyQt6.QtWidgets import QApplication

from sketchterrain.ui.look.style import Marks
from sketchterrain.ui.look.style_sheet import style_sheet

__all__ = [
    "CHOICES",
    "DARK",
    "LIGHT",
    "MARGIN",
    "SMALL",
    "SPACING",
    "Looks",
    "Theme",
    "apply_theme",
    "looks",
    "tabular",
    "theme",
]

SMALL: Final = 4
"""px between things that are one."""
SPACING: Final = 8
"""px between things beside one another."""
MARGIN: Final = 12
"""px around a group of things."""
CHOICES: Final = {"system": "As the system", "light": "Light", "dark": "Dark"}
"""Which themes a person can choose from, and what they are called."""


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
    text, faint : QColor
        What is read, and what is read second.
    accent, on_accent : QColor
        What is selected, and text on it.
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
    accent: QColor
    on_accent: QColor
    warning: QColor
    error: QColor
    good: QColor
    canvas: QColor

    def names(self) -> dict[str, str]:
        """Return the colours as a style sheet writes them, by name."""
        return {each.name: getattr(self, each.name).name() for each in fields(self) if each.name != "name"}


def _theme(name: str, **colours: str) -> Theme:
    return Theme(name, **{key: QColor(colour) for key, colour in colours.items()})


LIGHT: Final = _theme(
    "light",
    window="#f3f3f1",
    base="#ffffff",
    raised="#fbfbfa",
    line="#d4d4cf",
    text="#23262a",
    faint="#63686e",
    accent="#1d756b",
    on_accent="#ffffff",
    warning="#9a6200",
    error="#b3312b",
    good="#1d756b",
    canvas="#c9cac8",
)
DARK: Final = _theme(
    "dark",
    window="#25282b",
    base="#1c1e20",
    raised="#32363a",
    line="#3f444a",
    text="#e4e6e8",
    faint="#9aa1a8",
    accent="#4cb8a8",
    on_accent="#0f1f1d",
    warning="#e3b04b",
    error="#f08379",
    good="#4cb8a8",
    canvas="#17191b",
)


class Looks(QObject):
    """Which theme is shown; tells when it is another one.

    Attributes
    ----------
    theme : Theme
    """

    changed = pyqtSignal()

    def __init__(self) -> None:
        super().__init__()
        self.theme = LIGHT
        self._choice = "system"
        self._follows = False

    def choose(self, app: QApplication, choice: str) -> None:
        """Show a theme of `CHOICES`, and go on doing so when the system's is another one.

        Raises
        ------
        ValueError
            If there is no such choice.
        """
        if choice not in CHOICES:
            raise ValueError(f"expected a theme, one of {', '.join(CHOICES)}, got {choice!r}")
        self._choice = choice
        hints = QGuiApplication.styleHints()
        if not self._follows and hints is not None:
            hints.colorSchemeChanged.connect(self._follow)
            self._follows = True
            app.setStyle(Marks(theme))
        self._show(app, always=True)

    def _follow(self, _: Qt.ColorScheme) -> None:
        app = QApplication.instance()
        if isinstance(app, QApplication):
            self._show(app)

    def _show(self, app: QApplication, *, always: bool = False) -> None:
        shown = {"light": LIGHT, "dark": DARK}.get(self._choice) or _of_the_system()
        if shown is not self.theme or always:
            self.theme = shown
            app.setPalette(_palette(shown))
            app.setStyleSheet(style_sheet(shown.names()))
            self.changed.emit()


looks: Final = Looks()
"""The program's."""


def theme() -> Theme:
    """Return the theme that is shown."""
    return looks.theme


def apply_theme(app: QApplication, choice: str = "system") -> None:
    """Make an application look as a theme of `CHOICES` says, now and when the system changes."""
    looks.choose(app, choice)


def tabular(font: QFont) -> QFont:
    """Return a font whose figures are all of one width, so that numbers that change do not jump."""
    figures = QFont(font)
    if hasattr(figures, "setFeature"):  # Qt 6.7; before it, fonts with such figures by default serve
        figures.setFeature(QFont.Tag("tnum"), 1)
    return figures


def _of_the_system() -> Theme:
    hints = QGuiApplication.styleHints()
    dark = hints is not None and hints.colorScheme() == Qt.ColorScheme.Dark
    return DARK if dark else LIGHT


def _palette(shown: Theme) -> QPalette:
    palette = QPalette(shown.raised, shown.window)
    role = QPalette.ColorRole
    for each, colour in {
        role.Window: shown.window,
        role.WindowText: shown.text,
        role.Base: shown.base,
        role.AlternateBase: shown.window,
        role.Text: shown.text,
        role.PlaceholderText: shown.faint,
        role.Button: shown.raised,
        role.ButtonText: shown.text,
        role.BrightText: shown.error,
        role.Highlight: shown.accent,
        role.HighlightedText: shown.on_accent,
        role.Accent: shown.accent,
        role.Link: shown.accent,
        role.LinkVisited: shown.faint,
        role.ToolTipBase: shown.raised,
        role.ToolTipText: shown.text,
        role.Mid: shown.line,
    }.items():
        palette.setColor(each, colour)
    off = QColor(shown.faint)
    off.setAlpha(120)
    for each in (role.WindowText, role.Text, role.ButtonText, role.HighlightedText):
        palette.setColor(QPalette.ColorGroup.Disabled, each, off)
    palette.setColor(QPalette.ColorGroup.Disabled, role.Highlight, shown.line)
    return palette
