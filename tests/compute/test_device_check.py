"""Checks of devices in child processes: drivers that abort, results cached on disk."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import pytest

from sketchterrain.compute import device_check
from sketchterrain.compute.device import choose_device, fallback_device, list_devices
from sketchterrain.compute.device_check import DeviceCheck, cached_on_disk, check_device, is_usable
from sketchterrain.errors import DeviceFailedError
from sketchterrain.io.system import ChildFailedError, ChildTimedOutError, module_result, run_child
from tests.devices import DEVICES, needs_device

pytestmark = needs_device

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
POCL = [device for device in DEVICES if "Portable Computing Language" in device.platform]
FAILURE = (
    "the self-test crashed (SIGABRT): aborting driver: error: no firmware for this GPU; "
    "update or reinstall the driver"
)


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    check_device.cache_clear()
    yield tmp_path / "sketchterrain"
    check_device.cache_clear()


@pytest.fixture(scope="module")
def with_aborting_gpu(tmp_path_factory):
    """The environment of a machine whose preferred device aborts when it is opened."""
    if COMPILER is None:
        pytest.skip("no C compiler")
    folder = tmp_path_factory.mktemp("vendors")
    library = folder / "libaborting.so"
    source = Path(__file__).with_name("aborting_driver.c")
    subprocess.run([COMPILER, "-shared", "-fPIC", "-o", library, source], check=True)
    given = Path(os.environ.get("OCL_ICD_VENDORS", "/etc/OpenCL/vendors"))
    for file in given.glob("*.icd"):
        shutil.copy(file, folder)
    (folder / "aborting.icd").write_text(f"{library}\n", encoding="utf-8")
    return os.environ | {"OCL_ICD_VENDORS": str(folder)}


def listed_devices(environment):
    command = [sys.executable, "-m", "sketchterrain", "devices", "--json"]
    environment = environment | {device_check.TWIN_VARIABLE: ""}
    return json.loads(subprocess.run(command, capture_output=True, env=environment, check=True).stdout)


def test_an_aborting_driver_is_logged_once_and_skipped(with_aborting_gpu):
    code = "from sketchterrain.compute.context import ComputeContext; print(ComputeContext().device.name)"
    for _ in range(2):  # the second process reads the result from the cache
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, env=with_aborting_gpu, check=True
        )
        assert done.stdout.strip() == choose_device().name
        notes = [line for line in done.stderr.splitlines() if "Aborting GPU" in line]
        assert notes == [f"Aborting GPU (Aborting platform) is not used: {FAILURE}"]


@pytest.mark.soak
def test_devices_lists_an_aborting_driver(with_aborting_gpu):
    aborting, *others = listed_devices(with_aborting_gpu)
    assert (aborting["name"], aborting["type"]) == ("Aborting GPU", "GPU")
    assert aborting["self_test"] == {"bits": "failed", "detail": FAILURE}
    assert [entry["name"] for entry in others] == [each.name for each in list_devices() if not each.twin_of]
    assert [entry["name"] for entry in others if entry["default"]] == [choose_device().name]


@pytest.mark.soak
@pytest.mark.skipif(not POCL, reason="PoCL is not installed")
def test_pocl_without_a_linker_names_the_package_to_install(tmp_path):
    hidden = os.environ | {"PATH": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path)}
    entries = listed_devices(hidden)
    for test in (entry["self_test"] for entry in entries if entry["platform"] == POCL[0].platform):
        if POCL[0].driver.startswith("3.0"):  # the one of PyPI; others may bring their linker
            assert test["bits"] == "failed"
        if test["bits"] == "failed":
            assert test["detail"].endswith("install a linker: apt install gcc libc6-dev")


def test_a_check_is_cached_by_driver_version_and_linker(empty_cache, monkeypatch):
    runs = []

    monkeypatch.setattr(device_check, "module_result", lambda *given, **_: runs.append(given) or b'["cubic"]')
    device = DEVICES[0]

    def check(driver):
        check_device.cache_clear()  # as in another process
        return check_device(replace(device, driver=driver))

    assert check("1.0") == check("1.0") == DeviceCheck("", ("cubic",))
    assert len(runs) == 1
    check("1.1")
    assert len(runs) == 2
    check("1.1")
    monkeypatch.setattr(shutil, "which", lambda _: "/other/ld")
    check("1.1")
    assert len(runs) == 3
    for content in ("", "{", "[]", "null", '{"key": 3}'):
        for file in empty_cache.iterdir():
            file.write_text(content, encoding="utf-8")
        check("1.1")
    assert len(runs) == 8


def test_without_a_cache_folder_checks_run_each_time(empty_cache):
    empty_cache.write_text("a file where the folder should be", encoding="utf-8")
    device = DEVICES[0]
    results = iter([{"a": 1}, {"a": 2}])
    for expected in (1, 2):
        assert cached_on_disk("test", (device,), (), lambda: next(results)) == {"a": expected}


def test_devices_that_fail_are_skipped(empty_cache, monkeypatch):
    def result(_, index, **__):
        if index == "0":
            raise ChildFailedError("the self-test crashed (SIGSEGV)")
        return b"[]"

    failing, working = (replace(DEVICES[0], index=index, name=f"Device {index}") for index in (0, 1))
    monkeypatch.setattr("sketchterrain.compute.device.list_devices", lambda: (failing, working))
    monkeypatch.setattr(device_check, "module_result", result)
    assert not is_usable(failing)
    assert choose_device() == working
    assert fallback_device([working]) is None
    with pytest.raises(DeviceFailedError, match=r"no OpenCL device that fits --device 0 works: .*SIGSEGV"):
        choose_device("0")


def test_child_failures_have_a_message():
    linker = "import os; os.write(2, b'Final\\nno \\'ld\\' found\\n'); os.abort()"
    cases = {
        "import os; os.abort()": "it crashed (SIGABRT); update or reinstall the driver",
        linker: "it crashed (SIGABRT): no 'ld' found; install a linker: apt install gcc libc6-dev",
        "import signal; signal.pause()": "it did not answer within 0.1 s",
        "raise SystemExit('a reason\\n\\n')": "a reason",
        "raise SystemExit(3)": "it failed with code 3",
    }
    for code, message in cases.items():
        with pytest.raises(ChildFailedError) as caught:
            run_child([sys.executable, "-c", code], name="it", timeout=0.1 if "pause" in code else 300.0)
        assert str(caught.value) == message
    with pytest.raises(ChildFailedError, match="it did not start: "):
        run_child(["/no/such/program"], name="it", timeout=300.0)
    with pytest.raises(ChildFailedError, match="it exited early"):
        module_result("this", name="it", timeout=300.0)


def test_children_import_the_program_itself_not_a_folder_of_its_name(tmp_path, monkeypatch):
    """As a checkout, in whose folder an installed program is run."""
    (tmp_path / "this.py").write_text("import sys; open(sys.argv[-1], 'w').write('shadow')")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ChildFailedError, match="it exited early"):
        module_result("this", name="it", timeout=300.0)


def test_a_check_that_timed_out_is_not_cached(empty_cache, monkeypatch):
    slow = ChildTimedOutError("the self-test did not answer within 60 s")
    monkeypatch.setattr(device_check, "module_result", Mock(side_effect=slow))
    device = DEVICES[0]
    assert check_device(device) == DeviceCheck("the self-test did not answer within 60 s")
    assert not list(empty_cache.glob("device-*.json"))
    monkeypatch.setattr(device_check, "module_result", lambda *_, **__: b"[]")
    check_device.cache_clear()
    assert check_device(device) == DeviceCheck("")
