use super::*;
use crate::embree::Device;
use crate::observer::Silent;
use crate::scene_file::{BuiltScene, build_scene, parse_scene};
use std::path::Path;
use std::sync::{Arc, LazyLock};

fn built(text: &str) -> BuiltScene {
    static DEVICE: LazyLock<Arc<Device>> = LazyLock::new(|| Arc::new(Device::new(1).unwrap()));
    let head = "[camera]\neye = [0.5, 0.5, -2]\nat = [0.5, 0.5, 0.5]\n";
    let text = if text.contains("[camera]") { text.to_owned() } else { format!("{head}{text}") };
    let description =
        parse_scene(&text, Path::new("test.toml"), &[]).unwrap_or_else(|e| panic!("{e}\n{text}"));
    build_scene(&description, &DEVICE, (4, 4)).unwrap()
}

fn quad(corner: &str, u: &str, v: &str, more: &str) -> String {
    format!(
        "[[shapes]]\ntype = \"quad\"\ncorner = {corner}\nedge-u = {u}\nedge-v = {v}\nmaterial = \"grey\"\n{more}\n"
    )
}

fn grey(reflectance: f64) -> String {
    format!("[materials.grey]\ntype = \"lambert\"\nreflectance = {reflectance}\n")
}

const GLOWS: &str = "emission = { radiance = 1.0 }";

/// The inside of the unit cube, as six quads that face inwards; `more` by quad: floor, ceiling, and the walls.
fn room(reflectance: f64, more: impl Fn(usize) -> &'static str) -> String {
    let (x, y, z) = ("[1, 0, 0]", "[0, 1, 0]", "[0, 0, 1]");
    let sides = [
        ("[0, 0, 0]", z, x),
        ("[0, 1, 0]", x, z),
        ("[0, 0, 0]", x, y),
        ("[0, 0, 1]", y, x),
        ("[0, 0, 0]", y, z),
        ("[1, 0, 0]", z, y),
    ];
    let quads = sides.iter().enumerate().map(|(i, (corner, u, v))| quad(corner, u, v, more(i)));
    grey(reflectance) + &quads.collect::<String>()
}

/// A small lamp below the middle of the ceiling, and a board that shades half of the floor.
fn lit_room() -> String {
    room(0.6, |_| "")
        + &quad("[0.4, 0.98, 0.4]", "[0.2, 0, 0]", "[0, 0, 0.2]", GLOWS)
        + &quad("[0.0, 0.5, 0.2]", "[0.5, 0, 0]", "[0, 0, 0.6]", "")
}

fn options(method: Method, patches: usize) -> RadiosityOptions {
    RadiosityOptions { method, patches, ..RadiosityOptions::default() }
}

fn solve(text: &str, options: &RadiosityOptions) -> Radiosity {
    Radiosity::compute(&built(text).scene, options, None, None, &Silent).unwrap()
}

/// The patches that are lit, with their areas in square metres and their radiosity in W/m^2, first channel.
fn lit(solution: &Radiosity, scene: &Scene) -> Vec<(f64, f64)> {
    let space = scene.space();
    let elements = solution.model.elements.iter().enumerate();
    elements
        .filter(|(i, element)| element.children == NONE && solution.irradiance[*i].total() != Rgb::ZERO)
        .map(|(i, element)| {
            (element.area / (space.scale * space.scale), solution.state.radiosity[i].x / space.power)
        })
        .collect()
}

/// The form factor between two quads of one square metre, with what the division of both into `patches` gives.
fn between_quads(second: (&str, &str, &str), patches: usize) -> (f64, f64) {
    let text = grey(0.5)
        + &quad("[0, 0, 0]", "[0, 0, 1]", "[1, 0, 0]", GLOWS)
        + &quad(second.0, second.1, second.2, "");
    let built = built(&text);
    let solution =
        Radiosity::compute(&built.scene, &options(Method::Matrix, patches), None, None, &Silent).unwrap();
    let scale = built.scene.space().scale;
    let sum: f64 = solution.links.iter().map(|link| f64::from(link.exchange)).sum();
    let variance: f64 = solution.links.iter().map(|link| f64::from(link.error).powi(2)).sum();
    (sum / (scale * scale), variance.sqrt() / (scale * scale))
}

#[test]
fn form_factors_of_squares() {
    // Howell's catalogue, C-11 and C-14; the quadrature over the first square leaves what the error states, and division makes it small.
    let parallel = ("[0, 1, 0]", "[1, 0, 0]", "[0, 0, 1]");
    let upright = ("[0, 0, 0]", "[1, 0, 0]", "[0, 1, 0]");
    for (second, exact) in [(parallel, 0.199_824_895_698_387_46), (upright, 0.200_043_776_075_403_16)] {
        let (coarse, error) = between_quads(second, 4);
        assert!((coarse - exact).abs() < error.max(1e-4), "{coarse} +- {error} for {exact}");
        let (fine, _) = between_quads(second, 256);
        assert!((fine - exact).abs() < 1e-3 * exact, "{fine} for {exact}");
    }
}

#[test]
fn exchanges_are_the_same_from_both_ends_to_the_bit() {
    let built = built(&lit_room());
    let mut hierarchy_options = options(Method::Matrix, 64);
    hierarchy_options.strata = 3;
    let model = Model::new(&built.scene, Specular::Refuse).unwrap();
    let factors = FormFactors { scene: &built.scene, strata: 2, seed: 0 };
    let mut hierarchy = Hierarchy::new(factors, &hierarchy_options, model);
    hierarchy.divide_uniformly();
    let mut partly = 0;
    for i in 0..hierarchy.model.elements.len() as u32 {
        for j in 0..i {
            let (a, b) = (factors.between(&hierarchy.model, i, j), factors.between(&hierarchy.model, j, i));
            assert_eq!(a.exchange.to_bits(), b.exchange.to_bits());
            assert_eq!(a.spread, [b.spread[1], b.spread[0]]);
            let free = FormFactors { scene: &built.scene, strata: 1, seed: 0 };
            partly += u32::from(
                a.exchange > 0.0 && free.between(&hierarchy.model, i, j).exchange > 1.5 * a.exchange,
            );
        }
    }
    assert!(partly > 0, "the board shades nothing");
}

#[test]
fn form_factors_of_a_closed_room_sum_to_one() {
    for (method, patches, bound) in [(Method::Matrix, 400, 0.01), (Method::Hierarchy, 600, 0.02f64)] {
        let solution = solve(&lit_room(), &options(method, patches));
        let rows = Rows::new(&solution.model, &solution.links);
        let sums = rows.sums(&solution.model);
        let report = solution.report();
        assert!((report.row_sum - 1.0).abs() < bound.min(4.0 * report.row_error), "{report:?}");
        for (i, element) in solution.model.elements.iter().enumerate().filter(|(_, e)| e.children == NONE) {
            if solution.irradiance[i].total() != Rgb::ZERO {
                // Links of large elements spread evenly over them what corners get less or more of.
                let most = if method == Method::Matrix { 0.1 } else { 0.5 };
                assert!((sums[i] - 1.0).abs() < most, "{method:?}: {} {element:?}", sums[i]);
            }
        }
    }
}

/// In a closed room whose walls all emit, radiosity is `E / (1 - rho)` everywhere.
#[test]
fn the_furnace() {
    let (reflectance, exitance) = (0.5, std::f64::consts::PI);
    let sphere = grey(reflectance)
        + "[[shapes]]\ntype = \"sphere\"\ncenter = [0.5, 0.5, 0.5]\nradius = 1.0\nflip-normal = true\nmaterial = \"grey\"\n"
        + GLOWS;
    let cube = room(reflectance, |_| GLOWS);
    let exact = exitance / (1.0 - reflectance);
    for (name, text) in [("cube", cube), ("sphere", sphere)] {
        for method in [Method::Hierarchy, Method::Matrix, Method::Shooting] {
            let built = built(&text);
            let solution =
                Radiosity::compute(&built.scene, &options(method, 500), None, None, &Silent).unwrap();
            let lit = lit(&solution, &built.scene);
            let area: f64 = lit.iter().map(|(area, _)| area).sum();
            let mean = lit.iter().map(|(area, radiosity)| area * radiosity).sum::<f64>() / area;
            let worst = lit.iter().map(|(_, radiosity)| (radiosity / exact - 1.0).abs()).fold(0.0, f64::max);
            println!("{name}, {method:?}: mean {:.5}, worst patch {worst:.4}", mean / exact);
            assert!((mean / exact - 1.0).abs() < 0.005, "{name}, {method:?}: {mean} for {exact}");
            // Links of large elements spread evenly over them what corners get less or more of.
            let most = if method == Method::Hierarchy { 0.15 } else { 1e-3 };
            assert!(worst < most, "{name}, {method:?}: {worst}");
        }
    }
}

/// Two patches that face each other: `B_1 = E / (1 - rho^2 F^2)`, `B_2 = rho F B_1`.
#[test]
fn parallel_plates() {
    let text = grey(0.7)
        + &quad("[0, 0, 0]", "[0, 0, 1]", "[1, 0, 0]", GLOWS)
        + &quad("[0, 1, 0]", "[1, 0, 0]", "[0, 0, 1]", "");
    let (factor, reflectance, exitance) = (0.199_824_895_7f64, 0.7, std::f64::consts::PI);
    let first = exitance / (1.0 - (reflectance * factor).powi(2));
    for method in [Method::Matrix, Method::Shooting, Method::Hierarchy] {
        let built = built(&text);
        let solution = Radiosity::compute(&built.scene, &options(method, 4), None, None, &Silent).unwrap();
        let mut found: Vec<f64> =
            lit(&solution, &built.scene).iter().map(|(_, radiosity)| *radiosity).collect();
        found.sort_by(f64::total_cmp);
        let exact = [reflectance * factor * first, first];
        assert_eq!(found.len(), 2, "{method:?}: {found:?}");
        for (found, exact) in found.iter().zip(exact) {
            assert!((found / exact - 1.0).abs() < 1e-3, "{method:?}: {found} for {exact}");
        }
    }
}

/// A point light in the middle of a sphere: `E = I / r^2`, `B = rho E / (1 - rho)`.
#[test]
fn light_sources_without_a_surface() {
    let text = grey(0.5)
        + "[[shapes]]\ntype = \"sphere\"\ncenter = [0.5, 0.5, 0.5]\nradius = 2.0\nmaterial = \"grey\"\n[[lights]]\ntype = \"point\"\n\
           position = [0.5, 0.5, 0.5]\nintensity = 3.0\n";
    let built = built(&text);
    let solution =
        Radiosity::compute(&built.scene, &options(Method::Hierarchy, 200), None, None, &Silent).unwrap();
    for (_, radiosity) in lit(&solution, &built.scene) {
        assert!((radiosity / 0.75 - 1.0).abs() < 0.02, "{radiosity}");
    }
}

#[test]
fn methods_agree_and_energy_is_kept() {
    let by = |method, patches| {
        let solution = solve(&lit_room(), &options(method, patches));
        let balance = solution.report().balance;
        for channel in 0..3 {
            let [emitted, absorbed, escaped] =
                [balance.emitted, balance.absorbed, balance.escaped].map(|rgb| rgb[channel]);
            assert!((emitted - 0.04 * std::f64::consts::PI).abs() < 1e-5, "{emitted}");
            assert!(
                (absorbed + escaped - emitted).abs() < 1e-9 && escaped.abs() < 0.01 * emitted,
                "{balance:?}"
            );
        }
        // Light that the board reflects on both sides, and the light of the floor in its shadow and beside it.
        let mut sums = [0.0; 4];
        let elements = solution.model.elements.iter().enumerate();
        for (i, element) in elements.filter(|(_, element)| element.children == NONE) {
            let part = match (element.surface, element.back) {
                (0, false) => usize::from(element.center.x > 0.0),
                (7, back) => 2 + usize::from(back),
                _ => continue,
            };
            sums[part] += f64::from(solution.irradiance[i].total().x) * element.area;
        }
        sums
    };
    let reference = by(Method::Matrix, 1500);
    for (method, patches) in [(Method::Shooting, 1000), (Method::Hierarchy, 1500)] {
        let found = by(method, patches);
        for (found, reference) in found.iter().zip(reference) {
            assert!((found / reference - 1.0).abs() < 0.04, "{method:?}: {found} for {reference}");
        }
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    for method in [Method::Hierarchy, Method::Shooting] {
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut bytes = Vec::new();
                write_radiosity(&mut bytes, &solve(&lit_room(), &options(method, 300))).unwrap();
                bytes
            })
        };
        assert!(with(1) == with(3), "{method:?}");
    }
}

#[test]
fn patches_follow_the_edge_of_a_shadow() {
    let built = built(&lit_room());
    let solution =
        Radiosity::compute(&built.scene, &options(Method::Hierarchy, 3000), None, None, &Silent).unwrap();
    // The floor: the board shades it up to about the middle, within z of 0.2 to 0.8.
    let floor = solution.model.elements.iter().filter(|e| e.surface == 0 && !e.back && e.children == NONE);
    let space = built.scene.space();
    let smallest_at = |x: f64, z: f64| {
        let near = floor.clone().filter(|element| {
            let at = space.world_position(element.center);
            (at.x - x).abs() < 0.1 && (at.z - z).abs() < 0.1
        });
        near.map(|element| element.area).fold(f64::INFINITY, f64::min)
    };
    assert!(
        smallest_at(0.5, 0.5) <= 0.3 * smallest_at(0.78, 0.5),
        "{} {}",
        smallest_at(0.5, 0.5),
        smallest_at(0.78, 0.5)
    );
}

#[test]
fn interpolation_has_no_seams() {
    let built = built(&lit_room());
    let solution =
        Radiosity::compute(&built.scene, &options(Method::Hierarchy, 2000), None, None, &Silent).unwrap();
    let down = |x: f32, z: f32| {
        let space = built.scene.space();
        let origin = space.position(glam::DVec3::new(x.into(), 0.2, z.into())).as_vec3();
        let hit = built.scene.intersect(&crate::math::Ray::new(origin, glam::Vec3::NEG_Y)).unwrap();
        (solution.interpolated(&hit).total().x, solution.of_patch(&hit).total().x)
    };
    let (mut before, mut largest) = (down(0.05, 0.437), 0.0f32);
    let (mut sum, mut sum_flat, mut jump) = (0.0, 0.0, 0.0f32);
    for i in 1..=9000 {
        let now = down(0.05 + 1e-4 * i as f32, 0.437);
        jump = jump.max((now.0 - before.0).abs());
        largest = largest.max(now.0);
        (sum, sum_flat) = (sum + now.0, sum_flat + now.1);
        before = now;
    }
    // A ten thousandth of the room: the smallest patch is sixty of those wide.
    assert!(jump < 0.02 * largest, "a step of {jump} of {largest}");
    assert!((sum / sum_flat - 1.0).abs() < 0.02, "{sum} {sum_flat}");
}

/// What is computed again after a change, with the file of the solution before it.
#[test]
fn what_changed_decides_where_it_restarts() {
    for method in [Method::Matrix, Method::Hierarchy] {
        let options = options(method, 200);
        let text = format!("[camera]\neye = [0.5, 0.5, 0.1]\nat = [0.5, 0.5, 0.5]\n{}", lit_room());
        let first = Radiosity::compute(&built(&text).scene, &options, None, None, &Silent).unwrap();
        assert!(first.report().steps.model && first.report().steps.form_factors > 0);
        let mut bytes = Vec::new();
        write_radiosity(&mut bytes, &first).unwrap();
        let again = |from: &str, to: &str| {
            assert!(text.contains(from));
            let saved = file::parse(&bytes).unwrap();
            let scene = built(&text.replacen(from, to, 1)).scene;
            let anew = Radiosity::compute(&scene, &options, None, None, &Silent).unwrap();
            let solution = Radiosity::compute(&scene, &options, Some(saved), None, &Silent).unwrap();
            (solution, anew)
        };
        // The camera: step 4 alone.
        let (found, anew) = again("eye = [0.5, 0.5, 0.1]", "eye = [0.3, 0.6, 0.2]");
        assert_eq!(found.report().steps, StepsDone { model: false, form_factors: 0, solved: false });
        assert_eq!(found.irradiance, anew.irradiance);
        // Reflectance, and emission: step 3.
        for (from, to) in [("reflectance = 0.6", "reflectance = 0.3"), ("radiance = 1.0", "radiance = 2.5")] {
            let (found, anew) = again(from, to);
            assert_eq!(found.report().steps, StepsDone { model: false, form_factors: 0, solved: true });
            if method == Method::Matrix {
                assert_eq!(found.irradiance, anew.irradiance);
            }
            let absorbed = [&found, &anew].map(|solution| solution.report().balance.absorbed[0]);
            assert!((absorbed[0] / absorbed[1] - 1.0).abs() < 0.05, "{absorbed:?}");
        }
        // Geometry: step 1.
        let (found, anew) = again("[0.4, 0.98, 0.4]", "[0.35, 0.98, 0.4]");
        assert!(found.report().steps.model && found.report().steps.form_factors > 0);
        assert_eq!(found.irradiance, anew.irradiance);
    }
}

#[test]
fn damaged_files_are_refused() {
    let solution = solve(&lit_room(), &options(Method::Matrix, 30));
    let mut bytes = Vec::new();
    write_radiosity(&mut bytes, &solution).unwrap();
    assert!(file::parse(&bytes).is_ok());
    for end in 0..bytes.len() {
        assert!(file::parse(&bytes[..end]).is_err(), "{end}");
    }
    for at in 0..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[at] ^= 0x10;
        assert!(file::parse(&damaged).is_err(), "{at}");
    }
}

#[test]
fn scenes_that_are_not_for_radiosity_are_refused_in_words() {
    let fails = |text: &str, options: &RadiosityOptions, allowed: Option<u64>, parts: &[&str]| {
        let error = Radiosity::compute(&built(text).scene, options, None, allowed, &Silent).unwrap_err();
        let message = error.to_string();
        parts.iter().for_each(|part| assert!(message.contains(part), "no `{part}` in {message}"));
    };
    let plain = RadiosityOptions::default();
    let ball = "[materials.shiny]\ntype = \"mirror\"\n[[shapes]]\nname = \"globe\"\ntype = \"sphere\"\nradius = 0.2\nmaterial = \"shiny\"\n";
    fails(&(lit_room() + ball), &plain, None, &["globe", "cardioid render", "--specular absorb"]);
    fails(&room(0.5, |_| ""), &plain, None, &["nothing shines", "add a light source"]);
    let mirror = ball.to_owned() + "[[lights]]\ntype = \"point\"\nposition = [0, 5, 0]\nintensity = 1.0\n";
    fails(
        &mirror,
        &RadiosityOptions { specular: Specular::Absorb, ..plain },
        None,
        &["no surface", "diffuse"],
    );
    let csg = "[[shapes]]\nname = \"lump\"\ntype = \"csg\"\noperation = \"union\"\noperands = [{ type = \"sphere\", radius = 0.2 }, \
               { type = \"sphere\", radius = 0.2, center = [0.1, 0, 0] }]\nmaterial = \"grey\"\n";
    fails(&(lit_room() + csg), &plain, None, &["lump", "no coordinates", "mesh"]);
    fails(
        &lit_room(),
        &options(Method::Matrix, 1_000_000),
        Some(4_000_000_000),
        &["1000000 patches", "4.0 GB", "--patches"],
    );
    fails(&room(1.0, |_| GLOWS), &options(Method::Matrix, 24), None, &["does not settle", "below 1"]);
    let absorbing = RadiosityOptions { specular: Specular::Absorb, patches: 100, ..plain };
    assert!(Radiosity::compute(&built(&(lit_room() + ball)).scene, &absorbing, None, None, &Silent).is_ok());
}

#[test]
fn every_shape_has_patches() {
    let shape = |words: &str| format!("[[shapes]]\n{words}\nmaterial = \"grey\"\n");
    let text = room(0.5, |_| "")
        + &quad("[0.4, 0.98, 0.4]", "[0.2, 0, 0]", "[0, 0, 0.2]", GLOWS)
        + &shape("type = \"sphere\"\ncenter = [0.3, 0.2, 0.3]\nradius = 0.15")
        + &shape("type = \"cylinder\"\nbase = [0.7, 0.1, 0.3]\ntop = [0.7, 0.5, 0.3]\nradius = 0.1")
        + &shape("type = \"disc\"\ncenter = [0.3, 0.6, 0.7]\nnormal = [0, 1, 0.3]\nradius = 0.2")
        + &shape("type = \"box\"\nmin = [0.6, 0.1, 0.6]\nmax = [0.8, 0.4, 0.8]")
        + &shape(
            "type = \"mesh\"\nvertices = [[0.1, 0.7, 0.1], [0.3, 0.7, 0.1], [0.2, 0.8, 0.3], [0.1, 0.9, 0.3]]\nfaces = [[0, 1, 2], [0, 2, 3]]",
        );
    let solution = solve(&text, &options(Method::Hierarchy, 2500));
    let report = solution.report();
    let total: f64 = report.balance.emitted.iter().sum();
    let escaped: f64 = report.balance.escaped.iter().sum();
    assert!(escaped.abs() < 0.02 * total, "{report:?}");
    for surface in 0..12 {
        let mut patches = solution.model.elements.iter().enumerate().filter(|(_, e)| e.surface == surface);
        assert!(patches.any(|(i, _)| solution.irradiance[i].total().max_element() > 0.0), "{surface}");
    }
}

/// The floor of a room as a mesh: all of its area, no cracks where patches of different sizes meet, and the radiance of the solution.
#[test]
fn a_baked_model_has_no_cracks() {
    let built = built(&lit_room());
    let solution =
        Radiosity::compute(&built.scene, &options(Method::Hierarchy, 1500), None, None, &Silent).unwrap();
    let meshes = solution.baked(&built.scene);
    // Six walls, the lamp and the board; outsides are dark.
    assert_eq!(meshes.len(), 8);
    for (mesh, lit) in meshes.iter().zip([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.08, 0.6]) {
        let mut edges = std::collections::BTreeMap::new();
        let mut area = 0.0;
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|vertex| mesh.positions[vertex as usize]);
            let cross = (b - a).cross(c - a);
            area += 0.5 * f64::from(cross.length());
            assert!(
                cross.dot(mesh.normals[triangle[0] as usize]) > 0.0,
                "{}: a triangle faces away",
                mesh.name
            );
            for i in 0..3 {
                let ends =
                    [triangle[i], triangle[(i + 1) % 3]].map(|v| mesh.positions[v as usize].to_array());
                *edges.entry(ends.map(|p| p.map(f32::to_bits))).or_insert(0) += 1;
            }
        }
        assert!((area - lit).abs() < 1e-5, "{}: {area} for {lit}", mesh.name);
        // An edge that no other triangle has the other way around is a part of the border.
        for ([a, b], count) in &edges {
            assert_eq!(*count, 1, "{}", mesh.name);
            if !edges.contains_key(&[*b, *a]) {
                let [a, b] = [a, b].map(|p| glam::Vec3::from_array(p.map(f32::from_bits)));
                let on_border = |x: f32, y: f32| {
                    x == y && [0.0, 1.0, 0.4, 0.6, 0.5, 0.2, 0.8].iter().any(|e| (x - e).abs() < 1e-6)
                };
                let is_border = (0..3).any(|i| {
                    let is_flat = mesh.positions.iter().all(|p| p[i] == mesh.positions[0][i]);
                    !is_flat && on_border(a[i], b[i])
                });
                assert!(is_border, "{}: a crack from {a} to {b}", mesh.name);
            }
        }
    }
    let lamp = &meshes[6];
    assert!(lamp.radiance.iter().any(|radiance| (radiance.x - 1.0).abs() < 0.05), "{:?}", lamp.radiance);
    let mut bytes = Vec::new();
    write_glb(&mut bytes, &meshes, 1.0).unwrap();
    let read = gltf::Gltf::from_slice(&bytes).unwrap();
    assert_eq!(read.document.meshes().len(), 8);
    assert_eq!(read.blob.unwrap().len() % 4, 0);
}
