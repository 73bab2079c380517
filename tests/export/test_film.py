"""Films: what was put in comes out, in order and at its speed, and nothing is left of what failed."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image, ImageSequence

from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.export.film import ANIMATED, VIDEO, check_film, film

if TYPE_CHECKING:
    from pathlib import Path

SIZE = (64, 48)


def frames(count: int) -> list[np.ndarray]:
    """A bright bar that goes from left to right over a slope of colours."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    made = []
    for number in range(count):
        picture = np.stack([4 * x, 5 * y, np.full_like(x, 60)], axis=-1).astype(np.uint8)
        picture[:, 4 * number : 4 * number + 8] = (250, 240, 20)
        made.append(picture)
    return made


def write(path: Path, count: int, *, fps: int = 30, failure: BaseException | None = None) -> None:
    with film(path, size=SIZE, fps=fps, frames=count) as add:
        for frame in frames(count):
            add(frame)
        if failure is not None:
            raise failure


def entries(folder: Path) -> list[str]:
    return sorted(each.name for each in folder.iterdir())


def test_a_folder_of_frames(tmp_path: Path) -> None:
    write(tmp_path / "made" / "frames", 12)
    assert entries(tmp_path / "made" / "frames") == [f"{number:04d}.png" for number in range(12)]
    for number, frame in enumerate(frames(12)):
        with Image.open(tmp_path / "made" / "frames" / f"{number:04d}.png") as image:
            np.testing.assert_array_equal(np.asarray(image), frame)


def test_more_than_ten_thousand_frames_keep_their_order() -> None:
    from sketchterrain.export.film import _name

    assert [_name(number, 10_001) for number in (0, 10_000)] == ["00000.png", "10000.png"]
    assert _name(9999, 10_000) == "9999.png"


@pytest.mark.parametrize(("ending", "near"), [(".webp", 12), (".gif", 30)])
def test_an_animated_picture_has_all_frames_and_its_length(ending: str, near: float, tmp_path: Path) -> None:
    path = tmp_path / f"a{ending}"
    write(path, 12, fps=30)
    assert entries(tmp_path) == [path.name]
    length = 0
    with Image.open(path) as image:
        assert (image.size, image.n_frames) == (SIZE, 12)
        for shown, frame in zip(ImageSequence.Iterator(image), frames(12), strict=True):
            difference = np.asarray(shown.convert("RGB")).astype(int) - frame
            assert np.abs(difference).mean() < near
            length += shown.info["duration"]
    assert length == 400


def test_one_frame_is_a_film_too(tmp_path: Path) -> None:
    for name in ("a.webp", "a.gif", "frames"):
        write(tmp_path / name, 1)
    assert entries(tmp_path) == ["a.gif", "a.webp", "frames"]


def test_a_video_has_all_frames_its_length_and_its_colours(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    path = tmp_path / "a.mp4"
    write(path, 12, fps=25)
    assert entries(tmp_path) == ["a.mp4"]
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert (stream.width, stream.height, stream.average_rate, stream.frames) == (*SIZE, 25, 12)
        for shown, frame in zip(container.decode(stream), frames(12), strict=True):
            assert int(shown.colorspace) == 1
            difference = shown.to_ndarray(format="rgb24").astype(int) - frame
            assert np.abs(difference).mean() < 8
            assert np.abs(difference.mean(axis=(0, 1))).max() < 2  # no colour is off as a whole


@pytest.mark.parametrize("name", ["frames", "a.webp", "a.gif", "a.mp4"])
@pytest.mark.parametrize("failure", [KeyboardInterrupt(), SketchterrainError("it broke")])
def test_what_is_interrupted_leaves_nothing(name: str, failure: BaseException, tmp_path: Path) -> None:
    if name.endswith(VIDEO):
        pytest.importorskip("av")
    (tmp_path / "a.webp").write_text("old")
    with pytest.raises(type(failure)):
        write(tmp_path / name, 5, failure=failure)
    there = entries(tmp_path)
    assert there == ["a.webp"] + ["frames"] * (name == "frames")
    assert (tmp_path / "a.webp").read_text() == "old"
    assert not list((tmp_path / "frames").iterdir()) if name == "frames" else True


def test_a_shorter_film_does_not_mix_with_a_longer_one(tmp_path: Path) -> None:
    write(tmp_path, 5)
    check_film(tmp_path, size=SIZE, frames=5)
    (tmp_path / "notes.png").write_text("mine")
    with pytest.raises(InputError, match=r"frames of a longer film, 0003\.png to 0004\.png"):
        check_film(tmp_path, size=SIZE, frames=3)
    with pytest.raises(InputError, match=r"0000\.png to 0004\.png"):
        check_film(tmp_path, size=SIZE, frames=20_000)


def test_odd_sides_and_files_in_the_way_are_refused_before_the_work(tmp_path: Path) -> None:
    pytest.importorskip("av")
    with pytest.raises(InputError, match=r"even sides for an \.mp4, got 65×48"):
        check_film(tmp_path / "a.mp4", size=(65, 48), frames=3)
    check_film(tmp_path / "a.webp", size=(65, 48), frames=3)
    (tmp_path / "file").write_text("mine")
    for path in (tmp_path / "file", tmp_path / "file" / "a.gif"):
        with pytest.raises(InputError, match="expected a folder"):
            check_film(path, size=SIZE, frames=3)


def test_without_pyav_one_line_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(SketchterrainError, match=r"pip install 'sketchterrain\[video\]'"):
        check_film(tmp_path / "a.mp4", size=SIZE, frames=3)
    assert set(ANIMATED) == {".webp", ".gif"}
