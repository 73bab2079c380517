"""Make the OpenCL CPU runtime of the ``cpu`` extra visible to pyopencl, hiding no other driver.

The wheel ``intel-opencl-rt`` puts its libraries where no loader looks. The loader that pyopencl brings along
reads a folder of ``.icd`` files, one a driver; we hand it a folder with every driver it would have found
anyway and one more.
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
    """Within this context the first OpenCL call of the process finds the system's drivers and the wheel's.

    The environment is put back afterwards, so that child processes start as this one did. Without the wheel,
    or where the system already has that runtime, nothing is changed.
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
    """Where the wheel's OpenCL driver lies, if it is installed in this environment."""
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
    """Every ``.icd`` file the loader would read by itself: of the user's setting or of the system."""
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
