"""Topographic maps."""
