"""Pictures of a stream's ground alone, and what is to be seen in them."""

import moderngl
import numpy as np

from sketchterrain.render import Camera
from sketchterrain.render.camera import clip_planes, direction
from sketchterrain.render.frame import FrameBlock
from sketchterrain.render.programs import FRAME_BINDING
from sketchterrain.resources import source

MAGENTA = (255, 0, 255)
LIT = """
in vec3 ground_normal;
out float light;
void main()
{
    light = 110.0 + 140.0 * max(dot(normalize(ground_normal), vec3(-0.5, 0.35, 0.79)), 0.0);
    vec3 seen = vec3(gl_FragCoord.xy / reach.zw, gl_FragCoord.z) * 2.0 - 1.0;
    vec4 position = from_clip * vec4(seen, 1.0);
    light = mix(light, 255.0, smoothstep(0.75, 0.98, length(position.xy / position.w) / reach.x));
}
"""
FINER = 4
"""Samples a pixel along each axis: one would see facets come and go that are far smaller than a pixel."""


class Shade:
    """Draws a stream's ground lit from the side, up to 250, before a sky of 255; averages over pixels.

    Towards the draw distance it goes over into the sky, as in frame.glsl.
    """

    def __init__(self, gl, stream, size):
        self.gl, self.size = gl, size
        inner = (FINER * size[0], FINER * size[1])
        self.light = gl.texture(inner, 1, dtype="f4")
        self.target = gl.framebuffer([self.light], gl.depth_renderbuffer(inner))
        self.frame = FrameBlock(gl)
        version, _, rest = source("render/ground.vert.glsl").partition("\n")
        program = gl.program(
            vertex_shader=f"{version}\n#define TILE_QUADS {stream.tiles.quads}\n{rest}",
            fragment_shader=f"{version}\n{source('render/frame.glsl')}{LIT}",
        )
        program["Frame"].binding = FRAME_BINDING
        self.pool = stream.pool
        self.array = stream.pool.array(program)

    def see(self, camera, reach):
        to_clip = camera.to_clip(self.size[0] / self.size[1])
        self.frame["to_clip"], self.frame["from_clip"] = to_clip, np.linalg.inv(to_clip)
        self.frame["reach"] = (reach, 0.0, *self.light.size)
        self.frame["eye"] = (0.0, 0.0, camera.eye[2])
        self.frame.upload()
        self.target.use()
        self.target.clear(255.0, depth=1.0)
        self.gl.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        self.pool.draw(self.array)
        self.gl.enable_only(moderngl.NOTHING)
        samples = np.frombuffer(self.light.read(), np.float32)
        width, height = self.size
        return samples.reshape(height, FINER, width, FINER).mean(axis=(1, 3), dtype=np.float64)


def change(before, after):
    """By how much each pixel leaves what it and its eight neighbours showed: an edge may move a pixel."""
    padded = np.pad(before, 1, mode="edge")
    height, width = before.shape
    near = [padded[i : i + height, j : j + width] for i in range(3) for j in range(3)]
    return np.maximum(np.maximum(np.min(near, axis=0) - after, after - np.max(near, axis=0)), 0.0)


def must_be_covered(camera, size, reach, lowest):
    """Which pixels' rays meet the plane under all ground (at `lowest` m) within reach (m): (height, width).

    Row 0 is the lowest one.
    """
    width, height = size
    half = np.tan(np.radians(camera.fov) / 2.0)
    x = ((np.arange(width) + 0.5) / width * 2.0 - 1.0) * half * width / height
    y = ((np.arange(height) + 0.5) / height * 2.0 - 1.0)[:, None] * half
    axes = camera.view()[:3, :3]
    way = x[..., None] * axes[0] + y[..., None] * axes[1] - axes[2]
    with np.errstate(divide="ignore"):
        far = (camera.eye[2] - lowest) / np.maximum(-way[..., 2], 0.0)
    return far * np.hypot(way[..., 0], way[..., 1]) < reach


def holes(picture, camera, reach, lowest):
    """How many pixels of a picture (height, width, 4) show magenta although they must be covered."""
    magenta = (picture[..., :3] == MAGENTA).all(axis=-1)
    return int(np.count_nonzero(magenta & must_be_covered(camera, picture.shape[1::-1], reach, lowest)))


class Eye:
    """Draws a stream's ground before magenta."""

    def __init__(self, gl, size):
        self.gl, self.size = gl, size
        self.texture = gl.texture(size, 4)
        self.target = gl.framebuffer([self.texture], gl.depth_renderbuffer(size))
        self.frame = FrameBlock(gl)

    def see(self, stream, camera):
        self.frame["to_clip"] = camera.to_clip(self.size[0] / self.size[1])
        self.frame["eye"] = (0.0, 0.0, camera.eye[2])
        self.frame.upload()
        self.target.use()
        self.target.clear(1.0, 0.0, 1.0, 1.0, depth=1.0)
        self.gl.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        stream.draw(camera.eye)
        self.gl.enable_only(moderngl.NOTHING)
        return np.frombuffer(self.texture.read(), np.uint8).reshape(*self.size[::-1], 4)


def camera_towards(eye, ground, bearing, pitch, reach):
    near, far = clip_planes(eye[2] - ground, reach)
    return Camera(tuple(eye), tuple(np.add(eye, direction(bearing, pitch))), fov=50.0, near=near, far=far)
