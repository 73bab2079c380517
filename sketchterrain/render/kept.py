"""What pictures of different terrains share, so that the second one finds it made."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import TypeVar

T = TypeVar("T")


class ResourceCache:
    """One thing of each kind, of one OpenGL context: textures of materials, memory of vertices.

    Whoever asks for it may use it until the next one asks. Whoever made this closes it; who is to use it and
    not to close it gets it lent.
    """

    def __init__(self) -> None:
        self._things: dict[str, tuple[Hashable, object, Callable[[], None] | None]] = {}
        self._is_lent = False

    def borrow(self) -> ResourceCache:
        """Return the same things, which stay when what is returned is closed."""
        other = ResourceCache()
        other._things, other._is_lent = self._things, True
        return other

    def of(
        self, kind: str, key: Hashable, make: Callable[[], T], *, close: Callable[[T], None] | None = None
    ) -> T:
        """Return the thing of a kind, made if there is none that was made for the key.

        Parameters
        ----------
        kind
        key
            All that it depends on.
        make
            Makes it.
        close
            Gives it back, when one for another key takes its place.
        """
        known = self._things.get(kind)
        if known is not None and known[0] == key:
            thing: T = known[1]  # type: ignore[assignment]  # of the kind that was asked for before
            return thing
        self._forget(kind)
        made = make()
        self._things[kind] = key, made, None if close is None else lambda: close(made)
        return made

    def close(self) -> None:
        """Give all of it back, if it is not lent."""
        if not self._is_lent:
            for kind in list(self._things):
                self._forget(kind)

    def _forget(self, kind: str) -> None:
        _, _, close = self._things.pop(kind, (None, None, None))
        if close is not None:
            close()
