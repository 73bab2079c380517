"""Plain formats, read again by readers that are not ours."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

if TYPE_CHECKING:
    from collections.abc import Callable

    import sketchterrain as st


@pytest.mark.parametrize(("form", "kind"), [("r16", "<u2"), ("r16be", ">u2"), ("r32", "<f4")])
def test_raw_numbers_are_the_heights(exported: Callable, terrain: st.Terrain, form: str, kind: str) -> None:
    done = exported("raw", size=65, format=form, plants=False)
    heights = done.sidecar["heights"]
    values = np.fromfile(done.of(form[:3])[0], kind).reshape(65, 65).astype(np.float64)
    if form != "r32":
        values = heights["low"] + values * heights["metres_per_step"]
    expected = terrain.heights(*done.places(), cell_size=16.0)
    quantum = 0.0 if form == "r32" else 0.5 * heights["metres_per_step"]
    np.testing.assert_allclose(values, expected, rtol=0.0, atol=quantum * 1.000001)
