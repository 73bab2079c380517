"""Rendering with OpenGL."""
