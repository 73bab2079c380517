from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from sketchterrain.world.chunk_cache import ChunkCache


def test_what_was_asked_for_lately_is_not_made_again() -> None:
    made = []
    cache = ChunkCache(300)

    def get(key: int) -> None:
        def make() -> np.ndarray:
            made.append(key)
            return np.full(100, key, np.uint8)

        assert cache.get(key, make)[0] == key

    for key in (1, 2, 3, 1, 4, 1, 3, 2):  # 4 drives 2 out, which was not asked for the longest time
        get(key)
    assert made == [1, 2, 3, 4, 2]
    assert cache.taken == 300


def test_one_that_is_larger_than_the_room_is_still_given() -> None:
    cache = ChunkCache(10)
    assert len(cache.get("a", lambda: np.zeros(100, np.uint8))) == 100
    cache.get("b", lambda: np.zeros(4, np.uint8))
    assert cache.taken == 4


def test_a_failure_leaves_nothing_behind() -> None:
    cache = ChunkCache(10)
    with pytest.raises(ZeroDivisionError):
        cache.get("a", lambda: 1 // 0)  # type: ignore[return-value, arg-type]
    assert cache.taken == 0


def test_threads_share_it_and_its_room() -> None:
    cache = ChunkCache(1000)

    def ask(number: int) -> bool:
        key = number % 37
        return bool((cache.get(key, lambda: np.full(100, key, np.uint8)) == key).all())

    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(ask, range(2000)))
    assert cache.taken == 1000
