"""Blender as a library: one scene whose vertices change, and pixels straight from memory.

Everything that knows Blender's axes, units or data blocks is here. A process has one scene;
a sequence replaces its meshes, images and lights, a frame moves vertices.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator, Mapping
from typing import Any, Final

import bpy
import mathutils
import numpy as np

from pliant.generator.scene.appearance import Light
from pliant.generator.scene.camera import NEAR_M
from pliant.spec.arrays import Float32Array, FloatArray, Int32Array
from pliant.spec.camera import Camera

_SENSOR_MM: Final = 36.0
_FAR_M: Final = 1000.0

Passes = dict[str, Float32Array]

_grabbed: Passes = {}


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep what Blender prints off standard output, also what C++ code prints."""
    sys.stdout.flush()
    kept, sink = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(sink, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(sink)


def new_scene(size: tuple[int, int], threads: int, *, gpu: bool) -> Any:
    """Return an empty scene set up for Cycles, exact and the same everywhere.

    Args:
        size: Width and height, px.
        threads: Threads of the renderer.
        gpu: Use a GPU if Cycles finds one (OptiX, then CUDA).
    """
    with quiet():
        bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "GPU" if gpu and _use_gpu() else "CPU"
    _hook_cycles()
    cycles, render = scene.cycles, scene.render
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.seed = 0
    cycles.max_bounces = 2
    cycles.diffuse_bounces = 2
    cycles.glossy_bounces = 1
    cycles.transmission_bounces = 0
    cycles.volume_bounces = 0
    cycles.transparent_max_bounces = 0
    cycles.use_light_tree = False  # one sun and the sky: nothing to choose from
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.pixel_filter_type = "BLACKMAN_HARRIS"
    cycles.filter_width = 1.5
    render.use_persistent_data = True
    render.use_motion_blur = False
    render.use_compositing = False
    render.use_sequencer = False
    render.dither_intensity = 0.0
    render.threads_mode = "FIXED"
    render.threads = threads
    render.resolution_x, render.resolution_y = size
    render.resolution_percentage = 100
    scene.view_settings.view_transform = "Standard"
    scene.world = bpy.data.worlds.new("sky")
    scene.world.use_nodes = True
    # A uniform sky needs no map to sample from.
    scene.world.cycles.sampling_method = "NONE"
    lens = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(lens)
    scene.camera = lens
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    scene.collection.objects.link(sun)
    return scene


def _use_gpu() -> bool:
    """Turn on the first GPU back end that Cycles finds; say whether there is one."""
    # The driver's device files are looked for first: asking Cycles costs a second and, without
    # a driver, finds nothing.
    if not os.path.exists("/dev/nvidiactl"):
        return False
    preferences = bpy.context.preferences.addons["cycles"].preferences
    for backend in ("OPTIX", "CUDA"):
        try:
            preferences.compute_device_type = backend
        except TypeError:
            continue
        preferences.refresh_devices()
        found = [entry for entry in preferences.devices if entry.type == backend]
        for entry in preferences.devices:
            entry.use = entry.type == backend
        if found:
            return True
    return False


def place_camera(scene: Any, camera: Camera) -> None:
    """Give Blender's camera the same view: its axes are x right, y up, z backward."""
    lens = scene.camera
    lens.data.sensor_fit = "HORIZONTAL"
    lens.data.sensor_width = _SENSOR_MM
    lens.data.lens = camera.K[0, 0] * _SENSOR_MM / camera.width
    lens.data.clip_start, lens.data.clip_end = NEAR_M, _FAR_M
    # The principal point's distance from the middle, in units of the width.
    lens.data.shift_x = (camera.width / 2 - camera.K[0, 2]) / camera.width
    lens.data.shift_y = (camera.K[1, 2] - camera.height / 2) / camera.width
    pose = np.eye(4)
    pose[:3, :3] = camera.world_to_camera[:3, :3].T @ np.diag([1.0, -1.0, -1.0])
    pose[:3, 3] = camera.centre_m
    lens.matrix_world = mathutils.Matrix(pose.tolist())


def place_light(scene: Any, light: Light) -> None:
    """Set sun and sky; Blender's sun strength is an irradiance, the sky's a radiance."""
    sun = bpy.data.objects["sun"]
    irradiance = np.asarray(light.sun_irradiance)
    strength = float(irradiance.max())
    sun.data.energy = strength
    sun.data.color = (irradiance / strength).tolist() if strength > 0 else (1.0, 1.0, 1.0)
    sun.data.angle = light.sun_angle_rad
    towards = mathutils.Vector(light.sun_direction)
    sun.rotation_mode = "QUATERNION"
    sun.rotation_quaternion = towards.to_track_quat("Z", "Y")
    background = scene.world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (*light.sky_radiance, 1.0)
    background.inputs["Strength"].default_value = 1.0


def add_mesh(
    scene: Any,
    name: str,
    vertices: FloatArray,
    faces: Int32Array,
    attributes: Mapping[str, FloatArray],
    material: Any,
    pass_index: int,
) -> Any:
    """Add a smooth triangle mesh.

    Args:
        scene: The scene.
        name: Its name.
        vertices: float64 (V, 3), world metres.
        faces: int32 (F, 3).
        attributes: Name -> float64 (V, 3), read by the material.
        material: Its material.
        pass_index: What the object-index pass shows.

    Returns:
        The object.
    """
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", vertices.astype(np.float32).ravel())
    mesh.loops.add(faces.size)
    mesh.loops.foreach_set("vertex_index", np.ascontiguousarray(faces, np.int32).ravel())
    mesh.polygons.add(len(faces))
    mesh.polygons.foreach_set("loop_start", np.arange(0, faces.size, 3, dtype=np.int32))
    mesh.update(calc_edges=True)
    mesh.polygons.foreach_set("use_smooth", np.ones(len(faces), bool))
    for key, values in attributes.items():
        attribute = mesh.attributes.new(key, "FLOAT_VECTOR", "POINT")
        attribute.data.foreach_set("vector", values.astype(np.float32).ravel())
    mesh.materials.append(material)
    made = bpy.data.objects.new(name, mesh)
    made.pass_index = pass_index
    scene.collection.objects.link(made)
    return made


def move_vertices(made: Any, vertices: FloatArray) -> None:
    """Move an object's vertices; its topology stays."""
    position = made.data.attributes["position"].data
    position.foreach_set("vector", np.ascontiguousarray(vertices, np.float32).ravel())
    made.data.update()


def remove_meshes(scene: Any) -> None:
    """Remove every mesh, material and image, so that nothing is left of a sequence."""
    # Cycles keeps textures by the address of their data block, and a new image may get the
    # address of one that was removed. Turning persistent data off drops what it keeps.
    scene.render.use_persistent_data = False
    for mesh in list(bpy.data.meshes):
        bpy.data.meshes.remove(mesh)  # its object goes with it
    for made in [item for item in bpy.data.objects if item.type == "MESH" or item.data is None]:
        bpy.data.objects.remove(made)
    for material in list(bpy.data.materials):
        bpy.data.materials.remove(material)
    for image in list(bpy.data.images):
        bpy.data.images.remove(image)
    scene.render.use_persistent_data = True


def add_image(name: str, pixels: Float32Array) -> Any:
    """Make a float image of linear values.

    Args:
        name: Its name.
        pixels: float32 (H, W, 3); the first row is v = 0, which Blender too keeps first.
    """
    height, width, _ = pixels.shape
    image = bpy.data.images.new(name, width, height, float_buffer=True, is_data=True)
    four = np.ones((height, width, 4), np.float32)
    four[..., :3] = pixels
    image.pixels.foreach_set(four.ravel())
    image.update()
    return image


def render_passes(scene: Any) -> Passes:
    """Render and return every pass.

    Args:
        scene: The scene.

    Returns:
        Pass name -> float32 (H, W, C), the first row at the top.
    """
    _grabbed.clear()
    scene.update_tag()  # persistent data would ignore changed settings
    with quiet():
        bpy.ops.render.render()
    return dict(_grabbed)


def set_border(scene: Any, window: tuple[int, int, int, int] | None) -> None:
    """Render a window of the image only, or all of it.

    Args:
        scene: The scene.
        window: First and last column, first and last row (exclusive), px, from the top; the
            passes then have the window's size.
    """
    render = scene.render
    render.use_border = render.use_crop_to_border = window is not None
    if window is None:
        return
    width, height = render.resolution_x, render.resolution_y
    # Blender rounds the borders to whole pixels; aim at their middle of the rounding.
    render.border_min_x = (window[0] + 1e-3) / width
    render.border_max_x = (window[1] + 1e-3) / width
    render.border_min_y = (height - window[3] + 1e-3) / height
    render.border_max_y = (height - window[2] + 1e-3) / height


def _hook_cycles() -> None:
    """Copy the passes out of Cycles' result when it has rendered, in place of writing files."""
    import cycles.engine as engine

    if getattr(engine.render, "copies_passes", False):
        return
    original = engine.render

    def render(render_engine: Any, depsgraph: Any) -> None:
        original(render_engine, depsgraph)
        result = render_engine.get_result()
        for layer in result.layers:
            for each in layer.passes:
                width, height = result.resolution_x, result.resolution_y
                pixels = np.empty(width * height * each.channels, np.float32)
                each.rect.foreach_get(pixels)
                _grabbed[each.name] = pixels.reshape(height, width, each.channels)[::-1]

    render.copies_passes = True  # type: ignore[attr-defined]
    engine.render = render
