"""Placement of the textures of materials."""

from __future__ import annotations

import numpy as np

from sketchterrain.look.texture_maker import LAYERS
from sketchterrain.render.texture_places import (
    OCTAVES,
    PERIOD,
    RATIO,
    texture_phases,
    texture_uniforms,
    texture_widths,
)

WIDTHS = texture_widths()


def phases(*eye):
    return texture_phases(eye, WIDTHS).reshape(len(LAYERS), 3, OCTAVES, 2)


def test_phases_repeat_after_whole_periods_and_stay_within_one():
    grass = WIDTHS[0]
    here, there = phases(0.0, 0.0, 0.0), phases(PERIOD * grass, -2 * PERIOD * grass, 0.0)
    gap = np.abs(here - there)[0, 2, 0]
    assert np.minimum(gap, PERIOD - gap).max() < 1e-5
    far = phases(1e9, -1e9, 10.0)
    assert ((far >= 0) & (far <= PERIOD)).all()


def test_phases_are_places_in_turned_planes_over_widths():
    eye = np.array([3.0, 7.0, 2.0])
    got = phases(*eye)
    for layer, (width, _, _, turn) in enumerate(texture_uniforms(WIDTHS)["laid"]):
        for plane, axes in enumerate(((1, 2), (0, 2), (0, 1))):
            for octave in range(OCTAVES):
                place = complex(*eye[list(axes)]) * np.exp(1j * turn * octave) / (width * RATIO**octave)
                expected = np.array([place.real, place.imag]) % PERIOD
                assert np.allclose(got[layer, plane, octave], expected, atol=1e-5)


def test_beds_of_rock_lie_level_at_every_size():
    laid, spins = (texture_uniforms(WIDTHS)[name] for name in ("laid", "spins"))
    rock = list(LAYERS).index("rock")
    assert laid[rock][3] == 0.0
    assert spins[rock] == 0.0
    assert laid[0][3] > 0.0


def test_a_look_sets_the_width_of_a_texture():
    widths = texture_widths({"sand": {"size": 9.0}, "rock": {"size": 0.0}})
    names = list(LAYERS)
    assert widths[names.index("sand")] == 9.0
    assert widths[names.index("rock")] == LAYERS["rock"].width
