"""The sketch document: declared settings, label layers, edits, undo history, and its files.

Nothing here depends on how terrain is computed from a sketch.
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
