"""Everything that can be done by menu, button or key: declared once, and made into Qt's actions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from PyQt6.QtCore import QEvent, QObject
from PyQt6.QtGui import QAction, QActionGroup, QKeyEvent, QKeySequence
from PyQt6.QtWidgets import QMainWindow, QWidget

from sketchterrain.sketch import LAYERS
from sketchterrain.ui.look.icons import icon
from sketchterrain.ui.models.workspace import OVERLAYS


@dataclass(frozen=True)
class Command:
    """One thing that can be done.

    Attributes
    ----------
    text
        In a menu; ``&`` stands before the letter that chooses it.
    tip
        One line of help.
    icon
        Of `ICONS`; empty: none.
    keys
        Its shortcuts, the first is shown.
    kind : {'', 'check', 'tool', 'layer', 'mode'}
        Whether it can be on and off, and of which group only one is on.
    """

    text: str
    tip: str
    icon: str = ""
    keys: tuple[str, ...] = ()
    kind: str = ""


TOOL_KEYS: Final = {
    "select": "V",
    "brush": "B",
    "eraser": "E",
    "line": "L",
    "fill": "F",
    "pick": "I",
    "pan": "H",
}
_TOOLS = {
    "select": ("&Select", "Choose and move what was generated"),
    "brush": ("&Brush", "Paint with the chosen label; [ and ] change the size"),
    "eraser": ("&Eraser", "Take paint away from the chosen layer"),
    "line": ("&Line", "Draw a smooth line, such as a river: click its points, or draw it"),
    "fill": ("&Fill", "Fill an area with the chosen label"),
    "pick": ("P&ick", "Take the label from the sketch"),
    "pan": ("&Hand", "Move the sheet; Space does so with any tool"),
}
_MODES = {
    "orbit": ("&Orbit", "Turn around the terrain with the mouse"),
    "fly": ("&Fly", "Fly freely with W A S D and the mouse"),
    "walk": ("&Walk", "Walk on the ground with W A S D and the mouse"),
}
_SHOWN = {
    "relief": ("&Relief beneath the paint", "eye"),
    "features": ("Placed feat&ures and rivers", "target"),
    "contradictions": ("Co&ntradictions", "warning"),
    "adherence": ("&Adherence", "adherence"),
    "eye": ("Where the 3-D view &looks from", "camera"),
}

COMMANDS: Final[dict[str, Command]] = {
    # file
    "new": Command("&New…", "Begin a sketch of another size or extent", "new", ("Ctrl+N",)),
    "open": Command("&Open…", "Open a .sketch file", "open", ("Ctrl+O",)),
    "open-folder": Command("Open &folder…", "Open a sketch that is kept as a folder of images", "open"),
    "open-world": Command("Open &world…", "Walk and fly in a world that was written", "view"),
    "trace": Command(
        "New from pi&cture…", "Begin with a coloured map, a paint program's layers or a GIS's vectors", "pick"
    ),
    "presets": Command("&Presets…", "Begin with one of the program's own sketches", "gallery", ("Ctrl+P",)),
    "save": Command("&Save", "Save the sketch", "save", ("Ctrl+S",)),
    "save-as": Command("Save &as…", "Save the sketch under another name", "", ("Ctrl+Shift+S",)),
    "import": Command(
        "&Import layer image…", "Take a layer's paint from a PNG of the sketch's size", "layers"
    ),
    "export": Command(
        "&Export terrain…", "Write heights, materials, plants and maps as files", "export", ("Ctrl+E",)
    ),
    "write-world": Command(
        "Write wor&ld…", "Write a world of any size, with coarser levels over it", "world"
    ),
    "save-picture": Command(
        "Save pic&ture…", "Save what the 3-D view shows", "screenshot", ("Ctrl+Shift+P",)
    ),
    "quit": Command("&Quit", "End the program", "", ("Ctrl+Q",)),
    # edit
    "undo": Command("&Undo", "Undo the last step", "undo", ("Ctrl+Z",)),
    "redo": Command("&Redo", "Do the undone step again", "redo", ("Ctrl+Shift+Z", "Ctrl+Y")),
    "delete-chosen": Command("&Delete", "Delete the selected feature from the terrain", "delete"),
    "lock-chosen": Command(
        "&Lock", "Keep the selected feature where it is, whatever is painted", "lock", ("Ctrl+L",), "check"
    ),
    "reset-chosen": Command(
        "Undo its &edits", "Make the selected feature again as it was generated", "reset"
    ),
    "choose-none": Command("Select &nothing", "Let go of the selected feature", "", ("Ctrl+Shift+A",)),
    "preferences": Command("&Preferences…", "Theme and device", "settings", ("Ctrl+,",)),
    "brush-smaller": Command("Brush s&maller", "Make the brush smaller", "", ("[",)),
    "brush-larger": Command("Brush lar&ger", "Make the brush larger", "", ("]",)),
    **{
        f"tool-{name}": Command(text, tip, name, (TOOL_KEYS[name],), "tool")
        for name, (text, tip) in _TOOLS.items()
    },
    # layer
    **{
        f"layer-{name}": Command(
            f"&{number} {layer.title}", f"Paint {layer.help}", "", (str(number),), "layer"
        )
        for number, (name, layer) in enumerate(LAYERS.items(), start=1)
    },
    "new-label": Command(
        "&New label", "Another kind on this layer, with properties of its own", "add", ("Ctrl+Shift+N",)
    ),
    "delete-label": Command("&Delete label", "Delete the label with all that is painted with it", "delete"),
    "clear-layer": Command("&Clear layer", "Take all paint from this layer"),
    "show-layer": Command("&Visible", "Show this layer's paint", "eye", (), "check"),
    "lock-layer": Command("&Locked", "Keep this layer from being painted on", "lock", (), "check"),
    "only-layer": Command("Show &only this layer", "Hide the paint of all others", "", (), "check"),
    # view
    "fit": Command("&Fit sheet", "Show the whole sketch", "fit", ("Ctrl+0",)),
    "zoom-in": Command("Zoom &in", "Show the sketch larger", "zoom-in", ("Ctrl++", "Ctrl+=")),
    "zoom-out": Command("Zoom ou&t", "Show the sketch smaller", "zoom-out", ("Ctrl+-",)),
    "actual-size": Command(
        "&One to one", "A pixel of the sketch on a pixel of the screen", "actual-size", ("Ctrl+1",)
    ),
    **{
        f"overlay-{name}": Command(text, f"Show {OVERLAYS[name]}", icon, (), "check")
        for name, (text, icon) in _SHOWN.items()
    },
    "canvas-only": Command("&Canvas only", "Give the whole window to the sketch", "canvas", ("F9",), "check"),
    "view-only": Command(
        "&3-D view only", "Give the whole window to the 3-D view", "view", ("F10",), "check"
    ),
    "full-screen": Command("Full &screen", "Use the whole screen", "full-screen", ("F11",), "check"),
    "leave": Command("Leave", "Show the whole window again", "", ("Esc",)),
    "reset-layout": Command("Reset la&yout", "Put all panels back to their places", "reset"),
    # terrain
    "random-seed": Command("&Another seed", "Another terrain from the same sketch", "dice", ("Ctrl+R",)),
    "measure": Command(
        "&Measure adherence", "See how far the terrain does what the sketch says", "adherence", ("Ctrl+M",)
    ),
    **{f"mode-{name}": Command(text, tip, name, (), "mode") for name, (text, tip) in _MODES.items()},
    "look-all": Command("&See the whole terrain", "Look at all of it from the air", "fit"),
    "look-best": Command("Best &place", "Stand where the terrain looks best", "view"),
    "look-chosen": Command("See the se&lection", "Look at the selected feature", "target"),
    "play": Command("Water and &clouds move", "Let water, plants and clouds move", "play", (), "check"),
    "bookmark": Command("&Bookmark this view", "Remember where the eye is", "bookmark", ("Ctrl+B",)),
    **{
        f"bookmark-{number}": Command(
            f"View &{number}", f"Be where bookmark {number} was made", "", (f"Alt+{number}",)
        )
        for number in range(1, 10)
    },
    "restart": Command(
        "Start the &engine again", "End what works out the terrain and start it anew", "restart"
    ),
    # help
    "first-steps": Command("&First steps", "How to paint a terrain, in a minute", "info", ("F1",)),
    "keys": Command("&Keys", "All keys of the program", "keyboard", ("Ctrl+/",)),
    "find": Command("F&ind a command…", "Type what you want to do", "", ("Ctrl+Shift+F",)),
    "about": Command("&About Sketchterrain", "Version, device, licences"),
}
"""Everything, by name."""


_GROUPS = ("tool", "layer", "mode")


class Actions(QObject):
    """All actions of a window, by the names in `COMMANDS`."""

    def __init__(self, window: QMainWindow, names: Iterable[str] = COMMANDS) -> None:
        super().__init__(window)
        groups = {kind: QActionGroup(self) for kind in _GROUPS}
        self._actions: dict[str, QAction] = {}
        self._plain: dict[str, Callable[[], object]] = {}
        self._checked: dict[str, Callable[[bool], object]] = {}
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
            action.setIconVisibleInMenu(not command.kind)  # there the tick says more
            if command.kind in groups:
                groups[command.kind].addAction(action)
            action.triggered.connect(self._do)
            self._actions[name] = action
            window.addAction(action)

    def __getitem__(self, name: str) -> QAction:
        return self._actions[name]

    def __contains__(self, name: object) -> bool:
        return name in self._actions

    def __iter__(self) -> Iterator[QAction]:
        return iter(self._actions.values())

    def bind(self, what: Mapping[str, Callable[[], object]]) -> None:
        """Say what actions do when they are triggered."""
        for name, do in what.items():
            self._actions[name]  # a name that is none is told now, not when it is chosen
            self._plain[name] = do

    def bind_checked(self, what: Mapping[str, Callable[[bool], object]]) -> None:
        """Say what actions do when a person switches them on or off."""
        for name, do in what.items():
            self._actions[name]
            self._checked[name] = do

    def _do(self, on: bool) -> None:
        # One bound method for all: it is let go in order when the window is deleted.
        action = self.sender()
        name = "" if action is None else action.objectName()
        if name in self._plain:
            self._plain[name]()
        elif name in self._checked:
            self._checked[name](on)


def _tool_tip(text: str, tip: str, action: QAction) -> str:
    keys = action.shortcut().toString(QKeySequence.SequenceFormat.NativeText)
    title = text.replace("&", "").rstrip("…")
    return f"<p><b>{title}</b>{f' &nbsp;{keys}' if keys else ''}<br>{tip}</p>"


class OwnKeys(QObject):
    """Accepts a widget's keys before the window looks for shortcuts.

    A filter, and no `event` of the widget's own: that would be running while Qt deletes the widget in it.
    """

    def __init__(self, widget: QWidget, wants: Callable[[QKeyEvent], bool]) -> None:
        super().__init__(widget)
        self._wants = wants
        widget.installEventFilter(self)

    def eventFilter(self, watched: QObject | None, event: QEvent | None) -> bool:
        """Take what is the widget's."""
        if (
            isinstance(event, QKeyEvent)
            and event.type() == QEvent.Type.ShortcutOverride
            and self._wants(event)
        ):
            event.accept()
            return True
        return False
