"""Packages and data files in pyproject.toml, and an installed wheel without the checkout."""

import base64
import hashlib
import importlib
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import pytest

from sketchterrain.errors import InputError
from sketchterrain.host import compiling, library
from sketchterrain.io import resources

ROOT = Path(__file__).parents[1]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
DATA = {".c", ".h", ".cl", ".clh", ".glsl", ".toml", ".png", ".jpg", ".svg", ".qss", ".fgb", ".raster"}


def test_every_package_and_data_file_is_listed() -> None:
    mapped = {folder: name for name, folder in SETTINGS["package-dir"].items()}
    there = set()
    for top, name in mapped.items():
        for init in (ROOT / top).rglob("__init__.py"):
            below = init.parent.relative_to(ROOT / top).parts
            there.add(".".join([name, *below]))
    assert set(SETTINGS["packages"]) == there
    for folder in ("kernels", "presets", "ui"):
        listed = {
            file
            for pattern in SETTINGS["package-data"][mapped[folder]]
            for file in (ROOT / folder).glob(pattern)
        }
        data = {file for file in (ROOT / folder).rglob("*") if file.suffix in DATA}
        assert data
        assert data <= listed, folder


@pytest.mark.soak
def test_wheel_contains_kernels_and_presets(tmp_path: Path) -> None:
    command = [
        sys.executable,
        *["-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir"],
        str(tmp_path),
        str(ROOT),
    ]
    subprocess.run(command, check=True)
    (wheel,) = tmp_path.glob("*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    for folder, pattern in (("kernels", "*.*"), ("presets", "*.*"), ("ui", "*.*")):
        for file in (ROOT / folder).rglob(pattern):
            if file.suffix in DATA:
                assert f"sketchterrain/{file.relative_to(ROOT).as_posix()}" in names
    expected = [
        compiling.library_name(library.SOURCES, level) for level in compiling.LEVELS[compiling.architecture()]
    ]
    assert {f"sketchterrain/host/{file}" for file in expected} <= names
    assert "-py3-none-any" not in wheel.name
    code = (
        f"import sys; sys.path[:0] = [{str(wheel)!r}, {sysconfig.get_path('purelib')!r}]; "
        "import sketchterrain; from sketchterrain.io import resources; print(sketchterrain.__file__); "
        "print(len(resources.source('terrain.cl')), *resources.preset_names())"
    )
    done = subprocess.run(
        [sys.executable, "-S", "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert wheel.name in done.stdout
    assert "valley_river" in done.stdout


def test_a_wheel_with_libraries_has_its_platform_and_a_true_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("setuptools")
    monkeypatch.syspath_prepend(str(ROOT / "sketchterrain" / "host"))
    backend = importlib.import_module("build_backend")
    wheel, built = tmp_path / "p-1-py3-none-any.whl", tmp_path / "host-0-linux-x86_64-2.so"
    with zipfile.ZipFile(wheel, "w") as file:
        file.writestr("p-1.dist-info/WHEEL", "Root-Is-Purelib: true\nTag: py3-none-any\n")
        file.writestr("p-1.dist-info/RECORD", "p-1.dist-info/WHEEL,sha256=0,0\n")
    built.write_bytes(b"\x7fELF")
    platform_wheel = backend.add_libraries(wheel, [built], "linux_x86_64")
    assert platform_wheel.name == "p-1-py3-none-linux_x86_64.whl"
    with zipfile.ZipFile(platform_wheel) as file:
        assert b"Purelib: false\nTag: py3-none-linux_x86_64\n" in file.read("p-1.dist-info/WHEEL")
        for line in file.read("p-1.dist-info/RECORD").decode().splitlines()[:-1]:
            name, digest, size = line.split(",")
            content = file.read(name)
            hashed = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).decode().rstrip("=")
            assert (digest, size) == (f"sha256={hashed}", str(len(content)))
        assert file.read(f"sketchterrain/host/{built.name}") == b"\x7fELF"
    with pytest.raises(ValueError, match="expected platform as one of manylinux_2_17_x86_64"):
        backend.build_wheel(str(tmp_path), {"platform": "amiga"})


def test_includes_are_expanded_once() -> None:
    text = resources.source("terrain.cl")
    assert '#include "' not in text
    assert text.count("INLINE REAL simplex(") == 1
    assert text.index("INLINE REAL simplex(") < text.index("INLINE TerrainSample terrain_at(")


def test_every_preset_has_a_small_picture() -> None:
    for name in resources.preset_names():
        picture = resources.preset_picture(name)
        assert picture.startswith(b"\xff\xd8")
        assert len(picture) < 60_000
    with pytest.raises(InputError, match="no preset 'valley': expected alpine_range"):
        resources.preset("valley")
