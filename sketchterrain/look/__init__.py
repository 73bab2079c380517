"""What materials, plants and water look like, for pictures and for files; no OpenGL."""
