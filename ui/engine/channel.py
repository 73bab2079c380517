"""Messages between processes: pickled, arrays sent once and then by hash, and changes of a sketch."""

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
import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from hashlib import blake2b
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from sketchterrain.document.label_layers import Box, LabelImage, freeze_image, union_box
from sketchterrain.document.layers import PAINTED_LAYERS
from sketchterrain.document.sketch import Sketch
from sketchterrain.io.system import module_command
from sketchterrain.ui.engine.protocol import LayerPatch, SketchUpdate

if TYPE_CHECKING:
    from sketchterrain.ui.models.document import Document


_COUNT: Final = struct.Struct("<I")
_LENGTH: Final = struct.Struct("<Q")
_SEND_BUFFER: Final = 1 << 20  # bytes in flight before a writer blocks, as far as the system allows
_LEAST: Final = 1024  # bytes of an array that is sent by its hash
_CHUNK: Final = 1 << 14  # bytes that are sent again if one of them changes
_DIGEST: Final = 16  # bytes of a hash
_REMEMBERED: Final = 4  # messages with arrays
_PLAIN: Final = frozenset({str, int, float, bool, bytes, tuple, list, dict, type(None), type})

_Definition: TypeAlias = tuple[bytes, npt.DTypeLike | None, tuple[int, ...], tuple[bytes, ...]]
"""Hash of a new value, type and shape of an array (None: any other value), hashes of its chunks."""


def _read_only(values: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(values)


copyreg.pickle(MappingProxyType, lambda mapping: (_read_only, (dict(mapping),)))  # a sketch's settings


class _Shared(NamedTuple):
    """A value that both ends of a connection hold."""

    value: Any
    content: memoryview  # an array's data; any other value pickled
    chunks: tuple[bytes, ...]  # hashes of parts of the content
    parts: tuple[bytes, ...]  # hashes of the shared values that it refers to


class _ContentMemory:
    """Values of the last messages in one direction by hash: both ends remember the same ones."""

    def __init__(self) -> None:
        self._messages: deque[dict[bytes, _Shared]] = deque(maxlen=_REMEMBERED)
        self.shared: dict[bytes, _Shared] = {}
        self.chunks: dict[bytes, memoryview] = {}
        self.digests: dict[int, bytes] = {}  # by id of the values held here

    def add_message(self, used: dict[bytes, _Shared]) -> None:
        """Remember the values of a message and forget those of the oldest one."""
        if not used:
            return
        self._messages.append(used)
        self.shared = {digest: each for message in self._messages for digest, each in message.items()}
        self.digests = {id(each.value): digest for digest, each in self.shared.items()}
        self.chunks = {
            name: chunk
            for each in self.shared.values()
            for name, chunk in zip(each.chunks, _split(each.content), strict=True)
        }


class _Message:
    """The shared values of one message."""

    def __init__(self, memory: _ContentMemory) -> None:
        self.memory = memory
        self.used: dict[bytes, _Shared] = {}
        self.new: list[_Definition] = []  # parts before what refers to them
        self.new_chunks: dict[bytes, memoryview | bytearray] = {}

    def use(self, digest: bytes) -> Any:
        """Return the value of a hash, and remember it and its parts with this message."""
        shared = self.used.get(digest)
        if shared is None:
            shared = self.used[digest] = self.memory.shared[digest]
            for part in shared.parts:
                self.use(part)
        return shared.value

    def define(self, definition: _Definition) -> None:
        """Assemble a new value from its chunks."""
        digest, dtype, shape, names = definition
        content = b"".join(self.new_chunks.get(name) or self.memory.chunks[name] for name in names)
        parts: tuple[bytes, ...] = ()
        if dtype is None:
            reader = _ContentUnpickler(content, self)
            value, parts = reader.load(), tuple(reader.parts)
        else:
            value = np.frombuffer(content, dtype).reshape(shape)
        self.used[digest] = _Shared(value, memoryview(content), names, parts)


class ContentPickler(pickle.Pickler):
    """Pickles a message; large arrays and frozen values as the hash of their content."""

    dispatch_table = copyreg.dispatch_table.copy()
    # A sketch would compress its layers.
    dispatch_table[Sketch] = lambda sketch: (_sketch, (settings_of(sketch), dict(sketch.layers)))

    def __init__(self, message: _Message) -> None:
        self._stream = io.BytesIO()
        super().__init__(self._stream, protocol=5)
        self._message = message
        self._whole: object = None
        self.parts: dict[bytes, None] = {}

    def dumps(self, whole: object) -> memoryview:
        """Return a pickled value, itself in full."""
        self._whole = whole
        self.dump(whole)
        return self._stream.getbuffer()

    def persistent_id(self, value: Any) -> bytes | None:
        """Return the hash of a shared value; None if it is pickled in place."""
        if type(value) in _PLAIN or value is self._whole or not _is_shared(value):
            return None
        digest = self._message.memory.digests.get(id(value)) or self._define(value)
        self._message.use(digest)
        self.parts[digest] = None
        return digest

    def _define(self, value: Any) -> bytes:
        """Return the hash of a value, and note what of it the receiver does not have."""
        message, dtype, shape = self._message, None, ()
        parts: tuple[bytes, ...] = ()
        if isinstance(value, np.ndarray):
            content, dtype, shape = value.reshape(-1).view(np.uint8).data, value.dtype, value.shape
        else:
            inner = ContentPickler(message)
            content, parts = inner.dumps(value), tuple(inner.parts)
        chunks = _split(content)
        names = tuple(_digest(chunk) for chunk in chunks)
        digest = _digest(b"".join([*names, repr((dtype, shape)).encode()]))
        if digest not in message.memory.shared and digest not in message.used:
            known = message.memory.chunks
            pairs = zip(names, chunks, strict=True)
            message.new_chunks |= {name: chunk for name, chunk in pairs if name not in known}
            message.new.append((digest, dtype, shape, names))
            message.used[digest] = _Shared(value, content, names, parts)
        return digest


class _ContentUnpickler(pickle.Unpickler):
    """Reads what `ContentPickler` wrote: arrays are read-only, and known values the same objects."""

    def __init__(self, data: bytes | bytearray, message: _Message, buffers: Iterable[bytearray] = ()) -> None:
        super().__init__(io.BytesIO(data), buffers=buffers)
        self._message = message
        self.parts: dict[bytes, None] = {}

    def persistent_load(self, digest: bytes) -> Any:
        """Return the value of a hash."""
        self.parts[digest] = None
        return self._message.use(digest)


def _is_shared(value: object) -> bool:
    """Return whether a value is a large array, or frozen and compared by identity."""
    kind = type(value)
    if kind is np.ndarray:
        array = cast("npt.NDArray[Any]", value)
        return array.nbytes >= _LEAST and array.flags.c_contiguous
    dataclass = getattr(kind, "__dataclass_params__", None)
    return dataclass is not None and dataclass.frozen and not dataclass.eq


def _split(content: memoryview) -> list[memoryview]:
    return [content[start : start + _CHUNK] for start in range(0, len(content), _CHUNK)]


def _digest(data: bytes | memoryview) -> bytes:
    return blake2b(data, digest_size=_DIGEST).digest()


def _sketch(settings: dict[str, Any], layers: dict[str, LabelImage]) -> Sketch:
    valid = {name: freeze_image(image) for name, image in layers.items()}
    return Sketch(**settings, layers=valid)


class Channel:
    """One end of a connection to another process; if not `patient`, `send` queues instead of blocking."""

    def __init__(self, end: socket.socket, *, patient: bool = True) -> None:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        self._socket = end
        self._received = _ContentMemory()
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
        parts = self._pickle(message)
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
        head, data, *others = [self._read(length) for length in lengths]
        message = _Message(self._received)
        # Only processes of this program hold the other end.
        definitions, names = pickle.loads(head) if head else ((), ())  # noqa: S301
        message.new_chunks.update(zip(names, others, strict=False))
        for definition in definitions:
            message.define(definition)
        received = _ContentUnpickler(data, message, others[len(names) :]).load()
        self._received.add_message(message.used)
        return received

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

    def _pickle(self, message: Any) -> list[memoryview]:
        """Return what of shared values is new (nothing), the pickled message, and its buffers."""
        buffers = list[pickle.PickleBuffer]()
        data = pickle.dumps(message, protocol=5, buffer_callback=buffers.append)
        return [memoryview(b""), memoryview(data), *(buffer.raw() for buffer in buffers)]

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


class ContentChannel(Channel):
    """A channel that sends of arrays and values only what the last messages did not contain."""

    def __init__(self, end: socket.socket, *, patient: bool = True) -> None:
        self._sent = _ContentMemory()
        super().__init__(end, patient=patient)

    def _pickle(self, message: Any) -> list[memoryview]:
        parts = _Message(self._sent)
        data = ContentPickler(parts).dumps(message)
        self._sent.add_message(parts.used)
        head = pickle.dumps((parts.new, tuple(parts.new_chunks)), protocol=5)
        return [memoryview(head), data, *(memoryview(chunk) for chunk in parts.new_chunks.values())]


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
    command = module_command(f"sketchterrain.ui.engine.{module}", *arguments)
    numbers = [*(end.fileno() for end in ends), *descriptors]
    child = subprocess.Popen(command, pass_fds=numbers, stdin=subprocess.DEVNULL)  # noqa: S603
    for end in ends:
        end.close()
    return child


def settings_of(sketch: Sketch) -> dict[str, Any]:
    """Return every field of a sketch except its layers."""
    return {each.name: getattr(sketch, each.name) for each in fields(sketch) if each.name != "layers"}


def _placed_settings(sketch: Sketch) -> dict[str, Any]:
    return {**settings_of(sketch), "drapes": ()}


class SketchMirror:
    """A copy of the sketch, assembled from updates.

    Unchanged layers stay the same array, so that caches keyed by identity remain valid.
    """

    def __init__(self) -> None:
        self.version = -1
        self._layers: dict[str, LabelImage] = {}
        self._settings: Mapping[str, Any] = {}

    def apply(self, update: SketchUpdate) -> None:
        """Apply an update."""
        first = next(iter(self._layers.values()), None)
        if first is None or first.shape != update.shape:
            empty = np.zeros(update.shape, np.uint8)
            empty.flags.writeable = False
            self._layers = dict.fromkeys(PAINTED_LAYERS, empty)
        for name, patch in update.layers.items():
            self._patch(name, patch)
        self._settings = update.settings
        self.version = update.version

    def sketch(self) -> Sketch:
        """Return the sketch as of the last update."""
        return Sketch(**self._settings, layers=self._layers)

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


class UpdateBuilder:
    """Collects a document's changes, including the current stroke's, into updates."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._version = 0
        self._shape = (0, 0)
        self._settings: dict[str, Any] = {}  # of the last update
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
            self._boxes = dict.fromkeys(PAINTED_LAYERS, (0, 0, *shape))
        layers = {name: self._patch(name, box) for name, box in self._boxes.items()}
        self._shape, self._boxes = shape, {}
        self._all = self._fresh = False
        self._version += 1
        self._settings = _placed_settings(sketch)
        return SketchUpdate(self._version, shape, self._settings, layers), fresh

    @property
    def is_empty(self) -> bool:
        """Whether nothing but draped layers, which the placer does not receive, has changed."""
        unsent = self._all or bool(self._boxes) or self._document.draft is not None
        return not unsent and _placed_settings(self._document.sketch) == self._settings

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
