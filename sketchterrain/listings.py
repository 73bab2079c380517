"""What there is and what was done, told to people in lines and to programs as entries."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.compute import Device
    from sketchterrain.sketch import Sketch

__all__ = [
    "adherence_lines",
    "device_entry",
    "device_lines",
    "generated_lines",
    "preset_entry",
    "preset_lines",
]

_GL_SHARING = {
    "extension": "shares buffers through cl_khr_gl_sharing",
    "mapped": "kernels write into mapped vertex buffers, no copy",
    "copy": "results are copied to vertex buffers",
}


def device_entry(device: Device) -> dict[str, Any]:
    """Return what there is to know about a device; memory in bytes."""
    return {
        "index": device.index,
        "name": device.name,
        "version": device.version,
        "platform": device.platform,
        "driver": device.driver,
        "type": device.type,
        "memory": device.memory_bytes,
        "compute_units": device.compute_units,
        "float64": device.has_double,
        "gl_sharing": device.gl_sharing,
    }


def device_lines(device: Device, *, chosen: bool) -> list[str]:
    """Return the same for a person; `chosen` says whether it is the one that is taken by default."""
    doubles = "float64" if device.has_double else "no float64"
    return [
        f"{device.index}: {device.name}{' (taken by default)' if chosen else ''}",
        f"   {device.platform}, {device.version}, driver {device.driver}",
        f"   {device.type}, {device.compute_units} compute units, "
        f"{device.memory_bytes / (1 << 30):.1f} GiB, {doubles}",
        f"   OpenGL: {_GL_SHARING.get(device.gl_sharing, device.gl_sharing)}",
    ]


def preset_entry(name: str, sketch: Sketch) -> dict[str, Any]:
    """Return what a preset is: its name, title, extent (m), seed and painted layers."""
    return {
        "name": name,
        "title": sketch.name,
        "extent": sketch.extent,
        "seed": sketch.seed,
        "layers": [layer for layer, image in sketch.layers.items() if image.any()],
    }


def preset_lines(entries: list[dict[str, Any]]) -> list[str]:
    """Return a line for each entry of a preset."""
    width = max((len(entry["name"]) for entry in entries), default=0)
    return [
        f"{entry['name']:<{width}}  {entry['title']}: {entry['extent']:g} m, {', '.join(entry['layers'])}"
        for entry in entries
    ]


def generated_lines(report: dict[str, Any], folder: Path) -> list[str]:
    """Return what was made, how long it took, and where it lies."""
    size, heights, counts = report["size"], report["heights"], report["counts"]
    device, seconds = report["device"], report["timings"]["total"]
    lines = [
        f"{report['sketch']}, seed {report['seed']}: {size['columns']} × {size['rows']} vertices "
        f"{report['spacing']['x']:.3g} m apart, {heights['minimum']:.1f} to {heights['maximum']:.1f} m high, "
        f"{_counted(sum(counts['features'].values()), 'feature')}, {_counted(counts['rivers'], 'river')}, "
        f"{_counted(sum(counts['plants'].values()), 'plant')}",
        f"in {seconds:.1f} s on {device['name']} ({device['platform']})",
        f"files: {folder}: {' '.join(report['files'])}",
    ]
    if "preview.png" in report["files"]:
        lines.append(f"preview: {folder / 'preview.png'}")
    return lines


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def adherence_lines(told: dict[str, Any]) -> list[str]:
    """Return how far a terrain does what its sketch says, a line a layer and a river."""
    lines = [
        f"{told['sketch']}, seed {told['seed']}, fidelity {told['fidelity']:g}: {told['lost']} shapes lost"
    ]
    for name, layer in told["layers"].items():
        line = f"{name:<9} {layer['shapes']} shapes, {layer['lost']} lost"
        if layer["measured"]:
            line += (
                f"; overlap (IoU) of {layer['measured']}: mean {layer['iou_mean']:.2f}, median "
                f"{layer['iou_median']:.2f}, 10 % below {layer['iou_p10']:.2f}; spill {layer['spill']:.1%}"
            )
        lines.append(line)
    peaks = told["peaks"]
    if peaks["measured"]:
        lines.append(
            f"peaks     {peaks['measured']}: reached over asked {peaks['least']:.2f} to {peaks['most']:.2f}, "
            f"mean {peaks['mean']:.2f}; {peaks['capped']} too small for their height, capped at 70°"
        )
    lines += [
        f"river {river['label']}   centreline {river['mean_distance']:.2f} px from what was painted, at most "
        f"{river['greatest_distance']:.2f} px; {river['descending']:.1%} descends, deepest pit "
        f"{river['deepest_pit']:.2f} m"
        for river in told["rivers"]
        if not river["lost"]
    ]
    return lines
