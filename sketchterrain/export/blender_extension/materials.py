"""Node trees: ground, objects, water, plants, sky, and the instances of plants."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import bpy

STATE = "sketchterrain_state"  # property: digest of a block as it was imported
_IGNORED = {"name", "label", "select", "location", "width", "height", "parent", "is_active_output"}
_COLUMN, _ROW = 220.0, 190.0  # layout of nodes
_SKY = 8.7  # irradiance of Blender's sky on level ground, times e / (e + 6°) for the sun's elevation e: a fit
_WATER = (0.010, 0.050, 0.070, 1.0)

Tile = dict[str, Any]


def rebuild(block: Any, build: Callable[..., None], *arguments: Any) -> bool:
    """Build a block unless it was changed since its import; return whether it was built."""
    if STATE in block and block[STATE] != digest(block):
        return False
    build(block, *arguments)
    block[STATE] = digest(block)
    return True


def digest(block: Any) -> str:
    """Return a digest of a node tree, of what has one, or of an object and its light or camera."""
    tree = block if isinstance(block, bpy.types.NodeTree) else getattr(block, "node_tree", None)
    parts: list[Any] = []
    for node in () if tree is None else sorted(tree.nodes, key=lambda node: str(node.name)):
        sockets = [getattr(each, "default_value", None) for each in (*node.inputs, *node.outputs)]
        parts.append((node.name, node.bl_idname, _settings(node), _plain(sockets)))
        for socket in node.inputs:
            parts += [(node.name, socket.identifier, each.from_node.name) for each in socket.links]
    if isinstance(block, bpy.types.Object):
        parts += [_plain(value) for value in (block.location, block.rotation_euler, block.scale)]
        parts += _settings(block.data) if block.type in {"CAMERA", "LIGHT"} else []
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


def _settings(block: Any) -> list[Any]:
    names = [each.identifier for each in block.bl_rna.properties if not each.is_readonly]
    values = ((name, getattr(block, name)) for name in names if name not in _IGNORED)
    simple = (int, float, str, bpy.types.ID)
    return [(name, _plain(value)) for name, value in values if isinstance(value, simple)]


def _plain(value: Any) -> Any:
    if isinstance(value, bpy.types.ID):
        return value.name
    return (
        value if value is None or isinstance(value, (int, float, str)) else [_plain(each) for each in value]
    )


def _add(tree: Any, kind: str, *inputs: Any, named: Mapping[str, Any] | None = None, **settings: Any) -> Any:
    """Add a node; inputs are sockets or values, in order or by their names."""
    node = tree.nodes.new(kind)
    for name, value in settings.items():
        setattr(node, name, value)
    values = dict(zip((socket for socket in node.inputs if socket.enabled), inputs, strict=False))
    for socket, value in (values | {node.inputs[key]: value for key, value in (named or {}).items()}).items():
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, socket)
        else:
            socket.default_value = value
    return node


def _sockets(tree: Any, direction: str, **kinds: str) -> None:
    """Add the sockets of a group, but those that it has: nodes and modifiers refer to them."""
    there = {(each.in_out, each.name) for each in tree.interface.items_tree}
    for name, kind in kinds.items():
        if (direction, name) not in there:
            tree.interface.new_socket(name, in_out=direction, socket_type=f"NodeSocket{kind}")


def _math(tree: Any, operation: str, *inputs: Any) -> Any:
    return _add(tree, "ShaderNodeMath", *inputs, operation=operation).outputs[0]


def _vector(tree: Any, operation: str, *inputs: Any, **named: Any) -> Any:
    kind = "ShaderNodeVectorMath"
    return _add(tree, kind, *inputs, operation=operation, named=named).outputs[operation == "DISTANCE"]


def _mix(tree: Any, factor: Any, first: Any, second: Any, blend: str = "MIX") -> Any:
    inputs = (factor, first, second)
    node = _add(tree, "ShaderNodeMix", *inputs, data_type="RGBA", blend_type=blend)
    return node.outputs["Result"]


def _image(tree: Any, image: Any, vector: Any, extension: str) -> Any:
    return _add(tree, "ShaderNodeTexImage", vector, image=image, extension=extension)


def _arrange(tree: Any) -> None:
    """Place nodes in columns by their distance from the output."""
    column = dict.fromkeys((node.name for node in tree.nodes), 0)
    for _ in tree.nodes:
        for link in tree.links:
            start, end = link.from_node.name, link.to_node.name
            column[start] = max(column[start], column[end] + 1)
    rows = dict.fromkeys(column.values(), 0)
    for node in tree.nodes:
        node.location = (-_COLUMN * column[node.name], -_ROW * rows[column[node.name]])
        rows[column[node.name]] += 1


def _surface(material: Any) -> Any:
    material.use_nodes = True
    material.node_tree.nodes.clear()
    return material.node_tree


def _principled(tree: Any, colour: Any, roughness: Any, **named: Any) -> Any:
    named = {"Base Color": colour, "Roughness": roughness} | named
    return _add(tree, "ShaderNodeBsdfPrincipled", named=named).outputs[0]


def _finish(tree: Any, shader: Any, air: Any) -> None:
    faded = shader if air is None else _group(tree, air, shader)[0]
    _add(tree, "ShaderNodeOutputMaterial", faded)
    _arrange(tree)


def _group(tree: Any, group: Any, value: Any) -> Any:
    return _add(tree, "ShaderNodeGroup", value, node_tree=group, label=group.name).outputs


def load_image(name: str, path: Path | bytes, *, is_data: bool = False) -> Any:
    """Return the image of this name with the content of a file, or of bytes that are packed."""
    image = bpy.data.images.get(name) or bpy.data.images.new(name, 1, 1)
    if isinstance(path, bytes):
        image.pack(data=path, data_len=len(path))
    else:
        if image.packed_file is not None:
            image.unpack(method="REMOVE")
        image.filepath = str(path)
    image.source = "FILE"
    image.alpha_mode = "CHANNEL_PACKED"
    image.colorspace_settings.name = "Non-Color" if is_data else "sRGB"
    image.reload()
    return image


def build_tile(tree: Any, tile: Tile, image: Any) -> None:
    """Fill a node group with a material's repeating texture, as a function of the position (m)."""
    tree.nodes.clear()
    _sockets(tree, "INPUT", Position="Vector")
    _sockets(tree, "OUTPUT", Colour="Color", Height="Float", Roughness="Float")
    position = _add(tree, "NodeGroupInput").outputs[0]
    near = _image(tree, image, _vector(tree, "SCALE", position, Scale=1.0 / tile["width"]), "REPEAT")
    # A second, coarser and rotated copy hides the repetition.
    turned = _add(tree, "ShaderNodeVectorRotate", position, rotation_type="Z_AXIS", named={"Angle": 0.7})
    wide = _vector(tree, "SCALE", turned.outputs[0], Scale=1.0 / (1.7 * tile["coarsest_width"]))
    colour = _mix(tree, 0.5, near.outputs["Color"], _image(tree, image, wide, "REPEAT").outputs["Color"])
    for number, (low, high) in enumerate(tile["tints"]):
        moved = _vector(tree, "ADD", position, (7919.0 * number, 3571.0 * number, 0.0))
        noise = {"Vector": moved, "Scale": 0.004, "Detail": 5.0, "Roughness": 0.6}
        share = _add(tree, "ShaderNodeTexNoise", named=noise).outputs[0]
        share = _add(tree, "ShaderNodeMapRange", share, 0.3, 0.7).outputs[0]
        colour = _mix(tree, 1.0, colour, _mix(tree, share, (*low, 1.0), (*high, 1.0)), "MULTIPLY")
    if tile["beds"]:  # bands of colour across the rock's beds
        *across, banding = tile["beds"]
        bed = _add(tree, "ShaderNodeVectorMath", position, across, operation="DOT_PRODUCT").outputs["Value"]
        bands = {"W": bed, "Scale": 0.7, "Detail": 4.0, "Roughness": 0.7}
        band = _add(tree, "ShaderNodeTexNoise", noise_dimensions="1D", named=bands).outputs[0]
        low, high = 1.0 - 0.8 * banding, 1.0 + 0.6 * banding
        share = _add(tree, "ShaderNodeMapRange", band, 0.35, 0.65, low, high).outputs[0]
        colour = _vector(tree, "SCALE", colour, Scale=share)
    height = _math(tree, "MULTIPLY", near.outputs["Alpha"], tile["relief"])
    roughness = _add(tree, "ShaderNodeValue")
    roughness.outputs[0].default_value = tile["roughness"]
    _add(tree, "NodeGroupOutput", colour, height, roughness.outputs[0])
    _arrange(tree)


def build_ground(
    material: Any,
    air: Any,
    tiles: list[Tile],
    groups: dict[str, Any],
    weights: dict[str, Any],
    painted: list[Any],
) -> None:
    """Mix the tiles by their weights, under the colour of roads and land use."""
    tree = _surface(material)
    place = _add(tree, "ShaderNodeTexCoord").outputs
    channels = {}
    for name, image in weights.items():
        node = _image(tree, image, place["UV"], "EXTEND")
        parts = _add(tree, "ShaderNodeSeparateColor", node.outputs["Color"]).outputs
        channels[name] = [*parts, node.outputs["Alpha"]]
    colour, height, roughness = (0.0, 0.0, 0.0), 0.0, 0.0
    for tile in tiles:
        weight = channels[tile["weights"]][tile["channel"]]
        own = _group(tree, groups[tile["material"]], place["Object"])
        colour = _vector(tree, "MULTIPLY_ADD", own["Colour"], weight, colour)
        height = _math(tree, "MULTIPLY_ADD", own["Height"], weight, height)
        roughness = _math(tree, "MULTIPLY_ADD", own["Roughness"], weight, roughness)
    for image in painted:
        node = _image(tree, image, place["UV"], "EXTEND")
        colour = _mix(tree, node.outputs["Alpha"], colour, node.outputs["Color"])
    bump = _add(tree, "ShaderNodeBump", 1.0, 1.0, height).outputs[0]
    named = {"Normal": bump, "Specular IOR Level": 0.25}
    _finish(tree, _principled(tree, colour, roughness, **named), air)


def build_baked_ground(material: Any, air: Any, colour: Any, roughness: Any) -> None:
    """Show the textures that a GLB holds."""
    tree = _surface(material)
    uv = _add(tree, "ShaderNodeTexCoord").outputs["UV"]
    mean, rough = (_image(tree, each, uv, "EXTEND").outputs["Color"] for each in (colour, roughness))
    rough = _add(tree, "ShaderNodeSeparateColor", rough).outputs["Green"]
    _finish(tree, _principled(tree, mean, rough), air)


def build_solid(material: Any, air: Any, colour: tuple[float, ...], group: Any) -> None:
    """Show a material of roads and buildings: the tile of the ground's material if there is one."""
    tree = _surface(material)
    look: Any = (colour, 0.85)
    if group is not None:
        own = _group(tree, group, _add(tree, "ShaderNodeTexCoord").outputs["Object"])
        look = (own["Colour"], own["Roughness"])
    _finish(tree, _principled(tree, *look), air)


def build_water(material: Any, air: Any) -> None:
    """Reflect the sky on small waves over dark water."""
    tree = _surface(material)
    position = _add(tree, "ShaderNodeTexCoord").outputs["Object"]
    height: Any = 0.0
    for scale, rise in ((0.08, 0.12), (0.7, 0.02)):
        noise = _add(tree, "ShaderNodeTexNoise", named={"Vector": position, "Scale": scale, "Detail": 3.0})
        height = _math(tree, "MULTIPLY_ADD", noise.outputs[0], rise, height)
    bump = _add(tree, "ShaderNodeBump", 1.0, 1.0, height).outputs[0]
    named = {"IOR": 1.333, "Normal": bump, "Transmission Weight": 0.15}
    _finish(tree, _principled(tree, _WATER, 0.03, **named), air)


def build_plants(material: Any, air: Any) -> None:
    """Show the colours of leaves and wood, each plant a little lighter or darker."""
    tree = _surface(material)
    random = _add(tree, "ShaderNodeObjectInfo").outputs["Random"]
    # Lighter, as the shade inside crowns is in the colours and is cast again.
    shade = _add(tree, "ShaderNodeMapRange", random, 0.0, 1.0, 1.2, 1.8).outputs[0]
    own = _add(tree, "ShaderNodeVertexColor", layer_name="colour").outputs["Color"]
    colour = _vector(tree, "SCALE", own, Scale=shade)
    matt = _add(tree, "ShaderNodeBsdfDiffuse", colour).outputs[0]
    through = _add(tree, "ShaderNodeBsdfTranslucent", colour).outputs[0]
    _finish(tree, _add(tree, "ShaderNodeMixShader", 0.35, matt, through).outputs[0], air)


def build_world(world: Any, scene: Mapping[str, Any], unit: float) -> None:
    """Show the sky of the sun's place and its clouds; the sun itself is a lamp."""
    world.use_nodes = True
    tree, sun, weather = world.node_tree, scene["sun"], scene["weather"]
    tree.nodes.clear()
    is_old = bpy.app.version < (5, 0, 0)  # before names changed
    sky = _add(
        tree, "ShaderNodeTexSky", sky_type="NISHITA" if is_old else "SINGLE_SCATTERING", sun_disc=False
    )
    sky.sun_elevation, sky.sun_rotation = math.radians(sun["elevation"]), math.radians(sun["azimuth"])
    sky.altitude = max(scene["camera"]["eye"][2], 0.0)
    setattr(sky, "dust_density" if is_old else "aerosol_density", 0.1 * weather["haze"])
    # The model has single scattering only: its strength gives level ground the sketch's light of the sky.
    own = _SKY * max(sun["elevation"], 1.0) / (max(sun["elevation"], 1.0) + 6.0)
    colour = _vector(tree, "SCALE", sky.outputs[0], Scale=unit * scene["skylight"][1] / own)
    # Clouds in a plane; they are seen and reflected, but light nothing.
    direction = _add(tree, "ShaderNodeTexCoord").outputs["Generated"]
    up = _add(tree, "ShaderNodeSeparateXYZ", direction).outputs["Z"]
    # Near the horizon the sky is the light of the air.
    haze = _add(tree, "ShaderNodeMapRange", up, 0.0, 0.25, 0.85, 0.0, interpolation_type="SMOOTHSTEP")
    light = (*(unit * each for each in scene["air"]["radiance"]), 1.0)
    colour = _mix(tree, haze.outputs[0], colour, light)
    far = _math(tree, "DIVIDE", 1.0, _math(tree, "ADD", _math(tree, "MAXIMUM", up, 0.0), 0.06))
    place = _vector(tree, "SCALE", direction, Scale=far)
    noise = {"Vector": place, "Scale": 1.1, "Detail": 9.0, "Roughness": 0.55}
    field = _add(tree, "ShaderNodeTexNoise", named=noise).outputs[0]
    edge = 0.65 - 0.36 * weather["clouds"]
    cover = _add(tree, "ShaderNodeMapRange", field, edge, edge + 0.12).outputs[0]
    low = _add(tree, "ShaderNodeMapRange", up, 0.01, 0.12).outputs[0]
    is_lit = _add(tree, "ShaderNodeLightPath").outputs["Is Diffuse Ray"]
    cover = _math(tree, "MULTIPLY", _math(tree, "MULTIPLY", cover, low), _math(tree, "SUBTRACT", 1.0, is_lit))
    thick = _add(tree, "ShaderNodeMapRange", field, edge, edge + 0.35).outputs[0]
    bright = unit * scene["sunlight"][1] / math.pi
    white, grey = ((share * bright, share * bright, share * bright, 1.0) for share in (0.6, 0.3))
    colour = _mix(tree, cover, colour, _mix(tree, thick, white, grey))
    _add(tree, "ShaderNodeOutputWorld", _add(tree, "ShaderNodeBackground", colour).outputs[0])
    _arrange(tree)


def build_air(tree: Any, air: Mapping[str, Any], unit: float) -> None:
    """Fade a shader into the light of the air by its distance from the camera."""
    tree.nodes.clear()
    for direction in ("INPUT", "OUTPUT"):
        _sockets(tree, direction, Shader="Shader")
    given = _add(tree, "NodeGroupInput").outputs[0]
    distance = _add(tree, "ShaderNodeCameraData").outputs["View Distance"]
    seen = _add(tree, "ShaderNodeLightPath").outputs["Is Camera Ray"]
    lost = []
    for extinction in air["extinction"]:
        through = _math(tree, "EXPONENT", _math(tree, "MULTIPLY", distance, -extinction))
        lost.append(_math(tree, "MULTIPLY", _math(tree, "SUBTRACT", 1.0, through), seen))
    colour = [unit * each for each in air["radiance"]]
    colour = _vector(tree, "MULTIPLY", _add(tree, "ShaderNodeCombineXYZ", *lost).outputs[0], colour)
    light = _add(tree, "ShaderNodeEmission", colour).outputs[0]
    faded = _add(tree, "ShaderNodeMixShader", lost[1], given).outputs[0]
    _add(tree, "NodeGroupOutput", _add(tree, "ShaderNodeAddShader", faded, light).outputs[0])
    _arrange(tree)


def build_instances(tree: Any, near: float, far: float) -> None:
    """Instance models on points: the finest nearer than `near` to the camera, the coarsest beyond `far`."""
    tree.nodes.clear()
    _sockets(tree, "INPUT", Geometry="Geometry", Models="Collection", Near="Float", Far="Float")
    _sockets(tree, "OUTPUT", Geometry="Geometry")
    for socket in tree.interface.items_tree:
        if socket.name in ("Near", "Far"):
            socket.default_value, socket.min_value = (near if socket.name == "Near" else far), 0.0
    given = _add(tree, "NodeGroupInput").outputs
    camera = _add(tree, "GeometryNodeInputActiveCamera").outputs[0]
    eye = _add(tree, "GeometryNodeObjectInfo", camera, transform_space="RELATIVE").outputs["Location"]
    distance = _vector(tree, "DISTANCE", _add(tree, "GeometryNodeInputPosition").outputs[0], eye)
    attributes = {
        name: _add(tree, "GeometryNodeInputNamedAttribute", name, data_type=kind).outputs[0]
        for name, kind in (("model", "INT"), ("rotation", "FLOAT"), ("scale", "FLOAT"))
    }
    model = attributes["model"]
    for limit in ("Near", "Far"):
        model = _math(tree, "ADD", model, _math(tree, "GREATER_THAN", distance, given[limit]))
    turn = _add(tree, "ShaderNodeCombineXYZ", 0.0, 0.0, attributes["rotation"]).outputs[0]
    models = _add(tree, "GeometryNodeCollectionInfo", given["Models"], True, True).outputs[0]
    upright = _add(tree, "FunctionNodeEulerToRotation", turn).outputs[0]
    given = (given["Geometry"], True, models, True, model, upright, attributes["scale"])
    placed = _add(tree, "GeometryNodeInstanceOnPoints", *given).outputs[0]
    _add(tree, "NodeGroupOutput", placed)
    _arrange(tree)
