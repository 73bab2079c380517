"""Imports between rooms."""

import ast
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]

GROUND = {"errors", "lazily", "resources", "whole_files", "sketch", "features", "terrain", "tiles", "compute"}
# Each room and the rooms it may import; a room may always import itself.
MAY_IMPORT = {
    "errors": set(),
    "resources": {"errors"},
    "whole_files": {"errors"},
    "metric_crs": {"errors"},
    "gdal_paths": set(),
    "lazily": set(),
    "disk": {"errors", "whole_files"},
    "estimate": {"errors", "disk", "system"},
    "child_process": {"errors"},
    "system": set(),
    "sketch": {"errors", "resources", "whole_files"},
    "features": {"errors", "lazily", "sketch"},
    "compute": {"errors", "resources", "whole_files", "disk", "child_process"},
    "terrain": {"errors", "lazily", "resources", "child_process", "sketch", "features", "compute"},
    "tiles": {"errors"},
    "look": {"errors", "resources", "whole_files", "disk", "sketch", "features", "terrain", "compute"},
    "render": GROUND | {"look", "child_process"},
    "export": GROUND | {"look", "metric_crs", "gdal_paths", "disk", "system"},
    "trace": {"errors", "resources", "whole_files", "sketch", "metric_crs", "gdal_paths"},
}
ANYTHING = {
    "__init__",
    "__main__",
    "arguments",
    "batch",
    "benchmarks",
    "cli",
    "commands",
    "exit_codes",
    "export_plans",
    "exporting",
    "fly",
    "generate",
    "jobs",
    "listings",
    "picture_arguments",
    "progress",
    "queries",
    "report",
    "sizes",
    "still",
    "termination",
    "ui",
    "world",
}
ONLY_IN = {"pyopencl": {"compute"}, "moderngl": {"render"}, "PyQt6": {"ui", "benchmarks"}}


def room_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return parts[0] if parts[0] != "sketchterrain" else parts[1]


def modules() -> list[Path]:
    rooms = ("sketchterrain", "benchmarks", "ui")
    return sorted(path for room in rooms for path in (ROOT / room).rglob("*.py"))


def imports(tree: ast.AST) -> set[str]:
    """Every module a tree imports, inside functions and type-checking blocks too."""
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def violations(room: str, tree: ast.AST) -> list[str]:
    bad = []
    for name in imports(tree):
        parts = name.split(".")
        if parts[0] == "sketchterrain" and len(parts) > 1 and room in MAY_IMPORT:
            if parts[1] not in MAY_IMPORT[room] | {room} and (parts[1] in MAY_IMPORT or parts[1] in ANYTHING):
                bad.append(name)
        elif parts[0] in ONLY_IN and room not in ONLY_IN[parts[0]]:
            bad.append(name)
    return bad


def test_modules_import_only_the_rooms_they_may() -> None:
    for path in modules():
        room, tree = room_of(path), ast.parse(path.read_text(encoding="utf-8"))
        assert room in MAY_IMPORT or room in ANYTHING, f"{path} is in no known room"
        assert violations(room, tree) == [], path
        for node in ast.walk(tree):  # a relative import would hide from this test
            assert not (isinstance(node, ast.ImportFrom) and node.level), f"{path}: relative import"


def test_planted_violations_are_found() -> None:
    for room, planted in (
        ("features", "from sketchterrain.terrain import build"),
        ("tiles", "import sketchterrain.compute.device"),
        ("terrain", "import pyopencl as cl"),
        ("sketch", "def f():\n    from sketchterrain import cli"),
    ):
        assert violations(room, ast.parse(planted)) != [], room


def test_importing_loads_no_driver() -> None:
    drivers = {"pyopencl", "moderngl", "PyQt6", "scipy"}
    code = "import sys, sketchterrain, sketchterrain.cli, sketchterrain.errors; "
    code += f"print(*sorted({drivers} & set(sys.modules)))"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == ""
