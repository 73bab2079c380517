"""Parts of panels: labels, collapsible groups, scrolling frames, page heads."""

from __future__ import annotations

from PyQt6.QtCore import QSize, Qt
from PyQt6.QtGui import QFont, QIcon, QPalette, QPixmap
from PyQt6.QtWidgets import QFrame, QGridLayout, QLabel, QScrollArea, QSizePolicy, QVBoxLayout, QWidget
from superqt import QCollapsible, QElidingLabel

from sketchterrain.ui.look.layer_colours import swatch
from sketchterrain.ui.look.theme import MARGIN, MARKS, SPACING, tabular

_SMALLER = 0.88
_UNBOUNDED = (1 << 24) - 1  # Qt's QWIDGETSIZE_MAX
_SWATCH = 28


def small(font: QFont) -> QFont:
    """Return a font a little smaller."""
    smaller = QFont(font)
    if font.pointSizeF() > 0:
        smaller.setPointSizeF(font.pointSizeF() * _SMALLER)
    else:
        smaller.setPixelSize(max(1, round(font.pixelSize() * _SMALLER)))
    return smaller


def faint_label(text: str = "", parent: QWidget | None = None) -> QLabel:
    """Return a label for secondary text: small, pale, wrapped."""
    label = QLabel(text, parent)
    label.setFont(small(label.font()))
    label.setForegroundRole(QPalette.ColorRole.PlaceholderText)
    label.setWordWrap(True)
    return label


def heading(text: str, parent: QWidget | None = None) -> QLabel:
    """Return a label for the title of a part."""
    label = QLabel(text, parent)
    font = QFont(label.font())
    font.setWeight(QFont.Weight.DemiBold)
    label.setFont(font)
    return label


def figure(tip: str, sample: str | None = None) -> QElidingLabel:
    """Return one elided line of secondary text, as wide as `sample`, or else as there is room."""
    label = QElidingLabel()
    label.setFont(tabular(label.font()))
    label.setForegroundRole(QPalette.ColorRole.PlaceholderText)
    label.setToolTip(tip)
    if sample is None:
        label.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
    else:
        label.setFixedWidth(label.fontMetrics().horizontalAdvance(sample) + 4)
    return label


class Group(QCollapsible):  # type: ignore[misc] # superqt has no types
    """Controls under a heading that collapses them, without animation and out of the tab order."""

    def __init__(
        self, title: str, content: QWidget, *, is_open: bool = True, parent: QWidget | None = None
    ) -> None:
        super().__init__(title, parent, *(QIcon(str(MARKS / f"{name}.svg")) for name in ("down", "right")))
        self.content().deleteLater()
        self.layout().setContentsMargins(0, 0, 0, 0)
        self.setContent(content)
        header = self.toggleButton()
        header.setStyleSheet("")  # the application's
        header.setAutoDefault(False)
        header.setAccessibleName(title)
        header.setToolTip(f"Show or hide: {title.lower()}")
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
        """Hide the content."""
        super().collapse(animate=False)
        self.content().hide()


class ScrollingPanel(QScrollArea):
    """A panel of controls below one another that scrolls where there is no room for all."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWidgetResizable(True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        page = QWidget(self)
        self._down = QVBoxLayout(page)
        self._down.setContentsMargins(MARGIN, MARGIN, MARGIN, MARGIN)
        self._down.setSpacing(MARGIN)
        self._down.addStretch(1)
        self.setWidget(page)

    def add(self, widget: QWidget) -> None:
        """Add a control below the others."""
        self._down.insertWidget(self._down.count() - 1, widget)

    def sizeHint(self) -> QSize:
        """Return a comfortable width."""
        return QSize(300, 420)

    def minimumSizeHint(self) -> QSize:
        """Return the least width at which nothing is clipped."""
        return QSize(220, 80)


class PageHead(QWidget):
    """The head of a page of properties: a swatch, a title and a line below it."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._picture = QLabel(self)
        self._picture.setFixedSize(_SWATCH, _SWATCH)
        self._title, self._line = heading("", self), faint_label("", self)
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(SPACING + 2)
        grid.setVerticalSpacing(0)
        grid.addWidget(self._picture, 0, 0, 2, 1, Qt.AlignmentFlag.AlignTop)
        grid.addWidget(self._title, 0, 1)
        grid.addWidget(self._line, 1, 1)
        grid.setColumnStretch(1, 1)

    def show_text(self, title: str, line: str, label: tuple[str, int] | None = None) -> None:
        """Show what the page is about, with the swatch of a layer's label if there is one."""
        picture = QPixmap() if label is None else swatch(*label, _SWATCH, self.devicePixelRatioF())
        self._picture.setPixmap(picture)
        self._title.setText(title)
        self._line.setText(line[:1].upper() + line[1:])
