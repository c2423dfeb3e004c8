"""The engine: passes, borders, rounds, frames, cancelling, errors, and the add-on as it is installed."""

import os
import sys
import tempfile
import unittest
from pathlib import Path

import bpy
import numpy
from stage import ROOT, by_cycles, empty_scene, eye, lamp, material, mean, plane, render, white, world

import blender
from blender import engine, exr, export, notices, panels, program


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
        third = scene.view_layers.new("third")
        third.material_override = material("over", "ShaderNodeEmission", Strength=5.0)
        found = render()
        self.assertAlmostEqual(mean(found, "third.Combined"), 5.0, delta=1e-4)
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
        scene = self.stage(integrator="progressive", extra="--global-photons 3000 --caustic-photons 3000")
        scene.cardioid.rounds = 18
        with tempfile.TemporaryDirectory() as folder:
            scene.cardioid.folder = folder
            found = render()["Combined"][..., :3]
            from subprocess import run

            alone = os.path.join(folder, "alone.exr")
            run(
                ["cardioid", "render", "-q", os.path.join(folder, "scene.toml"), "-o", alone]
                + ["--quality", "draft", "--integrator", "progressive", "--rounds", "18"]
                + scene.cardioid.extra.split(),
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


class Panels(unittest.TestCase):
    def test_blenders_panels(self):
        """Those of lights, materials, worlds and cameras are shown, and none twice."""
        blender.unregister()
        import bl_ui

        before = {panel.__name__ for panel in self.shown()}
        blender.register()
        shown = {panel.__name__ for panel in self.shown()}
        self.assertEqual(before, set())
        for name in panels._OF_EEVEE + ("RENDER_PT_format", "RENDER_PT_color_management", "DATA_PT_lens", "DATA_PT_spot"):
            self.assertIn(name, shown)
        self.assertFalse([name for name in shown if "freestyle" in name])
        self.assertNotIn("DATA_PT_light", shown)
        self.assertIsNotNone(bl_ui)

    @staticmethod
    def shown():
        return [p for p in bpy.types.Panel.__subclasses__() if "CARDIOID" in getattr(p, "COMPAT_ENGINES", ())]


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
        """After a frame, and after an error."""
        self.stage()
        with tempfile.TemporaryDirectory() as folder:
            before, tempfile.tempdir = tempfile.tempdir, folder
            try:
                render()
                bpy.context.scene.cardioid.extra = "--spp many"
                with self.assertRaises(RuntimeError):
                    render()
                self.assertEqual(os.listdir(folder), [])
            finally:
                tempfile.tempdir = before
