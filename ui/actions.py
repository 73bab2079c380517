"""Commands of menus, buttons and keys: one declaration each, Qt actions from them, menus and tool bars."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import chain, repeat
from pathlib import Path
from typing import Final, cast

from PyQt6.QtCore import QEvent, QObject, QSize, Qt
from PyQt6.QtGui import QAction, QActionGroup, QClipboard, QGuiApplication, QIcon, QKeyEvent, QKeySequence
from PyQt6.QtWidgets import QMainWindow, QMenu, QToolBar, QWidget

from sketchterrain.landforms.placement.feature_types import FEATURE_TYPES
from sketchterrain.schema.layers import LAYERS
from sketchterrain.ui.commands import exists, is_edited, is_locked, name_of, reported
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.look.theme import icon
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.features import FEATURE_COMMANDS, paste, selected_text
from sketchterrain.ui.models.selection import add, delete, lock, reset, unlock
from sketchterrain.ui.models.workspace import OVERLAYS, TOOLS, RecentFiles, Selection, Workspace


@dataclass(frozen=True)
class Command:
    """A command of the user interface."""

    text: str  # Menu text with ``&`` before the mnemonic
    tip: str  # One line of help
    icon: str = ""  # Name of an icon
    keys: tuple[str, ...] = ()  # Shortcuts, the displayed one first
    kind: str = ""  # "check": on or off; "tool", "layer", "mode", "drape": one of an exclusive group


_TOOLS = {
    "select": ("V", "&Select", "Select and move generated features, lines and areas"),
    "brush": ("B", "&Brush", "Paint with the active label; [ and ] change the size"),
    "eraser": ("E", "&Eraser", "Erase paint of the active layer"),
    "line": (
        "L",
        "&Line",
        "Draw a river, road or line, or outline a lake, pad or field: click points, or drag",
    ),
    "fill": ("F", "&Fill", "Fill an area with the active label"),
    "pick": ("I", "P&ick", "Pick the label from the sketch"),
    "pan": ("H", "&Hand", "Move the sketch; Space does so with any tool"),
}
_LAYER_KEYS = "1234567890TPUWAN"
_MODES = {
    "orbit": ("&Orbit", "Turn around the terrain with the mouse"),
    "fly": ("&Fly", "Fly freely with W A S D and the mouse"),
    "walk": ("&Walk", "Walk on the ground with W A S D and the mouse"),
}
DRAPE_METHODS = {
    "tiles": ("Drape &by tiles", "Paint draped layers into tiles of the ground's appearance"),
    "two-step": ("Drape in t&wo steps", "Draw draped layers on a smooth approximation of the ground"),
    "geometry": ("Drape by &geometry", "Draw draped layers in each picture, exact to the pixel"),
}
_OVERLAYS = {
    "relief": ("&Relief beneath the paint", "the terrain's relief beneath the paint", "eye"),
    "elevation": ("Elevation &data beneath the paint", "elevation data beneath the paint, shaded", "world"),
    "pictures": ("Pictur&es beneath the paint", "pictures of raster sources beneath the paint", "gallery"),
    "features": ("Placed feat&ures and rivers", "placed features and rivers", "target"),
    "contradictions": (
        *("Co&ntradictions", "where layers contradict each other, and how it was resolved", "warning"),
    ),
    "adherence": ("&Adherence", "where the terrain agrees with the sketch", "adherence"),
    "realism": ("Realis&m", "where landforms differ from real land", "adherence"),
    "eye": ("Viewpoint of the 3-D &view", "position and direction of the 3-D camera", "camera"),
}

COMMANDS: Final[dict[str, Command]] = {
    # file
    "new": Command("&New…", "Start a sketch of another size or extent", "new", ("Ctrl+N",)),
    "open": Command("&Open…", "Open a .sketch file", "open", ("Ctrl+O",)),
    "open-folder": Command("Open &folder…", "Open a sketch stored as a folder of images", "open"),
    "open-world": Command("Open &world…", "Walk and fly in a stored world", "view"),
    "trace": Command("New from pi&cture…", "Start from a coloured map, painted layers or vectors", "pick"),
    "elevation": Command("New from ele&vation…", "Start on a real place: GeoTIFF, HGT, ASC, zip …", "world"),
    "presets": Command("&Presets…", "Start from one of the supplied sketches", "gallery", ("Ctrl+P",)),
    "save": Command("&Save", "Save the sketch", "save", ("Ctrl+S",)),
    "save-as": Command("Save &as…", "Save the sketch under another name", "", ("Ctrl+Shift+S",)),
    "import": Command("&Import layer image…", "Import a layer from a PNG of the sketch's size", "layers"),
    "add-raster": Command("A&dd raster…", "Show a georeferenced picture beneath the paint", "gallery"),
    "add-drapes": Command("Add draped la&yers…", "Show vectors or rasters on the terrain", "layers"),
    "export": Command("&Export terrain…", "Write heights, materials and plants", "export", ("Ctrl+E",)),
    "write-world": Command("Write wor&ld…", "Write a world of any size, with overviews", "world"),
    "save-picture": Command("Save pic&ture…", "Save the 3-D view", "screenshot", ("Ctrl+Shift+P",)),
    "quit": Command("&Quit", "Quit the program", "", ("Ctrl+Q",)),
    # edit
    "undo": Command("&Undo", "Undo the last step", "undo", ("Ctrl+Z",)),
    "redo": Command("&Redo", "Redo the undone step", "redo", ("Ctrl+Shift+Z", "Ctrl+Y")),
    "copy": Command("&Copy", "Copy the selected line or area", "", ("Ctrl+C",)),
    "paste": Command("P&aste", "Paste a copied line or area beside the first one", "", ("Ctrl+V",)),
    "delete-selection": Command("&Delete", "Delete the selected feature, vertex, line or area", "delete"),
    "split-line": Command("&Split line", "Split the selected line at the active vertex", "", ("S",)),
    "join-lines": Command("&Join lines", "Join the selected line with one that shares an end", "", ("J",)),
    "reverse-line": Command("Re&verse line", "Reverse the direction of the selected line"),
    "lock-selection": Command("&Lock", "Protect the selected feature", "lock", ("Ctrl+L",), "check"),
    "reset-selection": Command("Reset &edits", "Restore the selected feature as it was generated", "reset"),
    "select-none": Command("Select &nothing", "Clear the selection", "", ("Ctrl+Shift+A",)),
    "preferences": Command("&Preferences…", "Theme and device", "settings", ("Ctrl+,",)),
    "brush-smaller": Command("Brush s&maller", "Make the brush smaller", "", ("[",)),
    "brush-larger": Command("Brush lar&ger", "Make the brush larger", "", ("]",)),
    **{f"tool-{name}": Command(text, tip, name, (key,), "tool") for name, (key, text, tip) in _TOOLS.items()},
    # layer
    **{
        f"layer-{name}": Command(
            f"&{key} {layer.title}" if key.isdigit() else layer.title,
            f"{'Paint' if layer.is_painted else 'Draw'} {layer.help}",
            *("", tuple(key), "layer"),
        )
        for (name, layer), key in zip(LAYERS.items(), chain(_LAYER_KEYS, repeat("")), strict=False)
    },
    "new-label": Command("&New label", "Add a label to this layer", "add", ("Ctrl+Shift+N",)),
    "delete-label": Command("&Delete label", "Delete the label with its paint and vectors", "delete"),
    "clear-layer": Command("&Clear layer", "Erase all paint and vectors of this layer"),
    "show-layer": Command("&Visible", "Show this layer's paint", "eye", (), "check"),
    "lock-layer": Command("&Locked", "Protect this layer from painting", "lock", (), "check"),
    "only-layer": Command("Show &only this layer", "Hide the paint of all other layers", "", (), "check"),
    # view
    "fit": Command("&Fit sketch", "Show the whole sketch", "fit", ("Ctrl+0",)),
    "zoom-in": Command("Zoom &in", "Show the sketch larger", "zoom-in", ("Ctrl++", "Ctrl+=")),
    "zoom-out": Command("Zoom ou&t", "Show the sketch smaller", "zoom-out", ("Ctrl+-",)),
    "actual-size": Command("&One to one", "One sketch pixel a screen pixel", "actual-size", ("Ctrl+1",)),
    **{
        f"overlay-{name}": Command(text, f"Show {shown}", icon, (), "check")
        for name, (text, shown, icon) in _OVERLAYS.items()
    },
    **{f"drape-{name}": Command(*texts, kind="drape") for name, texts in DRAPE_METHODS.items()},
    "canvas-only": Command("&Canvas only", "Maximise the sketch", "canvas", ("F9",), "check"),
    "view-only": Command("&3-D view only", "Maximise the 3-D view", "view", ("F10",), "check"),
    "full-screen": Command("Full &screen", "Use the whole screen", "full-screen", ("F11",), "check"),
    "leave": Command("Leave", "Restore the window", "", ("Esc",)),
    "reset-layout": Command("Reset la&yout", "Restore the initial arrangement of panels", "reset"),
    # terrain
    "random-seed": Command("&Another seed", "Another terrain from the same sketch", "dice", ("Ctrl+R",)),
    "measure": Command("&Measure adherence", "Compare terrain and sketch", "adherence", ("Ctrl+M",)),
    **{f"mode-{name}": Command(text, tip, name, (), "mode") for name, (text, tip) in _MODES.items()},
    "look-all": Command("&See the whole terrain", "View all of it from the air", "fit"),
    "look-best": Command("Best &place", "Go to the best viewpoint", "view"),
    "look-selection": Command("See the se&lection", "View the selected feature", "target"),
    "play": Command("Animate water and &clouds", "Animate water, plants and clouds", "play", (), "check"),
    "bookmark": Command("&Bookmark this view", "Store the current viewpoint", "bookmark", ("Ctrl+B",)),
    **{
        f"bookmark-{number}": Command(f"View &{number}", f"Go to bookmark {number}", "", (f"Alt+{number}",))
        for number in range(1, 10)
    },
    "restart": Command("Restart the &engine", "Restart the processes behind the terrain", "restart"),
    # help
    "first-steps": Command("&First steps", "How to paint a terrain, in a minute", "info", ("F1",)),
    "keys": Command("&Keys", "All keys of the program", "keyboard", ("Ctrl+/",)),
    "find": Command("F&ind a command…", "Type what you want to do", "", ("Ctrl+Shift+F",)),
    "about": Command("&About Sketchterrain", "Version, device, licences"),
}
"""All commands by name."""

_GROUPS = ("tool", "layer", "mode", "drape")


class Actions(QObject):
    """Actions of a window by the names in `COMMANDS`."""

    def __init__(self, window: QMainWindow, names: Iterable[str] = COMMANDS) -> None:
        super().__init__(window)
        groups = {kind: QActionGroup(self) for kind in _GROUPS}
        self._actions: dict[str, QAction] = {}
        self._callbacks: dict[str, Callable[[bool], object]] = {}
        for name in names:
            command = COMMANDS[name]
            action = QAction(command.text, self)
            action.setObjectName(name)
            action.setShortcuts([QKeySequence(key) for key in command.keys])
            action.setStatusTip(command.tip)
            action.setToolTip(_tool_tip(command.text, command.tip, action))
            if command.icon:
                action.setIcon(icon(command.icon))
            action.setCheckable(bool(command.kind))
            action.setIconVisibleInMenu(not command.kind)  # its place is the tick's
            if command.kind in groups:
                groups[command.kind].addAction(action)
            action.triggered.connect(self._run)
            self._actions[name] = action
            window.addAction(action)

    def __getitem__(self, name: str) -> QAction:
        return self._actions[name]

    def __contains__(self, name: object) -> bool:
        return name in self._actions

    def __iter__(self) -> Iterator[QAction]:
        return iter(self._actions.values())

    def bind(self, callbacks: Mapping[str, Callable[[], object]]) -> None:
        """Set the callbacks of actions by name."""
        self.bind_checked({name: partial(_call, callback) for name, callback in callbacks.items()})

    def bind_checked(self, callbacks: Mapping[str, Callable[[bool], object]]) -> None:
        """Set the callbacks of actions that can be on and off."""
        self._callbacks |= {self[name].objectName(): callback for name, callback in callbacks.items()}

    def _run(self, on: bool) -> None:
        # One bound method for all is disconnected in order when the window is deleted.
        action = self.sender()
        name = "" if action is None else action.objectName()
        if name in self._callbacks:
            self._callbacks[name](on)


def _call(callback: Callable[[], object], _: bool) -> None:
    callback()


def _tool_tip(text: str, tip: str, action: QAction) -> str:
    keys = action.shortcut().toString(QKeySequence.SequenceFormat.NativeText)
    title = text.replace("&", "").rstrip("…")
    return f"<p><b>{title}</b>{f' &nbsp;{keys}' if keys else ''}<br>{tip}</p>"


class ShortcutOverride(QObject):
    """Event filter that delivers keys to a widget before the window's shortcuts.

    Not an override of the widget's `event`, which would be running while Qt deletes the widget in it.
    """

    def __init__(self, widget: QWidget, accepts: Callable[[QKeyEvent], bool]) -> None:
        super().__init__(widget)
        self._accepts = accepts
        widget.installEventFilter(self)

    def eventFilter(self, watched: QObject | None, event: QEvent | None) -> bool:
        if (
            isinstance(event, QKeyEvent)
            and event.type() == QEvent.Type.ShortcutOverride
            and self._accepts(event)
        ):
            event.accept()
            return True
        return False


class ContextMenu(QMenu):
    """A menu that is deleted when it closes."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)

    def add_command(self, icon_name: str, text: str, callback: Callable[[], object]) -> QAction:
        """Add an action, with an icon of `ui.look.icons` unless its name is empty."""
        action = QAction(icon(icon_name) if icon_name else QIcon(), text, self)
        action.triggered.connect(partial(_call, callback))
        self.addAction(action)
        return action

    def add_submenu(self, icon_name: str, text: str) -> ContextMenu:
        """Add a submenu, deleted with this menu."""
        inner = ContextMenu(self)
        inner.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose, False)
        inner.setIcon(icon(icon_name))
        inner.setTitle(text)
        self.addMenu(inner)
        return inner


def selection_menu(
    parent: QWidget,
    document: Document,
    workspace: Workspace,
    placed: Placement,
    place: tuple[float, float] | None = None,
) -> ContextMenu:
    """Return the menu of the selection, if it exists, and of what can be added at a place (m)."""
    menu, selection = ContextMenu(parent), workspace.selection
    if selection is not None and not selection.is_placed:
        _add_feature_commands(menu, document, workspace)
    elif selection is not None and exists(placed, selection):
        _add_placed_commands(menu, document, workspace, placed, selection)
    if place is not None:
        menu.addSeparator()
        submenu = menu.add_submenu("add", "Add here")
        for kind in FEATURE_TYPES:
            submenu.add_command("", kind.capitalize(), partial(add, document, workspace, kind, *place))
    return menu


def _add_placed_commands(
    menu: ContextMenu, document: Document, workspace: Workspace, placed: Placement, selection: Selection
) -> None:
    name, sketch = name_of(placed, selection), document.sketch
    commands: dict[str, Callable[..., None]] = {"reset": reset, "delete": delete}
    if selection.kind == "feature":
        commands = ({"unlock": unlock} if is_locked(sketch, selection) else {"lock": lock}) | commands
    for verb, command in commands.items():
        callback = partial(command, document, workspace, placed, selection)
        action = menu.add_command(verb, f"{verb.capitalize()} {name}", callback)
        action.setEnabled(verb != "reset" or is_edited(sketch, placed, selection))


def clipboard() -> QClipboard:
    """Return the system's clipboard."""
    return cast(QClipboard, QGuiApplication.clipboard())


def copy_feature(document: Document, workspace: Workspace) -> None:
    """Copy the selected feature to the clipboard."""
    if text := selected_text(document, workspace):
        clipboard().setText(text)


def paste_features(document: Document, workspace: Workspace) -> None:
    """Paste the features of the clipboard; raise InputError if it has none."""
    paste(document, workspace, clipboard().text())


CLIPBOARD_COMMANDS = {"copy": copy_feature, "paste": paste_features}


def _add_feature_commands(menu: ContextMenu, document: Document, workspace: Workspace) -> None:
    def run(command: Callable[[Document, Workspace], None]) -> None:
        with reported(document.message.emit):
            command(document, workspace)

    for name, command in {**FEATURE_COMMANDS, **CLIPBOARD_COMMANDS}.items():
        menu.add_command(COMMANDS[name].icon, COMMANDS[name].text.replace("&", ""), partial(run, command))


class RecentMenu(QMenu):
    """Menu of recently opened files."""

    def __init__(self, recent: RecentFiles, open_file: Callable[[Path], object], parent: QWidget) -> None:
        super().__init__("Open &recent", parent)
        self._recent, self._open_file = recent, open_file
        recent.changed.connect(self._fill)
        self._fill()

    def _fill(self) -> None:
        self.clear()
        for number, path in enumerate(self._recent.paths, start=1):
            mnemonic = f"&{number} " if number < 10 else ""
            action = self.addAction(f"{mnemonic}{_short(path)}")
            if action is not None:
                action.setStatusTip(f"Open {path}")
                action.triggered.connect(partial(self._open, path))
        self.addSeparator()
        clear = self.addAction("&Clear list")
        if clear is not None:
            clear.setStatusTip("Empty this list")
            clear.triggered.connect(self._recent.clear)
        self.setEnabled(bool(self._recent.paths))

    def _open(self, path: Path, _: bool = False) -> None:
        self._open_file(path)


def _short(path: Path) -> str:
    """Return a path with ``~`` for the home folder and ampersands escaped for menus."""
    home = Path.home()
    text = f"~/{path.relative_to(home)}" if path.is_relative_to(home) else str(path)
    return text.replace("&", "&&")


_RULE = "-"
_LOOKS = ("look-all", "look-best", "look-selection")

MENUS: Final[dict[str, tuple[str, ...]]] = {
    "&File": (
        *("new", "trace", "elevation", _RULE, "open", "open-folder", "open-world", ">Open &recent"),
        *("presets", _RULE, "save", "save-as", _RULE, "import", "add-raster", "add-drapes"),
        *("export", "write-world", "save-picture", _RULE, "quit"),
    ),
    "&Edit": (
        *("undo", "redo", _RULE, ">&Tool", "brush-smaller", "brush-larger", _RULE, "copy", "paste"),
        *("delete-selection", "lock-selection", "reset-selection", "select-none", _RULE, "split-line"),
        *("join-lines", "reverse-line", _RULE, "preferences"),
    ),
    "&Layer": (
        *(f"layer-{name}" for name in LAYERS),
        *(_RULE, "new-label", "delete-label", "clear-layer", _RULE, "show-layer", "lock-layer", "only-layer"),
    ),
    "&View": (
        *("fit", "zoom-in", "zoom-out", "actual-size", _RULE, *(f"overlay-{name}" for name in OVERLAYS)),
        *(_RULE, *(f"drape-{name}" for name in DRAPE_METHODS)),
        *(_RULE, "canvas-only", "view-only", "full-screen", _RULE, ">&Panels", "reset-layout"),
    ),
    "&Terrain": (
        *("random-seed", "measure", _RULE, *(f"mode-{name}" for name in _MODES), *_LOOKS, _RULE, "bookmark"),
        *(">Go to &view", _RULE, "play", "restart"),
    ),
    "&Help": ("first-steps", "keys", "find", _RULE, "about"),
}
"""Names of actions; ``-`` is a separator, ``>Title`` a submenu."""

_BAR = ("new", "open", "save", _RULE, "undo", "redo", _RULE, "export", "save-picture")
_BAR_END = ("random-seed", "measure", _RULE, "canvas-only", "view-only", "full-screen")


def add_menus(window: QMainWindow, actions: Actions, submenus: Mapping[str, QMenu]) -> None:
    """Fill a window's menu bar with those actions of `MENUS` that it has."""
    bar = window.menuBar()
    if bar is None:
        return
    for title, names in MENUS.items():
        if not any(name in actions for name in names):
            continue
        menu = QMenu(title, window)
        bar.addMenu(menu)
        for name in names:
            if name == _RULE:
                menu.addSeparator()
            elif name[1:] in submenus:
                menu.addMenu(submenus[name[1:]])
            elif name in actions:
                menu.addAction(actions[name])


def add_tool_bars(window: QMainWindow, actions: Actions, options: Iterable[QWidget]) -> QToolBar:
    """Add the bar of tools and the bar of commands, with `options` in its middle; return the latter."""
    commands, tools = QToolBar("Commands", window), QToolBar("Tools", window)
    _fill(commands, actions, _BAR)
    commands.addSeparator()
    for widget in options:
        commands.addWidget(widget)
    _fill(commands, actions, _BAR_END)
    _fill(tools, actions, (f"tool-{name}" for name in TOOLS))
    for bar, name in ((commands, "commands"), (tools, "tools")):
        bar.setObjectName(f"bar-{name}")
        bar.setIconSize(QSize(20, 20))
        bar.setMovable(False)
    window.addToolBar(Qt.ToolBarArea.TopToolBarArea, commands)
    window.addToolBar(Qt.ToolBarArea.LeftToolBarArea, tools)
    return commands


def _fill(bar: QToolBar, actions: Actions, names: Iterable[str]) -> None:
    for name in names:
        if name == _RULE:
            bar.addSeparator()
        else:
            bar.addAction(actions[name])
