"""Adherence and realism as text lines."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from sketchterrain.io.console import pluralize

_NAME_WIDTH = 10  # columns


def adherence_lines(entry: dict[str, Any]) -> list[str]:
    """Return a terrain's adherence to its sketch: a line for each layer and river, and notes."""
    lines = [
        f"{entry['sketch']}, seed {entry['seed']}, fidelity {entry['fidelity']:g}: "
        f"{pluralize(entry['lost'], 'shape')} lost"
    ]
    lines += [f"{name:<{_NAME_WIDTH}}{_layer_line(layer)}" for name, layer in entry["layers"].items()]
    if entry["peaks"]["measured"]:
        lines.append(f"{'peaks':<{_NAME_WIDTH}}{_peaks_line(entry['peaks'])}")
    lines += [f"{'':<{_NAME_WIDTH}}{line}" for line in limited_lines(entry["shapes"])]
    for number, river in enumerate(entry["rivers"], start=1):
        lines.append(f"{f'course {number}':<{_NAME_WIDTH}}{_river_line(river)}")
    return [*lines, *(f"note: {line}" for line in entry["notes"])]


def realism_lines(entry: dict[str, Any]) -> list[str]:
    """Return a terrain's realism: distance, kind, and a line for each metric out of real land's range."""
    from sketchterrain.measure.realism import TITLES

    name = f"{entry['sketch']}, seed {entry['seed']}" if "sketch" in entry else entry["file"]
    lines = [
        f"{name}: distance {entry['distance']:.2f} to {entry['kind']}; of "
        f"{pluralize(entry['windows'], 'window')} of {entry['cell']:g} m cells {entry['passes']:.0%} pass"
    ]
    for found in entry["out_of_range"].values():
        value = "not measurable" if found["value"] is None else f"{found['value']:.3g}"
        low, middle, high = found["real"]
        lines.append(f"{found['title']}: {value}; real land {low:.3g} to {high:.3g}, median {middle:.3g}")
    return lines + [f"failed gate: {TITLES[name]} ({count})" for name, count in entry["failed"].items()]


def _layer_line(layer: dict[str, Any]) -> str:
    line = f"{pluralize(layer['shapes'], 'shape')}, {layer['lost']} lost"
    narrow = layer["shapes"] - layer["measured"]
    if layer["measured"]:
        line += (
            f"; overlap (IoU): mean {layer['iou_mean']:.2f}, median {layer['iou_median']:.2f}, "
            f"10th percentile {layer['iou_p10']:.2f}; spill {layer['spill']:.1%}"
        )
    return line + (f"; {narrow} narrower than 6 px, overlap not measured" if narrow else "")


def _peaks_line(peaks: dict[str, Any]) -> str:
    return (
        f"{pluralize(peaks['measured'], 'shape')}, reached over built height: {peaks['least']:.2f} to "
        f"{peaks['most']:.2f}, median {peaks['median']:.2f}"
    )


def limited_lines(shapes: Iterable[Mapping[str, Any]]) -> list[str]:
    """Return a line for each label with shapes too narrow for its height: asked and built."""
    built: dict[tuple[str, int, float], list[float]] = {}
    for shape in shapes:
        if shape["limited"]:
            key = shape["layer"], shape["label"], shape["asked"]
            built.setdefault(key, []).append(shape["built"])
    lines = []
    for (layer, label, asked), heights in built.items():
        least, most = (f"{each:.0f}" for each in (min(heights), max(heights)))
        stands = f"{least} m" if least == most else f"{least} to {most} m"
        many = pluralize(len(heights), "shape")
        lines.append(f"{layer} {label}: {asked:.0f} m asked, {stands} built ({many} too narrow)")
    return lines


def _river_line(river: dict[str, Any]) -> str:
    if river["lost"]:
        return "of a river: lost"
    return (
        f"{river['mean_distance']:.2f} px from the painted course, at most "
        f"{river['greatest_distance']:.2f} px; {river['descending']:.1%} descends, deepest pit "
        f"{river['deepest_pit']:.2f} m"
    )
