"""Points, lines and areas: tables of them, edits, files, and their drawable parts."""
