"""Appearance: themes, icons, colours of layers."""
