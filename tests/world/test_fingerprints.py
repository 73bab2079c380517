"""Fingerprints of worlds and batches: sketch, files that it shows, options, code."""

from collections.abc import Iterable
from dataclasses import fields, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from sketchterrain.batch.results import Output
from sketchterrain.document.drapes import DrapedLayer
from sketchterrain.document.edits import Edit
from sketchterrain.document.material_rules import RuleChange
from sketchterrain.document.rasters import RasterSource
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch, save_sketch
from sketchterrain.errors import InputError
from sketchterrain.features.table import LINE, Feature, VectorLayer
from sketchterrain.generation import stages
from sketchterrain.generation.stages import fingerprint
from sketchterrain.io import resources
from sketchterrain.schema.layers import DENSITY
from sketchterrain.world.grid import World
from sketchterrain.world.job import Job, job_fingerprint
from sketchterrain.world.journal import Header, Journal, Ledger, check_output_unused
from sketchterrain.world.task_runner import shard_store

ROOT = Path(__file__).parents[2]


def road(*points: tuple[float, float]) -> dict[str, VectorLayer]:
    return {"road": VectorLayer("road").edited(add=[Feature(LINE, (np.array(points),))])}


ROAD = road((10.0, 20.0), (300.0, 400.0))
# A changed value of every field: a new field needs one too.
CHANGES = {
    "name": "Other",
    "extent": 600.0,
    "seed": 5,
    "fidelity": 0.5,
    "density": {next(iter(DENSITY)): 2.0},
    "ground": {"relief": 50.0},
    "geology": {"dip": 30.0},
    "climate": {"aridity": 0.7},
    "coast": {"beach": 50.0},
    "weather": {"wind": 9.0},
    "frame": {"east": 7.0},
    "base": {"margin": 90.0},
    "layers": {"lake": np.eye(512, dtype=np.uint8)},
    "vectors": road((10.0, 20.0), (300.0, 401.0)),
    "rasters": (RasterSource("dem.tif", "elevation"),),
    "drapes": (DrapedLayer("ways.gpkg"),),
    "labels": {("river", 1): {"width": 12.0}},
    "materials": {"lava": {}},
    "look": {"rock": {"bump": 1.5}},
    "edits": (Edit("add", type="hill", x=10.0, y=20.0, radius=30.0, strength=5.0),),
    "material_rules": (RuleChange("dry_soil", material="rock"),),
}


def fingerprints(job: Job, sketches: Iterable[Sketch]) -> list[tuple[str, str]]:
    """Return the fingerprints of a world and of a batch's item of each sketch."""
    return [(job_fingerprint(replace(job, sketch=each)), fingerprint(each, Output())) for each in sketches]


def test_every_field_of_a_sketch_changes_both(small_job) -> None:
    sketch = Sketch(vectors=ROAD)
    names = [each.name for each in fields(Sketch) if each.name != "notes"]  # they change nothing
    changed = [sketch.replace(**{name: CHANGES[name]}) for name in names]
    for found in zip(*fingerprints(small_job, [sketch, *changed]), strict=True):
        assert len(set(found)) == len(CHANGES) + 1
    assert fingerprints(small_job, [sketch.replace()]) == fingerprints(small_job, [sketch])


def test_files_that_a_sketch_shows_change_both(small_job, tmp_path) -> None:
    file = tmp_path / "albedo.png"
    shown = [Sketch(rasters=(RasterSource(str(file), role),)) for role in ("elevation", "orthophoto")]
    shown += [Sketch(drapes=(DrapedLayer(str(file)),)), Sketch(materials={"lava": {"folder": str(tmp_path)}})]
    found = []
    for content in (b"one", b"another"):
        file.write_bytes(content)
        found.append(fingerprints(small_job, [*shown, Sketch(rasters=(RasterSource(str(file)),))]))
    *differ, (of_picture, of_other) = zip(*found, strict=True)
    assert all(world != other[0] and item != other[1] for (world, item), other in differ)
    assert of_picture == of_other  # it lies beneath the paint in the window alone


def test_folder_and_order_of_tables_change_neither(small_job, tmp_path) -> None:
    values = {name: value for name, value in CHANGES.items() if name not in ("rasters", "drapes")}
    values |= {"density": {"hill": 2.0, "mountain": 0.5}, "coast": {"beach": 50.0, "shelf": 90.0}}
    values["labels"] = {("river", 1): {"width": 12.0, "depth": 1.0}, ("river", 2): {}}
    values["look"] = {"rock": {"bump": 1.5, "colour": "#101010"}, "snow": {"bump": 1.5}}
    turned = {
        table: {
            name: dict(reversed(each.items())) if isinstance(each, dict) else each
            for name, each in reversed(values[table].items())
        }
        for table in ("labels", "density", "coast", "look", "layers")
    }
    sketches = Sketch(**values), Sketch(**values | turned)
    for number, sketch in enumerate(sketches):
        save_sketch(sketch, tmp_path / str(number))
    loaded = [load_sketch(tmp_path / str(number)) for number in range(2)]
    assert len({*fingerprints(small_job, [*sketches, *loaded])}) == 1


def test_options_and_program_change_both(small_job, monkeypatch) -> None:
    others = {
        "world": World(0.0, 0.0, 8.0, 8.0, 1.0),
        "form": "tiles",
        "layers": ("height",),
        "plants": "parquet",
        "grass": True,
        "crs": "EPSG:25832",
        "origin": (1.0, 0.0),
        "step": 0.5,
        "fast": True,
    }
    assert {*others, "sketch", "recipe", "output"} == {each.name for each in fields(Job)}
    before = job_fingerprint(small_job)
    found = {job_fingerprint(replace(small_job, **{name: value})) for name, value in others.items()}
    assert len(found | {before}) == len(others) + 1
    assert job_fingerprint(replace(small_job, output=Path("elsewhere.zarr"))) == before
    (both,) = fingerprints(small_job, [Sketch()])
    for name in ("version", "code_digest"):
        with monkeypatch.context() as patched:
            patched.setattr(stages, name, lambda *_: "other")
            (other,) = fingerprints(small_job, [Sketch()])
            assert other[0] != both[0]
            assert other[1] != both[1]


def test_resuming_a_world_whose_road_has_moved_is_refused(small_job, tmp_path) -> None:
    job = replace(small_job, sketch=Sketch(vectors=ROAD), output=tmp_path, form="tiles")
    with Journal(job.layout.journal, Ledger(Header(job_fingerprint(job), version("sketchterrain")), {})):
        shard_store(job).create()
    check_output_unused(job, resume=True)
    moved = replace(job, sketch=job.sketch.replace(vectors=CHANGES["vectors"]))
    with pytest.raises(InputError, match=r"computed from another sketch, .* or by other code"):
        check_output_unused(moved, resume=True)


def test_every_source_file_changes_the_code_digest(monkeypatch) -> None:
    digest = resources.code_digest.__wrapped__
    files = [file for room in ("sketchterrain", "kernels") for file in (ROOT / room).rglob("*.*")]
    built = {".typed", ".so", ""}  # and the mark of typed packages
    sources = [file for file in files if file.suffix not in built and file.parent.name != "__pycache__"]
    digests = set()
    for planted in (ROOT, *sources):
        monkeypatch.setattr(
            Path, "read_bytes", lambda file, planted=planted: b"1" if file == planted else b""
        )
        digests.add(digest())
    assert len(digests) == len(sources) + 1 > 400
