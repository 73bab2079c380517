"""The tone curve."""

from __future__ import annotations

import colorsys

import numpy as np
import pytest

from .test_shaders import evaluate

pytestmark = pytest.mark.gl


def film(gl, colours):
    rows = np.c_[colours, np.zeros(len(colours))]
    return evaluate(gl, ["render/tone.glsl"], "vec4(film(a.rgb), 0.0)", rows)[:, :3].astype(float)


def decoded(encoded):
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def test_more_light_is_never_darker(gl):
    grey = np.geomspace(1e-4, 50.0, 400)[:, None] * np.ones(3)
    shown = film(gl, grey)
    assert (np.diff(shown, axis=0) > -2e-4).all()
    assert shown[0].max() < 0.01
    assert shown[-1].min() > 0.98
    assert np.ptp(shown, axis=1).max() < 2e-3


def test_middle_grey_and_a_stop_around_it_keep_their_brightness(gl):
    darker, middle, brighter = decoded(film(gl, [[0.09] * 3, [0.18] * 3, [0.36] * 3]))
    assert middle == pytest.approx(0.18, abs=0.012)
    assert 0.05 < darker[0] < 0.1
    assert 0.3 < brighter[0] < 0.5


def test_hues_stay_as_they_fade_to_white(gl):
    for hue in np.linspace(0.0, 1.0, 13)[:-1]:
        colour = np.array(colorsys.hsv_to_rgb(hue, 0.6, 1.0))
        shown = film(gl, np.geomspace(0.05, 4.0, 30)[:, None] * colour)
        chroma = np.ptp(shown, axis=1)
        hues = np.array([colorsys.rgb_to_hsv(*c)[0] for c in shown])
        turned = np.abs((hues - hue + 0.5) % 1.0 - 0.5)
        assert turned[chroma > 0.03].max() < 0.07, hue
        assert chroma[-1] < 0.6 * chroma.max(), hue
