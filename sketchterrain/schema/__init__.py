"""Declared layers, materials and parameters, from which file format, panels and docs follow."""
