"""Messages between processes: pickled with out-of-band buffers, and changes of a sketch."""

from __future__ import annotations

import contextlib
import copyreg
import io
import pickle
import queue
import selectors
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import fields
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.document.label_layers import Box, LabelImage, union_box
from sketchterrain.document.layers import LAYERS
from sketchterrain.document.sketch import Sketch
from sketchterrain.ui.engine.protocol import LayerPatch, SketchUpdate

if TYPE_CHECKING:
    from sketchterrain.ui.models.document import Document


_COUNT: Final = struct.Struct("<I")
_LENGTH: Final = struct.Struct("<Q")
_SEND_BUFFER: Final = 1 << 20  # bytes in flight before a writer blocks, as far as the system allows


def _read_only(values: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(values)


copyreg.pickle(MappingProxyType, lambda mapping: (_read_only, (dict(mapping),)))  # a sketch's settings


class Channel:
    """One end of a connection to another process; if not `patient`, `send` queues instead of blocking."""

    def __init__(self, end: socket.socket, *, patient: bool = True) -> None:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        self._socket = end
        self._queue: queue.SimpleQueue[list[memoryview] | None] | None = None
        if not patient:
            self._queue = queue.SimpleQueue()
            self._thread = threading.Thread(target=self._write_queued, name="channel", daemon=True)
            self._thread.start()

    @classmethod
    def from_descriptor(cls, number: int, *, patient: bool = True) -> Channel:
        """Return the end that this process inherited as a file descriptor."""
        return cls(socket.socket(fileno=number), patient=patient)

    def fileno(self) -> int:
        """Return the socket's file descriptor, for `select`."""
        return self._socket.fileno()

    def send(self, message: Any) -> None:
        """Send a message; its arrays must not change afterwards, the rest is pickled before this returns."""
        buffers = list[pickle.PickleBuffer]()
        data = pickle.dumps(message, protocol=5, buffer_callback=buffers.append)
        parts = [memoryview(data), *(buffer.raw() for buffer in buffers)]
        if self._queue is None:
            self._write(parts)
        else:
            self._queue.put(parts)

    def has_message(self, timeout: float | None = 0.0) -> bool:
        """Return whether `receive` would not block; waits up to `timeout` s (None: unlimited)."""
        return bool(ready([self], timeout))

    def receive(self) -> Any:
        """Return the next message, blocking; raise EOFError when the other process has ended."""
        (count,) = _COUNT.unpack(self._read(_COUNT.size))
        lengths = [_LENGTH.unpack(self._read(_LENGTH.size))[0] for _ in range(count)]
        first, *others = [self._read(length) for length in lengths]
        return pickle.loads(first, buffers=others)  # noqa: S301 # only processes of this program hold the other end

    def close(self, *, timeout: float = 0.2) -> None:
        """Write queued messages for up to `timeout` s, then close the socket."""
        if self._queue is not None:
            self._queue.put(None)
            self._thread.join(timeout)
        # Wake a blocked reader or writer: the descriptor's number may be reused once it is closed.
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        if self._queue is not None:
            self._thread.join(timeout)
        self._socket.close()

    def _write_queued(self) -> None:
        assert self._queue is not None  # noqa: S101 # it started this thread
        with contextlib.suppress(OSError):
            while (parts := self._queue.get()) is not None:
                self._write(parts)

    def _write(self, parts: list[memoryview]) -> None:
        head = b"".join([_COUNT.pack(len(parts)), *(_LENGTH.pack(part.nbytes) for part in parts)])
        for part in [memoryview(head), *parts]:
            self._socket.sendall(part)

    def _read(self, length: int) -> bytearray:
        data = bytearray(length)
        view, start = memoryview(data), 0
        while start < length:
            try:
                count = self._socket.recv_into(view[start:])
            except OSError as error:
                raise EOFError("the other process has ended") from error
            if count == 0:
                raise EOFError("the other process has ended")
            start += count
        return data


def ready(channels: list[Channel], timeout: float | None = None) -> list[Channel]:
    """Return the channels with a message or a lost connection; wait up to `timeout` s for the first."""
    with selectors.DefaultSelector() as selector:
        for channel in channels:
            selector.register(channel.fileno(), selectors.EVENT_READ)
        found = {key.fd for key, _ in selector.select(timeout)}
    return [channel for channel in channels if channel.fileno() in found]


def start_process(
    module: str, arguments: list[str], ends: list[socket.socket], *descriptors: int
) -> subprocess.Popen[bytes]:
    """Run a module of this package in a process that inherits socket ends (closed here) and descriptors."""
    command = [sys.executable, "-m", f"sketchterrain.ui.engine.{module}", *arguments]
    numbers = [*(end.fileno() for end in ends), *descriptors]
    child = subprocess.Popen(command, pass_fds=numbers, stdin=subprocess.DEVNULL)  # noqa: S603
    for end in ends:
        end.close()
    return child


class _Pickler(pickle.Pickler):
    def __init__(self, data: io.BytesIO, excluded: object) -> None:
        super().__init__(data, protocol=5)
        self._excluded = excluded

    def persistent_id(self, value: Any) -> str | None:
        return "excluded" if value is self._excluded and value is not None else None


class _Unpickler(pickle.Unpickler):
    def __init__(self, data: bytes, excluded: object) -> None:
        super().__init__(io.BytesIO(data))
        self._excluded = excluded

    def persistent_load(self, _: Any) -> object:
        return self._excluded


def pickle_without(value: Any, excluded: object = None) -> bytes:
    """Return a value pickled with a placeholder for one object that it refers to; see `unpickle_with`."""
    data = io.BytesIO()
    _Pickler(data, excluded).dump(value)
    return data.getvalue()


def unpickle_with(data: bytes, excluded: object = None) -> Any:
    """Return the value of `pickle_without`, the given object in place of the placeholder."""
    return _Unpickler(data, excluded).load()


def settings_of(sketch: Sketch) -> dict[str, Any]:
    """Return every field of a sketch except its layers."""
    return {each.name: getattr(sketch, each.name) for each in fields(sketch) if each.name != "layers"}


class SketchMirror:
    """A copy of the sketch, assembled from updates.

    Unchanged layers stay the same array, so that caches keyed by identity remain valid.
    """

    def __init__(self) -> None:
        self.version = -1
        self._layers: dict[str, LabelImage] = {}
        self._settings: Mapping[str, Any] = {}
        self._changed: set[str] = set()

    def apply(self, update: SketchUpdate) -> None:
        """Apply an update."""
        first = next(iter(self._layers.values()), None)
        if first is None or first.shape != update.shape:
            empty = np.zeros(update.shape, np.uint8)
            empty.flags.writeable = False
            self._layers = dict.fromkeys(LAYERS, empty)
            self._changed = set(LAYERS)
        for name, patch in update.layers.items():
            self._patch(name, patch)
        self._settings = update.settings
        self.version = update.version

    def sketch(self) -> Sketch:
        """Return the sketch as of the last update."""
        return Sketch(**self._settings, layers=self._layers)

    def changes(self) -> SketchUpdate:
        """Return the update for another mirror since the last call."""
        shape = next(iter(self._layers.values())).shape
        layers = {name: LayerPatch(0, 0, self._layers[name]) for name in sorted(self._changed)}
        self._changed = set()
        return SketchUpdate(self.version, (shape[0], shape[1]), self._settings, layers)

    def _patch(self, name: str, patch: LayerPatch) -> None:
        image = self._layers[name]
        rows, columns = patch.pixels.shape
        place = (slice(patch.row, patch.row + rows), slice(patch.column, patch.column + columns))
        if np.array_equal(image[place], patch.pixels):
            return
        if patch.pixels.shape == image.shape:
            image = np.array(patch.pixels)
        else:
            image = image.copy()
            image[place] = patch.pixels
        image.flags.writeable = False
        self._layers[name] = image
        self._changed.add(name)


class UpdateBuilder:
    """Collects a document's changes, including the current stroke's, into updates."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._version = 0
        self._shape = (0, 0)
        self._boxes: dict[str, Box] = {}
        self._all = self._fresh = True
        self._notify: Callable[[], None] | None = None
        document.painted.connect(self._on_painted)
        document.opened.connect(self._on_opened)

    def start(self, notify: Callable[[], None]) -> None:
        """Call `notify` on each change; the next update is complete."""
        self.stop()
        self._all, self._notify = True, notify
        self._document.live_changed.connect(notify)

    def stop(self) -> None:
        """Stop notifying."""
        if self._notify is not None:
            self._document.live_changed.disconnect(self._notify)
        self._notify = None

    def next(self) -> tuple[SketchUpdate, bool]:
        """Return the changes since the last update, and whether another document was opened."""
        sketch, fresh = self._document.sketch, self._fresh
        shape = (sketch.height_px, sketch.width_px)
        if self._all or shape != self._shape:
            # Mirrors clear layers only where the shape differs, so empty ones are sent as well.
            self._boxes = dict.fromkeys(LAYERS, (0, 0, *shape))
        layers = {name: self._patch(name, box) for name, box in self._boxes.items()}
        self._shape, self._boxes = shape, {}
        self._all = self._fresh = False
        self._version += 1
        return SketchUpdate(self._version, shape, settings_of(sketch), layers), fresh

    def _patch(self, name: str, box: Box) -> LayerPatch:
        top, left, bottom, right = max(box[0], 0), max(box[1], 0), box[2], box[3]
        image = self._document.layer(name)
        pixels = image[top:bottom, left:right]
        # A sketch's arrays never change; a stroke's do.
        return LayerPatch(top, left, pixels.copy() if image.flags.writeable else pixels)

    def _on_painted(self, layer: str, box: Box) -> None:
        self._boxes[layer] = union_box(self._boxes.get(layer), box) or box

    def _on_opened(self) -> None:
        self._all = self._fresh = True
