"""Elevation files: a new sketch on them, or more ground for the open one, read in the background."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PyQt6.QtCore import QObject, pyqtSignal

from sketchterrain.document.rasters import RasterSource
from sketchterrain.elevation.raster_reader import SUFFIXES
from sketchterrain.ui.banner import Message
from sketchterrain.ui.files import Files
from sketchterrain.ui.models.elevation import SketchElevation, added_elevation, new_on_elevation

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.elevation.base import BaseElevation

_FILTER = f"Elevation ({' '.join(f'*{each}' for each in SUFFIXES)});;All files (*)"


class ElevationFiles(QObject):
    """Asks for elevation files and reads them; failures become messages."""

    findings_requested = pyqtSignal()  # to show what was found in the data

    def __init__(self, files: Files, elevation: SketchElevation) -> None:
        super().__init__(files)
        self._files, self._elevation, self._banner = files, elevation, files.banner

    def ask_new(self) -> None:
        """Ask for files and start a sketch on them unless the user keeps the current one."""
        if paths := self._files.ask_files("New from elevation", _FILTER):
            self._files.read(paths[0], partial(new_on_elevation, paths), self._start)

    def ask_add(self) -> None:
        """Ask for files and add them to the sketch."""
        if paths := self._files.ask_files("Add elevation", _FILTER):
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
