"""The window of a stored world."""
