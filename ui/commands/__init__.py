"""Changes of a sketch: functions from a sketch to another one. No Qt."""
