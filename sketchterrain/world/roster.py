"""Which worker of a cluster does which task, and what becomes of tasks whose worker is lost: pure logic."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from sketchterrain.errors import DeviceError, SketchterrainError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from sketchterrain.world.made import Task

__all__ = ["LOSSES", "Member", "Roster", "Seen"]

LOSSES: Final = 10
"""How many workers a task may take along, and how often in a row a worker may be lost while it prepares."""


@dataclass(frozen=True)
class Seen:
    """A worker as the scheduler tells of it.

    Attributes
    ----------
    name : str
    host : str
        Its machine.
    """

    name: str
    host: str


@dataclass
class Member:
    """A worker that was seen.

    Attributes
    ----------
    name : str
        As people call it.
    host : str
    turn : int
        Which of its machine's workers it is, from 0.
    at_once : int
        Tasks that it takes at once; 0 until it is ready.
    refused : str
        Why it gets none; empty where it does.
    tasks : set of Task
        That it is at.
    """

    name: str
    host: str
    turn: int
    at_once: int = 0
    refused: str = ""
    tasks: set[Task] = field(default_factory=set)


class Roster:
    """Workers by address, and tasks until they are done.

    Parameters
    ----------
    tasks
        Taken as they are handed out.

    Attributes
    ----------
    members : dict of str to Member
        By address.
    """

    def __init__(self, tasks: Iterable[Task]) -> None:
        self.members: dict[str, Member] = {}
        self._tasks, self._again = iter(tasks), deque["Task"]()
        self._exhausted = False
        self._losses: Counter[Task | str] = Counter()

    @property
    def over(self) -> bool:
        """Whether all tasks are done."""
        return self._exhausted and not (self.at_work or self._again)

    @property
    def at_work(self) -> bool:
        """Whether any worker is at a task."""
        return any(member.tasks for member in self.members.values())

    @property
    def has_ready(self) -> bool:
        """Whether any worker takes tasks."""
        return any(member.at_once for member in self.members.values())

    def check(self) -> None:
        """Go on only if some worker takes tasks or may still do so; none being there yet is no reason to end.

        Raises
        ------
        DeviceError
            Naming each worker, and why it was refused.
        """
        members = self.members.values()
        if members and all(member.refused for member in members):
            told = "; ".join(f"{member.name}: {member.refused}" for member in members)
            raise DeviceError(f"no worker is left: {told}")

    def update(self, seen: Mapping[str, Seen]) -> list[Member]:
        """Take note of the workers that there are; return those that are lost.

        Raises
        ------
        SketchterrainError
            If a task took too many workers along.
        """
        lost = [self._lose(address) for address in self.members.keys() - seen.keys()]
        for address, each in seen.items():
            if address not in self.members:
                taken = {member.turn for member in self.members.values() if member.host == each.host}
                turn = next(turn for turn in range(len(taken) + 1) if turn not in taken)
                self.members[address] = Member(each.name, each.host, turn)
        return lost

    def ready(self, address: str, name: str, at_once: int) -> None:
        """Let a worker take tasks."""
        member = self.members[address]
        self._losses.pop(member.name, None)
        member.name, member.at_once = name, at_once

    def unprepared(self, address: str) -> None:
        """Let a worker take tasks only once it is ready again; those that it is at are to be done again."""
        member = self.members[address]
        member.at_once = 0
        self._return(member)

    def refuse(self, address: str, name: str, reason: str) -> None:
        """Give a worker no task any more; those that it is at go to others."""
        member = self.members[address]
        member.name, member.refused, member.at_once = name, reason, 0
        self._return(member)

    def dies_preparing(self, name: str) -> bool:
        """Tell whether workers of a name were lost so often while they prepared that no other need try."""
        return self._losses[name] >= LOSSES

    def hand_out(self) -> Iterator[tuple[str, Task]]:
        """Give workers as many tasks as each takes at once; return addresses and tasks."""
        for address, member in self.members.items():
            while len(member.tasks) < member.at_once:
                task = self._take()
                if task is None:
                    return
                member.tasks.add(task)
                yield address, task

    def finished(self, address: str, task: Task) -> None:
        """Take note that a task is done."""
        self.members[address].tasks.discard(task)
        self._losses.pop(task, None)

    def _take(self) -> Task | None:
        # Those that were lost come last: should one of them be what kills workers, all others are done.
        task = next(self._tasks, None)
        self._exhausted = task is None
        return self._again.popleft() if task is None and self._again else task

    def _return(self, member: Member) -> None:
        self._again.extend(sorted(member.tasks))
        member.tasks.clear()

    def _lose(self, address: str) -> Member:
        member = self.members.pop(address)
        for task in member.tasks:
            self._losses[task] += 1
            if self._losses[task] >= LOSSES:
                where = f"{task.kind} of shard {task.row},{task.column} of level {task.level}"
                raise SketchterrainError(f"{LOSSES} workers died at the {where}, last {member.name}")
        if not (member.at_once or member.refused):
            self._losses[member.name] += 1
        self._return(member)
        return member
