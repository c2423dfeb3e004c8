//! Illumination maps against photon maps and closed forms, side by side in one scene.

use super::support::{Shot, Stage, assert_close, device, photon_map, show};
use cardioid::measure::caustics::{Cell, MirrorSquare, caustic_figure};
use cardioid::render::{MapKind, Overrides, ProbeEstimator, ProbePoint, ProbeRequest, Silent, probe};
use cardioid::scene_file::{build_scene, load_scene, parse_scene};
use glam::DVec3;
use std::path::Path;

/// A room with a floor, a block, a ball and a column, of which those with `map` have illumination maps, a ball of glass over the
/// floor, and a wall that keeps its photons.
fn room(map: &str) -> Stage {
    let text = format!(
        "
        [camera]
        eye = [0, 1.6, 3.4]
        at = [0, 0.6, 0]
        fov = 45
        [materials.white]
        type = \"lambert\"
        reflectance = [0.7, 0.6, 0.5]
        [materials.glass]
        type = \"dielectric\"
        ior = 1.5
        [[shapes]]
        name = \"floor\"
        type = \"quad\"
        corner = [-1.5, 0, 1.5]
        edge-u = [3, 0, 0]
        edge-v = [0, 0, -3]
        material = \"white\"
        {map}
        [[shapes]]
        name = \"wall\"
        type = \"quad\"
        corner = [-1.5, 0, -1.5]
        edge-u = [3, 0, 0]
        edge-v = [0, 2, 0]
        material = \"white\"
        [[shapes]]
        name = \"block\"
        type = \"box\"
        min = [-0.3, 0, -0.3]
        max = [0.3, 0.8, 0.3]
        material = \"white\"
        transform = [{{ rotate = 25, axis = \"y\" }}, {{ translate = [-0.8, 0, -0.6] }}]
        {map}
        [[shapes]]
        name = \"ball\"
        type = \"sphere\"
        center = [0.9, 0.4, -0.7]
        radius = 0.4
        material = \"white\"
        {map}
        [[shapes]]
        name = \"column\"
        type = \"cylinder\"
        base = [0.1, 0, -1.0]
        top = [0.1, 1.2, -1.0]
        radius = 0.15
        material = \"white\"
        {map}
        [[shapes]]
        name = \"glass\"
        type = \"sphere\"
        center = [0.2, 0.5, 0.4]
        radius = 0.3
        material = \"glass\"
        [[shapes]]
        name = \"lamp\"
        type = \"quad\"
        corner = [-0.2, 2.5, -0.2]
        edge-u = [0.4, 0, 0]
        edge-v = [0, 0, 0.4]
        emission = {{ radiance = 30.0 }}
        "
    );
    Stage::new(&text, (48, 40))
}

fn quick() -> Overrides {
    Overrides {
        spp: Some(4),
        global_photons: Some(100_000),
        caustic_photons: Some(200_000),
        gather_samples: Some(4),
        ..photon_map()
    }
}

/// Means of caustics and indirect light with maps of either kind, from as many photons as either needs: with few, estimates
/// lose light where a bright caustic is blurred (4 % with 200 000), and elements where things stand on them, as an element
/// that is covered in part has the mean of light and dark. That takes 2.2 % of the indirect light of path tracing with 100 000
/// photons and 0.7 % with a million; with the things raised from the floor, half as much.
#[test]
fn both_kinds_of_maps_show_the_same_light() {
    let quick = || Overrides { spp: Some(16), ..quick() };
    let photons = room("").shoot(&quick());
    let fine = Overrides {
        global_photons: Some(1_000_000),
        caustic_photons: Some(1_000_000),
        gather_samples: Some(16),
        ..quick()
    };
    let many = room("").shoot(&fine);
    assert!(photons.statistics.illumination.is_none());
    for map in ["illumination-map = true", "illumination-map = \"box\""] {
        let stage = room(map);
        let summed = stage.shoot(&quick());
        let summed_many = stage.shoot(&fine);
        for layer in ["caustics", "indirect"] {
            assert_close(&format!("{map}, {layer}"), summed_many.mean(layer), many.mean(layer), 0.015);
        }
        assert_eq!(summed.layer("direct"), photons.layer("direct"));
        let sizes = summed.statistics.illumination.unwrap().sizes;
        println!("{sizes:?}");
        assert_eq!(sizes.surfaces, 4);
        // What faces away from the glass gets no caustic.
        assert!(sizes.caustic_elements > 0 && sizes.caustic_elements < sizes.caustic_elements_everywhere);
        assert!(summed.statistics.counters.illumination_lookups > 0);
        // Switched off, the same scene has photon maps to the bit.
        let off = stage.shoot(&Overrides { illumination_maps: Some(false), ..quick() });
        assert_eq!(off.developed, photons.developed);
        for (kind, layer) in [(MapKind::Global, "indirect"), (MapKind::Caustic, "caustics")] {
            let shown = Overrides { caustic_photons: Some(1_000_000), ..show(kind) };
            // The elements are finer than pixels, and their noise is white: few samples of a pixel would say little.
            let mean = |stage: &Stage| stage.shoot(&Overrides { spp: Some(64), ..shown.clone() }).mean(layer);
            assert_close(&format!("{map}, {layer} shown"), mean(&stage), mean(&room("")), 0.03);
        }
    }
}

#[test]
fn threads_change_no_bit() {
    let stage = room("illumination-map = true");
    let shoot = |threads: usize| -> Shot {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| stage.shoot(&quick()))
    };
    let one = shoot(1);
    for threads in [2, 5] {
        let other = shoot(threads);
        assert_eq!(one.developed, other.developed, "{threads} threads");
        assert_eq!(one.statistics.counters, other.statistics.counters);
    }
}

/// The caustic of the mirror square from illumination maps: mean over a cell within 1 %; and the figure as a whole.
#[test]
fn the_mirror_square() {
    let path = super::support::scene_path("mirror-square");
    let mut description = load_scene(&path, &[]).unwrap();
    let figure = caustic_figure(&description, device(), 50_000, &Silent).unwrap();
    println!("{}", figure.to_markdown());
    assert!(
        figure.to_svg().ends_with("</svg>\n")
            && figure.to_markdown().lines().count() == figure.rows.len() + 2
    );
    for row in &figure.rows {
        // Photons are stratified, and the distance to the k-th of them says a little less than it does of independent ones.
        let bound = if row.name.contains("N = 50") { 0.02 } else { 0.01 };
        assert!((row.mean - 1.0).abs() < bound, "{}: {}", row.name, row.mean);
        assert_eq!(row.line.len(), figure.places.len());
    }
    let rms = |name: &str| figure.rows.iter().find(|row| row.name == name).unwrap().rms;
    assert!(rms("illumination map, tent") < 0.75 * rms("illumination map, box"));
    assert!(rms("photon map, N = 200") < rms("illumination map, box"));
    let exact = MirrorSquare { intensity: 1.0, reflectance: 0.9 };
    description.shapes[0].value.illumination = Some(cardioid::scene_file::IlluminationDescription {
        kernel: cardioid::scene::IlluminationKernel::Tent,
        elements: None,
        refinement: None,
    });
    let stage =
        Stage { built: build_scene(&description, device(), (4, 4)).unwrap(), description, size: (4, 4) };
    let cell = Cell::around(1.0, 0.0, 0.6);
    let across = |range: [f64; 2], i: u32| range[0] + (range[1] - range[0]) * (f64::from(i) + 0.5) / 30.0;
    let places: Vec<DVec3> =
        (0..900).map(|i| DVec3::new(across(cell.x, i % 30), 0.0, across(cell.z, i / 30))).collect();
    let request = ProbeRequest {
        points: places.iter().map(|&position| ProbePoint { position, normal: DVec3::Y }).collect(),
        estimators: vec![ProbeEstimator::IlluminationMap],
        samples: 1,
        batches: 1,
        lift: 1e-3,
        settings: stage.settings(&quick()),
    };
    let probed = probe(stage.scene(), &request, &Silent).unwrap().unwrap();
    let mean = |of: &dyn Fn(usize) -> f64| (0..places.len()).map(of).sum::<f64>() / places.len() as f64;
    let found = mean(&|i| probed.points[i].as_ref().unwrap().readings[0].irradiance[1].x);
    let direct = mean(&|i| probed.points[i].as_ref().unwrap().readings[0].irradiance[2].x);
    let want = mean(&|i| exact.caustic(places[i].x, places[i].z));
    let want_direct = mean(&|i| exact.direct(places[i].x, places[i].z));
    println!("caustic {found}, want {want}; direct {direct}, want {want_direct}");
    assert!((found / want - 1.0).abs() < 0.01, "{found}, not {want}");
    assert!((direct / want_direct - 1.0).abs() < 0.02, "{direct}, not {want_direct}");
}

#[test]
fn what_has_no_coordinates_is_refused() {
    let base = "[camera]\neye = [0, 1, 3]\nat = [0, 0, 0]\n[materials.m]\ntype = \"lambert\"\nreflectance = 0.5\n\
                [materials.s]\ntype = \"mirror\"\nreflectance = 0.9\n";
    let text = |shape: &str, more: &str| {
        format!("{base}[[shapes]]\nname = \"thing\"\n{shape}\nillumination-map = true\n{more}")
    };
    let parsed = |text: &str| parse_scene(text, Path::new("s.toml"), &[]);
    let cone = "type = \"cone\"\nbase = [0, 0, 0]\ntop = [0, 1, 0]\nradius = 1\nmaterial = \"m\"";
    let message = parsed(&text(cone, "")).unwrap_err().to_string();
    assert!(message.contains("no coordinates") && message.contains("s.toml:"), "{message}");
    for (shape, more, why) in [
        ("type = \"sphere\"\nradius = 1\nmaterial = \"s\"", "", "`lambert`"),
        (
            "type = \"sphere\"\nradius = 1\nmaterial = \"m\"\ntransform = [{ scale = [1, 2, 1] }]",
            "",
            "scaled",
        ),
        (
            "type = \"sphere\"\nradius = 1\nmaterial = \"m\"\ngroup = \"g\"",
            "[[instances]]\ngroup = \"g\"\n",
            "group",
        ),
    ] {
        let description = parsed(&text(shape, more)).unwrap_or_else(|e| panic!("{e}"));
        let error = build_scene(&description, device(), (4, 4)).unwrap_err().to_string();
        assert!(error.contains(why) && error.contains("thing"), "{error}");
    }
    let bad = text("type = \"sphere\"\nradius = 1\nmaterial = \"m\"", "")
        .replace("map = true", "map = { elements = 0 }");
    assert!(parsed(&bad).is_err());
}
