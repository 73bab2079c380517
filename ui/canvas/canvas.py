"""The sketch editor: displays the sketch with its overlays, to paint and select on."""

from PyQt6.QtCore import QPointF, QRect, QRectF, QSize, Qt, pyqtSignal
from PyQt6.QtGui import QPainter, QPaintEvent, QResizeEvent
from PyQt6.QtWidgets import QSizePolicy, QWidget

from sketchterrain.ui.canvas.canvas_input import CanvasInput
from sketchterrain.ui.canvas.decorations import Decorations
from sketchterrain.ui.canvas.sketch_image import SketchView
from sketchterrain.ui.canvas.tool_context import ToolContext, Viewport
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import FrameFacts
from sketchterrain.ui.look.theme import draw_focus
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Workspace

_MARGIN = 28  # logical px around a fitted sketch
_ZOOM = 1.25


class Canvas(QWidget):
    """Displays a document's sketch; `CanvasInput` handles mouse, pen and keys."""

    hovered = pyqtSignal(object)  # (x, y, height or None) under the mouse, m; None: outside the sketch

    def __init__(self, document: Document, workspace: Workspace, link: EngineLink) -> None:
        super().__init__()
        self._context = ToolContext(document, workspace, link)
        self._sketch_view = SketchView(self._context, self)
        self.underlay, self.drapes = self._sketch_view.underlay, self._sketch_view.drapes
        self._input = CanvasInput(self._context, self)
        self._decorations = Decorations(self._context)
        self._fitted = True
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
            "sketch, [ and ] change the brush, the right button erases, Alt picks a label."
        )
        document.sketch_changed.connect(self._on_sketch)
        document.opened.connect(self._on_opened)
        document.drapes.changed.connect(self._redraw)
        workspace.selection_changed.connect(self._redraw)
        workspace.look_changed.connect(self._redraw)
        link.placed_changed.connect(self._redraw)
        link.frame_shown.connect(self._on_frame)
        self._context.redraw = self._redraw
        self._sketch_view.stale.connect(self._on_stale)

    def sizeHint(self) -> QSize:
        return QSize(720, 720)

    @property
    def viewport(self) -> Viewport:
        """Position of the sketch, in device pixels."""
        return self._context.viewport

    def fit(self) -> None:
        self.set_viewport(self.viewport.fitted(margin=round(_MARGIN * self._context.ratio)), fitted=True)

    def zoom_in(self) -> None:
        self.zoom(_ZOOM, QPointF(self.rect().center()))

    def zoom_out(self) -> None:
        self.zoom(1.0 / _ZOOM, QPointF(self.rect().center()))

    def actual_size(self) -> None:
        """Show each sketch pixel as one device pixel."""
        self.zoom(1.0 / self.viewport.scale, QPointF(self.rect().center()))

    def show_place(self, x: float, y: float) -> None:
        """Centre a position (m)."""
        self.set_viewport(self.viewport.with_middle(*self._context.sketch_from_world(x, y)))

    def show_box(self, west: float, south: float, east: float, north: float) -> None:
        """Centre a box (m) and show as much of it as fits."""
        context = self._context
        size = max((east - west) / self.width(), (north - south) / self.height()) * 1.1  # m a logical px
        if size > 0.0:
            self.zoom(1.0 / (size * context.px_per_metre), QPointF(self.rect().center()))
        self.show_place(0.5 * (west + east), 0.5 * (south + north))

    def zoom(self, factor: float, about: QPointF) -> None:
        """Zoom about a position (logical px)."""
        ratio = self._context.ratio
        self.set_viewport(self.viewport.zoomed(factor, about.x() * ratio, about.y() * ratio))

    def scroll_by(self, right: float, down: float) -> None:
        """Pan by logical px."""
        ratio = self._context.ratio
        self.set_viewport(self.viewport.moved(right * ratio, down * ratio))

    def set_viewport(self, viewport: Viewport, *, fitted: bool = False) -> None:
        """Show the sketch through a viewport; `fitted`: it stays fitted when the canvas is resized."""
        self._fitted |= fitted
        if viewport != self._context.viewport:
            self._fitted = fitted
            self._context.viewport = viewport
            self._decorations.reset()
            self._input.update_brush_ring()
            self.update()

    def _redraw(self, area: object = None) -> None:
        if isinstance(area, QRectF) and not area.isEmpty():
            self.update(area.toAlignedRect().adjusted(-2, -2, 2, 2))
        else:
            self.update()

    def _on_stale(self, pixels: QRect) -> None:
        ratio = self._context.ratio
        size = (pixels.width() / ratio, pixels.height() / ratio)
        self.update(QRectF(pixels.x() / ratio, pixels.y() / ratio, *size).toAlignedRect())

    def _on_sketch(self) -> None:
        sketch, viewport = self._context.document.sketch, self.viewport
        if (sketch.width_px, sketch.height_px) != (viewport.columns, viewport.rows):
            self._on_opened()
        self.update()

    def _on_opened(self) -> None:
        self._input.cancel()
        self._sketch_view.refresh()
        self._resize(fitted=True)

    def _on_frame(self, facts: FrameFacts) -> None:
        for area in self._decorations.camera_moved(facts):
            self._redraw(area)

    def _resize(self, *, fitted: bool) -> None:
        sketch, context = self._context.document.sketch, self._context
        context.ratio = self.devicePixelRatioF()
        size = round(self.width() * context.ratio), round(self.height() * context.ratio)
        sides = (sketch.width_px, sketch.height_px)
        if fitted or sides != (context.viewport.columns, context.viewport.rows):
            self._fitted = True
            context.viewport = Viewport(*size, *sides).fitted(margin=round(_MARGIN * context.ratio))
        else:
            context.viewport = context.viewport.resized(*size)
        self._decorations.reset()
        self.update()

    def resizeEvent(self, event: QResizeEvent | None) -> None:
        """Keep the centre, or the whole sketch if it was fitted."""
        self._resize(fitted=self._fitted)

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Draw the cached sketch image, then decorations and the tool's overlay."""
        if self._context.ratio != self.devicePixelRatioF():  # moved to another screen
            self._resize(fitted=self._fitted)
        area = event.rect() if event is not None else self.rect()
        painter = QPainter(self)
        self._sketch_view.draw(painter, area)
        self._decorations.draw(painter, area, self._input.tool, self.width(), self.height())
        draw_focus(painter, self)
        painter.end()
