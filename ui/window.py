"""The main window: the sketch, the 3-D view, the panels around them, and what connects them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from PyQt6.QtCore import QSize, Qt
from PyQt6.QtGui import QCloseEvent, QDragEnterEvent, QDropEvent, QResizeEvent, QShowEvent
from PyQt6.QtWidgets import QMainWindow, QMenu, QSizePolicy, QTabWidget, QWidget

from sketchterrain.ui.actions import Actions
from sketchterrain.ui.banner import Banner, ErrorReporter, Message, UncaughtExceptions
from sketchterrain.ui.canvas.canvas import Canvas
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import GoTo
from sketchterrain.ui.files import Files
from sketchterrain.ui.layout import FullViews, Layout, fitting_size
from sketchterrain.ui.look.icons import app_icon
from sketchterrain.ui.menus import RecentMenu, add_last, add_menus, add_tool_bars
from sketchterrain.ui.models.background import Saving
from sketchterrain.ui.models.bookmarks import Bookmarks
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.preferences import Preferences, RecentFiles
from sketchterrain.ui.models.workspace import Workspace
from sketchterrain.ui.open_dialogs import OpenDialogs
from sketchterrain.ui.panels.adherence import AdherencePanel
from sketchterrain.ui.panels.layers import LayersPanel
from sketchterrain.ui.panels.lists import ContradictionsPanel, HistoryPanel
from sketchterrain.ui.panels.properties import PropertiesPanel
from sketchterrain.ui.panels.status_line import StatusLine
from sketchterrain.ui.panels.view import ViewPanel
from sketchterrain.ui.panels.world import WorldPanel
from sketchterrain.ui.sketch_actions import SketchActions
from sketchterrain.ui.tool_options import ToolOptions
from sketchterrain.ui.view3d.bookmarks import BookmarksPanel
from sketchterrain.ui.view3d.view import View3D
from sketchterrain.ui.view_actions import ViewActions


class Parts:
    """Makes every part once."""

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


_SIZE = QSize(1500, 920)
_LEAST = QSize(720, 480)


class MainWindow(QMainWindow):
    """The program's window."""

    def __init__(
        self,
        document: Document,
        workspace: Workspace,
        link: EngineLink,
        *,
        preferences: Preferences,
        recent: RecentFiles,
        saving: Saving,
        bookmarks: Bookmarks,
    ) -> None:
        super().__init__()
        self._document, self._workspace, self._link = document, workspace, link
        self._preferences = preferences
        self._is_fresh = preferences.layout is None
        self.setWindowIcon(app_icon())
        self.setMinimumSize(_LEAST)
        self.setAcceptDrops(True)
        self.setDockOptions(
            QMainWindow.DockOption.AnimatedDocks
            | QMainWindow.DockOption.AllowTabbedDocks
            | QMainWindow.DockOption.AllowNestedDocks
        )
        self.setTabPosition(Qt.DockWidgetArea.AllDockWidgetAreas, QTabWidget.TabPosition.North)
        self.resize(fitting_size(_SIZE, self.screen()))
        self.actions_by_name = Actions(self)
        commands, _ = add_tool_bars(self, self.actions_by_name)
        commands.addSeparator()
        commands.addWidget(ToolOptions(document, workspace))
        commands.addWidget(_stretch())
        add_last(commands, self.actions_by_name)
        self.banner = Banner(self, below=commands)
        self.surprises = UncaughtExceptions(self.banner, self)
        self._parts = Parts(document, workspace, link, bookmarks)
        self.canvas, self.view = self._parts.canvas, self._parts.view
        self.setCentralWidget(self.canvas)
        self.layout_of_parts = Layout(self, self._parts.panels)
        self.files = Files(
            self,
            document=document,
            preferences=preferences,
            recent=recent,
            saving=saving,
            banner=self.banner,
        )
        self._add_menus(recent)
        status = self.statusBar()
        if status is not None:
            status.setSizeGripEnabled(False)
            status.addPermanentWidget(self._parts.status, 1)
        ErrorReporter(self.banner, link)
        self._parts.tell_by(self._say)
        self.view.picture_wanted.connect(self.actions_by_name["save-picture"].trigger)
        self._parts.contradictions.show_place.connect(self._show_place)
        self._bind()
        document.saved_changed.connect(self._show_title)
        document.sketch_changed.connect(self._show_title)
        document.opened.connect(self._begin)
        self._show_title()
        self._restore_layout()

    def _add_menus(self, recent: RecentFiles) -> None:
        tools, panels, views = (QMenu(title, self) for title in ("&Tool", "&Panels", "Go to &view"))
        for action in self.actions_by_name:
            if action.objectName().startswith("tool-"):
                tools.addAction(action)
            if action.objectName().startswith("bookmark-"):
                views.addAction(action)
        self.layout_of_parts.add_toggles(panels)
        inner = {
            "Open &recent": RecentMenu(recent, self.files, self),
            "&Tool": tools,
            "&Panels": panels,
            "Go to &view": views,
        }
        add_menus(self, self.actions_by_name, inner)

    def _bind(self) -> None:
        actions, files = self.actions_by_name, self.files
        FullViews(self, actions, self.layout_of_parts)
        SketchActions(actions, self._document, self._workspace, self._link, self.banner)
        ViewActions(actions, self._link, self._workspace)
        self.dialogs = OpenDialogs(
            self,
            actions,
            document=self._document,
            link=self._link,
            preferences=self._preferences,
            files=files,
            banner=self.banner,
        )
        actions.bind(
            {
                "open": files.ask_open,
                "open-folder": files.ask_open_folder,
                "save": files.save,
                "save-as": files.save_as,
                "import": self._import,
                "quit": self.close,
                "fit": self.canvas.fit,
                "zoom-in": self.canvas.zoom_in,
                "zoom-out": self.canvas.zoom_out,
                "actual-size": self.canvas.actual_size,
                "new-label": self._parts.layers.new_label,
                "delete-label": self._parts.layers.delete_label,
                "clear-layer": self._parts.layers.clear_layer,
                "look-all": self.view.see_all,
                "look-best": self.view.see_best,
                "look-chosen": self.view.see_chosen,
                "bookmark": self._parts.bookmarks.add,
                **{
                    f"bookmark-{number}": partial(self._parts.bookmarks.go_to, number - 1)
                    for number in range(1, 10)
                },
                "restart": self._restart,
            }
        )

    def showEvent(self, event: QShowEvent | None) -> None:
        """Share out the room when there is some for the first time."""
        super().showEvent(event)
        if self._is_fresh:
            self._is_fresh = False
            self.layout_of_parts.share_out()

    def resizeEvent(self, event: QResizeEvent | None) -> None:
        """Keep messages in the middle."""
        super().resizeEvent(event)
        self.banner.place()

    def dragEnterEvent(self, event: QDragEnterEvent | None) -> None:
        """Welcome files."""
        if event is not None and _paths(event):
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent | None) -> None:
        """Open a sketch, or take images as layers."""
        if event is not None:
            event.acceptProposedAction()
            self.files.take(_paths(event), self._workspace.layer)

    def closeEvent(self, event: QCloseEvent | None) -> None:
        """Ask about changes; remember where everything stood."""
        if event is None:
            return
        if not self.files.may_leave():
            event.ignore()
            return
        self.dialogs.end()
        self._preferences.layout = self.saveGeometry(), self.layout_of_parts.state()
        self._preferences.keep()
        event.accept()

    def _begin(self) -> None:
        self._workspace.selection = None
        self.canvas.fit()

    def _show_title(self) -> None:
        path = self._document.path
        name = self._document.sketch.name or (path.stem if path else "Untitled")
        self.setWindowTitle(f"{name}[*] — Sketchterrain")
        self.setWindowModified(self._document.is_modified)
        self.setWindowFilePath(str(path) if path else "")

    def warn(self, line: str) -> None:
        """Tell of something that could not be kept."""
        self.banner.tell(Message("warning", line, "keeping"))

    def _say(self, line: str) -> None:
        self.banner.tell(Message("info", line, "hint"))

    def _import(self) -> None:
        self.files.ask_import(self._workspace.layer)

    def _show_place(self, x: float, y: float) -> None:
        self.canvas.show_place(x, y)
        self._link.tell(GoTo(x, y))

    def _restart(self) -> None:
        self._link.stop()
        self._link.start()

    def _restore_layout(self) -> None:
        layout = self._preferences.layout
        if layout is not None:
            self.restoreGeometry(layout[0])
            self.layout_of_parts.restore(layout[1])


def _stretch() -> QWidget:
    space = QWidget()
    space.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Preferred)
    return space


def _paths(event: QDropEvent) -> list[Path]:
    data = event.mimeData()
    if data is None:
        return []
    return [Path(url.toLocalFile()) for url in data.urls() if url.isLocalFile()]
