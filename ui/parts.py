"""What the window is made of: the sketch, the 3-D view, and the panels around them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain.ui.canvas.canvas import Canvas
from sketchterrain.ui.panels.adherence import AdherencePanel
from sketchterrain.ui.panels.contradictions import ContradictionsPanel
from sketchterrain.ui.panels.history import HistoryPanel
from sketchterrain.ui.panels.layers import LayersPanel
from sketchterrain.ui.panels.properties import PropertiesPanel
from sketchterrain.ui.panels.status_line import StatusLine
from sketchterrain.ui.panels.view import ViewPanel
from sketchterrain.ui.panels.world import WorldPanel
from sketchterrain.ui.view3d.bookmarks import BookmarksPanel
from sketchterrain.ui.view3d.view import View3D

if TYPE_CHECKING:
    from collections.abc import Callable

    from PyQt6.QtWidgets import QWidget

    from sketchterrain.ui.engine.link import EngineLink
    from sketchterrain.ui.models.bookmarks import Bookmarks
    from sketchterrain.ui.models.document import Document
    from sketchterrain.ui.models.workspace import Workspace

__all__ = ["Parts"]


class Parts:
    """Makes every part once.

    Parameters
    ----------
    document, workspace, link, bookmarks
        What the parts show and change.

    Attributes
    ----------
    canvas, view, layers, contradictions, bookmarks, status : QWidget
    panels : dict of str to QWidget
        All that stand around the canvas, by name, see `ui.layout.PARTS`.
    """

    def __init__(
        self, document: Document, workspace: Workspace, link: EngineLink, bookmarks: Bookmarks
    ) -> None:
        self.canvas = Canvas(document, workspace, link)
        self.view = View3D(document, workspace, link)
        self.layers = LayersPanel(document, workspace)
        self.contradictions = ContradictionsPanel(workspace, link)
        self.bookmarks = BookmarksPanel(link, bookmarks)
        self.status = StatusLine(document, workspace, link)
        self.panels: dict[str, QWidget] = {
            "layers": self.layers,
            "properties": PropertiesPanel(document, workspace, link),
            "world": WorldPanel(document),
            "light": ViewPanel(document, link),
            "view": self.view,
            "history": HistoryPanel(document),
            "adherence": AdherencePanel(workspace, link),
            "contradictions": self.contradictions,
            "bookmarks": self.bookmarks,
        }

    def tell_by(self, say: Callable[[str], None]) -> None:
        """Let a function show what parts have to say; the line at the foot shows what the mouse is over."""
        for part in (self.canvas, self.view):
            part.hovered.connect(self.status.hover)
            part.message.connect(say)
        self.layers.message.connect(say)
