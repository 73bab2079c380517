"""Compilation of ``kernels/host/*.c`` into a shared library, by the system's compiler or by zig.

The build backend runs it where nothing is installed: it imports only the standard library.
"""

import os
import platform
import shlex
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

FLAGS: Final = (
    *("-std=c11", "-O3", "-shared", "-fvisibility=hidden"),
    *("-fwrapv", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math"),
)
"""Every compiler and processor computes the same bits: nothing is contracted or reordered."""

VARIABLE: Final = "SKETCHTERRAIN_CC"
"""Environment variable with a compiler and flags that are to be used in place of what is found."""

LEVELS: Final = {"x86_64": (2, 3, 4), "aarch64": (0,)}
"""Levels of vector instructions (x86-64-v…) by architecture; 0 is what every processor of it has."""

_ARCHITECTURES: Final = {"amd64": "x86_64", "arm64": "aarch64"}


def architecture() -> str:
    """Return the name of this machine's architecture, as compilers say it."""
    name = platform.machine().lower()
    return _ARCHITECTURES.get(name, name)


def library_name(sources: Path, level: int, system: str = sys.platform, machine: str | None = None) -> str:
    """Return the file name of the library of sources, with the digest of these and of the flags."""
    digest = sha256(" ".join((os.environ.get(VARIABLE, ""), *FLAGS)).encode())
    for path in sorted([*sources.glob("*.c"), *sources.glob("*.h")]):
        digest.update(f"\n{path.name}\n".encode() + path.read_bytes())
    return f"host-{digest.hexdigest()[:16]}-{system}-{machine or architecture()}-{level}.so"


def find_compiler() -> list[str] | None:
    """Return the command of a C compiler: a variable's, the system's, or that of the package ziglang."""
    for command in (os.environ.get(VARIABLE), os.environ.get("CC"), "cc", "gcc", "clang"):
        if command and _works(shlex.split(command)):
            return shlex.split(command)
    return [sys.executable, "-m", "ziglang", "cc"] if find_spec("ziglang") else None


def _works(compiler: list[str]) -> bool:
    """Return whether a compiler finds the C library's headers and links."""
    if not shutil.which(compiler[0]):
        return False
    with TemporaryDirectory() as folder:
        source, target = Path(folder) / "one.c", Path(folder) / "one.so"
        source.write_text("#include <math.h>\n#include <stdint.h>\nint64_t one(void) { return 1; }\n")
        command = [*compiler, "-shared", "-fPIC", str(source), "-o", str(target)]
        return not subprocess.run(command, capture_output=True, check=False).returncode  # noqa: S603


def compile_library(
    sources: Path, target: Path, level: int, compiler: list[str], flags: tuple[str, ...] = ()
) -> None:
    """Compile all sources of a folder into ``target``, which appears whole or not at all.

    ``flags`` are those of another platform. Raises RuntimeError with what the compiler said.
    """
    zig = "ziglang" in compiler
    own = 1 + max(number for number, word in enumerate(compiler) if not word.startswith("-"))
    command = [*compiler[:own], *FLAGS]
    if not any("windows" in flag for flag in flags):
        command.append("-fPIC")
    if level:
        command.append(f"-mcpu=x86_64_v{level}" if zig else f"-march=x86-64-v{level}")
    if zig:
        command.append("-fno-sanitize=undefined")
    command += [*flags, *compiler[own:]]  # last, so that a user's override
    with TemporaryDirectory(dir=target.parent) as folder, ThreadPoolExecutor(os.cpu_count()) as pool:

        def run(arguments: list[str]) -> None:
            done = subprocess.run([*command, *arguments], capture_output=True, text=True, check=False)  # noqa: S603
            if done.returncode:
                raise RuntimeError(f"{shlex.join([*command, *arguments])}: {done.stderr.strip()}")

        objects = {str(path): f"{folder}/{path.stem}.o" for path in sorted(sources.glob("*.c"))}
        list(pool.map(run, (["-c", source, "-o", path] for source, path in objects.items())))
        built = Path(folder) / target.name
        run([*objects.values(), "-o", str(built), "-lm"])
        built.replace(target)


def compile_levels(
    sources: Path,
    folder: Path,
    compiler: list[str],
    system: str = sys.platform,
    machine: str | None = None,
    flags: tuple[str, ...] = (),
) -> list[Path]:
    """Compile the libraries of all levels of an architecture into a folder, and return their paths."""

    def build(level: int) -> Path:
        path = folder / library_name(sources, level, system, machine)
        if not path.is_file():
            compile_library(sources, path, level, compiler, flags)
        return path

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(build, LEVELS.get(machine or architecture(), (0,))))


def delete_stale(folder: Path, name: str) -> None:
    """Delete libraries that were compiled from other sources than one of the given name."""
    for path in folder.glob("host-*.so"):
        if path.name.split("-")[1] != name.split("-")[1]:
            path.unlink(missing_ok=True)
