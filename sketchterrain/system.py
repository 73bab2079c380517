"""Calls that differ between POSIX and Windows: file locks, process priority and memory.

The platforms are branches of if and else, after return too, since mypy takes only these for a platform's own.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

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
