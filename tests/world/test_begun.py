"""What a world may be written over: nothing that is not a part of that same world."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from sketchterrain.errors import InputError
from sketchterrain.sketch import packed_sketch
from sketchterrain.world.begun import refuse_taken
from sketchterrain.world.forms import store_of
from sketchterrain.world.roots import Roots
from sketchterrain.world.run import run_world
from sketchterrain.world.sweeping import sweep

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from sketchterrain.world.job import Job

FORMS = {"zarr": "world.zarr", "tiles": "world", "tif": "world.tif"}
SOMEONES = [
    ("tiles", "world/sketch.sketch"),
    ("tiles", "world/height.vrt"),
    ("zarr", "world.zarr/zarr.json"),
    ("zarr", "world.zarr/0/height/c/0/0"),
    ("tif", "world.tif"),
    ("tif", "world_normal.tif"),
    ("tif", "world_materials.tif"),
    *((form, "world-plants/notes.txt") for form in FORMS),
]


def job_as(job: Job, folder: Path, form: str) -> Job:
    return replace(job, output=folder / FORMS[form], form=form, plants="parquet")


@pytest.mark.parametrize("resume", [False, True])
@pytest.mark.parametrize(("form", "name"), SOMEONES)
def test_a_file_that_is_not_the_worlds_is_named_and_left(
    form: str, name: str, resume: bool, small_job: Job, tmp_path: Path, heard, tree: Callable[[Path], object]
) -> None:
    asked = job_as(small_job, tmp_path, form)
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text('{"zarr_format": 3, "node_type": "group"}')
    before = tree(tmp_path)
    with pytest.raises(InputError, match="there is something else; take another output"):
        run_world(asked, resume=resume, watcher=heard)
    assert tree(tmp_path) == before


@pytest.mark.parametrize("form", FORMS)
def test_what_a_run_has_begun_is_gone_on_with(form: str, small_job: Job, tmp_path: Path) -> None:
    asked = job_as(small_job, tmp_path, form)
    store = store_of(asked)
    store.journal.parent.mkdir(parents=True)
    store.journal.touch()
    store.mark.with_name(f".{store.mark.name}.0123abcd.tmp").write_bytes(b"half")
    refuse_taken(asked, resume=False)  # killed before it wrote anything
    store.create()
    refuse_taken(asked, resume=True)
    with pytest.raises(InputError, match="there is a world; --resume goes on with it"):
        refuse_taken(asked, resume=False)


def test_another_sketch_of_that_name_is_a_persons(small_job: Job, tmp_path: Path) -> None:
    asked = job_as(small_job, tmp_path, "tiles")
    asked.output.mkdir()
    (asked.output / "sketch.sketch").write_bytes(packed_sketch(replace(small_job.sketch, seed=99)))
    with pytest.raises(InputError, match="there is something else"):
        refuse_taken(asked, resume=True)


@pytest.mark.parametrize("form", FORMS)
def test_only_what_a_killed_run_leaves_is_swept(form: str, small_job: Job, tmp_path: Path, tree) -> None:
    asked = job_as(small_job, tmp_path, form)
    store, roots = store_of(asked), Roots.of(asked)
    store.create()
    (tmp_path / "world-plants").mkdir()
    for folder in (tmp_path, store.journal.parent, tmp_path / "world-plants"):
        for name in (".draft.tmp", ".draft.12345678x.tmp", ".sketchterrain-mine", "notes.txt"):
            (folder / name).write_text("mine")
    before = tree(tmp_path)
    halves = [store.mark.with_name(".height.tif.0123abcd.tmp"), tmp_path / "world-plants" / ".p.01234567.tmp"]
    token = f".sketchterrain-{'0' * 32}"
    tokens = [store.journal.with_name(name) for name in (token, f"{token}-0123abcd")]
    for path in (*halves, *tokens):
        path.write_bytes(b"half")
    sweep(asked, store, roots, ())
    assert tree(tmp_path) == before
