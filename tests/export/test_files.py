"""Atomic files, staging folders, formatted numbers, PNG values and the sidecar."""

import json
import os
import signal
import subprocess
import sys

import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
from PIL import Image

from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.export.files import (
    format_rows,
    move_files,
    staging,
    stale_files,
    write_json,
    write_json_list,
    write_values_png,
)
from sketchterrain.export.target import SIDECAR, SettingRow, setting_rows
from sketchterrain.export.vectors import ExportLayer, geopackage
from sketchterrain.io.files import write_atomic


def test_failed_writes_leave_the_old_file_unchanged(tmp_path, monkeypatch):
    with pytest.raises(SketchterrainError, match="cannot be written") as caught:
        write_atomic(tmp_path / "no" / "a.bin", b"")
    assert str(caught.value).isprintable()
    assert ".tmp" not in str(caught.value)

    path = tmp_path / "a.bin"
    write_atomic(path, b"new")
    assert write_atomic(path, b"old") == path
    for failure, message in [
        (OSError(28, "No space left on device"), r"a\.bin: cannot be written \(No space left on device\)$"),
        (KeyboardInterrupt(), "^$"),
    ]:

        def failing(_, failure=failure):
            raise failure

        monkeypatch.setattr(os, "fsync", failing)
        with pytest.raises((SketchterrainError, KeyboardInterrupt), match=message):
            write_atomic(path, b"new")
        assert path.read_bytes() == b"old"
        assert [entry.name for entry in tmp_path.iterdir()] == ["a.bin"]


def run_killed(code, path):
    command = [sys.executable, "-c", f"import os, pathlib, signal, sys\n{code}", str(path)]
    assert subprocess.run(command, check=False).returncode == -signal.SIGKILL


def test_killed_process_leaves_the_old_file_unchanged(tmp_path):
    path = tmp_path / "a.bin"
    write_atomic(path, b"old")
    code = (
        "from sketchterrain.io.files import write_atomic\n"
        "os.fsync = lambda _: os.kill(os.getpid(), signal.SIGKILL)\n"
        "write_atomic(pathlib.Path(sys.argv[1]), b'new')\n"
    )
    run_killed(code, path)
    assert path.read_bytes() == b"old"


def test_geopackages_in_a_folder_of_any_name(tmp_path):
    folder = tmp_path / os.fsdecode(b"gel\xe4nde")
    folder.mkdir()
    with geopackage(folder / "a.gpkg", "EPSG:25832") as file:
        file.add(ExportLayer("points", "Point", np.array([shapely.Point(1.0, 2.0)], object), {}))
    assert pyogrio.read_info((folder / "a.gpkg").rename(tmp_path / "a.gpkg"))["features"] == 1


def test_json_preserves_order_and_unicode_and_refuses_nan(tmp_path):
    text = write_json(tmp_path / "a.json", {"z": 1, "a": "Höhe"}).read_text(encoding="utf-8")
    assert list(json.loads(text)) == ["z", "a"]
    assert "Höhe" in text
    place = os.fsdecode(b"gel\xe4nde")  # a file's name that is not UTF-8
    assert json.loads(write_json(tmp_path / "c.json", {"folder": place}).read_bytes()) == {"folder": place}
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "b.json", {"z": float("nan")})
    assert not (tmp_path / "b.json").exists()


def test_staged_files_are_moved_together_and_errors_name_the_final_folder(tmp_path):
    (tmp_path / "old").write_bytes(b"old")
    with staging(tmp_path) as hidden:
        assert hidden.parent == tmp_path
        (hidden / "a").write_bytes(b"a")
        (hidden / "unwanted").write_bytes(b"")
        assert move_files(tmp_path, [hidden / "a"], stale=[tmp_path / "old"]) == (tmp_path / "a",)
    assert [path.name for path in tmp_path.iterdir()] == ["a"]

    with pytest.raises(SketchterrainError, match="cannot be written") as caught, staging(tmp_path) as hidden:
        raise SketchterrainError(f"{hidden / 'a'}: cannot be written")
    assert str(caught.value).startswith(f"{tmp_path / 'a'}: ")
    with pytest.raises(SketchterrainError, match="cannot be written"), staging(tmp_path / "none"):
        pass


def test_abandoned_staging_folders_are_removed_and_active_ones_not(tmp_path):
    code = (
        "from sketchterrain.export.files import staging\n"
        "with staging(pathlib.Path(sys.argv[1])) as hidden:\n"
        "    (hidden / 'half').write_bytes(b'half')\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    run_killed(code, tmp_path)
    (left,) = tmp_path.iterdir()
    assert [path.name for path in left.iterdir()] == ["half"]
    with staging(tmp_path) as first:
        assert not left.exists()
        with staging(tmp_path) as second:
            assert first.is_dir()
            assert second != first
        assert [*tmp_path.iterdir()] == [first]
    assert [*tmp_path.iterdir()] == []


def test_stale_files_are_those_of_the_same_sketch_and_target(tmp_path):
    for name in ("a", "b", "c"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "d").write_bytes(b"")
    before = ["a", "b", "gone", "inner", "inner/d", "../" + tmp_path.name + "/c", "", "."]
    report = write_json(tmp_path / "report.json", {"format": 1, "files": before})
    assert stale_files(report, {"format": 1, "files": ["b", "new"]}, ["format"]) == [tmp_path / "a"]

    def sidecar(*names, target="raw"):
        files = [{"file": name} for name in names]
        return {"format": 1, "target": target, "sketch": "a", "files": files}

    def stale():
        return stale_files(tmp_path / SIDECAR, current, ("format", "target", "sketch"))

    (tmp_path / "old").write_bytes(b"")
    (tmp_path / "common").write_bytes(b"")
    current = sidecar("common", "new")
    assert stale() == []
    for content in ("[]", "{", json.dumps(sidecar("old", "common", target="png16"))):
        (tmp_path / SIDECAR).write_text(content)
        assert stale() == [], content
    (tmp_path / SIDECAR).write_text(json.dumps(sidecar("old", "common")))
    assert stale() == [tmp_path / "old"]


def test_settings_become_rows_with_headings_and_limited_lists():
    settings = {"Resolution": 65, "Flip": False, "scale": 1 / 3, "crs": None, "bands": [1, 2]}
    settings["Scale"] = {"X": 100.0, "Y": -2.5}
    values = ("65", "no", "0.3333333333", "none", "1, 2", "X 100  Y -2.5")
    assert [row.value for row in setting_rows(settings)] == list(values)

    tiles = [{"file": f"a_{number}.raw", "Position": {"X": 0.5 * number}} for number in range(6)]
    rows = setting_rows({"tiles": tiles})
    tile = [SettingRow(0, "tile 1", ""), SettingRow(1, "file", "a_0.raw"), SettingRow(1, "Position", "X 0")]
    assert rows[:3] == tile
    assert len(rows) == 4 * 3 + 1
    assert rows[-1] == SettingRow(0, "tiles", "2 more in terrain.json")
    assert setting_rows({"tiles": tiles[:1]})[0] == SettingRow(0, "tile", "")
    rows = setting_rows({"texture": {"file": "a.exr", "plane": {"size": 1.0, "place": {"x": 1.0}}}})
    assert [row.depth for row in rows] == [0, 1, 1, 2, 2]


def test_numbers_are_formatted_as_by_python():
    for places in [1, 4, 7]:
        ties = np.array([0.0, -0.0, 0.5, -0.5, 1.5, 2.5, 999.5, -(10.0**places)]) / 10.0**places
        for size in [1e-6, 12.0, 123456.0, 1e8, 1e15, 1e200]:
            values = np.append(np.random.default_rng(places).normal(0.0, size, 2000), ties)
            rounded = np.rint(values * 10.0**places) / 10.0**places + 0.0  # halves to even, no negative zero
            expected = "".join(f"{value:.{places}f}\n" for value in rounded)
            assert format_rows(f"%.{places}f\n", values) == expected.encode(), (places, size)

    names = np.array(["oak tree", "fir"], object)
    assert format_rows("%d,%s,%.1f\n", np.uint8([7, 255]), names, np.array([-0.04, -22.5])) == (
        b"7,oak tree,0.0\n255,fir,-22.5\n"
    )
    assert format_rows("%.3f\n", np.zeros(0)) == b""
    for invalid in [np.nan, np.inf]:
        with pytest.raises(InputError, match="expected finite numbers to write as text, got"):
            format_rows("%.3f\n", np.array([1.0, invalid, 2.0]))


def test_json_lists_are_valid_and_failed_ones_leave_no_file(tmp_path):
    pieces = [b"[1.0,1.0],\n[-22.25,-22.2]", b"", b"[0.0,0.0]"]
    content = json.loads(
        write_json_list(tmp_path / "a.json", {"format": 1, "é": "ü"}, "rows", pieces).read_text()
    )
    assert content == {"format": 1, "é": "ü", "rows": [[1.0, 1.0], [-22.25, -22.2], [0.0, 0.0]]}
    assert json.loads(write_json_list(tmp_path / "b.json", {}, "rows", []).read_text()) == {"rows": []}
    with pytest.raises(SketchterrainError, match="cannot be written"):
        write_json_list(tmp_path / "gone" / "a.json", {}, "rows", [])

    def failing():
        yield b"[1]"
        raise InputError("no more")

    with pytest.raises(InputError, match="no more"):
        write_json_list(tmp_path / "c.json", {"format": 1}, "rows", failing())
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.json", "b.json"]


def test_png_values_round_trip_in_pillow_and_gdal(tmp_path):
    random, path = np.random.default_rng(1), tmp_path / "a.png"
    whole = np.arange(60 * 80, dtype=np.uint16).reshape(60, 80)
    cases = [
        *((shape, kind) for shape in ((1, 1), (1, 7), (65, 5), (200, 3)) for kind in (np.uint8, np.uint16)),
        *(((130, 9, channels), np.uint8) for channels in (3, 4)),
    ]
    arrays = [random.integers(0, np.iinfo(kind).max, shape, kind, endpoint=True) for shape, kind in cases]
    for values in [*arrays, whole[5:50:2, 70:3:-3], whole.T, np.broadcast_to(np.uint16(7), (9, 9))]:
        content = write_values_png(path, values).read_bytes()
        assert write_values_png(path, values).read_bytes() == content
        with Image.open(path) as image:
            np.testing.assert_array_equal(np.asarray(image), values)
        with pytest.warns(rasterio.errors.NotGeoreferencedWarning):
            other = rasterio.open(path)
        with other:
            assert set(other.dtypes) == {values.dtype.name}
            np.testing.assert_array_equal(np.moveaxis(other.read(), 0, -1).reshape(values.shape), values)

    x = np.linspace(0.0, 6.0, 500)
    values = np.rint(20_000 * (1.0 + np.sin(x) * np.cos(x[:, None]))).astype(np.uint16)
    assert write_values_png(path, values).stat().st_size < 0.8 * values.nbytes
    with pytest.raises(SketchterrainError, match="cannot be written"):
        write_values_png(tmp_path / "no" / "a.png", np.zeros((2, 2), np.uint8))
