"""The `bench` command: what a run prints and writes."""

import json

import pytest

from sketchterrain.benchmarks import command, run
from sketchterrain.benchmarks.splines import SEED
from sketchterrain.errors import DeviceError, InputError


@pytest.fixture(autouse=True)
def _small(monkeypatch, tiny) -> None:
    monkeypatch.setattr(command, "QUICK", tiny)


def test_a_run_prints_json(capsys):
    assert run(["splines"], output=None, quick=True, device=None, as_json=True) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["format"] == 1
    assert found["rounds"] == 2
    assert found["about"]["command"] == "sketchterrain bench splines --quick -o DIR"
    (splines,) = found["benchmarks"]
    assert (splines["name"], splines["seed"]) == ("splines", str(SEED))
    assert splines["tables"][0]["rows"]


@pytest.mark.slow
def test_a_run_writes_report_data_and_charts(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    target = tmp_path / "new" / "result"
    assert run(["culling", "splines"], output=target, quick=True, device=None, as_json=False) == 0
    assert sorted(path.name for path in target.iterdir()) == [
        "bench.json",
        "bench.md",
        "culling.png",
        "culling.svg",
        "splines.png",
        "splines.svg",
    ]
    page = (target / "bench.md").read_text(encoding="utf-8")
    for part in (
        "## splines",
        "## culling",
        "![culling](culling.png)",
        "2 rounds",
        "Seed: ",
        "| driver |",
        "pyopencl",
    ):
        assert part in page
    assert str(tmp_path) not in page + (target / "bench.json").read_text(encoding="utf-8")
    assert capsys.readouterr().out.strip() == str(target / "bench.md")


def test_invalid_names_devices_and_folders_are_refused(tmp_path):
    target = tmp_path / "file"
    target.write_text("kept")
    for name, device, output, error, line in (
        # before a device is opened
        ("nothing", "no such device", None, InputError, "no benchmark 'nothing'"),
        ("splines", "no such device", None, DeviceError, "no such device"),
        ("splines", None, target, InputError, "expected a folder to write into"),
    ):
        with pytest.raises(error, match=line):
            run([name], output=output, quick=True, device=device, as_json=False)
    assert target.read_text() == "kept"
