"""The sketch: what a person painted and set, as a document and as files.

`parameters` declares everything that can be set. `document` holds it as a value, checked against that
declaration. `files` reads and writes it as a folder or a ``.sketch`` zip; `toml_text`, `layer_images`
and `archive` know the three formats involved, `contents` which files are a sketch's, `starter` the
first sketch a person gets, `wording` how an error shows what was given. Nothing here knows what
becomes of a sketch.
"""

from __future__ import annotations

from sketchterrain.sketch.document import Sketch
from sketchterrain.sketch.files import load_sketch, new_sketch, save_sketch
from sketchterrain.sketch.parameters import (
    CLIMATE,
    DENSITY,
    GROUND,
    LAYERS,
    MATERIALS,
    SKETCH,
    TABLES,
    Layer,
    Parameter,
    Properties,
    reference_table,
)

__all__ = [
    "CLIMATE",
    "DENSITY",
    "GROUND",
    "LAYERS",
    "MATERIALS",
    "SKETCH",
    "TABLES",
    "Layer",
    "Parameter",
    "Properties",
    "Sketch",
    "load_sketch",
    "new_sketch",
    "reference_table",
    "save_sketch",
]
