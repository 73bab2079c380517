"""What Fusion is told beyond colours: even spacing, thin lines, a focus that is seen."""

from __future__ import annotations

from string import Template
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["style_sheet"]

_SHEET = Template("""
QToolTip { background: $raised; color: $text; border: 1px solid $line; padding: 4px 6px; }
QMainWindow::separator { background: $window; width: 5px; height: 5px; }
QMainWindow::separator:hover { background: $accent; }

QMenuBar { background: $window; border-bottom: 1px solid $line; padding: 1px 4px; }
QMenuBar::item { padding: 4px 9px; border-radius: 4px; background: transparent; }
QMenuBar::item:selected { background: $line; }
QMenu { background: $base; border: 1px solid $line; padding: 4px; }
QMenu::item { padding: 5px 26px 5px 8px; border-radius: 4px; min-height: 16px; }
QMenu::item:selected { background: $line; }
QMenu::item:disabled { color: $faint; }
QMenu::icon { padding-left: 8px; }
QMenu::separator { height: 1px; background: $line; margin: 4px 8px; }

QToolBar { background: $window; border: none; border-bottom: 1px solid $line;
           padding: 3px 6px; spacing: 2px; }
QToolBar::separator { background: $line; width: 1px; height: 1px; margin: 5px; }
QToolBar:vertical { border-bottom: none; border-right: 1px solid $line; padding: 6px 3px; }
QToolButton { border: 1px solid transparent; border-radius: 5px; padding: 4px; background: transparent; }
QToolButton:hover { background: $line; }
QToolButton:pressed { background: $accent; }
QToolButton:checked { background: $accent; color: $on_accent; }
QToolButton:focus { border-color: $accent; }
QToolButton::menu-indicator { image: none; }
QToolButton::menu-button { border: none; background: transparent; width: 14px; }

QFrame#banner { background: $raised; border: 1px solid $faint; border-radius: 7px; }

QStatusBar { background: $window; border-top: 1px solid $line; }
QStatusBar::item { border: none; }

QTabBar { qproperty-drawBase: 0; }
QTabBar::tab { background: transparent; color: $faint; padding: 5px 9px; border: none;
               border-bottom: 2px solid transparent; }
QTabBar::tab:selected { color: $text; border-bottom-color: $accent; }
QTabBar::tab:hover:!selected { color: $text; border-bottom-color: $line; }
QTabBar::tab:focus { color: $accent; }
QTabWidget::pane { border: none; border-top: 1px solid $line; }

QPushButton { background: $raised; border: 1px solid $line; border-radius: 5px; padding: 5px 14px;
              min-height: 16px; }
QPushButton:hover { border-color: $faint; }
QPushButton:pressed { background: $line; }
QPushButton:focus { border-color: $accent; }
QPushButton:default { background: $accent; color: $on_accent; border-color: $accent; }
QPushButton:default:focus { border-color: $text; }
QPushButton:disabled, QPushButton:default:disabled {
    background: $window; color: $faint; border-color: $line; }

QLineEdit, QPlainTextEdit, QTextEdit {
    background: $base; border: 1px solid $line; border-radius: 4px; padding: 3px 5px;
    selection-background-color: $accent; selection-color: $on_accent; }
QLineEdit:focus, QPlainTextEdit:focus, QTextEdit:focus { border-color: $accent; }
QLineEdit:disabled { background: $window; }
QAbstractSpinBox QLineEdit { border: none; padding: 0; background: transparent; }
QComboBox QAbstractItemView { background: $base; border: 1px solid $line; padding: 3px; outline: none;
    selection-background-color: $accent; selection-color: $on_accent; }
QCheckBox, QRadioButton { spacing: 7px; }
QCheckBox:focus, QRadioButton:focus { color: $accent; }
QListView, QTreeView, QTableView { background: $base; border: 1px solid $line; border-radius: 4px; }
QListView:focus, QTreeView:focus, QTableView:focus { border-color: $accent; }
QListView#gallery { border: none; background: transparent; }
QListView#gallery::item { border-radius: 9px; padding: 9px 3px 3px 3px; }
QListView#gallery::item:hover { background: $line; }
QListView#gallery::item:selected { background: $accent; color: $on_accent; }
QHeaderView::section { background: $window; color: $faint; border: none; border-bottom: 1px solid $line;
                       padding: 4px 6px; }
QScrollArea { border: none; background: transparent; }
QScrollArea > QWidget > QWidget { background: transparent; }

QScrollBar:vertical { background: transparent; width: 11px; margin: 0; }
QScrollBar:horizontal { background: transparent; height: 11px; margin: 0; }
QScrollBar::handle { background: $line; border-radius: 3px; margin: 2px; }
QScrollBar::handle:vertical { min-height: 28px; }
QScrollBar::handle:horizontal { min-width: 28px; }
QScrollBar::handle:hover { background: $faint; }
QScrollBar::add-line, QScrollBar::sub-line { width: 0; height: 0; }
QScrollBar::add-page, QScrollBar::sub-page { background: transparent; }

QSlider:horizontal { min-height: 20px; }
QSlider::groove:horizontal { height: 4px; border-radius: 2px; background: $line; }
QSlider::sub-page:horizontal { height: 4px; border-radius: 2px; background: $accent; }
QSlider::sub-page:horizontal:disabled { background: $line; }
QSlider::handle:horizontal { width: 12px; height: 12px; margin: -5px 0; border-radius: 7px;
                             background: $base; border: 1px solid $faint; }
QSlider::handle:horizontal:hover, QSlider::handle:horizontal:focus { border: 2px solid $accent;
                             width: 10px; height: 10px; }
QSlider::handle:horizontal:disabled { border-color: $line; background: $window; }

QProgressBar { background: $line; border: none; border-radius: 3px; min-height: 6px; max-height: 6px; }
QProgressBar::chunk { background: $accent; border-radius: 3px; }
QGroupBox { border: none; margin-top: 20px; font-weight: 600; }
QGroupBox::title { subcontrol-origin: margin; left: 0; color: $text; }
""")


def style_sheet(colours: Mapping[str, str]) -> str:
    """Return the application's style sheet.

    Parameters
    ----------
    colours
        As ``#rrggbb``, by the names of `Theme`.
    """
    return _SHEET.substitute(colours)
