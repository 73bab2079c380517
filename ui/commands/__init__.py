"""Pure functions from a sketch to a changed sketch, recorded by the caller as history steps."""
