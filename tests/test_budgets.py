"""Numbers of tests by tier and folder, and of lines by package, stay within budgets.toml."""

import tomllib
from collections import Counter

from tests.conftest import COUNTS, ROOT

BUDGETS = tomllib.loads((ROOT / "tests" / "budgets.toml").read_text(encoding="utf-8"))
KERNELS = {".cl", ".clh", ".glsl", ".c", ".h"}


def count_lines() -> Counter[str]:
    """Return the lines of each package, those of ``sketchterrain`` by folder and with ``ui`` together."""
    lines: Counter[str] = Counter()
    for folder in ("sketchterrain", "ui", "kernels", "tests", "benchmarks"):
        for path in (ROOT / folder).rglob("*"):
            if path.suffix in (KERNELS if folder == "kernels" else {".py"}):
                parts = path.relative_to(ROOT).parts
                inner = parts[0] == "sketchterrain"
                count = path.read_bytes().count(b"\n")
                lines["/".join(parts[:2]) if inner and len(parts) > 2 else parts[0]] += count
                lines["sketchterrain + ui"] += count * (inner or parts[0] == "ui")
    return lines


def exceeded(found: Counter[str], budget: dict[str, int]) -> dict[str, str]:
    return {
        name: f"{count}, budget {budget.get(name, 0)}"
        for name, count in found.items()
        if count > budget.get(name, 0)
    }


def test_packages_have_no_more_lines_than_budgeted():
    assert exceeded(count_lines(), BUDGETS["lines"]) == {}


def test_folders_have_no_more_tests_than_budgeted(request):
    counts = request.config.stash[COUNTS]
    for tier, budget in BUDGETS["tests"].items():
        found = Counter({folder: n for (name, folder), n in counts.items() if name == tier})
        assert exceeded(found, budget) == {}, tier


def test_a_budget_that_is_exceeded_or_missing_is_noticed():
    found = Counter(terrain=3, new=1, ui=2)
    assert exceeded(found, {"terrain": 2, "ui": 2}) == {"terrain": "3, budget 2", "new": "1, budget 0"}
