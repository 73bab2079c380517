"""Digests are of contents: the same in any process, of images by blocks."""

import gc
import subprocess
import sys
from dataclasses import dataclass, field

import numpy as np
import pytest

from sketchterrain.stages import digests
from sketchterrain.stages.digests import BLOCK, derive_digest, digest_of, patched
from sketchterrain.stages.runner import Results, Runner


@dataclass(frozen=True, eq=False)
class Value:
    a: object
    b: object = field(init=False, default=1)


@dataclass(frozen=True)
class Named:
    id: int
    rest: object = field(compare=False, default=None)


def test_values_that_differ_in_anything_have_other_digests():
    values = [
        *(None, True, 1, 1.0, -0.0, 0.0, "1", b"1", (), [], {}, (1,), ((1,),), {1: 2}, {2: 1}, "ab"),
        *(("a", "b"), ("ab",), ("a", "b", 1), frozenset({1, 2}), slice(1, 2), np.float32(1.0), Value, len),
        *(np.zeros(4), np.zeros(4, np.float32), np.zeros((2, 2)), np.zeros(2, [("a", "f8"), ("b", "f8")])),
        *(np.zeros(4, [("b", "f8")]), Value(1), Value(2), Value(np.arange(3)), Named(1), Named(2)),
    ]
    found = [digest_of(value) for value in values]
    same = [(values[i], values[j]) for j in range(len(found)) for i in range(j) if found[i] == found[j]]
    assert same == []
    assert digest_of(Value((1, [2.0, {"a": np.arange(3)}]))) == digest_of(
        Value((1, [2.0, {"a": np.arange(3)}]))
    )
    assert digest_of(Named(1, "a")) == digest_of(Named(1, "b"))


def test_what_has_no_content_is_refused():
    for value in (object(), lambda: 1, np.array([object()]), Value(object())):
        with pytest.raises(TypeError, match="expected"):
            digest_of(value)


def test_digests_are_the_same_in_another_process():
    code = (
        "from sketchterrain.stages.digests import digest_of; import numpy as np; print(digest_of(%s).hex())"
    )
    value = "('a', 1.5, {'b': np.arange(5), 'c': None}, frozenset({'x', 'y', 'z'}))"
    found = subprocess.run([sys.executable, "-c", code % value], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == digest_of(eval(value)).hex()  # noqa: S307 # the line above


def frozen(image):
    image = image.copy()
    image.flags.writeable = False
    return image


def test_an_edited_images_digest_hashes_its_blocks_and_is_that_of_a_new_one(monkeypatch):
    rng = np.random.default_rng(3)
    image = rng.integers(0, 5, (3 * BLOCK + 7, 2 * BLOCK + 1), np.uint8)
    before = frozen(image)
    digest_of(before)
    for box in (
        (-9, -70, 1, 1),
        (BLOCK - 1, 3, BLOCK + 1, BLOCK),
        (3 * BLOCK, 2 * BLOCK, 3 * BLOCK + 7, 2 * BLOCK + 1),
    ):
        image[max(box[0], 0) : box[2], max(box[1], 0) : box[3]] += 1
        after = frozen(image)
        derive_digest(after, before, box)
        hashed = []
        monkeypatch.setattr(digests, "_hashed_blocks", lambda *_, to=hashed: to.append(1))
        found = digest_of(after)
        monkeypatch.undo()
        assert hashed == []
        assert found == digest_of(frozen(image)) != digest_of(before)
        differs = digests.blocks_of(after) != digests.blocks_of(before)
        pixels = bytearray(b"".join(after[place].tobytes() for place in digests.places_of(differs)))
        again = patched(before, after.shape, differs, pixels)
        assert np.array_equal(again, after)
        assert digest_of(again) == found
        before = after


def test_digests_of_objects_are_kept_as_long_as_they_live():
    value = Value(np.zeros(10))
    digest_of(value)
    assert id(value) in digests._digests
    name = id(value)
    del value
    gc.collect()
    digests._digests.forget_gone()
    assert name not in digests._digests
    living = len(digests._digests)
    for _ in range(4 * (living + digests._FEW)):
        digest_of(Value(np.zeros(1)))
    assert len(digests._digests) <= 2 * (living + digests._FEW)


def doubled(items):
    CALLS.append(list(items))
    return [2 * item for item in items]


CALLS: list[list[int]] = []


def parity(value):
    CALLS.append([value])
    return np.full(1000, value % 2)


def total(values):
    CALLS.append(["total"])
    return float(values.sum())


def test_equal_results_are_one_object_and_stop_what_depends_on_them():
    CALLS.clear()
    run = Runner()
    one, other = (run(total, run(parity, value)) for value in (1, 3))
    assert one == other == 1000.0
    assert CALLS == [[1], ["total"], [3]]
    assert run(parity, 1) is run(parity, 3)
    assert not run(parity, 1).flags.writeable
    run(total, run(parity, 2))
    assert CALLS[3:] == [[2], ["total"]]


def test_missing_items_are_computed_at_once():
    CALLS.clear()
    run = Runner()
    assert run.each(doubled, [1, 2, 3]) == [2, 4, 6]
    assert run.each(doubled, [3, 4, 1, 5, 4]) == [6, 8, 2, 10, 8]
    assert CALLS == [[1, 2, 3], [4, 5]]


def test_results_are_bounded_and_a_cancelled_run_leaves_none():
    results, stop = Results(max_bytes=20_000), []

    def checkpoint():
        if stop:
            raise InterruptedError

    run = Runner(results, checkpoint)
    for value in range(9):
        run(np.full, 1000, float(value))
        assert results.nbytes <= 20_000
    stop.append(True)
    with pytest.raises(InterruptedError):
        run(np.full, 1000, 99.0)
    stop.clear()
    assert run(np.full, 1000, 99.0)[0] == 99.0
