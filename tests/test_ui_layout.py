"""Imports inside the desktop program: models and engine never import views."""

import ast
from pathlib import Path

UI = Path(__file__).parents[1] / "ui"
VIEWS = {"canvas", "panels", "view3d", "dialogs", "look", "window", "app", "actions"}
INNER = {"models", "commands", "engine"}


def modules() -> list[Path]:
    return sorted(UI.rglob("*.py"))


def violations(path: Path, tree: ast.AST) -> list[str]:
    """Imports that a file of the desktop program may not have."""
    place = path.relative_to(UI).parts[0].removesuffix(".py")
    bad = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        bad += [name for name in names if place in INNER and _forbidden(path, place, name)]
    return bad


def _forbidden(path: Path, place: str, name: str) -> bool:
    parts = name.split(".")
    if parts[:2] == ["sketchterrain", "ui"] and len(parts) > 2:
        return parts[2] in VIEWS
    if parts[0] != "PyQt6":
        return False
    if place == "models":
        return parts[1] != "QtCore"
    # The link hands over pictures as Qt knows them.
    return not (place == "engine" and path.name == "link.py" and parts[1] in ("QtCore", "QtGui"))


def test_models_import_no_views() -> None:
    for path in modules():
        assert violations(path, ast.parse(path.read_text(encoding="utf-8"))) == [], path.relative_to(UI)


def test_a_planted_violation_is_found() -> None:
    for path, planted in (
        ("models/document.py", "from PyQt6.QtWidgets import QWidget"),
        ("models/document.py", "from sketchterrain.ui.canvas.canvas import Canvas"),
        ("commands.py", "from PyQt6 import QtCore"),
        ("engine/engine.py", "import PyQt6.QtGui"),
        ("models/painting.py", "from sketchterrain.ui import window"),
    ):
        assert violations(UI / path, ast.parse(planted)) != [], (path, planted)
