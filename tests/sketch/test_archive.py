import io
import stat
import struct
import time
import tracemalloc
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest

from sketchterrain.sketch import load_sketch
from sketchterrain.sketch.archive import pack_zip

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


def test_the_sketch_may_lie_at_the_top_or_in_one_folder_beside_other_files(
    packed: Callable[..., Path], grey: Callable[..., bytes]
) -> None:
    hill = grey([[1, 0, 0]])
    for top in ("", "My valley/"):
        sketch = load_sketch(
            packed((f"{top}sketch.toml", b"format = 1\nseed = 5\n"), (f"{top}hill.png", hill))
        )
        assert sketch.seed == 5
        assert sketch.layers["hill"].tolist() == [[1, 0, 0]]

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


def _special(kind: int) -> zipfile.ZipInfo:
    """An entry of another kind than a file."""
    info = zipfile.ZipInfo("hill.png")
    info.external_attr = (kind | 0o777) << 16
    return info


_LEAVING = (
    "../evil.toml",
    "a/../../evil",
    "/etc/evil",
    "a\\..\\evil",
    "C:/evil",
    "./sketch.toml",
    "a//b",
    "..",
    "a/..",
)
# Entries beside the settings, and what the refusal says.
_REFUSED: list[tuple[list[tuple[str | zipfile.ZipInfo, bytes]], str]] = [
    *(([(name, b"evil")], "refused: expected a") for name in _LEAVING),
    *(
        ([(_special(kind), b"/etc/passwd")], "not a link or a device")
        for kind in (stat.S_IFLNK, stat.S_IFIFO, stat.S_IFCHR)
    ),
    ([("sketch.toml", _SETTINGS)], "it is there twice"),
    ([(f"{i}.txt", b"") for i in range(1001)], "expected at most 1000"),
    ([(f"{i}.xcf", bytes(60 << 20)) for i in range(5)], "unpacked: too large: expected at most 256 MiB"),
]


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_refused_entries(packed: Callable[..., Path], refusal: Callable[..., str], tmp_path: Path) -> None:
    for entries, expected in _REFUSED:
        path = packed(("sketch.toml", _SETTINGS), *entries)
        message = refusal(path)
        assert expected in message, entries[0]
        assert str(path) in message, entries[0]
        assert [entry.name for entry in tmp_path.iterdir()] == ["valley.sketch"]
        assert not (tmp_path.parent / "evil").exists()
    for method in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        message = refusal(packed(("sketch.toml", _SETTINGS), method=method))
        assert "expected it stored or deflated" in message
    path = packed(("sketch.toml", _SETTINGS + bytes(2 << 20)))
    assert "sketch.toml: too large: expected at most 2 MiB" in refusal(path)


def test_refused_bytes(packed: Callable[..., Path], refusal: Callable[..., str], tmp_path: Path) -> None:
    path = packed(("sketch.toml", _SETTINGS), ("hill.pngXevil", b""))
    path.write_bytes(path.read_bytes().replace(b"hill.pngX", b"hill.png\0"))
    assert "refused: expected a plain relative path" in refusal(path)

    path = packed(("sketch.toml", _SETTINGS))
    data = bytearray(path.read_bytes())
    data[6] |= 1
    data[data.index(b"PK\1\2") + 8] |= 1
    path.write_bytes(data)
    assert "encrypted" in refusal(path)

    path = tmp_path / "x.sketch"
    for content in (b"", b"PK", b"not a zip", b"PK\5\6" + bytes(18)):
        path.write_bytes(content)
        assert str(path) in refusal(path), content
    with path.open("wb") as stream:
        stream.truncate(1 << 40)  # sparse
    assert "too large: expected at most 256 MiB" in refusal(path)


_BOMBS = [
    (name, declared, start)
    for name in ("hill.png", "notes.txt")
    for declared in (_TEN_GB, 60 << 20, 1000)
    for start in (b"", b"\x89PNG\r\n\x1a\n")
]
_FEW = [("hill.png", 1000, b""), ("hill.png", 60 << 20, b"\x89PNG\r\n\x1a\n"), ("notes.txt", _TEN_GB, b"")]


@pytest.mark.parametrize("bombs", [_FEW, pytest.param(_BOMBS, marks=pytest.mark.slow)], ids=["few", "all"])
def test_ten_gigabytes_of_zeros_take_neither_time_nor_memory(
    tmp_path: Path, refusal: Callable[..., str], bombs: list[tuple[str, int, bytes]]
) -> None:
    path = tmp_path / "bomb.sketch"
    for name, declared, start in bombs:
        path.write_bytes(_bomb(name, _TEN_GB, declared=declared, start=start))
        tracemalloc.start()
        began = time.perf_counter()
        if name == "notes.txt" and declared < _TEN_GB:
            load_sketch(path)  # never unpacked: it says that it is small, and nobody asks for it
        else:
            assert "bomb.sketch" in refusal(path), (name, declared, start)
        assert time.perf_counter() - began < 5
        assert tracemalloc.get_traced_memory()[1] < 200 << 20
        tracemalloc.stop()


def test_damaged_zips_and_errors_inside_are_refused(
    packed: Callable[..., Path], refusal: Callable[..., str], grey: Callable[..., bytes]
) -> None:
    path = packed(("sketch.toml", _SETTINGS), ("hill.png", grey([[0, 1], [2, 3]])))
    whole = path.read_bytes()
    for length in range(0, len(whole), 3):
        path.write_bytes(whole[:length])
        assert "valley.sketch" in refusal(path)

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
