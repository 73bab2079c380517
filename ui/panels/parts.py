"""Parts of panels: labels, collapsible groups, scrolling frames and page heads."""

from PyQt6.QtCore import QRectF, QSize, Qt
from PyQt6.QtGui import QColor, QFont, QIcon, QPainter, QPalette, QPixmap
from PyQt6.QtWidgets import (
    QFrame,
    QGridLayout,
    QLabel,
    QScrollArea,
    QSizePolicy,
    QStyle,
    QStyleOptionViewItem,
    QWidget,
)
from superqt import QCollapsible, QElidingLabel

from sketchterrain.ui.look.layer_colours import swatch
from sketchterrain.ui.look.theme import MARGIN, MARKS, SPACING, column, described, tabular

_SMALLER = 0.88
_UNBOUNDED = (1 << 24) - 1  # Qt's QWIDGETSIZE_MAX
_SWATCH = 28


def small(font: QFont) -> QFont:
    """Return a slightly smaller font."""
    smaller = QFont(font)
    if font.pointSizeF() > 0:
        smaller.setPointSizeF(font.pointSizeF() * _SMALLER)
    else:
        smaller.setPixelSize(max(1, round(font.pixelSize() * _SMALLER)))
    return smaller


def faint_label(text: str = "") -> QLabel:
    """Return a label for secondary text: small, pale, wrapped."""
    label = QLabel(text)
    label.setFont(small(label.font()))
    label.setForegroundRole(QPalette.ColorRole.PlaceholderText)
    label.setWordWrap(True)
    return label


def heading(text: str = "") -> QLabel:
    """Return a label for a title."""
    label = QLabel(text)
    font = QFont(label.font())
    font.setWeight(QFont.Weight.DemiBold)
    label.setFont(font)
    return label


def status_label(tip: str, sample: str | None = None) -> QElidingLabel:
    """Return one elided line of secondary text, as wide as `sample` or as the available room."""
    label = QElidingLabel()
    label.setFont(tabular(label.font()))
    label.setForegroundRole(QPalette.ColorRole.PlaceholderText)
    label.setToolTip(tip)
    if sample is None:
        label.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
    else:
        label.setFixedWidth(label.fontMetrics().horizontalAdvance(sample) + 4)
    return label


def draw_band(painter: QPainter, option: QStyleOptionViewItem, band: QRectF) -> None:
    """Draw the rounded background of a selected or hovered row, clipped to its cell."""
    is_selected = bool(option.state & QStyle.StateFlag.State_Selected)
    if not (is_selected or option.state & QStyle.StateFlag.State_MouseOver):
        return
    role = QPalette.ColorRole
    colour = QColor(option.palette.color(role.Highlight if is_selected else role.Mid))
    colour.setAlpha(255 if is_selected else 90)
    painter.setClipRect(option.rect)
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(colour)
    painter.drawRoundedRect(band, 5, 5)


class CollapsibleGroup(QCollapsible):  # type: ignore[misc] # superqt has no types
    """Controls under a heading; a collapsed group is not animated and not in the tab order."""

    def __init__(self, title: str, content: QWidget, *, is_open: bool = True) -> None:
        super().__init__(title, None, *(QIcon(str(MARKS / f"{name}.svg")) for name in ("down", "right")))
        self.content().deleteLater()
        self.layout().setContentsMargins(0, 0, 0, 0)
        self.setContent(content)
        header = described(self.toggleButton(), title, f"Show or hide: {title.lower()}")
        header.setStyleSheet("")  # the application's
        header.setAutoDefault(False)
        if is_open:
            self.expand()
        else:
            self.collapse()

    def expand(self, animate: bool = False) -> None:
        """Show the content at its full height, also where its lines wrap."""
        super().expand(animate=False)
        self.content().setMaximumHeight(_UNBOUNDED)
        self.content().show()

    def collapse(self, animate: bool = False) -> None:
        super().collapse(animate=False)
        self.content().hide()


class Panel(QWidget):
    """A dock's content with its usual and smallest size."""

    def sizeHint(self) -> QSize:
        return QSize(300, 320)

    def minimumSizeHint(self) -> QSize:
        return QSize(220, 80)


class ScrollingPanel(QScrollArea):
    """A vertically scrolling panel of controls."""

    def __init__(self) -> None:
        super().__init__()
        self.setWidgetResizable(True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        page = QWidget(self)
        self._column = column(page, 1, margins=MARGIN, spacing=MARGIN)
        self.setWidget(page)

    def add(self, *widgets: QWidget) -> None:
        for widget in widgets:
            self._column.insertWidget(self._column.count() - 1, widget)

    def sizeHint(self) -> QSize:
        return QSize(300, 420)

    def minimumSizeHint(self) -> QSize:
        return QSize(220, 80)


class PageHead(QWidget):
    """The head of a properties page: a swatch, a title and a line."""

    def __init__(self) -> None:
        super().__init__()
        self._picture, self._title, self._line = QLabel(), heading(), faint_label()
        self._picture.setFixedSize(_SWATCH, _SWATCH)
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(SPACING + 2)
        grid.setVerticalSpacing(0)
        grid.addWidget(self._picture, 0, 0, 2, 1, Qt.AlignmentFlag.AlignTop)
        grid.addWidget(self._title, 0, 1)
        grid.addWidget(self._line, 1, 1)
        grid.setColumnStretch(1, 1)

    def show_text(self, title: str, line: str, label: tuple[str, int] | None = None) -> None:
        """Show a title, a line and the swatch of a layer's label."""
        picture = QPixmap() if label is None else swatch(*label, _SWATCH, self.devicePixelRatioF())
        self._picture.setPixmap(picture)
        self._title.setText(title)
        self._line.setText(line[:1].upper() + line[1:])
