"""Wheels of other platforms: what is in them, and Windows' library under Wine."""

import ctypes
import math
import shutil
import subprocess
import sys
import zipfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sketchterrain.benchmarks.host import SAMPLES
from sketchterrain.host import library

pytestmark = pytest.mark.soak
ROOT = Path(__file__).parents[2]
ZIG = [sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-windows-gnu"]
WINE = next((path for path in ("wine64", "wine", "/usr/lib/wine/wine64") if shutil.which(path)), None)
MAGIC = {"win_amd64": b"MZ", "macosx_11_0_arm64": b"\xcf\xfa\xed\xfe", "manylinux_2_17_aarch64": b"\x7fELF"}
SIZE = 21
LIBM = {"stroke_pieces", "drape_pieces", "compute_tops", "sinuosities", "geomorphons"}  # hypot, atan


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("wheels")
    for platform in MAGIC:
        command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(folder)]
        subprocess.run([*command, "--config-settings", f"platform={platform}", str(ROOT)], check=True)
    return {platform: next(folder.glob(f"*-py3-none-{platform}.whl")) for platform in MAGIC}


def libraries(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as file:
        names = [name for name in file.namelist() if name.startswith("sketchterrain/host/host-")]
        return {Path(name).name: file.read(name) for name in names}


def test_wheels_have_the_libraries_of_their_platform(wheels: dict[str, Path]) -> None:
    for platform, wheel in wheels.items():
        found = libraries(wheel)
        assert len(found) == (3 if platform == "win_amd64" else 1), platform
        for content in found.values():
            assert content.startswith(MAGIC[platform])
            assert all(name.encode() in content for name in library._prototypes())


def declared(signature: Any, arguments: Any) -> list[Any]:
    """Return what C is passed in the order of its declaration, with arrays, and lists for structures."""
    items, _ = signature.passed(arguments)
    items = [
        float(item) if kind is ctypes.c_double else item
        for item, kind in zip(items, signature.types, strict=True)
    ]
    for number, place, *_ in signature._arrays:
        items[place] = arguments[number]
    for number, place, _, structure in signature._others:
        if structure:
            inner = structure._signature
            items[place] = declared(inner, [getattr(arguments[number], each.name) for each in inner.given])
    return items


def program(name: str) -> str:
    """Return C that calls each function on its sample, and writes what is returned and all arrays."""
    lines = ["#include <stdio.h>", "#include <stdlib.h>", "#include <windows.h>"]
    lines += [f'#include "{path.name}"' for path in sorted(library.SOURCES.glob("*.h"))]
    lines += [
        "static void *get(FILE *f, size_t n) {",
        "void *p = malloc(n + 64); return fread(p, 1, n, f) == n ? p : 0; }",
        'int main(void) { FILE *in = fopen("given", "rb"), *out = fopen("found", "wb");',
        f'HMODULE all = LoadLibraryA("{name}"); if (!all) return 2;',
    ]
    for function, sample in SAMPLES.items():
        signature = library.host_function(function)._signature
        arrays: list[np.ndarray] = []

        def word(item: Any, arrays: list[np.ndarray]) -> str:
            if isinstance(item, np.ndarray):
                arrays.append(item)
                return f"(int64_t)a{len(arrays) - 1}"
            bits = (
                np.array(item, np.float64).view(np.uint64) if isinstance(item, float) else int(item) % 2**64
            )
            return f"(int64_t)UINT64_C({bits})"

        def argument(item: Any, word: Any) -> str:
            if isinstance(item, list):
                return f"(void *)(int64_t[]){{{', '.join(map(word, item))}}}"
            if isinstance(item, float):
                return item.hex() if math.isfinite(item) else f"(double){item}".replace("inf", "INFINITY")
            return f"(void *){word(item)}" if isinstance(item, np.ndarray) else word(item)

        items = declared(signature, sample(SIZE))
        call = ", ".join(argument(item, partial(word, arrays=arrays)) for item in items)
        kind = library.host_function(function)._result
        lines.append(
            f'{{ __typeof__(&{function}) f = (__typeof__(&{function}))GetProcAddress(all, "{function}");'
        )
        lines += [f"void *a{n} = get(in, {array.nbytes});" for n, array in enumerate(arrays)]
        lines.append(
            f"f({call});" if kind == "void" else f"{kind} r = f({call}); fwrite(&r, 1, sizeof r, out);"
        )
        lines += [f"fwrite(a{n}, 1, {array.nbytes}, out);" for n, array in enumerate(arrays)]
        lines.append("}")
    return "\n".join([*lines, "return fclose(out); }"])


def flat(items: list[Any]) -> list[np.ndarray]:
    """Return the arrays among arguments, in the order in which `program` names them."""
    found = []
    for item in items:
        found += flat(item) if isinstance(item, list) else [item] if isinstance(item, np.ndarray) else []
    return found


@pytest.mark.skipif(WINE is None, reason="Wine is not installed")
def test_functions_of_the_windows_wheel_have_the_same_bits(wheels: dict[str, Path], tmp_path: Path) -> None:
    pytest.importorskip("ziglang")
    given, expected = b"", []
    for function, sample in SAMPLES.items():
        called = library.host_function(function)
        arguments = sample(SIZE)
        arrays = flat(declared(called._signature, arguments))
        given += b"".join(array.tobytes() for array in arrays)
        value = called(*arguments)
        kind = {"int64_t": np.int64, "double": np.float64, "bool": np.bool_}.get(called._result)
        expected += [(function, each) for each in ([np.array(value, kind)] if kind else []) + arrays]
    (tmp_path / "given").write_bytes(given)
    for name, content in libraries(wheels["win_amd64"]).items():
        if int(name.split("-")[-1].removesuffix(".so")) > library._level():
            continue
        (tmp_path / name).write_bytes(content)
        (tmp_path / "calls.c").write_text(program(name))
        command = [*ZIG, "-O1", "-w", "-I", str(library.SOURCES), "calls.c", "-o", "calls.exe"]
        subprocess.run(command, cwd=tmp_path, check=True)
        subprocess.run([str(WINE), "calls.exe"], cwd=tmp_path, check=True)
        written = (tmp_path / "found").read_bytes()
        assert len(written) == sum(array.nbytes for _, array in expected)
        at = 0
        for function, array in expected:
            found = np.frombuffer(written[at : at + array.nbytes], array.dtype).reshape(array.shape)
            at += array.nbytes
            if function in LIBM:
                np.testing.assert_allclose(found, array, 1e-13)
            else:
                assert found.tobytes() == array.tobytes(), (name, function)
