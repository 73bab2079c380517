"""The sketch: what a person painted and set, as a document and as files.

`parameters` declares everything that can be set (each a `parameter`), `edits` what can be changed of what was
generated, and `reference` makes a page of both. `document` holds it all as a value, checked against these
declarations. `files` reads and writes it as a folder or a ``.sketch`` zip; `toml_text`, `layer_images` and
`archive` know the three formats involved, `contents` which files are a sketch's, `starter` the first sketch a
person gets, `wording` how an error shows what was given. Nothing here knows what becomes of a sketch.
"""

from __future__ import annotations

from sketchterrain.sketch.document import Sketch
from sketchterrain.sketch.edits import ACTIONS, ADDED_BIT, Edit
from sketchterrain.sketch.files import load_sketch, new_sketch, save_sketch
from sketchterrain.sketch.parameter import Parameter, Properties
from sketchterrain.sketch.parameters import (
    CLIMATE,
    DENSITY,
    GROUND,
    LAYERS,
    MATERIALS,
    SKETCH,
    TABLES,
    Layer,
)
from sketchterrain.sketch.reference import reference_table

__all__ = [
    "ACTIONS",
    "ADDED_BIT",
    "CLIMATE",
    "DENSITY",
    "GROUND",
    "LAYERS",
    "MATERIALS",
    "SKETCH",
    "TABLES",
    "Edit",
    "Layer",
    "Parameter",
    "Properties",
    "Sketch",
    "load_sketch",
    "new_sketch",
    "reference_table",
    "save_sketch",
]
