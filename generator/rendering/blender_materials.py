"""The surfaces of an appearance as Blender's shader nodes."""

from __future__ import annotations

from typing import Any, Final

import bpy
import numpy as np
import numpy.typing as npt

from pliant.generator.rendering.blender import add_image
from pliant.generator.rendering.materials import FIBRES_PER_M
from pliant.generator.rendering.patterns import cloth_images
from pliant.generator.scene.appearance import Appearance

PLACE: Final = "pliant_place"
"""Vertex attribute: where the fibres' noise or the cloth's image is read."""

COLOUR: Final = "pliant_colour"
"""Vertex attribute: reflectance of a strand or of the ball."""


def surface_material(name: str, appearance: Appearance, kind: str) -> Any:
    """Make the material of a part.

    Args:
        name: Its name.
        appearance: The appearance.
        kind: `rope`, `ball` or `cloth`.
    """
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    colour = _colour(tree, appearance, kind)
    shader = _matt(tree, colour, appearance.specular)
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader, output.inputs["Surface"])
    return material


def table_material(reflectance: npt.NDArray[np.float32]) -> Any:
    """Make the table's material from its image, laid over the plane's `place`."""
    material = bpy.data.materials.new("table")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    texture = _image(tree, add_image("table", reflectance), _attribute(tree, PLACE))
    tree.links.new(texture, diffuse.inputs["Color"])
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    return material


def plain_material(name: str) -> Any:
    """Make a material that only marks where a surface is, for the passes of the truth."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    # Every triangle would enter the light tree otherwise.
    material.cycles.emission_sampling = "NONE"
    tree = material.node_tree
    tree.nodes.clear()
    emission = tree.nodes.new("ShaderNodeEmission")  # strength 0 would be no surface at all
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    return material


def _colour(tree: Any, appearance: Appearance, kind: str) -> Any:
    if kind == "cloth":
        front, back = cloth_images(appearance)
        place = _attribute(tree, PLACE)
        first = _image(tree, add_image("front", front), place)
        if front is back or np.array_equal(front, back):
            return first
        return _by_side(tree, first, _image(tree, add_image("back", back), place))
    colour = _attribute(tree, COLOUR)
    if kind != "rope" or appearance.fibre_contrast == 0.0:
        return colour
    noise = tree.nodes.new("ShaderNodeTexNoise")
    noise.noise_dimensions = "3D"
    noise.inputs["Scale"].default_value = FIBRES_PER_M
    noise.inputs["Detail"].default_value = 0.0
    tree.links.new(_attribute(tree, PLACE), noise.inputs["Vector"])
    spread = tree.nodes.new("ShaderNodeMapRange")
    # Blender's noise keeps to 0.2..0.8; spread it as far as ours.
    spread.clamp = False
    spread.inputs["From Min"].default_value = 0.2
    spread.inputs["From Max"].default_value = 0.8
    spread.inputs["To Min"].default_value = 1.0 - appearance.fibre_contrast
    spread.inputs["To Max"].default_value = 1.0 + appearance.fibre_contrast
    tree.links.new(noise.outputs["Fac"], spread.inputs["Value"])
    return _mixed(tree, "MULTIPLY", colour, spread.outputs[0])


def _matt(tree: Any, colour: Any, specular: float) -> Any:
    if specular < 0.02:
        node = tree.nodes.new("ShaderNodeBsdfDiffuse")
        tree.links.new(colour, node.inputs["Color"])
        return node.outputs[0]
    node = tree.nodes.new("ShaderNodeBsdfPrincipled")
    node.inputs["Roughness"].default_value = 0.5
    node.inputs["Specular IOR Level"].default_value = 0.5 * specular
    tree.links.new(colour, node.inputs["Base Color"])
    return node.outputs[0]


def _attribute(tree: Any, name: str) -> Any:
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_type = "GEOMETRY"
    node.attribute_name = name
    return node.outputs["Vector"]


def _image(tree: Any, image: Any, place: Any) -> Any:
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    node.extension = "EXTEND"
    node.interpolation = "Linear"
    tree.links.new(place, node.inputs["Vector"])
    return node.outputs["Color"]


def _mixed(tree: Any, blend: str, first: Any, second: Any, factor: Any = None) -> Any:
    node = tree.nodes.new("ShaderNodeMix")
    node.data_type = "RGBA"
    node.blend_type = blend
    if factor is None:
        node.inputs["Factor"].default_value = 1.0
    else:
        tree.links.new(factor, node.inputs["Factor"])
    # A colour mix has its sockets after those of the other types.
    tree.links.new(first, node.inputs[6])
    tree.links.new(second, node.inputs[7])
    return node.outputs[2]


def _by_side(tree: Any, front: Any, back: Any) -> Any:
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    return _mixed(tree, "MIX", front, back, geometry.outputs["Backfacing"])
