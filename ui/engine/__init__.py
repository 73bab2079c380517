"""The engine processes that place, draw and measure terrain, and the window's connection to them."""
