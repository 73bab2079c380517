"""What the program's processes say to each other: whole messages over a socket, arrays without copies."""

from __future__ import annotations

import contextlib
import io
import pickle
import queue
import selectors
import socket
import struct
import threading
from types import MappingProxyType
from typing import Any, Final

_COUNT: Final = struct.Struct("<I")
_LENGTH: Final = struct.Struct("<Q")
_ROOM: Final = 1 << 20  # bytes that may be on their way before a writer waits, as far as the system allows


class Channel:
    """One end of a connection to another process of the program.

    Messages are pickled; the bytes of their arrays travel beside the pickle, so that neither end copies them
    and large ones hold up no other thread.
    """

    def __init__(self, end: socket.socket, *, patient: bool = True) -> None:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _ROOM)
        self._socket = end
        self._waiting: queue.SimpleQueue[list[memoryview] | None] | None = None
        if not patient:
            self._waiting = queue.SimpleQueue()
            self._thread = threading.Thread(target=self._write_all, name="channel", daemon=True)
            self._thread.start()

    @classmethod
    def of(cls, number: int, *, patient: bool = True) -> Channel:
        """Return the end that a process was given by the number of its file descriptor."""
        return cls(socket.socket(fileno=number), patient=patient)

    def fileno(self) -> int:
        """Return the socket's file descriptor, for `select`."""
        return self._socket.fileno()

    def send(self, message: Any) -> None:
        """Send a message; its arrays must stay as they are, all else is read before this returns."""
        parts = _parts(message)
        if self._waiting is None:
            self._write(parts)
        else:
            self._waiting.put(parts)

    def has_message(self, timeout: float | None = 0.0) -> bool:
        """Whether `receive` has something to return, or to raise; waits up to `timeout` s, None: for ever."""
        return bool(ready([self], timeout))

    def receive(self) -> Any:
        """Return the next message; waits for it."""
        (count,) = _COUNT.unpack(self._read(_COUNT.size))
        lengths = [_LENGTH.unpack(self._read(_LENGTH.size))[0] for _ in range(count)]
        first, *others = [self._read(length) for length in lengths]
        return pickle.loads(first, buffers=others)  # noqa: S301 # only processes of this program hold the other end

    def close(self, *, timeout: float = 0.2) -> None:
        """Let what was sent be written, for a short while (s), and close the socket."""
        if self._waiting is not None:
            self._waiting.put(None)
            self._thread.join(timeout)
        # A thread that still reads or writes must be woken, not left on a number that is given away anew.
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        if self._waiting is not None:
            self._thread.join(timeout)
        self._socket.close()

    def _write_all(self) -> None:
        assert self._waiting is not None  # noqa: S101 # that is what started the thread
        while (parts := self._waiting.get()) is not None:
            try:
                self._write(parts)
            except OSError:
                return

    def _write(self, parts: list[memoryview]) -> None:
        head = b"".join([_COUNT.pack(len(parts)), *(_LENGTH.pack(part.nbytes) for part in parts)])
        self._socket.sendall(head)
        for part in parts:
            self._socket.sendall(part)

    def _read(self, length: int) -> bytearray:
        data = bytearray(length)
        view, start = memoryview(data), 0
        while start < length:
            try:
                count = self._socket.recv_into(view[start:])
            except OSError as error:
                raise EOFError("the other process is gone") from error
            if count == 0:
                raise EOFError("the other process is gone")
            start += count
        return data


def ready(channels: list[Channel], timeout: float | None = None) -> list[Channel]:
    """Return the channels that have a message, or lost their other end; wait up to `timeout` s for one."""
    with selectors.DefaultSelector() as selector:
        for channel in channels:
            selector.register(channel.fileno(), selectors.EVENT_READ)
        found = {key.fd for key, _ in selector.select(timeout)}
    return [channel for channel in channels if channel.fileno() in found]


class _Pickler(pickle.Pickler):
    """Also takes read-only mappings, of which settings are made."""

    def reducer_override(self, value: Any) -> Any:
        if type(value) is MappingProxyType:
            return _read_only, (dict(value),)
        return NotImplemented


def _read_only(values: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(values)


def pickled(value: Any, *, but: object = None) -> bytes:
    """Return a value as bytes; for `but`, which is part of it, there is only a mark. See `unpickled`."""
    data = io.BytesIO()
    _Marking(data, but).dump(value)
    return data.getvalue()


def unpickled(data: bytes, *, but: object = None) -> Any:
    """Return what `pickled` was given, with `but` where the mark is: the same thing, in this process."""
    return _Marked(data, but).load()


class _Marking(_Pickler):
    """Leaves one object out."""

    def __init__(self, data: io.BytesIO, but: object) -> None:
        super().__init__(data, protocol=5)
        self._but = but

    def persistent_id(self, value: Any) -> str | None:
        return "but" if value is self._but and value is not None else None


class _Marked(pickle.Unpickler):
    """Puts an object where one was left out."""

    def __init__(self, data: bytes, but: object) -> None:
        super().__init__(io.BytesIO(data))
        self._but = but

    def persistent_load(self, _: Any) -> object:
        return self._but


def _parts(message: Any) -> list[memoryview]:
    """Return a message as the parts that are written: its pickle and its arrays' bytes."""
    data, buffers = io.BytesIO(), list[pickle.PickleBuffer]()
    _Pickler(data, protocol=5, buffer_callback=buffers.append).dump(message)
    return [memoryview(data.getvalue()), *(buffer.raw() for buffer in buffers)]
