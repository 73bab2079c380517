"""Meshes of plants: forms, levels of detail that look the same from afar, leaves."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from sketchterrain.look.tree_levels import level
from sketchterrain.look.tree_measure import seen, sprig
from sketchterrain.look.tree_shape import BROAD, NEEDLES, SOLID
from sketchterrain.look.trees import DETAILS, HEIGHTS, SPECIES, VARIANTS, plant_mesh
from sketchterrain.terrain.plant import STOREYS

from .test_shaders import evaluate


def test_plants_stand_on_the_ground_one_unit_high_and_get_simpler():
    assert STOREYS["woody"] == SPECIES
    assert len(HEIGHTS) == len(SPECIES)
    total = 0
    for species, variant in itertools.product(SPECIES, range(VARIANTS)):
        meshes = [plant_mesh(species, variant, detail) for detail in range(DETAILS)]
        total += sum(mesh.nbytes for mesh in meshes)
        counts = [len(mesh) // 3 for mesh in meshes]
        assert counts == sorted(counts, reverse=True), (species, variant)
        assert counts[0] > (2000 if species == "shrub" else 4000), (species, variant)
        assert counts[-1] == 12, (species, variant)
        for mesh in meshes:
            assert -0.2 < mesh["place"][:, 2].min() < 0.05, (species, variant)
            assert 0.85 < mesh["place"][:, 2].max() < 1.2, (species, variant)
            outward = mesh["outward"][:, :3] / 127.5 - 1.0
            assert np.abs(np.linalg.norm(outward, axis=1) - 1.0).max() < 0.02, (species, variant)
        wood = meshes[0]["place"][meshes[0]["outward"][:, 3] == 0]
        foot = wood[wood[:, 2] < 0.0]
        assert np.abs(foot[:, :2]).max() < 0.1, (species, variant)
    assert total < 20e6  # bytes


@pytest.mark.parametrize(
    "species", [SPECIES[0], *(pytest.param(species, marks=pytest.mark.slow) for species in SPECIES[1:])]
)
def test_levels_cover_what_the_finest_does_in_its_colour(species):
    """From other sides than those that the levels were fitted to."""
    views = (0.9, 2.6, 4.1)
    areas = np.zeros((DETAILS, VARIANTS))
    for variant in range(VARIANTS):
        finest, *coarser = (seen(level(species, variant, detail), views=views) for detail in range(DETAILS))
        areas[:, variant] = [each.area for each in (finest, *coarser)]
        for coarse in coarser:
            assert coarse.area == pytest.approx(finest.area, rel=0.15)
            assert coarse.colour == pytest.approx(finest.colour, rel=0.25, abs=0.02)
    means = areas.mean(axis=1)
    assert means == pytest.approx(np.full(DETAILS, means[0]), rel=0.08)


def test_levels_keep_the_outline():
    """How wide a plant is, by height."""
    for species, variant in itertools.product(SPECIES, range(VARIANTS)):
        widths = []
        for detail in range(4):
            place = level(species, variant, detail).place.reshape(-1, 3)
            away = np.linalg.norm(place[:, :2], axis=1)
            bands = np.clip((place[:, 2] * 3).astype(int), 0, 2)
            widths.append([np.quantile(away[bands == band], 0.95) for band in range(3)])
        assert np.allclose(widths[1:], widths[0], atol=0.16), (species, variant)


def test_variants_differ_and_are_repeatable():
    first, second = (plant_mesh("oak", variant, 1) for variant in (0, 1))
    assert first.tobytes() != second.tobytes()
    plant_mesh.cache_clear()
    assert plant_mesh("oak", 0, 1).tobytes() == first.tobytes()


def test_crowns_are_dark_inside():
    for species in ("spruce", "oak", "birch"):
        made = level(species, 0, 0)
        leafy = made.leafy == 1.0
        away = np.linalg.norm(made.place[leafy].mean(axis=1)[:, :2], axis=1)
        opened = made.open[leafy].mean(axis=1)
        low, high = np.quantile(away, [0.2, 0.8])
        assert opened[away < low].mean() < 0.85 * opened[away > high].mean()


@pytest.mark.gl
def test_sprays_are_cut_as_they_are_measured(gl):
    rng = np.random.default_rng(4)
    across, along = rng.uniform(-1, 1, 4000), rng.uniform(0, 1, 4000)
    for kind in (SOLID, BROAD, NEEDLES):
        rows = np.stack([across, along, np.full(4000, kind), np.zeros(4000)], axis=1).astype(np.float32)
        got = evaluate(gl, ["render/sprig.glsl"], "vec4(sprig(a.xy, a.z))", rows)[:, 0]
        rows = rows.astype(np.float64)
        edge = np.mod((rows[:, 1] - 0.3 * 0.55 * np.abs(rows[:, 0])) * 5.0 + 0.5 * (rows[:, 0] < 0.0), 1.0)
        expected = sprig(rows[:, 0], rows[:, 1], rows[:, 2])
        inner = np.minimum(edge, 1.0 - edge) > 1e-4  # a leaf's neighbour begins there
        assert np.abs(got - expected)[inner].max() < 1e-4, kind
        covered = (expected > 0.0).mean()
        assert covered == 1.0 if kind == SOLID else 0.35 < covered < 0.75, kind
