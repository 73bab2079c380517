"""Operating-system services: file locks, priority, memory, child processes and signals."""

from __future__ import annotations

import ctypes
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType
from typing import Any, Final

import filelock
import psutil

from sketchterrain.errors import InputError, SketchterrainError, one_line
from sketchterrain.io.files import wrap_os_errors

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl
    import resource

_LOCKED_BYTE = 0x7FFFFFFE
"""Offset of the locked byte on Windows: past any content, as locked bytes cannot be written."""


def lock_file(descriptor: int, *, wait: bool = False) -> None:
    """Acquire an exclusive lock on an open file until it is closed; raise BlockingIOError if it is locked."""
    if sys.platform == "win32":
        os.lseek(descriptor, _LOCKED_BYTE, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            raise BlockingIOError(*error.args) from None
    else:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))


def lock_folder(folder: Path, *, wait: bool = False) -> int | None:
    """Return a descriptor with an exclusive lock on a folder, None if unsupported; raise BlockingIOError."""
    if sys.platform == "win32":
        return None
    else:  # noqa: RET505
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            lock_file(descriptor, wait=wait)
        except BlockingIOError:
            os.close(descriptor)
            raise
        except OSError:  # some network file systems have no locks
            os.close(descriptor)
            return None
        return descriptor


def unlock_folder(lock: int | None) -> None:
    """Release the lock that `lock_folder` returned."""
    if lock is not None:
        os.close(lock)


@contextmanager
def exclusive_run(output: Path) -> Iterator[None]:
    """Hold the lock of an output; raise InputError if another run holds it."""
    path = output.with_name(f".{output.name}.lock")
    with wrap_os_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = filelock.FileLock(path)
        try:
            lock.acquire(timeout=0)
        except filelock.Timeout:
            raise InputError(f"{one_line(output)}: another run is writing it") from None
    try:
        yield
    finally:
        with suppress(PermissionError):  # Windows does not delete an open file
            path.unlink(missing_ok=True)
        lock.release()


def lower_priority(increment: int) -> None:
    """Lower the scheduling priority of this process by an increment of its nice value, 0 to 19."""
    if sys.platform == "win32":
        psutil.Process().nice(psutil.BELOW_NORMAL_PRIORITY_CLASS)
    else:
        os.nice(increment)


def physical_memory() -> int:
    """Return the memory of this machine, bytes."""
    return int(psutil.virtual_memory().total)


def free_memory() -> int:
    """Return the memory that programs can have without swapping, bytes."""
    return int(psutil.virtual_memory().available)


def resident_memory(process: int | None = None) -> int:
    """Return the resident memory of a process, by default this one, bytes; 0 if it has ended."""
    try:
        return int(psutil.Process(process).memory_info().rss)
    except psutil.NoSuchProcess:
        return 0


def peak_memory() -> int:
    """Return the peak resident memory of this process, bytes."""
    if sys.platform == "win32":
        return int(psutil.Process().memory_info().peak_wset)
    else:  # noqa: RET505
        status = Path("/proc/self/status")
        if status.exists():  # getrusage would include the parent before the exec
            (peak,) = re.findall(r"^VmHWM:\s*(\d+) kB", status.read_text(encoding="utf-8"), re.MULTILINE)
            return 1024 * int(peak)
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def release_freed_memory() -> None:
    """Return to the system what the C library keeps of freed memory, if it is glibc."""
    with suppress(AttributeError, OSError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


_MAX_LINE: Final = 200  # characters of the last line of stderr
# Words in a driver's stderr, and remedies.
_LINKER: Final = ("linker", "'ld'", '"ld"')
_INSTALL_LINKER: Final = "install a linker: apt install gcc libc6-dev"
_INSTALL_DRIVER: Final = "update or reinstall the driver"


class ChildFailedError(SketchterrainError):
    """A child process crashed, hung, did not start or exited with an error."""


class ChildTimedOutError(ChildFailedError):
    """A child process did not end in time, perhaps because of the load of the machine."""


def run_child(
    command: Sequence[str], *, name: str, timeout: float, environment: Mapping[str, str] | None = None
) -> None:
    """Run a command; raise ChildFailedError, with `name` and the reason, unless it exits with 0."""
    try:
        child = subprocess.run(  # noqa: S603
            command,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=timeout,
            check=False,
            env=environment,
        )
    except subprocess.TimeoutExpired:
        raise ChildTimedOutError(f"{name} did not answer within {timeout:g} s") from None
    except OSError as error:
        raise ChildFailedError(f"{name} did not start: {error}") from error
    if child.returncode:
        raise ChildFailedError(_failure(name, child.returncode, child.stderr))


def module_command(module: str, *arguments: str) -> list[str]:
    """Return the command that runs a module in a child process, never one of the working directory."""
    return [sys.executable, "-P", "-m", module, *arguments]


def module_result(
    module: str, *arguments: str, name: str, timeout: float, environment: Mapping[str, str] | None = None
) -> bytes:
    """Run a module in a child process, and return the bytes that it writes to the file in its last argument.

    It does not use stdout, to which drivers write.
    """
    with TemporaryDirectory(prefix="sketchterrain-child-") as folder:
        file = Path(folder) / "result"
        command = module_command(module, *arguments, str(file))
        run_child(command, name=name, timeout=timeout, environment=environment)
        try:
            return file.read_bytes()
        except FileNotFoundError:  # a driver that exits the process with code 0
            raise ChildFailedError(f"{name} exited early") from None


def _failure(name: str, code: int, errors: str) -> str:
    lines = [one_line(line.strip()[:_MAX_LINE]) for line in errors.splitlines() if line.strip()]
    if code > 0:
        return lines[-1] if lines else f"{name} failed with code {code}"
    reason = next((line for line in lines if "error" in line.lower()), lines[-1] if lines else "")
    remedy = _INSTALL_LINKER if any(word in errors for word in _LINKER) else _INSTALL_DRIVER
    return "; ".join([f"{name} crashed ({_signal(-code)})" + (f": {reason}" if reason else ""), remedy])


def _signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


@contextmanager
def sigterm_as_interrupt() -> Iterator[None]:
    """Raise KeyboardInterrupt on SIGTERM; do nothing off the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def restore_default_sigterm() -> None:
    """Restore the default action of SIGTERM."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


class Interrupts:
    """Defer the first signal until `check`; a second one raises at once. Other threads get no signals."""

    def __init__(self) -> None:
        self.pending = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Interrupts:
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._handle)
        return self

    def __exit__(self, *_: object) -> None:
        for number, before in self._before.items():
            signal.signal(number, before)

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal is pending."""
        if self.pending:
            raise KeyboardInterrupt

    def _handle(self, _: int, __: FrameType | None) -> None:
        if self.pending:
            raise KeyboardInterrupt
        self.pending = True
