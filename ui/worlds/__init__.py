"""Window of a stored world."""
