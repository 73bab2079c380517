"""Visibility of the ``cpu`` extra's OpenCL runtime to pyopencl, beside the system's drivers.

The wheel ``intel-opencl-rt`` puts its libraries where no loader looks. The loader bundled with pyopencl reads
a folder of ``.icd`` files, one per driver; it gets a folder with every driver it would have found, and this
one.
"""

from __future__ import annotations

import ctypes
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

_SYSTEM_VENDORS = Path("/etc/OpenCL/vendors")
_VENDORS_VARIABLE = "OCL_ICD_VENDORS"
# What libintelocl.so needs and would not find by itself, in the order of need.
_NEEDED = ("libirng.so", "libimf.so", "libintlc.so.5", "libsvml.so", "libtbb.so.12")


@contextmanager
def all_drivers_visible() -> Iterator[None]:
    """Make the first OpenCL call within this context find the system's drivers and the wheel's.

    The environment is restored afterwards for child processes. Does nothing without the wheel, or where the
    system has that runtime already.
    """
    library = _wheel_runtime()
    given = _given_icd_files()
    if library is None or any(library.name in text for text in given.values()):
        yield
        return
    _load_needed(library.parent)
    before = os.environ.get(_VENDORS_VARIABLE)
    with tempfile.TemporaryDirectory(prefix="sketchterrain-icd-") as folder:
        for name, text in given.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        (Path(folder) / "zz-intel-wheel.icd").write_text(f"{library}\n", encoding="utf-8")
        os.environ[_VENDORS_VARIABLE] = folder
        try:
            yield
        finally:
            if before is None:
                del os.environ[_VENDORS_VARIABLE]
            else:
                os.environ[_VENDORS_VARIABLE] = before


def _wheel_runtime() -> Path | None:
    """Return the path of the wheel's OpenCL driver, None if it is not installed."""
    try:
        installed = distribution("intel-opencl-rt").files or []
    except PackageNotFoundError:
        return None
    for file in installed:
        if file.name == "libintelocl.so":
            path = Path(str(file.locate())).resolve().with_name("libintelocl.so")
            return path if path.exists() and sys.platform == "linux" else None
    return None


def _given_icd_files() -> dict[str, str]:
    """Return name and text of every ``.icd`` file the loader would read by itself."""
    setting = os.environ.get(_VENDORS_VARIABLE)
    place = Path(setting) if setting else _SYSTEM_VENDORS
    if place.is_dir():
        return {file.name: file.read_text(encoding="utf-8") for file in sorted(place.glob("*.icd"))}
    if place.suffix == ".icd" and place.is_file():
        return {place.name: place.read_text(encoding="utf-8")}
    return {"user-setting.icd": f"{setting}\n"} if setting else {}


def _load_needed(folder: Path) -> None:
    for name in _NEEDED:
        # A newer runtime may no longer need one of them; what is truly missing shows when the driver loads.
        if (folder / name).exists():
            ctypes.CDLL(str(folder / name), ctypes.RTLD_GLOBAL)
