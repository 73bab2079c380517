"""Outputs of a batch: resource needs, manifest, contact sheets, progress."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple

import msgspec
import numpy as np
from PIL import Image, ImageDraw, ImageFont
from rich.progress import TaskID

from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError, one_line
from sketchterrain.export.planning import checked_plan
from sketchterrain.export.planning import memory_needed as export_memory
from sketchterrain.export.rasters import write_picture
from sketchterrain.export.target import ExportOptions
from sketchterrain.io.console import progress_bars
from sketchterrain.io.files import hash_file, write_atomic
from sketchterrain.jobs.estimates import check_size, memory_needed, plant_bytes

MANIFEST = "manifest.json"
# Names of a manifest must not lead outside the batch's folder.
_PART = r"(?!\.{1,2}(?:/|\Z))[^/\\\x00]+"
_FileName = Annotated[str, msgspec.Meta(pattern=rf"\A{_PART}\Z")]
_ItemName = Annotated[str, msgspec.Meta(pattern=rf"\A{_PART}(?:/{_PART})*\Z")]


class File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A file of an item: name in the item's folder, length and SHA-256."""

    file: _FileName
    bytes: int
    sha256: str


class Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Manifest entry of an item: `input` is its fingerprint, `notes` are the devices that failed.

    A partial item lacks its preview; `error` is the reason, or that of a failed item.
    """

    name: _ItemName
    sketch: str
    seed: int
    settings: dict[str, int | float | str] = {}
    state: Literal["waiting", "done", "partial", "failed"] = "waiting"
    input: str = ""
    files: tuple[File, ...] = ()
    seconds: float = 0.0
    timings: dict[str, float] = {}
    adherence: dict[str, Any] | None = None
    notes: tuple[str, ...] = ()
    error: str = ""
    realism: dict[str, Any] | None = None
    base: dict[str, Any] | None = None

    def is_intact(self, folder: Path) -> bool:
        """Return whether all files exist in a folder with their hashes."""
        try:
            return all(File(each.file, *hash_file(folder / each.file)) == each for each in self.files)
        except OSError:
            return False


class Manifest(msgspec.Struct, forbid_unknown_fields=True):
    """Manifest of a batch: output options, entries of the items, contact sheets."""

    format: Literal[1]
    version: str
    output: Any
    items: list[Entry]
    sheets: list[_FileName]

    @property
    def entries(self) -> dict[str, Entry]:
        """The entries by name."""
        return {entry.name: entry for entry in self.items}

    def write(self, folder: Path) -> None:
        """Write the manifest atomically; raise SketchterrainError if it cannot be written."""
        write_atomic(folder / MANIFEST, msgspec.json.format(msgspec.json.encode(self), indent=1))


def read_manifest(folder: Path) -> Manifest | None:
    """Return the manifest in a folder, None if it is missing; raise InputError if it is invalid."""
    path = folder / MANIFEST
    try:
        manifest = msgspec.json.decode(path.read_bytes(), type=Manifest)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise InputError(f"{one_line(path)}: cannot be read ({error.strerror})") from None
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(
            f"{one_line(path)}: expected a batch's manifest ({one_line(error)}); choose another folder"
        ) from None
    if len(manifest.entries) < len(manifest.items):
        raise InputError(f"{one_line(path)}: expected a batch's manifest with unique items")
    return manifest


DEFAULT_SIZE: Final = 1025
PREVIEW_MEMORY: Final = 1600 << 20  # bytes for all previews, measured with OpenGL on a CPU
_PREVIEW_DISK: Final = 3 << 20
_VERTEX_DISK: Final = 9  # bytes: heights twice, normals, materials; presets take 7


@dataclass(frozen=True)
class Output:
    """Files of each terrain: those of ``generate``, or of an export target; `size` None means its default."""

    size: int | None = None
    preview: bool = True
    view: str = "auto"
    foliage: str = "csv"
    grass: bool = False
    map: str | None = None
    target: str | None = None
    options: ExportOptions | None = None
    fast: bool = False


class Needs(NamedTuple):
    """Needs of a terrain: vertices, bytes of memory without preview, bytes of disk."""

    vertices: int
    memory: float
    disk: float


def estimate_needs(sketch: Sketch, output: Output) -> Needs:
    """Return the needs of a terrain; raise SketchterrainError for invalid options."""
    east, north = sketch.size
    if output.target is None:
        size = output.size or DEFAULT_SIZE
        check_size(sketch, size)
        vertices = size * (round((size - 1) * min(east, north) / max(east, north)) + 1)
        memory, disk = memory_needed(sketch, size), float(_VERTEX_DISK * vertices)
        disk += plant_bytes(east * north, output.foliage, grass=output.grass)
    else:
        options = output.options or ExportOptions()
        export_plan = checked_plan(sketch, output.target, options)
        vertices, memory = export_plan.vertices, export_memory(export_plan)
        disk = export_plan.target.disk * vertices + plant_bytes(east * north, "csv", grass=options.grass)
    return Needs(vertices, memory, disk + output.preview * _PREVIEW_DISK)


COLUMNS: Final = 4
PAGE: Final = 40  # pictures on a page
_PICTURE: Final = (400, 225)
_GAP, _LINE, _FONT = 12, 22, 15  # px
_PAPER, _INK, _QUIET, _RED = (250, 250, 248), (40, 40, 40), (225, 225, 222), (170, 30, 30)


def write_sheets(folder: Path, entries: Sequence[Entry]) -> list[str]:
    """Write contact sheets ``sheet.png``, ``sheet-2.png`` … of previews and errors; return their names."""
    if not any(_has_preview(each) for each in entries):
        return []
    names = []
    for page, first in enumerate(range(0, len(entries), PAGE), start=1):
        names.append("sheet.png" if page == 1 else f"sheet-{page}.png")
        write_picture(folder / names[-1], np.asarray(_page(folder, entries[first : first + PAGE])))
    return names


def _page(folder: Path, entries: Sequence[Entry]) -> Image.Image:
    columns = min(COLUMNS, len(entries))
    rows = -(-len(entries) // columns)
    width, height = _PICTURE[0] + _GAP, _PICTURE[1] + _LINE + _GAP
    sheet = Image.new("RGB", (columns * width + _GAP, rows * height + _GAP), _PAPER)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(_FONT)
    for index, entry in enumerate(entries):
        left, top = _GAP + index % columns * width, _GAP + index // columns * height
        picture = _thumbnail(folder / entry.name / "preview.png") if _has_preview(entry) else None
        if picture is None:
            draw.rectangle((left, top, left + _PICTURE[0] - 1, top + _PICTURE[1] - 1), fill=_QUIET)
            problem = _truncated(draw, entry.error or "no preview", font)
            draw.text((left + _GAP, top + _GAP), problem, fill=_RED, font=font)
        else:
            sheet.paste(picture, (left, top))
        draw.text((left, top + _PICTURE[1] + 2), _truncated(draw, entry.name, font), fill=_INK, font=font)
    return sheet


def _has_preview(entry: Entry) -> bool:
    return entry.state != "failed" and any(each.file == "preview.png" for each in entry.files)


def _thumbnail(path: Path) -> Image.Image | None:
    try:
        with Image.open(path, formats=("PNG",)) as picture:
            return picture.convert("RGB").resize(_PICTURE, Image.Resampling.BOX)
    except OSError:
        return None


def _truncated(
    draw: ImageDraw.ImageDraw, text: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont
) -> str:
    """Return the end of a text that fits under a picture."""
    width = _PICTURE[0] - 2 * _GAP
    cuts = (text, *(f"…{text[cut:]}" for cut in range(1, len(text))), "…")
    return next(each for each in cuts if draw.textlength(each, font=font) <= width)


class BatchProgress:
    """Progress of a batch on stderr; thread-safe, a context manager."""

    def __init__(self) -> None:
        self._bars = progress_bars()
        self._tasks: dict[str, TaskID] = {}
        self._items = self._done = self._failed = 0

    def __enter__(self) -> BatchProgress:
        self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bars.stop()

    def verified(self, number: int, items: int) -> None:
        """Show the number of verified items."""
        self._show("", "Verifying existing terrains", number, items)

    def started(self, items: int, skipped: int) -> None:
        """Report the numbers of terrains to compute and of unchanged ones."""
        self._items = items
        self._remove("")
        if skipped:
            self._bars.console.print(f"{skipped} of {skipped + items} terrains are unchanged")
        self._show("", f"0 of {items} terrains", 0, items)

    def stage(self, name: str, title: str) -> None:
        """Show the stage of an item."""
        self._show(name, f"{name}: {title}")

    def share(self, name: str, share: float) -> None:
        """Show the share done of an item's stage, 0 … 1."""
        self._bars.update(self._tasks[name], completed=share)

    def finished(self, entry: Entry) -> None:
        """Report the result of an item."""
        self._done += 1
        self._failed += entry.state == "failed"
        self._remove(entry.name)
        result = f"failed: {entry.error}" if entry.state == "failed" else f"{entry.seconds:.1f} s"
        missing = f", no preview: {entry.error}" if entry.state == "partial" else ""
        if self._bars.disable or entry.state != "done":
            self._bars.console.print(f"[{self._done}/{self._items}] {entry.name}: {result}{missing}")
        failed = f", {self._failed} failed" if self._failed else ""
        self._show("", f"{self._done} of {self._items} terrains{failed}", self._done, self._items)

    def interrupted(self) -> None:
        """Report that the batch is interrupted."""
        self._bars.console.print("stopping: unfinished terrains are discarded, finished ones remain …")

    def _show(self, name: str, text: str, done: int = 0, total: int = 1) -> None:
        if name not in self._tasks:
            self._tasks[name] = self._bars.add_task(text, total=total)
        elif name:  # each stage of an item has its own time
            self._bars.reset(self._tasks[name])
        self._bars.update(self._tasks[name], description=text, completed=done)

    def _remove(self, name: str) -> None:
        if name in self._tasks:
            self._bars.remove_task(self._tasks.pop(name))
