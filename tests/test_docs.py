"""Links and generated tables of the documentation."""

import re
import runpy
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = ("README.md", "ARCHITECTURE.md", "CONTRIBUTING.md")
DOCS = [*(ROOT / name for name in PAGES), *(ROOT / "docs").rglob("*.md")]


def test_tables_of_parameters_and_rules_are_generated() -> None:
    """``python .ci/parameter_reference.py`` writes them."""
    reference = runpy.run_path(str(ROOT / ".ci/parameter_reference.py"))
    text = (ROOT / "docs/parameters.md").read_text(encoding="utf-8")
    assert reference["reference_table"]().strip() in text
    assert reference["rule_table"]() in (ROOT / "docs/kernels/materials.md").read_text(encoding="utf-8")


def test_links_and_pictures_exist() -> None:
    for page in DOCS:
        for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
            if "://" not in target:
                assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_readme_names_every_command() -> None:
    from typer.main import get_command

    from sketchterrain.app.cli import app

    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for name in get_command(app).commands:  # type: ignore[attr-defined]
        assert f"`{name}" in readme, name
