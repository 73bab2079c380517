"""Areas of land use: differences, outlines of pieces, crops, directions of rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sketchterrain.document.sketch import Sketch
from sketchterrain.features.table import AREA, Feature, FeatureTable
from sketchterrain.landuse.areas import LandUse, land_use
from sketchterrain.schema.layers import CROPS


def sketch_of(layer: FeatureTable) -> Sketch:
    return Sketch(extent=1000.0, vectors={"landuse": layer})


def row_of_fields(count: int, **own) -> FeatureTable:
    """Return squares of 10 m in a row, ids from 1 on."""
    square = np.array([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)])
    every = [Feature(AREA, (square + np.array([10.0 * k, 0.0]),), 1, dict(own)) for k in range(count)]
    return FeatureTable("landuse").edited(add=every)


def contents(areas: LandUse, row: int) -> tuple[bytes, ...]:
    values = (areas.ids, areas.use, areas.crop, areas.direction, areas.density, areas.conifers, areas.parcels)
    edges = areas.edges[areas.first[row] : areas.first[row + 1]]
    return (*(each[row].tobytes() for each in values), edges.tobytes())


def test_differences_are_those_of_the_contents() -> None:
    """Of a layer of many pieces too: what its areas share is not compared."""
    rng, layer = np.random.default_rng(2), row_of_fields(1500)
    assert len(layer.pieces) > 1
    old = land_use(sketch_of(layer))
    one = [contents(old, k) for k in range(len(old))]
    for number in range(16):
        name = int(rng.choice(layer.ids))
        feature = layer.feature(name)
        ring = feature.rings[0].copy()
        match number % 4:
            case 0:
                ring[rng.integers(len(ring))] += rng.integers(1, 3, 2)
            case 1:
                ring = np.insert(ring, 1, ring[0] + (3.0, -1.0), axis=0)
            case 2:
                feature = replace(feature, properties={"use": str(rng.choice(["forest", "meadow"]))})
        feature = replace(feature, rings=(ring,))
        others = [replace(feature, id=0)] if number % 8 == 3 else []
        layer = layer.edited(remove=[name], add=[*others] if number % 4 == 3 else [feature])
        new = land_use(sketch_of(layer))
        removed, added = new.difference(old)
        other = [contents(new, k) for k in range(len(new))]
        gone, fresh = set(one) - set(other), set(other) - set(one)
        assert removed.tolist() == [k for k, each in enumerate(one) if each in gone], number
        assert added.tolist() == [k for k, each in enumerate(other) if each in fresh], number
        old, one = new, other


def test_outlines_are_those_of_all_edges() -> None:
    areas = land_use(sketch_of(row_of_fields(1500)))
    chosen = np.random.default_rng(1).integers(0, 1500, 80)
    owner, edges = areas.outlines(chosen)
    of, number = areas.edges_of(chosen)
    assert np.array_equal(owner, of)
    assert np.array_equal(edges, areas.edges[number])
    assert np.array_equal(np.bincount(owner), np.full(80, 4))


def test_automatic_crops_are_mixed_and_others_stay() -> None:
    areas = land_use(sketch_of(row_of_fields(1500)))
    every = np.arange(len(areas))
    share = np.bincount(areas.crops(every), minlength=len(CROPS)) / len(areas)
    assert share[CROPS.index("automatic")] == share[CROPS.index("orchard")] == 0.0
    assert 0.4 < share[CROPS.index("wheat")] < 0.6
    vines = land_use(sketch_of(row_of_fields(3, crop="vineyard")))
    assert (vines.crops(np.arange(3)) == CROPS.index("vineyard")).all()


def test_rows_follow_contours_or_the_longest_side() -> None:
    long = [(0.0, 0.0), (200.0, 100.0), (180.0, 140.0), (-20.0, 40.0)]
    layer = FeatureTable("landuse").edited(add=[Feature(AREA, (np.array(long),))])
    areas, one = land_use(sketch_of(layer)), np.zeros(1, np.int64)

    def slope(east: float, north: float):
        return lambda x, y, cell_size: (east * x + north * y + 0.0 * cell_size).astype(np.float32)

    side = np.degrees(np.arctan2(200.0, 100.0))
    assert abs(areas.bearings(one, slope(0.0, 0.0))[0] - side) < 1e-9
    assert abs(areas.bearings(one, slope(0.3, 0.0))[0] % 180.0) < 1e-3  # uphill is east: rows run north
    assert abs(areas.bearings(one, slope(0.2, 0.2))[0] - 135.0) < 1e-3
    given = replace(areas, direction=np.array([20.0]))
    assert given.bearings(one, slope(0.3, 0.0)).tolist() == [20.0]
