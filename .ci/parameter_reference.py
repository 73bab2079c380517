"""Markdown tables of all settings and edits, generated from their declarations.

Running this file writes them into docs/parameters.md and docs/kernels/materials.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from sketchterrain.document.drapes import CLASS, DRAPE, MAX_CLASSES, MAX_DRAPES
from sketchterrain.document.edits import ACTIONS
from sketchterrain.document.material_rules import (
    DEFAULT_RULES,
    FACTOR,
    MAX_FACTORS,
    MAX_INPUTS,
    RULE,
    Factor,
    MaterialRule,
)
from sketchterrain.document.own_materials import MAX_MATERIALS, OWN
from sketchterrain.document.rasters import MAX_EMBEDDED_BYTES, MAX_RASTERS, RASTER
from sketchterrain.document.sketch import TABLES
from sketchterrain.schema.layers import LAYERS
from sketchterrain.schema.materials import MATERIALS
from sketchterrain.schema.parameters import FORMAT, LOOK, SKETCH, Parameter, Value, format_number
from sketchterrain.schema.styles import STYLE

DOCS = Path(__file__).parents[1] / "docs"


def reference_table() -> str:
    """Return every parameter as Markdown: one section per table of the sketch file."""
    sections = [_section("The sketch", f"`format = {FORMAT}` comes first.", SKETCH)]
    about = {
        "density": "Features where nothing is painted; mountains and hills join to ranges.",
        "ground": "The drained ground between mountains and hills.",
        "geology": "The rock; it changes materials, but no heights.",
        "climate": "Snow and vegetation.",
        "coast": "The sea's level and its shores ([sea](kernels/sea.md)).",
        "weather": "Lighting and air of pictures ([light.md](light.md)); it does not change the terrain.",
        "frame": "The place on Earth of exports and worlds; it does not change the terrain.",
        "base": (
            "Real elevation beneath the sketch: every `[[raster]]` whose role is `elevation` "
            "([elevation.md](elevation.md)). Without one it has no effect."
        ),
    }
    sections += [_section(f"`[{name}]`", about[name], table) for name, table in TABLES.items()]
    for layer in LAYERS.values():
        text = f"{layer.title} (`{layer.file}`): {layer.help}. One table a label, 1 to 255."
        sections.append(_section(f"`[{layer.name}.1]`", text, layer.parameters))
    return "\n".join([*sections, _rasters(), _drapes(), _own(), _look(), _rules(), _edits()])


def rule_table(rules: Iterable[MaterialRule] = DEFAULT_RULES) -> str:
    """Return material rules as a Markdown table, from the lowest to the topmost."""
    rows = [
        f"| {number} | `{rule.name}` | {rule.material} | {format_number(rule.cover)} | "
        f"{'<br>'.join(map(_factor_text, rule.factors))} |"
        for number, rule in enumerate(rules, 1)
    ]
    return "\n".join(["| | rule | material | most | factors |", "|---|---|---|---|---|", *rows])


def _factor_text(factor: Factor) -> str:
    """Return a factor as in: `aridity` + 0.12 `mottle`: 0.3 to 0.633."""
    total = ""
    for name, weight in factor.weights.items():
        sign = "−" if weight < 0 else "+"
        amount = "" if abs(weight) == 1 else f"{abs(weight):g} "
        total += f" {sign} {amount}`{name}`" if total else f"{'−' if weight < 0 else ''}{amount}`{name}`"
    straight = ", straight" if factor.shape == "straight" else ""
    return f"{total}: {factor.start:.3g} to {factor.full:.3g}{straight}"


def _section(title: str, text: str, table: Mapping[str, Parameter]) -> str:
    rows = [
        f"| `{p.name}` | {_toml_like(p.default)} | {p.range} | {p.unit} | {p.help} |" for p in table.values()
    ]
    head = ["| key | default | range | unit | meaning |", "|---|---|---|---|---|"]
    return "\n".join([f"### {title}", "", text, "", *head, *rows, ""])


def _rasters() -> str:
    text = (
        f"A georeferenced file, at most {MAX_RASTERS}. It is not copied unless it is embedded, in all at "
        f"most {MAX_EMBEDDED_BYTES >> 20} MiB. One that is missing or has changed is reported and kept "
        "([saving.md](saving.md)). Rasters of the role `elevation` are the ground beneath the paint "
        "([elevation.md](elevation.md)); the keys from `accuracy` on are theirs."
    )
    return _section("`[[raster]]`", text, RASTER)


def _drapes() -> str:
    text = (
        f"A vector or raster file that is shown on the terrain, at most {MAX_DRAPES}, from the lowest to the "
        "highest. It does not change the terrain ([drapes.md](drapes.md)). Paths and hashes are as of "
        "`[[raster]]`."
    )
    about_classes = (
        f"A style for features with a value of the property `by`, at most {MAX_CLASSES}: `value` and any "
        "keys of the style; the others are the layer's."
    )
    sections = (
        _section("`[[drape]]`", text, {**DRAPE, **STYLE}),
        _section("`[[drape.class]]`", about_classes, {"value": CLASS["value"]}),
    )
    return "\n".join(sections)


def _own() -> str:
    text = (
        f"A material of the sketch's own, at most {MAX_MATERIALS - len(MATERIALS)}: a pattern of the program "
        "with other values, or a folder of pictures ([textures.md](textures.md))."
    )
    return _section("`[materials.NAME]`", text, OWN)


def _look() -> str:
    text = (
        f"Appearance of a material, one table each: {', '.join(MATERIALS)}. It does not change the terrain "
        "([textures.md](textures.md))."
    )
    return _section("`[look.grass]`", text, LOOK)


def _rules() -> str:
    about_rules = (
        "A rule lays its material over those of the rules before it; below them is grass. A name of the "
        "table changes only the given values of that rule; a new name adds a rule on top."
        f"\n\n{rule_table()}\n\n"
        "A factor is 0 at the first number and 1 at the second. Details: "
        "[kernels/materials.md](kernels/materials.md). The preset `desert_mountains` has rules of its own."
    )
    about_factors = (
        f"A ramp over a weighted sum of 1 to {MAX_INPUTS} inputs. A rule covers `cover` times all its "
        f"factors, at most {MAX_FACTORS}; given ones replace those of the table's rule, and "
        "`factor = []` removes them."
    )
    sections = (
        _section("`[[material_rule]]`", about_rules, RULE),
        _section("`[[material_rule.factor]]`", about_factors, FACTOR),
    )
    return "\n".join(sections)


def _edits() -> str:
    text = (
        "Changes of generated features, a table each, applied in this order. `feature` is an id as in "
        "`features.json`."
    )
    head = ["| action | effect | required | optional |", "|---|---|---|---|"]
    rows = []
    for name, action in ACTIONS.items():
        required = [*([] if name == "add" else ["feature"]), *action.required]
        rows.append(f"| {name} | {action.help} | {', '.join(required)} | {', '.join(action.optional)} |")
    return "\n".join(["### `[[edit]]`", "", text, "", *head, *rows, ""])


def _toml_like(value: Value) -> str:
    return f'"{value}"' if isinstance(value, str) else format_number(value)


def _write() -> None:
    page = DOCS / "parameters.md"
    text = page.read_text(encoding="utf-8")
    page.write_text(text[: text.index("### The sketch")] + reference_table(), encoding="utf-8")
    page = DOCS / "kernels/materials.md"
    before, rest = page.read_text(encoding="utf-8").split("| | rule |", 1)
    after = rest.split("\n\n", 1)[1]
    page.write_text(f"{before}{rule_table()}\n\n{after}", encoding="utf-8")


if __name__ == "__main__":
    _write()
