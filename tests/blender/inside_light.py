"""Lights and worlds, against closed forms and Cycles."""

import math
import unittest

import bpy
import numpy
from stage import by_cycles, empty_scene, eye, lamp, mean, plane, render, white, world


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
