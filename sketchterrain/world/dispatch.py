"""Tasks handed to the workers of a scheduler, and what is done with their answers."""

from __future__ import annotations

import queue
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple

from sketchterrain.errors import SketchterrainError, one_line
from sketchterrain.world import worker as done_there
from sketchterrain.world.made import Made
from sketchterrain.world.order import Failed, Ready, Refused

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator

    from sketchterrain.world.made import Task
    from sketchterrain.world.roster import Member, Roster
    from sketchterrain.world.scheduler import Connection

__all__ = ["Dispatch"]

_LOOK = 1.0  # s between two looks at which workers there are
_EARLY_LOOK = 0.2  # s, while none of them is ready
_PATIENCE = 60.0  # s without any worker
_LATE, _LATER = 600.0, 20.0  # s, and times the longest so far, after which an answer will not come


class _Asked(NamedTuple):
    """What was asked of a worker: a task, or that it prepares."""

    address: str
    task: Task | None
    future: Any
    since: float


class Dispatch:
    """Hands out tasks until all are done.

    Each worker gets as many tasks as it does at once: the scheduler has none that wait, so that a lost
    worker costs what it is at, and a world of any size no memory.

    Parameters
    ----------
    connection
        With the scheduler.
    order
        What workers need to know.
    bits
        That all workers must compute; None: those of the first one.
    note
        Told a line where a worker is refused or lost.
    stopped
        Tells whether what is begun is to be the last.
    reason
        Tells why there may be no worker; empty where that is not known.
    """

    def __init__(
        self,
        connection: Connection,
        order: dict[str, Any],
        *,
        bits: str | None,
        note: Callable[[str], None],
        stopped: Callable[[], bool],
        reason: Callable[[], str],
    ) -> None:
        self._connection, self._bits = connection, bits
        self._note, self._stopped, self._reason = note, stopped, reason
        self._asked: dict[Any, _Asked] = {}
        self._answers: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._looked = self._accompanied = time.monotonic()
        self._longest = 0.0
        self._gone = False
        self._connection.post(order)

    def run(self, roster: Roster) -> Iterator[Made]:
        """Have all tasks done.

        Raises
        ------
        DeviceError
            If no worker is left.
        SketchterrainError
            If the scheduler is gone, a task cannot be done, or no worker comes.
        """
        try:
            self._look(roster)
            while roster.at_work or not (roster.over or self._stopped()):
                if time.monotonic() - self._looked > (_LOOK if roster.has_ready else _EARLY_LOOK):
                    self._look(roster)
                for address, task in () if self._stopped() else roster.hand_out():
                    self._ask(address, task, done_there.make, *task)
                done = self._next(roster)
                if done is not None:
                    yield done
        finally:
            if not self._gone:
                self._drop(self._asked.values())

    def end(self) -> None:
        """Have no worker do anything more; return once none writes."""
        if not self._gone:
            with suppress(SketchterrainError):
                self._connection.end()

    def _look(self, roster: Roster) -> None:
        """See which workers there are, and have new ones prepare."""
        try:
            there = self._connection.workers()
        except SketchterrainError:
            self._gone = True
            raise
        self._looked = time.monotonic()
        if there:
            self._accompanied = self._looked
        elif self._looked - self._accompanied > _PATIENCE:
            reason = self._reason()
            told = f"{self._connection.told} has had no worker for {_PATIENCE:.0f} s"
            raise SketchterrainError(f"{told}: {reason}" if reason else told)
        for member in roster.update(there):
            self._note(f"{member.name} is lost: what it was at is done again")
        self._drop([asked for asked in self._asked.values() if asked.address not in roster.members])
        preparing = {asked.address for asked in self._asked.values() if asked.task is None}
        for address, member in roster.members.items():
            if address not in preparing and not (member.at_once or member.refused):
                self._prepare(roster, address, member)
        late = self._looked - max(_LATE, _LATER * self._longest)
        overdue = {asked.address: asked.since for asked in self._asked.values() if asked.since < late}
        for address, since in overdue.items():
            name = roster.members[address].name
            self._refuse(roster, address, name, f"no answer for {self._looked - since:.0f} s")
        roster.check()

    def _prepare(self, roster: Roster, address: str, member: Member) -> None:
        if roster.dies_preparing(member.name):
            self._refuse(roster, address, member.name, "it died again and again while it prepared")
        else:
            self._ask(address, None, done_there.prepare, member.turn)

    def _ask(self, address: str, task: Task | None, work: Callable[..., Any], *given: object) -> None:
        future = self._connection.submit(work, *given, worker=address)
        self._asked[future.key] = _Asked(address, task, future, time.monotonic())
        future.add_done_callback(lambda done: self._answers.put(done.key))

    def _next(self, roster: Roster) -> Made | None:
        """Wait a little for an answer and act upon it; return what was made, if something was."""
        try:
            asked = self._asked.pop(self._answers.get(timeout=_EARLY_LOOK), None)
        except queue.Empty:
            return None
        if asked is None or asked.address not in roster.members:
            return None  # of a worker that is lost or refused
        answer = self._answer(asked, roster.members[asked.address].name)
        if isinstance(answer, Made) and asked.task is not None:
            roster.finished(asked.address, asked.task)
            self._longest = max(self._longest, time.monotonic() - asked.since)
            return answer
        if isinstance(answer, Failed):
            raise answer.error
        if isinstance(answer, Ready):
            self._ready(roster, asked.address, answer)
        elif isinstance(answer, Refused):
            self._refuse(roster, asked.address, answer.worker, answer.reason)
            roster.check()
        else:
            self._drop([each for each in self._asked.values() if each.address == asked.address])
            roster.unprepared(asked.address)
        return None

    def _answer(self, asked: _Asked, name: str) -> object:
        """Return what a worker answered; None if the answer is lost."""
        from distributed.scheduler import KilledWorker

        if asked.future.status == "error":
            error = asked.future.exception()
            if isinstance(error, KilledWorker):
                return None
            if "deserialization of the task graph" in str(error):
                told = f"{self._connection.told} cannot load sketchterrain: it must be installed there, too"
                raise SketchterrainError(told) from error
            if asked.task is not None:
                raise error
            return Refused(name, one_line(f"{type(error).__name__}: {error}"))
        return self._connection.result(asked.future)

    def _ready(self, roster: Roster, address: str, answer: Ready) -> None:
        if self._bits is None:
            self._bits = answer.bits
        if answer.bits == self._bits:
            roster.ready(address, answer.worker, answer.at_once)
            return
        self._refuse(roster, address, answer.worker, f"{answer.device} computes other bits of this world")
        roster.check()

    def _refuse(self, roster: Roster, address: str, name: str, reason: str) -> None:
        self._drop([asked for asked in self._asked.values() if asked.address == address])
        roster.refuse(address, name, reason)
        self._note(f"{name} is refused: {reason}")

    def _drop(self, asked: Collection[_Asked]) -> None:
        dropped = [each.future for each in asked]
        for future in dropped:
            del self._asked[future.key]
        self._connection.cancel(dropped)
