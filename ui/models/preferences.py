"""What the program remembers of a person between two runs: choices, and recent files."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from PyQt6.QtCore import QByteArray, QObject, QSettings, pyqtSignal

from sketchterrain.errors import SketchterrainError
from sketchterrain.io.files import write_atomic

_THEMES = ("system", "light", "dark")


def config_folder() -> Path:
    """Return the folder for what a person chose, after ``XDG_CONFIG_HOME``."""
    return _folder("XDG_CONFIG_HOME", ".config")


def state_folder() -> Path:
    """Return the folder for what the program keeps from run to run, after ``XDG_STATE_HOME``."""
    return _folder("XDG_STATE_HOME", ".local/state")


def _folder(variable: str, usual: str) -> Path:
    given = os.environ.get(variable, "")
    # The standard says that a relative path there counts for nothing.
    base = Path(given) if given.startswith("/") else Path.home() / usual
    return base / "sketchterrain"


class Preferences(QObject):
    """A person's choices. What cannot be read counts as never chosen."""

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
        """Selector of the device that terrain is worked out on; None: the program chooses."""
        return self._text("device") or None

    @device.setter
    def device(self, device: str | None) -> None:
        if device != self.device:
            self._settings.setValue("device", device or "")
            self.device_changed.emit()

    @property
    def last_folder(self) -> Path:
        """Where a file was opened or saved last; the home folder at first, or where that folder is gone."""
        folder = Path(self._text("last_folder") or Path.home())
        return folder if folder.is_dir() else Path.home()

    @last_folder.setter
    def last_folder(self, folder: Path) -> None:
        self._settings.setValue("last_folder", str(folder))

    @property
    def export_folder(self) -> Path | None:
        """Where a terrain was exported to last."""
        text = self._text("export_folder")
        return Path(text) if text else None

    @export_folder.setter
    def export_folder(self, folder: Path) -> None:
        self._settings.setValue("export_folder", str(folder))

    @property
    def export_target(self) -> str:
        """What a terrain was exported to last; empty: everything, as at first."""
        return self._text("export_target")

    @export_target.setter
    def export_target(self, target: str) -> None:
        self._settings.setValue("export_target", target)

    def exported(self, target: str) -> dict[str, Any]:
        """Return how a terrain was exported to a target the last time; empty: it never was."""
        try:
            kept = json.loads(self._text(f"export/{target or 'everything'}"))
        except ValueError:
            return {}
        return kept if isinstance(kept, dict) else {}

    def set_export_options(self, target: str, values: Mapping[str, object]) -> None:
        """Remember how a terrain was exported to a target."""
        self._settings.setValue(f"export/{target or 'everything'}", json.dumps(dict(values)))

    @property
    def layout(self) -> tuple[QByteArray, QByteArray] | None:
        """The window's geometry and the places of its panels, as Qt keeps them; None: as at first."""
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
        """Write what was chosen now, not when the program ends."""
        self._settings.sync()

    def _text(self, key: str) -> str:
        value = self._settings.value(key, "")
        return value if isinstance(value, str) else ""


_MOST = 12


class RecentFiles(QObject):
    """Paths of sketches, the newest first, kept in a file.

    Other programs of ours may write that file too: it is read before each change. Where it cannot be read or
    written, paths are known until the program ends.
    """

    changed = pyqtSignal()

    def __init__(self, file: Path, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._file = file
        self._paths: tuple[Path, ...] = ()
        self._is_kept = True
        self._read()

    @property
    def paths(self) -> tuple[Path, ...]:
        """The newest first, twelve at most; some may be gone."""
        return self._paths

    def add(self, path: Path) -> None:
        """Put a path first."""
        self._read()
        whole = path.absolute()
        self._keep([whole, *(each for each in self._paths if each != whole)][:_MOST])

    def forget(self, path: Path) -> None:
        """Drop a path, if it is there."""
        self._read()
        whole = path.absolute()
        self._keep([each for each in self._paths if each != whole])

    def clear(self) -> None:
        """Drop all paths."""
        self._keep([])

    def _read(self) -> None:
        if not self._is_kept:
            return
        try:
            found = json.loads(self._file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return
        if isinstance(found, list):
            self._paths = tuple(Path(each) for each in found if isinstance(each, str))[:_MOST]

    def _keep(self, paths: Sequence[Path]) -> None:
        if tuple(paths) == self._paths:
            return
        self._paths = tuple(paths)
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(self._file, json.dumps([str(path) for path in paths], indent=1).encode("utf-8"))
            self._is_kept = True
        except (OSError, SketchterrainError):
            self._is_kept = False  # not worth a message
        self.changed.emit()
