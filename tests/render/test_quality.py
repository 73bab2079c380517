"""Quality of pictures as one number."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.render import Quality

CHEAPER_WHEN_GREATER = {"tolerance", "steep", "thin"}
FIXED = {"split"}


def test_a_greater_number_never_costs_less():
    assert Quality.of(1.0) == Quality()
    steps = [Quality.of(number) for number in np.linspace(0.0, 1.0, 101)]
    assert all(quality.map_texels % 64 == 0 for quality in steps)  # light maps lie on whole blocks
    for field in dataclasses.fields(Quality):
        if field.name == "without":
            continue
        values = np.array([getattr(quality, field.name) for quality in steps], dtype=float)
        change = np.diff(values)
        if field.name in CHEAPER_WHEN_GREATER:
            assert (change < 0.0).all()
        else:
            assert (change >= 0.0).all()
            assert (values[-1] > values[0]) != (field.name in FIXED)


def test_a_driver_without_a_gpu_gets_a_cheap_picture():
    software = Quality.for_renderer("llvmpipe (LLVM 15.0.6, 256 bits)")
    shared = Quality.for_renderer("Mesa Intel(R) UHD Graphics 620 (KBL GT2)")
    card = Quality.for_renderer("NVIDIA H100 80GB HBM3/PCIe/SSE2")
    assert software.woods < shared.woods < card.woods <= Quality().woods
    assert software.materials * software.planes * software.octaves == 1
    assert software.moving_scale < card.moving_scale


def test_parts_are_left_out_by_name():
    quality = Quality.of(0.5, without=["grass"])
    assert not quality.has("grass")
    assert quality.has("trees")


def test_other_numbers_and_parts_are_refused():
    for number in (-0.01, 1.01, float("nan")):
        with pytest.raises(InputError, match="from 0 to 1"):
            Quality.of(number)
    with pytest.raises(InputError, match=r"one of shadows.*got 'gras'"):
        Quality.of(0.5, without=["gras"])
