"""Messages between processes: pickled, arrays and frozen values sent once and then by their digests."""

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
from collections import ChainMap, deque
from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any, Final, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import UInt8Array
from sketchterrain.document.label_layers import freeze_image
from sketchterrain.document.sketch import Sketch
from sketchterrain.io.system import module_command
from sketchterrain.stages.digests import blocks_of, digest_of, is_image, patched, places_of, remember
from sketchterrain.ui.engine.protocol import SketchUpdate

if TYPE_CHECKING:
    from sketchterrain.ui.models.document import Document


_COUNT: Final = struct.Struct("<I")
_LENGTH: Final = struct.Struct("<Q")
_SEND_BUFFER: Final = 1 << 20  # bytes in flight before a writer blocks, as far as the system allows
_LEAST: Final = 1024  # bytes of an array that is sent by its digest
_REMEMBERED: Final = 4  # messages with arrays
_PLAIN: Final = frozenset({str, int, float, bool, bytes, tuple, list, dict, type(None), type})


class _Held(NamedTuple):
    """A value that both ends of a connection hold, and the digests of those that it refers to."""

    value: Any
    parts: tuple[bytes, ...] = ()


class _Definition(NamedTuple):
    """How a new value is sent: pickled, or as an array; of an image the blocks that differ from another."""

    digest: bytes
    dtype: npt.DTypeLike | None = None
    shape: tuple[int, ...] = ()
    before: bytes | None = None
    blocks: npt.NDArray[np.bool_] | None = None


class _Message:
    """The shared values of one message."""

    def __init__(self, held: Mapping[bytes, _Held]) -> None:
        self.held = held
        self.used: dict[bytes, _Held] = {}
        self.definitions: list[_Definition] = []  # parts before what refers to them
        self.contents: list[memoryview] = []

    def use(self, digest: bytes) -> bool:
        """Remember a value and its parts with this message; return whether it is known."""
        if digest not in self.used and digest in self.held:
            self.used[digest] = self.held[digest]
            for part in self.held[digest].parts:
                self.use(part)
        return digest in self.used

    def define(self, digest: bytes, value: Any) -> None:
        """Note a value that the receiver does not have."""
        parts: tuple[bytes, ...] = ()
        definition, content = _Definition(digest), memoryview(b"")
        if is_image(value):
            definition, content = self._image(digest, value)
        elif isinstance(value, np.ndarray):
            definition = _Definition(digest, value.dtype, value.shape)
            content = value.reshape(-1).view(np.uint8).data
        else:
            inner = ContentPickler(self)
            content, parts = inner.dumps(value), tuple(inner.parts)
        self.used[digest] = _Held(value, parts)
        self.definitions.append(definition)
        self.contents.append(content)

    def _image(self, digest: bytes, image: UInt8Array) -> tuple[_Definition, memoryview]:
        """Return an image as what differs from the nearest known one."""
        own, best = blocks_of(image), None
        where = np.ones(own.shape, np.bool_)
        for name, (other, _) in self.held.items():
            if is_image(other) and other.shape == image.shape:
                differs = blocks_of(other) != own
                if best is None or differs.sum() < where.sum():
                    best, where = name, differs
        pixels = b"".join(image[place].tobytes() for place in places_of(where))
        return _Definition(digest, image.dtype, image.shape, best, where), memoryview(pixels)

    def assemble(self, definition: _Definition, content: bytearray) -> None:
        """Read a new value."""
        value: Any
        parts: tuple[bytes, ...] = ()
        if definition.blocks is not None:
            before = None if definition.before is None else self.held[definition.before].value
            value = patched(before, definition.shape, definition.blocks, content)
        elif definition.dtype is not None:
            value = np.frombuffer(content, definition.dtype).reshape(definition.shape)
            value.flags.writeable = False
        else:
            reader = _ContentUnpickler(content, self)
            value, parts = reader.load(), tuple(reader.parts)
        remember(value, definition.digest)
        self.used[definition.digest] = _Held(value, parts)


class ContentPickler(pickle.Pickler):
    """Pickles a message; large arrays and frozen values as their digests."""

    dispatch_table = copyreg.dispatch_table.copy()
    # A sketch would compress its layers.
    dispatch_table[Sketch] = lambda sketch: (_sketch, (_values_of(sketch),))

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
        """Return the digest of a shared value; None if it is pickled in place."""
        if type(value) in _PLAIN or value is self._whole or not _is_shared(value):
            return None
        digest = digest_of(value)
        if not self._message.use(digest):
            self._message.define(digest, value)
        self.parts[digest] = None
        return digest


class _ContentUnpickler(pickle.Unpickler):
    """Reads what `ContentPickler` wrote: arrays are read-only, and known values the same objects."""

    def __init__(self, data: bytes | bytearray, message: _Message, buffers: Iterable[bytearray] = ()) -> None:
        super().__init__(io.BytesIO(data), buffers=buffers)
        self._message = message
        self.parts: dict[bytes, None] = {}

    def persistent_load(self, digest: bytes) -> Any:
        """Return the value of a digest."""
        self.parts[digest] = None
        self._message.use(digest)
        return self._message.used[digest].value


def _is_shared(value: object) -> bool:
    """Return whether a value is a large array, or frozen and compared by identity."""
    kind = type(value)
    if kind is np.ndarray:
        array = cast("npt.NDArray[Any]", value)
        return array.nbytes >= _LEAST and array.flags.c_contiguous
    dataclass = getattr(kind, "__dataclass_params__", None)
    return dataclass is not None and dataclass.frozen and not dataclass.eq


def _values_of(sketch: Sketch) -> dict[str, Any]:
    return {each.name: getattr(sketch, each.name) for each in fields(sketch)}


def _sketch(values: dict[str, Any]) -> Sketch:
    valid = {name: freeze_image(image) for name, image in values["layers"].items()}
    return Sketch(**{**values, "layers": valid})


class Channel:
    """One end of a connection to another process; if not `patient`, `send` queues instead of blocking."""

    def __init__(self, end: socket.socket, *, patient: bool = True) -> None:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        self._socket = end
        self._received: deque[dict[bytes, _Held]] = deque(maxlen=_REMEMBERED)
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
        message = _Message(ChainMap(*self._received))
        # Only processes of this program hold the other end.
        definitions = pickle.loads(head) if head else ()  # noqa: S301
        for definition, content in zip(definitions, others, strict=False):
            message.assemble(definition, content)
        received = _ContentUnpickler(data, message, others[len(definitions) :]).load()
        if message.used:
            self._received.append(message.used)
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
        self._sent: deque[dict[bytes, _Held]] = deque(maxlen=_REMEMBERED)
        super().__init__(end, patient=patient)

    def _pickle(self, message: Any) -> list[memoryview]:
        parts = _Message(ChainMap(*self._sent))
        data = ContentPickler(parts).dumps(message)
        if parts.used:
            self._sent.append(parts.used)
        return [memoryview(pickle.dumps(parts.definitions, protocol=5)), data, *parts.contents]


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


class UpdateBuilder:
    """Makes messages of a document's sketch, with the current stroke and without draped layers."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._version = 0
        self.sent = b""  # digest of the last update's sketch
        self._fresh = True
        document.opened.connect(self._on_opened)

    def next(self) -> tuple[SketchUpdate, bool]:
        """Return the newest sketch, and whether another document was opened since the last one."""
        sketch, draft, fresh = self._placed_sketch(), self._document.draft, self._fresh
        if draft is not None:
            sketch = sketch.replace(layers={**sketch.layers, draft.layer: draft.snapshot()})
        self._version += 1
        self.sent, self._fresh = digest_of(sketch), False
        return SketchUpdate(self._version, sketch), fresh

    @property
    def is_empty(self) -> bool:
        """Whether nothing but draped layers, which the placer does not receive, has changed."""
        return self._document.draft is None and digest_of(self._placed_sketch()) == self.sent

    def _placed_sketch(self) -> Sketch:
        return self._document.sketch.replace(drapes=())

    def _on_opened(self) -> None:
        self._fresh = True
