"""From a map and elevation to a terrain: `new --osm --dem`, then `build`."""

import numpy as np
import rasterio
from rasterio.transform import Affine

from sketchterrain.app.cli import main
from sketchterrain.document.rasters import raster_source
from sketchterrain.document.store import load_sketch
from sketchterrain.generation.building import build
from sketchterrain.generation.terrain import Terrain
from sketchterrain.importing.elevation import sketch_on_elevation
from sketchterrain.roads.road_types import BRIDGE, GROUND, TUNNEL, axis_points
from sketchterrain.terrain.layers.pads import PadsLayer
from sketchterrain.terrain.layers.roads import RoadsLayer
from tests import terrains
from tests.importing.test_roads import osm_of

CORNER, SIZE, STEP = (600_000.0, 5_200_000.0), (75, 60), 20.0


def valley_and_ridge(x):
    return 500.0 - 18.0 * np.exp(-(((x - 400.0) / 25.0) ** 2)) + 70.0 * np.exp(-(((x - 1000.0) / 70.0) ** 2))


def test_a_map_on_elevation_becomes_a_terrain(tmp_path, capsys) -> None:
    columns, rows = SIZE
    heights = np.tile(valley_and_ridge((np.arange(columns) + 0.5) * STEP), (rows, 1)).astype(np.float32)
    place = Affine(STEP, 0.0, CORNER[0], 0.0, -STEP, CORNER[1])
    profile = {"driver": "GTiff", "count": 1, "height": rows, "width": columns, "dtype": "float32"}
    with rasterio.open(tmp_path / "dem.tif", "w", crs="EPSG:25832", transform=place, **profile) as file:
        file.write(heights, 1)
    frame, _ = sketch_on_elevation([raster_source(tmp_path / "dem.tif", "elevation")])
    yard = [(600, 620), (630, 620), (630, 640), (600, 640), (600, 620)]
    path = osm_of(
        tmp_path / "map.osm",
        frame,
        ([(50, 600), (360, 600)], {"highway": "secondary"}),
        ([(360, 600), (440, 600)], {"highway": "secondary", "bridge": "yes", "layer": "1"}),
        ([(440, 600), (700, 600), (860, 600)], {"highway": "secondary"}),
        ([(860, 600), (1140, 600)], {"highway": "secondary", "tunnel": "yes", "layer": "-1"}),
        ([(1140, 600), (1450, 600)], {"highway": "secondary"}),
        ([(400, 100), (400, 1100)], {"highway": "track"}),
        ([(700, 600), (720, 900)], {"highway": "path"}),
        (yard, {"building": "yes"}),
        ([(600, 650), (640, 650)], {"barrier": "hedge"}),
    )
    assert main(["new", str(tmp_path / "a"), "--osm", str(path), "--dem", str(tmp_path / "dem.tif")]) == 0
    assert "km on 1 grid of elevation" in capsys.readouterr().out
    sketch = load_sketch(tmp_path / "a")
    terrain = build(sketch, device=terrains.context())
    network = terrain.recipe.network
    (pad,), (hedge,) = network.pads, network.standing
    assert pad.building == 6.0
    assert hedge.values["material"] == "hedge"
    assert not any("above" in told for told in network.findings)
    names = terrain.recipe.materials.names
    natural = terrain.recipe.with_layers([PadsLayer(names, ()), RoadsLayer(names, ())])
    bare = Terrain(sketch, natural, terrain.context)
    lengths = {GROUND: 0.0, BRIDGE: 0.0, TUNNEL: 0.0}
    for road in network.roads:
        points = axis_points(road, 0.5)
        ground, before = (each.heights(*points.position[:, :2].T) for each in (terrain, bare))
        lengths[road.structure] += np.ptp(road.along)
        if road.structure == GROUND:
            assert np.abs(ground - points.position[:, 2]).max() < 0.02
        else:
            inside = (points.along > points.along[0] + 64.0) & (points.along < points.along[-1] - 64.0)
            assert np.array_equal(ground[inside], before[inside])
    assert lengths[BRIDGE] >= 79.9
    assert lengths[TUNNEL] > 150.0
