"""Rivers and lakes: networks, courses, profiles, water levels."""
