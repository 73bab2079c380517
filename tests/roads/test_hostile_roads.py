"""Roads and pads that nobody would draw: bends under a width, cliffs, walls, crossings, slivers, water."""

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.roads.build import road_network
from sketchterrain.roads.road_types import BRIDGE, GROUND, TUNNEL, axis_points, grades
from sketchterrain.stages.runner import Runner
from tests.sample_roads import (
    Named,
    contents,
    hairpins,
    heights_with,
    hills,
    network_on,
    no_water,
    ring,
    sketch_with,
)

LEVEL_GROUND = {"structure": "ground"}


def flat(x, y):
    return 0.0 * (x + y)


def off_section(network, ground=hills, shares=(-0.999, 0.0, 0.999), keep=lambda points: True):
    """Return how far (m) the ground is from carriageways at most, at shares of their half width."""
    worst = 0.0
    for road in network.roads:
        if road.structure == GROUND:
            points = axis_points(road, 0.01)
            for share in shares:
                at = points.beside(share * points.half_width)
                off = np.abs(heights_with(network, at[:, :2], ground) - at[:, 2])
                worst = max(worst, np.where(keep(at), off, 0.0).max())
    return worst


def structures_at(network, x):
    """Return the structures of roads that run past an x."""
    return {each.structure for each in network.roads if np.ptp(np.sign(each.axis[:, 0] - x)) == 2.0}


def deck(network, vector, x, y):
    """Return the height of a road's axis at its station nearest to a place."""
    axis = np.concatenate([road.axis for road in network.roads if road.id & 0xFFFF == vector])
    return axis[np.argmin(np.hypot(axis[:, 0] - x, axis[:, 1] - y)), 2]


@pytest.mark.parametrize(
    "features",
    {
        "hairpins of a radius below the width": [("road", hairpins(300, 300), LEVEL_GROUND)],
        "self-crossing": [
            ("road", [(200, 200), (400, 200), (400, 400), (300, 400), (300, 100)], LEVEL_GROUND)
        ],
        "back on itself": [("road", [(300, 300), (500, 300), (400, 300)], LEVEL_GROUND)],
        "five arms": [("road", [(500, 500), at], LEVEL_GROUND) for at in ring(500, 500, 200, 5).tolist()],
        "roundabout of 3 m": [
            ("road", [*ring(500, 500, 3.0, 8).tolist(), (503, 500)], LEVEL_GROUND),
            ("road", [(503, 500), (700, 500)], LEVEL_GROUND),
            ("road", [(497, 500), (300, 500)], LEVEL_GROUND),
        ],
        "spiral within a tile": [
            (
                "road",
                [
                    (500 + (4 + 2.2 * a) * np.cos(a), 500 + (4 + 2.2 * a) * np.sin(a))
                    for a in np.arange(0, 12, 0.3)
                ],
            )
        ],
        "tiny and long segments": [
            ("road", [(10, 100), (10.001, 100), (10.002, 100.001), (1010, 100)], LEVEL_GROUND),
            ("road", [(300, 300), (300.001, 300)]),
            ("road", [(400, 300), (400.02, 300)]),
            ("road", [(300, 400), (300.001, 400), (300, 400.001), (300, 400)]),
            ("path", [(400, 300), (400, 300.009)]),
        ],
        "duplicates": [("road", [(300, 300), (500, 300)], {"structure": "ground"}) for _ in range(3)],
    }.items(),
    ids=lambda each: each[0],
)
def test_axes_are_on_the_ground_of_odd_networks(features) -> None:
    network = network_on(sketch_with(*features[1]))
    assert network.roads
    for road in network.roads:
        assert all(np.isfinite(each).all() for each in vars(road).values() if isinstance(each, np.ndarray))
        assert np.abs(grades(road)).max() < 0.101 or road.layer == "path"
    assert off_section(network, shares=(0.0,)) < 0.02


def test_sections_are_exact_beside_cliffs_and_walls() -> None:
    def cliff(x, y):
        return np.where(y > 500.0, 60.0, 0.0) + 0.0 * x

    def terrace(x, y):
        return np.where(y > 503.0, 8.0, 0.0) + 0.0 * x

    narrow = {"width": 3.5, "shoulder": 0.5}
    lanes = [("road", [(100, y), (900, y)], narrow) for y in (500, 506)]
    for ground, features in ((cliff, [("road", [(100, 504.5), (900, 504.5)])]), (terrace, lanes)):
        network = network_on(sketch_with(*features), ground)
        assert off_section(network, ground) < 0.02
    assert [road.axis[0, 2] for road in network.roads] == [0.0, 8.0]
    y = np.arange(502.25, 503.75, 0.01)
    wall = heights_with(network, np.column_stack([np.full(len(y), 500.0), y]), terrace)
    assert (np.diff(wall) > -0.01).all()  # one step between both, of 8 m within 1.5 m
    assert np.ptp(wall) > 7.9
    beyond = ring(500, 500, 400.0, 5000)
    beyond = beyond[np.abs(beyond[:, 1] - 503.0) > 12.0]
    assert np.array_equal(
        heights_with(network, beyond, terrace), terrace(*np.round(beyond * 2**14).T / 2**14)
    )


def test_straights_of_hairpins_have_their_whole_section() -> None:
    network = network_on(sketch_with(("road", hairpins(300, 300, apart=9.0), LEVEL_GROUND)))
    assert off_section(network, keep=lambda at: np.abs(at[:, 0] - 330.0) < 15.0) < 0.02


def test_arms_of_a_junction_are_near_its_height() -> None:
    arms = [("road", [(500, 500), at], LEVEL_GROUND) for at in ring(500, 500, 200, 5).tolist()]
    network = network_on(sketch_with(*arms))
    (node,) = {float(road.axis[0, 2]) for road in network.roads}
    away = np.random.default_rng(3).uniform(-6.0, 6.0, (2000, 2))
    near = np.min([np.abs(away @ road_left(road)) < 3.0 for road in network.roads], axis=0)
    off = np.abs(heights_with(network, away + 500.0) - node)
    assert (off <= 0.101 * np.hypot(*away.T) + 0.02)[near].all()


def road_left(road):
    x, y = (road.axis[-1] - road.axis[0])[:2]
    return np.array([-y, x]) / np.hypot(x, y)


def test_bridges_reach_over_dips_that_begin_before_their_tag() -> None:
    def gully(x, y):
        return np.where((x > 470.0) & (x < 530.0), -20.0, 0.0) + 0.0 * y

    parts = [(100, 500, "automatic"), (500, 540, "bridge"), (540, 900, "automatic")]
    features = [("road", [(a, 300), (b, 300)], {"structure": kind}) for a, b, kind in parts]
    network = network_on(sketch_with(*features), gully)
    assert min(road.axis[:, 2].min() for road in network.roads) > -0.05
    assert structures_at(network, 490.0) == structures_at(network, 515.0) == {BRIDGE}


def test_decks_are_above_each_other() -> None:
    """Three ways over one place, each above the last, and each deck straight."""
    ways = [(300, 500), (700, 500)], [(500, 300), (500, 700)], [(350, 350), (650, 650)]
    features = [("road", way, {"id": k + 1, "level": k}) for k, way in enumerate(ways)]
    for slope in (0.0, 0.05):
        network = network_on(sketch_with(*features), lambda x, y, slope=slope: slope * x + 0.0 * y)
        assert network.findings == ()
        decks = [deck(network, vector, 500, 500) for vector in (1, 2, 3)]
        assert np.diff(decks).min() >= 4.5
    short = [
        ("road", [(300, 500), (494, 500), (700, 500)]),
        ("road", [(494, 500), (494, 508), (500, 508), (500, 480)], {"level": 1}),
    ]
    told, _ = network_on(sketch_with(*short), flat).findings
    assert told.startswith("road 2 is ")
    assert told.endswith("m above road 1: expected 4.5 m")


def test_tunnels_need_cover_and_length() -> None:
    def ridge(x, y):
        return 60.0 * np.exp(-(((x - 500.0) / 80.0) ** 2)) + 0.0 * y

    for (a, b), is_tunnel in (((400, 600), True), ((498, 502), False), ((300, 340), False)):
        kinds = ((100, a, "ground"), (a, b, "tunnel"), (b, 900, "ground"))
        features = [("road", [(x, 300), (end, 300)], {"structure": kind}) for x, end, kind in kinds]
        network = network_on(sketch_with(*features), ridge)
        assert ({road.structure for road in network.roads} == {GROUND, TUNNEL}) == is_tunnel, (a, b)
        assert any("they are cuttings" in told for told in network.findings)


def test_water_is_crossed_above_its_floods() -> None:
    def is_lake(x, y):
        return np.hypot(x - 600.0, y - 300.0) < 150.0

    def bed(x, y):
        return np.where(is_lake(x, y), 0.0, 6.0)

    def water(x, y):
        return np.where(is_lake(x, y), 5.0, np.nan)

    pad = [(590, 290), (610, 290), (610, 310), (590, 310)]
    for features, expected, told in (
        ([("road", [(100, 300), (600, 300)])], GROUND, "on a causeway"),
        ([("road", [(100, 300), (900, 300)])], BRIDGE, ""),
        ([("road", [(100, 300), (900, 300)], LEVEL_GROUND)], GROUND, ""),
        ([("pad", pad, {"building": 5.0})], None, ""),
    ):
        network = network_on(sketch_with(*features), bed, water)
        assert all(told in each for each in network.findings)
        for road in network.roads:
            inside = np.hypot(road.axis[:, 0] - 600.0, road.axis[:, 1] - 300.0) < 135.0
            assert (road.axis[inside, 2] >= 5.99).all()
            assert not inside.any() or road.structure == expected
        assert [each.level for each in network.pads] in ([], [6.0])


def test_earthworks_end_beyond_dead_ends() -> None:
    network = network_on(sketch_with(("road", [(300, 300), (500, 320)], LEVEL_GROUND)))
    (road,) = network.roads
    assert off_section(network) < 0.02
    for end, reach in zip(road.axis[[0, -1], :2], road.reach[[0, -1]], strict=True):
        at = ring(*end, reach + 0.01, 720)
        outside = (
            np.hypot(*(at - road.axis[[len(road.axis) // 2], :2]).T)
            > np.hypot(*(end - road.axis[len(road.axis) // 2, :2])) + 1.0
        )
        at = np.round(at[outside] * 2**14) / 2**14
        assert np.array_equal(heights_with(network, at), hills(*at.T))


def test_roads_fade_without_a_jump_while_cells_grow() -> None:
    """The width across two cells: each step of the cell size moves the ground by a small share of all."""
    network = network_on(sketch_with(("road", [(100, 300), (900, 340)], LEVEL_GROUND)))
    points = axis_points(network.roads[0], 0.1).position[:, :2]
    rng = np.random.default_rng(0)
    at = points[rng.integers(len(points), size=400)] + rng.normal(0.0, 6.0, (400, 2))
    steps = []
    for count in (25, 100):
        heights = np.array([heights_with(network, at, cell=cell) for cell in np.geomspace(0.2, 8.0, count)])
        steps.append(np.abs(np.diff(heights, axis=0)).max())
    assert np.array_equal(heights[-1], hills(*(np.round(at * 2**14) / 2**14).T))
    assert steps[1] < 0.3 * steps[0]


def test_pads_are_level_or_refused() -> None:
    for outline, reason in (
        ([(0, 0), (10, 10), (10, 0), (0, 10)], "touch itself"),
        ([(0, 0), (10, 0), (5, 0)], "touch itself"),
        ([(0, 0), (10, 0)], "three vertices"),
    ):
        with pytest.raises(InputError, match=reason):
            sketch_with(("pad", outline))

    def gentle(x, y):
        return 0.04 * x + 0.02 * y

    for outlines in (
        [[(300, 300), (340, 300), (320, 300.05)]],
        [[(300, 300), (300.002, 300), (300, 300.002)]],
        [[(300, 300), (330, 300), (330, 330), (300, 330)], [(320, 320), (350, 320), (350, 350), (320, 350)]],
        [[(300, 304), (330, 304), (330, 320), (310, 320), (310, 310), (300, 310)]],
    ):
        for turned in (1, -1):
            road = ("road", [(100, 290), (900, 290)], LEVEL_GROUND)
            features = [("pad", outline[::turned]) for outline in outlines]
            network = network_on(sketch_with(road, *features), gentle)
            assert off_section(network, gentle) < 0.02
            for pad in network.pads:
                at = np.mean(pad.outline[:3], axis=0)[None]
                assert heights_with(network, at, gentle)[0] == pytest.approx(pad.level, abs=0.02), outlines


def test_a_hundred_undone_edits_give_the_same_bits() -> None:
    features = [
        ("road", [(100, 300), (500, 340), (900, 300)]),
        ("road", [(500, 340), (520, 700)]),
        ("pad", ring(600, 400, 20)),
    ]
    other = [("road", [(100, 300), (500, 340), (900, 300)]), ("road", [(500, 340), (540, 700)])]
    sketches = [sketch_with(*features), sketch_with(*other)]
    run = Runner()
    expected = [contents(network_on(each)) for each in sketches]
    for number in range(100):
        which = number % 2
        network = road_network(sketches[which], Named(hills), Named(no_water), run)
        assert contents(network) == expected[which]


def test_earthworks_have_no_steps_where_their_reach_changes() -> None:
    """On slopes that are steeper than embankments, which never meet the ground."""

    def steep(x, y):
        return 2.0 * hills(x, y)

    road = ("road", [(100, 300), (900, 340)], LEVEL_GROUND | {"grade": 0.6})
    network, t = network_on(sketch_with(road), steep), np.linspace(0.0, 1.0, 8000)
    for away in (*range(-59, 0, 12), *range(5, 60, 12)):
        at = np.column_stack([100.0 + 800.0 * t, 300.0 + 40.0 * t + away])
        assert np.abs(np.diff(heights_with(network, at, steep))).max() < 0.2, away
