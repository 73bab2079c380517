"""Cache of OpenGL resources that renderers of one context share."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import TypeVar

T = TypeVar("T")


class ResourceCache:
    """One resource of each kind of one OpenGL context: material textures, vertex memory.

    A resource may be used until another one of its kind is requested. The creator of the cache closes it;
    others get it by `borrow`.
    """

    def __init__(self) -> None:
        self._entries: dict[str, tuple[Hashable, object, Callable[[], None] | None]] = {}
        self._is_borrowed = False

    def borrow(self) -> ResourceCache:
        """Return a view of the same entries whose `close` has no effect."""
        other = ResourceCache()
        other._entries, other._is_borrowed = self._entries, True
        return other

    def get_or_create(
        self, kind: str, key: Hashable, create: Callable[[], T], *, close: Callable[[T], None] | None = None
    ) -> T:
        """Return the cached resource of a kind; replace one that was created for another key."""
        entry = self._entries.get(kind)
        if entry is not None and entry[0] == key:
            resource: T = entry[1]  # type: ignore[assignment]  # a kind has one type
            return resource
        self._remove(kind)
        created = create()
        self._entries[kind] = key, created, None if close is None else lambda: close(created)
        return created

    def close(self) -> None:
        """Release all resources unless borrowed."""
        if not self._is_borrowed:
            for kind in list(self._entries):
                self._remove(kind)

    def _remove(self, kind: str) -> None:
        _, _, close = self._entries.pop(kind, (None, None, None))
        if close is not None:
            close()
