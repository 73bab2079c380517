"""Python's search for garbage, kept from stopping the window: of the whole program it takes 0.1 s."""

from __future__ import annotations

import gc

__all__ = ["keep_what_is_there"]


def keep_what_is_there() -> None:
    """Leave all that there is now out of every later search: modules, the window, its panels.

    What is made from now on is searched as ever.
    """
    gc.collect()
    gc.freeze()
