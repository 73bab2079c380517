"""Many terrains: what to make, in which order, what came of each, and how to go on after a stop."""
