//! Images, normal maps and alpha on materials of scene files, against what the image says.

use cardioid::embree::Device;
use cardioid::film::{Filter, LayerSet};
use cardioid::image_io::{PngPixels, write_png};
use cardioid::render::{IntegratorKind, Overrides, RenderRequest, Settings, Silent, render};
use cardioid::scene_file::{build_scene, load_scene};
use std::fs;
use std::sync::Arc;

const SIDE: u32 = 8;

/// A scene in a folder that its images are in.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// Writes a square image of bytes, row by row from the top.
    fn image(&self, name: &str, side: u32, texel: impl Fn(u32, u32) -> [u8; 3]) {
        let texels: Vec<u8> =
            (0..side).flat_map(|y| (0..side).map(move |x| (x, y))).flat_map(|(x, y)| texel(x, y)).collect();
        write_png(self.0.path().join(name), side, side, PngPixels::Rgb8(&texels)).unwrap();
    }

    fn load(&self, text: &str) -> Result<cardioid::scene_file::SceneDescription, String> {
        let path = self.0.path().join("scene.toml");
        fs::write(&path, text).unwrap();
        load_scene(&path, &[]).map_err(|error| error.to_string())
    }

    /// The picture, pixel by pixel, by paths.
    fn picture(&self, text: &str, spp: u32) -> Vec<[f64; 3]> {
        let scene = self.load(text).unwrap_or_else(|error| panic!("{error}\n{text}"));
        let device = Arc::new(Device::new(1).unwrap());
        let built = build_scene(&scene, &device, (SIDE, SIDE)).unwrap_or_else(|error| panic!("{error}"));
        assert!(built.warnings.is_empty(), "{:?}", built.warnings);
        let asked = Overrides {
            integrator: Some(IntegratorKind::Path),
            spp: Some(spp),
            seed: Some(3),
            ..Overrides::default()
        };
        let request = RenderRequest {
            width: SIDE,
            height: SIDE,
            crop: None,
            filter: Filter::Box { radius: 0.5 },
            layers: LayerSet::default(),
            settings: Settings::from(&asked),
        };
        let film = render(&built.scene, &built.camera, &request, &Silent).unwrap().film;
        let beauty = film.develop().beauty().to_vec();
        beauty.chunks_exact(3).map(|pixel| std::array::from_fn(|i| f64::from(pixel[i]))).collect()
    }
}

/// Looks along -z at the square from -1 to 1 in x and y, in parallel light of irradiance π from the camera: white paint has the radiance 1.
const VIEW: &str = "[camera]\ntype = \"orthographic\"\neye = [0, 0, 5]\nat = [0, 0, 0]\nheight = 2
    [[lights]]\ntype = \"directional\"\ndirection = [0, 0, -1]\nirradiance = 3.14159265\n";
const QUAD: &str = "[[shapes]]\ntype = \"quad\"\ncorner = [-1, -1, 0]\nedge-u = [2, 0, 0]\nedge-v = [0, 2, 0]\nmaterial = \"m\"\n";
const WOOD: &str =
    "[textures.wood]\ntype = \"image\"\nfile = \"wood.png\"\nencoding = \"linear\"\nfilter = \"nearest\"\n";

/// A colour of its own for each of the texels.
fn colours(x: u32, y: u32) -> [u8; 3] {
    [(20 + 25 * x) as u8, (30 + 20 * y) as u8, (40 + 3 * x * y) as u8]
}

/// An image on a quad is the picture of it: upright, not mirrored, with the values that it has.
#[test]
fn an_image_on_a_quad_is_its_picture() {
    let folder = Folder::new();
    folder.image("wood.png", SIDE, colours);
    folder.image("grey.png", 4, |_, _| [128; 3]);
    let scene = |texture: &str, material: &str| format!("{VIEW}{texture}\n[materials.m]\n{material}\n{QUAD}");
    let lambert = "type = \"lambert\"\nreflectance = { texture = \"wood\" }";
    let check = |found: Vec<[f64; 3]>, at: &dyn Fn(u32, u32) -> (u32, u32), factor: f64| {
        for (i, pixel) in found.iter().enumerate() {
            let (x, y) = at(i as u32 % SIDE, i as u32 / SIDE);
            let want = colours(x, y).map(|byte| f64::from(byte) / 255.0 * factor);
            for channel in 0..3 {
                assert!((pixel[channel] - want[channel]).abs() < 2e-3, "{i}: {pixel:?} {want:?}");
            }
        }
    };
    check(folder.picture(&scene(WOOD, lambert), 4), &|x, y| (x, y), 1.0);
    let half = lambert.replace("\"wood\" }", "\"wood\", factor = 0.5 }");
    check(folder.picture(&scene(WOOD, &half), 4), &|x, y| (x, y), 0.5);
    // A quarter turn counter-clockwise about the lower left corner, with the picture moved back into the square.
    let turned = format!("{WOOD}rotate = 90\noffset = [0, -1]\n");
    check(folder.picture(&scene(&turned, lambert), 4), &|x, y| (SIDE - 1 - y, x), 1.0);
    let twice = format!("{WOOD}repeat = [2, 2]\n");
    let found = folder.picture(&scene(&twice, lambert), 16);
    for (i, pixel) in found.iter().enumerate() {
        let (x, y) = (i as u32 % 4 * 2, i as u32 / SIDE % 4 * 2);
        let mean = |f: &dyn Fn([u8; 3]) -> u8| {
            let four = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
            four.iter().map(|&(x, y)| f64::from(f(colours(x, y))) / 255.0).sum::<f64>() / 4.0
        };
        assert!(
            (pixel[0] - mean(&|c| c[0])).abs() < 0.02 && (pixel[1] - mean(&|c| c[1])).abs() < 0.02,
            "{i}: {pixel:?}"
        );
    }
    // sRGB is decoded, unless the texture says otherwise.
    let grey = "[textures.wood]\ntype = \"image\"\nfile = \"grey.png\"\n";
    let decoded = ((128.0 / 255.0 + 0.055) / 1.055f64).powf(2.4);
    assert!(folder.picture(&scene(grey, lambert), 1).iter().all(|pixel| (pixel[1] - decoded).abs() < 1e-3));
}

/// Spheres, discs, cylinders, boxes and meshes show the image upright: red grows to the right, green downwards.
#[test]
fn images_are_upright_on_all_shapes() {
    let folder = Folder::new();
    folder.image("wood.png", 64, |x, y| [(4 * x) as u8, (4 * y) as u8, 0]);
    fs::write(
        folder.0.path().join("a.obj"),
        "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n",
    )
    .unwrap();
    for shape in [
        "type = \"sphere\"\nradius = 1",
        "type = \"disc\"\nnormal = [0, 0, 1]\nradius = 1",
        "type = \"box\"\nmin = [-1, -1, -1]\nmax = [1, 1, 1]",
        "type = \"mesh\"\nfile = \"a.obj\"",
        "type = \"mesh\"\nvertices = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]\nfaces = [[0, 1, 2, 3]]\ncoordinates = [[0, 0], [1, 0], [1, 1], [0, 1]]",
        "type = \"cylinder\"\nbase = [0, -1, 0]\ntop = [0, 1, 0]\nradius = 1",
    ] {
        // The meridians of a cylinder start anywhere around it.
        let turns = if shape.contains("cylinder") { 4 } else { 1 };
        let is_upright = (0..turns).any(|turn| {
            let text = format!(
                "{VIEW}{WOOD}[materials.m]\ntype = \"lambert\"\nreflectance = {{ texture = \"wood\" }}
                [[shapes]]\n{shape}\nmaterial = \"m\"\ntransform = [{{ rotate = {}, axis = \"y\" }}]\n",
                90 * turn
            );
            let found = folder.picture(&text, 16);
            let at = |x: usize, y: usize| found[y * SIDE as usize + x];
            let (left, right, top, bottom) = (at(2, 3), at(5, 3), at(3, 2), at(3, 5));
            // Colours of a curved surface, free of the light on it.
            let share = |pixel: [f64; 3]| pixel[0] / (pixel[0] + pixel[1]);
            share(right) > share(left) + 0.05 && share(bottom) < share(top) - 0.05
        });
        assert!(is_upright, "{shape}");
    }
}

/// Where a normal map tilts the normal to the right, light from the right is stronger, and green is up.
#[test]
fn normal_maps_tilt() {
    let folder = Folder::new();
    folder.image("flat.png", 4, |_, _| [128, 128, 255]);
    // (0.6, 0, 0.8), and (0, 0.6, 0.8): green is up.
    folder.image("right.png", 4, |_, _| [204, 128, 230]);
    folder.image("up.png", 4, |_, _| [128, 204, 230]);
    let mirrored = |map: &str, direction: &str, transform: &str| {
        let text = format!(
            "{}[textures.n]\ntype = \"image\"\nfile = \"{map}.png\"
            [materials.m]\ntype = \"lambert\"\nreflectance = 0.5\nnormal-map = \"n\"\n{QUAD}{transform}",
            VIEW.replace("[0, 0, -1]", direction)
        );
        folder.picture(&text, 4)[27][0]
    };
    let radiance = |map: &str, direction: &str| mirrored(map, direction, "");
    let straight = "[0, 0, -1]";
    let [from_right, from_left, from_above, from_below] =
        ["[-0.6, 0, -0.8]", "[0.6, 0, -0.8]", "[0, -0.6, -0.8]", "[0, 0.6, -0.8]"];
    assert!((radiance("flat", straight) - 0.5).abs() < 0.01);
    // Between the normals of the map and of the surface.
    let tilted = radiance("right", straight);
    assert!((tilted - 0.5 * 0.8).abs() < 0.01, "{tilted}");
    let right = radiance("right", from_right);
    assert!(right > 1.2 * tilted && radiance("right", from_left) < 0.7 * tilted, "{right} {tilted}");
    // The same picture turned by a quarter.
    for (one, other) in [
        (("right", from_right), ("up", from_above)),
        (("right", from_left), ("up", from_below)),
        (("right", from_above), ("up", from_right)),
    ] {
        let (a, b) = (radiance(one.0, one.1), radiance(other.0, other.1));
        assert!((a / b - 1.0).abs() < 0.02, "{one:?} {a} {b}");
    }
    // A picture that is mirrored has its relief mirrored, and not turned inside out.
    let [aside, over] =
        ["[-1, 1, 1]", "[1, -1, 1]"].map(|scale| format!("transform = [{{ scale = {scale} }}]\n"));
    for (map, direction, transform, as_from) in [
        ("up", from_above, &aside, from_above),
        ("up", from_below, &aside, from_below),
        ("right", from_left, &aside, from_right),
        ("up", from_below, &over, from_above),
        ("up", from_above, &over, from_below),
        ("right", from_right, &over, from_right),
    ] {
        let (a, b) = (mirrored(map, direction, transform), radiance(map, as_from));
        assert!((a / b - 1.0).abs() < 0.02, "{map} {direction} {transform} {a} {b}");
    }
}

/// What is cut out shows what is behind; a half alpha shows half of it.
#[test]
fn alpha_and_cutouts() {
    let folder = Folder::new();
    folder.image("mask.png", 2, |x, _| if x == 0 { [255; 3] } else { [0; 3] });
    let scene = |alpha: &str| {
        let mask = "[textures.mask]\ntype = \"image\"\nfile = \"mask.png\"\nfilter = \"nearest\"\n";
        let mask = if alpha.contains("mask") { mask } else { "" };
        format!(
            "{VIEW}{mask}[materials.m]\ntype = \"lambert\"\nreflectance = 0.5\n{alpha}
            [materials.black]\ntype = \"lambert\"\nreflectance = 0.25\n{QUAD}
            [[shapes]]\ntype = \"quad\"\ncorner = [-3, -3, -1]\nedge-u = [6, 0, 0]\nedge-v = [0, 6, 0]\nmaterial = \"black\"\n"
        )
    };
    for alpha in ["alpha = { texture = \"mask\" }", "alpha = { texture = \"mask\" }\ncutout = 0.5"] {
        for (i, pixel) in folder.picture(&scene(alpha), 4).iter().enumerate() {
            let want = if i as u32 % SIDE < SIDE / 2 { 0.5 } else { 0.25 };
            // The left half keeps light from its neighbours behind.
            assert!((pixel[0] - want).abs() < 0.02, "{alpha} {i}: {pixel:?}");
        }
    }
    let mean = |pixels: Vec<[f64; 3]>| pixels.iter().map(|pixel| pixel[0]).sum::<f64>() / pixels.len() as f64;
    let half = mean(folder.picture(&scene("alpha = 0.5"), 256));
    // Half of the rays pass, and of what lies behind half is lit.
    assert!((half - (0.25 + 0.25 * 0.25)).abs() < 0.06, "{half}");
}

/// In light that is the same from everywhere, what absorbs nothing is as bright as that light, and nothing is brighter.
#[test]
fn nothing_gains_light() {
    let folder = Folder::new();
    folder.image("wood.png", 4, |x, y| [(60 * x) as u8, (60 * y) as u8, 255]);
    let mean = |material: &str| {
        let text = format!(
            "[camera]\neye = [0, 0, 5]\nat = [0, 0, 0]\nfov = 15\n[[lights]]\ntype = \"environment\"\nradiance = 1.0
            {WOOD}[materials.m]\n{material}\n[[shapes]]\ntype = \"sphere\"\nradius = 1\nmaterial = \"m\"\n"
        );
        let text = if material.contains("wood") { text } else { text.replace(WOOD, "") };
        let pixels = folder.picture(&text, 64);
        pixels.iter().map(|pixel| pixel[2]).sum::<f64>() / pixels.len() as f64
    };
    let glass = mean("type = \"thin-glass\"");
    assert!((glass - 1.0).abs() < 0.01, "{glass}");
    for material in [
        "type = \"plastic\"\ncolour = 1.0",
        "type = \"plastic\"\ncolour = { texture = \"wood\" }\nroughness = { texture = \"wood\" }",
        "type = \"principled\"\ncolour = 1.0\ncoat = 1.0\nroughness = 0.4",
        "type = \"principled\"\ncolour = 1.0\nmetallic = { texture = \"wood\" }\nroughness = { texture = \"wood\" }\ncoat = { texture = \"wood\" }\nspecular = { texture = \"wood\" }\nspecular-colour = { texture = \"wood\" }\ncoat-roughness = { texture = \"wood\" }",
        "type = \"principled\"\ncolour = 1.0\ntransmission = 0.7\nroughness = 0.2",
        "type = \"conductor\"\nmetal = \"iron\"\nroughness = { texture = \"wood\" }",
        "type = \"conductor\"\ncolour = { texture = \"wood\" }\nroughness = 0.2",
        "type = \"dielectric\"\nior = 1.5\nroughness = { texture = \"wood\" }",
    ] {
        let found = mean(material);
        assert!((0.3..1.01).contains(&found), "{material}: {found}");
    }
}

/// A number and an image that has it everywhere are the same.
#[test]
fn even_images_are_numbers() {
    let folder = Folder::new();
    folder.image("wood.png", 4, |_, _| [51; 3]);
    let mean = |material: &str, uses: bool| {
        let text = format!(
            "[camera]\neye = [0, 1, 5]\nat = [0, 0, 0]\nfov = 30\n[[lights]]\ntype = \"point\"\nposition = [2, 3, 4]\nintensity = 20
            {}[materials.m]\n{material}\n{QUAD}",
            if uses { WOOD } else { "" }
        );
        let pixels = folder.picture(&text, 64);
        pixels.iter().map(|pixel| pixel[0]).sum::<f64>() / pixels.len() as f64
    };
    for material in [
        "type = \"plastic\"\ncolour = 0.5\nroughness = VALUE",
        "type = \"principled\"\nroughness = VALUE",
        "type = \"principled\"\nmetallic = VALUE\nroughness = 0.4",
        "type = \"principled\"\ncoat = VALUE\ncoat-roughness = 0.3",
        "type = \"principled\"\nroughness = 0.4\nspecular = VALUE",
    ] {
        let plain = mean(&material.replace("VALUE", "0.2"), false);
        let image = mean(&material.replace("VALUE", "{ texture = \"wood\" }"), true);
        assert!((plain / image - 1.0).abs() < 0.01, "{material}: {plain} {image}");
    }
}

#[test]
fn what_is_wrong_with_images_is_told() {
    let folder = Folder::new();
    folder.image("wood.png", 4, |_, _| [51; 3]);
    fs::write(folder.0.path().join("text.png"), "no picture").unwrap();
    let scene = |texture: &str, material: &str, shape: &str| {
        folder.load(&format!("[textures.wood]\ntype = \"image\"\n{texture}\n[materials.m]\n{material}\n[[shapes]]\n{shape}\nmaterial = \"m\"\n"))
    };
    let (good, quad) = (
        "file = \"wood.png\"",
        "type = \"quad\"\ncorner = [0, 0, 0]\nedge-u = [1, 0, 0]\nedge-v = [0, 1, 0]",
    );
    let lambert = "type = \"lambert\"\nreflectance = { texture = \"wood\" }";
    assert!(scene(good, lambert, quad).is_ok());
    for (texture, material, shape, told) in [
        ("file = \"gone.png\"", lambert, quad, "there is no file"),
        ("file = \"text.png\"", lambert, quad, "cannot be read"),
        (&*format!("{good}\nwrap = \"round\""), lambert, quad, "one of \"repeat\""),
        (&*format!("{good}\nrepeat = 2"), lambert, quad, "a list of 2 numbers"),
        (&*format!("{good}\nsize = 2"), lambert, quad, "unknown key `size`"),
        (
            good,
            "type = \"lambert\"\nreflectance = { texture = \"oak\" }",
            quad,
            "no image texture is named `oak`",
        ),
        (good, "type = \"lambert\"\nreflectance = { image = \"wood\" }", quad, "unknown key `image`"),
        (
            good,
            "type = \"lambert\"\nreflectance = 1\ntexture = \"wood\"",
            quad,
            "a solid texture, and this is an image",
        ),
        (good, lambert, "type = \"torus\"\nradius = 1\ntube-radius = 0.1", "has no texture coordinates"),
        (good, &format!("{lambert}\ntwo-sided = false"), quad, "leave `two-sided` out"),
        (good, "type = \"lambert\"\nreflectance = 1\ncutout = 0.5", quad, "no image whose alpha"),
        (good, "type = \"dielectric\"\nior = 1.5\nalpha = 0.5", quad, "border of a medium"),
        (good, "type = \"plastic\"\nroughness = 0.1", quad, "has no `colour`"),
        (good, "type = \"principled\"\nmetalic = 1.0", quad, "did you mean `metallic`?"),
        (good, lambert, &format!("{quad}\nillumination-map = true"), "illumination map"),
    ] {
        let error = scene(texture, material, shape).map(|_| ()).unwrap_err();
        assert!(error.contains(told), "{material}: {error}");
    }
}

/// Every metal of the table has a name in scene files, and there are at least twenty.
#[test]
fn metals_by_name() {
    let folder = Folder::new();
    let scene = |metal: &str| {
        folder.load(&format!("[materials.m]\ntype = \"conductor\"\nmetal = \"{metal}\"\n{QUAD}")).map(|_| ())
    };
    let told = scene("unobtainium").unwrap_err();
    let names: Vec<&str> = told.split('`').skip(1).step_by(2).filter(|name| scene(name).is_ok()).collect();
    assert!(names.len() >= 20 && names.contains(&"titanium") && names.contains(&"gold"), "{told}");
}
