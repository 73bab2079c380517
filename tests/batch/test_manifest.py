"""Manifests of batches: round trip, verification of files, and refusal of broken or hostile ones."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any

import pytest

from sketchterrain.batch.manifest import MANIFEST, Entry, File, Manifest, hashed, read_manifest
from sketchterrain.batch.output import Fingerprints, Output
from sketchterrain.errors import InputError
from sketchterrain.export.target import ExportOptions
from sketchterrain.sketch import Sketch

if TYPE_CHECKING:
    from pathlib import Path

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
def manifest(tmp_path: Path) -> Manifest:
    found = Manifest(
        tmp_path, Output().as_dict(), {each.name: each for each in (DONE, FAILED)}, ["sheet.png"]
    )
    found.write()
    return found


def test_a_manifest_round_trips_as_json(manifest: Manifest) -> None:
    again = read_manifest(manifest.folder)
    assert again is not None
    assert again.entries == {DONE.name: DONE, FAILED.name: FAILED}
    assert list(again.entries) == [DONE.name, FAILED.name]
    assert (again.output, again.sheets) == (Output().as_dict(), ["sheet.png"])
    before = manifest.path.read_bytes()
    again.write()
    assert manifest.path.read_bytes() == before

    told = json.loads(manifest.path.read_text(encoding="utf-8"))
    assert list(told) == ["format", "version", "output", "items", "sheets"]
    assert told["items"][0]["files"] == [
        {"file": "a.bin", "bytes": 3, "sha256": hashlib.sha256(b"abc").hexdigest()}
    ]
    assert told["items"][1]["error"] == "no „room“"

    manifest.entries[FAILED.name] = Entry(FAILED.name, "valley", 8)
    manifest.write()
    again = read_manifest(manifest.folder)
    assert again is not None
    assert again.entries[FAILED.name].state == "waiting"


def test_an_item_is_whole_only_with_the_files_and_hashes_it_lists(tmp_path: Path) -> None:
    assert not DONE.whole(tmp_path)
    (tmp_path / "a.bin").write_bytes(b"abc")
    assert DONE.whole(tmp_path)
    assert not FAILED.whole(tmp_path)
    for content in (b"abd", b"ab", b"abcd"):
        (tmp_path / "a.bin").write_bytes(content)
        assert not DONE.whole(tmp_path)
    (tmp_path / "a.bin").unlink()
    (tmp_path / "a.bin").mkdir()
    assert not DONE.whole(tmp_path)

    content = bytes(range(256)) * 9000  # more than is read at once
    (tmp_path / "b").write_bytes(content)
    assert hashed(tmp_path / "b") == File("b", len(content), hashlib.sha256(content).hexdigest())


def _parsed(manifest: Manifest) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(manifest.path.read_text(encoding="utf-8"))
    return found


def test_files_that_are_no_manifest_are_refused(tmp_path: Path) -> None:
    assert read_manifest(tmp_path) is None
    for content in [
        b"",
        b"{",
        b"[]",
        b"{}",
        b'{"a": 1}',
        b"\xff\xfe",
        b"[" * 100_000,
        b"null",
        b'"manifest"',
    ]:
        (tmp_path / MANIFEST).write_bytes(content)
        with pytest.raises(
            InputError, match="expected a batch's manifest, this is another file or broken"
        ) as error:
            read_manifest(tmp_path)
        assert "\n" not in str(error.value), content[:20]

    (tmp_path / MANIFEST).unlink()
    (tmp_path / MANIFEST).mkdir()
    with pytest.raises(InputError, match="cannot be read"):
        read_manifest(tmp_path)


def test_a_truncated_manifest_is_refused(manifest: Manifest) -> None:
    content = manifest.path.read_bytes()
    for end in range(0, len(content) - 2, 37):
        manifest.path.write_bytes(content[:end])
        with pytest.raises(InputError):
            read_manifest(manifest.folder)


def test_names_that_lead_outside_the_folder_are_refused(manifest: Manifest) -> None:
    for name in ["..", "../../etc", "/etc/passwd", "a//b", "", ".", "a\0b", "a\\b", "a/../../b"]:
        for where in ("item", "file", "sheet"):
            told = _parsed(manifest)
            if where == "item":
                told["items"][0]["name"] = name
            elif where == "file":
                told["items"][0]["files"][0]["file"] = name
            else:
                told["sheets"] = [name]
            (manifest.folder / MANIFEST).write_text(json.dumps(told), encoding="utf-8")
            with pytest.raises(InputError, match="this one has the name") as error:
                read_manifest(manifest.folder)
            if "\0" not in name:
                assert repr(name) in str(error.value), (name, where)


def test_a_repeated_item_is_refused(manifest: Manifest) -> None:
    told = _parsed(manifest)
    told["items"].append(told["items"][0])
    manifest.path.write_text(json.dumps(told), encoding="utf-8")
    with pytest.raises(InputError, match="an item twice"):
        read_manifest(manifest.folder)


def test_fingerprints_follow_from_all_that_files_follow_from() -> None:
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
    found = [Fingerprints(output).of(each) for output in outputs for each in sketches]
    assert len(set(found)) == len(found)
    assert found == [Fingerprints(output).of(each.replace()) for output in outputs for each in sketches]
