"""Writers for engines and GIS: each file whole or not at all, the same terrain always the same bytes.

Every writer takes the folder to write into and returns the paths of what it wrote.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain.lazily import lazy_attributes

if TYPE_CHECKING:
    from sketchterrain.export.agreement import agreement_picture, write_agreement
    from sketchterrain.export.features import write_features
    from sketchterrain.export.files import move_into, prepare_folder, staging, write_json
    from sketchterrain.export.film import check_film
    from sketchterrain.export.foliage_files import FoliageFiles, WrittenFoliage, check_room, write_foliage
    from sketchterrain.export.geotiff import write_height_tif
    from sketchterrain.export.images import write_height_png, write_materials, write_normals, write_picture
    from sketchterrain.export.map import MAP_WIDTH, write_map, write_sheet
    from sketchterrain.export.weights import quantised_weights

__all__ = [
    "MAP_WIDTH",
    "FoliageFiles",
    "WrittenFoliage",
    "agreement_picture",
    "check_film",
    "check_room",
    "move_into",
    "prepare_folder",
    "quantised_weights",
    "staging",
    "write_agreement",
    "write_features",
    "write_foliage",
    "write_height_png",
    "write_height_tif",
    "write_json",
    "write_map",
    "write_materials",
    "write_normals",
    "write_picture",
    "write_sheet",
]

_MODULE = {
    **dict.fromkeys(("agreement_picture", "write_agreement"), "agreement"),
    "write_features": "features",
    **dict.fromkeys(("move_into", "prepare_folder", "staging", "write_json"), "files"),
    "check_film": "film",
    **dict.fromkeys(("FoliageFiles", "WrittenFoliage", "check_room", "write_foliage"), "foliage_files"),
    "write_height_tif": "geotiff",
    **dict.fromkeys(("write_height_png", "write_materials", "write_normals", "write_picture"), "images"),
    **dict.fromkeys(("MAP_WIDTH", "write_map", "write_sheet"), "map"),
    "quantised_weights": "weights",
}

__getattr__ = lazy_attributes(__name__, _MODULE)
