"""The parts of the add-on that need no Blender: `python3 -m unittest discover -s tests/blender`."""

import json
import math
import os
import struct
import sys
import tempfile
import time
import unittest
from pathlib import Path
from types import SimpleNamespace

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from blender import camera, framing, glb, lamps, nodes, notices, program, surface, toml_text, units, world

try:
    import numpy

    from blender import exr, passes, pictures
except ImportError:
    numpy = None

try:
    import tomllib
except ImportError:
    tomllib = None

UPRIGHT = [(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)]


def placed(x, y, z):
    return [(1, 0, 0, x), (0, 1, 0, y), (0, 0, 1, z), (0, 0, 0, 1)]


class Units(unittest.TestCase):
    def test_flux_comes_out(self):
        """The flux of what stands for a light is its watts."""
        self.assertAlmostEqual(4 * math.pi * units.point_intensity(60.0), 60.0)
        # Each square metre of a sphere sends out pi times its radiance.
        self.assertAlmostEqual(math.pi * units.sphere_radiance(60.0, 0.3) * 4 * math.pi * 0.3**2, 60.0)
        self.assertAlmostEqual(math.pi * units.area_radiance(60.0, 0.5) * 0.5, 60.0)

    def test_absorption(self):
        self.assertEqual(units.absorption((1.0, 0.75, 0.0), 2.0), (0.0, 0.5, 2.0))
        self.assertEqual(units.absorption((1.5, 0.5, -1.0), 2.0), (0.0, 1.0, 2.0))
        self.assertEqual(units.absorption((0.5, 0.5, 0.5), -1.0), (0.0, 0.0, 0.0))

    def test_profile_of_a_spot(self):
        """Between its angles, which are interpolated, the file is as the formula to a thousandth."""
        for half, blend in ((0.6, 0.5), (0.2, 1.0), (math.pi / 2, 0.15), (0.05, 0.01)):
            lines = units.spot_profile(half, blend).split("\n")
            self.assertEqual(lines[:2], ["IESNA:LM-63-2002", "TILT=NONE"])
            numbers = [float(word) for word in " ".join(lines[3:]).split()]
            count = int(lines[2].split()[3])
            angles, candelas = numbers[3 : 3 + count], numbers[4 + count :]
            self.assertEqual((angles[0], angles[-1], len(candelas)), (0.0, 90.0, count))
            self.assertEqual(angles, sorted(set(angles)))
            for i in range(2000):
                angle = 90.0 * i / 2000
                # A hard edge lies between two angles.
                after = next(k for k, known in enumerate(angles) if known > angle)
                share = (angle - angles[after - 1]) / (angles[after] - angles[after - 1])
                candela = candelas[after - 1] + share * (candelas[after] - candelas[after - 1])
                want = units.spot_falloff(math.cos(math.radians(angle)), half, blend)
                self.assertAlmostEqual(candela / 683.0, want, delta=1e-3, msg=f"{half} {blend} {angle}")


class Toml(unittest.TestCase):
    @unittest.skipUnless(tomllib, "Python before 3.11 has no reader of TOML")
    def test_what_is_written_is_read(self):
        table = {"name": 'a "b" \\ c\nd\x07', "x": 1e-30, "n": 3, "list": [1.0, [2.0, 3.5e20]], "yes": True, "in": {"a": 0.1}}
        text = toml_text.document([("[first]", table), ("[[many]]", {"a": 1}), ("[[many]]", {"a": 2})], [("name", "x")])
        self.assertEqual(tomllib.loads(text), {"name": "x", "first": table, "many": [{"a": 1}, {"a": 2}]})

    def test_dollars_are_no_parameters(self):
        self.assertEqual(toml_text.string("${a}"), '"$${a}"')

    def test_infinity_is_refused(self):
        with self.assertRaises(ValueError):
            toml_text.value(math.inf)


class Framing(unittest.TestCase):
    def test_field_of_view(self):
        # 50 mm on a sensor of 36 mm by 24 mm: 39.6 degrees across.
        frame = framing.frame_of(framing.Lens(50.0), 1920, 1080)
        across = 2 * math.degrees(math.atan(math.tan(math.radians(frame.fov / 2)) * 1920 / 1080))
        self.assertAlmostEqual(across, 39.5978, places=3)
        upright = framing.frame_of(framing.Lens(50.0), 1080, 1920)
        self.assertAlmostEqual(upright.fov, 39.5978, places=3)
        vertical = framing.frame_of(framing.Lens(50.0, sensor_fit="VERTICAL"), 1920, 1080)
        self.assertAlmostEqual(vertical.fov, 2 * math.degrees(math.atan(12 / 50)), places=6)
        self.assertTrue(frame.is_whole)

    def test_shift_is_a_window_of_a_larger_picture(self):
        frame = framing.frame_of(framing.Lens(36.0, shift_x=0.1, shift_y=-0.05), 200, 100)
        # 20 pixels to the right, 10 down: the axis is there in the middle of the larger picture.
        self.assertEqual((frame.width, frame.height), (240, 120))
        self.assertEqual(frame.window, (40, 20, 240, 120))
        # Pixels stay as large.
        pixel = 2 * math.tan(math.radians(frame.fov / 2)) / 120
        self.assertAlmostEqual(pixel, 1.0 / 200)

    def test_border_counts_from_below(self):
        frame = framing.frame_of(framing.Lens(36.0), 200, 100, (10, 20, 50, 90))
        self.assertEqual(frame.window, (10, 10, 50, 80))
        self.assertEqual(framing.border_pixels(200, 100, 0.05, 0.255, 0.0, 0.999), (10, 0, 51, 99))

    def test_lens(self):
        self.assertAlmostEqual(framing.lens_radius(50.0, 2.0), 0.0125)


def camera_of(**values):
    dof = SimpleNamespace(use_dof=False, aperture_fstop=2.8, focus_distance=5.0, aperture_blades=0, aperture_ratio=1.0)
    for key in list(values):
        if hasattr(dof, key):
            setattr(dof, key, values.pop(key))
    data = dict(type="PERSP", ortho_scale=6.0, lens=50.0, sensor_width=36.0, sensor_height=24.0, sensor_fit="AUTO", shift_x=0.0, shift_y=0.0)
    return SimpleNamespace(**(data | values), dof=dof)


class Camera(unittest.TestCase):
    def test_axes(self):
        """Blender's camera looks along -z, with y up; its z is y of scene files."""
        told = notices.Notices()
        _, table = camera.frame_and_table("c", camera_of(), placed(1, 2, 3), (10, 10), None, told)
        self.assertEqual((table["eye"], table["at"], table["up"]), ((1, 3, -2), (1, 2, -2), (0, 0, -1)))
        self.assertNotIn("lens-radius", table)

    def test_focus_on_an_object_is_along_the_view(self):
        told = notices.Notices()
        lens = camera_of(use_dof=True, aperture_fstop=1.4, aperture_blades=5)
        _, table = camera.frame_and_table("c", lens, placed(0, 0, 0), (10, 10), None, told, focus=(3.0, 1.0, -4.0))
        self.assertAlmostEqual(table["focus-distance"], 4.0)
        self.assertAlmostEqual(table["lens-radius"], 0.05 / 2.8)
        self.assertIn("camera 'c': the blades", told.lines()[0])

    def test_others_are_refused(self):
        whole = dict(latitude_min=-math.pi / 2, latitude_max=math.pi / 2, longitude_min=-math.pi, longitude_max=math.pi)
        for message, values in (
            ("camera 'c' is a panorama of the kind MIRRORBALL", dict(type="PANO", panorama_type="MIRRORBALL")),
            ("camera 'c' shows a part", dict(type="PANO", panorama_type="EQUIRECTANGULAR") | whole | dict(latitude_min=0.0)),
            ("its picture has to be a square", dict(type="PANO", panorama_type="FISHEYE_EQUIDISTANT", fisheye_fov=3.0)),
            ("camera 'c' is of the kind CUSTOM", dict(type="CUSTOM")),
        ):
            with self.assertRaisesRegex(camera.SceneError, message):
                camera.frame_and_table("c", camera_of(**values), UPRIGHT, (2, 1), None, notices.Notices())
        frame, table = camera.frame_and_table(
            "c", camera_of(type="PANO", panorama_type="EQUIRECTANGULAR", **whole), UPRIGHT, (4, 2), (1, 0, 3, 1), notices.Notices()
        )
        self.assertEqual((table["type"], frame.window, frame.pixel), ("panorama", (1, 1, 3, 2), None))

    def test_orthographic(self):
        frame, table = camera.frame_and_table(
            "c", camera_of(type="ORTHO", ortho_scale=6.0, shift_y=0.25), UPRIGHT, (60, 40), None, notices.Notices()
        )
        # Six metres across 60 pixels; the shift adds 15 rows above and below.
        self.assertEqual((table["type"], table["height"], frame.window), ("orthographic", 7.0, (0, 0, 60, 40)))
        self.assertEqual((frame.width, frame.height), (60, 70))


def light(kind, energy=100.0, **values):
    common = dict(type=kind, color=(1.0, 0.5, 0.0), energy=energy, use_nodes=False, node_tree=None, use_shadow=True)
    return SimpleNamespace(**(common | values))


class Lamps(unittest.TestCase):
    def tables(self, own, matrix=UPRIGHT):
        self.told = notices.Notices()
        return lamps.tables("lamp", own, matrix, self.told)

    def test_area(self):
        own = light("AREA", shape="RECTANGLE", size=2.0, size_y=3.0, spread=math.pi)
        [(header, table)], text = self.tables(own, placed(1, 2, 5))
        self.assertEqual((header, text, len(self.told)), ("[[shapes]]", None, 0))
        self.assertEqual(table["corner"], (0.0, 5.0, -3.5))
        # Its normal is edge-u x edge-v, and points down.
        (ux, uy, uz), (vx, vy, vz) = table["edge-u"], table["edge-v"]
        self.assertEqual((uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx), (0.0, -6.0, 0.0))
        radiance = 100.0 / (math.pi * 6.0)
        for got, share in zip(table["emission"]["radiance"], (1.0, 0.5, 0.0)):
            self.assertAlmostEqual(got, share * radiance)

    def test_ellipse_has_its_area(self):
        own = light("AREA", shape="ELLIPSE", size=2.0, size_y=1.0, spread=1.0)
        [(_, table)], _ = self.tables(own)
        points = table["vertices"]
        area = 0.5 * sum(x0 * z1 - x1 * z0 for (x0, _, z0), (x1, _, z1) in zip(points, points[1:] + points[:1]))
        self.assertAlmostEqual(abs(area), math.pi * 0.5, places=9)
        # Counter-clockwise as seen from below, where its light goes: y of the sum of cross products points down.
        self.assertGreater(area, 0.0)
        self.assertIn("light 'lamp': a spread of 57 degrees", self.told.lines()[0])

    def test_sun_spot_and_point(self):
        [(_, sun)], _ = self.tables(light("SUN", 3.0, angle=math.radians(0.5)))
        self.assertEqual((sun["type"], sun["direction"], sun["irradiance"]), ("directional", (0, -1, 0), (3.0, 1.5, 0.0)))
        self.assertAlmostEqual(sun["angular-diameter"], 0.5)
        [(_, sun)], _ = self.tables(light("SUN", 3.0, angle=0.0))
        self.assertNotIn("angular-diameter", sun)
        spot = dict(shadow_soft_size=0.0, use_square=False, spot_size=1.0)
        [(_, hard)], text = self.tables(light("SPOT", 4 * math.pi, spot_blend=0.0, **spot))
        self.assertEqual((hard["type"], text), ("spot", None))
        self.assertAlmostEqual(hard["intensity"][0], 1.0)
        [(_, soft)], text = self.tables(light("SPOT", 4 * math.pi, spot_blend=0.2, **spot))
        self.assertEqual(soft["type"], "ies")
        self.assertAlmostEqual(soft["scale"][0], 1.0)
        self.assertTrue(text.startswith("IESNA"))
        [(header, ball)], _ = self.tables(light("POINT", shadow_soft_size=0.1))
        self.assertEqual((header, ball["type"]), ("[[shapes]]", "sphere"))
        [(_, point)], _ = self.tables(light("POINT", shadow_soft_size=0.0))
        self.assertEqual(point["power"], (100.0, 50.0, 0.0))

    def test_exposure_and_temperature(self):
        own = light("POINT", shadow_soft_size=0.0, exposure=1.0, use_temperature=True, temperature_color=(1.0, 0.5, 0.25))
        [(_, point)], _ = self.tables(own)
        self.assertEqual(point["power"], (200.0, 50.0, 0.0))

    def test_dark_lights_are_left_out(self):
        self.assertEqual(self.tables(light("POINT", 0.0, shadow_soft_size=0.0)), ([], None))
        self.assertEqual(len(self.told), 0)
        self.assertEqual(self.tables(light("POINT", -1.0, shadow_soft_size=0.0)), ([], None))
        self.assertIn("negative", self.told.lines()[0])


class Surfaces(unittest.TestCase):
    def material(self, own):
        return surface.material(own, "m", lambda texture: {"index": 0}, lambda one, two: {"index": 1})

    def test_glass_without_absorption_is_left_to_the_importer(self):
        """It decides by the mesh whether it is a body, and takes the root of the colour at each border then."""
        own = surface.Surface(base=surface.Amount((0.25, 1.0, 0.5)), transmission=1.0)
        told = self.material(own)
        self.assertNotIn("KHR_materials_volume", told["extensions"])
        self.assertEqual(told["pbrMetallicRoughness"]["baseColorFactor"], [0.25, 1.0, 0.5, 1.0])
        own.tints_each_border = True
        self.assertEqual(self.material(own)["pbrMetallicRoughness"]["baseColorFactor"], [0.0625, 1.0, 0.25, 1.0])

    def test_absorption(self):
        own = surface.Surface(base=surface.Amount((0.25, 1.0, 1.0)), transmission=1.0, inside=surface.Medium((0.0, 2.0, 8.0)))
        told = self.material(own)
        volume = told["extensions"]["KHR_materials_volume"]
        back = [-math.log(share) / volume["attenuationDistance"] for share in volume["attenuationColor"]]
        for got, want in zip(back, (0.0, 2.0, 8.0)):
            self.assertAlmostEqual(got, want)
        self.assertGreater(volume["thicknessFactor"], 0.0)
        self.assertEqual(told["pbrMetallicRoughness"]["baseColorFactor"][0], 0.5)

    def test_emission_is_in_nits(self):
        own = surface.black()
        own.emission = (3.0, 1.5, 0.0)
        told = self.material(own)
        strength = told["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"]
        self.assertAlmostEqual(strength * told["emissiveFactor"][1] / 683.0, 1.5)
        self.assertLessEqual(max(told["emissiveFactor"]), 1.0)

    def test_mixed_and_added(self):
        red, blue = surface.matt((1.0, 0.0, 0.0)), surface.matt((0.0, 0.0, 1.0))
        found, is_whole = surface.mixed(red, blue, 0.25)
        self.assertEqual((found.base.value, is_whole), ((0.75, 0.0, 0.25), True))
        found, is_whole = surface.mixed(None, surface.matt((1.0, 0.0, 0.0)), 0.25)
        self.assertEqual((found.alpha.value, is_whole), (0.25, True))
        glass = surface.Surface(transmission=1.0)
        found, is_whole = surface.mixed(red, glass, 0.75)
        self.assertEqual((found, is_whole), (glass, False))
        glow = surface.black()
        glow.emission = (1.0, 2.0, 3.0)
        found, is_whole = surface.added(blue, glow)
        self.assertEqual((found.emission, found.base.value, is_whole), ((1.0, 2.0, 3.0), (0.0, 0.0, 1.0), True))
        self.assertFalse(surface.added(red, blue)[1])

    def test_mapping_of_uv_coordinates(self):
        """What the transform makes of glTF's coordinates is what Blender's mapping makes of its own."""
        place, turn, scale = (0.3, -0.2, 0.0), 0.7, (2.0, 0.5, 1.0)
        offset, rotation, factors = nodes.uv_transform(place, turn, scale)
        for u, v in ((0.0, 0.0), (0.2, 0.9), (1.0, 1.0)):
            x, y = scale[0] * u, scale[1] * v
            want = (place[0] + math.cos(turn) * x - math.sin(turn) * y, place[1] + math.sin(turn) * x + math.cos(turn) * y)
            # By the specification of KHR_texture_transform: scaled, turned, moved.
            x, y = factors[0] * u, factors[1] * (1.0 - v)
            got = (
                offset[0] + math.cos(rotation) * x + math.sin(rotation) * y,
                offset[1] - math.sin(rotation) * x + math.cos(rotation) * y,
            )
            self.assertAlmostEqual(got[0], want[0])
            self.assertAlmostEqual(1.0 - got[1], want[1])


class World(unittest.TestCase):
    def test_without_nodes(self):
        own = SimpleNamespace(name="w", node_tree=None, use_nodes=False, color=(0.1, 0.2, 0.3))
        self.assertEqual(world.tables(own, notices.Notices())[0], [{"type": "environment", "radiance": (0.1, 0.2, 0.3)}])
        self.assertEqual(world.tables(None, notices.Notices()), ([], None))

    def test_sun_of_the_physical_sky(self):
        """What Cycles 4.2 gave, with its own air and with others."""
        for elevation, air, dust, want in (
            (15, 1, 1, (121.4, 87.8, 48.7)),
            (45, 1, 1, (146.6, 119.9, 92.2)),
            (80, 1, 1, (151.2, 126.2, 102.4)),
            (45, 2, 1, (136.3, 103.7, 65.8)),
            (45, 1, 3, (136.0, 111.2, 85.5)),
        ):
            for got, known in zip(world.sun_irradiance(math.radians(elevation), "NISHITA", air, dust), want):
                self.assertAlmostEqual(got / known, 1.0, delta=0.03, msg=f"{elevation} degrees, air {air}, dust {dust}")


class GlbFile(unittest.TestCase):
    def test_chunks(self):
        model = glb.Glb()
        positions = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
        place = model.numbers(positions, glb.FLOAT, "VEC3", ((0, 0, 0), (1, 1, 0)))
        corners = model.numbers(struct.pack("<3I", 0, 1, 2), glb.UNSIGNED_INT, "SCALAR")
        look = model.material({"name": "m", "extensions": {"KHR_materials_ior": {"ior": 1.3}}})
        mesh = model.mesh("t", [{"attributes": {"POSITION": place}, "indices": corners, "material": look}])
        self.assertTrue(model.is_empty)
        model.place("t", mesh, [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1])
        model.picture(b"12345", "image/png", "p")
        self.assertFalse(model.is_empty)
        data = model.to_bytes()
        magic, version, length, text_length, kind = struct.unpack_from("<4sIIII", data)
        self.assertEqual((magic, version, length, kind), (b"glTF", 2, len(data), 0x4E4F534A))
        document = json.loads(data[20 : 20 + text_length])
        binary_length, kind = struct.unpack_from("<II", data, 20 + text_length)
        self.assertEqual(kind, 0x004E4942)
        binary = data[28 + text_length :]
        self.assertEqual(len(binary), binary_length)
        self.assertEqual(document["buffers"], [{"byteLength": binary_length}])
        view = document["bufferViews"][document["accessors"][place]["bufferView"]]
        self.assertEqual(binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]], positions)
        self.assertEqual(document["accessors"][corners]["count"], 3)
        self.assertEqual(document["extensionsUsed"], ["KHR_materials_ior"])
        self.assertTrue(all(view["byteOffset"] % 4 == 0 for view in document["bufferViews"]))
        # Up in Blender is up in glTF.
        matrix = document["nodes"][0]["matrix"]
        self.assertEqual([sum(matrix[4 * k + row] * up for k, up in enumerate((0, 0, 1))) for row in range(3)], [0, 1, 0])


FAKE = """#!{python}
import json, sys, time
for done in range(3):
    print(json.dumps({{"step": "rendering", "done": done, "total": 4, "seconds": 0.0}}), flush=True)
print("warning: something is odd", file=sys.stderr)
print("note: something is so", file=sys.stderr)
{rest}
"""


class Program(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()

    def tearDown(self):
        self.folder.cleanup()

    def fake(self, rest):
        path = os.path.join(self.folder.name, "fake")
        with open(path, "w", encoding="utf-8") as file:
            file.write(FAKE.format(python=sys.executable, rest=rest))
        os.chmod(path, 0o755)
        return path

    def ended(self, run):
        end = time.monotonic() + 30.0
        while (code := run.poll()) is None and time.monotonic() < end:
            time.sleep(0.01)
        return code

    def test_progress_and_messages(self):
        run = program.Run([self.fake("")])
        self.assertEqual(self.ended(run), 0)
        self.assertEqual((run.step, run.share), ("rendering", 0.5))
        self.assertEqual(program.sorted_messages(run.messages), [("WARNING", "something is odd"), ("INFO", "something is so")])

    def test_remedies_are_those_of_blender(self):
        lines = [
            "note: /x/scene.toml: model: material `glass` is solid (--set \"solid:glass=no\" makes sheets)",
            "warning: /x/scene.toml: the scene has no light, so the picture is black: add a `[[lights]]` table",
            "global map: 3 photons",
        ]
        want = [
            ("INFO", "material `glass` is solid"),
            ("WARNING", "the scene has no light, so the picture is black: add a light, or give the world a colour"),
        ]
        self.assertEqual(program.sorted_messages(lines, "/x/scene.toml"), want)

    def test_failure(self):
        run = program.Run([self.fake("print('error: no scene\\n  help: write one', file=sys.stderr); sys.exit(1)")])
        code = self.ended(run)
        self.assertEqual((code, run.failure(code)), (1, "error: no scene\n  help: write one"))

    def test_cancel(self):
        """A program that stops when asked to, and one that does not listen."""
        for rest in ("time.sleep(60)", "import signal; signal.signal(15, signal.SIG_IGN); print('x', flush=True); time.sleep(60)"):
            run = program.Run([self.fake(rest)])
            while run.share < 0.5:
                time.sleep(0.01)
            time.sleep(0.1)
            start = time.monotonic()
            run.cancel(patience=0.2)
            self.assertLess(run.poll(), 0)
            self.assertLess(time.monotonic() - start, 20.0)

    def test_options(self):
        self.assertEqual(
            program.options("draft", "path", 3, extra="--spp 4 --guide 'photons'"),
            ["--quality", "draft", "--integrator", "path", "--seed", "3", "--spp", "4", "--guide", "photons"],
        )
        words = program.options("draft", "progressive", 0, time_limit=1.5, threads=2, rounds=8)
        self.assertEqual(words[6:], ["--rounds", "8", "--time-limit", "1.500s", "--threads", "2"])
        with self.assertRaises(program.ProgramError):
            program.options("draft", "path", 0, extra="--spp '4")
        line = program.command("cardioid", "s.toml", "p.exr", ["--x"], (1, 2, 3, 4))
        self.assertEqual(line[:5], ["cardioid", "render", "s.toml", "-o", "p.exr"])
        self.assertEqual(line[-3:], ["--crop", "1,2,3,4", "--x"])
        self.assertEqual(program.round_steps(5), [1, 2, 4, 5])
        self.assertEqual(program.round_steps(1), [1])

    def test_find(self):
        path = self.fake("")
        self.assertEqual(program.find(path), path)
        with self.assertRaisesRegex(program.ProgramError, "there is no program"):
            program.find(os.path.join(self.folder.name, "none"))
        os.chmod(path, 0o644)
        if os.getuid() != 0 or not os.access(path, os.X_OK):
            with self.assertRaisesRegex(program.ProgramError, "no program that can be run"):
                program.find(path)


def exr_file(width, lines, channels, window=None):
    """A file of one kind of compression, ZIP of sixteen lines, by the format's own description."""
    import zlib

    x0, y0 = (window or (0, 0))[:2]
    whole = window[2:] if window else (width, len(lines))

    def attribute(name, kind, data):
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<I", len(data)) + data

    listed = b"".join(name.encode() + b"\0" + struct.pack("<IIII", 2, 0, 1, 1) for name in channels) + b"\0"
    header = struct.pack("<II", 20000630, 2)
    header += attribute("channels", "chlist", listed) + attribute("compression", "compression", b"\3")
    header += attribute("dataWindow", "box2i", struct.pack("<4i", x0, y0, x0 + width - 1, y0 + len(lines) - 1))
    header += attribute("displayWindow", "box2i", struct.pack("<4i", 0, 0, whole[0] - 1, whole[1] - 1)) + b"\0"
    chunks = []
    for first in range(0, len(lines), 16):
        raw = b"".join(lines[first : first + 16])
        split = raw[0::2] + raw[1::2]
        coded = bytes([split[0]]) + bytes((b - a + 128) % 256 for a, b in zip(split, split[1:]))
        packed = zlib.compress(coded)
        chunks.append(struct.pack("<ii", y0 + first, min(len(packed), len(raw))) + (packed if len(packed) < len(raw) else raw))
    offsets, position = b"", len(header) + 8 * len(chunks)
    for chunk in chunks:
        offsets += struct.pack("<Q", position)
        position += len(chunk)
    return header + offsets + b"".join(chunks)


@unittest.skipUnless(numpy, "numpy is not there, which Blender brings along")
class Exr(unittest.TestCase):
    def file(self, data):
        file = tempfile.NamedTemporaryFile(suffix=".exr", delete=False)
        self.addCleanup(os.unlink, file.name)
        with file:
            file.write(data)
        return file.name

    def test_zip(self):
        width, height = 5, 35
        values = {name: [[k + 10 * y + x / 7 for x in range(width)] for y in range(height)] for k, name in enumerate("BGR")}
        lines = [b"".join(struct.pack(f"<{width}f", *values[name][y]) for name in "BGR") for y in range(height)]
        picture = exr.read(self.file(exr_file(width, lines, "BGR", (3, 4, 20, 50))))
        self.assertEqual((picture.window, picture.whole, picture.size), ((3, 4, 8, 39), (0, 0, 20, 50), (5, 35)))
        for name in "BGR":
            numpy.testing.assert_array_equal(picture.channels[name], numpy.array(values[name], numpy.float32))

    def test_what_is_written_is_read(self):
        values = numpy.arange(3 * 4 * 5, dtype=numpy.float32).reshape(4, 5, 3)
        picture = exr.read(self.file(exr.colours(values)))
        numpy.testing.assert_array_equal(numpy.stack([picture.channels[c] for c in "RGB"], axis=-1), values)

    def test_damaged_files(self):
        data = exr_file(4, [struct.pack("<4f", 1, 2, 3, 4)] * 20, "R")
        exr.read(self.file(data))
        for end in range(0, len(data), 7):
            with self.assertRaises(exr.ExrError):
                exr.read(self.file(data[:end]))

    def test_passes(self):
        rows = numpy.array([[1.0, 2.0], [3.0, numpy.inf]], numpy.float32)
        names = ["R", "G", "B", "direct.R", "direct.G", "direct.B", "normal.X", "normal.Y", "normal.Z", "depth.Z"]
        channels = {name: rows + k for k, name in enumerate(names)}
        channels["depth.Z"] = rows
        picture = exr.Picture((2, 0, 4, 2), (0, 0, 4, 4), channels, {})
        combined = passes.combined(picture)
        # Rows from the bottom.
        self.assertEqual(combined[0, 0].tolist(), [3.0, 4.0, 5.0, 1.0])
        self.assertIsNone(passes.layer(picture, "caustics"))
        self.assertEqual(passes.layer(picture, "direct")[1, 0].tolist(), [4.0, 5.0, 6.0])
        # Blender's z is y, and its y is -z.
        self.assertEqual(passes.normal(picture)[1, 0].tolist(), [7.0, -9.0, 8.0])
        depth = passes.depth(picture, framing.Frame(4, 4, (2, 0, 4, 2), 0.5))[..., 0]
        # The pixel at 2, 0 of 4 x 4: its middle is at 0.25 and 0.75 on a plane at the distance of one.
        self.assertAlmostEqual(depth[1, 0], 1.0 / math.sqrt(1 + 0.25**2 + 0.75**2), places=6)
        self.assertEqual(depth[0, 1], numpy.float32(passes.FAR))
        flat = passes.depth(picture, framing.Frame(4, 4, (2, 0, 4, 2), 0.5, False))[..., 0]
        self.assertEqual(flat[1].tolist(), [1.0, 2.0])
        self.assertEqual(passes.flat(depth).dtype, numpy.float32)


class FakeImage(SimpleNamespace):
    """What Blender's images have; rows from the bottom."""

    def __init__(self, name, values, space="sRGB", is_float=False, **more):
        values = numpy.asarray(values, numpy.float32)

        def foreach_get(target):
            target[:] = values.reshape(-1)

        common = dict(source="GENERATED", path="", packed_file=None, is_dirty=False, has_data=True, name_full=name)
        super().__init__(
            name=name,
            size=(values.shape[1], values.shape[0]),
            pixels=SimpleNamespace(foreach_get=foreach_get),
            colorspace_settings=SimpleNamespace(name=space),
            is_float=is_float,
            **(common | more),
        )

    def __eq__(self, other):
        return self is other


def png_pixels(data):
    """The pixels of a PNG that `pictures.png` wrote."""
    import zlib

    width, height, _, kind = struct.unpack_from(">IIBB", data, 16)
    channels = {2: 3, 6: 4}[kind]
    start = data.index(b"IDAT") + 4
    (length,) = struct.unpack_from(">I", data, start - 8)
    rows = numpy.frombuffer(zlib.decompress(data[start : start + length]), numpy.uint8).reshape(height, -1)
    return rows[:, 1:].reshape(height, width, channels)


@unittest.skipUnless(numpy, "numpy is not there, which Blender brings along")
class PicturesOfSurfaces(unittest.TestCase):
    def setUp(self):
        self.model, self.told = glb.Glb(), notices.Notices()
        self.pictures = pictures.Pictures(self.model, self.told, lambda image: image.path)

    def pixels(self, slot):
        """The pixels of a slot's picture, and its kind."""
        image = self.model.json["images"][self.model.json["textures"][slot["index"]]["source"]]
        view = self.model.json["bufferViews"][image["bufferView"]]
        data = self.model.to_bytes()
        start = 28 + struct.unpack_from("<I", data, 12)[0] + view["byteOffset"]
        return data[start : start + view["byteLength"]], image["mimeType"]

    def test_colours(self):
        grey = FakeImage("grey", [[[0.5, 0.5, 0.5, 1.0], [0.25, 0.5, 1.0, 0.5]]])
        linear = FakeImage("linear", [[[0.2158605, 2.0, 0.0, 1.0]]], space="Linear Rec.709", is_float=True)
        slot = self.pictures.slot((None, "other"))
        # Bytes stay as they are, and linear numbers are encoded; what is above 1 is cut, and told.
        first, kind = self.pixels(slot(surface.Texture(grey)))
        self.assertEqual((png_pixels(first).tolist(), kind), ([[[128, 128, 128, 255], [64, 128, 255, 128]]], "image/png"))
        second, _ = self.pixels(slot(surface.Texture(linear)))
        self.assertEqual(png_pixels(second)[0, 0].tolist(), [128, 255, 0, 255])
        self.assertEqual(self.told.lines(), ["image 'linear': values above 1 are cut to 1 in pictures of surfaces"])
        # The same picture is written once; its place is that of the texture.
        again = slot(surface.Texture(grey, uv="other", transform=((0.1, 0.2), 0.3, (2.0, 1.0))))
        self.assertEqual((again["index"], again["texCoord"]), (0, 1))
        self.assertEqual(again["extensions"]["KHR_texture_transform"]["rotation"], 0.3)
        self.assertEqual(len(self.model.json["images"]), 2)

    def test_files_go_in_as_they_are(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "p.jpg")
            Path(path).write_bytes(b"\xff\xd8\xff and more")
            jpeg = FakeImage("jpeg", [[[0, 0, 0, 1]]], source="FILE", path=path)
            slot = self.pictures.slot((None,))
            self.assertEqual(self.pixels(slot(surface.Texture(jpeg))), (b"\xff\xd8\xff and more", "image/jpeg"))
        lost = FakeImage("lost", numpy.zeros((0, 0, 4)), source="FILE", path="/nowhere.png", has_data=False)
        data, _ = self.pixels(slot(surface.Texture(lost)))
        self.assertEqual(png_pixels(data)[0, 0].tolist(), [255, 0, 255])
        self.assertIn("its file is missing", self.told.lines()[0])

    def test_roughness_and_metal(self):
        """Green and blue of one picture, of the size of the larger; colours as numbers are their linear luminance."""
        rough = FakeImage("rough", [[[0.2] * 3 + [1]] * 2, [[0.6] * 3 + [1]] * 2], space="Non-Color")
        metal = FakeImage("metal", [[[0.5, 0.5, 0.5, 1.0]]])
        both = self.pictures.slot_of_both((None,), "material 'm'")
        data, _ = self.pixels(both(surface.Amount(1.0, surface.Texture(rough)), surface.Amount(0.0, surface.Texture(metal))))
        pixels = png_pixels(data)
        # Rows from the top; 0.5 of sRGB is 0.214.
        self.assertEqual(pixels[..., 1].tolist(), [[153, 153], [51, 51]])
        self.assertEqual(set(pixels[..., 2].ravel().tolist()), {55})
        # Channels of a picture that is packed already are left as they are.
        packed = FakeImage("packed", [[[0.1, 0.2, 0.3, 1.0]]], space="Non-Color")
        amounts = [surface.Amount(1.0, surface.Texture(packed, channel)) for channel in ("G", "B")]
        data, _ = self.pixels(both(*amounts))
        self.assertEqual(png_pixels(data)[0, 0].tolist(), [26, 51, 76, 255])
        # A picture of one alone leaves the other to its factor.
        own = surface.Surface(roughness=amounts[0], metallic=surface.Amount(0.25))
        told = surface.material(own, "m", None, both)["pbrMetallicRoughness"]
        self.assertEqual((told["roughnessFactor"], told["metallicFactor"]), (1.0, 0.25))
        data, _ = self.pixels(told["metallicRoughnessTexture"])
        self.assertEqual(png_pixels(data)[0, 0].tolist(), [255, 51, 255])


class Extension(unittest.TestCase):
    @unittest.skipUnless(tomllib, "Python before 3.11 has no reader of TOML")
    def test_manifest(self):
        with open(ROOT / "blender/blender_manifest.toml", "rb") as file:
            manifest = tomllib.load(file)
        with open(ROOT / "Cargo.toml", "rb") as file:
            self.assertEqual(manifest["version"], tomllib.load(file)["workspace"]["package"]["version"])
        self.assertLessEqual(len(manifest["tagline"]), 64)
        self.assertFalse(manifest["tagline"].endswith("."))
        self.assertLessEqual(len(manifest["permissions"]["files"]), 64)


if __name__ == "__main__":
    unittest.main()
