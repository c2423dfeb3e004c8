"""Cameras and objects: what is where in the picture, as Blender and Cycles have it."""

import math
import unittest

import bpy
import numpy
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector
from stage import assert_same_shapes, box, by_cycles, empty_scene, eye, material, mean, plane, render, white, world

from blender import camera, framing, notices


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
