//! Tests of the Mitsuba importer.

use super::*;
use crate::lights::{EnvironmentLight, EnvironmentMap};
use crate::math::Rgb;
use crate::sampling::square_to_direction;
use crate::scene_file::description::{
    FilterDescription, FovAxis, GeometryDescription, LightDescription, MaterialDescription, MeshNormals,
    ProjectionDescription,
};
use crate::scene_file::photon_content_hash;
use glam::{DMat3, DVec3, Vec3};
use std::fs;

const PATH: &str = "a.xml";

pub(super) fn read(body: &str) -> Result<SceneDescription, String> {
    read_with(body, &[])
}

fn read_with(body: &str, parameters: &[(&str, &str)]) -> Result<SceneDescription, String> {
    let parameters: Vec<_> =
        parameters.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
    let text = format!("<scene version=\"3.0.0\">\n{body}\n</scene>");
    parse_mitsuba_bytes(text.as_bytes(), Path::new(PATH), &parameters).map_err(|error| error.to_string())
}

pub(super) fn scene(body: &str) -> SceneDescription {
    read(body).unwrap_or_else(|error| panic!("{error}"))
}

/// The material of a sphere with this BSDF.
pub(super) fn material(bsdf: &str) -> (MaterialDescription, SceneDescription) {
    let scene = scene(&format!("<shape type=\"sphere\">{bsdf}</shape>"));
    let number = scene.shapes[0].value.material;
    (scene.materials[number].value.clone(), scene)
}

pub(super) fn layered(bsdf: &str) -> crate::scene::LayeredMaterial {
    match material(bsdf).0 {
        MaterialDescription::Layered { material, .. } => (*material).clone(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_whole_scene_becomes_what_it_says() {
    let scene = read_with(
        "<default name=\"spp\" value=\"8\"/><default name=\"width\" value=\"200\"/>
        <integrator type=\"path\"><integer name=\"max_depth\" value=\"5\"/></integrator>
        <sensor type=\"perspective\">
          <float name=\"fov\" value=\"40\"/>
          <transform name=\"to_world\"><lookat origin=\"0, 1, 5\" target=\"0, 1, 0\" up=\"0, 1, 0\"/></transform>
          <sampler type=\"independent\"><integer name=\"sample_count\" value=\"$spp\"/></sampler>
          <film type=\"hdrfilm\"><integer name=\"width\" value=\"$width\"/><integer name=\"height\" value=\"100\"/>
            <rfilter type=\"box\"/></film>
        </sensor>
        <bsdf type=\"diffuse\" id=\"red\"><rgb name=\"reflectance\" value=\"0.8, 0.1, 0.2\"/></bsdf>
        <shape type=\"sphere\"><point name=\"center\" x=\"1\" y=\"2\" z=\"3\"/><float name=\"radius\" value=\"0.5\"/><ref id=\"red\"/></shape>
        <shape type=\"rectangle\"><emitter type=\"area\"><rgb name=\"radiance\" value=\"17, 12, 4\"/></emitter></shape>",
        &[("spp", "64")],
    )
    .unwrap();
    assert_eq!((scene.film.width, scene.film.height, scene.film.exposure), (200, 100, None));
    assert_eq!(scene.film.filter, FilterDescription::Box { radius: 0.5 });
    assert_eq!((scene.render.spp, scene.render.max_depth), (Some(64), Some(5)));
    let camera = scene.camera.unwrap();
    assert_eq!(
        (camera.eye, camera.perspective().unwrap()),
        (DVec3::new(0.0, 1.0, 5.0), (40.0, FovAxis::Horizontal))
    );
    assert!(((camera.at - camera.eye).normalize() - DVec3::NEG_Z).length() < 1e-12 && !camera.mirrored);
    let MaterialDescription::Lambert { reflectance, two_sided } =
        scene.materials[scene.shapes[0].value.material].value
    else {
        panic!()
    };
    assert!(reflectance == Rgb::new(0.8, 0.1, 0.2) && !two_sided);
    assert!(matches!(scene.shapes[0].value.geometry, GeometryDescription::Sphere { radius: 0.5, .. }));
    assert_eq!(scene.shapes[1].value.emission.unwrap().emitted.radiance(1.0), DVec3::new(17.0, 12.0, 4.0));
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    assert!(scene.notes.iter().all(|note| note.location.line > 0), "{:?}", scene.notes);
}

#[test]
fn what_is_wrong_is_told_with_its_line() {
    let sphere = |inside: &str| format!("<shape type=\"sphere\">{inside}</shape>");
    for (body, line, parts) in [
        ("<shape type=\"spere\"/>".to_owned(), 2, vec!["`spere`", "did you mean `sphere`?"]),
        ("\n<shap type=\"sphere\"/>".to_owned(), 3, vec!["<shap>", "`shape`"]),
        ("<shape/>".to_owned(), 2, vec!["needs the attribute `type`"]),
        (sphere("\n\n<float name=\"radios\" value=\"1\"/>"), 4, vec!["no parameter `radios`", "`radius`"]),
        (sphere("<float name=\"radius\" value=\"big\"/>"), 2, vec!["`big` is no number"]),
        (sphere("<float name=\"radius\" value=\"-1\"/>"), 2, vec!["radius of -1"]),
        (sphere("<float name=\"radius\" value=\"inf\"/>"), 2, vec!["no number"]),
        (sphere("<string name=\"radius\" value=\"1\"/>"), 2, vec!["a number is expected", "<float"]),
        (sphere("<ref id=\"gold\"/>"), 2, vec!["no object `gold`"]),
        (sphere("<bsdf type=\"measured\"/>"), 2, vec!["`measured` is not modelled", "principled"]),
        (sphere("<float name=\"radius\" value=\"$r\"/>"), 2, vec!["`$r` has no value", "-D r=VALUE"]),
        (sphere("text"), 2, vec!["text between elements", "<!--"]),
        (
            sphere("<bsdf type=\"roughconductor\"><string name=\"material\" value=\"Unobtainium\"/></bsdf>"),
            2,
            vec!["Unobtainium", "eta"],
        ),
        (
            sphere("<bsdf type=\"dielectric\"><string name=\"int_ior\" value=\"watr\"/></bsdf>"),
            2,
            vec!["`water`"],
        ),
        (sphere("<bsdf type=\"twosided\"/>"), 2, vec!["holds no material"]),
        (sphere("<transform name=\"to_world\"><scale value=\"0\"/></transform>"), 2, vec!["flattens"]),
        (
            sphere("<transform name=\"to_world\"><matrix value=\"1 2 3\"/></transform>"),
            2,
            vec!["matrix of 3 numbers"],
        ),
        (sphere("<transform name=\"to_world\"><turn angle=\"3\"/></transform>"), 2, vec!["<turn>"]),
        (sphere("<texture type=\"bitmap\" name=\"a\"/>"), 2, vec![]),
        (
            "<shape type=\"obj\"><string name=\"filename\" value=\"none.obj\"/></shape>".to_owned(),
            2,
            vec!["no file `none.obj`"],
        ),
        ("<shape type=\"obj\"/>".to_owned(), 2, vec!["names no file", "filename"]),
        ("<include filename=\"none.xml\"/>".to_owned(), 2, vec!["no file `none.xml`"]),
        ("<path value=\"nowhere\"/>".to_owned(), 2, vec!["no folder `nowhere`"]),
        ("<sensor type=\"batch\"/>".to_owned(), 2, vec!["`batch`", "orthographic"]),
        (
            "<sensor type=\"orthographic\"><transform name=\"to_world\"><scale x=\"2\"/></transform></sensor>".to_owned(),
            2,
            vec!["differently", "the same factor"],
        ),
        (
            "<sensor type=\"perspective\"><float name=\"fov\" value=\"200\"/></sensor>".to_owned(),
            2,
            vec!["200 degrees"],
        ),
        ("<emitter type=\"area\"/>".to_owned(), 2, vec!["without a shape"]),
        ("<shape type=\"instance\"/>".to_owned(), 2, vec!["one <shape"]),
        ("<float name=\"a\" value=\"1\"/>".to_owned(), 2, vec!["no parameter `a`"]),
        (
            "<bsdf type=\"diffuse\" id=\"a\"/><bsdf type=\"diffuse\" id=\"a\"/>".to_owned(),
            2,
            vec!["`a` is taken"],
        ),
        ("<shape type=\"sphere\" radius=\"2\"/>".to_owned(), 2, vec!["no attribute `radius`"]),
        ("<shape type=\"sphere\">".to_owned(), 3, vec!["not XML"]),
    ] {
        let error = match read(&body) {
            Err(error) => error,
            // Left out, with a message.
            Ok(scene) => {
                assert!(!scene.warnings.is_empty(), "{body}");
                continue;
            }
        };
        assert!(error.starts_with(&format!("{PATH}:{line}:")), "{body}: {error}");
        for part in parts {
            assert!(error.contains(part), "{body}: {error}");
        }
        assert!(error.contains("help: "), "{body}: {error}");
    }
}

#[test]
fn other_files_are_told_for_what_they_are() {
    for (text, part) in [
        ("<COLLADA/>", "begins with <COLLADA>"),
        ("", "not XML"),
        ("<!DOCTYPE a [<!ENTITY b \"c\">]><scene/>", "DOCTYPE"),
        ("<scene version=\"new\"/>", "no version"),
    ] {
        let error = parse_mitsuba_bytes(text.as_bytes(), Path::new(PATH), &[]).unwrap_err().to_string();
        assert!(error.contains(part), "{text}: {error}");
    }
    assert!(parse_mitsuba_bytes(b"<scene a=\"\xff\"/>", Path::new(PATH), &[]).is_err());
    assert!(parse_mitsuba_bytes(b"\x89PNG\r\n\x1a\n", Path::new(PATH), &[]).is_err());
}

#[test]
fn parameters_of_the_command_line_must_be_some_of_the_file() {
    let body = "<default name=\"radius\" value=\"1\"/><shape type=\"sphere\"><float name=\"radius\" value=\"$radius\"/></shape>";
    let radius = |scene: SceneDescription| match scene.shapes[0].value.geometry {
        GeometryDescription::Sphere { radius, .. } => radius,
        _ => panic!(),
    };
    assert_eq!(radius(scene(body)), 1.0);
    assert_eq!(radius(read_with(body, &[("radius", "3")]).unwrap()), 3.0);
    let error = read_with(body, &[("radios", "3")]).unwrap_err();
    assert!(error.contains("no parameter `radios`") && error.contains("did you mean `radius`?"), "{error}");
    // The longest name is taken, and substituted text is not scanned again.
    let text = "<default name=\"r\" value=\"$\"/><default name=\"rr\" value=\"4\"/><shape type=\"sphere\"><float name=\"radius\" value=\"$rr\"/></shape>";
    let error = read(text).unwrap_err();
    assert!(error.contains("has no value"), "{error}");
    assert_eq!(radius(scene(&text.replace("value=\"$\"", "value=\"5\""))), 4.0);
}

/// Values that double each other must not exhaust the memory.
#[test]
fn parameters_do_not_explode() {
    let mut body = "<default name=\"a0\" value=\"0123456789\"/>".to_owned();
    for i in 1..60 {
        body += &format!("<default name=\"a{i}\" value=\"$a{0}$a{0}\"/>", i - 1);
    }
    assert!(read(&body).unwrap_err().contains("too long"));
    let deep = format!("{}{}", "<shape type=\"merge\">".repeat(5000), "</shape>".repeat(5000));
    assert!(read(&deep).unwrap_err().contains("nested deeper"));
    let circle = "<bsdf type=\"twosided\" id=\"a\"><ref id=\"b\"/></bsdf><bsdf type=\"twosided\" id=\"b\"><ref id=\"a\"/></bsdf>
        <shape type=\"sphere\"><ref id=\"a\"/></shape>";
    assert!(read(circle).unwrap_err().contains("hold each other"));
}

#[test]
fn files_include_others_with_folders_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir_all(at("parts/meshes")).unwrap();
    fs::create_dir_all(at("common")).unwrap();
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    fs::write(at("parts/meshes/flat.obj"), format!("{triangle}f 1 2 3\n")).unwrap();
    fs::write(at("common/smooth.obj"), format!("{triangle}vn 0 0 1\nf 1//1 2//1 3//1\n")).unwrap();
    fs::write(
        at("parts/inner.xml"),
        "<scene version=\"0.6.0\"><shape type=\"obj\"><string name=\"filename\" value=\"meshes/flat.obj\"/>
        <boolean name=\"faceNormals\" value=\"true\"/><transform name=\"toWorld\"><translate x=\"2\"/></transform></shape></scene>",
    )
    .unwrap();
    fs::write(
        at("outer.xml"),
        "<scene version=\"3.0.0\"><path value=\"common\"/><include filename=\"parts/inner.xml\"/>
        <shape type=\"obj\"><string name=\"filename\" value=\"smooth.obj\"/></shape>
        <shape type=\"obj\"><string name=\"filename\" value=\"smooth.obj\"/><boolean name=\"face_normals\" value=\"true\"/></shape>
        </scene>",
    )
    .unwrap();
    let scene = mitsuba_scene(&at("outer.xml"), &[]).unwrap();
    let found: Vec<_> = scene
        .shapes
        .iter()
        .map(|shape| match &shape.value.geometry {
            GeometryDescription::MeshFile { path, normals, own_materials: false, .. } => {
                (path.clone(), *normals)
            }
            other => panic!("{other:?}"),
        })
        .collect();
    assert!(found[0].0.ends_with("parts/meshes/flat.obj") && found[0].1 == MeshNormals::Flat);
    assert!(found[1].0.ends_with("common/smooth.obj") && found[1].1 == MeshNormals::Leading);
    assert_eq!(found[2].1, MeshNormals::Flat);
    assert_eq!(scene.shapes[0].value.transform.translation, DVec3::new(2.0, 0.0, 0.0));
    for name in ["inner.xml", "flat.obj", "smooth.obj"] {
        assert!(scene.further_files.iter().any(|file| file.ends_with(name)), "{name}");
    }
    // An error in an included file is reported at its place there.
    fs::write(at("parts/inner.xml"), "<scene version=\"3.0.0\">\n<shape type=\"ball\"/></scene>").unwrap();
    let error = mitsuba_scene(&at("outer.xml"), &[]).unwrap_err().to_string();
    assert!(error.contains("inner.xml:2:1"), "{error}");
    fs::write(at("parts/inner.xml"), "<scene><include filename=\"inner.xml\"/></scene>").unwrap();
    let error = mitsuba_scene(&at("outer.xml"), &[]).unwrap_err().to_string();
    assert!(error.contains("include each other"), "{error}");
}

#[test]
fn steps_of_a_transform_follow_each_other() {
    let scene = scene(
        "<shape type=\"sphere\"><transform name=\"to_world\"><scale value=\"2\"/><rotate z=\"1\" angle=\"90\"/>
        <translate x=\"1\" y=\"2\" z=\"3\"/><matrix value=\"1 0 0 0  0 1 0 0  0 0 1 10  0 0 0 1\"/></transform></shape>",
    );
    let at = scene.shapes[0].value.transform.transform_point3(DVec3::X);
    assert!((at - DVec3::new(1.0, 4.0, 13.0)).length() < 1e-12, "{at}");
}

/// x of an orthographic sensor goes from -1 to 1 across the picture, in its own space.
#[test]
fn orthographic_sensors() {
    let scene = |kind: &str| {
        scene(&format!(
            "<sensor type=\"{kind}\"><float name=\"aperture_radius\" value=\"0.1\"/><float name=\"focus_distance\" value=\"4\"/>
            <transform name=\"to_world\"><scale x=\"3\" y=\"3\"/><lookat origin=\"1, 2, 3\" target=\"4, 2, 3\" up=\"0, 0, 1\"/>
            </transform></sensor>"
        ))
        .camera
        .unwrap()
    };
    let (plain, lens) = (scene("orthographic"), scene("telecentric"));
    let wanted = ProjectionDescription::Orthographic { extent: 6.0, axis: FovAxis::Horizontal };
    assert_eq!((plain.projection, plain.lens, plain.mirrored), (wanted, None, false));
    let lens = lens.lens.unwrap();
    assert!((lens.radius - 0.3).abs() < 1e-9 && (lens.focus - 4.0).abs() < 1e-9, "{lens:?}");
}

/// A point on the left of the camera's axes (x of a sensor points left) is on the left of the picture. Where the transform
/// mirrors, it is on the right.
#[test]
fn sensors_keep_left_and_right() {
    for (mirror, is_left) in [("", true), ("<scale x=\"-1\"/>", false)] {
        let scene = scene(&format!(
            "<sensor type=\"perspective\"><float name=\"fov\" value=\"60\"/><transform name=\"to_world\">{mirror}<lookat origin=\"1, 2, 3\"
            target=\"4, 2, 3\" up=\"0, 0, 1\"/></transform></sensor>"
        ));
        let view = scene.camera.unwrap();
        let camera = crate::camera::Camera::look_at(view.eye, view.at, view.up, 40.0, 1.5).unwrap();
        let camera = if view.mirrored { camera.mirrored() } else { camera };
        // Looking along x with z up, left is y.
        let at = camera.position_of(Vec3::new(1.0, 0.2, 0.1).normalize()).unwrap();
        assert_eq!(at.x < 0.5, is_left, "{at}");
        assert!(at.y < 0.5, "{at}");
    }
}

#[test]
fn fields_of_view_span_what_they_say() {
    let fov = |text: &str| {
        let film = "<film type=\"hdrfilm\"><integer name=\"width\" value=\"200\"/><integer name=\"height\" value=\"100\"/></film>";
        let camera = scene(&format!("<sensor type=\"perspective\">{film}{text}</sensor>")).camera.unwrap();
        camera.perspective().unwrap()
    };
    let axis = |name: &str| {
        fov(&format!("<float name=\"fov\" value=\"50\"/><string name=\"fov_axis\" value=\"{name}\"/>"))
    };
    assert_eq!(axis("x"), (50.0, FovAxis::Horizontal));
    assert_eq!(axis("y"), (50.0, FovAxis::Vertical));
    assert_eq!(axis("smaller"), (50.0, FovAxis::Vertical));
    assert_eq!(axis("larger"), (50.0, FovAxis::Horizontal));
    let (diagonal, _) = axis("diagonal");
    let expected = 2.0 * (25f64.to_radians().tan() * 2.0 / 5f64.sqrt()).atan().to_degrees();
    assert!((diagonal - expected).abs() < 1e-9, "{diagonal} {expected}");
    // 50 mm on 36 x 24 mm.
    let (usual, _) = fov("");
    let expected = 2.0 * (43.266_615_305_567_87 / 100.0 * 2.0 / 5f64.sqrt()).atan().to_degrees();
    assert!((usual - expected).abs() < 1e-9, "{usual} {expected}");
}

#[test]
fn crop_windows_are_parts_of_the_film() {
    let film = |numbers: &str| {
        read(&format!(
            "<sensor type=\"perspective\"><film type=\"hdrfilm\"><integer name=\"width\" value=\"40\"/><integer name=\"height\" value=\"30\"/>
            {numbers}</film></sensor>"
        ))
    };
    let crop = "<integer name=\"crop_offset_x\" value=\"5\"/><integer name=\"crop_offset_y\" value=\"6\"/><integer name=\"crop_width\" value=\"7\"/>
        <integer name=\"crop_height\" value=\"8\"/>";
    let rect = film(crop).unwrap().film.crop.unwrap();
    assert_eq!((rect.x0, rect.y0, rect.x1, rect.y1), (5, 6, 12, 14));
    assert!(film("").unwrap().film.crop.is_none());
    assert!(film(&crop.replace("\"7\"", "\"70\"")).unwrap_err().contains("crop window ends at 75"));
}

#[test]
fn groups_are_in_the_picture_where_instances_place_them() {
    let scene = scene(
        "<shape type=\"shapegroup\" id=\"g\"><shape type=\"sphere\"/><shape type=\"rectangle\"><boolean name=\"flip_normals\" value=\"true\"/></shape></shape>
        <shape type=\"shapegroup\" id=\"unused\"><shape type=\"sphere\"/></shape>
        <shape type=\"instance\"><ref id=\"g\"/></shape><shape type=\"instance\"><ref id=\"g\"/><transform name=\"to_world\"><translate y=\"3\"/></transform></shape>",
    );
    assert_eq!((scene.groups.len(), scene.shapes.len(), scene.instances.len()), (1, 2, 2));
    assert!(scene.shapes.iter().all(|shape| shape.value.group == Some(0)));
    assert!(scene.shapes[1].value.flip_normal && !scene.shapes[0].value.flip_normal);
    assert_eq!(scene.instances[1].value.transform.translation, DVec3::new(0.0, 3.0, 0.0));
}

#[test]
fn lights_shine_along_their_axes() {
    let scene = scene(
        "<emitter type=\"point\"><point name=\"position\" x=\"1\" y=\"2\" z=\"3\"/><rgb name=\"intensity\" value=\"4\"/></emitter>
        <emitter type=\"spot\"><transform name=\"to_world\"><lookat origin=\"0, 3, 0\" target=\"0, 0, 0\" up=\"0, 0, 1\"/></transform>
          <float name=\"cutoff_angle\" value=\"30\"/><float name=\"beam_width\" value=\"30\"/></emitter>
        <emitter type=\"directional\"><vector name=\"direction\" x=\"1\" y=\"-2\" z=\"0\"/></emitter>
        <emitter type=\"constant\"/>
        <emitter type=\"sunsky\"><vector name=\"sun_direction\" x=\"0\" y=\"1\" z=\"1\"/></emitter>",
    );
    assert_eq!(scene.lights.len(), 5);
    let LightDescription::Spot { position, direction, inner, outer, .. } = scene.lights[1].value else {
        panic!()
    };
    assert!(position == DVec3::new(0.0, 3.0, 0.0) && (direction - DVec3::NEG_Y).length() < 1e-12);
    assert!((inner - outer).abs() < 1e-6 && (outer - 30f64.to_radians()).abs() < 1e-12);
    let LightDescription::Sky { elevation, azimuth, axes: Some(axes), .. } = scene.lights[4].value else {
        panic!()
    };
    // z is up: the sun is half way between z and y.
    assert!((elevation - 45f64.to_radians()).abs() < 1e-9);
    let local =
        DVec3::new(elevation.cos() * azimuth.sin(), elevation.sin(), -elevation.cos() * azimuth.cos());
    assert!((axes * local - DVec3::new(0.0, 1.0, 1.0).normalize()).length() < 1e-9);
}

/// A spot in an environment map is seen where Mitsuba sees it: the picture begins at -z, continues over x, and is rotated by the
/// transform.
#[test]
fn surroundings_stand_as_in_mitsuba() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.hdr"), b"").unwrap();
    let (width, height) = (256usize, 128usize);
    for (u, v) in [(0.1, 0.4), (0.6, 0.7), (0.85, 0.3)] {
        // The direction of this place of the picture before the transform.
        let (phi, theta) = (std::f64::consts::TAU * u, std::f64::consts::PI * v);
        let local = DVec3::new(phi.sin() * theta.sin(), theta.cos(), -phi.cos() * theta.sin());
        let texel = |index: usize| {
            let x = (index % width) as f64 / width as f64 - u;
            let y = (index / width) as f64 / height as f64 - v;
            Rgb::splat((-(x * x * 4.0 + y * y) / 0.002).exp() as f32)
        };
        let map = EnvironmentMap::new(width, (0..width * height).map(texel).collect()).0.unwrap();
        let map = std::sync::Arc::new(map);
        for (text, matrix) in [
            ("", DMat3::IDENTITY),
            ("<rotate y=\"1\" angle=\"50\"/>", DMat3::from_rotation_y(50f64.to_radians())),
            ("<rotate x=\"1\" angle=\"90\"/>", DMat3::from_rotation_x(90f64.to_radians())),
            (
                "<scale x=\"-1\"/><rotate x=\"1\" angle=\"90\"/>",
                DMat3::from_rotation_x(90f64.to_radians()) * DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)),
            ),
        ] {
            let text = format!(
                "<scene><emitter type=\"envmap\"><string name=\"filename\" value=\"a.hdr\"/><transform name=\"to_world\">{text}</transform></emitter></scene>"
            );
            let scene = parse_mitsuba_bytes(text.as_bytes(), &folder.path().join(PATH), &[]).unwrap();
            let LightDescription::EnvironmentMap { turn, axes, .. } = scene.lights[0].value else { panic!() };
            let light = EnvironmentLight::of_map(std::sync::Arc::clone(&map), turn, Rgb::ONE);
            let light = light.with_axes(axes.map(|axes| axes.as_mat3()));
            let seen = light.radiance_from((matrix * local).as_vec3()).x;
            assert!(seen > 0.9, "{text} {u} {v}: {seen}");
        }
    }
    assert!(square_to_direction(0.5, 0.5).0.z < -0.99);
}

#[test]
fn photons_depend_on_parameters() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(PATH);
    fs::write(&path, "<scene><default name=\"r\" value=\"1\"/><shape type=\"sphere\"><float name=\"radius\" value=\"$r\"/></shape></scene>").unwrap();
    let hash = |value: Option<&str>| {
        let parameters: Vec<_> = value.map(|value| ("r".to_owned(), value.to_owned())).into_iter().collect();
        photon_content_hash(&mitsuba_scene(&path, &parameters).unwrap()).unwrap()
    };
    assert_eq!(hash(None), hash(None));
    assert_ne!(hash(None), hash(Some("2")));
}

#[test]
fn what_is_not_modelled_is_told_once() {
    let scene = scene(
        "<emitter type=\"projector\"/><shape type=\"sphere\"><bsdf type=\"roughplastic\"/></shape><shape type=\"sphere\"><bsdf type=\"roughplastic\"/></shape>
        <shape type=\"sphere\"><integer name=\"zzz\" value=\"3\"/></shape>",
    );
    let beckmann: Vec<_> = scene.notes.iter().filter(|note| note.message.contains("Beckmann")).collect();
    assert_eq!(beckmann.len(), 1);
    assert!(beckmann[0].message.contains("one more object") && beckmann[0].location.line == 2);
    for part in ["projector", "`zzz` is not known"] {
        assert!(scene.warnings.iter().any(|warning| warning.message.contains(part)), "{part}");
    }
}
