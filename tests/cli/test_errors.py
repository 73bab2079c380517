"""Every failure is one line on stderr with its exit code, and nothing is written."""

import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
from PIL import Image

import sketchterrain.document.store
import sketchterrain.jobs.export
from sketchterrain.app.cli import main
from sketchterrain.errors import SketchterrainError


def test_invalid_sketches_are_refused_and_nothing_is_written(call, tmp_path):
    out = tmp_path / "out.png"
    for name, settings in (("layer", "format = 1"), ("value", "format = 1\nextent = nan"), ("missing", None)):
        folder = tmp_path / name
        folder.mkdir()
        if settings is not None:
            (folder / "sketch.toml").write_text(settings, encoding="utf-8")
        if name == "layer":
            Image.fromarray(np.full((8, 8, 3), (1, 2, 3), np.uint8)).save(folder / "mountain.png")
        for command in ("generate", "render"):
            done = call(command, folder, "-o", out)
            assert (done.code, done.out) == (3, ""), (name, done.err)
            assert done.error, name
            assert not out.exists(), name


def test_size_beyond_the_memory_is_refused(call, sketch, tmp_path, monkeypatch):
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(total=1 << 30))
    done = call("generate", sketch, "-o", tmp_path / "out", "--size", 8193)
    assert done.code == 3
    assert "this machine has 1.0 GiB" in done.error
    assert not (tmp_path / "out").exists()


def test_invalid_output_folders_are_refused(call, sketch, tmp_path, monkeypatch):
    (tmp_path / "out").write_text("mine")
    commands = [("generate", sketch), ("export", sketch, "--to", "raw")]
    for command in commands:
        for place, code, part in (("out", 3, "expected a folder"), ("out/deeper", 1, "cannot be written")):
            done = call(*command, "-o", tmp_path / place)
            assert (done.code, f"{tmp_path / place}: {part}" in done.error) == (code, True)
    assert (tmp_path / "out").read_text() == "mine"

    def refused(self: Path, *_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "mkdir", refused)
    for command in commands:
        done = call(*command, "-o", tmp_path / "new")
        assert (done.code, done.error) == (1, f"{tmp_path / 'new'}: cannot be written (Permission denied)")


def fails_with(error: BaseException) -> Callable[..., None]:
    def fail(*_: object, **__: object) -> None:
        raise error

    return fail


def test_exceptions_are_reported_and_tracebacks_optional(call, sketch, tmp_path, monkeypatch):
    monkeypatch.delenv("SKETCHTERRAIN_DEBUG", raising=False)
    for error, code, line in (
        (KeyboardInterrupt(), 130, "interrupted"),
        (MemoryError(), 1, "out of memory"),
        (OSError(5, "Input/output error", "a.bin"), 1, "a.bin: Input/output error"),
        (OSError("odd"), 1, "odd"),
        (
            UnicodeEncodeError("utf-8", "o\udce9", 1, 2, "surrogates not allowed"),
            3,
            "o\ufffd: expected a name in",
        ),
        (ZeroDivisionError("division\nby\x1b"), 1, "unexpected ZeroDivisionError: division by\ufffd; "),
    ):
        monkeypatch.setattr(sketchterrain.jobs.export, "build", fails_with(error))
        done = call("generate", sketch, "-o", tmp_path, "--size", 9)
        assert (done.code, done.error.startswith(line)) == (code, True), line
        assert list(tmp_path.iterdir()) == []
    monkeypatch.setenv("SKETCHTERRAIN_DEBUG", "1")
    done = call("generate", sketch, "-o", tmp_path)
    assert (done.code, "Traceback" in done.err) == (1, True)


# Arguments, exit code, parts of the message; a part that ends in "\n" ends the message.
USAGE = [
    *((words, 2, ()) for words in ("", "nothing", "--nothing", "generate", "generate SKETCH")),
    *(
        (f"generate SKETCH {words}", 2, ())
        for words in ("-o", "-o OUT --size big", "-o OUT --seed 1.5", "-o OUT x")
    ),
    ("generate valley_rivr -o OUT", 3, ("did you mean 'valley_river'?",)),
    *((f"generate SKETCH -o OUT --seed {seed}", 3, (str(seed),)) for seed in (-1, 2**63)),
    *((f"generate SKETCH -o OUT --size {size}", 3, ("expected 2 to 16385 vertices",)) for size in (-1, 0, 1)),
    *((f"generate SKETCH -o OUT --size {size}", 3, ("to 16385 vertices", "GiB")) for size in (16386, 10**12)),
    *(
        (f"{command} SKETCH -o OUT.png --device {device}", 4, (f"--device {device}",))
        for command in ("generate", "render", "export --to raw")
        for device in ("nonsense", "999")
    ),
    *(
        (f"{command} SKETCH -o OUT.zarr --device nonsense", 4, ("nonsense",))
        for command in ("batch", "world")
    ),
    ("fly SKETCH -o OUT --device nonsense", 4, ("--device nonsense",)),
    *(
        (f"{command} {empty}", 2, ("expected a value, got an empty text\n",))
        for command in ("generate SKETCH", "fly SKETCH", "trace MAP", "bench", "blender-extension")
        for empty in ("-o ''", "--output=")
    ),
    *((words, 2, ("expected a value, got",)) for words in ("new ''", "trace '' -o OUT", "new x --dem ''")),
]
GENERATE = [
    ("--foliage obj", 2, ("expected csv, ply, both or none, got 'obj'",)),
    ("--grass", 2, ("--grass with --foliage csv: expected --foliage ply or both",)),
    ("--foliage none --grass", 2, ("--grass with --foliage none",)),
    ("--map pdf", 2, ("expected png or svg, got 'pdf'",)),
    ("--no-preview --time 12", 2, ("--time with --no-preview: it is the preview's",)),
    ("--no-preview --view air", 2, ("--view with --no-preview",)),
    ("--view moon", 3, ("expected a view, one of auto, ground, hill, air",)),
    ("--time 0", 3, ("expected an hour from",)),
]
RENDER = [
    *(
        (words, 2, ())
        for words in ("-o OUT", "-o OUT.jpg", "--size 1280", "--size 15x720", "--size 8193x720")
    ),
    *((words, 2, ()) for words in ("--look-at 1,2,3", "--eye 1,2,3 --look-at 1,2,3", "--time 24:01")),
    ("-o OUT.svg", 2, ("expected the name of a .png file, or --map",)),
    ("-o OUT.svg --map --size 640x480", 2, ("--size with --map",)),
    *((f"--eye {eye}", 2, ()) for eye in ("1,2", "1,2,3,4", "a,b,c", "1,2,nan", "1,2,inf")),
    ("--overlay contours", 3, ("no overlay 'contours'; there are: wireframe, levels",)),
    ("--view moon", 3, ("expected a view, one of auto, ground, hill, air, layers, got 'moon'",)),
    ("--without people", 3, ("expected a part of a picture",)),
    ("--time 9:75", 2, ("expected a time of day HH or HH:MM, up to 24, got '9:75'",)),
    ("--time 1", 3, ("expected an hour from",)),
    ("--sky fog", 2, ("expected cumulus, stratocumulus, stratus, cirrus or clear, got 'fog'",)),
    ("--clouds 1.5", 2, ("'--clouds'",)),
    ("--textures nowhere", 2, ("expected a folder of textures, got 'nowhere'",)),
    ("--eye 1,2,3 --view air", 2, ("--view with --eye",)),
    ("--map --eye 1,2,3", 2, ("--eye with --map",)),
    ("--map --time 18", 2, ("--time with --map",)),
    ("--map --without trees", 2, ("--without with --map",)),
    ("--map --drape-method tiles", 2, ("--drape-method with --map",)),
    ("--drape-method texture", 2, ("expected auto, tiles, two-step or geometry, got 'texture'",)),
    ("--layer no/such.gpkg,width=3", 3, ("--layer no/such.gpkg,width=3", "the file is missing\n")),
    ("--layer MAP,widht=3", 3, ("unknown key 'widht' = '3': expected", "did you mean 'width'?\n")),
    ("--layer MAP,width=wide", 3, ("drape.width = 'wide': expected a number from 0 to 10000\n",)),
    ("--layer MAP,cap=flat", 3, ("drape.cap = 'flat': expected 'butt' or 'round' or 'square'\n",)),
]
FLY = [
    *((words, 2, ()) for words in ("-o film.avi", "--fps 0", "--fps 2.5", "--seconds 0", "--seconds nan")),
    *((words, 2, ()) for words in ("--seconds 1e9", "--quality 1.5", "--size big")),
]
EXPORT = [
    *(
        (f"--to {words}", 2, ())
        for words in ("nothing", "RAW", "raw --size 1", "raw --size big", "raw --tiles 4")
    ),
    *((f"--to raw --{words}", 2, ()) for words in ("tiles 0x4", "tiles 4x4x4", "tiles 2x2 --overlap -1")),
    *((f"--to raw --{words}", 2, ()) for words in ("overlap 1", "tile-name {x}{y}", "tiles-from-south")),
    *((f"--to raw --{words}", 2, ()) for words in ("heights 5", "heights 5,nan", "origin 5")),
    ("--to raw --size 66 --tiles 2x2", 3, ("66 vertices ", " nearest: 65 or 67")),
    ("--to raw --size 9 --tiles 9x1", 3, ("nearest: 10\n",)),
    ("--to raw --tiles 300x300", 3, ("expected 1 to 65536 tiles",)),
    ("--to raw --tiles 2x2 --tile-name {x}/{y}", 3, ("expected a valid file name",)),
    ("--to raw --format r64", 3, ("expected r16 or r32 or r16be as format, got 'r64'",)),
    ("--to raw --crs EPSG:25832", 3, ("raw has no option crs, only size, tiles",)),
    ("--to raw --grass --no-plants", 3, ("grass without plants",)),
    ("--to raw --heights 5,4", 3, ("expected the lowest and the highest",)),
    ("--to raw --heights=-1e30,1e30", 3, ("expected them within",)),
    ("--to raw --size 33 --heights 0,10", 3, ("the terrain goes from",)),
    ("--to png16 --size 1000000", 3, ("of memory, this machine has",)),
    ("--to unity --size 1000", 3, ("1000 vertices is not a valid size; nearest: 513 or 1025",)),
]
BATCH = [
    ("", 3, ("expected at least one sketch",)),
    ("nothing", 3, ("no sketch 'nothing'",)),
    ("SKETCH --seeds x", 3, ("seeds 'x': expected",)),
    ("SKETCH --set river", 3, ("expected NAME=VALUES",)),
    ("SKETCH --set river.1.wdth=3", 3, ("did you mean 'river.1.width'",)),
    ("SKETCH --set lake.1.depth=3", 3, ("no sketch of the batch has a label 1",)),
    ("SKETCH --size 99999", 3, ("expected 2 to 16385 vertices",)),
    ("SKETCH --to nowhere", 3, ("nowhere",)),
    ("SKETCH --to raw --map png", 2, ("map with a target",)),
    ("SKETCH --tiles 2x2", 2, ("needs --to TARGET",)),
    ("SKETCH --no-preview --view air", 2, ("it is the preview's",)),
    ("SKETCH --jobs 0", 2, ("--jobs",)),
    ("SKETCH --foliage odd", 3, ("expected foliage as one of",)),
    ("SKETCH --grass", 3, ("expected ply or both for grass",)),
    ("SKETCH --sweep none.toml", 3, ("none.toml: cannot be read",)),
]
TRACE = [
    ("--colour moor=#0000ff", 3, ("unknown layer 'moor'",)),
    ("--colour hill=#123456", 3, ("no colour of the legend in it",)),
    ("--colour hill=#123456 --colours x.toml", 2, ("expected one legend",)),
    ("--colours none.toml", 3, ("none.toml: cannot be read",)),
    ("--layer moor", 3, ("layer 'moor'",)),
    ("--layer hill --specks 3", 2, ("--specks: not with --layer",)),
    ("--bounds 1,2,3,4", 2, ("--bounds: not with a picture, only with vectors",)),
    ("--bounds 1,2,3", 2, ("WEST,SOUTH,EAST,NORTH",)),
    *((f"--extent {extent}", 3, ("extent",)) for extent in ("0", "nan")),
    ("--size 0", 3, ("size: expected 1 to 16384 px",)),
    ("--seed -1", 3, ("seed",)),
    ("--tolerance 2", 2, ("--tolerance",)),
    ("--preview p.jpg", 2, ("expected the name of a .png file",)),
    ("--preview no/such/p.png", 3, ("expected a file in an existing folder",)),
]
WORLD = [
    ("--bounds 1,2,3", 2, ("expected WEST,SOUTH,EAST,NORTH in metres, got '1,2,3'",)),
    ("--bounds 5,0,5,1", 3, ("west < east",)),
    ("--bounds 0,2,1,1", 3, ("south < north",)),
    ("--cell 0", 3, ("cell of more than 0 m",)),
    ("--cell nan", 3, ("finite",)),
    ("--cell 1e-7", 3, ("expected at least",)),
    ("--bounds 0,0,1e13,1e13 --cell 1e7", 3, ("coordinates must be finite and within",)),
    ("-o ' '", 3, ("expected a path to write to",)),
    ("-o world.png", 3, ("expected a name that ends in .zarr or .tif",)),
    ("--layers height,colour", 3, ("expected some of height, normal, materials",)),
    ("--layers normal", 3, ("expected height among them",)),
    *((f"--step {step}", 3, ("expected a power of two",)) for step in (0.3, 4096)),
    ("--plants csv", 3, ("expected plants as none, parquet or flatgeobuf",)),
    ("--grass", 3, ("grass without plants",)),
    ("--crs EPSG:4326", 3, ("in degrees",)),
    ("--crs nowhere", 3, ("not a coordinate reference system",)),
    ("--origin x", 2, ("expected two numbers",)),
    ("--workers 0", 2, ("--workers",)),
    ("--workers 2 --scheduler tcp://127.0.0.1:1", 2, ("--workers with --scheduler",)),
    ("--fast --workers 2", 2, ("--fast with workers",)),
    ("--scheduler 127.0.0.1", 3, ("tcp://",)),
    ("--scheduler tcp://127.0.0.1:1", 1, ("tcp://127.0.0.1:1",)),
]
STATS = [
    ("nowhere.zarr", 3, ("nowhere.zarr: no such file or folder",)),
    ("WORLD --level 9", 3, ("no level 9: expected 0 to 0",)),
    ("WORLD --level 0 --check", 2, ("--level with --check",)),
    ("SKETCH", 3, ("expected a world",)),
    ("SKETCH --check", 3, ("its ledger is missing",)),
]
COMMANDS = {
    "usage": ("", "", USAGE),
    "generate": ("generate SKETCH --size 9", "-o OUT", GENERATE),
    "render": ("render SKETCH", "-o OUT.png", RENDER),
    "fly": ("fly SKETCH", "", FLY),
    "export": ("export SKETCH", "-o OUT", EXPORT),
    "batch": ("batch", "-o OUT", BATCH),
    "trace": ("trace MAP", "-o OUT", TRACE),
    "world": ("world SKETCH", "-o world.zarr", WORLD),
    "stats": ("stats", "", STATS),
}


@pytest.fixture(scope="module")
def paths(sketch, tmp_path_factory) -> dict[str, str]:
    """A sketch, a coloured map and a stored world."""
    import numpy as np
    from PIL import Image

    folder = tmp_path_factory.mktemp("inputs")
    pixels = np.full((60, 90, 3), 255, np.uint8)
    pixels[5:30, 5:40] = (139, 90, 43)
    Image.fromarray(pixels).save(folder / "map.png")
    world = folder / "world.zarr"
    assert main(["world", str(sketch), "--cell", "8", "-o", str(world)]) == 0
    return {"SKETCH": str(sketch), "MAP": str(folder / "map.png"), "WORLD": str(world)}


@pytest.mark.parametrize("command", COMMANDS)
def test_invalid_arguments_are_refused(call, paths, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    out = str(tmp_path / "out")
    first, output, refusals = COMMANDS[command]
    for words, code, parts in refusals:
        line = f"{first} {words} {'' if '-o ' in words else output}"
        done = call(*(paths.get(word, word.replace("OUT", out)) for word in shlex.split(line)))
        assert (done.code, done.out) == (code, ""), (line, done.err)
        assert all(part in f"{done.error}\n" for part in parts), (line, done.error)
        assert list(tmp_path.iterdir()) == [], line


def test_outputs_into_a_sketchs_folder_are_refused(call, paths, sketch, tmp_path, monkeypatch):
    folder = tmp_path / "mine"
    shutil.copytree(sketch, folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    monkeypatch.chdir(folder)
    for words in (
        *("generate . -o .", "export MINE --to raw -o MINE", "batch MINE -o . --size 9", "fly . -o ."),
        *("render . -o a.png", "adherence . -o MINE/a.png", "realism . --map a.png", "view WORLD -o a.png"),
        "trace MAP -o OUT --preview a.png",
        "bench kernels --quick -o .",
    ):
        known = {**paths, "OUT": str(tmp_path / "out"), "MINE": str(folder), "MINE/a.png": f"{folder}/a.png"}
        done = call(*(known.get(word, word) for word in shlex.split(words)))
        assert (done.code, done.out) == (3, ""), (words, done.err)
        assert done.error.endswith(": holds a sketch.toml: expected another folder to write into"), words
        assert {path.name: path.read_bytes() for path in folder.iterdir()} == before, words
    done = call("world", ".", "-o", ".", "--cell", 8)
    assert (done.code, "holds other files" in done.error) == (3, True)


def test_missing_displays_libraries_and_sketches_are_errors(call, tmp_path, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    for name in ("XDG_CONFIG_HOME", "XDG_STATE_HOME", "XDG_RUNTIME_DIR"):
        monkeypatch.setenv(name, str(tmp_path))
    offscreen = {"QT_QPA_PLATFORM": "offscreen"}
    for name, environment, code, part in (
        ("valley_river", {}, 1, "no display: neither DISPLAY nor WAYLAND_DISPLAY is set"),
        ("valley_river", {"DISPLAY": ":4099"}, 1, "the X server at DISPLAY=:4099 does not answer\n"),
        (
            "valley_river",
            {"QT_QPA_PLATFORM": "wayland", "WAYLAND_DISPLAY": "wayland-7"},
            1,
            "expected WAYLAND_DISPLAY to name a running compositor\n",
        ),
        ("no_such_sketch", offscreen, 3, "no_such_sketch"),
        ("/dev/null", offscreen, 3, "/dev/null"),
    ):
        with monkeypatch.context() as patch:
            for key, value in environment.items():
                patch.setenv(key, value)
            done = call("edit", name)
        assert (done.code, part in f"{done.error}\n") == (code, True), (name, done.err)
        assert not list(tmp_path.iterdir())


def test_missing_qt_is_an_error():
    code = "import sys\nsys.modules['PyQt6'] = None\nfrom sketchterrain.app.cli import main\n"
    done = subprocess.run(
        [sys.executable, "-c", f"{code}sys.exit(main(['edit', 'valley_river']))"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert done.stderr == "sketchterrain: error: the desktop program needs Qt: pip install PyQt6\n"


def test_missing_system_library_names_its_package(monkeypatch):
    import ctypes

    from sketchterrain.ui.app import check_screen

    def refuse(name: str) -> None:
        raise OSError("libxcb-cursor.so.0: cannot open shared object file: No such file or directory")

    monkeypatch.setattr(ctypes, "CDLL", refuse)
    with pytest.raises(SketchterrainError, match="apt install libxcb-cursor0"):
        check_screen({"DISPLAY": ":0"})
