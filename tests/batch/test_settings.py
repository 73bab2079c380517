"""Seeds, settings and sweep files of a batch, the terrains that follow, manifests and contact sheets."""

import functools
import hashlib
import json
import operator
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from sketchterrain.batch.plan import (
    MAX_ITEMS,
    Source,
    parse_seeds,
    parse_setting,
    parse_settings,
    plan,
    read_sources,
    read_sweep,
    with_settings,
)
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
from sketchterrain.document.sketch import TABLES, Sketch
from sketchterrain.document.store import save_sketch
from sketchterrain.errors import InputError
from sketchterrain.export.target import ExportOptions
from sketchterrain.generation.stages import fingerprint
from sketchterrain.io.files import hash_file
from sketchterrain.schema.layers import LAYERS
from sketchterrain.schema.parameters import SKETCH
from tests.refusals import refused

RIVER = np.zeros((8, 8), np.uint8)
RIVER[3] = 1
PAINTED = Sketch(name="Painted", layers={"river": RIVER}, seed=4)
SOURCE = Source("valley", "valley", PAINTED)


def test_seeds_are_parsed():
    cases = {"7": (7,), "1-4": (1, 2, 3, 4), "1,5,9-12": (1, 5, 9, 10, 11, 12), " 3 - 4 , 2": (3, 4, 2)}
    for text, seeds in {**cases, "2,1-3": (2, 1, 3), "9223372036854775807": (2**63 - 1,)}.items():
        assert parse_seeds(text) == seeds, text


def test_invalid_seeds_are_refused():
    texts = ["a", "1,,2", "5-1", "-3", "1-", "1.5", "1-99999999999", "9223372036854775808", "1" * 400]
    for text in ("", "1\n2", "١", *texts):
        with pytest.raises(InputError, match=r"^seeds .*expected") as error:
            parse_seeds(text)
        assert "\n" not in str(error.value), text
        assert len(str(error.value)) < 250, text


def test_settings_are_parsed_with_their_types():
    for name, text, values in [
        ("river.1.width", "30", (30.0,)),
        ("river.1.width", "20, 30,20", (20.0, 30.0)),
        ("river.1.width", "10..50..10", (10.0, 20.0, 30.0, 40.0, 50.0)),
        ("fidelity", "0.1..0.5..0.1", (0.1, 0.2, 0.3, 0.4, 0.5)),
        ("climate.snow_line", "-200..-100..50", (-200.0, -150.0, -100.0)),
        ("hill.2.multitude", "3..5", (3, 4, 5)),
        ("material.1.material", "rock,sand", ("rock", "sand")),
        ("density.hill", "1e-1", (0.1,)),
    ]:
        found = parse_setting(name, text)
        assert found == (name, values), (name, text)
        assert [type(value) for value in found.values] == [type(value) for value in values], (name, text)


def test_invalid_settings_are_refused():
    for name, text, message in [
        ("river.1.wdth", "3", "expected river.1.width, river.1.depth, river.1.flow; did you mean"),
        ("rivr.1.width", "3", "river.1.…"),
        ("density.hil", "3", "did you mean 'density.hill'"),
        ("seed", "3", "expected extent, fidelity"),
        ("river.256.width", "3", "a label from 1 to 255"),
        ("river.١.width", "3", "a label from 1 to 255"),
        ("river.1.width", "wide", "a number from 0 to 2000 m"),
        ("river.1.width", "nan", "a number from 0 to 2000 m"),
        ("river.1.width", "", "a number from 0 to 2000 m"),
        ("river.1.width", "2..1..1", "that rises"),
        ("river.1.width", "1..2..1e-9", "at most 1000 values"),
        ("hill.1.multitude", "2.5", "a whole number"),
        ("", "", "unknown setting"),
    ]:
        refused(re.escape(message), parse_setting, name, text)


def test_every_declared_setting_can_be_swept():
    declared = {name: each for name, each in SKETCH.items() if name not in ("name", "seed")}
    declared |= {f"{key}.{name}": each for key in TABLES for name, each in TABLES[key].items()}
    declared |= {f"{key}.1.{name}": each for key in LAYERS for name, each in LAYERS[key].parameters.items()}
    for name, parameter in declared.items():
        changed = with_settings(PAINTED, {name: parse_setting(name, [parameter.default]).values[0]})
        table, *keys = name.split(".")
        found = changed.properties(table, 1) if len(keys) == 2 else getattr(changed, table)
        assert (found[keys[-1]] if keys else found) == parameter.default


def test_setting_replaces_only_itself():
    sketch = PAINTED.replace(labels={("river", 1): {"depth": 5.0}}, density={"hill": 2.0})
    changed = with_settings(sketch, {"river.1.width": 40.0, "density.dune": 1.0})
    assert changed.properties("river", 1) == {**sketch.properties("river", 1), "width": 40.0}
    assert (changed.density["hill"], changed.density["dune"]) == (2.0, 1.0)

    file = (parse_setting("river.1.width", "10"), parse_setting("fidelity", "0.5"))
    found = parse_settings(["river.1.width=20,30"], file)
    assert dict(found) == {"fidelity": (0.5,), "river.1.width": (20.0, 30.0)}
    refused("NAME=VALUES", parse_settings, ["river.1.width"])
    refused("set twice", parse_settings, ["fidelity=1", "fidelity=0"])


def test_plan_has_all_combinations_with_stable_names():
    swept = (parse_setting("river.1.width", "20,30"), parse_setting("fidelity", "1"))
    items = plan((SOURCE, Source("hills", "hills", PAINTED)), (7, 12), swept)
    places = [(width, seed) for width in (20, 30) for seed in ("007", "012")]
    expected = [f"valley/river.1.width={width}_fidelity=1/seed-{seed}" for width, seed in places]
    assert [item.name for item in items[:4]] == expected
    assert len({item.name for item in items}) == len(items) == 8
    assert items[2].sketch.seed == 7
    assert items[2].sketch.properties("river", 1)["width"] == 30.0
    assert [item.name for item in plan((SOURCE,))] == ["valley/seed-004"]

    alone = plan((SOURCE,), (7,), (parse_setting("fidelity", "0.5"),))
    many = plan((SOURCE,), tuple(range(2000)), (parse_setting("fidelity", "0.1,0.5"),))
    assert alone[0].name in {item.name for item in many}

    layers = ("mountain", "hill", "dune", "forest")
    swept = [parse_setting(f"{layer}.1.multitude", "100,200") for layer in layers]
    swept += [parse_setting(f"{layer}.1.height", "100.125,99.5") for layer in layers[:3]]
    sketch = PAINTED.replace(layers=dict.fromkeys(layers, RIVER))
    names = {item.name for item in plan((Source("s", "s", sketch),), (1,), swept)}
    assert len(names) == 2**7
    assert max(len(part) for name in names for part in name.split("/")) <= 120


def test_invalid_plans_are_refused():
    for seeds, texts, message in (
        (range(MAX_ITEMS), ("fidelity=0,1",), f"expected at most {MAX_ITEMS}"),
        ((1,), ("river.2.width=3",), "no sketch of the batch has a label 2 in its layer river"),
        ((1,), ("fidelity=0", "fidelity=1"), "set twice"),
    ):
        refused(message, plan, (SOURCE,), tuple(seeds), [parse_setting(*text.split("=")) for text in texts])


def test_unreadable_sketch_does_not_stop_others(tmp_path):
    (tmp_path / "b").mkdir()
    paths = [tmp_path / "a" / "my valley", tmp_path / "b" / "my valley.sketch"]
    for path in paths:
        save_sketch(PAINTED, path)
    first, second, bad = map(str, (*paths, tmp_path / "no"))
    sources = read_sources([first, second, bad])
    assert [source.name for source in sources] == ["my_valley", "my_valley-2", "no"]
    assert sources[2].sketch is None
    with pytest.raises(InputError, match="no sketch"):
        plan(sources, (1,))[2].sketch  # noqa: B018 - it is asked for
    for given, message in (
        ([bad], "no sketch"),
        ([first, first], "given twice"),
        ([], "at least one sketch"),
    ):
        refused(message, read_sources, given)


def test_output_folders_have_safe_names(tmp_path):
    (tmp_path / "a").mkdir()
    for name in ("..", ".hidden", "a/..", "Ümlaut", "con:x", " "):
        if not (tmp_path / name).exists():
            save_sketch(PAINTED, tmp_path / name)
        source = read_sources([str(tmp_path / name), "valley_river"])[0]
        assert re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_.=+-]*", source.name), name


def test_sweep_file_has_all_command_line_settings(tmp_path):
    save_sketch(PAINTED, tmp_path / "mine")
    file = tmp_path / "sweep.toml"
    file.write_text(
        """sketches = ["mine", "valley_river"]\nseeds = "1-3"\nsize = 257\npreview = false\nto = "unity"
        [export]\ntiles = [2, 2]\nheights = [-100, 900.5]\nplants = false
        [set]\nfidelity = [0.2, 1]\nriver.1.width = "10..30..10"\n"hill.1.height" = 40
        """
    )
    found = read_sweep(file)
    assert (found.sketches, found.seed_list) == ([str(tmp_path / "mine"), "valley_river"], (1, 2, 3))
    settings = {"fidelity": (0.2, 1.0), "river.1.width": (10.0, 20.0, 30.0), "hill.1.height": (40.0,)}
    assert dict(found.settings) == settings
    assert (found.size, found.preview, found.to) == (257, False, "unity")
    assert found.export == {"tiles": (2, 2), "heights": (-100.0, 900.5), "plants": False}


def test_invalid_sweep_files_are_refused(tmp_path):
    file = tmp_path / "sweep.toml"
    for text, message in {
        "sizes = 3": "unknown key 'sizes': expected sketches, seeds, size",
        "size = 'big'": "expected int | null, got str - at size",
        "[export]\ntile = 3": "unknown key 'export.tile'",
        "[export]\ntiles = [1]": "at export.tiles",
        "seeds = 'x'": "seeds 'x': expected",
        "[set]\nrivers = 3": "unknown setting 'rivers'",
        "[set]\nfidelity = [true]": "expected a number from 0 to 1",
        "[set]\nfidelity = []": "expected 1 to 1000 values",
        "size = ": "not TOML",
    }.items():
        file.write_text(text)
        with pytest.raises(InputError, match=re.escape(message)) as error:
            read_sweep(file)
        assert str(error.value).startswith(f"{file}: "), text
        assert "\n" not in str(error.value), text
    for place in (tmp_path / "none.toml", tmp_path):
        refused("cannot be read", read_sweep, place)


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
        refused(r"expected a batch's manifest", read_manifest, tmp_path)
    (tmp_path / MANIFEST).unlink()
    (tmp_path / MANIFEST).mkdir()
    refused("cannot be read", read_manifest, tmp_path)


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
            refused(r"matching regex .* - at `\$\.(items|sheets)\[", read_manifest, manifest.parent)
    for name in ("..a", "a..", "valley/fidelity=0.5/seed-001", ".a/...b"):
        changed(("items", 0, "name"), name)
        found = read_manifest(manifest.parent)
        assert found is not None
        assert found.items[0].name == name
    changed(("items", 0, "name"), FAILED.name)
    refused("with unique items", read_manifest, manifest.parent)


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
