"""What lies over the picture of a view, as pictures and troubles come: buttons, a compass, or a card."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from PyQt6.QtCore import QObject

from sketchterrain.ui.engine.orders import Turn
from sketchterrain.ui.view3d.bar import Bar
from sketchterrain.ui.view3d.card import Card, notice_of
from sketchterrain.ui.view3d.compass import Compass, heading_of

if TYPE_CHECKING:
    from PyQt6.QtWidgets import QWidget

    from sketchterrain.ui.engine.messages import FrameFacts, Trouble
    from sketchterrain.ui.engine.orders import ViewState
    from sketchterrain.ui.picture_source import PictureSource

__all__ = ["Over"]

_REFINES: Final = 0.6  # s without a finished picture until that is said
_EDGE: Final = 10  # px, around what lies over the picture


class Over(QObject):
    """Lies over a view, which is repainted as pictures come.

    Parameters
    ----------
    view
    link
        Whose pictures the view shows.

    Attributes
    ----------
    bar : Bar
        In the upper left corner.
    compass : Compass
        In the upper right one.
    card : Card
        In the middle, in place of them.
    """

    def __init__(self, view: QWidget, link: PictureSource) -> None:
        super().__init__(view)
        self._view, self._link = view, link
        self._trouble: Trouble | None = None
        self._unsettled: float | None = None
        self.bar, self.compass, self.card = Bar(view), Compass(view), Card(view)
        link.frame_shown.connect(self._take_frame)
        link.trouble.connect(self._take_trouble)
        link.working_changed.connect(self.show_card)
        link.view_changed.connect(self._take_view)
        self.bar.mode_chosen.connect(self.use_mode)
        self.compass.clicked.connect(self._face_north)
        self.card.pressed.connect(self._start_again)
        self._take_view(link.view)
        self.show_card()

    @property
    def refines(self) -> bool:
        """Whether a better picture has been on its way for a while."""
        return self._unsettled is not None and time.monotonic() - self._unsettled > _REFINES

    def place(self) -> None:
        """Put all in its places, in a view of another size."""
        self.bar.move(_EDGE, _EDGE)
        self.compass.move(self._view.width() - self.compass.width() - _EDGE, _EDGE)
        self.card.place()

    def show_card(self, *_: object) -> None:
        """Show why there is no picture, or what one moves with."""
        self.card.tell(notice_of(self._link, self._trouble))
        for each in (self.bar, self.compass):
            each.setVisible(self.card.notice is None)

    def use_mode(self, mode: str) -> None:
        """Move in one of `MODES`."""
        self._link.show(replace(self._link.view, mode=mode))

    def _face_north(self) -> None:
        heading = (self.compass.heading + 180.0) % 360.0 - 180.0
        self._link.tell(Turn(heading if self._link.view.mode == "orbit" else -heading, 0.0))

    def _start_again(self) -> None:
        self._trouble = None
        self._link.start()
        self.show_card()
        self._view.update()

    def _take_frame(self, frame: FrameFacts) -> None:
        self._trouble = None
        self.compass.heading = heading_of(frame.pose.eye, frame.pose.target)
        if frame.settled:
            self._unsettled = None
        elif self._unsettled is None:
            self._unsettled = time.monotonic()
        self.show_card()
        self._view.update()

    def _take_trouble(self, trouble: Trouble) -> None:
        if trouble.what in ("engine", "view"):
            self._trouble = trouble
            self.show_card()
            self._view.update()

    def _take_view(self, view: ViewState) -> None:
        self.bar.show_mode(view.mode)
