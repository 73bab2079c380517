"""Imports between packages, and inside the desktop program: models and engine never import views."""

import ast
import os
import re
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import sketchterrain

ROOT = Path(__file__).parents[1]
IMPORT = re.compile(r"^[ \t]*((?:from|import)[ \t][^(\n]*(?:\([^)]*\))?)", re.MULTILINE)

COMMON = {"errors", "array_types", "caching", "io", "host", "stages", "geometry"}
BASE = COMMON | {"schema", "features", "document"}
LAND = BASE | {"elevation", "landforms", "roads", "landuse", "compute", "drape", "terrain", "vegetation"}
CORE = LAND | {"generation", "measure"}
SHOWN = CORE | {"tiles", "look", "render", "export", "importing"}
# Each room and the rooms above it that it may import; a room may always import itself.
MAY_IMPORT = {
    "errors": set(),
    "array_types": set(),
    "caching": set(),
    "io": {"errors"},
    "host": {"errors", "array_types", "io"},
    "stages": {"caching"},
    "geometry": {"errors", "array_types"},
    "schema": COMMON,
    "features": COMMON | {"schema"},
    "document": BASE,
    "elevation": BASE,
    "landforms": BASE | {"elevation"},
    "roads": BASE | {"landforms"},
    "landuse": BASE | {"landforms"},
    "compute": {"errors", "array_types", "io"},
    "drape": BASE | {"elevation"},
    "terrain": LAND - {"vegetation"},
    "vegetation": LAND,
    "generation": LAND,
    "measure": LAND | {"generation"},
    "tiles": {"errors", "array_types", "host"},
    "look": CORE,
    "render": CORE | {"tiles", "look"},
    "export": CORE | {"tiles", "look"},
    "importing": BASE | {"elevation"},
    "jobs": SHOWN,
    "batch": SHOWN | {"jobs"},
    "world": SHOWN | {"jobs"},
    "ui": SHOWN | {"jobs", "world"},
    "benchmarks": SHOWN | {"jobs", "batch", "world", "ui"},
    "app": SHOWN | {"jobs", "batch", "world", "ui", "benchmarks"},
    "__main__": {"app"},
    "__init__": CORE,
}
ONLY_IN = {"pyopencl": {"compute"}, "moderngl": {"render"}, "PyQt6": {"ui", "benchmarks"}}
UI_VIEWS = {"canvas", "panels", "view3d", "dialogs", "look", "window", "app", "actions"}
UI_CORE = {"models", "commands", "engine"}


def room_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return parts[0] if parts[0] != "sketchterrain" else parts[1]


def modules() -> list[Path]:
    rooms = ("sketchterrain", "benchmarks", "ui")
    return sorted(path for room in rooms for path in (ROOT / room).rglob("*.py"))


def imports(text: str) -> set[str]:
    """Modules that a text imports, in functions and type-checking blocks too; relative ones with a dot."""
    found: set[str] = set()
    for statement in IMPORT.findall(text):
        with suppress(SyntaxError):  # prose that begins as an import does
            (node,) = ast.parse(statement).body
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                module = "." * node.level + (node.module or "")
                found |= {module} | {f"{module}.{alias.name}" for alias in node.names}
    return found


def violations(room: str, names: set[str]) -> list[str]:
    bad = []
    for name in names:
        parts = name.split(".")
        if parts[0] == "sketchterrain" and len(parts) > 1:
            if parts[1] not in MAY_IMPORT[room] | {room} and parts[1] in MAY_IMPORT:
                bad.append(name)
        elif parts[0] in ONLY_IN and room not in ONLY_IN[parts[0]]:
            bad.append(name)
    return bad


def ui_violations(path: Path, names: set[str]) -> list[str]:
    """Return imports of views or Qt that a module of the desktop program may not have."""
    place = path.relative_to(ROOT / "ui").parts[0].removesuffix(".py")
    if place not in UI_CORE:
        return []
    # The link passes pictures as Qt's images.
    allowed = {"models": {"QtCore"}, "engine": {"QtCore", "QtGui"} if path.name == "link.py" else set()}
    bad = []
    for name in names:
        parts = name.split(".")
        if (parts[:2] == ["sketchterrain", "ui"] and len(parts) > 2 and parts[2] in UI_VIEWS) or (
            parts[0] == "PyQt6" and len(parts) > 1 and parts[1] not in allowed.get(place, set())
        ):
            bad.append(name)
    return bad


def test_modules_import_only_the_packages_they_may() -> None:
    for number, (room, others) in enumerate(MAY_IMPORT.items()):
        assert others - {room} <= set(list(MAY_IMPORT)[:number]), f"{room} imports rooms below it"
    for path in modules():
        room, names = room_of(path), imports(path.read_text(encoding="utf-8"))
        assert room in MAY_IMPORT, f"{path} is in no known room"
        assert violations(room, names) == [], path
        assert room != "ui" or ui_violations(path, names) == [], path
        if path.parent.name == "blender_extension":
            continue  # Blender names its package
        assert not any(name.startswith(".") for name in names), f"{path}: relative import"


def test_planted_violations_are_found() -> None:
    for room, planted in (
        ("landforms", "from sketchterrain.generation.building import build"),
        ("tiles", "import sketchterrain.compute.device"),
        ("elevation", "from sketchterrain.landforms.placement import shapes"),
        ("terrain", "import pyopencl as cl"),
        ("document", "def f():\n    from sketchterrain.app import (\n        cli,\n    )"),
    ):
        assert violations(room, imports(planted)) != [], room
    for file, planted in (
        ("models/document.py", "from PyQt6.QtWidgets import QWidget"),
        ("models/document.py", "from sketchterrain.ui.canvas.canvas import Canvas"),
        ("commands.py", "from PyQt6 import QtCore"),
        ("engine/engine.py", "import PyQt6.QtGui"),
        ("models/painting.py", "from sketchterrain.ui import window"),
    ):
        assert ui_violations(ROOT / "ui" / file, imports(planted)) != [], (file, planted)


def imports_by_kind(name: str, text: str) -> list[tuple[str, str, int]]:
    """Return the names that a module imports, how (``top``, ``lazy``, ``type``) and at which line."""
    found: list[tuple[str, str, int]] = []

    def visit(node: ast.AST, kind: str) -> None:
        if isinstance(node, ast.ImportFrom):
            source = name.split(".")[: -node.level] if node.level else []
            source += [node.module] if node.module else []
            found.extend((".".join([*source, alias.name]), kind, node.lineno) for alias in node.names)
        elif isinstance(node, ast.Import):
            found.extend((alias.name, kind, node.lineno) for alias in node.names)
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            kind = "type"
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            kind = "lazy"
        for part in ("body", "orelse", "handlers", "finalbody", "cases"):  # statements, no expressions
            for child in getattr(node, part, ()):
                visit(child, kind)

    visit(ast.parse(text), "top")
    return found


def circular_imports(texts: dict[str, str]) -> list[str]:
    """Return imports among modules that close a circle: all at the top level, others without a comment."""
    numbers = {name: number for number, name in enumerate(texts)}
    edges = []
    for name, text in texts.items():
        for imported, kind, line in imports_by_kind(name, text):
            target = imported if imported in numbers else imported.rpartition(".")[0]
            if target in numbers and target != name:
                edges.append((name, target, kind, line))
    bad = []
    for kinds in ({"top"}, {"top", "lazy", "type"}):
        chosen = [edge for edge in edges if edge[2] in kinds]
        ends = np.array([[numbers[name], numbers[target]] for name, target, *_ in chosen]).reshape(-1, 2).T
        graph = coo_array((np.ones(len(chosen)), tuple(ends)), shape=(len(texts), len(texts)))
        _, circle = connected_components(graph, connection="strong")
        for name, target, kind, line in chosen:
            if circle[numbers[name]] != circle[numbers[target]]:
                continue
            above, own = ["", *texts[name].splitlines()][line - 1 : line + 1]
            is_explained = above.lstrip().startswith("# ") or re.search(r"# (?!noqa|type:)", own)
            if kinds == {"top"} or (kind != "top" and not is_explained):
                bad.append(f"{name}:{line} {kind} {target}")
    return bad


def test_circular_imports_are_lazy_or_for_types_and_a_comment_says_why() -> None:
    texts = {}
    for path in modules():
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        texts[name if name.startswith("sketchterrain") else f"sketchterrain.{name}"] = path.read_text("utf-8")
    assert circular_imports(texts) == []
    types = "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    "
    for planted in (
        {"a": "from b import f", "b": "from c import g", "c": "import a"},
        {"a": "from b import f", "b": "def f():\n    from a import g"},
        {"a": "from b import f", "b": f"{types}from a import G  # noqa: TC001"},
    ):
        assert circular_imports(planted) != [], planted
    for why in ("from a import G  # why", "# why\n    from a import G"):
        assert circular_imports({"a": "from b import f", "b": types + why}) == []


def test_one_place_decides_about_caches_and_no_assertion_has_an_effect() -> None:
    assert [path for path in modules() if "XDG_CACHE_HOME" in path.read_text("utf-8")] == [
        ROOT / "sketchterrain/__init__.py",
        ROOT / "sketchterrain/io/files.py",
    ]
    for path in modules():  # without assertions (python -O) the program must do the same
        for line in re.findall(r"^ +assert (.*)", path.read_text("utf-8"), re.MULTILINE):
            assert not re.search(r"(?<!isinstance)\(|:=", line.partition("#")[0]), (path, line)


def test_caches_that_cannot_be_written_are_temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr("atexit.register", lambda _, folder, **__: made.append(Path(folder)))
    made: list[Path] = []
    for home, cache in (
        *(
            (tmp_path, place)
            for place in ("/proc", "/proc/cache", f"{tmp_path}/file", f"{tmp_path}/file/new")
        ),
        *((place, "") for place in ("/proc", "/proc/home", f"{tmp_path}/file")),
    ):
        monkeypatch.setenv("HOME", str(home))
        monkeypatch.setenv("XDG_CACHE_HOME", cache)
        sketchterrain._ensure_writable_cache()
        assert os.environ["XDG_CACHE_HOME"] == str(made[-1])
        made.pop().rmdir()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "new"))
    sketchterrain._ensure_writable_cache()
    assert os.environ["XDG_CACHE_HOME"] == str(tmp_path / "new")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    sketchterrain._ensure_writable_cache()
    assert os.environ["XDG_CACHE_HOME"] == f"{tmp_path}/.cache"
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=1 << 20))
    sketchterrain._ensure_writable_cache()
    assert os.environ["XDG_CACHE_HOME"] == str(made[-1])
    made.pop().rmdir()


def test_importing_loads_no_driver() -> None:
    drivers = {"pyopencl", "moderngl", "PyQt6", "scipy"}
    code = "import sys, sketchterrain, sketchterrain.app.cli, sketchterrain.errors; "
    code += f"print(*sorted({drivers} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
