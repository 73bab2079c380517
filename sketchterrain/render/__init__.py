"""Draw terrains with OpenGL."""

from sketchterrain.render.camera import Camera
from sketchterrain.render.context import open_context
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import Sun
from sketchterrain.render.snapshot import render_picture
from sketchterrain.render.sunlight import find_sun
from sketchterrain.render.view import find_view

__all__ = ["Camera", "Quality", "Renderer", "Sun", "find_sun", "find_view", "open_context", "render_picture"]
