from __future__ import annotations

import pytest

from sketchterrain.features.recent import Recent, Same


def test_the_most_recent_values_are_cached_and_failures_are_not() -> None:
    recent, made = Recent(2), []

    def make(value: int) -> int:
        made.append(value)
        return value

    for value in (1, 2, 1, 3, 1, 2):
        assert recent.of(value, lambda value=value: make(value)) == value
    assert made == [1, 2, 3, 2]  # 2 was the least recent when 3 came

    def fail() -> None:
        raise KeyError("no")

    with pytest.raises(KeyError):
        recent.of("a", fail)
    assert recent.of("a", lambda: 5) == 5


def test_same_compares_by_identity() -> None:
    one, other = [1], [1]
    assert Same(one) == Same(one)
    assert hash(Same(one)) == hash(Same(one))
    assert Same(one) != Same(other)
    recent = Recent(0)
    assert recent.of(Same(one), lambda: 1) == 1
    assert recent.of(Same(one), lambda: 2) == 2
