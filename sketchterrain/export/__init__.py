"""Writers of terrain files, maps and films."""
