"""What tracing rivers and lakes worked out before, so that a stroke elsewhere does not ask for it again."""

from __future__ import annotations

from dataclasses import dataclass, field

from sketchterrain.features.recent import Recent


@dataclass(frozen=True)
class WaterMemory:
    """Values by what they were made from; several threads may share it.

    Attributes
    ----------
    images : Recent
        What was made of whole layers.
    parts : Recent
        What was made of single rivers and of groups of them.
    """

    images: Recent = field(default_factory=lambda: Recent(16))
    parts: Recent = field(default_factory=lambda: Recent(256))
