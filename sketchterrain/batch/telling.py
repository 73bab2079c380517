"""How a batch goes on, on stderr: a bar and what is in work on a terminal, a line a terrain elsewhere."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from sketchterrain.batch.remaining import Remaining, duration

if TYPE_CHECKING:
    from collections.abc import Hashable, Sequence

    from rich.progress import Progress, TaskID

    from sketchterrain.batch.manifest import Entry
    from sketchterrain.batch.plan import Item

__all__ = ["Telling"]


class Telling:
    """The :class:`~sketchterrain.batch.crew.Watcher` of the command line.

    Use it as a context manager: a bar must be taken off the terminal however the command ends.
    """

    def __init__(self, remaining: Remaining | None = None) -> None:
        self._bars: Progress | None = _bars() if sys.stderr.isatty() else None
        self._remaining = remaining or Remaining()
        self._given = remaining
        self._left: dict[str, Item] = {}
        self._in_work: dict[str, TaskID] = {}
        self._all: TaskID | None = None
        self._checked: TaskID | None = None
        self._done = self._failed = self._items = 0

    def __enter__(self) -> Telling:
        if self._bars is not None:
            self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bars is not None:
            self._bars.stop()

    def checking(self, number: int, items: int) -> None:
        """Show how much of what is there has been looked at."""
        if self._bars is not None:
            if self._checked is None:
                self._checked = self._bars.add_task("Looking at what is there", total=items, left="")
            self._bars.update(self._checked, completed=number + 1)

    def begins(self, items: Sequence[Item], skipped: int) -> None:
        """Show how many there are."""
        self._remaining = self._given or Remaining()  # the time runs from now
        self._left = {item.name: item for item in items}
        self._items = len(items)
        if self._bars is not None:
            if self._checked is not None:
                self._bars.remove_task(self._checked)
            self._all = self._bars.add_task(f"0 of {self._items} terrains", total=self._items, left="")
        if skipped:
            self._say(f"{skipped} of {skipped + self._items} terrains are there and unchanged")

    def stage(self, item: Item, title: str) -> None:
        """Show what is in work."""
        self._remaining.begins(item.name)
        if self._bars is None:
            return
        if item.name not in self._in_work:
            self._in_work[item.name] = self._bars.add_task("", total=None, left="")
        self._bars.update(self._in_work[item.name], description=f"{item.name}: {title}")

    def finished(self, item: Item, entry: Entry) -> None:
        """Show what came of a terrain, and how long the others will take."""
        self._done += 1
        self._left.pop(item.name, None)
        if entry.state == "failed":
            self._failed += 1
            self._remaining.failed(item.name)
        else:
            self._remaining.finished(item.name, _kind(item), entry.seconds)
        seconds = self._remaining.seconds({name: _kind(each) for name, each in self._left.items()})
        left = "" if seconds is None or not self._left else f"about {duration(seconds)} left"
        took = f"failed: {entry.error}" if entry.state == "failed" else f"{entry.seconds:.1f} s"
        if entry.state == "partial":
            took += f", no preview: {entry.error}"
        if self._bars is None:
            self._say(f"[{self._done}/{self._items}] {item.name}: {took}{left and '; '}{left}")
            return
        if item.name in self._in_work:
            self._bars.remove_task(self._in_work.pop(item.name))
        if entry.state == "failed":
            self._say(f"{item.name}: {took}")
        if self._all is not None:
            failed = f", {self._failed} failed" if self._failed else ""
            text = f"{self._done} of {self._items} terrains{failed}"
            self._bars.update(self._all, description=text, completed=self._done, left=left)

    def stops(self) -> None:
        """Say why it does not end at once."""
        self._say("stopping: what is in work is given up, what is done stays …")

    def _say(self, line: str) -> None:
        if self._bars is None:
            sys.stderr.write(f"{line}\n")
        else:
            self._bars.console.print(line, markup=False, highlight=False)


def _kind(item: Item) -> Hashable:
    """Terrains of one sketch with the same settings take about the same time."""
    return item.source.name, tuple(item.settings.items())


def _bars() -> Progress:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    text, left = (
        TextColumn("{task.description}", markup=False),
        TextColumn("{task.fields[left]}", markup=False),
    )
    return Progress(text, BarColumn(), TimeElapsedColumn(), left, console=Console(stderr=True))
