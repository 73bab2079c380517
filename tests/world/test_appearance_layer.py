"""Stored worlds with the colour of roads and land use."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from sketchterrain.compute.context import ComputeContext
from sketchterrain.features.table import VectorLayer
from sketchterrain.generation.building import make_recipe
from sketchterrain.generation.terrain import Terrain
from sketchterrain.world.grid import World
from sketchterrain.world.run import run_world
from sketchterrain.world.stored_world import open_world


@pytest.mark.parametrize("form", ["zarr", pytest.param("tiles", marks=pytest.mark.slow)])
def test_appearance_is_stored_as_evaluated(form, small_job, tmp_path, reporter) -> None:
    """Of two shards at two levels, bit for bit."""
    fields = shapely.box([-5.0, 101.0], [20.0, 35.0], [101.0, 300.0], [140.0, 240.0])
    layer = VectorLayer.from_shapes("landuse", fields)
    sketch = small_job.sketch.replace(vectors={"landuse": layer})
    world = World(-20.0, 60.0, 400.0, 64.0, 0.125)
    job = replace(
        small_job,
        sketch=sketch,
        recipe=make_recipe(sketch),
        world=world,
        form=form,
        layers=("height", "appearance"),
        output=tmp_path / ("world.zarr" if form == "zarr" else "world"),
    )
    run_world(job, reporter=reporter)
    terrain = Terrain(sketch, job.recipe, ComputeContext())
    stored = open_world(job.output)
    assert stored.layers == ("height", "appearance")
    for number in (0, 2):
        level = stored.levels[number]
        found = stored.read("appearance", number, top=0, left=0, rows=level.rows, columns=level.columns)
        cell = level.cell, level.cell
        size = {"columns": level.columns, "rows": level.rows}
        expected = terrain.appearance.window(world.west, world.north, cell=cell, **size)
        assert expected[..., 3].any()
        off = np.abs(found.astype(int) - expected.transpose(2, 0, 1))
        # Shards begin at other texels: rounding moves few of them over the edges of patterns.
        assert (off > 1).mean() < 1e-3
