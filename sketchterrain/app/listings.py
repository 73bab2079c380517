"""Results of commands as text lines and as JSON entries."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sketchterrain.io.console import pluralize

if TYPE_CHECKING:
    from sketchterrain.compute.device import Device
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.export.target import Target
    from sketchterrain.generation.self_test import Verdict
    from sketchterrain.render.overlays import LegendEntry
    from sketchterrain.render.sharing_probe import Sharing


_NAME_WIDTH = 10  # columns
_MAX_FILES = 6  # names of an export's files in its text
_GL_SHARING = {
    "extension": "shares buffers through cl_khr_gl_sharing",
    "mapped": "kernels write into mapped vertex buffers, no copy",
    "copy": "results are copied to vertex buffers",
    "none": "no rendering",
}


def print_lines(*lines: str) -> None:
    """Write lines to stdout, unless its reader has gone."""
    with suppress(BrokenPipeError):
        sys.stdout.writelines(f"{line}\n" for line in lines)


def print_json(value: object) -> None:
    """Write a value to stdout as JSON, as `write_json` does to a file."""
    print_lines(json.dumps(value, indent=2, ensure_ascii=False).encode(errors="backslashreplace").decode())


def print_result(entry: object, lines: Iterable[str], *, as_json: bool) -> None:
    """Write an entry as JSON, or else the lines that tell the same."""
    if as_json:
        print_json(entry)
    else:
        print_lines(*lines)


def device_test_entry(device: Device, verdict: Verdict, sharing: Sharing) -> dict[str, Any]:
    """Return the facts about a device, its self-test, and how vertices are shared with OpenGL."""
    from sketchterrain.compute.device import device_entry

    return device_entry(device) | {
        "self_test": {"bits": verdict.bits, "detail": verdict.detail},
        "gl_sharing": sharing.kind,
        "gl_sharing_note": sharing.reason,
    }


def device_lines(device: Device, verdict: Verdict, sharing: Sharing, *, default: bool) -> list[str]:
    """Return the same as text."""
    note = f" ({sharing.reason})" if sharing.reason else ""
    doubles = "float64" if device.has_double else "no float64"
    return [
        f"{device.index}: {device.name}{' (default)' if default else ''}",
        f"   {device.platform}, {device.version}, driver {device.driver}",
        f"   {device.type}, {device.compute_units} compute units, "
        f"{device.memory_bytes / (1 << 30):.1f} GiB, {doubles}",
        f"   self-test: {verdict.line}",
        f"   OpenGL: {_GL_SHARING[sharing.kind]}{note}",
    ]


def preset_entry(name: str, sketch: Sketch) -> dict[str, Any]:
    """Return a preset's name, title, extent (m), seed, painted layers and material rules."""
    return {
        "name": name,
        "title": sketch.name,
        "extent": sketch.extent,
        "seed": sketch.seed,
        "layers": [
            layer
            for layer, image in sketch.layers.items()
            if image.any() or len(sketch.vectors.get(layer, ()))
        ],
        "material_rules": [change.name for change in sketch.material_rules],
    }


def preset_lines(entries: list[dict[str, Any]]) -> list[str]:
    """Return a line for each preset."""
    width = max((len(entry["name"]) for entry in entries), default=0)
    return [
        f"{entry['name']:<{width}}  {entry['title']}: {entry['extent']:g} m, {', '.join(entry['layers'])}"
        + (f"; own material rules: {', '.join(rules)}" if (rules := entry["material_rules"]) else "")
        for entry in entries
    ]


def generated_lines(report: dict[str, Any], folder: Path) -> list[str]:
    """Return the text of a generated terrain's report."""
    size, counts, device = report["size"], report["counts"], report["device"]
    heights = report["heights"]
    lines = [
        f"{report['sketch']}, seed {report['seed']}: {size['columns']} × {size['rows']} vertices "
        f"{report['spacing']['x']:.3g} m apart, {heights['minimum']:.1f} to {heights['maximum']:.1f} m high, "
        f"{pluralize(sum(counts['features'].values()), 'feature')}, "
        + ", ".join(pluralize(counts[name], name.removesuffix("s")) for name in ("rivers", "lakes"))
        + (f", the sea at {report['sea_level']:g} m" if "sea_level" in report else "")
        + (f", {pluralize(sum(counts['plants'].values()), 'plant')}" if counts["plants"] else ""),
        f"in {report['timings']['total']:.1f} s on {device['name']} ({device['platform']})"
        f"{', with --fast: other bits than without' if report['fast'] else ''}",
        f"files: {folder}: {' '.join(report['files'])}",
    ]
    if "preview.png" in report["files"]:
        lines.append(f"preview: {folder / 'preview.png'}")
    lines += [f"restarted: {line}" for line in report["restarts"]]
    lines += [f"elevation: {line}" for line in report.get("base", {}).get("findings", ())]
    lines += [f"roads: {line}" for line in report.get("roads", {}).get("findings", ())]
    lines += [f"resolved: {line}" for line in report["resolutions"]]
    return [*lines, *(f"note: {line}" for line in report["notes"])]


def exported_lines(report: dict[str, Any], folder: Path, seconds: float) -> list[str]:
    """Return the text of an export's sidecar, with the settings to enter where it is imported."""
    from sketchterrain.export.target import setting_rows

    grid, heights, tiles = report["grid"], report["heights"], report["tiles"]
    layout = f" in {len(tiles)} tiles" if len(tiles) > 1 else ""
    names = [entry["file"] for entry in report["files"]]
    more = len(names) - _MAX_FILES
    names = [*names[:_MAX_FILES], f"and {more} more"] if more > 1 else names
    lines = [
        f"{report['sketch']}, seed {report['seed']}, for {report['target']}: {grid['columns']} × "
        f"{grid['rows']} vertices{layout} {grid['spacing']['x']:.6g} m apart, {heights['minimum']:.1f} to "
        f"{heights['maximum']:.1f} m high, in {seconds:.1f} s",
        f"files: {folder}: {' '.join(names)}",
    ]
    lines += [f"restarted: {line}" for line in report.get("restarts", [])]
    rows = setting_rows(report["import"])
    if rows:
        lines.append("import settings:")
        width = max(2 * row.depth + len(row.name) for row in rows)
        for row in rows:
            name = "  " * row.depth + row.name
            lines.append(f"  {name:<{width}}  {row.value}".rstrip())
    return lines


def target_entry(target: Target) -> dict[str, Any]:
    """Return an export target's sizes, formats and options."""
    from sketchterrain.export.planning import option_names

    return {
        "name": target.name,
        "title": target.title,
        "line": target.summary,
        "tile_sizes": list(target.sizes) or None,
        "size": target.size if target.spacing is None else None,
        "spacing": target.spacing,
        "square": target.square,
        "formats": list(target.formats),
        "options": list(option_names(target)),
    }


def target_lines(entry: dict[str, Any]) -> list[str]:
    """Return an export target's entry as text."""
    if entry["spacing"] is not None:
        sizes = f"vertices {entry['spacing']:g} m apart"
    elif entry["tile_sizes"] is not None:
        sizes = f"sides of {', '.join(str(side) for side in entry['tile_sizes'])} vertices"
    else:
        sizes = f"any size, by default {entry['size']} vertices"
    formats = f"; formats {', '.join(entry['formats'])}" if entry["formats"] else ""
    options = " ".join(f"--{name.replace('_', '-')}" for name in entry["options"])
    lines = [f"{entry['name']:<{_NAME_WIDTH}}{entry['title']}: {entry['line']}"]
    return lines + [f"{'':<{_NAME_WIDTH}}{line}" for line in (f"{sizes}{formats}", options)]


def flight_lines(report: dict[str, Any]) -> list[str]:
    """Return a flight's report as text."""
    size, frame, device = report["size"], report["frame"], report["device"]
    generation, triangles = report["generation"], report["triangles"]
    lines = [
        f"{report['sketch']}, seed {report['seed']}: {pluralize(report['frames'], 'frame')} of "
        f"{size['width']} × {size['height']} pixels, {report['seconds']:.3g} s at {report['fps']} a second",
        f"drawn: {report['frames_per_second']:.1f} frames a second, {1e3 * frame['mean']:.1f} ms a frame, "
        f"{1e3 * frame['worst']:.1f} ms at most; {report['settled']} of {report['frames']} complete",
        f"generation: {1e3 * generation['initial']:.1f} ms at first, then {1e3 * generation['mean']:.2f} ms "
        f"a frame and {1e3 * generation['worst']:.2f} ms at most in "
        f"{pluralize(generation['updating_frames'], 'frame')} with new tiles",
        f"triangles: {triangles['mean']:,.0f} a frame, {triangles['most']:,} at most",
        f"in {report['timings']['total']:.1f} s on {device['name']} ({device['platform']})",
    ]
    if report["output"] is not None:
        lines.append(f"film: {report['output']}")
    if report["lowest"] < 0.0:
        lines.append(f"note: the path is up to {-report['lowest']:.1f} m below the ground")
    return lines + [f"restarted: {line}" for line in report["restarts"]]


def legend_lines(legend: Iterable[LegendEntry]) -> list[str]:
    """Return a line for each colour of the overlays."""
    return [f"#{bytes(entry.colour).hex()}  {entry.meaning}" for entry in legend]
