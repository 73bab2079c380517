"""Land use: fields, meadows, forests and built-up land, from vectors."""
