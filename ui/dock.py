"""A panel that can be moved, tabbed, floated and closed, with a title as quiet as its neighbours'."""

from __future__ import annotations

from PyQt6.QtCore import QSize, Qt
from PyQt6.QtWidgets import QDockWidget, QHBoxLayout, QLabel, QSizePolicy, QToolButton, QWidget

from sketchterrain.ui.look.theme import SMALL, SPACING
from sketchterrain.ui.look.tool_buttons import tool_button

__all__ = ["Dock"]


class Dock(QDockWidget):
    """A panel at the side of a window.

    Parameters
    ----------
    name
        By which its place is remembered.
    title
        What stands above it.
    content
        The panel itself.
    """

    def __init__(self, name: str, title: str, content: QWidget, parent: QWidget) -> None:
        super().__init__(title, parent)
        self.setObjectName(f"dock-{name}")
        self.name = name
        self.setWidget(content)
        self.setFeatures(
            QDockWidget.DockWidgetFeature.DockWidgetMovable
            | QDockWidget.DockWidgetFeature.DockWidgetFloatable
            | QDockWidget.DockWidgetFeature.DockWidgetClosable
        )
        self._title = _Title(self)
        self.setTitleBarWidget(self._title)
        self.topLevelChanged.connect(self._title.show_state)

    def bring_up(self) -> None:
        """Show it, before others of its tabs."""
        self.show()
        self.raise_()

    def show_title(self, shown: bool) -> None:
        """Have a title above it, or leave that to its tab."""
        self._title.show_all(shown)


class _Title(QWidget):
    """The title and two buttons. Presses beside these are the dock's: it is dragged by them."""

    def __init__(self, dock: Dock) -> None:
        super().__init__(dock)
        self._dock = dock
        row = QHBoxLayout(self)
        row.setContentsMargins(SPACING, SMALL, SMALL, 0)
        row.setSpacing(0)
        name = QLabel(dock.windowTitle())
        font = name.font()
        font.setBold(True)
        name.setFont(font)
        row.addWidget(name)
        row.addStretch(1)
        self._float = _button("float", f"Float {dock.windowTitle()}")
        self._float.clicked.connect(self._float_or_dock)
        close = _button("close", f"Close {dock.windowTitle()}")
        close.clicked.connect(dock.close)
        row.addWidget(self._float)
        row.addWidget(close)
        self._parts = (name, self._float, close)
        self._shown = True
        self.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Fixed)

    def _float_or_dock(self) -> None:
        self._dock.setFloating(not self._dock.isFloating())

    def show_state(self, floats: bool) -> None:
        """Say what the button does now."""
        what = "Dock" if floats else "Float"
        self._float.setToolTip(f"{what} {self._dock.windowTitle()}")

    def show_all(self, shown: bool) -> None:
        if shown != self._shown:
            self._shown = shown
            for part in self._parts:
                part.setVisible(shown)
            self.updateGeometry()

    def sizeHint(self) -> QSize:
        return super().sizeHint() if self._shown else QSize(60, 0)

    def minimumSizeHint(self) -> QSize:
        # A long title must not keep a narrow panel from being narrow.
        return QSize(60, super().minimumSizeHint().height() if self._shown else 0)


def _button(name: str, title: str) -> QToolButton:
    button = tool_button(name, title, side=12)
    button.setFocusPolicy(Qt.FocusPolicy.TabFocus)
    button.setAutoRaise(True)
    return button
