"""The library of compiled loops: checked calls, equal bits by every compiler and level, memory in bounds."""

import ctypes
import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from sketchterrain.benchmarks.host import SAMPLES
from sketchterrain.errors import BuildError
from sketchterrain.host import compiling, library

ROOT = Path(__file__).parents[2]
COMPILERS = {
    "gcc": ["gcc"],
    "clang": ["clang"],
    "zig": [sys.executable, "-m", "ziglang", "cc"],
}


@pytest.fixture
def fresh() -> Iterator[None]:
    """Caches of the library that are as a new process has them, before and after."""
    caches = library._prototypes, library._library
    for cached in caches:
        cached.cache_clear()
    yield
    for cached in caches:
        cached.cache_clear()


def results(path: Path | None, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Digests of what each function of a library returns and writes; None stands for the one in use."""
    library._prototypes.cache_clear()
    if path:
        loaded = ctypes.CDLL(str(path))
        monkeypatch.setattr(library, "_library", lambda: loaded)
    found = {}
    for name, sample in SAMPLES.items():
        digest = sha256()
        for size in (5, 33):
            arguments = sample(size)
            digest.update(repr(library.host_function(name)(*arguments)).encode())
            for argument in arguments:
                digest.update(
                    argument.tobytes() if isinstance(argument, np.ndarray) else repr(argument).encode()
                )
        found[name] = digest.hexdigest()
    monkeypatch.undo()
    return found


@pytest.mark.usefixtures("fresh")
def test_every_function_has_a_sample_with_the_same_results_each_time(monkeypatch: pytest.MonkeyPatch) -> None:
    assert set(SAMPLES) == set(library._prototypes())
    assert results(None, monkeypatch) == results(None, monkeypatch)


def test_arguments_are_checked() -> None:
    flood = library.host_function("fill_depressions")
    good = SAMPLES["fill_depressions"](4)

    def message(**changes: object) -> str:
        names = ("height", "rise", "filled", "parent", "scratch")
        with pytest.raises(ValueError, match="fill_depressions: expected ") as raised:
            flood(*(changes.get(name, value) for name, value in zip(names, good, strict=True)))
        return str(raised.value)

    assert "height as float64 (rows, columns), got float32 (4, 4)" in message(
        height=good[0].astype(np.float32)
    )
    assert "height as float64 (rows, columns), got float64 (16,)" in message(height=good[0].ravel())
    assert "height as float64 (rows, columns), got list" in message(height=[1.0])
    assert "height in C order" in message(height=good[0].T)
    assert "columns = 4 in the shape of filled, got (4, 5)" in message(filled=np.empty((4, 5)))
    assert "rows * columns = 16 in the shape of parent" in message(parent=np.empty(15, np.int64))
    still = np.empty((4, 4))
    still.flags.writeable = False
    assert "filled writable" in message(filled=still)
    with pytest.raises(
        ValueError, match=r"expected \(height, rise, filled, parent, scratch\), got 1 arguments"
    ):
        flood(good[0])


def test_a_library_is_named_by_its_sources_and_stale_ones_are_deleted(tmp_path: Path) -> None:
    sources = tmp_path / "sources"
    sources.mkdir()
    for name in ("host.h", "flow_routing.h", "flow_routing.c"):
        shutil.copy(library.SOURCES / name, sources)
    compiler = compiling.find_compiler()
    assert compiler
    level = library._level()
    first = tmp_path / compiling.library_name(sources, level)
    compiling.compile_library(sources, first, level, compiler)
    with (sources / "host.h").open("a") as header:
        header.write("/* changed */\n")
    second = tmp_path / compiling.library_name(sources, level)
    assert second != first
    compiling.compile_library(sources, second, level, compiler)
    compiling.delete_stale(tmp_path, second.name)
    assert [*tmp_path.glob("*.so")] == [second]
    (sources / "host.h").write_text("#error planted\n")
    with pytest.raises(RuntimeError, match="planted"):
        compiling.compile_library(sources, first, level, compiler)
    assert not first.exists()


@pytest.mark.usefixtures("fresh")
def test_the_cache_holds_the_library_where_the_package_cannot_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    locked = tmp_path / "package" / "library.py"
    locked.parent.write_text("a file, where a folder would be made")
    monkeypatch.setattr(library, "__file__", str(locked))
    monkeypatch.setattr(library, "cache_folder", lambda: tmp_path)
    monkeypatch.setenv(compiling.VARIABLE, "cc -O0")  # sooner compiled
    assert library._library()
    (built,) = (tmp_path / "host").glob("*.so")
    assert built.name == compiling.library_name(library.SOURCES, library._level())
    built.unlink()
    library._library.cache_clear()
    monkeypatch.setattr(compiling, "find_compiler", lambda: None)
    with pytest.raises(BuildError, match="no C compiler for kernels/host: sudo apt install gcc"):
        library._library()


@pytest.mark.slow
@pytest.mark.usefixtures("fresh")
@pytest.mark.parametrize("name", COMPILERS)
def test_compilers_and_levels_have_the_same_bits(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiler = COMPILERS[name]
    if not (importlib.util.find_spec("ziglang") if name == "zig" else shutil.which(name)):
        pytest.skip(f"{name} is not installed")
    expected = results(None, monkeypatch)
    levels = [
        level for level in compiling.LEVELS.get(compiling.architecture(), (0,)) if level <= library._level()
    ]
    for optimization in ("-O0", "-O2", "-O3"):
        for level in levels if optimization == "-O3" else levels[:1]:
            path = tmp_path / f"{level}{optimization}.so"
            compiling.compile_library(library.SOURCES, path, level, [*compiler, optimization])
            assert results(path, monkeypatch) == expected, (level, optimization)


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not installed")
def test_no_loop_leaves_its_arrays_or_overflows(tmp_path: Path) -> None:
    runtime = subprocess.run(
        ["gcc", "-print-file-name=libasan.so"], capture_output=True, text=True, check=True
    ).stdout.strip()
    if not Path(runtime).is_file():
        pytest.skip("gcc's address sanitizer is not installed")
    # gcc takes bounds such as rows + 1 for others, and arrays that are only read may be passed twice.
    flags = "-O1 -g -Wall -Wextra -Wno-vla-parameter -Wno-restrict -Werror"
    flags += " -fsanitize=address,undefined -fno-sanitize-recover=all"
    environment = os.environ | {compiling.VARIABLE: f"gcc {flags}", "LD_PRELOAD": runtime}
    environment["ASAN_OPTIONS"] = "detect_leaks=0"
    # The checkout keeps its own library.
    code = (
        "import sys, pytest; from pathlib import Path; from sketchterrain.host import library; "
        "folder = Path(sys.argv[1]); library.__file__ = str(folder / 'missing' / 'library.py'); "
        "library.cache_folder = lambda: folder; sys.exit(pytest.main(sys.argv[2:]))"
    )
    tests = "-n0", "-q", "-x", "-p", "no:cacheprovider", str(Path(__file__).parent)
    command = [sys.executable, "-c", code, str(tmp_path), *tests]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    assert list(tmp_path.rglob("*.so"))
