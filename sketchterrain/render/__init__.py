"""Draw terrains with OpenGL."""

from sketchterrain.render.camera import Camera
from sketchterrain.render.context import open_context
from sketchterrain.render.flight import Flight, Keyframe
from sketchterrain.render.flight_file import load_flight, save_flight
from sketchterrain.render.footage import CapturedFrame, capture_frames
from sketchterrain.render.overlays import OVERLAYS, check_overlays
from sketchterrain.render.quality import Quality
from sketchterrain.render.renderer import Renderer
from sketchterrain.render.sky import Sun
from sketchterrain.render.snapshot import render_picture
from sketchterrain.render.sunlight import find_sun, sun_for_view
from sketchterrain.render.view import VIEWS, check_view, find_view
from sketchterrain.render.weather import Weather

__all__ = [
    "OVERLAYS",
    "VIEWS",
    "Camera",
    "CapturedFrame",
    "Flight",
    "Keyframe",
    "Quality",
    "Renderer",
    "Sun",
    "Weather",
    "capture_frames",
    "check_overlays",
    "check_view",
    "find_sun",
    "find_view",
    "load_flight",
    "open_context",
    "render_picture",
    "save_flight",
    "sun_for_view",
]
