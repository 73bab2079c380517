from __future__ import annotations

import io
import stat
import struct
import time
import tracemalloc
import zipfile
import zlib
from typing import TYPE_CHECKING

import pytest

from sketchterrain.sketch import load_sketch
from sketchterrain.sketch.archive import pack_zip

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

_SETTINGS = b"format = 1\n"
_TEN_GB = 10 * 10**9


@pytest.fixture
def packed(tmp_path: Path) -> Callable[..., Path]:
    """A zip with the given entries: names or whole descriptions, and contents."""

    def make(*entries: tuple[str | zipfile.ZipInfo, bytes], method: int = zipfile.ZIP_DEFLATED) -> Path:
        path = tmp_path / "valley.sketch"
        with zipfile.ZipFile(path, "w", method) as archive:
            for name, content in entries:
                archive.writestr(name, content)
        return path

    return make


def _zeros(count: int) -> bytes:
    """A raw deflate stream of `count` zeros, in pieces that repeat so that it takes no time to make."""
    piece = 10**7
    compressor = zlib.compressobj(9, zlib.DEFLATED, -15)
    first = compressor.compress(bytes(piece)) + compressor.flush(zlib.Z_FULL_FLUSH)
    return first * (count // piece) + compressor.flush()


def _bomb(name: str, count: int, *, declared: int, start: bytes = b"") -> bytes:
    """A zip whose entry `name` holds `count` zeros after `start` and says it has `declared` bytes."""
    head = zlib.compressobj(9, zlib.DEFLATED, -15)
    content = head.compress(start) + head.flush(zlib.Z_FULL_FLUSH) + _zeros(count)
    entries, directory = b"", b""
    for entry, size, data, method in (("sketch.toml", 11, _SETTINGS, 0), (name, declared, content, 8)):
        wide = struct.pack("<HHQQ", 1, 16, size, len(data)) if size >= 2**32 else b""
        sizes = (2**32 - 1, 2**32 - 1) if wide else (len(data), size)
        fields = (45, 0, method, 0, 33, zlib.crc32(data) if not method else 0, *sizes, len(entry), len(wide))
        at = len(entries)
        entries += struct.pack("<4sHHHHHIIIHH", b"PK\3\4", *fields) + entry.encode() + wide + data
        directory += struct.pack("<4sHHHHHHIIIHHHHHII", b"PK\1\2", 45, *fields, 0, 0, 0, 0, at)
        directory += entry.encode() + wide
    tail = struct.pack("<4sHHHHIIH", b"PK\5\6", 0, 0, 2, 2, len(directory), len(entries), 0)
    return entries + directory + tail


def test_the_sketch_may_lie_at_the_top_or_in_one_folder(
    packed: Callable[..., Path], grey: Callable[..., bytes]
) -> None:
    hill = grey([[1, 0, 0]])
    for top in ("", "My valley/"):
        sketch = load_sketch(
            packed((f"{top}sketch.toml", b"format = 1\nseed = 5\n"), (f"{top}hill.png", hill))
        )
        assert sketch.seed == 5
        assert sketch.layers["hill"].tolist() == [[1, 0, 0]]


def test_what_systems_put_beside_the_sketch_is_passed_over(packed: Callable[..., Path]) -> None:
    path = packed(
        ("valley/", b""),
        ("valley/sketch.toml", _SETTINGS),
        ("__MACOSX/valley/._hill.png", b"?"),
        (".DS_Store", b"?"),
        ("valley/._hill.png", b"?"),
        ("valley/source.xcf", b"?"),
        ("valley/notes/readme.txt", b"?"),
    )
    assert load_sketch(path).width_px == 512


@pytest.mark.parametrize(
    "name",
    [
        "../evil.toml",
        "a/../../evil",
        "/etc/evil",
        "a\\..\\evil",
        "C:/evil",
        "./sketch.toml",
        "a//b",
        "..",
        "a/..",
    ],
)
def test_paths_that_leave_the_sketch_are_refused(
    packed: Callable[..., Path], refusal: Callable[..., str], name: str, tmp_path: Path
) -> None:
    path = packed(("sketch.toml", _SETTINGS), (name, b"evil"))
    message = refusal(path)
    assert "refused: expected a" in message
    assert str(path) in message
    assert [entry.name for entry in tmp_path.iterdir()] == ["valley.sketch"]
    assert not (tmp_path.parent / "evil").exists()


def test_a_name_with_a_null_is_refused(packed: Callable[..., Path], refusal: Callable[..., str]) -> None:
    path = packed(("sketch.toml", _SETTINGS), ("hill.pngXevil", b""))
    path.write_bytes(path.read_bytes().replace(b"hill.pngX", b"hill.png\0"))
    assert "refused: expected a plain relative path" in refusal(path)


@pytest.mark.parametrize("kind", [stat.S_IFLNK, stat.S_IFIFO, stat.S_IFCHR])
def test_links_and_devices_are_refused(
    packed: Callable[..., Path], refusal: Callable[..., str], kind: int
) -> None:
    info = zipfile.ZipInfo("hill.png")
    info.external_attr = (kind | 0o777) << 16
    assert "not a link or a device" in refusal(packed(("sketch.toml", _SETTINGS), (info, b"/etc/passwd")))


def test_encrypted_entries_are_refused(packed: Callable[..., Path], refusal: Callable[..., str]) -> None:
    path = packed(("sketch.toml", _SETTINGS))
    data = bytearray(path.read_bytes())
    data[6] |= 1
    data[data.index(b"PK\1\2") + 8] |= 1
    path.write_bytes(data)
    assert "encrypted" in refusal(path)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_entries_that_are_there_twice_are_refused(
    packed: Callable[..., Path], refusal: Callable[..., str]
) -> None:
    assert "it is there twice" in refusal(packed(("sketch.toml", _SETTINGS), ("sketch.toml", _SETTINGS)))


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_other_compressions_are_refused(
    packed: Callable[..., Path], refusal: Callable[..., str], method: int
) -> None:
    assert "expected it stored or deflated" in refusal(packed(("sketch.toml", _SETTINGS), method=method))


def test_too_many_entries_are_refused(packed: Callable[..., Path], refusal: Callable[..., str]) -> None:
    assert "expected at most 1000" in refusal(packed(*((f"{i}.txt", b"") for i in range(1001))))


def test_entries_that_together_are_too_large_are_refused(
    packed: Callable[..., Path], refusal: Callable[..., str]
) -> None:
    entries = [(f"{i}.xcf", bytes(60 << 20)) for i in range(5)]
    assert "unpacked: too large: expected at most 256 MiB" in refusal(
        packed(("sketch.toml", _SETTINGS), *entries)
    )


@pytest.mark.parametrize("name", ["hill.png", "notes.txt"])
@pytest.mark.parametrize("declared", [_TEN_GB, 60 << 20, 1000])
@pytest.mark.parametrize("start", [b"", b"\x89PNG\r\n\x1a\n"])
def test_ten_gigabytes_of_zeros_take_neither_time_nor_memory(
    tmp_path: Path, refusal: Callable[..., str], name: str, declared: int, start: bytes
) -> None:
    path = tmp_path / "bomb.sketch"
    path.write_bytes(_bomb(name, _TEN_GB, declared=declared, start=start))
    tracemalloc.start()
    began = time.perf_counter()
    if name == "notes.txt" and declared < _TEN_GB:
        load_sketch(path)  # never unpacked: it says that it is small, and nobody asks for it
    else:
        assert "bomb.sketch" in refusal(path)
    assert time.perf_counter() - began < 5
    assert tracemalloc.get_traced_memory()[1] < 200 << 20
    tracemalloc.stop()


def test_settings_of_gigabytes_are_refused(packed: Callable[..., Path], refusal: Callable[..., str]) -> None:
    path = packed(("sketch.toml", _SETTINGS + bytes(2 << 20)))
    assert "sketch.toml: too large: expected at most 2 MiB" in refusal(path)


def test_a_file_larger_than_any_sketch_is_refused_unread(tmp_path: Path, refusal: Callable[..., str]) -> None:
    path = tmp_path / "huge.sketch"
    with path.open("wb") as stream:
        stream.truncate(1 << 40)  # sparse
    assert "too large: expected at most 256 MiB" in refusal(path)


@pytest.mark.parametrize("content", [b"", b"PK", b"not a zip", b"PK\5\6" + bytes(18)])
def test_what_is_no_sketch_is_refused(tmp_path: Path, refusal: Callable[..., str], content: bytes) -> None:
    path = tmp_path / "x.sketch"
    path.write_bytes(content)
    assert str(path) in refusal(path)


def test_a_damaged_zip_is_refused_wherever_it_is_damaged(
    packed: Callable[..., Path], refusal: Callable[..., str], grey: Callable[..., bytes]
) -> None:
    path = packed(("sketch.toml", _SETTINGS), ("hill.png", grey([[0, 1], [2, 3]])))
    whole = path.read_bytes()
    for length in range(0, len(whole), 3):
        path.write_bytes(whole[:length])
        assert "valley.sketch" in refusal(path)


def test_errors_inside_name_the_archive_and_the_file(
    packed: Callable[..., Path], refusal: Callable[..., str], grey: Callable[..., bytes]
) -> None:
    path = packed(("v/sketch.toml", b"format = 1\nextent = 0\n"))
    assert refusal(path) == f"{path}/sketch.toml: extent = 0: expected a number from 1 to 1000000 m"
    path = packed(("v/sketch.toml", _SETTINGS), ("v/mountains.png", grey([[0]])))
    assert "unknown layer image 'mountains.png'" in refusal(path)
    path = packed(("v/w/sketch.toml", _SETTINGS))
    assert "no sketch.toml" in refusal(path)


def test_a_zip_has_the_same_bytes_whenever_and_in_whatever_order_it_is_made() -> None:
    files = {"sketch.toml": b"format = 1", "hill.png": b"2"}
    data = pack_zip(files)
    assert data == pack_zip(dict(reversed(files.items())))
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert archive.testzip() is None
        assert {info.filename: archive.read(info) for info in archive.infolist()} == files
