"""The document: a sketch, its parameters, history and files."""
