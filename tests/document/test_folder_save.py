"""Folders and archives: saving, loading, crashes during a save."""

import os
from pathlib import Path

import numpy as np
import pytest

from sketchterrain.document.edits import Edit
from sketchterrain.document.label_layers import encode_layer
from sketchterrain.document.rasters import RasterSource
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import JOURNAL, load_sketch, new_sketch, save_sketch
from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.features.table import KINDS, Feature, FeatureTable
from sketchterrain.io.resources import preset, preset_names
from sketchterrain.schema.layers import LAYERS, PAINTED_LAYERS, VECTOR_LAYERS
from tests.refusals import refused

from .conftest import grey, refusal, same

_FILES = sorted(["sketch.toml", *(f"{name}.png" for name in PAINTED_LAYERS)])


def _painted():
    image = np.zeros((20, 30), dtype=np.uint8)
    image[3:9, 4:20] = 1
    image[12:18, 4:20] = 200
    layers = {"mountain": image, "river": image[::-1] // 200}
    labels = {("mountain", 1): {"height": 0.1 + 0.2 + 1}, ("mountain", 200): {}}
    return Sketch(name='A "valley"', extent=1234.5, seed=2**63 - 1, layers=layers, labels=labels)


def test_saving_leaves_other_files(tmp_path):
    save_sketch(_painted(), tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    emptied = _painted().replace(layers={"river": np.ones((9, 9), dtype=np.uint8)})
    save_sketch(emptied, tmp_path)
    same(load_sketch(tmp_path), emptied)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == sorted([*_FILES, "notes.txt"])
    assert (tmp_path / "notes.txt").read_text() == "mine"

    # A folder that is named as a zip stays a folder.
    path = tmp_path / "valley.sketch"
    path.mkdir()
    save_sketch(_painted(), path)
    assert path.is_dir()
    same(load_sketch(path), _painted())

    path = tmp_path / "photo.png"
    path.write_bytes(b"mine")
    refused(r"expected a folder or a name that ends in \.sketch", save_sketch, Sketch(), path)
    assert path.read_bytes() == b"mine"


def test_failed_save_leaves_the_old_sketch(tmp_path, monkeypatch):
    def fail(_):
        raise OSError(28, "No space left on device")

    for name in ("valley", "valley.sketch"):
        path = tmp_path / name
        save_sketch(_painted(), path)
        before = sorted(tmp_path.rglob("*"))
        with monkeypatch.context() as patch:
            patch.setattr(os, "fsync", fail)
            with pytest.raises(
                SketchterrainError, match=f"{name}.*: cannot be written .No space left on device."
            ) as caught:
                save_sketch(Sketch(), path)
        assert caught.value.exit_code == 1
        assert sorted(tmp_path.rglob("*")) == before
        same(load_sketch(path), _painted())


def test_missing_layers_and_unpainted_labels(folder):
    sketch = load_sketch(folder("extent = 100"))
    assert (sketch.width_px, sketch.height_px, sketch.size) == (512, 512, (100.0, 100.0))
    assert not any(image.any() for image in sketch.layers.values())
    sketch = load_sketch(folder(files={"hill.png": grey(np.zeros((3, 7)))}))
    assert {image.shape for image in sketch.layers.values()} == {(3, 7)}
    sketch = load_sketch(folder("[hill.9]\nheight = 5", {"hill.png": grey([[0, 3]])}))
    assert sketch.properties("hill", 3)["height"] == 0.0
    assert sketch.properties("hill", 9)["height"] == 5.0
    sketch = load_sketch(folder(files={f"{name}.png": grey(np.full((8, 8), 1)) for name in PAINTED_LAYERS}))
    assert all((image == 1).all() for image in sketch.layers.values())


def test_sketches_of_format_1_keep_the_heights_that_they_had_by_default(folder, tmp_path):
    settings = "[mountain.2]\npeakiness = 1.0\n[hill.9]\nheight = 5\n[mountain.4]\nheight = 900\n"
    files = {"hill.png": grey([[3, 0]]), "mountain.png": grey([[0, 7]])}
    old = load_sketch(folder(settings, files, version=1))
    expected = {("mountain", 2): 600, ("mountain", 4): 900, ("mountain", 7): 600}
    expected |= {("hill", 3): 80, ("hill", 9): 5}
    assert {key: values["height"] for key, values in old.labels.items()} == expected
    assert old.labels["mountain", 2]["peakiness"] == 1.0
    assert old.properties("mountain", 1)["height"] == 0.0
    save_sketch(old, tmp_path / "new")
    assert (tmp_path / "new/sketch.toml").read_text().count("format = 2") == 1
    same(load_sketch(tmp_path / "new"), old)
    assert load_sketch(folder(settings, files)).labels["mountain", 2] == {"peakiness": 1.0}


def test_sketches_of_format_1_lose_the_width_of_their_gullies(folder, tmp_path):
    width = "gullies = 0.25\n"
    shape = 'type = "hill"\nx = 1.0\ny = 2\nradius = 30.0\nstrength = 4.0\nerosion = 0.5\n'
    added = 8641500212530785465  # the id that format 1 gave it
    edits = [
        f'[[edit]]\naction = "add"\n{shape}{width}',
        f'[[edit]]\naction = "move"\nfeature = {added}\nx = 5.0\ny = 6.0\n',
        f'[[edit]]\naction = "lock"\nfeature = 7\n{shape}{width}',
    ]
    settings = f"[mountain.2]\n{width}[hill.3]\nheight = 5.0\n{width}" + "".join(edits)
    old = load_sketch(folder(settings, version=1))
    assert old.labels == {("mountain", 2): {"height": 600.0}, ("hill", 3): {"height": 5.0}}
    values = {"type": "hill", "x": 1.0, "y": 2.0, "radius": 30.0, "strength": 4.0, "erosion": 0.5}
    add, lock = Edit("add", **values), Edit("lock", 7, **values)
    assert old.edits == (add, Edit("move", add.feature, x=5.0, y=6.0), lock)
    save_sketch(old, tmp_path / "new")
    assert "gullies" not in (tmp_path / "new/sketch.toml").read_text()
    same(load_sketch(tmp_path / "new"), old)

    for table in (f"[mountain.2]\n{width}", edits[0], edits[2]):
        assert "gullies" in refusal(folder(table)), table  # format 2
    for table in (f"[dune.2]\n{width}", f'[[edit]]\naction = "delete"\nfeature = 1\n{width}'):
        assert "gullies" in refusal(folder(table, version=1)), table


def test_refused_and_ignored_files(folder):
    place = folder()
    for name, message in [
        ("mountains.png", "did you mean 'mountain.png'"),
        ("Mountain.PNG", "did you mean 'mountain.png'"),
        (
            "pond.png",
            f"expected {', '.join(f'{name}.png' for name in PAINTED_LAYERS)}",
        ),
        ("road.png", "/road.png: expected road.fgb, the layer road has vectors alone"),
        ("hill.jpg", "'hill.jpg': expected a PNG file, hill.png"),
        ("two\nlines.png", r"unknown layer image 'two\nlines.png'"),
    ]:
        (place / name).write_bytes(b"")
        assert message in refusal(place), name
        (place / name).unlink()
    for content, message in [
        (b"JFIF", "hill.png: expected a PNG file"),
        (grey([[0]])[:-20], "hill.png: expected a whole PNG file, this one is truncated"),
    ]:
        (place / "hill.png").write_bytes(content)
        assert refusal(place).startswith(f"{place}/{message}"), message
    with (place / "hill.png").open("wb") as stream:
        stream.truncate(1 << 40)  # sparse
    assert "hill.png: too large: expected at most 64 MiB" in refusal(place)
    (place / "hill.png").unlink()
    (place / "hill.png").mkdir()
    assert refusal(place) == f"{place}/hill.png: expected a file"
    (place / "hill.png").rmdir()
    folder(files={"mountain.png": grey(np.zeros((4, 6))), "river.png": grey(np.zeros((4, 5)))})
    assert refusal(place) == f"{place}/river.png: 5×4 px, but mountain.png is 6×4 px: expected one size"
    (place / "river.png").unlink()
    for text, message in [
        ("extnt = 3", "unknown key 'extnt' = 3: expected format, name"),
        ("seed = ", "not TOML: Invalid value (at line 2"),
    ]:
        assert refusal(folder(text)).startswith(f"{place}/sketch.toml: {message}"), text
    (place / "sketch.toml").unlink()
    assert refusal(place).startswith(f"{place}: no sketch.toml in it")

    folder(files=dict.fromkeys(["hill.xcf", "README.md", ".hill.png.1.tmp", "._hill.png"], b"?"))
    (place / "sources").mkdir()
    assert (load_sketch(place).width_px, load_sketch(place).height_px) == (6, 4)


def test_local_sketches_precede_presets(tmp_path, monkeypatch):
    message = refusal(str(tmp_path / "nowhere"))
    assert "expected a folder, a .sketch file or a preset" in message
    assert all(name in message for name in preset_names())
    for strange in ("x" * 5000, "a\0b", "two\nlines"):
        refusal(strange)

    for name in preset_names():
        sketch = load_sketch(name)
        assert any(image.any() for image in sketch.layers.values()), name
        assert sketch.name
        save_sketch(sketch, tmp_path / "copy.sketch")
        same(load_sketch(tmp_path / "copy.sketch"), sketch)
        assert preset(name).joinpath("sketch.toml").is_file()

    shelf = tmp_path / "presets"
    save_sketch(_painted(), shelf / "valley")
    monkeypatch.setattr("sketchterrain.document.store.preset_names", lambda: ("valley",))
    monkeypatch.setattr("sketchterrain.document.store.preset", lambda name: shelf / name)
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    same(load_sketch("valley"), _painted())
    (here / "valley").mkdir()  # an output folder, say: it holds no sketch
    same(load_sketch("valley"), _painted())
    refused("did you mean 'valley'", load_sketch, "valey")
    refused(r"no sketch\.toml", load_sketch, Path("valley"))
    new_sketch("valley")
    assert load_sketch("valley").name == "My sketch"


def test_starter_declares_every_layer(tmp_path):
    new_sketch(tmp_path / "mine")
    assert sorted(entry.name for entry in (tmp_path / "mine").iterdir()) == _FILES
    sketch = load_sketch(tmp_path / "mine")
    assert sketch.size == (4096.0, 4096.0)
    assert (sketch.width_px, sketch.height_px) == (512, 512)
    painted = {name for name, image in sketch.layers.items() if image.any()}
    assert painted == {"mountain", "river"}
    for name, layer in LAYERS.items():
        assert sketch.labels[name, 1] == {key: p.default for key, p in layer.parameters.items()}
    text = (tmp_path / "mine" / "sketch.toml").read_text(encoding="utf-8")
    for layer in LAYERS.values():
        assert all(parameter.help in text for parameter in layer.parameters.values())

    (tmp_path / "other").mkdir()
    new_sketch(tmp_path / "other")
    settings = tmp_path / "other" / "sketch.toml"
    settings.write_text("mine")
    refused("this one is not empty", new_sketch, tmp_path / "other")
    refused("expected a folder", new_sketch, settings)
    assert settings.read_text() == "mine"


_TRIANGLE = np.array([[0.0, 0.0], [50.0, 0.0], [50.0, 50.0]])


class Killed(BaseException):
    """Not caught anywhere in the program."""


JOURNALLED = (
    2 * len(PAINTED_LAYERS) + 10
)  # disk operations until all new files are written beside the old ones


def numbered_sketch(label):
    """Return a sketch whose files all depend on a number; each has other vectors than the one before."""
    image = np.full((20, 30), label, dtype=np.uint8)
    name = VECTOR_LAYERS[label % 2]
    feature = Feature(KINDS.index(LAYERS[name].vectors[-1]), (_TRIANGLE * label,))
    content = bytes([label])
    return Sketch(
        seed=label,
        layers=dict.fromkeys(PAINTED_LAYERS, image),
        vectors={name: FeatureTable(name).edited(add=[feature])},
        rasters=(RasterSource(f"map-{label:08}.raster", content=content),),
    )


def interrupted_at(monkeypatch, moment, act):
    """Call `act`, killed at a numbered disk operation; return whether it was killed."""
    count, is_killed, unlink = 0, False, Path.unlink

    def pass_moment():
        nonlocal count, is_killed
        count += 1
        if count - 1 == moment:
            is_killed = True
            raise Killed

    def unlink_alive(path, missing_ok=False):
        """Remove a file, but a killed process does not clean up."""
        if path.suffix == ".tmp":
            return is_killed or unlink(path, missing_ok=missing_ok)
        pass_moment()
        unlink(path, missing_ok=missing_ok)
        return pass_moment()

    def counted(function):
        def wrapped(*arguments):
            pass_moment()
            result = function(*arguments)
            pass_moment()
            return result

        return wrapped

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", counted(Path.replace))
        patch.setattr(os, "fsync", counted(lambda _: None))
        patch.setattr(Path, "unlink", unlink_alive)
        try:
            act()
        except Killed:
            return True
    return False


@pytest.mark.parametrize("stride", [7, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("before", ["nothing", "a sketch", "an unfinished save"])
def test_killed_save_leaves_the_old_or_the_new_sketch(tmp_path, monkeypatch, before, stride):
    seen = set()
    for moment in range(0, 100, stride):
        folder = tmp_path / str(moment)
        if before != "nothing":
            save_sketch(numbered_sketch(1), folder)
        if before == "an unfinished save":
            assert interrupted_at(
                monkeypatch, JOURNALLED + 2, lambda folder=folder: save_sketch(numbered_sketch(2), folder)
            )
            assert (folder / JOURNAL).exists()
            same(load_sketch(folder), numbered_sketch(2))
        killed = interrupted_at(
            monkeypatch, moment, lambda folder=folder: save_sketch(numbered_sketch(3), folder)
        )
        try:
            sketch = load_sketch(folder)
        except InputError:
            assert (before, killed) == ("nothing", True)
            seen.add(0)
        else:
            seen.add(sketch.seed)
            same(sketch, numbered_sketch(sketch.seed))
        save_sketch(numbered_sketch(4), folder)
        same(load_sketch(folder), numbered_sketch(4))
        assert not (folder / JOURNAL).exists()
        if not killed:
            break
    else:
        pytest.fail("the save does not end")
    assert seen == {{"nothing": 0, "a sketch": 1, "an unfinished save": 2}[before], 3}
    assert moment > 20


def test_image_modified_after_the_crash_wins(tmp_path, monkeypatch):
    save_sketch(numbered_sketch(1), tmp_path)
    assert interrupted_at(monkeypatch, JOURNALLED, lambda: save_sketch(numbered_sketch(2), tmp_path))
    hill = tmp_path / "hill.png"
    hill.write_bytes(encode_layer(np.full((20, 30), 9, dtype=np.uint8), (0, 0, 0)))
    os.utime(hill, ns=(later := (tmp_path / JOURNAL).stat().st_mtime_ns + 10**9, later))
    sketch = load_sketch(tmp_path)
    assert sketch.seed == 2
    assert {name: int(image.max()) for name, image in sketch.layers.items()} == {
        name: 9 if name == "hill" else 2 for name in PAINTED_LAYERS
    }


def test_unfinished_first_save_precedes_a_preset(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = Path("valley_river")
    assert interrupted_at(monkeypatch, JOURNALLED - 1, lambda: save_sketch(numbered_sketch(2), folder))
    assert not (folder / "sketch.toml").exists()
    same(load_sketch("valley_river"), numbered_sketch(2))


def test_unchanged_files_are_not_written(tmp_path):
    save_sketch(numbered_sketch(1), tmp_path)
    for path in tmp_path.iterdir():
        os.utime(path, (1.0, 1.0))
    save_sketch(numbered_sketch(1).replace(seed=9), tmp_path)
    assert [path.name for path in tmp_path.iterdir() if path.stat().st_mtime != 1.0] == ["sketch.toml"]


def test_stale_temporary_files_are_removed(tmp_path, monkeypatch):
    assert interrupted_at(monkeypatch, 9, lambda: save_sketch(numbered_sketch(2), tmp_path))
    (tmp_path / ".notes.tmp").write_text("mine")
    left = list(tmp_path.glob(".*.tmp"))
    assert len(left) > 3
    save_sketch(numbered_sketch(3), tmp_path)
    assert set(left) <= set(tmp_path.iterdir())  # they may be in use
    for path in left:
        os.utime(path, (1.0, 1.0))
    save_sketch(numbered_sketch(3), tmp_path)
    assert {path.name for path in tmp_path.glob(".*")} == {".notes.tmp"}
