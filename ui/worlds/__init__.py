"""Written worlds in a window of their own."""
