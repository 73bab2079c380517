"""Least-recently-used cache keyed by content or identity."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
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
    """Thread-safe cache of `most` values; the least recently used are evicted."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._values: OrderedDict[Hashable, Any] = OrderedDict()

    def of(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """Return the value cached for a key of everything it depends on; compute it if missing."""
        try:
            value: Value = self._values.pop(key)
        except KeyError:
            value = make()
        self._values[key] = value
        while len(self._values) > self._most:
            self._values.popitem(last=False)
        return value
