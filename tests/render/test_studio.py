"""Pictures one after the other are those of `render_picture`, to the bit, whatever was drawn before."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.render import render_picture
from sketchterrain.render.kept import Kept
from sketchterrain.render.studio import Studio
from sketchterrain.sketch import Sketch
from sketchterrain.terrain import build

SIZE = (160, 90)


def sketch(seed, *, extent=1024.0, look=None):
    layers = {name: np.zeros((32, 32), np.uint8) for name in ("mountain", "forest", "river")}
    layers["mountain"][4:10, 20:28] = 1
    layers["forest"][18:28, 4:14] = 1
    layers["river"][14:16] = 1
    return Sketch(extent=extent, seed=seed, layers=layers, look=look or {})


@pytest.mark.gl
@pytest.mark.slow
def test_the_same_bytes_in_any_order():
    other = sketch(2, extent=700.0, look={"grass": {"colour": "#c83c3c"}})
    terrains = [build(sketch(1)), build(other)]
    with ThreadPoolExecutor(1) as thread:
        studio = thread.submit(Studio, SIZE).result()
        found = [thread.submit(studio.picture, terrains[number]).result() for number in (0, 1, 0)]
        thread.submit(studio.close).result()
    assert (found[1] == render_picture(terrains[1], size=SIZE)).all()
    assert (found[0] == found[2]).all()
    assert not (found[0] == found[1]).all()


@pytest.mark.gl
def test_invalid_sizes_and_views_are_refused():
    with pytest.raises(InputError, match="pixels a side"):
        Studio((8, 8))
    with Studio((32, 32)) as studio, pytest.raises(InputError, match="expected a view"):
        studio.picture(build(sketch(1)), view="odd")


def test_one_resource_of_each_kind_is_cached():
    kept, closed = Kept(), []
    first = kept.of("a", 1, lambda: ["first"], close=lambda thing: closed.append(thing[0]))
    assert kept.of("a", 1, lambda: ["never"]) is first
    other = kept.of("b", 1, lambda: ["other"])
    assert kept.of("a", 2, lambda: ["second"], close=lambda thing: closed.append(thing[0])) == ["second"]
    assert (closed, kept.of("b", 1, lambda: ["never"]) is other) == (["first"], True)
    kept.close()
    assert closed == ["first", "second"]
    assert kept.of("a", 2, lambda: ["third"]) == ["third"]


def test_lent_resources_outlive_their_borrower_and_failures_are_not_cached():
    kept, closed = Kept(), []
    lent = kept.lent()
    thing = lent.of("a", 1, lambda: ["made"], close=lambda thing: closed.append(thing[0]))
    lent.close()
    lent.lent().close()
    assert closed == []
    assert kept.of("a", 1, lambda: ["never"]) is thing
    kept.close()
    assert closed == ["made"]

    def fail():
        raise RuntimeError("no room")

    with pytest.raises(RuntimeError):
        kept.of("a", 1, fail)
    assert kept.of("a", 1, lambda: "made") == "made"
