"""From a sketch to its terrain: the table of stages, and all that can be asked of a terrain."""
