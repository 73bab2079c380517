"""Values by what they were made from; those not asked for the longest are forgotten."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

Value = TypeVar("Value")


class IdentityKey:
    """Stands in a key for a thing that never changes, which equals nothing but itself."""

    __slots__ = ("_thing",)

    def __init__(self, thing: object) -> None:
        self._thing = thing

    def __eq__(self, other: object) -> bool:
        """Whether it is the very same thing."""
        return isinstance(other, IdentityKey) and self._thing is other._thing

    def __hash__(self) -> int:
        """By identity: the key holds the thing, so no other can take its place."""
        return id(self._thing)


class LRUCache:
    """Remembers values, so that they need not be made again. Several threads may use it at once.

    Parameters
    ----------
    most : int
        How many it remembers.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._values: OrderedDict[Hashable, Any] = OrderedDict()

    def of(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """Return what was made for a key; make it, if it is not remembered.

        Parameters
        ----------
        key
            Everything that the value depends on.
        make
            If it raises, nothing is remembered.
        """
        try:
            value: Value = self._values.pop(key)
        except KeyError:
            value = make()
        self._values[key] = value
        while len(self._values) > self._most:
            self._values.popitem(last=False)
        return value
