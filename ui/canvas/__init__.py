"""The sketch as one paints on it."""
