"""Manifests and contact sheets of batches."""

import functools
import hashlib
import json
import operator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from sketchterrain.batch.results import (
    MANIFEST,
    PAGE,
    Entry,
    File,
    Manifest,
    Output,
    read_manifest,
    write_sheets,
)
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.export.target import ExportOptions
from sketchterrain.generation.stages import fingerprint
from sketchterrain.io.files import hash_file

DONE = Entry(
    "valley/seed-007",
    "valley",
    7,
    {"river.1.width": 20.0, "material.1.material": "rock"},
    "done",
    "ab12",
    (File("a.bin", 3, hashlib.sha256(b"abc").hexdigest()),),
    1.5,
    {"ground": 0.5},
    {"mean_iou": 0.8, "layers": {"river": {"iou_mean": None}}},
    ("a device failed",),
)
FAILED = Entry("valley/seed-008", "valley", 8, state="failed", error="no „room“")


@pytest.fixture
def manifest(tmp_path) -> Path:
    Manifest(1, "0.1", Output(), [DONE, FAILED], ["sheet.png"]).write(tmp_path)
    return tmp_path / MANIFEST


def test_a_manifest_round_trips_as_json(manifest):
    again = read_manifest(manifest.parent)
    assert again is not None
    assert again.entries == {DONE.name: DONE, FAILED.name: FAILED}
    assert (again.items, again.sheets) == ([DONE, FAILED], ["sheet.png"])
    before = manifest.read_bytes()
    again.write(manifest.parent)
    assert manifest.read_bytes() == before

    parsed = json.loads(before)
    assert list(parsed) == ["format", "version", "output", "items", "sheets"]
    assert parsed["output"]["size"] is None
    assert parsed["items"][0]["files"] == [
        {"file": "a.bin", "bytes": 3, "sha256": hashlib.sha256(b"abc").hexdigest()}
    ]
    assert parsed["items"][1]["error"] == "no „room“"


def test_item_is_intact_only_with_listed_hashes(tmp_path):
    assert not DONE.is_intact(tmp_path)
    (tmp_path / "a.bin").write_bytes(b"abc")
    assert DONE.is_intact(tmp_path)
    for content in (b"abd", b"ab", b"abcd"):
        (tmp_path / "a.bin").write_bytes(content)
        assert not DONE.is_intact(tmp_path)
    (tmp_path / "a.bin").unlink()
    (tmp_path / "a.bin").mkdir()
    assert not DONE.is_intact(tmp_path)

    content = bytes(range(256)) * 9000  # more than one read
    (tmp_path / "b").write_bytes(content)
    assert hash_file(tmp_path / "b") == (len(content), hashlib.sha256(content).hexdigest())


def test_invalid_manifests_are_refused(tmp_path):
    assert read_manifest(tmp_path) is None
    for content in (b"", b"{", b"[]", b'{"a": 1}', b"\xff\xfe", b"[" * 100_000, b"null", b'"manifest"'):
        (tmp_path / MANIFEST).write_bytes(content)
        with pytest.raises(InputError, match=r"expected a batch's manifest") as error:
            read_manifest(tmp_path)
        assert "\n" not in str(error.value), content[:20]
    (tmp_path / MANIFEST).unlink()
    (tmp_path / MANIFEST).mkdir()
    with pytest.raises(InputError, match="cannot be read"):
        read_manifest(tmp_path)


def test_truncated_and_hostile_manifests_are_refused(manifest):
    content = manifest.read_bytes()
    for end in range(0, len(content) - 2, 37):
        manifest.write_bytes(content[:end])
        with pytest.raises(InputError):
            read_manifest(manifest.parent)

    def changed(keys: tuple[Any, ...], value: object) -> None:
        parsed: Any = json.loads(content)
        functools.reduce(operator.getitem, keys[:-1], parsed)[keys[-1]] = value
        manifest.write_text(json.dumps(parsed), encoding="utf-8")

    for name in ("..", "../../etc", "/etc/passwd", "a//b", "", ".", "a\0b", "a\\b", "a/../../b", "a/", "./a"):
        for keys in (("items", 0, "name"), ("items", 0, "files", 0, "file"), ("sheets", 0)):
            changed(keys, name)
            with pytest.raises(InputError, match=r"matching regex .* - at `\$\.(items|sheets)\["):
                read_manifest(manifest.parent)
    for name in ("..a", "a..", "valley/fidelity=0.5/seed-001", ".a/...b"):
        changed(("items", 0, "name"), name)
        found = read_manifest(manifest.parent)
        assert found is not None
        assert found.items[0].name == name
    changed(("items", 0, "name"), FAILED.name)
    with pytest.raises(InputError, match="with unique items"):
        read_manifest(manifest.parent)


def test_fingerprint_depends_on_the_output():
    options = (ExportOptions(), ExportOptions(heights=(0.0, 900.0)))
    outputs = [Output(), Output(size=257), Output(preview=False), Output(fast=True)]
    outputs += [Output(target="unity", options=each) for each in options]
    found = [fingerprint(Sketch(), output) for output in outputs]
    assert len(set(found)) == len(found)


def entry(name: str, *, preview: bool = True, error: str = "") -> Entry:
    files = (File("preview.png", 1, ""),) if preview else ()
    return Entry(name, "s", 1, state="failed" if error else "done", files=files, error=error)


def written(folder: Path, name: str, colour: tuple[int, int, int]) -> None:
    (folder / name).mkdir(parents=True)
    Image.fromarray(np.full((72, 128, 3), colour, np.uint8)).save(folder / name / "preview.png")


def test_sheet_shows_previews_in_order(tmp_path):
    colours = [(40 * number, 200, 30) for number in range(6)]
    for number, colour in enumerate(colours):
        written(tmp_path, f"s/{number}", colour)
    names = write_sheets(
        tmp_path, [*(entry(f"s/{number}") for number in range(6)), entry("bad", preview=False, error="no")]
    )
    assert names == ["sheet.png"]
    with Image.open(tmp_path / "sheet.png") as picture:
        page = np.asarray(picture)
    places = [(12 + 112 + 259 * (number // 4), 12 + 200 + 412 * (number % 4)) for number in range(6)]
    assert [tuple(page[place].tolist()) for place in places] == colours
    red = (page[:, :, 0] > 150) & (page[:, :, 1] < 60) & (page[:, :, 2] < 60)
    assert red[271:, 836:].any()  # why the last one failed


def test_sheet_with_failed_items_and_missing_previews(tmp_path):
    written(tmp_path, "s/0", (0, 200, 0))
    failed = Entry("s/0", "s", 1, state="failed", files=(File("preview.png", 1, ""),), error="no")
    assert write_sheets(tmp_path, [failed]) == []
    assert write_sheets(tmp_path, [failed, entry("s/0")]) == ["sheet.png"]
    with Image.open(tmp_path / "sheet.png") as page:  # not its older picture
        assert page.getpixel((212, 124)) != (0, 200, 0) == page.getpixel((624, 124))
    (tmp_path / "s" / "preview.png").write_bytes(b"no picture")
    long = entry("x" * 300, preview=False, error="long " * 90)
    assert write_sheets(tmp_path, [entry("s"), entry("gone"), entry("s/0"), long]) == ["sheet.png"]


def test_sheets_are_paged(tmp_path):
    assert write_sheets(tmp_path, [entry("s/0", preview=False)]) == []
    assert write_sheets(tmp_path, []) == []
    assert list(tmp_path.iterdir()) == []

    written(tmp_path, "s/0", (1, 2, 3))
    entries = [entry("s/0") for _ in range(PAGE + 1)]
    assert write_sheets(tmp_path, entries) == ["sheet.png", "sheet-2.png"]
    with Image.open(tmp_path / "sheet-2.png") as page:
        assert page.size == (424, 271)
