"""Sketches from images, layered files and vector data."""
