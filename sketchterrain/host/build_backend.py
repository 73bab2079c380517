"""Build backend of the package: setuptools', with the compiled loops of the host in the wheel."""

import base64
import hashlib
import os
import re
import sys
import sysconfig
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from compiling import compile_levels, delete_stale, find_compiler
from setuptools import build_meta

build_sdist = build_meta.build_sdist
get_requires_for_build_sdist = build_meta.get_requires_for_build_sdist
prepare_metadata_for_build_editable = build_meta.prepare_metadata_for_build_editable

ROOT: Final = Path(__file__).resolve().parents[2]
SOURCES: Final = ROOT / "kernels" / "host"
PLATFORMS: Final = {
    "manylinux_2_17_x86_64": ("linux", "x86_64", "x86_64-linux-gnu.2.17"),
    "manylinux_2_17_aarch64": ("linux", "aarch64", "aarch64-linux-gnu.2.17"),
    "win_amd64": ("win32", "x86_64", "x86_64-windows-gnu"),
    "macosx_11_0_arm64": ("darwin", "aarch64", "aarch64-macos.11.0"),
    "macosx_11_0_x86_64": ("darwin", "x86_64", "x86_64-macos.11.0"),
}
"""System, architecture and zig's target of the platforms that ``pip wheel -C platform=…`` builds for."""

ZIG: Final = "ziglang>=0.13"


def get_requires_for_build_wheel(config_settings: Any = None) -> list[str]:
    """Return what pip installs before it builds a wheel: zig for another platform or without a compiler."""
    found = None if _platform(config_settings) else find_compiler()
    return [*build_meta.get_requires_for_build_wheel(config_settings), *([] if found else [ZIG])]


def get_requires_for_build_editable(config_settings: Any = None) -> list[str]:
    """Return what pip installs before it installs a checkout."""
    return [*build_meta.get_requires_for_build_editable(config_settings), *([] if find_compiler() else [ZIG])]


def build_editable(
    wheel_directory: str, config_settings: Any = None, metadata_directory: str | None = None
) -> str:
    """Compile the loops into the checkout, if it can be written: else they are when they are first called."""
    folder = ROOT / "sketchterrain" / "host"
    if os.access(folder, os.W_OK):
        delete_stale(folder, compile_levels(SOURCES, folder, find_compiler() or ["cc"])[0].name)
    return str(build_meta.build_editable(wheel_directory, config_settings, metadata_directory))


def build_wheel(
    wheel_directory: str, config_settings: Any = None, metadata_directory: str | None = None
) -> str:
    """Build a wheel for every version of Python on this platform, or on the one that settings name."""
    platform = _platform(config_settings)
    with tempfile.TemporaryDirectory() as folder:
        if platform:
            system, machine, target = PLATFORMS[platform]
            zig = [sys.executable, "-m", "ziglang", "cc"]
            libraries = compile_levels(SOURCES, Path(folder), zig, system, machine, ("-target", target))
        else:
            libraries = compile_levels(SOURCES, Path(folder), find_compiler() or ["cc"])
        wheel = Path(wheel_directory) / build_meta.build_wheel(
            wheel_directory, config_settings, metadata_directory
        )
        platform = platform or re.sub(r"[-.]", "_", sysconfig.get_platform())
        found = add_libraries(wheel, libraries, platform)
    wheel.unlink()
    return found.name


def _platform(config_settings: Any) -> str | None:
    """Return the platform that settings name; raise ValueError if it is not known."""
    platform = (config_settings or {}).get("platform")
    if platform not in {None, *PLATFORMS}:
        raise ValueError(f"expected platform as one of {', '.join(PLATFORMS)}, got {platform!r}")
    return platform


def add_libraries(wheel: Path, libraries: Sequence[Path], tag: str) -> Path:
    """Write a wheel for one platform beside one for any, with libraries in it; return its path."""
    target = wheel.with_name(wheel.name.replace("-any.whl", f"-{tag}.whl"))
    with ZipFile(wheel) as old, ZipFile(target, "w", ZIP_DEFLATED) as new:
        entries = {
            entry: old.read(entry) for entry in old.infolist() if not entry.filename.endswith("RECORD")
        }
        record = next(entry for entry in old.infolist() if entry.filename.endswith(".dist-info/RECORD"))
        for library in libraries:
            entry = ZipInfo(f"sketchterrain/host/{library.name}", record.date_time)
            entry.external_attr = 0o755 << 16
            entries[entry] = library.read_bytes()
        lines = []
        for entry, content in entries.items():
            if entry.filename.endswith(".dist-info/WHEEL"):
                content = content.replace(b"-any\n", f"-{tag}\n".encode()).replace(
                    b"lib: true", b"lib: false"
                )
            new.writestr(entry, content, ZIP_DEFLATED)
            digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
            lines.append(f"{entry.filename},sha256={digest},{len(content)}\n")
        new.writestr(record, "".join([*lines, f"{record.filename},,\n"]), ZIP_DEFLATED)
    return target
