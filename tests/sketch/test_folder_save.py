"""A folder's save that is cut off anywhere leaves the old sketch or the new one."""

import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.sketch import LAYERS, Sketch, load_sketch, save_sketch
from sketchterrain.sketch.folder_save import PLEDGE
from sketchterrain.sketch.layer_images import encode_layer


class Killed(BaseException):
    """Nothing in the program catches this."""


def one(label: int) -> Sketch:
    """A sketch that is another one in each of its files."""
    image = np.full((20, 30), label, dtype=np.uint8)
    return Sketch(seed=label, layers=dict.fromkeys(LAYERS, image))


def killed_at(monkeypatch: pytest.MonkeyPatch, moment: int, act: Callable[[], None]) -> bool:
    """Do something, killed before or after a moment at which the disk changes; True if it was killed."""
    count = 0

    def pass_moment() -> None:
        nonlocal count
        count += 1
        if count - 1 == moment:
            raise Killed

    def counted(function: Callable[..., object]) -> Callable[..., object]:
        def wrapped(*arguments: object) -> object:
            pass_moment()
            result = function(*arguments)
            pass_moment()
            return result

        return wrapped

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", counted(Path.replace))
        patch.setattr(os, "fsync", counted(lambda _: None))
        patch.setattr(Path, "unlink", lambda *_, **__: None)  # who is killed does not tidy up
        try:
            act()
        except Killed:
            return True
    return False


@pytest.mark.parametrize("stride", [3, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("before", ["nothing", "a sketch", "an unfinished save"])
def test_a_save_that_is_cut_off_leaves_the_old_sketch_or_the_new_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, same: Callable[..., None], before: str, stride: int
) -> None:
    seen = set()
    for moment in range(0, 100, stride):
        folder = tmp_path / str(moment)
        if before != "nothing":
            save_sketch(one(1), folder)
        if before == "an unfinished save":
            assert killed_at(monkeypatch, 22, lambda folder=folder: save_sketch(one(2), folder))
            assert (folder / PLEDGE).exists()
            same(load_sketch(folder), one(2))
        killed = killed_at(monkeypatch, moment, lambda folder=folder: save_sketch(one(3), folder))
        try:
            sketch = load_sketch(folder)
        except InputError:
            assert (before, killed) == ("nothing", True)
            seen.add(0)
        else:
            seen.add(sketch.seed)
            same(sketch, one(sketch.seed))
        save_sketch(one(4), folder)
        same(load_sketch(folder), one(4))
        assert not (folder / PLEDGE).exists()
        if not killed:
            break
    else:
        pytest.fail("a save has no end")
    assert seen == {{"nothing": 0, "a sketch": 1, "an unfinished save": 2}[before], 3}
    assert moment > 20


def test_an_image_written_after_the_crash_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save_sketch(one(1), tmp_path)
    assert killed_at(monkeypatch, 20, lambda: save_sketch(one(2), tmp_path))
    time.sleep(0.02)
    (tmp_path / "hill.png").write_bytes(encode_layer(np.full((20, 30), 9, dtype=np.uint8), (0, 0, 0)))
    sketch = load_sketch(tmp_path)
    assert sketch.seed == 2
    assert {name: int(image.max()) for name, image in sketch.layers.items()} == {
        name: 9 if name == "hill" else 2 for name in LAYERS
    }


def test_a_folder_named_as_a_preset_with_an_unfinished_first_save_is_the_sketch_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, same: Callable[..., None]
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = Path("valley_river")
    assert killed_at(monkeypatch, 19, lambda: save_sketch(one(2), folder))
    assert not (folder / "sketch.toml").exists()
    same(load_sketch("valley_river"), one(2))


def test_unchanged_files_are_not_written(tmp_path: Path) -> None:
    save_sketch(one(1), tmp_path)
    times = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    time.sleep(0.02)
    save_sketch(one(1).replace(seed=9), tmp_path)
    changed = {path.name for path in tmp_path.iterdir() if path.stat().st_mtime_ns != times[path.name]}
    assert changed == {"sketch.toml"}


def test_old_temporary_files_of_killed_saves_are_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert killed_at(monkeypatch, 9, lambda: save_sketch(one(2), tmp_path))
    (tmp_path / ".notes.tmp").write_text("mine")
    left = list(tmp_path.glob(".*.tmp"))
    assert len(left) > 3
    save_sketch(one(3), tmp_path)
    assert set(left) <= set(tmp_path.iterdir())  # somebody may be writing them
    for path in left:
        os.utime(path, (time.time() - 100, time.time() - 100))
    save_sketch(one(3), tmp_path)
    assert {path.name for path in tmp_path.glob(".*")} == {".notes.tmp"}
