"""Batches: many terrains from sketches, seeds and swept parameters, resumable."""
