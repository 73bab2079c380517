"""Landforms of hand-painted sketches."""
