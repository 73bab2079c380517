"""Rivers and lakes of a sketch on a given ground."""

from sketchterrain.landforms.hydrology.rivers import lay_out_water, solve_water
from sketchterrain.stages.runner import Runner


def trace_hydrology(sketch, *, seed, ground):
    run = Runner()
    layout = lay_out_water(sketch, seed=seed, ground=ground, run=run)
    return solve_water(sketch, layout, seed=seed, ground=ground, run=run)
