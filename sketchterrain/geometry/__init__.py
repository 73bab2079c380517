"""Lattice, hashing, splines, boxes and differences, which all packages share."""
