"""The surfaces of an appearance as Blender's shader nodes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import bpy
import numpy as np

from pliant.generator.rendering.blender import add_image
from pliant.generator.rendering.materials import FIBRES_PER_M, Image
from pliant.generator.scene.appearance import Appearance
from pliant.spec.arrays import Float32Array

PLACE: Final = "pliant_place"
"""Vertex attribute: where the fibres' noise or the cloth's image is read."""

COLOUR: Final = "pliant_colour"
"""Vertex attribute: reflectance of a strand or of the ball."""


def surface_material(
    name: str, appearance: Appearance, kind: str, woven: tuple[Image, Image]
) -> Any:
    """Make the material of a part.

    Args:
        name: Its name.
        appearance: The appearance.
        kind: `rope`, `ball` or `cloth`.
        woven: A cloth's front and back, as in `Materials`.
    """
    material, tree = _new_material(name)
    colour = _colour(tree, appearance, kind, woven)
    if appearance.specular < 0.02:
        shader = _node(tree, "BsdfDiffuse", {"Color": colour})
    else:
        inputs = {"Roughness": 0.5, "Specular IOR Level": 0.5 * appearance.specular}
        shader = _node(tree, "BsdfPrincipled", {**inputs, "Base Color": colour})
    _node(tree, "OutputMaterial", {"Surface": shader.outputs[0]})
    return material


def table_material(reflectance: Float32Array) -> Any:
    """Make the table's material from its image, laid over the plane's `place`."""
    material, tree = _new_material("table")
    texture = _image(tree, "table", reflectance, _attribute(tree, PLACE))
    shader = _node(tree, "BsdfDiffuse", {"Color": texture})
    _node(tree, "OutputMaterial", {"Surface": shader.outputs[0]})
    return material


def plain_material(name: str) -> Any:
    """Make a material that only marks where a surface is, for the passes of the truth."""
    material, tree = _new_material(name)
    # Every triangle would enter the light tree otherwise.
    material.cycles.emission_sampling = "NONE"
    emission = _node(tree, "Emission")  # strength 0 would be no surface at all
    _node(tree, "OutputMaterial", {"Surface": emission.outputs[0]})
    return material


def _new_material(name: str) -> tuple[Any, Any]:
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    material.node_tree.nodes.clear()
    return material, material.node_tree


def _node(tree: Any, kind: str, inputs: Mapping[Any, Any] | None = None, **settings: Any) -> Any:
    """Add a node; an input that is another node's output is linked, any other is set."""
    node = tree.nodes.new(f"ShaderNode{kind}")
    for name, value in settings.items():
        setattr(node, name, value)
    for key, value in (inputs or {}).items():
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, node.inputs[key])
        else:
            node.inputs[key].default_value = value
    return node


def _colour(tree: Any, appearance: Appearance, kind: str, woven: tuple[Image, Image]) -> Any:
    if kind == "cloth":
        front, back = woven
        place = _attribute(tree, PLACE)
        first = _image(tree, "front", front, place)
        if front is back or np.array_equal(front, back):
            return first
        second = _image(tree, "back", back, place)
        side = _node(tree, "NewGeometry").outputs["Backfacing"]
        return _mixed(tree, "MIX", first, second, side)
    colour = _attribute(tree, COLOUR)
    if kind != "rope" or appearance.fibre_contrast == 0.0:
        return colour
    scale = {"Scale": FIBRES_PER_M, "Detail": 0.0, "Vector": _attribute(tree, PLACE)}
    noise = _node(tree, "TexNoise", scale, noise_dimensions="3D")
    # Blender's noise keeps to 0.2..0.8; spread it as far as ours.
    spread = {
        "Value": noise.outputs["Fac"],
        "From Min": 0.2,
        "From Max": 0.8,
        "To Min": 1.0 - appearance.fibre_contrast,
        "To Max": 1.0 + appearance.fibre_contrast,
    }
    return _mixed(
        tree, "MULTIPLY", colour, _node(tree, "MapRange", spread, clamp=False).outputs[0], 1.0
    )


def _attribute(tree: Any, name: str) -> Any:
    node = _node(tree, "Attribute", attribute_type="GEOMETRY", attribute_name=name)
    return node.outputs["Vector"]


def _image(tree: Any, name: str, pixels: Float32Array, place: Any) -> Any:
    image = add_image(name, pixels)
    node = _node(
        tree, "TexImage", {"Vector": place}, image=image, extension="EXTEND", interpolation="Linear"
    )
    return node.outputs["Color"]


def _mixed(tree: Any, blend: str, first: Any, second: Any, factor: Any) -> Any:
    # A colour mix has its sockets after those of the other types.
    inputs = {"Factor": factor, 6: first, 7: second}
    return _node(tree, "Mix", inputs, data_type="RGBA", blend_type=blend).outputs[2]
