"""Films: frames, order, duration and colours, and no partial files after a failure."""

import sys

import numpy as np
import pytest
from PIL import Image, ImageSequence

from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.export.film import ANIMATED, VIDEO, check_film, film

SIZE = (64, 48)


def frames(count):
    """A bright bar that goes from left to right over a slope of colours."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    result = []
    for number in range(count):
        picture = np.stack([4 * x, 5 * y, np.full_like(x, 60)], axis=-1).astype(np.uint8)
        picture[:, 4 * number : 4 * number + 8] = (250, 240, 20)
        result.append(picture)
    return result


def write(path, count, *, fps=30, failure=None):
    with film(path, size=SIZE, fps=fps, frames=count) as add:
        for frame in frames(count):
            add(frame)
        if failure is not None:
            raise failure


def entries(folder):
    return sorted(each.name for each in folder.iterdir())


def test_frames_in_a_folder_are_numbered_and_exact(tmp_path):
    write(tmp_path / "new" / "frames", 12)
    assert entries(tmp_path / "new" / "frames") == [f"{number:04d}.png" for number in range(12)]
    for number, frame in enumerate(frames(12)):
        with Image.open(tmp_path / "new" / "frames" / f"{number:04d}.png") as image:
            np.testing.assert_array_equal(np.asarray(image), frame)

    from sketchterrain.export.film import _frame_name

    assert [_frame_name(number, 10_001) for number in (0, 10_000)] == ["00000.png", "10000.png"]
    assert _frame_name(9999, 10_000) == "9999.png"


def test_animated_images_have_all_frames_and_their_duration(tmp_path):
    for ending, near in [(".webp", 12), (".gif", 30)]:
        path = tmp_path / ending[1:] / f"a{ending}"
        write(path, 12, fps=30)
        assert entries(path.parent) == [path.name], ending
        length = 0
        with Image.open(path) as image:
            assert (image.size, image.n_frames) == (SIZE, 12), ending
            for decoded, frame in zip(ImageSequence.Iterator(image), frames(12), strict=True):
                difference = np.asarray(decoded.convert("RGB")).astype(int) - frame
                assert np.abs(difference).mean() < near, ending
                length += decoded.info["duration"]
        assert length == 400, ending

    for name in ("a.webp", "a.gif", "frames"):
        write(tmp_path / "one" / name, 1)
    assert entries(tmp_path / "one") == ["a.gif", "a.webp", "frames"]


def test_videos_have_all_frames_duration_and_colours(tmp_path):
    av = pytest.importorskip("av")
    path = tmp_path / "a.mp4"
    write(path, 12, fps=25)
    assert entries(tmp_path) == ["a.mp4"]
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert (stream.width, stream.height, stream.average_rate, stream.frames) == (*SIZE, 25, 12)
        for decoded, frame in zip(container.decode(stream), frames(12), strict=True):
            assert int(decoded.colorspace) == 1
            difference = decoded.to_ndarray(format="rgb24").astype(int) - frame
            assert np.abs(difference).mean() < 8
            assert np.abs(difference.mean(axis=(0, 1))).max() < 2  # no colour is off as a whole


def test_interrupted_films_leave_no_files(tmp_path):
    for name in ["frames", "a.webp", "a.gif", "a.mp4"]:
        for failure in [KeyboardInterrupt(), SketchterrainError("it broke")]:
            if name.endswith(VIDEO):
                pytest.importorskip("av")
            folder = tmp_path / f"{name}-{type(failure).__name__}"
            folder.mkdir()
            (folder / "a.webp").write_text("old")
            with pytest.raises(type(failure)):
                write(folder / name, 5, failure=failure)
            names = entries(folder)
            assert names == ["a.webp"] + ["frames"] * (name == "frames"), (name, failure)
            assert (folder / "a.webp").read_text() == "old", (name, failure)
            assert not list((folder / "frames").iterdir()) if name == "frames" else True, (name, failure)


def test_longer_films_odd_sides_missing_libraries_and_existing_files_are_refused(tmp_path, monkeypatch):
    write(tmp_path, 5)
    check_film(tmp_path, size=SIZE, frames=5)
    (tmp_path / "notes.png").write_text("mine")
    with pytest.raises(InputError, match=r"frames of a longer film, 0003\.png to 0004\.png"):
        check_film(tmp_path, size=SIZE, frames=3)
    with pytest.raises(InputError, match=r"0000\.png to 0004\.png"):
        check_film(tmp_path, size=SIZE, frames=20_000)

    pytest.importorskip("av")
    with pytest.raises(InputError, match=r"even sides for an \.mp4, got 65×48"):
        check_film(tmp_path / "a.mp4", size=(65, 48), frames=3)
    check_film(tmp_path / "a.webp", size=(65, 48), frames=3)
    (tmp_path / "file").write_text("mine")
    for path in (tmp_path / "file", tmp_path / "file" / "a.gif"):
        with pytest.raises(InputError, match="expected a folder"):
            check_film(path, size=SIZE, frames=3)

    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(SketchterrainError, match=r"pip install 'sketchterrain\[video\]'"):
        check_film(tmp_path / "a.mp4", size=SIZE, frames=3)
    assert set(ANIMATED) == {".webp", ".gif"}
