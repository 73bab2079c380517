"""Failures of a device: the work is restarted on another one, with the same files."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl
import pytest

import sketchterrain.jobs.export
from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import save_sketch
from sketchterrain.errors import DeviceFailedError
from sketchterrain.generation.self_test import Verdict, self_test
from tests.devices import KNOWN, needs_known_device

pytestmark = needs_known_device


def status(code: int) -> cl.Error:
    return cl.RuntimeError(cl._cl._ErrorRecord(msg="injected", code=code, routine="clInjected"))


class Failing:
    """Counts the calls of OpenCL on one device, and lets one of them fail."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, device: object) -> None:
        self.calls: list[str] = []
        self.at: int | None = None
        real = ComputeContext._call

        def call(context: ComputeContext, doing: str, work: Any, *given: Any, **named: Any) -> Any:
            if context.device != device:
                return real(context, doing, work, *given, **named)
            self.calls.append(doing)
            if len(self.calls) - 1 == self.at:
                return real(context, doing, self._fail)
            return real(context, doing, work, *given, **named)

        monkeypatch.setattr(ComputeContext, "_call", call)

    def _fail(self) -> None:
        raise status(cl.status_code.OUT_OF_RESOURCES)

    def at_call(self, number: int) -> None:
        self.calls.clear()
        self.at = number


@pytest.fixture(scope="module")
def tiny(tmp_path_factory) -> Path:
    mountain, river, forest = (np.zeros((16, 16), np.uint8) for _ in range(3))
    mountain[2:6, 9:14] = 1
    river[8:10] = 1
    forest[11:15, 2:8] = 1
    path = tmp_path_factory.mktemp("sketches") / "tiny"
    layers = {"mountain": mountain, "river": river, "forest": forest}
    save_sketch(Sketch(name="Tiny", extent=128.0, seed=5, layers=layers), path)
    return path


def generate(call: Callable[..., Any], sketch: Path, folder: Path, *more: object) -> Any:
    return call("generate", sketch, "-o", folder, "--size", 9, "--no-preview", *more)


def files(folder: Path) -> dict[str, bytes]:
    """Every file but the report, which holds times."""
    return {file.name: file.read_bytes() for file in folder.iterdir() if file.name != "report.json"}


def report(folder: Path) -> Any:
    return json.loads((folder / "report.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    "every", [pytest.param(0, marks=pytest.mark.slow), pytest.param(1, marks=pytest.mark.soak)]
)
def test_failure_at_any_call_restarts_on_another_device(call, tiny, tmp_path, monkeypatch, every):
    first, spare = KNOWN[:2]
    assert self_test(first, compare=False).bits == "same"
    failing = Failing(monkeypatch, first)
    options = ("--device", first.index, "--foliage", "both")
    assert generate(call, tiny, tmp_path / "whole", *options).code == 0
    expected, calls = files(tmp_path / "whole"), list(failing.calls)
    kinds = {"opening", "uploading", "downloading", "launching patches", "launching accept_graded"}
    assert kinds <= {*calls}
    selected = [number for number, doing in enumerate(calls) if every or doing not in calls[:number]]
    out = tmp_path / "out"
    for number in selected:
        failing.at_call(number)
        done = generate(call, tiny, out, *options)
        assert done.code == 0, (number, calls[number], done.err)
        assert files(out) == expected, (number, calls[number])
        data = report(out)
        # pocl's compiler prints to stderr, too, while its cache is cold.
        notes = [line for line in done.err.splitlines() if line.startswith("sketchterrain: ")]
        assert len(notes) == len(data["restarts"]) == 1, done.err
        assert notes[0] == f"sketchterrain: note: {data['restarts'][0]}"
        assert f"{first.name} ({first.platform}) failed at {calls[number]}" in notes[0]
        assert f"restarted on {spare.name}" in notes[0]
        assert data["device"]["platform"] == spare.platform


@pytest.mark.parametrize("number", [0, 60])
def test_without_another_device_nothing_is_written(call, tiny, tmp_path, monkeypatch, number):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "height.tif").write_text("old")
    device = KNOWN[0]
    self_test(device, compare=False)
    failing = Failing(monkeypatch, device)
    assert generate(call, tiny, tmp_path / "whole", "--device", device.index).code == 0
    monkeypatch.setattr("sketchterrain.compute.device.list_devices", lambda: (device,))
    failing.at_call(range(len(failing.calls))[number])
    done = generate(call, tiny, tmp_path / "out", "--device", device.index)
    assert done.code == 4
    assert "failed at" in done.error
    assert done.error.endswith("there is no other device to restart on")
    assert [(file.name, file.read_text()) for file in (tmp_path / "out").iterdir()] == [("height.tif", "old")]


@pytest.mark.slow
@pytest.mark.parametrize("foliage", ["none", "csv"])
def test_nonfinite_values_restart_on_another_device(call, tiny, tmp_path, monkeypatch, foliage):
    real = ComputeContext.download_into

    def download_into(context: ComputeContext, buffer: object, array: Any) -> None:
        real(context, buffer, array)
        if context.device == KNOWN[0] and array.ndim >= 3 and array.dtype == np.float32:
            array.flat[0] = np.nan

    options = ("--device", KNOWN[0].index, "--foliage", foliage)
    assert generate(call, tiny, tmp_path / "whole", *options).code == 0
    monkeypatch.setattr(ComputeContext, "download_into", download_into)
    assert generate(call, tiny, tmp_path / "out", *options).code == 0
    found = {"none": "non-finite normals and heights", "csv": "non-finite heights"}[foliage]
    assert found in report(tmp_path / "out")["restarts"][0]  # plants are computed first
    assert files(tmp_path / "out") == files(tmp_path / "whole")


@pytest.mark.slow
def test_failure_in_the_preview_restarts(call, tiny, tmp_path, monkeypatch):
    def picture(terrain: Any, **_: object) -> Any:
        if terrain.context.device == KNOWN[0]:
            raise DeviceFailedError("it broke")
        return np.zeros((4, 4, 3), np.uint8)

    monkeypatch.setattr("sketchterrain.jobs.generate._picture_taker", lambda *_: picture)
    monkeypatch.setattr("sketchterrain.jobs.pictures.render_picture", picture)
    size = ["--size", 9, "--device", KNOWN[0].index]
    assert call("generate", tiny, "-o", tmp_path, *size).code == 0
    data = report(tmp_path)
    assert data["restarts"][0].startswith("it broke; restarted on ")
    assert "preview.png" in data["files"]
    done = call("render", tiny, "-o", tmp_path / "a.png", "--device", KNOWN[0].index)
    assert (done.code, done.out) == (0, f"{tmp_path / 'a.png'}\n")
    assert done.err.count("it broke") == 1


def test_exhausted_device_memory_is_an_error(call, tiny, tmp_path, monkeypatch):
    real = ComputeContext._call

    def refuse(*_: object, **__: object) -> None:
        raise status(cl.status_code.MEM_OBJECT_ALLOCATION_FAILURE)

    def call_(context: ComputeContext, doing: str, work: Any, *given: Any, **named: Any) -> Any:
        return real(context, doing, refuse if doing == "launching patches" else work, *given, **named)

    monkeypatch.setattr(ComputeContext, "_call", call_)
    done = generate(call, tiny, tmp_path / "out")
    assert done.code == 4
    assert "has no memory left for launching patches" in done.error
    assert "not even a batch of one fits" in done.error
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.slow
def test_other_bits_print_a_note(call, tiny, tmp_path, monkeypatch):
    verdict = Verdict("other", "wrong in inverse_sqrt")
    monkeypatch.setattr(sketchterrain.jobs.export, "self_test", lambda device, *, compare: verdict)
    done = generate(call, tiny, tmp_path)
    assert (done.code, "self-test of" in done.err) == (0, True)
    assert any(line.endswith("other bits: wrong in inverse_sqrt") for line in done.err.splitlines())
    assert "self-test" not in generate(call, tiny, tmp_path, "--fast").err  # expected with --fast


@pytest.mark.slow
def test_fast_is_reported_and_close(call, tiny, tmp_path):
    import rasterio

    for name, more in (("exact", []), ("fast", ["--fast"])):
        assert generate(call, tiny, tmp_path / name, *more).code == 0
    assert "with --fast: other bits" in generate(call, tiny, tmp_path / "fast", "--fast").out
    assert (report(tmp_path / "exact")["fast"], report(tmp_path / "fast")["fast"]) == (False, True)
    heights = [rasterio.open(tmp_path / name / "height.tif").read(1) for name in ("exact", "fast")]
    np.testing.assert_allclose(*heights, atol=1e-3, rtol=0)


def test_a_device_that_fails_its_self_test_is_replaced(call, tiny, tmp_path, monkeypatch):
    failing = KNOWN[-1]

    def verdict(device: object, *, compare: bool) -> Verdict:
        if device == failing:
            return Verdict("failed", "the self-test crashed (SIGSEGV)")
        return Verdict("same", "")

    monkeypatch.setattr(sketchterrain.jobs.export, "self_test", verdict)
    done = generate(call, tiny, tmp_path, "--device", failing.index)
    assert done.code == 0
    (restart,) = report(tmp_path)["restarts"]
    assert f"{failing.name} ({failing.platform}) failed: the self-test crashed (SIGSEGV)" in restart
    assert report(tmp_path)["device"]["platform"] != failing.platform
