"""The default tier's device tests on other machines: other drivers, bare and read-only places."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.devices import DEVICES, machine

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
TESTS = ["tests/compute", "tests/cli/test_device_failures.py", "tests/world/test_serial.py"]
# name: variables, text of the summary
MACHINES = {
    "PoCL absent": ({"pocl": "absent"}, " passed"),
    "PoCL cannot build": ({"pocl": "broken"}, "kernels/self_test.cl did not build on"),
    "Intel absent": ({"intel": False}, " passed"),
    "no driver": ({"intel": False, "pocl": "absent"}, "no OpenCL device"),
}
# Mounts end with the namespace. The home cannot be written, not even by root.
BARE = """
set -e
mount --bind "$1" "$2" && mount -o remount,bind,ro "$2"
mount -t tmpfs -o size=64k,mode=1777 tmpfs /dev/shm
cd "$2"
exec env -i PATH="$PATH" PYTHONPATH="$3" LANG=C HOME=/proc/home "${@:4}"
"""
# The package is imported from the checkout's other path.
MOVED = """
import importlib, pathlib, sys
for entry in sys.path:
    for path in pathlib.Path(entry).glob("__editable___sketchterrain*.py"):
        mapping = importlib.import_module(path.stem).MAPPING
        mapping.update({name: place.replace(OLD, NEW, 1) for name, place in mapping.items()})
"""


def passing_run(command: list[object], environment: dict[str, str], *options: str) -> str:
    """Return the output of a test run, which must pass."""
    pytest_ = [sys.executable, "-m", "pytest", "-n", "0", "-q", "-p", "no:cacheprovider"]
    done = subprocess.run(
        [*map(str, command), *pytest_, *options, *TESTS],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
    return done.stdout


@pytest.mark.skipif(len(DEVICES) < 2, reason="needs two drivers, to hide one")
@pytest.mark.parametrize("name", MACHINES)
def test_device_tests_pass_with_other_drivers(name, tmp_path):
    hidden, expected = MACHINES[name]
    assert expected in passing_run([], os.environ | machine(tmp_path, **hidden))


def test_device_tests_pass_in_a_bare_read_only_place(tmp_path):
    """Without home, display, locale and shared memory, from a path that is not ASCII."""
    checkout, modules = tmp_path / "gelände", tmp_path / "modules"
    checkout.mkdir()
    modules.mkdir()
    (modules / "sitecustomize.py").write_text(f"OLD, NEW = {str(ROOT)!r}, {str(checkout)!r}{MOVED}", "utf-8")
    if shutil.which("unshare") is None or subprocess.run(["unshare", "--mount", "true"]).returncode:
        pytest.skip("needs unshare and the right to mount")
    command = ["unshare", "--mount", "bash", "-c", BARE, "bare", ROOT, checkout, modules]
    # That every kernel builds does not depend on the place.
    assert " passed" in passing_run(command, dict(os.environ), "-k", "not every_kernel")
