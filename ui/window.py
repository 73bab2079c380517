"""Main window of the editor, its tool options and elevation files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PyQt6.QtCore import QEvent, QObject, QSignalBlocker, QSize, Qt, QTimer, pyqtSignal
from PyQt6.QtGui import QCloseEvent, QDragEnterEvent, QDropEvent, QResizeEvent, QShowEvent
from PyQt6.QtWidgets import QLabel, QMainWindow, QMenu, QSizePolicy, QTabWidget, QWidget

from sketchterrain.document.drapes import drape_problem
from sketchterrain.document.rasters import RasterSource
from sketchterrain.elevation.raster_reader import SUFFIXES
from sketchterrain.errors import one_line
from sketchterrain.schema.layers import LAYERS
from sketchterrain.ui.actions import DRAPE_METHODS, Actions, RecentMenu, add_menus, add_tool_bars
from sketchterrain.ui.banner import Banner, ErrorReporter, Message, UncaughtExceptions
from sketchterrain.ui.canvas.canvas import ZOOM, Canvas
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import GoTo
from sketchterrain.ui.files import Files, OpenDialogs
from sketchterrain.ui.layout import FullScreenActions, PaneFocus, PanelLayout, fitting_size
from sketchterrain.ui.look.layer_colours import swatch
from sketchterrain.ui.look.theme import SMALL, SPACING, active_theme, app_icon, described, row, tabular
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.elevation import SketchElevation, added_elevation, new_on_elevation
from sketchterrain.ui.models.workspace import BRUSHES, Bookmarks, Preferences, RecentFiles, Workspace
from sketchterrain.ui.panels.base import BasePanel
from sketchterrain.ui.panels.controls import SLIDER_STEPS, Scale, slider
from sketchterrain.ui.panels.layers import LayersPanel
from sketchterrain.ui.panels.lists import BookmarksPanel, ContradictionsPanel, HistoryPanel
from sketchterrain.ui.panels.properties import PropertiesPanel
from sketchterrain.ui.panels.settings import ViewPanel, WorldPanel
from sketchterrain.ui.panels.status_line import AdherencePanel, StatusLine
from sketchterrain.ui.view3d.camera import show_line
from sketchterrain.ui.view3d.view import View3D
from sketchterrain.ui.world_window import SketchActions, ViewActions

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.elevation.base import BaseElevation

_RADII = Scale(*BRUSHES, "ratio")
_SWATCH = 20
_LABEL_TOOLS = ("brush", "line", "fill", "pick")
_SIZE_TOOLS = ("brush", "eraser", "line")
_ELEVATION_FILTER = f"Elevation ({' '.join(f'*{each}' for each in SUFFIXES)});;All files (*)"


class ToolOptions(QWidget):
    """Shows the active label and sets the brush's radius."""

    def __init__(self, document: Document, workspace: Workspace) -> None:
        super().__init__()
        self._document, self._workspace = document, workspace
        self._swatch, self._label, self._size_title = QLabel(), QLabel(), QLabel("Brush")
        self._swatch.setFixedSize(_SWATCH, _SWATCH)
        self._label.setMinimumWidth(self.fontMetrics().horizontalAdvance("Mountains 16 ") + SMALL)
        tip = "Radius of the brush: [ and ] on the sketch"
        self._slider = described(slider(), "Radius of the brush", tip)
        self._slider.setFixedWidth(140)
        self._size = QLabel()
        self._size.setFont(tabular(self.font()))
        self._size.setMinimumWidth(self.fontMetrics().horizontalAdvance("512 px · 88888 m "))
        self._size_parts = (self._size_title, self._slider, self._size)
        row(self, self._swatch, self._label, *self._size_parts, margins=(SPACING, 0, SPACING, 0))
        self.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Preferred)
        self._slider.valueChanged.connect(self._set_brush)
        workspace.brush_changed.connect(self._show_brush)
        workspace.label_changed.connect(self._show_label)
        workspace.tool_changed.connect(self._show_tool)
        document.sketch_changed.connect(self._show_brush)
        active_theme.changed.connect(self._show_label)
        self._show_label()
        self._show_brush()
        self._show_tool()

    def changeEvent(self, event: QEvent | None) -> None:
        super().changeEvent(event)
        if event is not None and event.type() == event.Type.DevicePixelRatioChange:
            self._show_label()

    def _show_label(self, *_: object) -> None:
        layer, label = self._workspace.layer, self._workspace.label
        self._swatch.setPixmap(swatch(layer, label, _SWATCH, self.devicePixelRatioF()))
        self._label.setText(f"{LAYERS[layer].title} {label}")
        self._label.setToolTip(f"Painting {LAYERS[layer].title.lower()}, label {label}")

    def _show_brush(self, *_: object) -> None:
        radius = self._workspace.brush
        metres = radius * self._document.sketch.pixel_size
        with QSignalBlocker(self._slider):
            self._slider.setValue(round(_RADII.fraction(radius) * SLIDER_STEPS))
        pixels = f"{radius:.1f}" if radius < 10 else f"{radius:.0f}"
        self._size.setText(f"{pixels} px · {metres:,.0f} m".replace(",", "\u202f"))

    def _show_tool(self, *_: object) -> None:
        tool = self._workspace.tool
        for widgets, tools in (((self._swatch, self._label), _LABEL_TOOLS), (self._size_parts, _SIZE_TOOLS)):
            for widget in widgets:
                widget.setEnabled(tool in tools)

    def _set_brush(self, step: int) -> None:
        self._workspace.brush = _RADII.value(step / SLIDER_STEPS)


class ElevationFiles(QObject):
    """Asks for elevation files and reads them; failures become messages."""

    findings_requested = pyqtSignal()  # to show what was found in the data

    def __init__(self, files: Files, elevation: SketchElevation) -> None:
        super().__init__(files)
        self._files, self._elevation, self._banner = files, elevation, files.banner

    def ask_new(self) -> None:
        """Ask for files and start a sketch on them unless the user keeps the current one."""
        if paths := self._files.ask_files("New from elevation", _ELEVATION_FILTER):
            self._files.read(paths[0], partial(new_on_elevation, paths), self._start)

    def ask_add(self) -> None:
        """Ask for files and add them to the sketch."""
        if paths := self._files.ask_files("Add elevation", _ELEVATION_FILTER):
            self.add(paths)

    def add(self, paths: Sequence[Path]) -> None:
        """Add files to the sketch in one undo step; a sketch without a place gets theirs."""
        work = partial(added_elevation, paths, self._elevation.document.sketch, self._elevation.memory)
        self._files.read(paths[0], work, self._add)

    def change(self, title: str, change: Callable[[Sketch], dict[str, Any]]) -> None:
        """Change fields of the sketch by what is in its elevation data, in one undo step."""
        sketch = self._elevation.document.sketch
        path = Path(sketch.elevation_rasters[0].path)
        self._files.read(path, partial(change, sketch), partial(self._change, title, sketch))

    def _change(self, title: str, before: Sketch, fields: dict[str, Any]) -> None:
        if self._elevation.document.sketch is not before:
            self._banner.show_message(Message("info", f"{title}: the sketch has changed meanwhile", "hint"))
        elif all(getattr(before, name) == value for name, value in fields.items()):
            self._banner.show_message(Message("info", f"{title}: there are none", "hint"))
        else:
            self._files.change(title, **fields)

    def _start(self, found: tuple[Sketch, BaseElevation]) -> None:
        sketch, base = found
        if not self._files.start_sketch(sketch, modified=True):
            return
        width, depth = (side / 1000.0 for side in sketch.size)
        line = f"A sketch of {width:.3g} × {depth:.3g} km on elevation data"
        names = tuple(f"{each.name}: " for each in base.grids)
        parts = [line, *(each for each in base.findings if not each.startswith(names))]
        if count := sum(each.startswith(names) for each in base.findings):
            parts.append(f"findings in the data: {count}")
        buttons = (("Show", self.findings_requested.emit),) if count else ()
        self._banner.show_message(Message("good", "; ".join(parts), "elevation", buttons))

    def _add(self, found: tuple[tuple[RasterSource, ...], dict[str, Any]]) -> None:
        sources, frame = found
        sketch = self._elevation.document.sketch
        title = sources[0].title if len(sources) == 1 else f"{len(sources)} elevation grids"
        frame = {**sketch.frame} if sketch.frame["crs"] else frame
        self._files.change(f"Add {title}", rasters=(*sketch.rasters, *sources), frame=frame)


_SIZE = QSize(1500, 920)
_MIN_SIZE = QSize(720, 480)


class MainWindow(QMainWindow):
    """The editor's window, which stores recent files and bookmarks in the folder `state`."""

    def __init__(
        self,
        document: Document,
        workspace: Workspace,
        link: EngineLink,
        preferences: Preferences,
        state: Path,
    ) -> None:
        super().__init__()
        self._document, self._workspace, self._link = document, workspace, link
        self._preferences = preferences
        self._raster_problems: tuple[str, ...] = ()
        self._needs_default_sizes = preferences.layout is None
        self.setWindowIcon(app_icon())
        self.setMinimumSize(_MIN_SIZE)
        self.setAcceptDrops(True)
        self.setDockNestingEnabled(True)
        self.setTabPosition(Qt.DockWidgetArea.AllDockWidgetAreas, QTabWidget.TabPosition.North)
        self.resize(fitting_size(_SIZE, self.screen()))
        self.actions_by_name = Actions(self)
        commands = add_tool_bars(self, self.actions_by_name, (ToolOptions(document, workspace), _stretch()))
        self.banner = Banner(self, below=commands)
        # Qt raises the canvas after another tab is shown.
        self.tabifiedDockWidgetActivated.connect(lambda _: QTimer.singleShot(0, self.banner.raise_))
        self.uncaught_exceptions = UncaughtExceptions(self.banner, self)
        bookmarks, recent = Bookmarks(document, state / "bookmarks"), RecentFiles(state / "recent")
        bookmarks.failed.connect(self.warn)
        self._add_panels(bookmarks)
        self.files = Files(self, document, preferences, recent, self.banner)
        elevation = self.canvas.underlay.elevation
        self.elevation_files = ElevationFiles(self.files, elevation)
        self.files.elevation_chosen.connect(self.elevation_files.add)
        self.elevation_files.findings_requested.connect(partial(self.panel_layout.show_panel, "base"))
        drapes = self._layers.drapes
        self.files.drapes_read.connect(drapes.add)
        drapes.add_requested.connect(self.files.ask_add_drapes)
        drapes.zoom_requested.connect(self._zoom_to_drape)
        drapes.save_requested.connect(self.files.save_drape)
        self._base.add_requested.connect(self.elevation_files.ask_add)
        self._base.change_requested.connect(self.elevation_files.change)
        self.canvas.underlay.changed.connect(self._show_raster_problems)
        document.drapes.changed.connect(self._show_raster_problems)
        self._show_raster_problems()
        self._add_menus(recent)
        ErrorReporter(self.banner, link)
        self._bind()
        document.saved_changed.connect(self._show_title)
        document.sketch_changed.connect(self._show_title)
        document.opened.connect(self._show_new_sketch)
        self._open_brushes()
        self._show_title()
        if preferences.layout is not None:
            self.restoreGeometry(preferences.layout[0])
            self.panel_layout.restore(preferences.layout[1])

    def _add_panels(self, bookmarks: Bookmarks) -> None:
        document, workspace, link = self._document, self._workspace, self._link
        self.canvas, self.view = Canvas(document, workspace, link), View3D(document, workspace, link)
        self._layers, self._bookmarks = LayersPanel(document, workspace), BookmarksPanel(link, bookmarks)
        contradictions, status = ContradictionsPanel(workspace, link), StatusLine(document, workspace, link)
        self._base = BasePanel(document, self.canvas.underlay.elevation)
        properties = PropertiesPanel(document, workspace, link)
        self.setCentralWidget(self.canvas)
        panels: dict[str, QWidget] = {
            "layers": self._layers,
            "properties": properties,
            "world": WorldPanel(document),
            "base": self._base,
            "light": ViewPanel(document, link),
            "view": self.view,
            "history": HistoryPanel(document),
            "adherence": AdherencePanel(workspace, link),
            "contradictions": contradictions,
            "bookmarks": self._bookmarks,
        }
        self.panel_layout = PanelLayout(self, panels)
        focus = PaneFocus(self, (self.canvas, self.view), self.panel_layout.docks.values())
        workspace.label_changed.connect(focus.leave_field)
        for part in (self.canvas, self.view):
            part.hovered.connect(status.show_position)
        document.message.connect(self._show_hint)
        contradictions.place_activated.connect(self._show_place)
        bar = self.statusBar()
        if bar is not None:
            bar.setSizeGripEnabled(False)
            bar.addPermanentWidget(status, 1)

    def _add_menus(self, recent: RecentFiles) -> None:
        tools, panels, views = (QMenu(title, self) for title in ("&Tool", "&Panels", "Go to &view"))
        for action in self.actions_by_name:
            if action.objectName().startswith("tool-"):
                tools.addAction(action)
            if action.objectName().startswith("bookmark-"):
                views.addAction(action)
        self.panel_layout.add_toggles(panels)
        submenus = {
            menu.title(): menu for menu in (RecentMenu(recent, self.files.open, self), tools, panels, views)
        }
        add_menus(self, self.actions_by_name, submenus)

    def _bind(self) -> None:
        actions, files, show = self.actions_by_name, self.files, self._link.change_view
        FullScreenActions(self, actions, self.panel_layout)
        SketchActions(actions, self._document, self._workspace, self._link, self.banner)
        ViewActions(actions, self._link, self._workspace)
        self.dialogs = OpenDialogs(files, actions, self._link)
        self.view.picture_requested.connect(actions["save-picture"].trigger)
        actions.bind(
            {
                "elevation": self.elevation_files.ask_new,
                "open": files.ask_open,
                "open-folder": files.ask_open_folder,
                "save": files.save,
                "save-as": files.save_as,
                "import": lambda: files.ask_import(self._workspace.layer),
                "add-raster": files.ask_add_raster,
                "add-drapes": files.ask_add_drapes,
                "quit": self.close,
                "fit": self.canvas.fit,
                "zoom-in": partial(self.canvas.zoom, ZOOM),
                "zoom-out": partial(self.canvas.zoom, 1.0 / ZOOM),
                "actual-size": self.canvas.actual_size,
                "new-label": self._layers.new_label,
                "delete-label": self._layers.delete_label,
                "clear-layer": self._layers.clear_layer,
                **{f"layer-{name}": partial(self._layers.use_layer, name) for name in LAYERS},
                "look-all": self.view.see_all,
                "look-best": self.view.see_best,
                "look-selection": self.view.see_selection,
                "bookmark": self._bookmarks.add,
                **{f"bookmark-{n + 1}": partial(self._bookmarks.go_to, n) for n in range(9)},
                "restart": self._link.start,
                **{f"drape-{each}": partial(show, drape_method=each) for each in DRAPE_METHODS},
            }
        )
        actions["drape-tiles"].setChecked(True)

    def showEvent(self, event: QShowEvent | None) -> None:
        super().showEvent(event)
        if self._needs_default_sizes:
            self._needs_default_sizes = False
            self.panel_layout.set_default_sizes()

    def resizeEvent(self, event: QResizeEvent | None) -> None:
        super().resizeEvent(event)
        self.banner.update_position()

    def dragEnterEvent(self, event: QDragEnterEvent | None) -> None:
        if event is not None and _local_files(event):
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent | None) -> None:
        if event is not None:
            event.acceptProposedAction()
            self.files.open_dropped(_local_files(event), self._workspace.layer)

    def closeEvent(self, event: QCloseEvent | None) -> None:
        if event is None:
            return
        if not self.files.confirm_close():
            event.ignore()
            return
        self.dialogs.close_all()
        self._preferences.layout = self.saveGeometry(), self.panel_layout.state()
        self._preferences.save()
        event.accept()

    def warn(self, line: str) -> None:
        """Report that a file of the program's state cannot be written."""
        self.banner.show_message(Message("warning", line, "state"))

    def _show_new_sketch(self) -> None:
        self._workspace.selection = None
        self._open_brushes()
        self.canvas.fit()

    def _open_brushes(self) -> None:
        sketch = self._document.sketch
        self._workspace.open_brushes(max(sketch.width_px, sketch.height_px))

    def _show_title(self) -> None:
        path = self._document.path
        name = self._document.sketch.name or (path.stem if path else "Untitled")
        self.setWindowTitle(f"{name}[*] — Sketchterrain")
        self.setWindowModified(self._document.is_modified)
        self.setWindowFilePath(str(path) if path else "")

    def _show_hint(self, line: str) -> None:
        self.banner.show_message(Message("info", line, "hint"))

    def _show_raster_problems(self) -> None:
        lines = (*self.canvas.underlay.problems, *self._document.drapes.problems)
        if lines == self._raster_problems:
            return
        for line in self._raster_problems:
            self.banner.withdraw(line)
        self._raster_problems = lines
        for line in lines:
            self.banner.show_message(Message("warning", line, line, self._drape_buttons(line)))

    def _drape_buttons(self, line: str) -> tuple[tuple[str, Callable[[], object]], ...]:
        """Return a button that accepts a draped layer's changed file, if that is the problem."""
        for number, layer in enumerate(self._document.sketch.drapes):
            if one_line(layer.path) in line and Path(layer.path).exists() and drape_problem(layer):
                return (("Update", partial(self._layers.drapes.update_file, number)),)
        return ()

    def _zoom_to_drape(self, number: int) -> None:
        """Show all of a draped layer on the canvas and in 3-D."""
        source = self._document.drapes.source(number)
        if source is not None:
            self.canvas.show_box(*source.box.tolist())
            self._link.send(show_line(source.box.reshape(2, 2), self._document.sketch.size))

    def _show_place(self, x: float, y: float) -> None:
        self.canvas.show_place(x, y)
        self._link.send(GoTo(x, y))


def _stretch() -> QWidget:
    space = QWidget()
    space.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Preferred)
    return space


def _local_files(event: QDropEvent) -> list[Path]:
    data = event.mimeData()
    if data is None:
        return []
    return [Path(url.toLocalFile()) for url in data.urls() if url.isLocalFile()]
