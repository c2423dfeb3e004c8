"""Scenes and pictures for the tests inside of Blender."""

import os
import sys
import tempfile
from pathlib import Path

import bpy
import numpy

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from blender import exr

FOLDER = tempfile.TemporaryDirectory(prefix="cardioid-test-")


def nodes_of(block):
    """The node tree of a new material or world, emptied."""
    if block.node_tree is None:
        block.use_nodes = True
    block.node_tree.nodes.clear()
    return block.node_tree


def material(name, kind, **values):
    """A material of one shader, or of the principled one."""
    new = bpy.data.materials.new(name)
    tree = nodes_of(new)
    shader = tree.nodes.new(kind)
    for key, value in values.items():
        shader.inputs[key.replace("_", " ")].default_value = value
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return new


def white(reflectance=1.0):
    return material("white", "ShaderNodeBsdfDiffuse", Color=(reflectance, reflectance, reflectance, 1.0))


def mesh(name, vertices, faces, look=None, place=(0, 0, 0)):
    data = bpy.data.meshes.new(name)
    data.from_pydata(vertices, [], faces)
    if look:
        data.materials.append(look)
    thing = bpy.data.objects.new(name, data)
    thing.location = place
    bpy.context.scene.collection.objects.link(thing)
    return thing


def plane(look, half=50.0, place=(0, 0, 0), name="plane"):
    corners = [(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)]
    return mesh(name, corners, [(0, 1, 2, 3)], look, place)


def box(look, low, high, name="box"):
    corners = [(x, y, z) for z in (low[2], high[2]) for y in (low[1], high[1]) for x in (low[0], high[0])]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return mesh(name, corners, faces, look)


def lamp(kind, watts, place=(0, 0, 3), turn=(0, 0, 0), **values):
    data = bpy.data.lights.new(kind, kind)
    data.energy = watts
    for key, value in values.items():
        setattr(data, key, value)
    thing = bpy.data.objects.new(kind, data)
    thing.location, thing.rotation_euler = place, turn
    bpy.context.scene.collection.objects.link(thing)
    return thing


def eye(place=(0, 0, 1), turn=(0, 0, 0), lens=3600.0):
    data = bpy.data.cameras.new("eye")
    data.lens = lens
    thing = bpy.data.objects.new("eye", data)
    thing.location, thing.rotation_euler = place, turn
    bpy.context.scene.collection.objects.link(thing)
    bpy.context.scene.camera = thing
    return thing


def world(colour=(0, 0, 0), strength=1.0):
    new = bpy.data.worlds.new("world")
    tree = nodes_of(new)
    background, output = tree.nodes.new("ShaderNodeBackground"), tree.nodes.new("ShaderNodeOutputWorld")
    background.inputs["Color"].default_value = (*colour, 1.0)
    background.inputs["Strength"].default_value = strength
    tree.links.new(background.outputs[0], output.inputs["Surface"])
    bpy.context.scene.world = new
    return tree, background


def empty_scene(size=(8, 8), integrator="path", extra="--spp 64"):
    """A scene without anything; the add-on stays registered."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CARDIOID"
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    scene.cardioid.integrator, scene.cardioid.extra, scene.cardioid.quality = integrator, extra, "draft"
    return scene


def render(**settings):
    """Renders, and yields all passes by name, rows from the top."""
    scene = bpy.context.scene
    for key, value in settings.items():
        setattr(scene.render, key, value)
    image = scene.render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = "MULTI_LAYER_IMAGE"
    if hasattr(image, "use_exr_interleave"):
        image.use_exr_interleave = True
    image.file_format, image.color_depth, image.exr_codec = "OPEN_EXR_MULTILAYER", "32", "ZIP"
    path = os.path.join(FOLDER.name, "result.exr")
    scene.render.filepath = path
    bpy.ops.render.render(write_still=True)
    picture = exr.read(path)
    passes = {}
    for name, values in picture.channels.items():
        layer, kind, channel = name.rsplit(".", 2)
        first = scene.view_layers[0].name
        passes.setdefault(kind if layer == first else f"{layer}.{kind}", {})[channel] = values
    order = {"A": 3, "R": 0, "G": 1, "B": 2, "X": 0, "Y": 1, "Z": 2, "V": 0}
    return {
        kind: numpy.stack([found[c] for c in sorted(found, key=order.get)], axis=-1) for kind, found in passes.items()
    }


def by_cycles(samples=64):
    """The same scene by Cycles."""
    scene = bpy.context.scene
    import addon_utils

    addon_utils.enable("cycles")
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_adaptive_sampling, scene.cycles.use_denoising = samples, False, False
    scene.cycles.pixel_filter_type = "BOX"
    for kind in ("max", "volume", "transmission", "glossy", "diffuse"):
        setattr(scene.cycles, f"{kind}_bounces", 100)
    scene.cycles.blur_glossy = 0.0
    scene.cycles.sample_clamp_indirect = 0.0
    found = render()
    scene.render.engine = "CARDIOID"
    return found


def mean(passes, name="Combined", channel=0):
    return float(passes[name][..., channel].mean(dtype=numpy.float64))


def assert_same_shapes(test, own, other):
    """Depths of the same objects. Cycles has one ray in each pixel, so that only ours has what covers less of it."""
    ours, theirs = own < 100, other < 100
    beside = theirs.copy()
    for axis in (0, 1):
        for step in (-1, 1):
            beside |= numpy.roll(theirs, step, axis) | numpy.roll(numpy.roll(theirs, step, axis), step, 1 - axis)
            beside |= numpy.roll(numpy.roll(theirs, step, axis), -step, 1 - axis)
    test.assertGreater(theirs.sum(), 60)
    test.assertFalse((ours & ~beside).any(), "something is where Cycles has nothing")
    test.assertLessEqual((theirs & ~ours).sum(), 0.02 * theirs.sum(), "something is missing")
    both = ours & theirs
    test.assertLess(numpy.median(abs(own[both] - other[both])), 0.02)
