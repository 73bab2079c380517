"""State of the program that is not the document: preferences, bookmarks, current tool, layer and view."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from PyQt6.QtCore import QByteArray, QObject, QSettings, QStandardPaths, pyqtSignal

from sketchterrain.document.sketch import DEFAULT_SIDE
from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.geometry.camera import Camera
from sketchterrain.io.files import write_atomic
from sketchterrain.schema.layers import LAYERS, VECTOR_LAYERS
from sketchterrain.ui.engine.protocol import MODES

if TYPE_CHECKING:
    from sketchterrain.ui.models.document import Document  # which holds it

_THEMES = ("system", "light", "dark")
_MAX_RECENT = 12


def config_folder() -> Path:
    """Return the folder for preferences (``XDG_CONFIG_HOME``)."""
    return _folder(QStandardPaths.StandardLocation.GenericConfigLocation)


def state_folder() -> Path:
    """Return the folder for state (``XDG_STATE_HOME``)."""
    return _folder(QStandardPaths.StandardLocation.GenericStateLocation)


def _folder(place: QStandardPaths.StandardLocation) -> Path:
    return Path(QStandardPaths.writableLocation(place)) / "sketchterrain"


class Preferences(QObject):
    """The user's preferences; unreadable values count as unset."""

    theme_changed = pyqtSignal(str)
    device_changed = pyqtSignal()

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._settings = QSettings(str(path), QSettings.Format.IniFormat)

    @property
    def theme(self) -> str:
        """``system``, ``light`` or ``dark``."""
        theme = self._text("theme")
        return theme if theme in _THEMES else "system"

    @theme.setter
    def theme(self, theme: str) -> None:
        if theme not in _THEMES:
            raise ValueError(f"expected a theme, one of {', '.join(_THEMES)}, got {theme!r}")
        if theme != self.theme:
            self._settings.setValue("theme", theme)
            self.theme_changed.emit(theme)

    @property
    def device(self) -> str | None:
        """Selector of the OpenCL device; None: automatic."""
        return self._text("device") or None

    @device.setter
    def device(self, device: str | None) -> None:
        if device != self.device:
            self._settings.setValue("device", device or "")
            self.device_changed.emit()

    @property
    def last_folder(self) -> Path:
        """Folder of the last opened or saved file; the home folder if unset or missing."""
        folder = Path(self._text("last_folder") or Path.home())
        return folder if folder.is_dir() else Path.home()

    @last_folder.setter
    def last_folder(self, folder: Path) -> None:
        self._settings.setValue("last_folder", str(folder))

    @property
    def export_folder(self) -> Path | None:
        text = self._text("export_folder")
        return Path(text) if text else None

    @export_folder.setter
    def export_folder(self, folder: Path) -> None:
        self._settings.setValue("export_folder", str(folder))

    @property
    def export_target(self) -> str:
        """Last export target; empty: all files."""
        return self._text("export_target")

    @export_target.setter
    def export_target(self, target: str) -> None:
        self._settings.setValue("export_target", target)

    def export_options(self, target: str) -> dict[str, Any]:
        """Return the options of the last export to a target; empty if none."""
        try:
            values = json.loads(self._text(f"export/{target or 'everything'}"))
        except ValueError:
            return {}
        return values if isinstance(values, dict) else {}

    def set_export_options(self, target: str, values: Mapping[str, object]) -> None:
        """Store the options of an export to a target."""
        self._settings.setValue(f"export/{target or 'everything'}", json.dumps(dict(values)))

    @property
    def layout(self) -> tuple[QByteArray, QByteArray] | None:
        """Window geometry and dock state in Qt's format; None: default."""
        geometry, state = (self._settings.value(f"window/{key}") for key in ("geometry", "state"))
        if isinstance(geometry, QByteArray) and isinstance(state, QByteArray):
            return geometry, state
        return None

    @layout.setter
    def layout(self, layout: tuple[QByteArray, QByteArray] | None) -> None:
        if layout is None:
            self._settings.remove("window")
            return
        self._settings.setValue("window/geometry", layout[0])
        self._settings.setValue("window/state", layout[1])

    def save(self) -> None:
        self._settings.sync()

    def _text(self, key: str) -> str:
        value = self._settings.value(key, "")
        return value if isinstance(value, str) else ""


class RecentFiles(QObject):
    """Paths of recent sketches, newest first, stored in a file.

    Other instances may write that file: it is read before each change. If it is not accessible, paths last
    until the program ends.
    """

    changed = pyqtSignal()

    def __init__(self, file: Path) -> None:
        super().__init__()
        self._file = file
        self.paths: tuple[Path, ...] = ()  # up to twelve, newest first; some may no longer exist
        self._is_stored = True
        self._read()

    def add(self, path: Path) -> None:
        """Move a path to the front."""
        self._read()
        whole = path.absolute()
        self._store([whole, *(each for each in self.paths if each != whole)][:_MAX_RECENT])

    def forget(self, path: Path) -> None:
        self._read()
        whole = path.absolute()
        self._store([each for each in self.paths if each != whole])

    def clear(self) -> None:
        self._store([])

    def _read(self) -> None:
        if not self._is_stored:
            return
        try:
            found = json.loads(self._file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return
        if isinstance(found, list):
            self.paths = tuple(Path(each) for each in found if isinstance(each, str))[:_MAX_RECENT]

    def _store(self, paths: Sequence[Path]) -> None:
        if tuple(paths) == self.paths:
            return
        self.paths = tuple(paths)
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(self._file, json.dumps([str(path) for path in paths], indent=1).encode("utf-8"))
            self._is_stored = True
        except (OSError, SketchterrainError):
            self._is_stored = False  # not worth a message
        self.changed.emit()


_MAX_NAME = 80  # characters


@dataclass(frozen=True)
class Bookmark:
    """A named camera pose, its mode (one of `MODES`) and a thumbnail (JPEG, may be empty)."""

    name: str
    pose: Camera
    mode: str = "orbit"
    picture: bytes = b""


class Bookmarks(QObject):
    """The bookmarks of the open sketch, stored by its path; an unreadable file counts as empty.

    They are not part of the sketch, which describes the terrain. An unsaved sketch's are stored on saving.
    """

    changed = pyqtSignal()
    failed = pyqtSignal(str)  # error of writing

    def __init__(self, document: Document, folder: Path) -> None:
        super().__init__()
        self._document, self._folder = document, folder
        self._path = document.path
        self.all = self._read()
        document.opened.connect(self._on_opened)
        document.saved_changed.connect(self._on_saved)

    def free_name(self) -> str:
        """Return an unused name: ``View 3``."""
        names = {each.name for each in self.all}
        return next(name for number in range(1, len(names) + 2) if (name := f"View {number}") not in names)

    def add(self, bookmark: Bookmark) -> None:
        self._set((*self.all, bookmark))

    def rename(self, index: int, name: str) -> None:
        """Rename a bookmark; an empty name changes nothing."""
        name = " ".join(name.split())[:_MAX_NAME]
        if name and name != self.all[index].name:
            self._replace(index, replace(self.all[index], name=name))

    def renew(self, index: int, bookmark: Bookmark) -> None:
        """Replace a bookmark's pose and thumbnail."""
        self._replace(index, replace(bookmark, name=self.all[index].name))

    def delete(self, index: int) -> None:
        self._set(self.all[:index] + self.all[index + 1 :])

    def _replace(self, index: int, bookmark: Bookmark) -> None:
        self._set((*self.all[:index], bookmark, *self.all[index + 1 :]))

    def _set(self, bookmarks: tuple[Bookmark, ...]) -> None:
        self.all = bookmarks
        self._write()
        self.changed.emit()

    def _on_opened(self) -> None:
        self._path = self._document.path
        self.all = self._read()
        self.changed.emit()

    def _on_saved(self) -> None:
        """Store the bookmarks under the path that the sketch was saved at."""
        if self._document.path != self._path:
            self._path = self._document.path
            self._write()

    def _file(self) -> Path | None:
        if self._path is None:
            return None
        name = hashlib.blake2b(str(self._path.absolute()).encode(), digest_size=12).hexdigest()
        return self._folder / f"{name}.json"

    def _read(self) -> tuple[Bookmark, ...]:
        file = self._file()
        try:
            table = json.loads(file.read_bytes()) if file is not None else {}
            return tuple(_bookmark(each) for each in table.get("bookmarks", []))
        except (OSError, ValueError, KeyError, TypeError, AttributeError, InputError):
            return ()

    def _write(self) -> None:
        file = self._file()
        if file is None or not (self.all or file.exists()):
            return
        table = {"sketch": str(self._path), "bookmarks": [_table(each) for each in self.all]}
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(file, json.dumps(table, indent=1).encode())
        except (OSError, SketchterrainError) as error:
            self.failed.emit(f"bookmarks cannot be saved: {error}")


def _table(bookmark: Bookmark) -> dict[str, Any]:
    pose = bookmark.pose
    return {
        "name": bookmark.name,
        "eye": pose.eye,
        "target": pose.target,
        "fov": pose.fov,
        "mode": bookmark.mode,
        "picture": base64.b64encode(bookmark.picture).decode(),
    }


def _bookmark(table: dict[str, Any]) -> Bookmark:
    """Return the bookmark of a table; raise ValueError if it is invalid."""
    numbers = [float(each) for each in (*table["eye"], *table["target"], table["fov"])]
    x, y, z, to_x, to_y, to_z, fov = numbers
    if table["mode"] not in MODES:
        raise ValueError(f"expected one of {', '.join(MODES)}, got {table['mode']!r}")
    picture = base64.b64decode(table["picture"], validate=True)
    return Bookmark(str(table["name"]), Camera((x, y, z), (to_x, to_y, to_z), fov), table["mode"], picture)


TOOLS: Final = ("select", "brush", "eraser", "line", "fill", "pick", "pan")
PAINT_TOOLS: Final = ("brush", "eraser", "fill")
"""Tools for layers with an image."""
OVERLAYS: Final = (
    *("relief", "elevation", "pictures", "features", "contradictions", "adherence", "realism", "eye"),
)
"""Overlays of the canvas."""
BRUSHES: Final = (0.5, 512.0)  # range of the brush radius, px of the sketch


@dataclass(frozen=True)
class LayerLook:
    """Visibility, lock and opacity (0 … 1) of a layer."""

    visible: bool = True
    locked: bool = False
    opacity: float = 0.75


@dataclass(frozen=True)
class Selection:
    """A selected feature, river or lake, by its id in `features.json`, or a vector, by its own.

    Of draped layers it is a feature by its id, or the layer, -1.
    """

    kind: str  # feature; the kind of the layer of a river (course) or lake (water); a vector's layer; drape
    id: int
    index: int | None = None  # of a river's control point or of a vector's vertex
    layer: int = -1  # number of a draped layer

    @property
    def is_vector(self) -> bool:
        return self.kind in VECTOR_LAYERS

    @property
    def is_draped(self) -> bool:
        return self.kind == "drape"

    @property
    def draped(self) -> tuple[int, int] | None:
        """Layer and id of a draped feature."""
        return (self.layer, self.id) if self.is_draped else None

    @property
    def is_placed(self) -> bool:
        return not (self.is_vector or self.is_draped)


@dataclass(frozen=True)
class Handle:
    """A drag handle of a selection, which for a river's control point has its index."""

    role: str  # move, radius, point (of a river or vector), width; corner, rotate (of a draped feature's box)
    selection: Selection
    x: float  # position, m
    y: float
    base_x: float  # origin of a radius or width, m: the feature's centre or the centreline
    base_y: float

    @property
    def is_vertex(self) -> bool:
        """Whether it is a vertex of a feature."""
        return self.role == "point" and not self.selection.is_placed

    @property
    def is_live(self) -> bool:
        """Whether the document follows a drag at once: not for vertices of rivers and lakes."""
        of_layer = self.selection.is_vector and LAYERS[self.selection.kind].is_painted
        return not of_layer or self.role == "width"


class Workspace(QObject):
    """Editing state with change signals; setting an equal value emits nothing."""

    tool_changed = pyqtSignal(str)
    label_changed = pyqtSignal(str, int)  # layer, label
    brush_changed = pyqtSignal(float)
    look_changed = pyqtSignal(str)  # layer
    selection_changed = pyqtSignal(object)  # Selection or None
    overlays_changed = pyqtSignal()

    def __init__(self) -> None:
        super().__init__()
        self._tool = "brush"
        self._paint_tool = ""  # that the line tool replaces while the active layer has no image
        self.layer, self.label = next(iter(LAYERS)), 1  # the active ones, changed by `use_label` only
        self._brushes: dict[str, float] = {}  # radii that were chosen, by layer
        self._longer_side = DEFAULT_SIDE
        self._looks = {name: LayerLook() for name in LAYERS}
        self._hidden: tuple[str, ...] = ()  # layers that `show_only` hid
        self._selection: Selection | None = None
        self.drape_kind = "line"  # point, line or area, which the line tool draws in a chosen draped layer
        # Visible, changed by `show_overlay` only.
        self.overlays = frozenset({"relief", "pictures", "features", "eye"})

    @property
    def tool(self) -> str:
        """One of `TOOLS`."""
        return self._tool

    @tool.setter
    def tool(self, tool: str) -> None:
        if tool not in TOOLS:
            raise ValueError(f"expected a tool, one of {', '.join(TOOLS)}, got {tool!r}")
        self._paint_tool = ""
        if tool != self._tool:
            self._tool = tool
            self.tool_changed.emit(tool)

    def use_label(self, layer: str, label: int) -> None:
        if self._selection is not None and self._selection.is_draped:  # or lines would be drawn in it
            self.selection = None
        if (layer, label) != (self.layer, self.label):
            self.layer, self.label = LAYERS[layer].name, label
            self._suit_tool()
            self.label_changed.emit(layer, label)
            self.brush_changed.emit(self.brush)

    def _suit_tool(self) -> None:
        """Take the line tool in place of a paint tool for a layer of vectors alone, and back for another."""
        if LAYERS[self.layer].is_painted and self._paint_tool and self._tool == "line":
            self.tool = self._paint_tool
        elif not LAYERS[self.layer].is_painted and self._tool in PAINT_TOOLS:
            paint_tool, self.tool = self._tool, "line"
            self._paint_tool = paint_tool

    @property
    def brush(self) -> float:
        """Radius of the active layer's brush, px of the sketch."""
        opening = LAYERS[self.layer].brush * self._longer_side
        return self._brushes.get(self.layer, min(max(opening, BRUSHES[0]), BRUSHES[1]))

    @brush.setter
    def brush(self, radius: float) -> None:
        radius = min(max(radius, BRUSHES[0]), BRUSHES[1])
        if radius != self.brush:
            self._brushes[self.layer] = radius
            self.brush_changed.emit(radius)

    def open_brushes(self, longer_side: int) -> None:
        """Open all brushes for a sketch with that many pixels along its longer side."""
        self._brushes.clear()
        self._longer_side = longer_side
        self.brush_changed.emit(self.brush)

    def look(self, layer: str) -> LayerLook:
        return self._looks.get(layer, LayerLook())

    def set_look(self, layer: str, **changes: object) -> None:
        """Change fields of a layer's `LayerLook`."""
        look = replace(self.look(layer), **changes)  # type: ignore[arg-type] # names are LayerLook's
        if look != self.look(layer):
            self._looks[layer] = look
            self.look_changed.emit(layer)

    def toggle_look(self, layer: str, field: str) -> None:
        """Toggle whether a layer is ``visible`` or ``locked``."""
        self.set_look(layer, **{field: not getattr(self.look(layer), field)})

    def is_alone(self, layer: str) -> bool:
        """Return whether a layer is visible and no other is."""
        return all(self.look(name).visible == (name == layer) for name in LAYERS)

    def show_only(self, layer: str) -> None:
        """Show one layer and hide the others; if they are hidden, show those that this hid, else all."""
        is_alone, others = self.is_alone(layer), [name for name in LAYERS if name != layer]
        if not is_alone:
            self._hidden = tuple(name for name in others if self.look(name).visible)
        for name in self._hidden or others if is_alone else others:
            self.set_look(name, visible=is_alone)
        self.set_look(layer, visible=True)

    def refusal(self, layer: str) -> str:
        """Return why a layer cannot be edited; empty if it can."""
        look, title = self._looks[layer], LAYERS[layer].title
        if look.locked:
            return f"{title} are locked. Unlock the layer to paint on it."
        return "" if look.visible else f"{title} are hidden. Show the layer to paint on it."

    @property
    def selection(self) -> Selection | None:
        return self._selection

    @selection.setter
    def selection(self, selection: Selection | None) -> None:
        if selection != self._selection:
            self._selection = selection
            self.selection_changed.emit(selection)

    def show_overlay(self, name: str, visible: bool) -> None:
        if name not in OVERLAYS:
            raise ValueError(f"expected an overlay, one of {', '.join(OVERLAYS)}, got {name!r}")
        overlays = self.overlays | {name} if visible else self.overlays - {name}
        if overlays != self.overlays:
            self.overlays = overlays
            self.overlays_changed.emit()
