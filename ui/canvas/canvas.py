"""The sketch as one paints on it."""

from __future__ import annotations

from typing import cast

from PyQt6.QtCore import QEvent, QPointF, QRect, QRectF, QSize, Qt, pyqtSignal
from PyQt6.QtGui import (
    QContextMenuEvent,
    QEnterEvent,
    QFocusEvent,
    QHideEvent,
    QKeyEvent,
    QMouseEvent,
    QPainter,
    QPaintEvent,
    QPen,
    QResizeEvent,
    QTabletEvent,
    QWheelEvent,
)
from PyQt6.QtWidgets import QSizePolicy, QWidget

from sketchterrain.ui.actions import ShortcutOverride
from sketchterrain.ui.canvas.canvas_input import CanvasInput, Keys, Tips
from sketchterrain.ui.canvas.decorations import Overlays
from sketchterrain.ui.canvas.marks import FeatureMarks
from sketchterrain.ui.canvas.sketch_image import SketchView
from sketchterrain.ui.canvas.tool_context import ToolContext, Viewport
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import FrameFacts
from sketchterrain.ui.look.theme import theme
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Workspace

_MARGIN = 28  # logical px around a sheet that is fitted
_ZOOM = 1.25
_KEYS = (
    Qt.FocusReason.TabFocusReason,
    Qt.FocusReason.BacktabFocusReason,
    Qt.FocusReason.ShortcutFocusReason,
)


class Canvas(QWidget):
    """Shows the sketch of a document, and lets a person paint on it."""

    hovered = pyqtSignal(object)
    """Where the mouse is: (x, y, height or None), m; None: not on the sketch."""
    message = pyqtSignal(str)
    """A line for a person."""

    def __init__(
        self, document: Document, workspace: Workspace, link: EngineLink, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self._desk = ToolContext(document, workspace, link)
        self._marks = FeatureMarks(self._desk)
        self._shown = SketchView(self._desk, self)
        self._hands = CanvasInput(self._desk, self._marks, self)
        self._keys = Keys(self._desk, self._hands, self)
        ShortcutOverride(self, self._keys.wants)
        Tips(self._desk, self)
        self._fits = True
        self._shows_focus = False
        self._overlays = Overlays(self._desk, self._marks)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setMouseTracking(True)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self.setAttribute(Qt.WidgetAttribute.WA_InputMethodEnabled, False)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setMinimumSize(160, 120)
        self.setAccessibleName("Sketch")
        self.setAccessibleDescription("The layers of the sketch, to paint on; the arrow keys move it")
        self.setWhatsThis(
            "Paint here: the terrain follows. The wheel zooms, the middle button or the space bar moves the "
            "sheet, [ and ] change the brush, the right button erases, Alt picks what is painted."
        )
        self._connect()

    def sizeHint(self) -> QSize:
        """Return the size that it likes."""
        return QSize(720, 720)

    @property
    def viewport(self) -> Viewport:
        """Where the sheet lies, in device pixels."""
        return self._desk.viewport

    def fit(self) -> None:
        """Show the whole sketch."""
        self._fits = True
        self.look(self._desk.viewport.fitted(margin=round(_MARGIN * self._desk.ratio)), fits=True)

    def zoom_in(self) -> None:
        """Show the middle larger."""
        self.zoom(_ZOOM, QPointF(self.rect().center()))

    def zoom_out(self) -> None:
        """Show the middle smaller."""
        self.zoom(1.0 / _ZOOM, QPointF(self.rect().center()))

    def actual_size(self) -> None:
        """Show a pixel of the sketch as a pixel of the screen."""
        self.zoom(1.0 / self._desk.viewport.scale, QPointF(self.rect().center()))

    def show_place(self, x: float, y: float) -> None:
        """Bring a place (m) into the middle."""
        self.look(self._desk.viewport.with_middle(*self._desk.pixels(x, y)))

    def zoom(self, factor: float, about: QPointF) -> None:
        """Show the sheet larger by a factor; what lies at a place (logical px) stays there."""
        ratio = self._desk.ratio
        self.look(self._desk.viewport.zoomed(factor, about.x() * ratio, about.y() * ratio))

    def scroll_by(self, right: float, down: float) -> None:
        """Move the sheet by logical px."""
        self.look(self._desk.viewport.moved(right * self._desk.ratio, down * self._desk.ratio))

    def look(self, viewport: Viewport, *, fits: bool = False) -> None:
        """Show the sheet through another viewport; `fits`: it stays fitted when the canvas is resized."""
        if viewport != self._desk.viewport:
            self._fits = fits
            self._desk.viewport = viewport
            self._overlays.forget_eye()
            self._hands.follow_sheet()
            self.update()

    # ── what models tell ─────────────────────────────────────────────────────────────────────────────────

    def _connect(self) -> None:
        document, workspace, link = self._desk.document, self._desk.workspace, self._desk.link
        document.sketch_changed.connect(self._on_sketch)
        document.opened.connect(self._on_opened)
        workspace.selection_changed.connect(self._redraw)
        link.placed_changed.connect(self._redraw)
        link.frame_shown.connect(self._on_frame)
        self._desk.tells.message.connect(self.message)
        self._desk.tells.stale.connect(self._redraw)
        self._shown.stale.connect(self._on_stale)

    def _redraw(self, area: object = None) -> None:
        if isinstance(area, QRectF) and not area.isEmpty():
            self.update(area.toAlignedRect().adjusted(-2, -2, 2, 2))
        else:
            self.update()

    def _on_stale(self, area: object) -> None:
        self.update(self._logical(cast("QRect", area)))

    def _on_sketch(self) -> None:
        sketch, viewport = self._desk.document.sketch, self._desk.viewport
        if (sketch.width_px, sketch.height_px) != (viewport.columns, viewport.rows):
            self._on_opened()
        self.update()

    def _on_opened(self) -> None:
        self._hands.forget()
        self._shown.refresh()
        self._resize(fits=True)

    def _on_frame(self, facts: object) -> None:
        for area in self._overlays.eye_moved(cast("FrameFacts", facts)):
            self._redraw(area)

    # ── drawing ──────────────────────────────────────────────────────────────────────────────────────────

    def _logical(self, area: QRect) -> QRect:
        ratio = self._desk.ratio
        logical = QRectF(area.x() / ratio, area.y() / ratio, area.width() / ratio, area.height() / ratio)
        return logical.toAlignedRect()

    def _resize(self, *, fits: bool) -> None:
        sketch, context = self._desk.document.sketch, self._desk
        context.ratio = self.devicePixelRatioF()
        size = round(self.width() * context.ratio), round(self.height() * context.ratio)
        sides = (sketch.width_px, sketch.height_px)
        if fits or sides != (context.viewport.columns, context.viewport.rows):
            self._fits = True
            context.viewport = Viewport(*size, *sides).fitted(margin=round(_MARGIN * context.ratio))
        else:
            context.viewport = context.viewport.resized(*size)
        self._overlays.forget_eye()
        self.update()

    def resizeEvent(self, event: QResizeEvent | None) -> None:
        """Keep what was in the middle there, or the whole sheet in sight if it was."""
        self._resize(fits=self._fits)

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Show the picture that is kept, and over it what lives."""
        context = self._desk
        if context.ratio != self.devicePixelRatioF():  # it came to another screen
            self._resize(fits=self._fits)
        area = event.rect() if event is not None else self.rect()
        painter = QPainter(self)
        self._shown.draw(painter, area)
        self._overlays.draw(painter, area, self._hands.tool, self.width(), self.height())
        if self._shows_focus and self.hasFocus():
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.setPen(QPen(theme().accent, 2.0))
            painter.drawRect(QRectF(self.rect()).adjusted(1.0, 1.0, -1.0, -1.0))
        painter.end()

    # ── input: see `hands` and `keys` ────────────────────────────────────────────────────────────────────

    def mousePressEvent(self, event: QMouseEvent | None) -> None:
        """Begin what the tool does."""
        self._hands.press(event)

    def mouseMoveEvent(self, event: QMouseEvent | None) -> None:
        """Go on with it."""
        self._hands.move(event)

    def mouseReleaseEvent(self, event: QMouseEvent | None) -> None:
        """Let go."""
        self._hands.release(event)

    def mouseDoubleClickEvent(self, event: QMouseEvent | None) -> None:
        """Do what the tool does at a double click."""
        self._hands.double(event)

    def wheelEvent(self, event: QWheelEvent | None) -> None:
        """Zoom, or change the brush."""
        self._hands.wheel(event)

    def tabletEvent(self, event: QTabletEvent | None) -> None:
        """Paint with a pen."""
        self._hands.pen(event)

    def contextMenuEvent(self, event: QContextMenuEvent | None) -> None:
        """Offer what can be done with a feature."""
        self._hands.menu(event)

    def enterEvent(self, event: QEnterEvent | None) -> None:
        """Show the tool's cursor."""
        self._hands.show_cursor()

    def leaveEvent(self, event: QEvent | None) -> None:
        """Show the brush no longer."""
        self._hands.leave()

    def keyPressEvent(self, event: QKeyEvent | None) -> None:
        """Do what a key means."""
        if event is not None and not self._keys.press(event):
            super().keyPressEvent(event)

    def keyReleaseEvent(self, event: QKeyEvent | None) -> None:
        """Let the sheet lie where it was moved."""
        if event is not None and not self._keys.release(event):
            super().keyReleaseEvent(event)

    def focusInEvent(self, event: QFocusEvent | None) -> None:
        """Show the focus, if keys brought it."""
        self._shows_focus = event is not None and event.reason() in _KEYS
        self.update()

    def focusOutEvent(self, event: QFocusEvent | None) -> None:
        """Finish what was begun."""
        self._hands.finish()
        self.update()

    def hideEvent(self, event: QHideEvent | None) -> None:
        """Finish what was begun."""
        self._hands.finish()
