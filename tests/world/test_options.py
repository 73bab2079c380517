"""Options of a world, estimates of memory and disk space, and fingerprints of worlds and batches."""

import inspect
import os
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
from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.features.table import LINE, Feature, FeatureTable
from sketchterrain.generation import stages
from sketchterrain.generation.building import make_recipe
from sketchterrain.generation.stages import fingerprint
from sketchterrain.io import resources
from sketchterrain.jobs import estimates as shared_estimates
from sketchterrain.schema.layers import DENSITY
from sketchterrain.world import job
from sketchterrain.world.grid import World
from sketchterrain.world.job import Job, job_fingerprint
from sketchterrain.world.journal import Header, Journal, Ledger, check_output_unused
from sketchterrain.world.options import WorldOptions, check_layers, estimate_world, output_form
from sketchterrain.world.task_runner import shard_store
from tests.refusals import refused

SKETCH = Sketch(extent=512.0, layers={"mountain": np.zeros((24, 32), np.uint8)})


def test_output_form_follows_extension() -> None:
    for form, names in {
        "zarr": ("world.zarr", "world.ZARR/"),
        "tif": ("a.b/world.tif", "world.tiff"),
        "tiles": ("world", "world.v2/"),
    }.items():
        assert {output_form(name) for name in names} == {form}


def test_other_extensions_are_refused_except_folders(tmp_path: Path) -> None:
    refused(r"world\.png: expected a name that ends in \.zarr or \.tif", output_form, "world.png")
    (tmp_path / "out.v2").mkdir()
    assert output_form(str(tmp_path / "out.v2")) == "tiles"


def test_names_that_gdal_refuses_are_refused_at_the_start() -> None:
    name = os.fsdecode(b"w\xe9")
    assert output_form(f"{name}.zarr") == "zarr"
    for output in (name, f"{name}.tif"):
        with pytest.raises(UnicodeEncodeError, match="surrogates not allowed"):
            output_form(output)


def test_layers_are_ordered_and_checked() -> None:
    assert check_layers(["materials", "height"]) == ("height", "materials")
    for text, message in (
        (("height", "colour"), "expected some of"),
        (["normal"], "expected height among them"),
    ):
        refused(message, check_layers, text)


def test_default_bounds_are_the_sketch() -> None:
    for step in (2.0**-7, 1.0, 2.0**10, 2.0**-24):
        WorldOptions(step=step).check(SKETCH)
    world = WorldOptions().check(SKETCH)
    assert (world.west, world.south, world.east, world.north, world.cell) == (0.0, 0.0, 512.0, 384.0, 1.0)


def test_options_that_no_command_line_has_are_refused() -> None:
    refused("expected height among them", WorldOptions(layers=("normal",)).check, SKETCH)
    refused("finite origin", WorldOptions(origin=(float("inf"), 0.0)).check, SKETCH)
    refused("finite bounds and cell", WorldOptions(cell=float("nan")).check, SKETCH)


def test_workers_need_a_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sketchterrain.world.job.find_spec", lambda _: None)
    WorldOptions().check(SKETCH)
    with pytest.raises(SketchterrainError, match=r"pip install 'sketchterrain\[world\]'"):
        WorldOptions(workers=True).check(SKETCH)


def test_zarr_needs_assertions() -> None:
    optimised = dict(vars(job))  # as in `python -O`
    exec(compile(inspect.getsource(job.require), "job", "exec", optimize=1), optimised)  # noqa: S102
    optimised["require"]("A cluster", ["dask"])
    with pytest.raises(
        SketchterrainError, match=r"^A world needs Python's assertions: run it without -O and"
    ):
        optimised["require"]("A world", ["zarr"])
    job.require("A world", ["zarr"])


def test_job_carries_the_options(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    options = WorldOptions(
        bounds=(0.0, 0.0, 8.0, 8.0), layers=("materials", "height"), crs="EPSG:25832", step=0.5
    )
    job = options.job(SKETCH, make_recipe(SKETCH), Path("w.zarr"), "zarr")
    assert job.output == tmp_path / "w.zarr"
    assert job.layers == ("height", "materials")
    assert (job.crs, job.step, job.form, job.world.east) == ("EPSG:25832", 0.5, "zarr", 8.0)


VAST = World(0.0, 0.0, 4e6, 4e6, 1.0)


def test_disk_follows_vertices_layers_and_form(small_job: Job, tmp_path: Path) -> None:
    job = replace(small_job, world=World(0.0, 0.0, 512.0, 512.0, 1.0), output=tmp_path / "w.zarr")
    found = estimate_world(job)
    assert set(found.needs.disk) == {"height", "normal", "materials"}
    four = estimate_world(replace(job, world=World(0.0, 0.0, 1024.0, 1024.0, 1.0)))
    assert four.needs.disk_needed / found.needs.disk_needed == pytest.approx(4.0, rel=0.02)
    rounded = estimate_world(replace(job, step=2.0**-7))
    assert rounded.needs.disk["height"] < found.needs.disk["height"] / 2
    joined = estimate_world(replace(job, form="tif", output=tmp_path / "w.tif"))
    assert joined.needs.disk_needed == 2 * found.needs.disk_needed
    planted = estimate_world(replace(job, plants="parquet"))
    beyond = estimate_world(replace(job, plants="parquet", world=World(600.0, 0.0, 900.0, 300.0, 1.0)))
    assert planted.needs.disk["plants"] > 0 == beyond.needs.disk["plants"]


def test_memory_estimate_is_proportional_to_workers(small_job: Job, tmp_path: Path) -> None:
    job = replace(small_job, world=VAST, output=tmp_path / "w.zarr")
    alone, three = (estimate_world(job, workers=count).needs.memory for count in (0, 3))
    assert 400e6 < alone < 700e6
    assert three > 3 * alone
    assert estimate_world(small_job).needs.memory < alone


def test_insufficient_disk_or_memory_is_refused(
    small_job: Job, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="the world's files need up to"):
        estimate_world(replace(small_job, world=VAST, output=tmp_path / "w.zarr")).check_resources()
    monkeypatch.setattr(shared_estimates, "free_memory", lambda: 1 << 20)
    with pytest.raises(InputError, match=r"of memory at once, 1\.0 MiB are free"):
        estimate_world(replace(small_job, output=tmp_path / "w.zarr")).check_resources()


ROOT = Path(__file__).parents[2]


def road(*points: tuple[float, float]) -> dict[str, FeatureTable]:
    return {"road": FeatureTable("road").edited(add=[Feature(LINE, (np.array(points),))])}


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
    refused(r"computed from another sketch, .* or by other code", check_output_unused, moved, resume=True)


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
