"""Running pure functions once for equal inputs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from hashlib import blake2b
from inspect import signature
from typing import Any, Final, TypeVar
from weakref import WeakValueDictionary

import numpy as np

from sketchterrain.caching import LRUCache
from sketchterrain.stages.digests import Memory, digest_of, remember_parts

Value = TypeVar("Value")

_MISSING: Any = object()
_AT_ONCE: Final = 64  # items
_sizes = Memory()
"""Bytes of the arrays of objects, by id."""


class Results(LRUCache):
    """Results of runs by the digests of function and inputs, and one object for each digest of a value.

    `on_disk` returns the result of a key that is on disk, or computes and stores it; by default none is.
    """

    def __init__(
        self,
        capacity: int = 1 << 14,
        *,
        max_bytes: int = 1 << 29,
        on_disk: Callable[[bytes, Callable[[], Any]], Any] = lambda _, compute: compute(),
    ) -> None:
        super().__init__(capacity, max_bytes=max_bytes)
        self.on_disk = on_disk
        self._objects: WeakValueDictionary[bytes, Any] = WeakValueDictionary()

    def _size_of(self, value: object) -> int:
        if not hasattr(value, "__dataclass_fields__"):
            return super()._size_of(value)
        size: int | None = _sizes.of(value)
        if size is None:
            size = super()._size_of(value)
            _sizes.keep(value, size)
        return size

    def canonical(self, value: Value) -> Value:
        """Return the object that had the same digest before, or this one; of a sequence, with such items."""
        found: Any = value
        if isinstance(found, (tuple, list)):
            items = [self.canonical(each) for each in found]
            found = found._make(items) if hasattr(found, "_make") else type(found)(items)
        elif isinstance(found, np.ndarray) or hasattr(found, "__dataclass_fields__"):
            if isinstance(found, np.ndarray):
                found.flags.writeable = False
            found = self._objects.setdefault(digest_of(found), found)
        result: Value = found
        return result


class Runner:
    """Runs functions of modules: each once for inputs of equal digests, as long as its result is kept.

    An equal result of other inputs is the same object as before, so that nothing runs that depends on it. A
    function that has a parameter `run` is given the runner, for runs of its own. `checkpoint` is called
    before each run; it may raise to cancel, which leaves the results valid.
    """

    def __init__(self, results: Results | None = None, checkpoint: Callable[[], None] = lambda: None) -> None:
        self.results = Results() if results is None else results
        self.checkpoint = checkpoint
        self.count = 0  # of runs, whose results were not stored
        self.progress: Callable[[float], None] = lambda _: None  # of the share done of what runs, 0 … 1

    def __call__(
        self, function: Callable[..., Value], *inputs: Any, hashed: bool = True, stored: bool = False
    ) -> Value:
        """Return the result of a function for some inputs; if `stored`, it may be kept on disk.

        Unless `hashed`, its digest is that of the run: nothing is saved where other inputs give the same.
        """
        key = digest_of((function, inputs))
        found: Value = self.results.get(key, _MISSING)
        if found is not _MISSING:
            return found
        self.checkpoint()
        self.count += 1
        compute = partial(function, *inputs, **({"run": self} if _takes_runner(function) else {}))
        result: Value = self.results.on_disk(key, compute) if stored else compute()
        if hashed:
            result = self.results.canonical(result)
        else:
            remember_parts(result, key)
        return self.results.store(key, result)

    def reached(self, share: float) -> None:
        """Report the share done of what runs, with a checkpoint."""
        self.checkpoint()
        self.progress(share)

    def steps(self, items: Sequence[Value]) -> Iterator[Value]:
        """Yield the items that what runs consists of, with a checkpoint and the share done before each."""
        for number, item in enumerate(items):
            self.reached(number / len(items))
            yield item

    def each(
        self, function: Callable[..., Sequence[Value]], items: Sequence[Any], *inputs: Any
    ) -> list[Value]:
        """Return the results of a function for many items; those that are missing are computed in parts.

        `function` is given a list of items before the other inputs, and returns as many results.
        """
        common = digest_of((function, inputs))
        keys = [blake2b(common + digest_of(item), digest_size=len(common)).digest() for item in items]
        found = {key: self.results.get(key, _MISSING) for key in keys}
        known = zip(keys, items, strict=True)
        missing = list({key: item for key, item in known if found[key] is _MISSING}.items())
        for first in self.steps(range(0, len(missing), _AT_ONCE)):
            part = missing[first : first + _AT_ONCE]
            results = function([item for _, item in part], *inputs)
            for (key, _), result in zip(part, results, strict=True):
                found[key] = self.results.store(key, self.results.canonical(result))
        return [found[key] for key in keys]


@cache
def _takes_runner(function: Callable[..., Any]) -> bool:
    return "run" in signature(function).parameters
