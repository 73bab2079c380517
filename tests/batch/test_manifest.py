"""Manifests of batches: round trip, verification of files, and refusal of broken or hostile ones."""

import functools
import hashlib
import json
import operator
from pathlib import Path
from typing import Any

import pytest

from sketchterrain.batch.manifest import MANIFEST, Entry, File, Manifest, hashed, read_manifest
from sketchterrain.batch.output import Output, fingerprint
from sketchterrain.errors import InputError
from sketchterrain.export.target import ExportOptions
from sketchterrain.sketch import Sketch

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


def test_an_item_is_whole_only_with_the_files_and_hashes_it_lists(tmp_path):
    assert not DONE.whole(tmp_path)
    (tmp_path / "a.bin").write_bytes(b"abc")
    assert DONE.whole(tmp_path)
    for content in (b"abd", b"ab", b"abcd"):
        (tmp_path / "a.bin").write_bytes(content)
        assert not DONE.whole(tmp_path)
    (tmp_path / "a.bin").unlink()
    (tmp_path / "a.bin").mkdir()
    assert not DONE.whole(tmp_path)

    content = bytes(range(256)) * 9000  # more than is read at once
    (tmp_path / "b").write_bytes(content)
    assert hashed(tmp_path / "b") == File("b", len(content), hashlib.sha256(content).hexdigest())


def test_files_that_are_no_manifest_are_refused(tmp_path):
    assert read_manifest(tmp_path) is None
    for content in (b"", b"{", b"[]", b'{"a": 1}', b"\xff\xfe", b"[" * 100_000, b"null", b'"manifest"'):
        (tmp_path / MANIFEST).write_bytes(content)
        with pytest.raises(
            InputError, match=r"expected a batch's manifest, .* another file or broken"
        ) as error:
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
    with pytest.raises(InputError, match="an item twice"):
        read_manifest(manifest.parent)


def test_fingerprints_follow_from_all_that_files_follow_from():
    sketch = Sketch(seed=3)
    river = sketch.layers["river"].copy()
    river[4, 5] = 1
    outputs = [
        Output(),
        Output(size=257),
        Output(preview=False),
        Output(fast=True),
        Output(target="unity", options=ExportOptions()),
        Output(target="unity", options=ExportOptions(heights=(0.0, 900.0))),
    ]
    sketches = [
        sketch,
        sketch.replace(seed=4),
        sketch.replace(fidelity=0.5),
        sketch.replace(layers={"river": river}),
        sketch.replace(layers={"lake": river}),
        sketch.replace(labels={("river", 1): {"width": 12.0}}),
    ]
    found = [fingerprint(each, output) for output in outputs for each in sketches]
    assert len(set(found)) == len(found)
    assert found == [fingerprint(each.replace(), output) for output in outputs for each in sketches]
