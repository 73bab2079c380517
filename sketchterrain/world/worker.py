"""What runs in the workers of a cluster: each checks itself once, then makes tasks."""

from __future__ import annotations

import errno
import socket
import time
from dataclasses import replace
from threading import Condition, Event, Lock
from typing import TYPE_CHECKING, Any

from sketchterrain.errors import DeviceError, SketchterrainError, one_line
from sketchterrain.world.made import Task
from sketchterrain.world.order import Failed, Ready, Refused, called, unpacked

if TYPE_CHECKING:
    from sketchterrain.world.made import Made

__all__ = ["leave", "make", "prepare", "stop"]

_FORGOTTEN = 600.0  # s after which what another run left behind is dropped
_AT_ONCE = {"GPU": 8}  # tasks at most: a GPU evaluates faster than a core packs
_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_benches: dict[tuple[str, str], _Bench] = {}  # of an order and a worker's address
_preparing = Lock()


class _Bench:
    """What a worker keeps of one order."""

    def __init__(self, name: str, order: dict[str, Any], turn: int, threads: int) -> None:
        from sketchterrain.world.worker_checks import (
            bits_of,
            check_device,
            check_folder,
            check_program,
            own_device,
        )

        check_program(order)
        check_folder(order)
        # Only now: what reads them must be the program that wrote them.
        from sketchterrain.compute import ComputeContext
        from sketchterrain.world.making import Maker

        device = own_device(order["device"], turn)
        check_device(device)
        job = unpacked(order)
        self._order, self._name = order, name
        self._maker = Maker(job, ComputeContext(device, fast=job.fast))
        self._device, self._stopped = Lock(), Event()
        self._change, self._works = Condition(), 0
        self._used = time.monotonic()
        at_once = min(threads, _AT_ONCE.get(device.type, 2))
        self.ready = Ready(name, f"{device.name} ({device.platform})", bits_of(self._maker), at_once)

    def make(self, task: Task) -> Made | Refused | Failed | None:
        """Do a task; None if it was told to stop meanwhile."""
        with self._change:
            self._works += 1
        try:
            with self._device:
                if self._stopped.is_set():
                    return None
                begun = self._maker.begin(task)
            if self._stopped.is_set():
                return None
            return replace(self._maker.end(begun), worker=self._name)
        except DeviceError as error:
            return Refused(self._name, one_line(error))
        except MemoryError:
            return Refused(self._name, "out of memory")
        except (SketchterrainError, OSError) as error:
            return self._told(error)
        finally:
            with self._change:
                self._works -= 1
                self._used = time.monotonic()
                self._change.notify_all()

    def stop(self) -> None:
        """Begin nothing more, and write nothing that is not begun."""
        self._stopped.set()

    def wait(self) -> None:
        """Wait until nothing is being done."""
        with self._change:
            self._change.wait_for(lambda: self._works == 0)

    def idle_since(self, moment: float) -> bool:
        """Tell whether nothing was done since a moment of the monotonic clock, s."""
        return self._works == 0 and self._used < moment

    def _told(self, error: SketchterrainError | OSError) -> Refused | Failed:
        """Return whether it is this worker alone that cannot write; a full disk is everyone's."""
        from sketchterrain.world.worker_checks import RefusedError, check_folder

        if not any(isinstance(each, OSError) and each.errno in _FULL for each in (error, error.__cause__)):
            try:
                check_folder(self._order)
            except RefusedError as refused:
                return Refused(self._name, one_line(refused))
        if isinstance(error, SketchterrainError):
            return Failed(self._name, error)
        reason = error.strerror or str(error)
        where = f"{error.filename}: " if error.filename else ""
        return Failed(self._name, SketchterrainError(one_line(f"{where}{reason}")))


def prepare(order: str, turn: int) -> Ready | Refused:
    """Check the worker that this runs in, and open its device for an order.

    Parameters
    ----------
    order
        Where the scheduler's metadata hold it.
    turn
        Which of its machine's workers this one is, from 0.
    """
    from distributed import get_worker
    from distributed.utils import sync

    worker = get_worker()
    name = _name_of(worker)
    try:
        told = sync(worker.loop, worker.scheduler.get_metadata, keys=[order], default=None)
        if told is None:
            return Refused(name, "the scheduler does not know what is to be made")
        with _preparing:
            _forget_old()
            bench = _Bench(name, told, turn, worker.state.nthreads)
            _benches[order, worker.address] = bench
        return bench.ready
    except SketchterrainError as error:
        return Refused(name, one_line(error))
    except Exception as error:  # noqa: BLE001 - whatever it is, this worker cannot do it
        return Refused(name, one_line(f"{type(error).__name__}: {error}"))


def make(order: str, kind: str, level: int, row: int, column: int) -> Made | Refused | Failed | None:
    """Do a task in a worker that is prepared; None if it is not, or was told to stop."""
    from distributed import get_worker

    bench = _benches.get((order, get_worker().address))
    if bench is None:
        return None
    return bench.make(Task("plants" if kind == "plants" else "ground", level, row, column))


def stop(order: str) -> None:
    """Let the workers of this process give up an order, as soon as that leaves no half file."""
    for key, bench in list(_benches.items()):
        if key[0] == order:
            bench.stop()


def leave(order: str) -> None:
    """Forget an order in the worker that this runs in, once nothing of it is being done."""
    from distributed import get_worker

    bench = _benches.pop((order, get_worker().address), None)
    if bench is not None:
        bench.stop()
        bench.wait()


def _forget_old() -> None:
    before = time.monotonic() - _FORGOTTEN
    for key in [key for key, bench in _benches.items() if bench.idle_since(before)]:
        del _benches[key]


def _name_of(worker: Any) -> str:
    """Return what people call a worker: its name if it was given one, and its machine."""
    name = called(worker.name)
    # A number is one of this machine's; without a name it is called by its address.
    return name if name != str(worker.name) or "://" in name else f"{name} on {socket.gethostname()}"
