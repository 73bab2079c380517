"""Theme, icons and style sheet."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from string import Template
from typing import Final, TypeVar

from PyQt6.QtCore import QByteArray, QObject, QPoint, QRect, QRectF, QSize, Qt, pyqtSignal
from PyQt6.QtGui import (
    QColor,
    QFont,
    QGuiApplication,
    QIcon,
    QIconEngine,
    QImage,
    QPainter,
    QPainterPath,
    QPalette,
    QPen,
    QPixmap,
)
from PyQt6.QtSvg import QSvgRenderer
from PyQt6.QtWidgets import (
    QApplication,
    QBoxLayout,
    QHBoxLayout,
    QLabel,
    QLayout,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

ICONS = Path(__file__).with_name("icons")
MARKS = Path(__file__).with_name("marks")
_CORNER = 6.0  # px, radius of rounded corners


def icon(name: str, colour: QColor | None = None) -> QIcon:
    """Return an icon by its file name, drawn in a colour, or in the current palette's of text."""
    _svg(name, "")
    return QIcon(_Engine(name, colour))


def app_icon() -> QIcon:
    """Return the application icon."""
    return QIcon(str(ICONS / "sketchterrain.svg"))


def draw_icon(painter: QPainter, name: str, place: QRectF, colour: QColor) -> None:
    """Draw an icon into the largest centred square of `place`."""
    drawing = QSvgRenderer(_svg(name, colour.name()))
    drawing.setAspectRatioMode(Qt.AspectRatioMode.KeepAspectRatio)
    painter.save()
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setOpacity(painter.opacity() * colour.alphaF())
    drawing.render(painter, place)
    painter.restore()


def tool_button(
    name: str, title: str, on_click: Callable[[], object] | None = None, *, tip: str = "", side: int = 18
) -> QToolButton:
    """Return an icon button; `title` is its accessible name, and its tool tip unless `tip` is given."""
    button = QToolButton()
    if on_click is not None:
        button.clicked.connect(lambda _: on_click())
    button.setIcon(icon(name))
    button.setIconSize(QSize(side, side))
    button.setAccessibleName(title)
    button.setToolTip(tip or title)
    return button


def rounded_picture(image: QImage, size: QSize, dpr: float) -> QPixmap:
    """Return an image that fills `size` logical pixels, with rounded corners."""
    pixels = size * dpr
    picture = QPixmap(pixels)
    picture.fill(Qt.GlobalColor.transparent)
    painter = QPainter(picture)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    outline = QPainterPath()
    outline.addRoundedRect(picture.rect().toRectF(), _CORNER * dpr, _CORNER * dpr)
    painter.setClipPath(outline)
    if image.isNull():
        painter.fillPath(outline, Qt.GlobalColor.darkGray)
    else:
        painter.drawImage(0, 0, filling(image, pixels))
    painter.end()
    picture.setDevicePixelRatio(dpr)
    return picture


def filling(image: QImage, size: QSize) -> QImage:
    """Return the middle of an image scaled to fill a size (px)."""
    cover = Qt.AspectRatioMode.KeepAspectRatioByExpanding
    scaled = image.scaled(size, cover, Qt.TransformationMode.SmoothTransformation)
    frame = QRect(QPoint(0, 0), size)
    frame.moveCenter(scaled.rect().center())
    return scaled.copy(frame)


@lru_cache(maxsize=512)
def _svg(name: str, colour: str) -> QByteArray:
    """Return an icon's SVG in a colour (a cached renderer, a QObject, would not outlive its application)."""
    text = (ICONS / f"{name}.svg").read_bytes()
    return QByteArray(text.replace(b"currentColor", colour.encode()))


class _Engine(QIconEngine):
    """Icon engine that draws an SVG in the state of its control."""

    def __init__(self, name: str, colour: QColor | None) -> None:
        super().__init__()
        self._name, self._colour = name, colour

    def clone(self) -> QIconEngine:
        return _Engine(self._name, self._colour)

    def isNull(self) -> bool:
        return False

    def actualSize(self, size: QSize, mode: QIcon.Mode, state: QIcon.State) -> QSize:
        return size

    def paint(self, painter: QPainter | None, rect: QRect, mode: QIcon.Mode, state: QIcon.State) -> None:
        palette, role = QApplication.palette(), QPalette.ColorRole
        group = QPalette.ColorGroup.Disabled if mode == QIcon.Mode.Disabled else QPalette.ColorGroup.Active
        lit = mode == QIcon.Mode.Selected or (state == QIcon.State.On and mode != QIcon.Mode.Disabled)
        if painter is not None:
            colour = palette.color(group, role.HighlightedText if lit else role.ButtonText)
            draw_icon(painter, self._name, QRectF(rect), self._colour or colour)

    def pixmap(self, size: QSize, mode: QIcon.Mode, state: QIcon.State) -> QPixmap:
        picture = QPixmap(size)
        picture.fill(Qt.GlobalColor.transparent)
        painter = QPainter(picture)
        self.paint(painter, QRect(QPoint(0, 0), size), mode, state)
        painter.end()
        return picture


SMALL: Final = 4  # px between parts of one control
SPACING: Final = 8  # px between controls
MARGIN: Final = 12  # px around a group of controls
CHOICES: Final = {"system": "As the system", "light": "Light", "dark": "Dark"}
"""Titles of the selectable themes."""
_SCHEMES: Final = {
    "system": Qt.ColorScheme.Unknown,
    "light": Qt.ColorScheme.Light,
    "dark": Qt.ColorScheme.Dark,
}

_Box = TypeVar("_Box", bound=QBoxLayout)
_Widget = TypeVar("_Widget", bound=QWidget)


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


class ActiveTheme(QObject):
    """The active theme; `changed` is emitted after another theme was applied."""

    changed = pyqtSignal()

    def __init__(self) -> None:
        super().__init__()
        self.theme = LIGHT
        self._choice = ""

    def apply(self, app: QApplication, choice: str = "system") -> None:
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


active_theme: Final = ActiveTheme()


def theme() -> Theme:
    """Return the active theme."""
    return active_theme.theme


apply_theme: Final = active_theme.apply

LayoutItem = QWidget | QLayout | int | tuple[QWidget, int]
"""A widget, a layout, the factor of a stretch, or a widget and its stretch factor."""
Margins = int | tuple[int, int, int, int]


def column(
    owner: QWidget | None, *items: LayoutItem, margins: Margins = 0, spacing: int = SPACING
) -> QVBoxLayout:
    """Return a vertical layout of items (px; -1: the style's)."""
    return _filled(QVBoxLayout(owner), items, margins, spacing)


def row(
    owner: QWidget | None, *items: LayoutItem, margins: Margins = 0, spacing: int = SPACING
) -> QHBoxLayout:
    """Return a horizontal layout of items (px; -1: the style's)."""
    return _filled(QHBoxLayout(owner), items, margins, spacing)


def _filled(box: _Box, items: Iterable[LayoutItem], margins: Margins, spacing: int) -> _Box:
    if margins != -1:
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


def clear(box: QBoxLayout) -> None:
    """Delete the widgets of a layout."""
    while (item := box.takeAt(0)) is not None:
        if (widget := item.widget()) is not None:
            widget.hide()
            widget.deleteLater()


def described(widget: _Widget, name: str, tip: str) -> _Widget:
    """Set a widget's accessible name and tool tip, and return it."""
    widget.setAccessibleName(name)
    widget.setToolTip(tip)
    return widget


def heading(text: str = "", *, weight: QFont.Weight = QFont.Weight.DemiBold, scale: float = 1.0) -> QLabel:
    """Return a label for a title, `scale` times the usual size."""
    label = QLabel(text)
    font = QFont(label.font())
    font.setWeight(weight)
    if scale != 1.0:
        font.setPointSizeF(font.pointSizeF() * scale)
    label.setFont(font)
    return label


def draw_focus(painter: QPainter, widget: QWidget) -> None:
    """Draw the frame of a widget if it has the focus."""
    if widget.hasFocus():
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.setPen(QPen(theme().accent, 2.0))
        painter.drawRect(QRectF(widget.rect()).adjusted(1.0, 1.0, -1.0, -1.0))


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
