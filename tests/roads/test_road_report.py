"""Facts about roads in reports."""

import numpy as np
import pytest
import shapely

import sketchterrain as st
from sketchterrain.features.table import FeatureTable
from sketchterrain.roads.network import road_facts
from sketchterrain.roads.road_types import BRIDGE, RoadNetwork
from tests.sample_roads import make_network, make_road


def sketch_of(network):
    """Return a sketch with a vector for each feature of a network, road 1 with a limit of 4 %."""
    vectors = {}
    for layer in ("road", "railway", "path"):
        own = [road for road in network.roads if road.layer == layer]
        ids = sorted({road.id & 0x7FFFFFFF for road in own})
        lines = np.array([shapely.LineString([(0, 0), (9, each)]) for each in ids])
        limits = {"grade": np.array([0.04 if each == 1 else np.nan for each in ids])}
        vectors[layer] = FeatureTable.from_shapes(layer, lines, ids=ids, columns=limits)
    return st.Sketch(extent=1024.0, layers={"hill": np.zeros((8, 8), np.uint8)}, vectors=vectors)


def test_facts_are_lengths_structures_and_grades_beside_their_limits():
    network = make_network()
    facts = road_facts(network, sketch_of(network))
    lengths = facts["lengths"]
    assert lengths["road"] == pytest.approx(800.0 + 400.0 + 50.0 * np.pi, abs=0.1)
    assert lengths["railway"] == pytest.approx(300.0 * np.sqrt(2.0), abs=0.1)
    assert [facts[name] for name in ("bridges", "tunnels", "pads", "walls")] == [1, 1, 2, 2]
    assert facts["findings"] == list(network.findings)
    steepest = facts["steepest"]["road"]
    assert steepest == {"grade": 0.05, "limit": 0.04, "vector": 1, "position": [100.0, 100.0]}
    assert facts["steepest"]["railway"]["limit"] == 0.03


def test_a_bridge_of_several_parts_is_one():
    points = np.array([(0, 0, 5), (50, 0, 5), (90, 0, 5), (200, 0, 5), (300, 0, 5)], float)
    parts = [make_road(points[k : k + 2], part=k, structure=BRIDGE) for k in (0, 1, 3)]
    network = RoadNetwork(tuple(parts))
    assert road_facts(network, sketch_of(network))["bridges"] == 2
    assert road_facts(RoadNetwork(), sketch_of(network))["steepest"] == {}
