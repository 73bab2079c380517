"""Random documents are stored and loaded without a difference; kills while saving lose nothing."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sketchterrain.document.store import load_sketch, save_sketch

from .conftest import same
from .random_documents import random_document

PROGRAM = "tests.document.save_until_killed"
ROOT = Path(__file__).parents[2]


def contents(path: Path) -> dict[str, bytes]:
    return {each.name: each.read_bytes() for each in ([path] if path.is_file() else path.iterdir())}


@pytest.mark.parametrize(
    ("first", "count"), [(0, 4), pytest.param(4, 996, marks=pytest.mark.soak)], ids=["few", "soak"]
)
def test_random_documents_are_loaded_as_saved_and_saved_as_loaded(tmp_path, first, count):
    for seed in range(first, first + count):
        for name in ("valley", "valley.sketch"):
            place = tmp_path / name
            document = random_document(np.random.default_rng(seed), own_folder=tmp_path / "valley")
            save_sketch(document, place)
            before, loaded = contents(place), load_sketch(place)
            same(loaded, document)
            shutil.rmtree(place) if place.is_dir() else place.unlink()
            save_sketch(loaded, place)
            assert contents(place) == before, seed
            save_sketch(document, place)
            assert contents(place) == before, seed


@pytest.mark.parametrize("name", ["valley", "valley.sketch"])
@pytest.mark.parametrize(
    "kills", [pytest.param(5, marks=pytest.mark.slow), pytest.param(1000, marks=pytest.mark.soak)]
)
def test_kills_while_saving_lose_nothing_older_than_the_last_save(tmp_path, name, kills):
    # A process of its own: it forks, which one with threads may not.
    command = [sys.executable, "-m", PROGRAM, str(tmp_path / name), str(kills), "1"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    print(done.stdout)  # noqa: T201
