"""How large pictures shall be: as the view is once its size rests, and none while it is hidden."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from PyQt6.QtCore import QObject, QTimer

if TYPE_CHECKING:
    from PyQt6.QtWidgets import QWidget

    from sketchterrain.ui.picture_source import PictureSource

__all__ = ["PictureSize"]

_SETTLE: Final = 120
"""ms without another size until a picture of the new one is asked for."""
_LEAST: Final = 16  # px


class PictureSize(QObject):
    """Asks for pictures of a view's size.

    Parameters
    ----------
    view, link
    """

    def __init__(self, view: QWidget, link: PictureSource) -> None:
        super().__init__(view)
        self._view, self._link = view, link
        self._ratio = view.devicePixelRatioF()
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.timeout.connect(self._ask)

    def begin(self) -> None:
        """Ask for pictures: the view is shown."""
        self._timer.start(0)

    def change(self) -> None:
        """Ask for another picture a little later: the view has another size."""
        self._timer.start(_SETTLE)

    def compare_screen(self) -> None:
        """Ask for another picture if the view is on a screen of another resolution now."""
        if self._view.devicePixelRatioF() != self._ratio:
            self._ratio = self._view.devicePixelRatioF()
            self.change()

    def end(self) -> None:
        """Ask for none any more: the view is hidden."""
        self._timer.stop()
        self._link.show(replace(self._link.view, width=0, height=0))

    def _ask(self) -> None:
        if self._view.isVisible():
            self._ratio = ratio = self._view.devicePixelRatioF()
            sides = (self._view.width(), self._view.height())
            width, height = (max(round(side * ratio), _LEAST) for side in sides)
            self._link.show(replace(self._link.view, width=width, height=height))
