"""The sketch: what a person painted and set, as a document and as files.

`parameters` declares everything that can be set (each a `parameter`), `material_rule` a rule by which a
material covers the ground (their table is in `material_rules`), `edits` what can be changed of what was
generated, and `reference` makes a page of all that. `document` holds it as a value, checked against these
declarations. `files` reads and writes it as a folder or a ``.sketch`` zip; `toml_text`, `layer_images` and
`archive` know the three formats involved, `safe_zip` any zip of a stranger's, `folder_save` replaces a
folder's files as a whole, `contents` knows which files are a sketch's, `starter` the first sketch a person
gets, `wording` how an error shows what was given, `toml_reading` any TOML, `label_colours` which colour
stands for a label. `history` holds the steps of undo, each as a `layer_change` of tiles.
Nothing here knows what becomes of a sketch.
"""

from __future__ import annotations

from sketchterrain.sketch.document import Sketch
from sketchterrain.sketch.edits import ACTIONS, ADDED_BIT, Edit
from sketchterrain.sketch.files import load_sketch, new_sketch, pack_sketch, save_sketch
from sketchterrain.sketch.material_rule import (
    FACTOR,
    INPUTS,
    MAX_INPUTS,
    RULE,
    Factor,
    MaterialRule,
    RuleChange,
)
from sketchterrain.sketch.material_rules import DEFAULT_RULES, resolved_rules
from sketchterrain.sketch.parameter import Parameter, Properties
from sketchterrain.sketch.parameters import (
    CLIMATE,
    DENSITY,
    GROUND,
    LAYERS,
    LOOK,
    MATERIALS,
    SKETCH,
    TABLES,
    WEATHER,
    Layer,
)
from sketchterrain.sketch.reference import reference_table, rule_table

__all__ = [
    "ACTIONS",
    "ADDED_BIT",
    "CLIMATE",
    "DEFAULT_RULES",
    "DENSITY",
    "FACTOR",
    "GROUND",
    "INPUTS",
    "LAYERS",
    "LOOK",
    "MATERIALS",
    "MAX_INPUTS",
    "RULE",
    "SKETCH",
    "TABLES",
    "WEATHER",
    "Edit",
    "Factor",
    "Layer",
    "MaterialRule",
    "Parameter",
    "Properties",
    "RuleChange",
    "Sketch",
    "load_sketch",
    "new_sketch",
    "pack_sketch",
    "reference_table",
    "resolved_rules",
    "rule_table",
    "save_sketch",
]
