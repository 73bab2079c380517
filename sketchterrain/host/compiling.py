"""Compilation of ``kernels/host/*.c`` into a shared library, by the system's compiler or by zig.

The build backend runs it where nothing is installed: it imports only the standard library.
"""

import os
import platform
import shlex
import shutil
import subprocess
import sys
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

LEVELS: Final = {"x86_64": (2, 3, 4), "aarch64": (0,)}
"""Levels of vector instructions (x86-64-v…) by architecture; 0 is what every processor of it has."""

_ARCHITECTURES: Final = {"amd64": "x86_64", "arm64": "aarch64"}


def architecture() -> str:
    """Return the name of this machine's architecture, as compilers say it."""
    name = platform.machine().lower()
    return _ARCHITECTURES.get(name, name)


def library_name(sources: Path, level: int, system: str = sys.platform, machine: str | None = None) -> str:
    """Return the file name of the library of sources, with the digest of these and of the flags."""
    digest = sha256(" ".join(FLAGS).encode())
    for path in sorted([*sources.glob("*.c"), *sources.glob("*.h")]):
        digest.update(f"\n{path.name}\n".encode() + path.read_bytes())
    return f"host-{digest.hexdigest()[:16]}-{system}-{machine or architecture()}-{level}.so"


def find_compiler() -> list[str] | None:
    """Return the command of a C compiler: ``$CC``, the system's, or that of the package ziglang."""
    if os.environ.get("CC"):
        return shlex.split(os.environ["CC"])
    # Without the C library's headers a compiler is of no use.
    for name in ("cc", "gcc", "clang"):
        if (path := shutil.which(name)) and _works([path]):
            return [path]
    return [sys.executable, "-m", "ziglang", "cc"] if find_spec("ziglang") else None


def _works(compiler: list[str]) -> bool:
    with TemporaryDirectory() as folder:
        command = [*compiler, "-x", "c", "-", "-shared", "-fPIC", "-o", f"{folder}/empty.so"]
        program = "#include <math.h>\n#include <stdint.h>\nint64_t one(void) { return 1; }\n"
        return not subprocess.run(  # noqa: S603
            command, input=program, text=True, capture_output=True, check=False
        ).returncode


def compile_library(
    sources: Path, target: Path, level: int, compiler: list[str], flags: tuple[str, ...] = ()
) -> None:
    """Compile all sources of a folder into ``target``, which appears whole or not at all.

    ``flags`` follow `FLAGS`, as for another platform; raises RuntimeError with what the compiler said.
    """
    zig = "ziglang" in compiler
    command = [*compiler, *FLAGS, *([] if "windows" in " ".join(flags) else ["-fPIC"])]
    if level:
        command.append(f"-mcpu=x86_64_v{level}" if zig else f"-march=x86-64-v{level}")
    if zig:
        command.append("-fno-sanitize=undefined")
    with TemporaryDirectory(dir=target.parent) as folder:
        built = Path(folder) / target.name
        command += [*flags, *map(str, sorted(sources.glob("*.c"))), "-o", str(built), "-lm"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
        if done.returncode:
            raise RuntimeError(f"{shlex.join(compiler)} did not compile {sources}: {done.stderr.strip()}")
        built.replace(target)
