"""What tracing rivers and lakes worked out before, so that a stroke elsewhere does not ask for it again."""

from __future__ import annotations

from dataclasses import dataclass, field

from sketchterrain.features.recent import LRUCache


@dataclass(frozen=True)
class HydrologyCache:
    """Values by what they were made from; several threads may share it.

    Attributes
    ----------
    images : LRUCache
        What was made of whole layers.
    parts : LRUCache
        What was made of single rivers and of groups of them.
    """

    images: LRUCache = field(default_factory=lambda: LRUCache(16))
    parts: LRUCache = field(default_factory=lambda: LRUCache(256))
