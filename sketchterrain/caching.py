"""Least-recently-used caches, keyed by everything that a value depends on."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable
from threading import RLock
from typing import Any, TypeVar

import numpy as np

Value = TypeVar("Value")
_PLAIN = frozenset({int, float, str, bytes, bool, type(None)})
_MISSING: Any = object()


class LRUCache:
    """Thread-safe cache of so many values and bytes of their arrays; the least recently used are evicted."""

    def __init__(self, capacity: int = 1 << 14, *, max_bytes: int = 1 << 29) -> None:
        self._capacity, self._max_bytes, self._bytes = capacity, max_bytes, 0
        self._values: OrderedDict[Hashable, tuple[Any, int]] = OrderedDict()
        self._lock = RLock()

    def __len__(self) -> int:
        return len(self._values)

    def __contains__(self, key: Hashable) -> bool:
        return key in self._values

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays of all values."""
        return self._bytes

    def get_or_compute(self, key: Hashable, compute: Callable[[], Value]) -> Value:
        """Return the value cached for a key of everything it depends on; compute it if missing."""
        value: Value = self.get(key, _MISSING)
        return self.store(key, compute()) if value is _MISSING else value

    def store(self, key: Hashable, value: Value) -> Value:
        """Cache a value and return it."""
        size = self._size_of(value)
        with self._lock:
            self._bytes += size - self._values.pop(key, (None, 0))[1]
            self._values[key] = value, size
            while len(self._values) > self._capacity or (
                self._bytes > self._max_bytes and len(self._values) > 1
            ):
                self._bytes -= self._values.popitem(last=False)[1][1]
        return value

    def _size_of(self, value: object) -> int:
        """Return the bytes of the arrays that a value consists of."""
        if isinstance(value, np.ndarray):
            return value.nbytes
        parts: Any = value if isinstance(value, (tuple, list)) else ()
        if hasattr(value, "__dataclass_fields__"):
            parts = vars(value).values()
        return sum([self._size_of(each) for each in parts if type(each) not in _PLAIN])

    def get(self, key: Hashable, default: Any = None) -> Any:
        """Return the value cached for a key, now the most recently used, or a default."""
        with self._lock:
            if key not in self._values:
                return default
            self._values.move_to_end(key)
            return self._values[key][0]

    def clear(self) -> None:
        """Forget all values."""
        with self._lock:
            self._values.clear()
            self._bytes = 0

    def items(self) -> list[tuple[Any, Any]]:
        """Return the keys and values, the least recently used first."""
        return [(key, value) for key, (value, _) in self._values.items()]

    def keys(self) -> list[Any]:
        """Return the keys, the least recently used first."""
        return list(self._values)

    def retained(self, keys: Iterable[Hashable]) -> LRUCache:
        """Return a cache of the entries of some keys, in this order."""
        other = LRUCache(self._capacity, max_bytes=self._max_bytes)
        for key in keys:
            other.store(key, self._values[key][0])
        return other
