"""Results of a batch: outputs, manifest, contact sheets, progress."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import file_digest, sha256
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple

import msgspec
import numpy as np
from PIL import Image, ImageDraw, ImageFont
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from sketchterrain.app.estimates import check_size, memory_needed, plant_bytes
from sketchterrain.document.label_layers import LabelImage
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.toml_format import settings_text
from sketchterrain.errors import InputError, one_line
from sketchterrain.export.planning import checked_plan
from sketchterrain.export.planning import memory_needed as export_memory
from sketchterrain.export.rasters import write_picture
from sketchterrain.export.target import ExportOptions
from sketchterrain.io.files import write_atomic

MANIFEST = "manifest.json"
# Names come from a file that anyone may have written: none may lead out of the batch's folder.
_PART = r"(?!\.{1,2}(?:/|\Z))[^/\\\x00]+"
_FileName = Annotated[str, msgspec.Meta(pattern=rf"\A{_PART}\Z")]
_ItemName = Annotated[str, msgspec.Meta(pattern=rf"\A{_PART}(?:/{_PART})*\Z")]


class File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A file of an item: its name in the item's folder, how many bytes it has, and their SHA-256."""

    file: _FileName
    bytes: int
    sha256: str


class Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the manifest says of one item.

    `input` is its fingerprint, `seconds` the wall time, `timings` that of each stage, `notes` the devices
    that failed. Partial is an item that lacks its preview, and `error` says why, or why an item failed.
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

    def whole(self, folder: Path) -> bool:
        """Return whether every file is in a folder, with the same hash."""
        try:
            return all(hashed(folder / each.file) == each for each in self.files)
        except OSError:
            return False


class Manifest(msgspec.Struct, forbid_unknown_fields=True):
    """What is written of each terrain of a batch, the entries of its items, and its contact sheets."""

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
        """Write it as a whole; raise SketchterrainError if the system cannot."""
        write_atomic(folder / MANIFEST, msgspec.json.format(msgspec.json.encode(self), indent=1))


def read_manifest(folder: Path) -> Manifest | None:
    """Return the manifest in a folder, None where there is none; raise InputError if it is not valid."""
    path = folder / MANIFEST
    try:
        manifest = msgspec.json.decode(path.read_bytes(), type=Manifest)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise InputError(f"{one_line(path)}: cannot be read ({error.strerror})") from None
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(
            f"{one_line(path)}: expected a batch's manifest, this is another file or broken "
            f"({one_line(error)}); take another folder, or move it away to start over"
        ) from None
    if len(manifest.entries) < len(manifest.items):
        raise InputError(f"{one_line(path)}: expected a batch's manifest, this one has an item twice")
    return manifest


def hashed(path: Path) -> File:
    """Return a file's size and hash; raise OSError if it cannot be read."""
    with path.open("rb") as stream:
        digest = file_digest(stream, "sha256").hexdigest()
        return File(path.name, stream.tell(), digest)


DEFAULT_SIZE: Final = 1025
PREVIEW_MEMORY: Final = 1600 << 20  # bytes, for all previews; measured with OpenGL on a processor
_PREVIEW_DISK: Final = 3 << 20
_VERTEX_DISK: Final = 9  # bytes: heights twice, normals, materials; the presets take 7


@dataclass(frozen=True)
class Output:
    """What is written of each terrain; without a target, the files of ``generate``.

    `size` is in vertices along the longer side (None: what suits the target, or `DEFAULT_SIZE`).
    """

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
    """What a terrain takes: vertices, bytes of memory but for its preview, bytes of disk."""

    vertices: int
    memory: float
    disk: float


def needs_of(sketch: Sketch, output: Output) -> Needs:
    """Return what a terrain takes; raise SketchterrainError if there cannot be one."""
    east, north = sketch.size
    if output.target is None:
        size = output.size or DEFAULT_SIZE
        check_size(sketch, size)
        vertices = size * (round((size - 1) * min(east, north) / max(east, north)) + 1)
        memory, disk = memory_needed(sketch, size), float(_VERTEX_DISK * vertices)
        disk += plant_bytes(east * north, output.foliage, grass=output.grass)
    else:
        options = output.options or ExportOptions()
        wanted = checked_plan(sketch, output.target, options)
        vertices, memory = wanted.vertices, export_memory(wanted)
        disk = wanted.target.disk * vertices + plant_bytes(east * north, "csv", grass=options.grass)
    return Needs(vertices, memory, disk + output.preview * _PREVIEW_DISK)


def fingerprint(sketch: Sketch, output: Output) -> str:
    """Return a hash of what a terrain's files follow from; the device is not part, for it changes no bit."""
    layers = {name: image_digest(image) for name, image in sketch.layers.items()}
    whole = {"version": version("sketchterrain"), "output": msgspec.to_builtins(output)}
    whole |= {"layers": layers, "settings": settings_text(sketch)}
    return sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()


def image_digest(image: LabelImage) -> str:
    """Return the SHA-256 of a layer's shape and labels, as hexadecimal digits."""
    return sha256(f"{image.shape}".encode() + image.tobytes()).hexdigest()


COLUMNS: Final = 4
PAGE: Final = 40  # pictures on a page
_PICTURE: Final = (400, 225)
_GAP, _LINE, _FONT = 12, 22, 15  # px
_PAPER, _INK, _QUIET, _RED = (250, 250, 248), (40, 40, 40), (225, 225, 222), (170, 30, 30)


def write_sheets(folder: Path, entries: Sequence[Entry]) -> list[str]:
    """Write ``sheet.png``, ``sheet-2.png`` and so on; return their names, none where there is no preview.

    Entries are shown in this order, with their preview, or with what went wrong.
    """
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
            problem = _fitting(draw, entry.error or "no preview", font)
            draw.text((left + _GAP, top + _GAP), problem, fill=_RED, font=font)
        else:
            sheet.paste(picture, (left, top))
        draw.text((left, top + _PICTURE[1] + 2), _fitting(draw, entry.name, font), fill=_INK, font=font)
    return sheet


def _has_preview(entry: Entry) -> bool:
    return entry.state != "failed" and any(each.file == "preview.png" for each in entry.files)


def _thumbnail(path: Path) -> Image.Image | None:
    """Return a preview at the size of the sheet; None where it is missing."""
    try:
        with Image.open(path, formats=("PNG",)) as picture:
            return picture.convert("RGB").resize(_PICTURE, Image.Resampling.BOX)
    except OSError:
        return None


def _fitting(draw: ImageDraw.ImageDraw, text: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont) -> str:
    """Return as much of the end of a text as fits under a picture."""
    width = _PICTURE[0] - 2 * _GAP
    cuts = (text, *(f"…{text[cut:]}" for cut in range(1, len(text))), "…")
    return next(each for each in cuts if draw.textlength(each, font=font) <= width)


class BatchProgress:
    """Report how a batch goes on; several threads may call it. Use it as a context manager."""

    def __init__(self) -> None:
        text, elapsed = TextColumn("{task.description}", markup=False), TimeElapsedColumn()
        columns = (text, BarColumn(), elapsed, TimeRemainingColumn())
        self._bars = Progress(
            *columns,
            console=Console(stderr=True, markup=False, emoji=False, highlight=False, soft_wrap=True),
            disable=not sys.stderr.isatty(),
            speed_estimate_period=3600.0,
        )
        self._tasks: dict[str, TaskID] = {}
        self._items = self._done = self._failed = 0

    def __enter__(self) -> BatchProgress:
        self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bars.stop()

    def verified(self, number: int, items: int) -> None:
        """Report how many items were compared with their files."""
        self._show("", "Verifying existing terrains", number, items)

    def begins(self, items: int, skipped: int) -> None:
        """Report how many terrains will be made, and how many are there."""
        self._items = items
        self._remove("")
        if skipped:
            self._bars.console.print(f"{skipped} of {skipped + items} terrains are there and unchanged")
        self._show("", f"0 of {items} terrains", 0, items)

    def stage(self, name: str, title: str) -> None:
        """Report what is being done for an item."""
        self._show(name, f"{name}: {title}")

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

    def stops(self) -> None:
        """Report that the batch ends before all is done."""
        self._bars.console.print("stopping: terrains in work are given up, finished ones stay …")

    def _show(self, name: str, text: str, done: int = 0, total: int | None = None) -> None:
        if name not in self._tasks:
            self._tasks[name] = self._bars.add_task(text, total=total)
        self._bars.update(self._tasks[name], description=text, completed=done)

    def _remove(self, name: str) -> None:
        if name in self._tasks:
            self._bars.remove_task(self._tasks.pop(name))
