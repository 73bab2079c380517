"""How a world goes on: on stderr a bar on a terminal, a line now and then elsewhere, or where it is told."""

from __future__ import annotations

import sys
import time
from collections import Counter, defaultdict
from statistics import median
from typing import TYPE_CHECKING, Final

from sketchterrain.batch.remaining import duration
from sketchterrain.errors import one_line

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rich.progress import Progress, TaskID

    from sketchterrain.world.grid import World
    from sketchterrain.world.made import Made, Task
    from sketchterrain.world.verification import Broken

__all__ = ["Remaining", "Telling"]

_QUIET: Final = 10.0  # s between two lines, where there is no terminal
_NAMED: Final = 10  # files that are missing or broken; --json has them all
_RECENT: Final = 25  # tasks: machines get busier and idle again


class Remaining:
    """How long the tasks that are left will take, by what others took: nothing while nothing is known.

    Shards take time by their vertices, each kind of task its own; where none of a kind is done yet, what the
    others took stands for it. Several are in work at once: that time is shared is measured, too.

    Parameters
    ----------
    timer
        Seconds that run on.
    """

    def __init__(self, timer: Callable[[], float] = time.perf_counter) -> None:
        self._timer = timer
        self._start = timer()
        self._took: dict[str, list[float]] = defaultdict(list)
        self._sum = 0.0

    def finished(self, kind: str, work: int, seconds: float) -> None:
        """Tell that so many vertices of a kind of task are done, and took so long."""
        self._took[kind] = [*self._took[kind][1 - _RECENT :], seconds / max(work, 1)]
        self._sum += seconds

    def seconds(self, left: Mapping[str, int]) -> float | None:
        """Return about how long the vertices that are left take, by kind; None before the first is done."""
        if not self._took:
            return None
        usual = {kind: median(took) for kind, took in self._took.items()}
        any_kind = median([each for took in self._took.values() for each in took])
        share = min((self._timer() - self._start) / max(self._sum, 1e-9), 1.0)
        return share * sum(usual.get(kind, any_kind) * work for kind, work in left.items())


class Telling:
    """The :class:`~sketchterrain.world.run.Watcher` of the command line and of the window.

    Use it as a context manager: a bar must be taken off the terminal however the command ends.

    Parameters
    ----------
    world
    plants
        Whether there are tasks of plants.
    show
        Takes what is being done, the share of it that is done and how long the rest takes; by default that
        is told on stderr.
    say
        Takes a line that stays; by default it goes to stderr.
    timer
        Seconds that run on.
    """

    def __init__(
        self,
        world: World,
        *,
        plants: bool,
        show: Callable[[str, float, str], None] | None = None,
        say: Callable[[str], None] | None = None,
        timer: Callable[[], float] = time.perf_counter,
    ) -> None:
        self._world, self._plants, self._timer = world, plants, timer
        self._bars: Progress | None = _bars() if show is None and sys.stderr.isatty() else None
        self._show, self._say = show or self._shown, say or self._said
        self._bar: TaskID | None = None
        self._told = timer()
        self._all = self._done = self._broken = 0
        self._left: Counter[str] = Counter()
        self._remaining = Remaining(timer)

    def __enter__(self) -> Telling:
        if self._bars is not None:
            self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bars is not None:
            self._bars.stop()

    def verified(self, share: float) -> None:
        """Show how much of what is there has been looked at."""
        self._show("Looking at what is there", share, "")

    def broken(self, file: Broken) -> None:
        """Tell of a file that will be made again; of very many only how many they are."""
        self._broken += 1
        if self._broken <= _NAMED:
            self._say(f"{one_line(file.file)} {file.why}: is made again")

    def began(self, tasks: int, done: int) -> None:
        """Show how many there are."""
        self._all, self._done = tasks, done
        if self._broken > _NAMED:
            self._say(f"and {self._broken - _NAMED} more files are made again")
        levels = self._world.levels
        self._left = Counter(ground=self._world.vertices)
        if self._plants:
            self._left["plants"] = levels[0].columns * levels[0].rows
        if done:
            self._say(f"{done} of {tasks} tasks are done and their files whole")
            share = 1.0 - done / tasks
            self._left = Counter({kind: round(share * work) for kind, work in self._left.items()})
        self._remaining = Remaining(self._timer)  # the time runs from now

    def made(self, made: Made) -> None:
        """Show that a task is done, and how long the others will take."""
        self._done += 1
        kind, work = made.task.kind, self._work(made.task)
        self._remaining.finished(kind, work, made.seconds)
        self._left[kind] = max(self._left[kind] - work, 0)
        seconds = self._remaining.seconds(self._left) if self._done < self._all else None
        left = "" if seconds is None else f"about {duration(seconds)} left"
        self._show(f"{self._done} of {self._all} tasks", self._done / self._all, left)

    def joined(self, share: float) -> None:
        """Show how much of what joins all is written."""
        self._show("Joining", share, "")

    def note(self, line: str) -> None:
        """Tell something that a person should know, once."""
        self._say(f"sketchterrain: note: {one_line(line)}")

    def _work(self, task: Task) -> int:
        from sketchterrain.world.grid import Shard

        level = self._world.levels[task.level]
        rows, columns = level.size_of(Shard(task.level, task.row, task.column))
        return rows * columns

    def _shown(self, text: str, share: float, left: str) -> None:
        if self._bars is not None:
            if self._bar is None:
                self._bar = self._bars.add_task("", total=1.0, left="")
            self._bars.update(self._bar, description=text, completed=share, left=left)
        elif self._timer() - self._told >= _QUIET:
            self._told = self._timer()
            self._say(f"{text}: {share:.0%}{left and ', '}{left}")

    def _said(self, line: str) -> None:
        if self._bars is None:
            sys.stderr.write(f"{line}\n")
        else:
            self._bars.console.print(line, markup=False, highlight=False)


def _bars() -> Progress:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    text, left = (
        TextColumn("{task.description}", markup=False),
        TextColumn("{task.fields[left]}", markup=False),
    )
    return Progress(text, BarColumn(), TimeElapsedColumn(), left, console=Console(stderr=True))
