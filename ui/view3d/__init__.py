"""The terrain as one walks around it."""
