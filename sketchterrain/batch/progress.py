"""Progress of a batch on stderr: bars with the remaining time on a terminal, elsewhere a line a terrain."""

import sys

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from sketchterrain.batch.manifest import Entry


class BatchProgress:
    """Report how a batch goes on; several threads may call it. Use it as a context manager."""

    def __init__(self) -> None:
        text, elapsed = TextColumn("{task.description}", markup=False), TimeElapsedColumn()
        columns = (text, BarColumn(), elapsed, TimeRemainingColumn())
        self._bars = Progress(
            *columns,
            console=Console(stderr=True, markup=False, emoji=False, highlight=False, soft_wrap=True),
            disable=not sys.stderr.isatty(),
            speed_estimate_period=3600.0,
        )
        self._tasks: dict[str, TaskID] = {}
        self._items = self._done = self._failed = 0

    def __enter__(self) -> "BatchProgress":
        self._bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bars.stop()

    def verified(self, number: int, items: int) -> None:
        """Report how many items were compared with their files."""
        self._show("", "Verifying existing terrains", number, items)

    def begins(self, items: int, skipped: int) -> None:
        """Report how many terrains will be made, and how many are there."""
        self._items = items
        self._remove("")
        if skipped:
            self._bars.console.print(f"{skipped} of {skipped + items} terrains are there and unchanged")
        self._show("", f"0 of {items} terrains", 0, items)

    def stage(self, name: str, title: str) -> None:
        """Report what is being done for an item."""
        self._show(name, f"{name}: {title}")

    def finished(self, entry: Entry) -> None:
        """Report the result of an item."""
        self._done += 1
        self._failed += entry.state == "failed"
        self._remove(entry.name)
        result = f"failed: {entry.error}" if entry.state == "failed" else f"{entry.seconds:.1f} s"
        missing = f", no preview: {entry.error}" if entry.state == "partial" else ""
        if self._bars.disable or entry.state != "done":
            self._bars.console.print(f"[{self._done}/{self._items}] {entry.name}: {result}{missing}")
        failed = f", {self._failed} failed" if self._failed else ""
        self._show("", f"{self._done} of {self._items} terrains{failed}", self._done, self._items)

    def stops(self) -> None:
        """Report that the batch ends before all is done."""
        self._bars.console.print("stopping: terrains in work are given up, finished ones stay …")

    def _show(self, name: str, text: str, done: int = 0, total: int | None = None) -> None:
        if name not in self._tasks:
            self._tasks[name] = self._bars.add_task(text, total=total)
        self._bars.update(self._tasks[name], description=text, completed=done)

    def _remove(self, name: str) -> None:
        if name in self._tasks:
            self._bars.remove_task(self._tasks.pop(name))
