"""Remaining time, budgets of memory and disk, contact sheets."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from sketchterrain.batch.manifest import Entry, File
from sketchterrain.batch.output import Output
from sketchterrain.batch.remaining import Remaining, duration
from sketchterrain.batch.room import Memory, memory_left, needs_of
from sketchterrain.batch.sheet import PAGE, sheets
from sketchterrain.disk import check_disk, disk_left
from sketchterrain.errors import InputError
from sketchterrain.export.target import ExportOptions
from sketchterrain.sketch import Sketch

if TYPE_CHECKING:
    from pathlib import Path


def test_remaining_time_adds_the_medians_of_each_kind() -> None:
    assert Remaining(lambda: 0.0).seconds({"1": "a"}) is None

    clock = [0.0]
    remaining = Remaining(lambda: clock[0])
    for kind, seconds in (("small", 1.0), ("small", 1.0), ("small", 40.0), ("large", 10.0)):
        remaining.begins("now")
        clock[0] += seconds
        remaining.finished("now", kind, seconds)
    assert remaining.seconds(left("small", "small", "small", "large")) == pytest.approx(13.0)
    assert remaining.seconds(left("unknown")) == pytest.approx(5.5)  # of all
    assert remaining.seconds({}) == 0.0


def left(*kinds: str) -> dict[str, str]:
    return {f"left-{number}": kind for number, kind in enumerate(kinds)}


def test_several_at_once_share_the_time() -> None:
    clock = [0.0]
    remaining = Remaining(lambda: clock[0])
    remaining.begins("1")
    remaining.begins("2")
    clock[0] = 10.0
    remaining.finished("1", "a", 10.0)
    assert remaining.seconds({"2": "a", **left(*"aaaaaaaa")}) == pytest.approx(40.0)  # the second is as far
    remaining.begins("3")
    clock[0] = 14.0
    assert remaining.seconds({"3": "a"}) == pytest.approx(6.0 * 14.0 / 28.0)


def test_remaining_time_ignores_failures_and_follows_recent_items() -> None:
    clock = [0.0]
    remaining = Remaining(lambda: clock[0])
    for seconds in (10.0, 1.0):
        remaining.begins("now")
        clock[0] += seconds
        if seconds > 5.0:
            remaining.finished("now", "a", seconds)
        else:
            remaining.failed("now")
    assert remaining.seconds(left("a", "a")) == pytest.approx(20.0)

    clock = [0.0]
    remaining = Remaining(lambda: clock[0])
    for seconds in [1.0] * 60 + [3.0] * 30:
        remaining.begins("now")
        clock[0] += seconds
        remaining.finished("now", "a", seconds)
    assert remaining.seconds(left("a")) == pytest.approx(3.0)


def test_durations_are_rounded_for_reading() -> None:
    for seconds, told in [
        (0.2, "1 s"),
        (40, "40 s"),
        (89, "89 s"),
        (90, "2 min"),
        (3600, "60 min"),
        (12000, "3 h 20 min"),
    ]:
        assert duration(seconds) == told, seconds


def test_terrains_begin_while_there_is_memory() -> None:
    memory = Memory(100.0)
    within, most, begun = [0], [0], threading.Semaphore(0)
    go_on = threading.Event()
    lock = threading.Lock()

    def work() -> None:
        with memory.room(40.0):
            with lock:
                within[0] += 1
                most[0] = max(most[0], within[0])
            begun.release()
            go_on.wait(10)
            with lock:
                within[0] -= 1

    threads = [threading.Thread(target=work) for _ in range(5)]
    for thread in threads:
        thread.start()
    assert begun.acquire(timeout=10)
    assert begun.acquire(timeout=10)
    assert not begun.acquire(timeout=0.1)  # 3 · 40 > 90
    go_on.set()
    for thread in threads:
        thread.join(10)
    assert (most[0], within[0]) == (2, 0)

    memory = Memory(10.0)
    for _ in range(2):
        with memory.room(1e12):
            pass


def test_what_terrains_take() -> None:
    sketch = Sketch(extent=1024.0)
    small, large = (needs_of(sketch, Output(size=size, preview=False)) for size in (257, 1025))
    assert (small.vertices, large.vertices) == (257**2, 1025**2)
    assert small.memory < large.memory
    assert small.disk < large.disk
    assert needs_of(sketch, Output(size=257)).disk > small.disk
    assert needs_of(sketch, Output(preview=False)) == large
    raw = needs_of(sketch, Output(target="raw", options=ExportOptions(size=257), preview=False))
    assert raw.vertices == 257**2
    with pytest.raises(InputError, match="size"):
        needs_of(sketch, Output(size=100_000))
    assert memory_left() > 0


def test_a_full_disk_is_told_before_any_work(tmp_path: Path) -> None:
    check_disk(tmp_path, 1000.0, "its files")
    with pytest.raises(InputError, match=r"its files need up to 9\d+\.\d GiB, .* has .* left"):
        check_disk(tmp_path, 1e18, "its files")
    assert disk_left(tmp_path / "not" / "there") == pytest.approx(disk_left(tmp_path), rel=0.1)


def entry(name: str, *, preview: bool = True, error: str = "") -> Entry:
    files = (File("preview.png", 1, ""),) if preview else ()
    return Entry(name, "s", 1, state="failed" if error else "done", files=files, error=error)


def written(folder: Path, name: str, colour: tuple[int, int, int]) -> None:
    (folder / name).mkdir(parents=True)
    Image.fromarray(np.full((72, 128, 3), colour, np.uint8)).save(folder / name / "preview.png")


def test_a_sheet_shows_each_preview_in_its_place(tmp_path: Path) -> None:
    colours = [(40 * number, 200, 30) for number in range(6)]
    for number, colour in enumerate(colours):
        written(tmp_path, f"s/{number}", colour)
    names = sheets(
        tmp_path, [*(entry(f"s/{number}") for number in range(6)), entry("bad", preview=False, error="no")]
    )
    assert names == ["sheet.png"]
    with Image.open(tmp_path / "sheet.png") as picture:
        page = np.asarray(picture)
    places = [(12 + 112 + 259 * (number // 4), 12 + 200 + 412 * (number % 4)) for number in range(6)]
    assert [tuple(page[place].tolist()) for place in places] == colours
    red = (page[:, :, 0] > 150) & (page[:, :, 1] < 60) & (page[:, :, 2] < 60)
    assert red[271:, 836:].any()  # why the last one failed


def test_one_that_failed_does_not_show_its_older_picture(tmp_path: Path) -> None:
    written(tmp_path, "s/0", (0, 200, 0))
    failed = Entry("s/0", "s", 1, state="failed", files=(File("preview.png", 1, ""),), error="no")
    assert sheets(tmp_path, [failed]) == []
    assert sheets(tmp_path, [failed, entry("s/0")]) == ["sheet.png"]
    with Image.open(tmp_path / "sheet.png") as page:
        assert page.getpixel((212, 124)) != (0, 200, 0) == page.getpixel((624, 124))


def test_sheets_have_pages_and_none_without_previews(tmp_path: Path) -> None:
    assert sheets(tmp_path, [entry("s/0", preview=False)]) == []
    assert sheets(tmp_path, []) == []
    assert list(tmp_path.iterdir()) == []

    written(tmp_path, "s/0", (1, 2, 3))
    entries = [entry("s/0") for _ in range(PAGE + 1)]
    assert sheets(tmp_path, entries) == ["sheet.png", "sheet-2.png"]
    with Image.open(tmp_path / "sheet-2.png") as page:
        assert page.size == (424, 271)


def test_a_missing_preview_or_a_long_name_leaves_the_sheet_readable(tmp_path: Path) -> None:
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "preview.png").write_bytes(b"no picture")
    assert sheets(tmp_path, [entry("s"), entry("gone")]) == ["sheet.png"]

    written(tmp_path, "s/0", (1, 2, 3))
    assert sheets(tmp_path, [entry("s/0"), entry("x" * 300, preview=False, error="long " * 90)]) == [
        "sheet.png"
    ]
