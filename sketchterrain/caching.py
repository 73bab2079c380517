"""Least-recently-used caches, keyed by everything that a value depends on."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable
from typing import Any, TypeVar

Value = TypeVar("Value")


class IdentityKey:
    """Cache key of an immutable object, equal only to itself."""

    __slots__ = ("_thing",)

    def __init__(self, thing: object) -> None:
        self._thing = thing

    def __eq__(self, other: object) -> bool:
        """Compare by identity."""
        return isinstance(other, IdentityKey) and self._thing is other._thing

    def __hash__(self) -> int:
        """Hash by identity: the key holds the object, so its id can't be reused."""
        return id(self._thing)


class LRUCache:
    """Thread-safe cache of a number of values; the least recently used are evicted."""

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._values: OrderedDict[Hashable, Any] = OrderedDict()

    def __len__(self) -> int:
        return len(self._values)

    def __contains__(self, key: Hashable) -> bool:
        return key in self._values

    def get_or_compute(self, key: Hashable, compute: Callable[[], Value]) -> Value:
        """Return the value cached for a key of everything it depends on; compute it if missing."""
        try:
            value: Value = self._values.pop(key)
        except KeyError:
            value = compute()
        return self.store(key, value)

    def store(self, key: Hashable, value: Value) -> Value:
        """Cache a value and return it."""
        self._values[key] = value
        while len(self._values) > self._capacity:
            self._values.popitem(last=False)
        return value

    def get(self, key: Hashable) -> Any:
        """Return the value cached for a key, now the most recently used, or None."""
        value = self._values.get(key)
        if value is not None:
            self._values.move_to_end(key)
        return value

    def keys(self) -> list[Any]:
        """Return the keys, the least recently used first."""
        return list(self._values)

    def retained(self, keys: Iterable[Hashable]) -> LRUCache:
        """Return a cache of the entries of some keys, in this order."""
        other = LRUCache(self._capacity)
        for key in keys:
            other._values[key] = self._values[key]
        return other
