"""Strokes, lines and fills on label images. No Qt."""
