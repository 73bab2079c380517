"""From painted shapes to placed features."""
