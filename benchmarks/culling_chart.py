"""Chart of what culling costs over the number of features in the world."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sketchterrain.benchmarks.outcome import value_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.benchmarks.outcome import Row

# Okabe and Ito's palette, which colour-blind people can tell apart.
_LINES = (
    ("tile_us", "a tile on new ground", "#D55E00"),
    ("launch_us", "of this on the device", "#0072B2"),
    ("cull_us", "lists of what reaches it, on new ground", "#009E73"),
    ("again_us", "the same on ground that was looked at", "#AA5586"),
)


def draw_culling(figure: Any, rows: Sequence[Row]) -> Any:
    """Draw microseconds a tile over features in the world, at one density."""
    axes = figure.subplots()
    x = [value_of(row, "features") for row in rows]
    for key, name, colour in _LINES:
        axes.plot(x, [value_of(row, key) for row in rows], "o-", color=colour, markersize=4, label=name)
    axes.set(xscale="log", yscale="log", xlabel="features in the world, at one density", ylabel="µs a tile")
    axes.legend(fontsize=7.5, frameon=False)
    figure.suptitle("A tile costs the same in a world of any size", x=0.01, ha="left")
    return figure
