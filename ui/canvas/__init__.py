"""The sketch editor."""
