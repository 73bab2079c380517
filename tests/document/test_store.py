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

PROGRAM = Path(__file__).with_name("save_until_killed.py")


def contents(path: Path) -> dict[str, bytes]:
    return {each.name: each.read_bytes() for each in ([path] if path.is_file() else path.iterdir())}


@pytest.mark.parametrize(
    ("first", "count"), [(0, 25), pytest.param(25, 975, marks=pytest.mark.soak)], ids=["few", "soak"]
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
