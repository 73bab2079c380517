"""The chart of fidelity against adherence and naturalness."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.benchmarks.outcome import Row

_MARKERS = "osD^v"
_ASKED = "#999999"

# Title, y label, keys of the rows (two: a band), and what is asked for: from and to which fidelity, value.
_PANELS: tuple[tuple[str, str, tuple[str, ...], tuple[tuple[float, float, float], ...]], ...] = (
    ("Areas", "overlap (IoU), mean", ("iou_mean",), ((0.8, 1.0, 0.75), (1.0, 1.02, 0.92))),
    (
        "Peaks",
        "reached / asked height",
        ("peak_least", "peak_most"),
        ((0.8, 1.02, 0.9), (0.8, 1.02, 1.1)),
    ),
    ("Rivers", "centreline off, mean px", ("centreline_px",), ((0.8, 1.0, 1.5), (1.0, 1.02, 0.75))),
    ("Naturalness", "slope along outlines / beside", ("slope",), ((-0.02, 1.02, 1.0),)),
    ("Naturalness", "curvature along outlines / beside", ("curvature",), ((-0.02, 1.02, 1.0),)),
)


def draw_adherence(figure: Any, rows: Sequence[Row], colours: Sequence[str]) -> Any:
    """Draw a panel a measure, a line a preset, and dashes where the project asks for a bound.

    Parameters
    ----------
    figure
        An empty matplotlib figure.
    rows
        Of the benchmark's first table.
    colours
        One a preset.
    """
    panels = figure.subplots(2, 3).ravel()
    presets = list(dict.fromkeys(str(row["preset"]) for row in rows))
    for axes, (title, label, keys, asked) in zip(panels, _PANELS, strict=False):
        for start, end, value in asked:
            axes.plot([start, end], [value, value], "--", color=_ASKED, linewidth=1.2)
        for preset, colour, marker in zip(presets, colours, _MARKERS, strict=False):
            known = [row for row in rows if row["preset"] == preset and row[keys[0]] is not None]
            fidelity = [row["fidelity"] for row in known]
            ends = [[row[key] for row in known] for key in keys]
            if len(ends) == 2:
                axes.fill_between(fidelity, *ends, color=colour, alpha=0.25, linewidth=0)
            for values in ends:
                axes.plot(fidelity, values, f"{marker}-", color=colour, markersize=3.5, linewidth=1.3)
        axes.set(title=title, xlabel="fidelity", ylabel=label, xlim=(-0.03, 1.03))
    panels[0].set_ylim(0, 1)
    panels[2].set_ylim(bottom=0)
    legend = panels[len(_PANELS)]
    legend.axis("off")
    for place, (preset, colour, marker) in enumerate(zip(presets, colours, _MARKERS, strict=False)):
        y = 0.9 - 0.13 * place
        legend.plot([0.05], [y], marker, color=colour, markersize=5, transform=legend.transAxes)
        legend.text(0.12, y, preset, color=colour, va="center", transform=legend.transAxes)
    y = 0.9 - 0.13 * len(presets)
    legend.plot([0.0, 0.1], [y, y], "--", color=_ASKED, linewidth=1.2, transform=legend.transAxes)
    legend.text(0.12, y, "what is asked for; no trace", va="center", transform=legend.transAxes)
    figure.suptitle("What fidelity does", x=0.01, ha="left")
    return figure
