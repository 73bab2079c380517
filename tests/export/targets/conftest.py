"""A terrain that reveals orientation, and its exports."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sketchterrain as st
from sketchterrain.document.edits import Edit
from sketchterrain.generation.building import make_recipe
from sketchterrain.landforms.hydrology.streams import is_stream
from tests.export.exporting import export as write_to


@dataclass(frozen=True)
class Outcome:
    """An export: its folder and sidecar."""

    folder: Path
    sidecar: dict[str, Any]

    def paths(self, ending):
        """Return the files whose names have an ending, in the order of the sidecar."""
        names = [entry["file"] for entry in self.sidecar["files"]]
        return [self.folder / name for name in names if name.endswith(ending)]

    def places(self, tile=0):
        """Return x and y of a tile's vertices, (rows, columns), by the sidecar."""
        grid = self.sidecar["tiles"][tile]
        bounds = grid["bounds"]
        x = np.linspace(bounds["west"], bounds["east"], grid["columns"])
        y = np.linspace(bounds["north"], bounds["south"], grid["rows"])
        return np.broadcast_to(x, (len(y), len(x))), np.broadcast_to(y[:, None], (len(y), len(x)))


@pytest.fixture(scope="session")
def corner():
    """One high mountain in the north-east corner, one river from north-west to south-west, a lake, a wood."""
    mountain, river, lake, forest = (np.zeros((64, 64), np.uint8) for _ in range(4))
    mountain[4:18, 46:60] = 1
    river[2:54, 8:10] = 1
    lake[50:58, 4:16] = 1
    forest[40:56, 34:52] = 1
    layers = {"mountain": mountain, "river": river, "lake": lake, "forest": forest}
    given = {"ground": {"relief": 5.0}, "layers": layers, "labels": {("mountain", 1): {"height": 500.0}}}
    sketch = st.Sketch(name="High corner", extent=1024.0, seed=5, **given)
    streams = [each.id for each in make_recipe(sketch).rivers if is_stream(each.id)]
    return sketch.replace(edits=tuple(Edit("delete", each) for each in streams))


@pytest.fixture(scope="session")
def terrain(corner):
    return st.build(corner)


@pytest.fixture(scope="session")
def exported(terrain, tmp_path_factory):
    """Return a function that exports the terrain: ``exported("raw", size=65, plants=False)``."""
    cache = {}

    def export(target, **options):
        key = f"{target} {sorted(options.items())}"
        if key not in cache:
            folder = tmp_path_factory.mktemp(target)
            done = write_to(terrain, target, folder, **options)
            content = json.loads((folder / "terrain.json").read_text(encoding="utf-8"))
            assert content == json.loads(json.dumps(done.report))
            assert [entry["file"] for entry in content["files"]] == [path.name for path in done.files]
            assert {path.name for path in folder.iterdir()} == {path.name for path in done.files}
            cache[key] = Outcome(folder, content)
        return cache[key]

    return export
