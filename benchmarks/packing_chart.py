"""Chart of packing: bytes a vertex against the time that it takes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sketchterrain.benchmarks.outcome import value_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.benchmarks.outcome import Row

# Okabe and Ito's palette, which colour-blind people can tell apart.
_HUES = ("#0072B2", "#D55E00", "#009E73", "#AA5586", "#E69F00", "#56B4E9", "#333333", "#8C6D31")


def draw_packing(rows: Sequence[Row]) -> Any:
    """Draw a panel a layer: the grounds' mean of each way to pack it, filled where it is the one used."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 3.9), layout="constrained")
    layers = list(dict.fromkeys(str(row["layer"]) for row in rows))
    for axes, layer in zip(figure.subplots(1, len(layers), squeeze=False)[0], layers, strict=True):
        ways = list(dict.fromkeys(str(row["way"]) for row in rows if row["layer"] == layer))
        for way, colour in zip(ways, _HUES, strict=False):
            mine = [row for row in rows if (row["layer"], row["way"]) == (layer, way)]
            used = bool(mine[0]["used"])
            dot = {"color": colour, "markersize": 9 if used else 6}
            dot |= {} if used else {"markerfacecolor": "none"}
            spot = (_mean(mine, "pack_ms"), _mean(mine, "bytes_a_vertex"))
            axes.plot(*spot, "o", label=f"{way}: used" if used else way, **dot)
        axes.set(title=layer, xlabel="packing, ms a million vertices", ylim=(0, None), xlim=(0, None))
        axes.legend(fontsize=7.5, frameon=False, loc="lower right")
    figure.axes[0].set_ylabel("bytes a vertex")
    grounds = len({row["ground"] for row in rows})
    means = f" (means of {grounds} grounds)" if grounds > 1 else ""
    figure.suptitle(f"Packing of a world's chunks{means}: down and left is better", x=0.01, ha="left")
    return figure


def _mean(rows: Sequence[Row], key: str) -> float:
    return sum(value_of(row, key) for row in rows) / len(rows)
