"""Exports of terrains."""

from sketchterrain.export.planning import checked_plan
from sketchterrain.export.target import ExportOptions
from sketchterrain.io.console import Stages
from sketchterrain.jobs.export import write_export


def export(terrain, target, folder, **options):
    """Export a terrain into a folder, which is made if it is missing."""
    folder.mkdir(exist_ok=True)
    plan = checked_plan(terrain.sketch, target, ExportOptions(**options))
    return write_export(plan, terrain, folder, stages=Stages())
