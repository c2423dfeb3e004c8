"""The add-on inside Blender: pictures through the engine against closed forms, and against Cycles where both show the same.

Runs under a Python that has `bpy`; `tests/blender.sh` finds one, and the program.
"""

import math
import os
import sys
import tempfile
import unittest
from pathlib import Path

import bpy
import numpy
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import blender
from blender import camera, exr, export, framing, notices, program

FOLDER = tempfile.TemporaryDirectory(prefix="cardioid-test-")


def setUpModule():
    blender.register()
    # Its classes are registered above.
    global engine
    from blender import engine


def tearDownModule():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender.unregister()
    FOLDER.cleanup()


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
    scene.cycles.max_bounces = 32
    scene.cycles.sample_clamp_indirect = 0.0
    found = render()
    scene.render.engine = "CARDIOID"
    return found


def mean(passes, name="Combined", channel=0):
    return float(passes[name][..., channel].mean(dtype=numpy.float64))


class Lights(unittest.TestCase):
    """Radiance of a white Lambertian plane under each light, one metre or more above its middle."""

    def assert_irradiance(self, want, tolerance=0.004, cycles=True):
        plane(white())
        eye()
        world()
        found = render()
        self.assertAlmostEqual(math.pi * mean(found) / want, 1.0, delta=tolerance)
        if cycles:
            self.assertAlmostEqual(mean(by_cycles(256)) / mean(found), 1.0, delta=2 * tolerance)

    def test_point(self):
        empty_scene()
        lamp("POINT", 100.0, color=(1.0, 0.5, 0.25), shadow_soft_size=0.0)
        self.assert_irradiance(100.0 / (4 * math.pi * 9.0))

    def test_colours(self):
        empty_scene()
        lamp("POINT", 100.0, color=(1.0, 0.5, 0.25), shadow_soft_size=0.0)
        plane(white())
        eye()
        world()
        found = render()
        for channel, share in enumerate((1.0, 0.5, 0.25)):
            self.assertAlmostEqual(mean(found, channel=channel), share * 100.0 / (4 * math.pi**2 * 9.0), delta=1e-4)

    def test_point_of_a_size(self):
        empty_scene(extra="--spp 256")
        lamp("POINT", 100.0, shadow_soft_size=0.3)
        # A sphere; Cycles turns a disc to the point that it lights, and is 1 % darker here.
        self.assert_irradiance(100.0 / (4 * math.pi * 9.0), tolerance=0.01)

    def test_spot(self):
        empty_scene()
        lamp("SPOT", 100.0, spot_size=1.0, spot_blend=0.0, shadow_soft_size=0.0)
        self.assert_irradiance(100.0 / (4 * math.pi * 9.0))

    def test_sun(self):
        empty_scene()
        lamp("SUN", 3.0, angle=0.0, turn=(0.5, 0, 0))
        self.assert_irradiance(3.0 * math.cos(0.5))

    def test_wide_sun(self):
        empty_scene(extra="--spp 256")
        lamp("SUN", 3.0, angle=0.6, turn=(0.5, 0, 0))
        self.assert_irradiance(3.0 * math.cos(0.5), tolerance=0.01)

    def test_rectangle(self):
        empty_scene(extra="--spp 256")
        lamp("AREA", 50.0, shape="RECTANGLE", size=2.0, size_y=1.0)
        self.assert_irradiance(rectangle_irradiance(50.0, 2.0, 1.0, 3.0), tolerance=0.01)

    def test_scaled_square(self):
        empty_scene(extra="--spp 256")
        lamp("AREA", 50.0, shape="SQUARE", size=1.0).scale = (2.0, 1.0, 1.0)
        self.assert_irradiance(rectangle_irradiance(50.0, 2.0, 1.0, 3.0), tolerance=0.01)

    def test_disc(self):
        empty_scene(extra="--spp 256")
        lamp("AREA", 50.0, shape="DISK", size=2.0)
        # Radiance P / (pi A) over the projected solid angle of a disc.
        self.assert_irradiance(50.0 / math.pi / (1.0 + 9.0), tolerance=0.01)

    def test_ellipse(self):
        empty_scene(extra="--spp 256")
        lamp("AREA", 50.0, shape="ELLIPSE", size=0.2, size_y=0.1)
        # Far enough to be small: E = P / (pi d^2) up to (size / d)^2.
        self.assert_irradiance(50.0 / math.pi / 9.0, tolerance=0.01)

    def test_area_light_has_one_side(self):
        empty_scene()
        lamp("AREA", 50.0, turn=(math.pi, 0, 0))
        plane(white())
        eye()
        world()
        self.assertEqual(mean(render()), 0.0)

    def test_edge_of_a_spot(self):
        """Along a line from the middle of a soft spot to its edge, at each pixel."""
        empty_scene(size=(40, 1), extra="--spp 16")
        half, blend, height, watts = 0.6, 0.5, 3.0, 100.0
        lamp("SPOT", watts, place=(0, 0, height), spot_size=2 * half, spot_blend=blend, shadow_soft_size=0.0)
        plane(white())
        world()
        # Pixels of 5 cm, from the middle outwards.
        thing = eye(place=(1.0, 0, 100.0), lens=36.0 * 100.0 / 2.0)
        self.assertAlmostEqual(thing.data.sensor_width, 36.0)
        found = render()["Combined"][0, :, 0]
        for pixel, radiance in enumerate(found):
            # The mean over the pixel.
            total = 0.0
            for part in range(20):
                x = 2.0 * (pixel + (part + 0.5) / 20) / 40
                cosine = height / math.hypot(height, x)
                edge = math.cos(half)
                t = min(max((cosine - edge) / ((1.0 - edge) * blend), 0.0), 1.0)
                total += watts / (4 * math.pi) * t * t * (3 - 2 * t) * cosine**3 / height**2 / math.pi / 20
            self.assertAlmostEqual(radiance, total, delta=0.004 + 0.01 * total, msg=f"pixel {pixel}")
        other = by_cycles(256)["Combined"][0, :, 0]
        numpy.testing.assert_allclose(found, other, atol=0.01 * found.max())


def rectangle_irradiance(watts, a, b, height):
    """Irradiance under the middle of a parallel rectangle."""
    x, y = 0.5 * a / height, 0.5 * b / height
    one = x / math.sqrt(1 + x * x) * math.atan(y / math.sqrt(1 + x * x))
    two = y / math.sqrt(1 + y * y) * math.atan(x / math.sqrt(1 + y * y))
    factor = 4 * (one + two) / (2 * math.pi)
    return watts / (a * b) * factor


class World(unittest.TestCase):
    def test_colour_and_strength(self):
        empty_scene()
        plane(white(0.5))
        eye()
        world((0.5, 0.25, 1.0), 3.0)
        found = render()
        for channel, radiance in enumerate((0.5, 0.25, 1.0)):
            self.assertAlmostEqual(mean(found, channel=channel), 0.5 * 3.0 * radiance, delta=0.02 * radiance)

    def environment(self, turn):
        """Colours that tell each direction from all others, seen with a wide lens."""
        scene = empty_scene(size=(24, 12), extra="--spp 64")
        plane(white(), half=0.1, place=(0, 0, -100))
        width, height = 64, 32
        image = bpy.data.images.new("directions", width, height, float_buffer=True)
        rows, columns = numpy.mgrid[0:height, 0:width]
        u, v = (columns + 0.5) / width, (rows + 0.5) / height
        pixels = numpy.stack([1 + numpy.cos(2 * math.pi * u), 1 + numpy.sin(2 * math.pi * u), 2 * v, numpy.ones_like(u)], axis=-1)
        image.pixels.foreach_set(pixels.astype(numpy.float32).reshape(-1))
        tree, background = world(strength=0.5)
        node = tree.nodes.new("ShaderNodeTexEnvironment")
        node.image = image
        tree.links.new(node.outputs["Color"], background.inputs["Color"])
        mapping, place = tree.nodes.new("ShaderNodeMapping"), tree.nodes.new("ShaderNodeTexCoord")
        mapping.inputs["Rotation"].default_value = (0.0, 0.0, turn)
        tree.links.new(place.outputs["Generated"], mapping.inputs["Vector"])
        tree.links.new(mapping.outputs["Vector"], node.inputs["Vector"])
        return scene

    def test_picture_is_where_cycles_has_it(self):
        for turn, heading in ((0.0, 0.0), (0.7, 0.0), (0.7, 2.0), (-1.5, -2.5)):
            self.environment(turn)
            eye(place=(0, 0, 0), turn=(1.4, 0, heading), lens=18.0)
            own, other = render()["Combined"][..., :3], by_cycles(64)["Combined"][..., :3]
            numpy.testing.assert_allclose(own, other, atol=0.02, err_msg=f"turned by {turn}, seen along {heading}")
            self.assertGreater(own.std(), 0.1)


    def test_skies(self):
        """A white ball under each sky is nearly as Cycles has it: as bright on the whole, and lit from the same side."""
        kinds = [item.identifier for item in bpy.types.ShaderNodeTexSky.bl_rna.properties["sky_type"].enum_items]
        self.assertGreaterEqual(len(kinds), 3)
        for kind in kinds:
            for turn in (0.0, 1.0):
                empty_scene(size=(16, 16), extra="--spp 64")
                tree, background = world(strength=0.5)
                node = tree.nodes.new("ShaderNodeTexSky")
                node.sky_type = kind
                if kind in ("HOSEK_WILKIE", "PREETHAM"):
                    node.sun_direction = (0.6, 0.3, 0.5)
                else:
                    node.sun_elevation, node.sun_rotation, node.sun_size = 0.6, 2.0, 0.02
                mapping, place = tree.nodes.new("ShaderNodeMapping"), tree.nodes.new("ShaderNodeTexCoord")
                mapping.inputs["Rotation"].default_value = (0.0, 0.0, turn)
                tree.links.new(place.outputs["Generated"], mapping.inputs["Vector"])
                if "Vector" in node.inputs:
                    tree.links.new(mapping.outputs["Vector"], node.inputs["Vector"])
                tree.links.new(node.outputs["Color"], background.inputs["Color"])
                bpy.ops.mesh.primitive_uv_sphere_add(radius=1.0, segments=64, ring_count=32)
                bpy.context.object.data.materials.append(white())
                bpy.ops.object.shade_smooth()
                eye(place=(0, 0, 20), lens=360.0)
                own, other = render()["Combined"][..., 1], by_cycles(256)["Combined"][..., 1]
                # Where the ball is about level; below the horizon the skies have nothing in common.
                own, other = own[4:12, 4:12], other[4:12, 4:12]
                self.assertAlmostEqual(own.mean() / other.mean(), 1.0, delta=0.15, msg=kind)
                least = 0.7 if kind in ("HOSEK_WILKIE", "PREETHAM") else 0.95
                self.assertGreater(numpy.corrcoef(own.ravel(), other.ravel())[0, 1], least, kind)


class Camera(unittest.TestCase):
    def test_corners_are_where_blender_has_them(self):
        """Points of space in the pixels that Blender's own projection gives, for all kinds of sensors and shifts of whole pixels."""
        point = Vector((0.3, -0.2, 0.4))
        for size in ((160, 90), (90, 160), (100, 100)):
            for fit in ("AUTO", "HORIZONTAL", "VERTICAL"):
                for shift in ((0.0, 0.0), (0.1, -0.2), (-0.3, 0.05)):
                    scene = empty_scene(size)
                    thing = eye(place=(1, -4, 2), turn=(1.1, 0.1, 0.2), lens=35.0)
                    data = thing.data
                    data.sensor_fit, data.sensor_width, data.sensor_height = fit, 32.0, 20.0
                    fitted = {"AUTO": max(size), "HORIZONTAL": size[0], "VERTICAL": size[1]}[fit]
                    whole = [round(part * fitted) / fitted for part in shift]
                    data.shift_x, data.shift_y = whole
                    bpy.context.view_layer.update()
                    want = world_to_camera_view(scene, thing, point)
                    told = notices.Notices()
                    frame, table = camera.frame_and_table("eye", data, [tuple(row) for row in thing.matrix_world], size, None, told)
                    column, row = framing.place(table, frame, (point.x, point.z, -point.y))
                    column, row = column - frame.window[0], row - frame.window[1]
                    self.assertAlmostEqual(column, want.x * size[0], delta=0.01, msg=f"{size} {fit} {shift}")
                    self.assertAlmostEqual(size[1] - row, want.y * size[1], delta=0.01, msg=f"{size} {fit} {shift}")
                    self.assertEqual(frame.window[2] - frame.window[0], size[0])

    def test_a_shifted_picture_is_that_of_cycles(self):
        scene = empty_scene((48, 32), extra="--spp 16")
        scene.view_layers[0].use_pass_z = True
        box(white(), (-1, -1, -1), (1, 1, 1))
        thing = eye(place=(3, -5, 2), turn=(1.2, 0.0, 0.5), lens=30.0)
        thing.data.shift_x, thing.data.shift_y = 4 / 48, -3 / 48
        world((1, 1, 1))
        own, other = render()["Depth"][..., 0], by_cycles(1)["Depth"][..., 0]
        assert_same_shapes(self, own, other)

    def test_depth_of_field_of_a_far_emitter(self):
        """A small bright square out of focus becomes a disc of the radius that the lens says."""
        empty_scene((32, 32), extra="--spp 1600")
        look = material("glow", "ShaderNodeEmission", Strength=1000.0)
        plane(look, half=0.1, place=(0, 0, -10.0))
        data = eye(place=(0, 0, 0), lens=50.0).data
        data.dof.use_dof, data.dof.aperture_fstop, data.dof.focus_distance = True, 0.125, 2.0
        world()
        found = render()["Combined"][..., 0].astype(float)
        pixel = 10.0 * 36.0 / 50.0 / 32
        # At 10 m: lens radius times (10 - 2) / 2.
        radius = 0.05 / (2 * 0.125) * 4.0 / pixel
        y, x = numpy.mgrid[0:32, 0:32] - 15.5
        moment = (found * (x * x + y * y)).sum() / found.sum()
        # The mean square of the distance in a disc is half its radius squared; those of the square and of a pixel are added.
        moment -= ((0.2 / pixel) ** 2 + 1.0) / 6
        self.assertAlmostEqual(math.sqrt(2 * moment), radius, delta=0.03 * radius)
        self.assertGreater(radius, 3.0)

    def test_orthographic_and_panoramic_cameras(self):
        """Glowing boxes all around, as Cycles has them, and their depths."""
        for size, kind, values in (
            ((48, 32), "ORTHO", dict(ortho_scale=9.0, shift_x=6 / 48)),
            ((32, 48), "ORTHO", dict(ortho_scale=9.0, sensor_fit="HORIZONTAL")),
            ((96, 48), "PANO", dict(panorama_type="EQUIRECTANGULAR")),
            ((64, 64), "PANO", dict(panorama_type="FISHEYE_EQUIDISTANT", fisheye_fov=3.5)),
        ):
            with self.subTest(kind, size=size, **values):
                scene = empty_scene(size, extra="--spp 64")
                scene.view_layers[0].use_pass_z = True
                for number, place in enumerate(((3, 0, 0), (-1, 4, 1), (-3, -3, -1), (0, 1, 4), (1, -1, -3), (2, -4, 2))):
                    glow = material(f"glow {number}", "ShaderNodeEmission", Strength=number + 1.0)
                    box(glow, [x - 0.5 for x in place], [x + 0.5 for x in place])
                thing = eye(place=(0.2, -0.3, 0.1) if kind == "PANO" else (0, -8, 2), turn=(1.3, 0.2, 0.4))
                thing.data.type = kind
                for key, value in values.items():
                    setattr(thing.data, key, value)
                world()
                own, other = render(), by_cycles(256)
                seen = other["Combined"][..., 0]
                self.assertGreater((seen > 0).sum(), 60)
                self.assertLess(numpy.abs(own["Combined"][..., 0] - seen).mean(), 0.03 * seen.mean())
                both = (own["Depth"] < 100) & (other["Depth"] < 100)
                self.assertLess(numpy.median(abs(own["Depth"] - other["Depth"])[both]), 0.02)

    def test_others_are_refused(self):
        empty_scene()
        plane(white())
        data = eye().data
        data.type, data.panorama_type = "PANO", "MIRRORBALL"
        with self.assertRaisesRegex(RuntimeError, "camera 'eye' is a panorama of the kind MIRRORBALL"):
            render()
        bpy.context.scene.camera = None
        with self.assertRaisesRegex(RuntimeError, "(?i)no camera"):
            render()


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


class Surfaces(unittest.TestCase):
    def through_slab(self, kind, inside=None, **values):
        """Share of an emitter's radiance that passes a slab of 10 cm at right angles."""
        empty_scene(extra="--spp 256")
        look = material("slab", kind, **values)
        if inside:
            tree = look.node_tree
            if len(inside) == 3:
                volume = tree.nodes.new("ShaderNodeVolumeCoefficients")
                volume.inputs["Absorption Coefficients"].default_value = inside
                volume.inputs["Scatter Coefficients"].default_value = (0, 0, 0)
            else:
                volume = tree.nodes.new("ShaderNodeVolumeAbsorption")
                volume.inputs["Color"].default_value, volume.inputs["Density"].default_value = (*inside[0], 1.0), inside[1]
            output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
            tree.links.new(volume.outputs[0], output.inputs["Volume"])
        box(look, (-1, -1, 0), (1, 1, 0.1))
        plane(material("glow", "ShaderNodeEmission", Strength=2.0), half=0.5, place=(0, 0, -1))
        world()
        eye(place=(0, 0, 2))
        found = render()
        self.assertAlmostEqual(mean(by_cycles(256)) / mean(found), 1.0, delta=0.03)
        return [mean(found, channel=channel) / 2.0 for channel in range(3)]

    @staticmethod
    def slab(ior, passed=1.0):
        """All reflections between the two sides of a slab that lets this share pass between them."""
        r = ((ior - 1) / (ior + 1)) ** 2
        return (1 - r) ** 2 * passed / (1 - (r * passed) ** 2)

    def test_glass(self):
        passed = self.through_slab("ShaderNodeBsdfGlass", Color=(1, 1, 1, 1), Roughness=0.0, IOR=1.5)
        self.assertAlmostEqual(passed[0], self.slab(1.5), delta=0.01)

    def test_principled_glass_of_another_index(self):
        passed = self.through_slab(
            "ShaderNodeBsdfPrincipled", Base_Color=(1, 1, 1, 1), Roughness=0.0, IOR=2.0, Transmission_Weight=1.0
        )
        self.assertAlmostEqual(passed[0], self.slab(2.0), delta=0.01)

    def test_coloured_glass(self):
        """A glass shader tints at each of the two borders, a principled one by the root of its colour."""
        passed = self.through_slab("ShaderNodeBsdfGlass", Color=(0.8, 0.5, 0.2, 1), Roughness=0.0, IOR=1.0001)
        numpy.testing.assert_allclose(passed, [0.64, 0.25, 0.04], atol=0.01)
        passed = self.through_slab(
            "ShaderNodeBsdfPrincipled", Base_Color=(0.8, 0.5, 0.2, 1), Roughness=0.0, IOR=1.0001, Transmission_Weight=1.0
        )
        numpy.testing.assert_allclose(passed, [0.8, 0.5, 0.2], atol=0.01)

    def test_absorption(self):
        inside = ((0.9, 0.5, 0.1), 10.0)
        want = [math.exp(-10.0 * (1 - channel) * 0.1) for channel in inside[0]]
        passed = self.through_slab("ShaderNodeBsdfGlass", inside, Color=(1, 1, 1, 1), Roughness=0.0, IOR=1.5)
        numpy.testing.assert_allclose(passed, [self.slab(1.5, share) for share in want], atol=0.01)
        passed = self.through_slab(
            "ShaderNodeBsdfPrincipled", inside, Base_Color=(0.8, 0.5, 0.2, 1), Roughness=0.0, IOR=1.0001, Transmission_Weight=1.0
        )
        numpy.testing.assert_allclose(passed, [share * tint for share, tint in zip(want, (0.8, 0.5, 0.2))], atol=0.01)

    def test_absorption_by_coefficients(self):
        if bpy.app.version < (5, 0, 0):
            self.skipTest("Blender 4.2 has no node of coefficients")
        passed = self.through_slab("ShaderNodeBsdfGlass", (1.0, 5.0, 9.0), Color=(1, 1, 1, 1), Roughness=0.0, IOR=1.5)
        numpy.testing.assert_allclose(passed, [self.slab(1.5, math.exp(-0.1 * c)) for c in (1.0, 5.0, 9.0)], atol=0.01)

    def test_open_meshes_are_sheets_or_borders(self):
        """A ray through one plane of glass at 45 degrees is bent where the material is the border of a body."""
        told = []
        for is_border in (False, True):
            empty_scene(extra="--spp 16")
            look = material("glass", "ShaderNodeBsdfGlass", Color=(1, 1, 1, 1), Roughness=0.0, IOR=1.5)
            look.cardioid.is_border = is_border
            plane(look, half=5.0)
            # Below, radiance tells the place along x.
            for cell in range(40):
                x = -2.0 + 0.1 * cell
                strip = material(f"strip {cell}", "ShaderNodeEmission", Strength=float(cell + 1))
                mesh(f"strip {cell}", [(x, -1, -1), (x + 0.1, -1, -1), (x + 0.1, 1, -1), (x, 1, -1)], [(0, 1, 2, 3)], strip)
            world()
            eye(place=(-1, 0, 1), turn=(0, -math.pi / 4, 0), lens=20000.0)
            told.append(mean(render()))
        # The ray meets the plane at x = 0 and goes on straight to x = 1, the strip of radiance 31, or bent to x = 0.535, that of 26.
        # A sheet reflects 4 to 10 %. Out of glass comes its radiance over the square of the index.
        reflected = 0.5 * (0.3034**2 + 0.0920**2)
        self.assertAlmostEqual(told[0] / 31.0, 0.93, delta=0.04)
        self.assertAlmostEqual(told[1], 26.0 * (1 - reflected) / 1.5**2, delta=0.3)

    def test_emission(self):
        empty_scene()
        plane(material("glow", "ShaderNodeBsdfPrincipled", Base_Color=(0, 0, 0, 1), Emission_Color=(1, 0.5, 0.25, 1), Emission_Strength=3.0))
        world()
        eye()
        found = render()
        for channel, radiance in enumerate((3.0, 1.5, 0.75)):
            self.assertAlmostEqual(mean(found, channel=channel), radiance, delta=1e-4)

    def test_glossy_and_diffuse_under_a_white_sky(self):
        """What reflects a share of all light at all angles shows that share of the sky."""
        for kind, share in (("ShaderNodeBsdfGlossy", 0.6), ("ShaderNodeBsdfDiffuse", 0.3)):
            empty_scene()
            plane(material("look", kind, Color=(share, share, share, 1), Roughness=0.0))
            world((1, 1, 1))
            eye(place=(0, 0, 1), turn=(0.5, 0, 0))
            self.assertAlmostEqual(mean(render()), share, delta=0.01, msg=kind)

    def picture(self, name, function, colour=True):
        """An image of 16 x 16 pixels of bytes."""
        image = bpy.data.images.new(name, 16, 16)
        image.colorspace_settings.name = "sRGB" if colour else "Non-Color"
        rows, columns = numpy.mgrid[0:16, 0:16]
        pixels = numpy.ones((16, 16, 4), numpy.float32)
        pixels[..., :3] = function(columns / 15.0, rows / 15.0)
        image.pixels.foreach_set(pixels.reshape(-1))
        return image

    def test_pictures_are_where_cycles_has_them(self):
        """A picture that tells its place, moved, turned and scaled by a mapping node."""
        for turn, place, scale in ((0.0, (0, 0, 0), (1, 1, 1)), (0.6, (0.2, 0.1, 0), (0.5, 0.8, 1.0))):
            empty_scene(size=(24, 24), extra="--spp 16")
            image = self.picture("place", lambda x, y: numpy.stack([x, y, 0.5 + 0 * x], axis=-1))
            look = material("look", "ShaderNodeEmission")
            tree = look.node_tree
            node, mapping, where = (tree.nodes.new(kind) for kind in ("ShaderNodeTexImage", "ShaderNodeMapping", "ShaderNodeTexCoord"))
            node.image = image
            mapping.inputs["Location"].default_value, mapping.inputs["Scale"].default_value = place, scale
            mapping.inputs["Rotation"].default_value = (0, 0, turn)
            tree.links.new(where.outputs["UV"], mapping.inputs["Vector"])
            tree.links.new(mapping.outputs["Vector"], node.inputs["Vector"])
            emission = next(node for node in tree.nodes if node.type == "EMISSION")
            tree.links.new(node.outputs["Color"], emission.inputs["Color"])
            thing = plane(look, half=1.0)
            uvs = thing.data.uv_layers.new(name="UVMap")
            for corner, uv in enumerate(((0, 0), (0.5, 0), (0.5, 0.5), (0, 0.5))):
                uvs.uv[corner].vector = uv
            world()
            eye(place=(0, 0, 2), lens=36.0)
            own, other = render()["Combined"][..., :3], by_cycles(64)["Combined"][..., :3]
            self.assertGreater(own.std(), 0.05)
            # Pixels on edges between texels differ by the reconstruction.
            self.assertLess(numpy.abs(own - other).mean(), 0.01, f"turned by {turn}")

    def test_colours_of_vertices(self):
        for domain, kind in (("POINT", "FLOAT_COLOR"), ("CORNER", "BYTE_COLOR")):
            empty_scene(size=(24, 24), extra="--spp 16")
            look = white()
            tree = look.node_tree
            node = tree.nodes.new("ShaderNodeVertexColor")
            node.layer_name = "paint"
            diffuse = next(node for node in tree.nodes if node.type == "BSDF_DIFFUSE")
            tree.links.new(node.outputs["Color"], diffuse.inputs["Color"])
            thing = plane(look, half=1.0)
            colours = thing.data.color_attributes.new("paint", kind, domain)
            for place, colour in enumerate(((0.9, 0.1, 0.1), (0.1, 0.8, 0.1), (0.1, 0.1, 0.7), (0.5, 0.5, 0.5))):
                colours.data[place].color = (*colour, 1.0)
            world((1, 1, 1))
            eye(place=(0, 0, 2), lens=36.0)
            own, other = render()["Combined"][..., :3], by_cycles(64)["Combined"][..., :3]
            self.assertGreater(own.std(), 0.05)
            self.assertLess(numpy.abs(own - other).mean(), 0.02, domain)

    def test_what_is_not_modelled_is_told(self):
        scene = empty_scene()
        look = material("odd", "ShaderNodeBsdfPrincipled", Subsurface_Weight=0.5)
        tree = look.node_tree
        noise = tree.nodes.new("ShaderNodeTexNoise")
        principled = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
        tree.links.new(noise.outputs[0], principled.inputs["Roughness"])
        plane(look)
        lamp("SPOT", 10.0, shadow_soft_size=0.1)
        eye()
        world()
        scene.render.use_motion_blur = True
        # One lamp in the picture, one behind the camera.
        lamp("AREA", 10.0, place=(0, 0, 0.5), turn=(math.pi, 0, 0), size=0.001)
        lamp("AREA", 10.0, place=(0, 0, 2.0), size=0.001)
        told = notices.Notices()
        with tempfile.TemporaryDirectory() as folder:
            export.write(bpy.context.evaluated_depsgraph_get(), folder, (8, 8), None, told)
        lines = "\n".join(told.lines())
        for part in (
            "material 'odd': Roughness comes from the node 'Noise Texture', which is not modelled; 0.5 is used",
            "material 'odd': subsurface scattering is not modelled",
            "light 'SPOT': the size of a spot is not modelled",
            "motion blur is not modelled",
            "light 'AREA': the camera may see it as a bright shape",
        ):
            self.assertIn(part, lines)
        self.assertEqual(len(told), 5, lines)


class Objects(unittest.TestCase):
    def depths(self, build):
        """The depths that the program finds are those of Cycles."""
        scene = empty_scene((80, 60), extra="--spp 16")
        scene.view_layers[0].use_pass_z = True
        build(scene)
        eye(place=(0, 0, 10), lens=50.0)
        world((1, 1, 1))
        own, other = render()["Depth"][..., 0], by_cycles(1)["Depth"][..., 0]
        assert_same_shapes(self, own, other)

    def test_modifiers_as_they_render(self):
        def build(_scene):
            thing = box(white(), (-0.5, -0.5, 0), (0.5, 0.5, 1))
            array = thing.modifiers.new("array", "ARRAY")
            array.count, array.relative_offset_displace = 3, (1.5, 0, 0)
            subdivided = thing.modifiers.new("round", "SUBSURF")
            subdivided.levels, subdivided.render_levels = 0, 3

        self.depths(build)

    def test_instances_of_a_collection(self):
        def build(scene):
            group = bpy.data.collections.new("group")
            thing = box(white(), (-0.3, -0.3, 0), (0.3, 0.3, 0.5))
            scene.collection.objects.unlink(thing)
            group.objects.link(thing)
            for place in range(3):
                empty = bpy.data.objects.new(f"place {place}", None)
                empty.instance_type, empty.instance_collection = "COLLECTION", group
                empty.location, empty.rotation_euler = (1.5 * place - 1.5, 0.3 * place, 0), (0, 0, 0.4 * place)
                empty.scale = (1, 1, 1 + place) if place < 2 else (-1, 1, 2)
                scene.collection.objects.link(empty)

        self.depths(build)

    def test_text_and_curves(self):
        def build(scene):
            text = bpy.data.curves.new("text", "FONT")
            text.body, text.extrude, text.size = "cardioid", 0.1, 1.2
            thing = bpy.data.objects.new("text", text)
            thing.location = (-2, 0, 0)
            scene.collection.objects.link(thing)
            curve = bpy.data.curves.new("curve", "CURVE")
            curve.dimensions, curve.bevel_depth = "3D", 0.2
            spline = curve.splines.new("POLY")
            spline.points.add(1)
            spline.points[0].co, spline.points[1].co = (-2, -1, 0, 1), (2, -1.5, 1, 1)
            scene.collection.objects.link(bpy.data.objects.new("curve", curve))

        self.depths(build)

    def test_hidden_objects_are_not_there(self):
        empty_scene()
        plane(white(), place=(0, 0, 0.5)).hide_render = True
        plane(material("glow", "ShaderNodeEmission", Strength=2.0))
        eye()
        world()
        self.assertAlmostEqual(mean(render()), 2.0, delta=1e-4)


class Passes(unittest.TestCase):
    def stage(self, **settings):
        scene = empty_scene((32, 24), **settings)
        layer = scene.view_layers[0]
        layer.use_pass_z = layer.use_pass_normal = layer.use_pass_diffuse_color = True
        plane(white(0.5), half=3.0)
        ball = material("glass", "ShaderNodeBsdfGlass", Color=(1, 1, 1, 1), Roughness=0.0, IOR=1.5)
        bpy.ops.mesh.primitive_uv_sphere_add(radius=0.5, location=(0, 0, 0.5))
        bpy.context.object.data.materials.append(ball)
        bpy.ops.object.shade_smooth()
        lamp("AREA", 40.0, place=(1, 1, 3), turn=(0.3, -0.3, 0), size=0.5)
        world((0.1, 0.2, 0.3))
        eye(place=(0, -4, 2.5), turn=(1.05, 0, 0), lens=35.0)
        return scene

    def test_light_adds_up(self):
        self.stage(integrator="photon-map", extra="")
        found = render()
        total = sum(found[name].astype(numpy.float64) for name in ("emission", "direct", "specular", "caustics", "indirect"))
        numpy.testing.assert_allclose(found["Combined"][..., :3], total, rtol=1e-5, atol=1e-6)
        self.assertEqual(found["Combined"][..., 3].min(), 1.0)
        # The ball casts a caustic, and is seen.
        self.assertGreater(found["caustics"].max(), 0.1)
        self.assertGreater(found["specular"].max(), 0.1)

    def test_depth_normal_and_albedo_are_those_of_blender(self):
        self.stage(extra="--spp 16")
        own, other = render(), by_cycles(1)
        albedo = next(name for name in own if name in ("DiffCol", "Diffuse Color"))
        # On the plane, away from the ball and from edges.
        flat = other["Normal"][..., 2] > 0.999
        self.assertGreater(flat.sum(), 100)
        self.assertLess(numpy.median(abs(own["Depth"] - other["Depth"])[flat]), 0.02)
        self.assertLess(numpy.median(abs(own["Normal"] - other["Normal"])[flat]), 0.001)
        self.assertLess(numpy.median(abs(own[albedo] - other[albedo])[flat]), 0.001)
        far = other["Depth"][..., 0] > 1e9
        self.assertTrue((own["Depth"][..., 0][far] > 1e9).mean() > 0.9)
        # Normals of the ball point to all sides.
        ball = (other["Normal"][..., 2] < 0.9) & ~far
        self.assertLess(numpy.median(abs(own["Normal"] - other["Normal"])[ball]), 0.1)

    def test_view_layers_have_their_own_objects(self):
        scene = empty_scene(extra="--spp 4")
        hidden = bpy.data.collections.new("hidden")
        scene.collection.children.link(hidden)
        near = plane(material("near", "ShaderNodeEmission", Strength=3.0), place=(0, 0, 0.5))
        scene.collection.objects.unlink(near)
        hidden.objects.link(near)
        plane(material("far", "ShaderNodeEmission", Strength=2.0))
        eye()
        world()
        second = scene.view_layers.new("second")
        second.layer_collection.children["hidden"].exclude = True
        found = render()
        self.assertAlmostEqual(mean(found), 3.0, delta=1e-4)
        self.assertAlmostEqual(mean(found, "second.Combined"), 2.0, delta=1e-4)
        self.assertAlmostEqual(mean(found, "second.emission"), 2.0, delta=1e-4)

    def test_a_border_has_the_same_pixels(self):
        self.stage(integrator="photon-map", extra="")
        whole = render()["Combined"]
        # Borders are shares in single precision: these are exact.
        border = {"border_min_x": 0.25, "border_max_x": 0.75, "border_min_y": 0.25, "border_max_y": 0.625}
        part = render(use_border=True, use_crop_to_border=True, **border)["Combined"]
        self.assertEqual(part.shape, (9, 16, 4))
        numpy.testing.assert_array_equal(part, whole[9:18, 8:24])
        beside = render(use_border=True, use_crop_to_border=False, **border)["Combined"]
        self.assertEqual(beside.shape, whole.shape)
        numpy.testing.assert_array_equal(beside[9:18, 8:24], whole[9:18, 8:24])
        self.assertEqual(beside[:9].max(), 0.0)

    def test_rounds_end_as_if_they_never_stopped(self):
        scene = self.stage(integrator="progressive", extra="")
        scene.cardioid.rounds = 5
        with tempfile.TemporaryDirectory() as folder:
            scene.cardioid.folder = folder
            found = render()["Combined"][..., :3]
            from subprocess import run

            alone = os.path.join(folder, "alone.exr")
            run(
                ["cardioid", "render", "-q", os.path.join(folder, "scene.toml"), "-o", alone]
                + ["--quality", "draft", "--integrator", "progressive", "--rounds", "5"],
                check=True,
            )
            channels = exr.read(alone).channels
            numpy.testing.assert_array_equal(found, numpy.stack([channels[c] for c in "RGB"], axis=-1))
            # A second frame starts anew.
            numpy.testing.assert_array_equal(render()["Combined"][..., :3], found)

    def test_frames_of_an_animation(self):
        scene = self.stage(extra="--spp 4")
        thing = bpy.data.objects["AREA"]
        thing.data.energy = 0.0
        thing.data.keyframe_insert("energy", frame=1)
        thing.data.energy = 80.0
        thing.data.keyframe_insert("energy", frame=2)
        world()
        scene.frame_set(1)
        self.assertEqual(mean(render()), 0.0)
        scene.frame_set(2)
        self.assertGreater(mean(render()), 0.05)


class Page(unittest.TestCase):
    def test_the_glass_of_the_page(self):
        """The script of docs/blender.md makes a scene that is modelled as a whole, with a caustic in the shadow of the glass."""
        bpy.ops.wm.read_factory_settings()
        text = (ROOT / "docs/blender.md").read_text(encoding="utf-8")
        script = text.split("```python\n")[1].split("```")[0]
        exec(compile(script, "docs/blender.md", "exec"), {})
        scene = bpy.context.scene
        scene.cardioid.quality = "draft"
        scene.render.resolution_percentage = 10
        told = notices.Notices()
        with tempfile.TemporaryDirectory() as folder:
            export.write(bpy.context.evaluated_depsgraph_get(), folder, (64, 48), None, told)
        self.assertEqual(told.lines(), [])
        found = render()
        self.assertEqual(found["caustics"].shape, (48, 64, 3))
        # Below the glass and to the right of it.
        self.assertGreater(found["caustics"][30:, 30:, 1].max(), 0.3 * found["direct"][..., 1].max())


class Extension(unittest.TestCase):
    def test_installed_from_the_zip(self):
        """Blender installs what `make blender` packs, renders with it, and disables it."""
        if bpy.app.binary_path:
            self.skipTest("a Blender of its own is started for this by the module bpy alone")
        from subprocess import PIPE, STDOUT, run

        with tempfile.TemporaryDirectory() as folder:
            run([sys.executable, str(ROOT / "blender/pack.py"), folder], check=True, stdout=PIPE)
            (archive,) = Path(folder).glob("*.zip")
            environment = os.environ | {"BLENDER_USER_RESOURCES": folder}
            done = run([sys.executable, "-c", INSTALL, str(archive)], env=environment, stdout=PIPE, stderr=STDOUT, text=True)
        self.assertIn("installed and rendered", done.stdout, done.stdout)
        self.assertNotIn("Traceback", done.stdout)


INSTALL = """
import os, sys, bpy, addon_utils
bpy.ops.extensions.package_install_files(filepath=sys.argv[1], repo="user_default", enable_on_install=True)
name = "bl_ext.user_default.cardioid"
scene = bpy.context.scene
scene.render.engine, scene.cardioid.quality = "CARDIOID", "draft"
scene.render.resolution_x = scene.render.resolution_y = 8
bpy.ops.mesh.primitive_plane_add()
eye = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
eye.location = (0, 0, 3)
scene.collection.objects.link(eye)
scene.camera = eye
# The path of the preferences goes over that of the environment.
preferences = bpy.context.preferences.addons[name].preferences
preferences.program = "/nowhere/cardioid"
try:
    bpy.ops.render.render()
except RuntimeError as error:
    assert "there is no program /nowhere/cardioid" in str(error), error
else:
    raise AssertionError("rendered without the program")
preferences.program = ""
assert bpy.ops.render.render() == {"FINISHED"}
addon_utils.disable(name)
assert not hasattr(scene, "cardioid") and scene.render.engine != "CARDIOID"
print("installed and rendered", flush=True)
os._exit(0)
"""


class Errors(unittest.TestCase):
    def stage(self):
        scene = empty_scene()
        plane(white())
        eye()
        world((1, 1, 1))
        return scene

    def test_what_the_program_refuses(self):
        self.stage().cardioid.extra = "--spp many"
        with self.assertRaisesRegex(RuntimeError, "--spp"):
            render()

    def test_no_program(self):
        self.stage()
        path = os.environ["PATH"]
        os.environ["PATH"] = ""
        try:
            with self.assertRaisesRegex(RuntimeError, "cardioid is not on PATH; install it"):
                render()
        finally:
            os.environ["PATH"] = path

    def test_cancelled(self):
        """Esc ends the program at once and removes its files."""
        scene = self.stage()
        scene.cardioid.quality, scene.cardioid.extra = "reference", "--spp 1000000"
        runs = []

        class Run(program.Run):
            def __init__(self, line, folder=None):
                super().__init__(line, folder)
                runs.append((self, line[2]))

        class Engine:
            """What Blender gives an engine, with Esc pressed once pixels are rendered."""

            render, _render, _fail = (getattr(engine.CardioidRenderEngine, name) for name in ("render", "_render", "_fail"))

            def report(self, kind, text):
                told.append((kind, text))

            def update_stats(self, *_):
                pass

            def update_progress(self, _):
                pass

            def test_break(self):
                return runs[0][0].step == "rendering"

        told, before = [], program.Run
        program.Run = Run
        try:
            Engine().render(bpy.context.evaluated_depsgraph_get())
        finally:
            program.Run = before
        self.assertEqual(told, [])
        [(run, path)] = runs
        self.assertIsNotNone(run.poll())
        self.assertFalse(os.path.exists(os.path.dirname(path)), path)

    def test_temporary_files_are_removed(self):
        before = {name for name in os.listdir(tempfile.gettempdir()) if name.startswith("cardioid-")}
        self.stage()
        render()
        bpy.context.scene.cardioid.extra = "--spp many"
        with self.assertRaises(RuntimeError):
            render()
        after = {name for name in os.listdir(tempfile.gettempdir()) if name.startswith("cardioid-")}
        self.assertEqual(before, after)


if __name__ == "__main__":
    # `blender --background --python FILE -- ARGUMENTS` keeps its own arguments.
    own = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else ([] if bpy.app.binary_path else sys.argv[1:])
    done = unittest.main(argv=["in_blender.py"] + own, exit=False)
    sys.stdout.flush()
    os._exit(0 if done.result.wasSuccessful() else 1)
