"""Questions for what ground is seen at a place of the picture: of one kind only the newest is answered."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PyQt6.QtCore import QObject

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.ui.engine.link import EngineLink
    from sketchterrain.ui.engine.messages import Picked

__all__ = ["Picks"]


class Picks(QObject):
    """Asks the engine, and hands each answer to whom it is for.

    Parameters
    ----------
    link
    parent
    """

    def __init__(self, link: EngineLink, parent: QObject) -> None:
        super().__init__(parent)
        self._link = link
        self._waiting: dict[str, tuple[int, Callable[[tuple[float, float, float] | None], None]]] = {}
        link.picked.connect(self._take)

    def ask(
        self, kind: str, x: float, y: float, then: Callable[[tuple[float, float, float] | None], None]
    ) -> None:
        """Ask for a place of the picture (shares); an older question of that kind is forgotten.

        Parameters
        ----------
        kind
            What it is for.
        x, y
        then
            Is called with the place (m), None for the sky.
        """
        self._waiting[kind] = self._link.pick(x, y), then

    def waits(self, kind: str) -> bool:
        """Whether a question of a kind is not answered yet."""
        return kind in self._waiting

    def forget(self) -> None:
        """Wait for no answer any more."""
        self._waiting.clear()

    def _take(self, picked: Picked) -> None:
        for kind, (token, then) in tuple(self._waiting.items()):
            if token == picked.token:
                del self._waiting[kind]
                then(picked.place)
