//! The first picture of somebody's own model, without any option: there is light in it, and the model is seen.

use base64::Engine;
use cardioid::image_io::{Image, read};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

type Point = [f32; 3];
type Triangles = Vec<[Point; 3]>;

/// What a file shows.
#[derive(Clone, Default)]
struct Model {
    triangles: Triangles,
    /// Triangles of a lamp, which emit `strength` nits.
    lamp: Triangles,
    strength: f32,
    /// Eye, target, up, vertical field of view in degrees.
    camera: Option<(Point, Point, Point, f32)>,
    /// A point light: position and candela.
    point: Option<(Point, f32)>,
    /// Parallel light from above in lux.
    sun: Option<f32>,
}

fn of(triangles: Triangles) -> Model {
    Model { triangles, strength: 1.0, ..Model::default() }
}

impl Model {
    fn camera(self, eye: Point, at: Point) -> Self {
        Self { camera: Some((eye, at, [0.0, 1.0, 0.0], 50.0)), ..self }
    }

    fn scaled(mut self, by: f32) -> Self {
        let scale = |p: &mut Point| p.iter_mut().for_each(|x| *x *= by);
        self.triangles.iter_mut().chain(&mut self.lamp).flatten().for_each(scale);
        if let Some((eye, at, ..)) = &mut self.camera {
            scale(eye);
            scale(at);
        }
        self
    }

    fn inverted(mut self) -> Self {
        self.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        self
    }

    fn gltf(&self) -> Value {
        let mut bytes = Vec::new();
        let (mut views, mut accessors, mut primitives) = (Vec::new(), Vec::new(), Vec::new());
        for (material, triangles) in [&self.triangles, &self.lamp].into_iter().enumerate() {
            if triangles.is_empty() {
                continue;
            }
            let start = bytes.len();
            let points: Vec<Point> = triangles.iter().flatten().copied().collect();
            points.iter().flatten().for_each(|x| bytes.extend(x.to_le_bytes()));
            let pick = |f: fn(f32, f32) -> f32, from: f32| {
                points.iter().fold([from; 3], |all, p| [0, 1, 2].map(|i| f(all[i], p[i])))
            };
            primitives.push(json!({ "attributes": { "POSITION": accessors.len() }, "material": material }));
            accessors.push(json!({
                "bufferView": views.len(), "componentType": 5126, "count": points.len(), "type": "VEC3",
                "min": pick(f32::min, f32::INFINITY), "max": pick(f32::max, f32::NEG_INFINITY),
            }));
            views.push(json!({ "buffer": 0, "byteOffset": start, "byteLength": bytes.len() - start }));
        }
        let mut nodes = vec![json!({ "mesh": 0 })];
        let mut file = json!({
            "asset": { "version": "2.0" },
            "scene": 0,
            "meshes": [{ "primitives": primitives }],
            "materials": [
                { "name": "clay", "doubleSided": true, "pbrMetallicRoughness": {
                    "baseColorFactor": [0.8, 0.3, 0.1, 1], "metallicFactor": 0, "roughnessFactor": 1 } },
                { "name": "lamp", "doubleSided": true, "emissiveFactor": [1, 1, 1],
                    "pbrMetallicRoughness": { "baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0, "roughnessFactor": 1 },
                    "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": self.strength } } },
            ],
            "accessors": accessors,
            "bufferViews": views,
            "extensionsUsed": ["KHR_materials_emissive_strength"],
        });
        if let Some((eye, at, up, fov)) = self.camera {
            nodes.push(json!({ "camera": 0, "matrix": look_at(eye, at, up) }));
            file["cameras"] = json!([{ "type": "perspective", "perspective": { "yfov": fov.to_radians(), "znear": 0.01 } }]);
        }
        let mut lights = Vec::new();
        let mut light = |light: Value, matrix: [f32; 16]| {
            nodes.push(json!({ "matrix": matrix, "extensions": { "KHR_lights_punctual": { "light": lights.len() } } }));
            lights.push(light);
        };
        if let Some((at, candela)) = self.point {
            let below = [at[0], at[1] - 1.0, at[2]];
            light(json!({ "type": "point", "intensity": candela }), look_at(at, below, [0.0, 0.0, 1.0]));
        }
        if let Some(lux) = self.sun {
            let matrix = look_at([0.5, 1.0, 0.3], [0.0; 3], [0.0, 1.0, 0.0]);
            light(json!({ "type": "directional", "intensity": lux }), matrix);
        }
        if !lights.is_empty() {
            file["extensions"] = json!({ "KHR_lights_punctual": { "lights": lights } });
            file["extensionsUsed"] = json!(["KHR_lights_punctual", "KHR_materials_emissive_strength"]);
        }
        file["scenes"] = json!([{ "nodes": (0..nodes.len()).collect::<Vec<_>>() }]);
        file["nodes"] = json!(nodes);
        let text = base64::engine::general_purpose::STANDARD.encode(&bytes);
        let uri = format!("data:application/octet-stream;base64,{text}");
        file["buffers"] = json!([{ "byteLength": bytes.len(), "uri": uri }]);
        file
    }
}

fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(a: Point) -> Point {
    let length = a.iter().map(|x| x * x).sum::<f32>().sqrt();
    a.map(|x| x / length)
}

/// Columns of the matrix of a node at `eye` whose -z points to `at`.
fn look_at(eye: Point, at: Point, up: Point) -> [f32; 16] {
    let z = unit([0, 1, 2].map(|i| eye[i] - at[i]));
    let x = unit(cross(up, z));
    let y = cross(z, x);
    let mut matrix = [0.0; 16];
    for (column, vector) in [x, y, z, eye].into_iter().enumerate() {
        matrix[4 * column..4 * column + 3].copy_from_slice(&vector);
    }
    matrix[15] = 1.0;
    matrix
}

/// A grid over [-1, 1]^2 with these heights, its fronts up.
fn terrain(height: impl Fn(f32, f32) -> f32) -> Triangles {
    const CELLS: i32 = 24;
    let point = |i: i32, j: i32| {
        let (x, z) = (2.0 * i as f32 / CELLS as f32 - 1.0, 2.0 * j as f32 / CELLS as f32 - 1.0);
        [x, height(x, z), z]
    };
    let mut triangles = Vec::new();
    for i in 0..CELLS {
        for j in 0..CELLS {
            let [a, b, c, d] = [point(i, j), point(i, j + 1), point(i + 1, j + 1), point(i + 1, j)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    triangles
}

fn hills() -> Triangles {
    terrain(|x, z| 0.15 * (4.0 * x).sin() * (3.0 * z + 1.0).cos())
}

fn crater() -> Triangles {
    terrain(|x, z| {
        let r = x.hypot(z);
        0.8 * (-(r - 0.6).powi(2) / 0.03).exp()
    })
}

fn quad(a: Point, b: Point, c: Point, d: Point) -> Triangles {
    vec![[a, b, c], [a, c, d]]
}

/// Sides of a box, by axis and side.
#[derive(Clone, Copy, PartialEq)]
struct Side(usize, bool);

const FLOOR: Side = Side(1, false);
const CEILING: Side = Side(1, true);

/// A box with its fronts outwards, without some sides.
fn boxed(min: Point, max: Point, without: &[Side]) -> Triangles {
    let mut triangles = Vec::new();
    for axis in 0..3 {
        for is_upper in [false, true] {
            if without.contains(&Side(axis, is_upper)) {
                continue;
            }
            let corner = |u: bool, v: bool| {
                let mut at = min;
                at[axis] = if is_upper { max[axis] } else { min[axis] };
                for (i, is_far) in [((axis + 1) % 3, u), ((axis + 2) % 3, v)] {
                    at[i] = if is_far { max[i] } else { min[i] };
                }
                at
            };
            let mut side =
                quad(corner(false, false), corner(true, false), corner(true, true), corner(false, true));
            if !is_upper {
                side.iter_mut().for_each(|triangle| triangle.swap(1, 2));
            }
            triangles.extend(side);
        }
    }
    triangles
}

/// A room of 4 x 2.6 x 5 m with its fronts inwards.
fn room(without: &[Side]) -> Model {
    of(boxed([0.0; 3], [4.0, 2.6, 5.0], without)).inverted()
}

/// The same with a window in the wall at x = 0.
fn room_with_window() -> Model {
    let mut model = room(&[Side(0, false)]);
    let (y, z) = ([0.0, 0.9, 2.1, 2.6], [0.0, 1.5, 3.5, 5.0]);
    for i in 0..3 {
        for j in 0..3 {
            if (i, j) != (1, 1) {
                let at = |a: usize, b: usize| [0.0, y[a], z[b]];
                model.triangles.extend(quad(at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)));
            }
        }
    }
    model
}

/// Part of a sphere of radius 1 up to a height, its fronts outwards.
fn ball(up_to: f32) -> Triangles {
    const ROWS: i32 = 12;
    let top = up_to.acos();
    let point = |i: i32, j: i32| {
        let (latitude, angle) = (
            top + (std::f32::consts::PI - top) * i as f32 / ROWS as f32,
            std::f32::consts::TAU * (j % (2 * ROWS)) as f32 / (2 * ROWS) as f32,
        );
        [latitude.sin() * angle.cos(), latitude.cos(), latitude.sin() * angle.sin()]
    };
    let mut triangles = Vec::new();
    for i in 0..ROWS {
        for j in 0..2 * ROWS {
            let [a, b, c, d] = [point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)];
            triangles.extend([[a, c, b], [a, d, c]]);
        }
    }
    triangles
}

/// Slopes over a ridge along z; `is_closed` has gables.
fn tent(is_closed: bool) -> Triangles {
    let (l, r) = (-1.0, 1.0);
    let mut triangles = quad([l, 0.0, 1.5], [0.0, 1.5, 1.5], [0.0, 1.5, -1.5], [l, 0.0, -1.5]);
    triangles.extend(quad([r, 0.0, -1.5], [0.0, 1.5, -1.5], [0.0, 1.5, 1.5], [r, 0.0, 1.5]));
    if is_closed {
        triangles.push([[l, 0.0, 1.5], [r, 0.0, 1.5], [0.0, 1.5, 1.5]]);
        triangles.push([[r, 0.0, -1.5], [l, 0.0, -1.5], [0.0, 1.5, -1.5]]);
    }
    triangles
}

/// Renders a file, and yields the picture, the bytes of its PNG and what was said.
fn render(path: &Path, options: &[&str]) -> (Image, Vec<f32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_cardioid"))
        .current_dir(path.parent().unwrap())
        .stdin(Stdio::null())
        .args(["render", path.file_name().unwrap().to_str().unwrap()])
        .args(["--quality", "draft", "--resolution", "32x24", "--global-photons", "4000", "-o"])
        .arg(path.with_extension("exr"))
        .args(options)
        .output()
        .unwrap();
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{}: {told}", path.display());
    let png = read(path.with_extension("png")).unwrap().layers[0].data.clone();
    (read(path.with_extension("exr")).unwrap(), png, told)
}

fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("first_pictures");
    fs::create_dir_all(&folder).unwrap();
    folder
}

/// Renders a model as it is: something is lit, the PNG is neither black nor white, and the model is in the picture. What was
/// said has `word` in it, and that it is a room where it `is_room`.
#[track_caller]
fn check(name: &str, model: &Model, is_room: bool, word: &str) -> Image {
    let path = folder().join(name).with_extension("gltf");
    fs::write(&path, model.gltf().to_string()).unwrap();
    let (image, png, told) = render(&path, &[]);
    assert_eq!(told.contains("taken for a room"), is_room, "{name}: {told}");
    // A lamp that is faint beside the others has few photons, and that is said.
    let is_odd = |line: &str| line.starts_with("warning") && !line.contains("fewer than 100 each");
    assert!(told.contains(word) && !told.lines().any(is_odd), "{name}: {told}");
    let beauty = &image.layer("").unwrap().data;
    assert!(beauty.iter().sum::<f32>() > 0.0, "{name} is black: {told}");
    let mean = png.iter().sum::<f32>() / png.len() as f32;
    assert!(mean > 0.02 && mean < 0.98, "{name}: the mean of the PNG is {mean}; {told}");
    let albedo = &image.layer("albedo").unwrap().data;
    let is_clay = |(albedo, light): &(&[f32], &[f32])| albedo[0] > 3.0 * albedo[2] && light[0] > 0.0;
    let seen = albedo.chunks_exact(3).zip(beauty.chunks_exact(3)).filter(is_clay).count();
    assert!(100 * seen > beauty.len() / 3, "{name}: the model is seen in {seen} pixels; {told}");
    image
}

#[test]
fn open_models_are_lit_from_outside() {
    check("hills", &of(hills()), false, "no light in the file");
    check("hills eye height", &of(hills()).camera([0.0, 0.3, 0.9], [0.0, 0.1, -1.0]), false, "studio");
    check("crater", &of(crater()), false, "shown from above");
    check("crater bottom", &of(crater()).camera([0.0, 0.2, 0.0], [0.5, 0.4, 0.0]), false, "studio");
    check("bowl", &of(ball(0.0)).inverted(), false, "shown from above");
    check("bowl inverted", &of(ball(0.0)), false, "shown from above");
    check("tent", &of(tent(false)), false, "studio");
    check("tent with camera", &of(tent(false)).camera([0.0, 0.5, 1.0], [0.0, 0.6, -1.5]), false, "studio");
    check("hills in the sun", &Model { sun: Some(50_000.0), ..of(hills()) }, false, "");
}

#[test]
fn rooms_are_lit_from_within() {
    let inside = |model: Model| model.camera([3.0, 1.5, 4.0], [0.5, 1.0, 0.5]);
    check("room", &room(&[]), true, "shown from within");
    check("room with camera", &inside(room(&[])), true, "enclosed");
    check("room inside out", &inside(room(&[]).inverted()), true, "enclosed");
    check("room without ceiling", &room(&[CEILING]), false, "shown from above");
    check("room without ceiling with camera", &inside(room(&[CEILING])), false, "studio");
    check("room without floor", &inside(room(&[FLOOR])), true, "enclosed");
    check("room without wall", &room(&[Side(2, true)]), false, "studio");
    check("room with window", &inside(room_with_window()), true, "enclosed");
    check("closed tent", &of(tent(true)).camera([0.0, 0.5, 1.0], [0.0, 0.6, -1.5]), true, "enclosed");
    let lamp = quad([1.5, 2.5, 2.0], [2.5, 2.5, 2.0], [2.5, 2.5, 3.0], [1.5, 2.5, 3.0]);
    let with_lamp = |strength| Model { lamp: lamp.clone(), strength, ..inside(room(&[])) };
    check("room with lamp", &with_lamp(1.0), true, "surfaces that emit are all its light");
    check("room with bright lamp", &with_lamp(1e4), true, "surfaces that emit are all its light");
    let lit = Model { point: Some(([2.0, 2.0, 2.0], 200.0)), ..inside(room(&[])) };
    check("room with point light", &lit, true, "");
    let mut thick = room(&[]);
    thick.triangles.extend(boxed([-0.3; 3], [4.3, 2.9, 5.3], &[]));
    check("thick walls with camera", &inside(thick.clone()), true, "enclosed");
    check("thick walls", &thick, false, "studio");
    check("up at the ceiling", &room(&[]).camera([2.0, 1.0, 2.5], [2.1, 2.6, 2.5]), true, "enclosed");
}

#[test]
fn bodies_are_seen_from_outside() {
    let cube = || of(boxed([-0.5; 3], [0.5; 3], &[]));
    check("box", &cube(), false, "a ground is added");
    check("box inside out", &of(ball(0.999)).inverted(), false, "studio");
    check("box open below", &of(boxed([-0.5; 3], [0.5; 3], &[FLOOR])), false, "studio");
    let plain = check("box with camera", &cube().camera([0.0, 1.5, 6.0], [0.0; 3]), false, "studio");
    // The studio's lamp does not stand in the picture, wherever the camera is.
    let is_lamp = |image: &Image| {
        let albedo = image.layer("albedo").unwrap().data.clone();
        let depth = image.layer("depth").unwrap().data.clone();
        albedo
            .chunks_exact(3)
            .zip(depth)
            .any(|(albedo, depth)| albedo == [0.0; 3] && depth.is_finite() && depth > 0.0)
    };
    assert!(!is_lamp(&plain));
    for turn in 0..4 {
        let (sin, cos) = (turn as f32 * 1.7).sin_cos();
        for (height, distance) in [(0.6, 5.0), (3.5, 3.5)] {
            let camera = cube().camera([distance * sin, height, distance * cos], [0.0; 3]);
            let image = check(&format!("box turned {turn} {height}"), &camera, false, "studio");
            assert!(!is_lamp(&image), "{turn} {height}");
        }
    }
    let wide = Model { camera: Some(([0.0, 0.6, 1.2], [0.0, 0.2, 0.0], [0.0, 1.0, 0.0], 150.0)), ..cube() };
    assert!(!is_lamp(&check("box with a wide camera", &wide, false, "studio")));
    let lit = Model { point: Some(([1.0, 2.0, 1.0], 800.0)), ..cube() };
    check("box with point light", &lit, false, "");
    let lamp = boxed([-0.2, 1.0, -0.2], [0.2, 1.2, 0.2], &[]);
    check("box with bright lamp", &Model { lamp: lamp.clone(), strength: 5e3, ..cube() }, false, "that emit");
    check("box with faint lamp", &Model { lamp, strength: 0.05, ..cube() }, false, "studio");
    // A light of nothing is none.
    check("box with dark light", &Model { point: Some(([1.0, 2.0, 1.0], 0.0)), ..cube() }, false, "studio");
    // z up: the camera stands upright by z, below the model in the file's terms.
    let mut floor = quad([-5.0, -5.0, -0.5], [5.0, -5.0, -0.5], [5.0, 5.0, -0.5], [-5.0, 5.0, -0.5]);
    floor.extend(boxed([-0.5; 3], [0.5; 3], &[]));
    let upright = Model {
        camera: Some(([3.0, -7.0, 4.0], [0.0; 3], [0.0, 0.0, 1.0], 35.0)),
        point: Some(([2.0, -2.0, 4.0], 2000.0)),
        ..of(floor)
    };
    check("z up", &upright, false, "export with that");
    check("from below", &cube().camera([0.0, -4.0, 2.0], [0.0; 3]), false, "below the model");
    for scale in [1e-5, 1e-2, 1e3, 1e6] {
        check(&format!("box {scale}"), &cube().scaled(scale), false, "studio");
        check(&format!("room {scale}"), &room(&[]).scaled(scale), true, "within");
        let camera = room(&[]).camera([3.0, 1.5, 4.0], [0.5, 1.0, 0.5]).scaled(scale);
        check(&format!("room with camera {scale}"), &camera, true, "enclosed");
    }
}

/// What is in the file that Blender's exporter wrote: a smooth sphere, a cube and a plane of one material, all with split vertices.
#[test]
fn glass_of_blender_is_solid_where_it_is_closed() {
    let folder = folder();
    let path = folder.join("glass.glb");
    fs::copy(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/gltf/blender-glass.glb"), &path).unwrap();
    let max = |image: &Image| image.layer("caustics").unwrap().data.iter().copied().fold(0.0, f32::max);
    let (solid, _, told) = render(&path, &["--caustic-photons", "40000"]);
    assert!(told.contains("2 closed meshes of it are solid, of index 1.45"), "{told}");
    assert!(told.contains("1 open mesh of it is a sheet"), "{told}");
    let (sheets, _, told) = render(&path, &["--set", "solid=no", "--caustic-photons", "40000"]);
    assert!(told.contains("3 open meshes") || told.contains("3 meshes of it are sheets"), "{told}");
    // Only what is solid gathers light.
    assert!(max(&solid) > 2.0 * max(&sheets), "{} {}", max(&solid), max(&sheets));
    let info = |options: &[&str]| {
        let program = Command::new(env!("CARGO_BIN_EXE_cardioid"));
        let output = { program }.args(["info"]).arg(&path).args(options).output().unwrap();
        (
            output.status.success(),
            String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned(),
        )
    };
    let (_, told) = info(&[]);
    assert!(told.contains("Glass: border of a medium of index 1.45 in air, smooth"), "{told}");
    assert!(told.contains("Glass: sheet that does not bend light"), "{told}");
    assert!(!info(&["--set", "solid:Glass=no"]).1.contains("border of a medium"));
    assert!(!info(&["--set", "solid=no", "--set", "solid:Glass=yes"]).1.contains("sheet that"));
    let (is_right, told) = info(&["--set", "solid:Glas=no"]);
    assert!(!is_right && told.contains("Glass"), "{told}");
}

fn obj(triangles: &Triangles) -> String {
    let point = |p: &Point| format!("v {} {} {}\n", p[0], p[1], p[2]);
    let corners: String = triangles.iter().flatten().map(point).collect();
    let faces = (0..triangles.len()).map(|i| format!("f {} {} {}\n", 3 * i + 1, 3 * i + 2, 3 * i + 3));
    corners + &faces.collect::<String>()
}

#[test]
fn a_mesh_alone_keeps_its_lengths() {
    let folder = folder();
    let cube = |name: &str, scale: f32, by: Point| {
        let mut triangles = boxed([-0.5; 3], [0.5; 3], &[]);
        let place = |p: &mut Point| *p = [0, 1, 2].map(|i| p[i] * scale + by[i]);
        triangles.iter_mut().flatten().for_each(place);
        let path = folder.join(name);
        fs::write(&path, obj(&triangles)).unwrap();
        path
    };
    let (small, _, told) = render(&cube("small.obj", 1.0, [0.0; 3]), &["--spp", "16"]);
    assert!(told.contains("small.obj keeps its lengths, 1 x 1 x 1 m") && !told.contains("room"), "{told}");
    let (large, _, told) = render(&cube("large.obj", 64.0, [100.0, -20.0, 7.0]), &["--spp", "16"]);
    assert!(told.contains("64 x 64 x 64 m"), "{told}");
    let sum = |image: &Image| image.layer("").unwrap().data.iter().sum::<f32>();
    assert!((sum(&large) / sum(&small) - 1.0).abs() < 0.05, "{} {}", sum(&large), sum(&small));
    let depth = |image: &Image| image.layer("depth").unwrap().pixel(12 * 32 + 16).unwrap()[0];
    assert!((depth(&large) / depth(&small) / 64.0 - 1.0).abs() < 1e-3, "{} {}", depth(&large), depth(&small));

    // A room, in every form, is shown from within.
    let path = folder.join("room.obj");
    fs::write(&path, obj(&room(&[]).triangles)).unwrap();
    let check = |path: &Path| {
        let (image, png, told) = render(path, &[]);
        assert!(told.contains("taken for a room") && told.contains("4 x 2.6 x 5 m"), "{told}");
        assert!(!told.contains("warning"), "{told}");
        let mean = png.iter().sum::<f32>() / png.len() as f32;
        assert!(mean > 0.05 && mean < 0.95, "{mean}");
        // No farther than across the room.
        assert!(image.layer("depth").unwrap().data.iter().all(|depth| *depth > 0.0 && *depth < 7.0));
    };
    check(&path);
    let stl: String = room(&[])
        .triangles
        .iter()
        .map(|triangle| {
            let corner = |p: &Point| format!("vertex {} {} {}\n", p[0], p[1], p[2]);
            let corners: String = triangle.iter().map(corner).collect();
            format!("facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n")
        })
        .collect();
    let path = folder.join("room.stl");
    fs::write(&path, format!("solid room\n{stl}endsolid room\n")).unwrap();
    check(&path);
    let (_, _, told) = render(&path, &["--set", "room=no"]);
    assert!(!told.contains("taken for a room"), "{told}");
    // Of z up the same.
    let turned: Triangles =
        room(&[]).triangles.iter().map(|triangle| triangle.map(|[x, y, z]| [x, -z, y])).collect();
    let path = folder.join("room z.obj");
    fs::write(&path, obj(&turned)).unwrap();
    let (_, _, told) = render(&path, &["--up", "z"]);
    assert!(told.contains("taken for a room") && told.contains("4 x 5 x 2.6 m"), "{told}");
    // Lit by its own lamp.
    let mut lamp = obj(&room(&[]).triangles).replace("f 1 ", "mtllib lamp.mtl\nusemtl wall\nf 1 ");
    lamp += "v 1.5 2.5 2\nv 2.5 2.5 2\nv 2.5 2.5 3\nv 1.5 2.5 3\nusemtl lamp\nf -4 -3 -2 -1\n";
    fs::write(
        folder.join("lamp.mtl"),
        "newmtl wall\nKd 0.7 0.7 0.7\nnewmtl lamp\nKd 0 0 0\nKe 500 500 500\n",
    )
    .unwrap();
    let path = folder.join("lamp.obj");
    fs::write(&path, lamp).unwrap();
    let (_, png, told) = render(&path, &[]);
    assert!(told.contains("surfaces that emit are all its light"), "{told}");
    let mean = png.iter().sum::<f32>() / png.len() as f32;
    assert!(mean > 0.05 && mean < 0.95, "{mean}: {told}");
}

#[test]
fn exposure_follows_the_picture_where_none_is_given() {
    let folder = folder();
    let scene = |film: &str, light: &str| {
        format!(
            "[camera]\neye = [0, 1, 4]\nat = [0, 0.3, 0]\n[film]\nwidth = 32\nheight = 24\n{film}\n[[shapes]]\ntype = \"sphere\"\n\
             center = [0, 0.5, 0]\nradius = 0.5\nmaterial = \"grey\"\n[[shapes]]\ntype = \"disc\"\nradius = 10.0\n\
             material = \"grey\"\n[materials.grey]\ntype = \"lambert\"\nreflectance = 0.5\n{light}"
        )
    };
    let sky = "[[lights]]\ntype = \"sky\"\nelevation = 40.0\n";
    let faint = "[[lights]]\ntype = \"environment\"\nradiance = 1e-7\n";
    let write = |name: &str, text: String| {
        let path = folder.join(name);
        fs::write(&path, text).unwrap();
        path
    };
    let mean = |png: &[f32]| png.iter().sum::<f32>() / png.len() as f32;
    let beauty = |image: &Image| image.layer("").unwrap().data.clone();
    for light in [sky, faint] {
        let (automatic, png, told) = render(&write("automatic.toml", scene("", light)), &[]);
        assert!(told.contains("chosen by the picture") && !told.contains("warning"), "{told}");
        assert!(mean(&png) > 0.15 && mean(&png) < 0.85, "{}", mean(&png));
        // Radiance is the same whatever is shown of it.
        let (given, png, told) = render(&write("given.toml", scene("exposure = 0.0", light)), &[]);
        assert_eq!(beauty(&automatic), beauty(&given));
        assert!(!told.contains("chosen by the picture"), "{told}");
        let help = told
            .split("try --exposure ")
            .nth(1)
            .and_then(|rest| rest.split_whitespace().next())
            .unwrap()
            .to_owned();
        assert!(mean(&png) == 0.0 || mean(&png) > 0.8, "{}", mean(&png));
        let (_, png, told) = render(&folder.join("given.toml"), &["--exposure", &help]);
        assert!(mean(&png) > 0.15 && mean(&png) < 0.85 && !told.contains("warning"), "{told}");
    }
    let value = |image: &Image, name: &str| {
        image.metadata.iter().find(|(key, _)| key == name).map(|(_, value)| format!("{value:?}")).unwrap()
    };
    let (image, ..) = render(&folder.join("automatic.toml"), &[]);
    assert!(value(&image, "cardioid/exposureFrom").contains("picture"));
    assert!(value(&image, "cardioid/exposure").contains("Double"));
    let (image, ..) = render(&folder.join("automatic.toml"), &["--exposure", "3"]);
    assert!(value(&image, "cardioid/exposureFrom").contains("command line"));
    // Without light that is said, with what to do.
    let (_, _, told) = render(&write("dark.toml", scene("", "")), &[]);
    assert!(told.contains("warning") && told.contains("no light") && told.contains("[[lights]]"), "{told}");
    let off = "[[lights]]\ntype = \"point\"\nposition = [0, 5, 0]\nintensity = [0, 0, 0]\n";
    let (_, _, told) = render(&write("off.toml", scene("", off)), &[]);
    assert!(told.contains("power of zero"), "{told}");
}
