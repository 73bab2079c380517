"""Where the sheet lies on the screen."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sketchterrain.ui.canvas.viewport import LARGEST, Viewport


def test_a_fitted_sheet_is_whole_and_in_the_middle() -> None:
    for size, sides in (((800, 600), (512, 512)), ((300, 900), (4096, 1024)), ((900, 300), (7, 5))):
        viewport = Viewport(*size, *sides).fitted(margin=20)
        width, height = viewport.sheet_size
        assert viewport.left >= 19
        assert viewport.top >= 19
        assert viewport.left + width <= size[0] - 19
        assert viewport.top + height <= size[1] - 19
        assert abs(viewport.left - (size[0] - viewport.left - width)) <= 2
        assert abs(viewport.top - (size[1] - viewport.top - height)) <= 2


@settings(max_examples=60, deadline=None)
@given(
    scale=st.floats(0.02, 64.0),
    left=st.integers(-4000, 900),
    top=st.integers(-4000, 900),
    x=st.floats(-100.0, 700.0),
    y=st.floats(-100.0, 700.0),
)
def test_places_go_there_and_back(scale: float, left: int, top: int, x: float, y: float) -> None:
    viewport = Viewport(1000, 800, 512, 512, scale, left, top)
    assert viewport.to_sketch(*viewport.to_screen(x, y)) == pytest.approx((x, y), abs=1e-6)


def test_zooming_and_resizing_keep_the_place_they_are_about() -> None:
    viewport = Viewport(1000, 800, 512, 512).fitted(margin=20)
    for factor in (1.2, 1.2, 3.0, 1 / 1.2, 1 / 3.0):
        before = viewport.to_sketch(431.0, 377.0)
        viewport = viewport.zoomed(factor, 431.0, 377.0)
        after = viewport.to_screen(*before)
        # The sheet's corner lies on whole pixels of the screen.
        assert after == pytest.approx((431.0, 377.0), abs=0.5 + 1e-9)

    viewport = Viewport(800, 600, 512, 512).fitted(margin=20).zoomed(4.0, 400.0, 300.0)
    middle = viewport.to_sketch(400.0, 300.0)
    wider = viewport.resized(1200, 700)
    assert wider.to_sketch(600.0, 350.0) == pytest.approx(middle, abs=0.5)
    assert wider.scale == viewport.scale


def test_the_sheet_is_never_lost() -> None:
    rng = random.Random(4)
    for sides in ((512, 512), (2048, 700), (3, 9), (16384, 16384)):
        viewport = Viewport(700, 500, *sides).fitted(margin=20)
        for _ in range(2000):
            action = rng.random()
            if action < 0.4:
                viewport = viewport.moved(rng.uniform(-900, 900), rng.uniform(-900, 900))
            elif action < 0.9:
                viewport = viewport.zoomed(rng.uniform(0.3, 3.0), rng.uniform(0, 700), rng.uniform(0, 500))
            else:
                viewport = viewport.resized(rng.randint(60, 1500), rng.randint(60, 1500))
            width, height = viewport.sheet_size
            assert 0.0 < viewport.scale <= LARGEST
            seen_x = min(viewport.left + width, viewport.width) - max(viewport.left, 0)
            seen_y = min(viewport.top + height, viewport.height) - max(viewport.top, 0)
            assert seen_x >= min(40, width - 1)
            assert seen_y >= min(40, height - 1)
