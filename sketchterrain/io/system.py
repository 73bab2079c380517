"""Operating-system services: file locks, priority, memory, child processes and signals."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType
from typing import Any, Final

from sketchterrain.errors import SketchterrainError, one_line

if sys.platform == "win32":
    import msvcrt

    import psutil
else:
    import fcntl
    import resource

_LOCKED_BYTE = 0x7FFFFFFE
"""Offset of the byte that a lock covers on Windows: past any content, for locked bytes cannot be written."""


def lock_file(descriptor: int, *, wait: bool = False) -> None:
    """Take an exclusive lock on an open file; it ends when the file is closed."""
    if sys.platform == "win32":
        os.lseek(descriptor, _LOCKED_BYTE, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            raise BlockingIOError(*error.args) from None
    else:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))


def lock_folder(folder: Path, *, wait: bool = False) -> int | None:
    """Return a descriptor that holds an exclusive lock on a folder, or None where folders have no locks."""
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
    """Release what `lock_folder` returned."""
    if lock is not None:
        os.close(lock)


def lower_priority(increment: int) -> None:
    """Lower the scheduling priority of this process by an increment of its nice value, 0 to 19."""
    if sys.platform == "win32":
        psutil.Process().nice(psutil.BELOW_NORMAL_PRIORITY_CLASS)
    else:
        os.nice(increment)


def cpu_count() -> int:
    """Return the number of CPUs that this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    else:  # noqa: RET505
        return os.cpu_count() or 1


def physical_memory() -> int:
    """Return the memory of this machine, bytes."""
    if sys.platform == "win32":
        return int(psutil.virtual_memory().total)
    else:  # noqa: RET505
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def resident_memory(process: int) -> int | None:
    """Return the resident memory of a process, bytes; None if it has ended or the system does not tell."""
    if sys.platform == "win32":
        return int(psutil.Process(process).memory_info().rss) if psutil.pid_exists(process) else None
    else:  # noqa: RET505
        try:
            pages = Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1]
        except OSError:
            return None
        return int(pages) * os.sysconf("SC_PAGE_SIZE")


def memory_in_use() -> int:
    """Return the resident memory of this process, or its peak where the system tells no more, bytes."""
    found = resident_memory(os.getpid())
    return peak_memory() if found is None else found


def peak_memory() -> int:
    """Return the peak resident memory of this process, bytes."""
    if sys.platform == "win32":
        return int(psutil.Process().memory_info().peak_wset)
    else:  # noqa: RET505
        told = proc_memory("self/status", "VmHWM")  # getrusage would include the parent before the exec
        if told is not None:
            return told
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def proc_memory(file: str, name: str) -> int | None:
    """Return an amount of memory from a file under ``/proc``, bytes; None where there is no such entry."""
    path = Path("/proc", file)
    if path.exists():
        for line in path.read_text(encoding="utf-8").splitlines():
            if line.startswith(f"{name}:"):
                return int(line.split()[1]) * 1024
    return None


_LONGEST: Final = 200  # characters of the line that the child wrote last
# Words that a driver writes to stderr before it aborts, and what helps.
_LINKER: Final = ("linker", "'ld'", '"ld"')
_INSTALL_LINKER: Final = "install a linker: apt install gcc libc6-dev"
_INSTALL_DRIVER: Final = "update or reinstall the driver"


class ChildFailedError(SketchterrainError):
    """A child process crashed, hung, did not start or exited with an error; the message is one line."""


class ChildTimedOutError(ChildFailedError):
    """A child process did not answer in time; the load of the machine may be why."""


def run_child(
    command: Sequence[str], *, name: str, timeout: float, environment: Mapping[str, str] | None = None
) -> None:
    """Run a command and wait for it."""
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


def module_result(
    module: str, *arguments: str, name: str, timeout: float, environment: Mapping[str, str] | None = None
) -> bytes:
    """Run a module of the program in a child, and return the bytes that it wrote into the file given last.

    Its stdout and stderr are left to drivers.
    """
    with TemporaryDirectory(prefix="sketchterrain-child-") as folder:
        file = Path(folder) / "result"
        command = [sys.executable, "-m", module, *arguments, str(file)]
        run_child(command, name=name, timeout=timeout, environment=environment)
        try:
            return file.read_bytes()
        except FileNotFoundError:  # a driver that exits the process with code 0
            raise ChildFailedError(f"{name} exited early") from None


def _failure(name: str, code: int, errors: str) -> str:
    lines = [one_line(line.strip()[:_LONGEST]) for line in errors.splitlines() if line.strip()]
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
    """Raise KeyboardInterrupt at a SIGTERM; off the main thread, leave signals as they are."""
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
    """Let a SIGTERM end this process as the system does it."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


class Interrupts:
    """Defer the first signal until `check`; a second one raises at once. Other threads get no signals."""

    def __init__(self) -> None:
        self.heard = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Interrupts:
        if threading.current_thread() is threading.main_thread():
            for each in (signal.SIGINT, signal.SIGTERM):
                self._before[each] = signal.signal(each, self._hear)
        return self

    def __exit__(self, *_: object) -> None:
        for each, before in self._before.items():
            signal.signal(each, before)

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal came."""
        if self.heard:
            raise KeyboardInterrupt

    def _hear(self, _: int, __: FrameType | None) -> None:
        if self.heard:
            raise KeyboardInterrupt
        self.heard = True
