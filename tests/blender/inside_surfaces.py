"""Materials, against closed forms and Cycles."""

import json
import math
import random
import tempfile
import unittest

import bpy
import numpy
from stage import box, by_cycles, empty_scene, eye, lamp, material, mean, mesh, nodes_of, plane, render, white, world

from blender import export, materials, notices, surface
from blender import world as worlds


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

    def test_volumes_that_scatter(self):
        """A body with and without a surface, before an emitter and under a sky, as bright as in Cycles."""
        scatter = {"Color": (0.9, 0.6, 0.3, 1.0), "Density": 8.0, "Anisotropy": 0.5}
        for surface, kind, values in (
            (None, "ShaderNodeVolumeScatter", scatter),
            ("ShaderNodeBsdfGlass", "ShaderNodeVolumeScatter", scatter),
            (None, "ShaderNodeVolumePrincipled", scatter | {"Absorption Color": (0.5, 0.2, 0.1, 1.0)}),
        ):
            with self.subTest(surface=surface, kind=kind):
                empty_scene(extra="--spp 1024")
                look = bpy.data.materials.new("fog")
                tree = nodes_of(look)
                output, volume = tree.nodes.new("ShaderNodeOutputMaterial"), tree.nodes.new(kind)
                for name, value in values.items():
                    volume.inputs[name].default_value = value
                tree.links.new(volume.outputs[0], output.inputs["Volume"])
                if surface:
                    shader = tree.nodes.new(surface)
                    shader.inputs["Color"].default_value, shader.inputs["Roughness"].default_value = (1, 1, 1, 1), 0.0
                    shader.inputs["IOR"].default_value = 1.3
                    tree.links.new(shader.outputs[0], output.inputs["Surface"])
                box(look, (-0.3, -0.3, 0), (0.3, 0.3, 0.2))
                plane(material("glow", "ShaderNodeEmission", Strength=2.0), half=0.1, place=(0, 0, -0.1))
                world((0.2, 0.3, 0.5))
                eye(place=(0, 0, 2))
                own, other = render(), by_cycles(1024)
                for channel in range(3):
                    self.assertAlmostEqual(mean(own, channel=channel) / mean(other, channel=channel), 1.0, delta=0.04)
                # Coefficients differ by channel, and so do the pictures.
                self.assertGreater(abs(mean(own, channel=0) - mean(own, channel=2)), 0.1)

    def test_fog_fills_the_world(self):
        """What a ray loses on its way through fog that absorbs; the box around the scene holds the eye."""
        empty_scene()
        plane(material("glow", "ShaderNodeEmission", Strength=2.0), half=4.0)
        tree, _ = world()
        volume = tree.nodes.new("ShaderNodeVolumeAbsorption")
        volume.inputs["Color"].default_value, volume.inputs["Density"].default_value = (0.8, 0.6, 0.0, 1.0), 0.5
        output = next(node for node in tree.nodes if node.type == "OUTPUT_WORLD")
        tree.links.new(volume.outputs[0], output.inputs["Volume"])
        eye(place=(0, 0, 2))
        found = render()
        for channel, share in enumerate((0.2, 0.4, 1.0)):
            self.assertAlmostEqual(mean(found, channel=channel), 2.0 * math.exp(-0.5 * share * 2.0), delta=0.01)

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

    def test_any_node_is_written_or_told(self):
        """Each node of Blender as surface, volume, colour, normal and factor: none is an error."""
        empty_scene()
        tree = nodes_of(bpy.data.materials.new("probe"))
        kinds = []
        for name in sorted(dir(bpy.types)):
            if name.startswith("ShaderNode") and name not in ("ShaderNode", "ShaderNodeTree", "ShaderNodeCustomGroup"):
                try:
                    tree.nodes.new(name)
                except RuntimeError:
                    continue
                kinds.append(name)
        self.assertGreater(len(kinds), 80)
        told = notices.Notices()
        for kind in kinds:
            for number in range(4):
                look = bpy.data.materials.new(f"{kind} {number}")
                tree = nodes_of(look)
                node, output = tree.nodes.new(kind), tree.nodes.new("ShaderNodeOutputMaterial")
                # Inputs are linked too: a colour from noise, shaders from glass.
                noise, glass = tree.nodes.new("ShaderNodeTexNoise"), tree.nodes.new("ShaderNodeBsdfGlass")
                for socket in node.inputs:
                    source = glass.outputs[0] if socket.type == "SHADER" else noise.outputs[0]
                    if number % 2 and not socket.is_unavailable:
                        tree.links.new(source, socket)
                if not node.outputs:
                    continue
                shader = tree.nodes.new("ShaderNodeBsdfPrincipled")
                if node.outputs[0].type == "SHADER":
                    targets = [output.inputs["Surface" if number < 2 else "Volume"]]
                elif number < 2:
                    targets = [shader.inputs[name] for name in ("Base Color", "Roughness", "Normal", "IOR", "Emission Color")]
                else:
                    volume = tree.nodes.new("ShaderNodeVolumePrincipled")
                    tree.links.new(volume.outputs[0], output.inputs["Volume"])
                    targets = [volume.inputs[name] for name in ("Color", "Density")] + [output.inputs["Displacement"]]
                if node.outputs[0].type != "SHADER":
                    tree.links.new(shader.outputs[0], output.inputs["Surface"])
                for target in targets:
                    tree.links.new(node.outputs[0], target)
                with self.subTest(kind, number=number):
                    found = materials.surface_of(look, told)
                    if found is not None and not found.textures:
                        json.dumps(surface.material(found, "m", None, None), allow_nan=False)
        # As the world, and as a light.
        for kind in kinds:
            own = bpy.data.worlds.new(kind)
            tree = nodes_of(own)
            try:
                node = tree.nodes.new(kind)
            except RuntimeError:
                continue
            background, output = tree.nodes.new("ShaderNodeBackground"), tree.nodes.new("ShaderNodeOutputWorld")
            if not node.outputs:
                continue
            is_shader = node.outputs[0].type == "SHADER"
            tree.links.new(node.outputs[0], output.inputs["Surface"] if is_shader else background.inputs["Color"])
            tree.links.new(node.outputs[0], output.inputs["Volume"] if is_shader else background.inputs["Strength"])
            if not is_shader:
                tree.links.new(background.outputs[0], output.inputs["Surface"])
            with self.subTest(kind, of="world"):
                worlds.tables(own, told)
                worlds.medium(own, told)

    def test_random_graphs(self):
        """Any links, also in circles, through groups, reroutes and muted nodes."""
        empty_scene()
        kinds = ["BsdfPrincipled", "MixShader", "AddShader", "BsdfGlass", "BsdfTransparent", "Emission", "Math", "RGB", "Value"]
        kinds += ["TexImage", "Mapping", "UVMap", "NormalMap", "Bump", "VolumeScatter", "VolumeAbsorption", "VertexColor", "LightPath"]
        image = self.picture("any", lambda x, y: numpy.stack([x, y, x], axis=-1))

        def link(graph, output, socket):
            try:
                graph.links.new(output, socket)
            except RuntimeError:
                # Sockets at the ends of groups, which stand for those that are still to be made.
                pass

        for seed in range(150):
            chance = random.Random(seed)
            look = bpy.data.materials.new(f"graph {seed}")
            tree = nodes_of(look)
            inner = bpy.data.node_groups.new(f"group {seed}", "ShaderNodeTree")
            for name, way in (("a", "INPUT"), ("b", "INPUT"), ("c", "OUTPUT")):
                kind = chance.choice(["NodeSocketColor", "NodeSocketFloat", "NodeSocketShader"])
                inner.interface.new_socket(name, in_out=way, socket_type=kind)
            for graph, count in ((inner, 5), (tree, 10)):
                own = [graph.nodes.new("ShaderNode" + chance.choice(kinds)) for _ in range(count)]
                own += [graph.nodes.new("NodeReroute") for _ in range(2)]
                if graph is inner:
                    own += [graph.nodes.new("NodeGroupInput"), graph.nodes.new("NodeGroupOutput")]
                else:
                    group = graph.nodes.new("ShaderNodeGroup")
                    group.node_tree = inner
                    own += [group, graph.nodes.new("ShaderNodeOutputMaterial")]
                for node in own:
                    node.mute = chance.random() < 0.1 and node.type not in ("OUTPUT_MATERIAL", "GROUP_OUTPUT", "REROUTE")
                    if node.type == "TEX_IMAGE" and chance.random() < 0.8:
                        node.image = image
                outputs = [socket for node in own for socket in node.outputs if not socket.is_unavailable]
                for node in own:
                    for socket in node.inputs:
                        if outputs and chance.random() < (0.9 if node.type in ("OUTPUT_MATERIAL", "GROUP_OUTPUT") else 0.5):
                            link(graph, chance.choice(outputs), socket)
            with self.subTest(seed=seed):
                found = materials.surface_of(look, notices.Notices())
                if found is not None:
                    table = lambda *_: {"index": 0}  # noqa: E731
                    json.dumps(surface.material(found, "m", table, table), allow_nan=False)
                    json.dumps(found.inside.table(found.ior))

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
        hairy = plane(look, half=0.1, name="hairy")
        hairy.modifiers.new("hair", "PARTICLE_SYSTEM")
        hairy.particle_systems[0].settings.type = "HAIR"
        # One lamp in the picture, one behind the camera.
        lamp("AREA", 10.0, place=(0, 0, 0.5), turn=(math.pi, 0, 0), size=0.001)
        linked = lamp("AREA", 10.0, place=(0, 0, 2.0), size=0.001)
        linked.light_linking.receiver_collection = bpy.data.collections.new("lit")
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
            "light 'AREA.001': light linking is not modelled",
            "object 'hairy': its hair is not modelled",
        ):
            self.assertIn(part, lines)
        self.assertEqual(len(told), 7, lines)
