"""Packages and data files in pyproject.toml, and an installed wheel without the checkout."""

import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import pytest

from sketchterrain.errors import InputError
from sketchterrain.io import resources

ROOT = Path(__file__).parents[1]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
DATA = {".cl", ".clh", ".glsl", ".toml", ".png", ".jpg", ".svg", ".qss", ".fgb", ".raster"}


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
    for folder, pattern in (("kernels", "*.cl*"), ("kernels", "*.glsl"), ("presets", "*.*"), ("ui", "*.*")):
        for file in (ROOT / folder).rglob(pattern):
            if file.suffix in DATA:
                assert f"sketchterrain/{file.relative_to(ROOT).as_posix()}" in names
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
