//! Tests of the pbrt importer: directives, view, shapes and lights.

use super::*;
use crate::scene_file::description::{
    EnvironmentLayout, FilterDescription, FovAxis, GeometryDescription, LightDescription,
    MaterialDescription, MeshNormals, ProjectionDescription,
};
use crate::scene_file::photon_content_hash;
use flate2::Compression;
use flate2::write::GzEncoder;
use glam::DVec3;
use std::f64::consts::PI;
use std::fs;
use std::io::Write;

const PATH: &str = "a.pbrt";

pub(super) fn whole(text: &str) -> Result<SceneDescription, String> {
    parse_pbrt_bytes(text.as_bytes(), Path::new(PATH)).map_err(|error| error.to_string())
}

/// A scene of these directives behind WorldBegin.
pub(super) fn read(body: &str) -> Result<SceneDescription, String> {
    whole(&format!("WorldBegin\n{body}\n"))
}

pub(super) fn scene(body: &str) -> SceneDescription {
    read(body).unwrap_or_else(|error| panic!("{error}"))
}

const TRIANGLE: &str = "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 2]";

#[test]
fn a_whole_scene_becomes_what_it_says() {
    let scene = whole(
        "LookAt 0 1 5  0 1 0  0 1 0  # the camera
        Camera \"perspective\" \"float fov\" 40 \"float lensradius\" 0.1 \"float focaldistance\" [5]
        Film \"rgb\" \"integer xresolution\" 200 \"integer yresolution\" [100] \"string filename\" \"a.exr\"
        PixelFilter \"box\" \"float xradius\" 0.5
        Sampler \"zsobol\" \"integer pixelsamples\" 64
        Integrator \"volpath\" \"integer maxdepth\" 7
        WorldBegin
        MakeNamedMaterial \"red\" \"string type\" \"diffuse\" \"rgb reflectance\" [0.8 0.1 0.2]
        AttributeBegin
          NamedMaterial \"red\"
          Translate 1 2 3
          Shape \"sphere\" \"float radius\" 0.5
        AttributeEnd
        AttributeBegin
          AreaLightSource \"diffuse\" \"rgb L\" [17 12 4] \"float scale\" 2
          Shape \"disk\"
        AttributeEnd
        LightSource \"infinite\" \"rgb L\" [0.1 0.2 0.3]",
    )
    .unwrap();
    assert_eq!((scene.film.width, scene.film.height, scene.film.exposure), (200, 100, None));
    assert_eq!(scene.film.filter, FilterDescription::Box { radius: 0.5 });
    assert_eq!((scene.render.spp, scene.render.max_depth), (Some(64), Some(7)));
    let camera = scene.camera.unwrap();
    assert_eq!(camera.perspective().unwrap(), (40.0, FovAxis::Vertical));
    assert!((camera.eye - DVec3::new(0.0, 1.0, 5.0)).length() < 1e-12);
    assert!(((camera.at - camera.eye).normalize() - DVec3::NEG_Z).length() < 1e-12);
    let lens = camera.lens.unwrap();
    assert!((lens.radius - 0.1).abs() < 1e-12 && (lens.focus - 5.0).abs() < 1e-12);
    let [ball, lamp] = &scene.shapes[..] else { panic!("{}", scene.shapes.len()) };
    let MaterialDescription::Lambert { reflectance, two_sided } = scene.materials[ball.value.material].value
    else {
        panic!()
    };
    assert!((reflectance - glam::Vec3::new(0.8, 0.1, 0.2)).length() < 1e-6 && two_sided);
    assert!(matches!(ball.value.geometry, GeometryDescription::Sphere { radius: 0.5, .. }));
    assert_eq!(ball.value.transform.translation, DVec3::new(1.0, 2.0, 3.0));
    assert_eq!(lamp.value.emission.unwrap().emitted.radiance(1.0), DVec3::new(34.0, 24.0, 8.0));
    assert!(!lamp.value.emission.unwrap().two_sided && lamp.value.transform == DAffine3::IDENTITY);
    assert!(matches!(scene.lights[0].value, LightDescription::Environment { .. }));
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    assert!(scene.notes.iter().any(|note| note.message.contains("7 reflections") && note.location.line == 6));
}

/// A camera without a mirror in its transform shows x on the left where it looks along z, and the usual mirror turns that.
#[test]
fn the_camera_is_left_handed() {
    let camera = |text: &str| {
        let text = format!("{text} LookAt 0 0 -5  0 0 0  0 1 0 Camera \"perspective\" WorldBegin");
        whole(&text).unwrap().camera.unwrap()
    };
    // x of pbrt's camera, to the right, is +x here; that of a camera that is not mirrored is forward x up, -x.
    assert!(camera("").mirrored);
    let turned = camera("Scale -1 1 1");
    assert!(!turned.mirrored && (turned.eye - DVec3::new(0.0, 0.0, -5.0)).length() < 1e-12);
    assert!(turned.up.y > 0.0);
}

/// Parallel rays show what the window and the scale of the camera say; a panorama begins at x of the camera, goes on over z, and has -x
/// in its middle.
#[test]
fn parallel_rays_and_panoramas() {
    use crate::scene::RenderSpace;
    let view = |camera: &str| {
        let text = format!(
            "Film \"rgb\" \"integer xresolution\" 200 \"integer yresolution\" 100
            Scale -1 1 1 Scale 0.5 0.5 0.5 LookAt 1 2 6  1 2 0  0 1 0 {camera} WorldBegin"
        );
        let scene = whole(&text).unwrap();
        let view = scene.camera.unwrap();
        let camera = view
            .build(&RenderSpace::fitting(DVec3::ZERO, 1.0), (scene.film.width, scene.film.height))
            .unwrap();
        (view, camera)
    };
    // The camera's units are twice those of the world.
    let (parallel, camera) = view("Camera \"orthographic\" \"float screenwindow\" [-3 3 -1.5 1.5]");
    let extent = ProjectionDescription::Orthographic { extent: 12.0, axis: FovAxis::Horizontal };
    assert_eq!(parallel.projection, extent);
    let corner = camera.ray(glam::Vec2::ZERO);
    let middle = camera.ray(glam::Vec2::splat(0.5));
    assert!((middle.direction - glam::Vec3::NEG_Z).length() < 1e-6);
    // The left of a picture that looks along -z is -x.
    let across = (corner.origin - middle.origin) / (corner.origin - middle.origin).length();
    assert!((across - glam::Vec3::new(-6.0, 3.0, 0.0).normalize()).length() < 1e-5, "{across}");
    for kind in ["\"spherical\" \"string mapping\" \"equirectangular\"", "\"environment\""] {
        let (_, camera) = view(&format!("Camera {kind}"));
        for (x, want) in [(0.0, glam::Vec3::X), (0.25, glam::Vec3::NEG_Z), (0.5, glam::Vec3::NEG_X)] {
            let found = camera.ray(glam::Vec2::new(x, 0.5)).direction;
            assert!((found - want).length() < 1e-5, "{x}: {found}");
        }
    }
}

#[test]
fn windows_and_crops() {
    let view = |camera: &str, film: &str| {
        whole(&format!(
            "Film \"rgb\" \"integer xresolution\" 200 \"integer yresolution\" 100 {film}
            Camera \"perspective\" \"float fov\" 90 {camera} WorldBegin"
        ))
        .unwrap()
    };
    let half = view("\"float screenwindow\" [-1 1 -0.5 0.5]", "");
    let camera = half.camera.unwrap();
    assert_eq!(
        (half.film.width, half.film.crop, camera.perspective().unwrap().1),
        (200, None, FovAxis::Horizontal)
    );
    assert!((camera.perspective().unwrap().0 - 90.0).abs() < 1e-9);
    // The right half of the window of 2 x 1: a crop of a picture of the whole.
    let right = view("\"float screenwindow\" [0 1 -0.25 0.25]", "");
    assert_eq!((right.film.width, right.film.height), (400, 100));
    let crop = right.film.crop.unwrap();
    assert_eq!((crop.x0, crop.x1, crop.y0, crop.y1), (200, 400, 0, 100));
    assert!((right.camera.unwrap().perspective().unwrap().0 - 90.0).abs() < 1e-9);
    // Above the middle is the upper part.
    let above = view("\"float screenwindow\" [-1 1 0 1]", "").film;
    assert_eq!((above.height, above.crop.unwrap().y0, above.crop.unwrap().y1), (200, 0, 100));
    let cropped = view("", "\"float cropwindow\" [0.25 0.5 0 1]").film.crop.unwrap();
    assert_eq!((cropped.x0, cropped.x1, cropped.y0, cropped.y1), (50, 100, 0, 100));
    let stretched = view("\"float screenwindow\" [-1 1 -1 1]", "");
    assert!(stretched.warnings.iter().any(|warning| warning.message.contains("square")));
    let tall = whole(
        "Film \"rgb\" \"integer xresolution\" 100 \"integer yresolution\" 200 Camera \"perspective\" WorldBegin",
    );
    assert_eq!(tall.unwrap().camera.unwrap().perspective().unwrap().1, FovAxis::Horizontal);
}

/// What the film multiplies light by is applied to all light.
#[test]
fn sensitivity_and_exposure_scale_light() {
    let text = |film: &str, camera: &str| {
        format!(
            "Film \"rgb\" {film} Camera \"perspective\" {camera} WorldBegin LightSource \"point\" \"rgb I\" [1 2 3]
            AreaLightSource \"diffuse\" \"rgb L\" [4 4 4] {TRIANGLE}"
        )
    };
    let scene =
        whole(&text("\"float iso\" 200", "\"float shutteropen\" 0 \"float shutterclose\" 0.25")).unwrap();
    let LightDescription::Point { intensity, .. } = scene.lights[0].value else { panic!() };
    assert_eq!(intensity, DVec3::new(0.5, 1.0, 1.5));
    assert_eq!(scene.shapes[0].value.emission.unwrap().emitted.radiance(1.0), DVec3::splat(2.0));
    assert!(scene.notes.iter().any(|note| note.message.contains("multiplied by 0.5")));
    assert!(!whole(&text("", "")).unwrap().notes.iter().any(|note| note.message.contains("multiplied")));
}

#[test]
fn transforms_are_multiplied_from_the_right() {
    let transform = |text: &str| scene(&format!("{text} Shape \"sphere\"")).shapes[0].value.transform;
    let moved = transform("Translate 1 0 0 Scale 2 2 2");
    assert_eq!(moved.transform_point3(DVec3::X), DVec3::new(3.0, 0.0, 0.0));
    let turned = transform("Rotate 90 0 0 1");
    assert!((turned.transform_point3(DVec3::X) - DVec3::Y).length() < 1e-12);
    let given = transform("Transform [1 0 0 0  0 1 0 0  0 0 -1 0  5 6 7 1]");
    assert_eq!(given.transform_point3(DVec3::Z), DVec3::new(5.0, 6.0, 6.0));
    let named = transform("Translate 1 2 3 CoordinateSystem \"here\" Identity CoordSysTransform \"here\"");
    assert_eq!(named.translation, DVec3::new(1.0, 2.0, 3.0));
    let concatenated = transform("Translate 1 0 0 ConcatTransform [1 0 0 0 0 1 0 0 0 0 1 0 0 2 0 1]");
    assert_eq!(concatenated.translation, DVec3::new(1.0, 2.0, 0.0));
    assert!(read("Scale 0 1 1 Shape \"sphere\"").unwrap_err().contains("flattens"));
    assert!(read("CoordSysTransform \"there\"").unwrap_err().contains("known: `world`"));
}

#[test]
fn blocks_keep_what_is_set_in_them() {
    let scene = scene(
        "Material \"diffuse\" \"rgb reflectance\" [1 0 0]
        AttributeBegin Material \"diffuse\" \"rgb reflectance\" [0 1 0] ReverseOrientation Translate 1 0 0
          Shape \"sphere\" AttributeEnd
        Shape \"sphere\"
        Attribute \"shape\" \"float radius\" 3 Shape \"sphere\" Shape \"sphere\" \"float radius\" 2",
    );
    let [first, second, third, fourth] = &scene.shapes[..] else { panic!() };
    let red = |shape: &crate::scene_file::description::ShapeDescription| match scene.materials[shape.material]
        .value
    {
        MaterialDescription::Lambert { reflectance, .. } => reflectance.x,
        _ => panic!(),
    };
    assert!(
        first.value.flip_normal && red(&first.value) == 0.0 && first.value.transform.translation.x == 1.0
    );
    assert!(
        !second.value.flip_normal && red(&second.value) == 1.0 && second.value.transform.translation.x == 0.0
    );
    assert!(matches!(third.value.geometry, GeometryDescription::Sphere { radius: 3.0, .. }));
    assert!(matches!(fourth.value.geometry, GeometryDescription::Sphere { radius: 2.0, .. }));
    // The same material is described once.
    assert_eq!(second.value.material, third.value.material);
    for (text, told) in [
        ("AttributeBegin", "no AttributeEnd"),
        ("AttributeEnd", "without AttributeBegin"),
        ("ObjectBegin \"a\" AttributeEnd", "closes the ObjectBegin"),
    ] {
        let error = read(text).unwrap_err();
        assert!(error.contains(told) && error.contains("a.pbrt:2"), "{error}");
    }
}

#[test]
fn objects_are_placed_by_instances() {
    let scene = scene(
        "ObjectInstance \"thing\" Translate 0 0 1
        AttributeBegin Translate 5 0 0 ObjectBegin \"thing\" AreaLightSource \"diffuse\" Scale 2 2 2 Shape \"sphere\"
        ObjectEnd AttributeEnd
        Rotate 90 0 0 1 ObjectInstance \"thing\"",
    );
    assert_eq!((scene.groups.len(), scene.instances.len(), scene.shapes.len()), (1, 2, 1));
    let shape = &scene.shapes[0].value;
    assert!(shape.group == Some(0) && shape.emission.is_none());
    assert_eq!(shape.transform.transform_point3(DVec3::X), DVec3::new(7.0, 0.0, 1.0));
    assert_eq!(scene.instances[0].value.transform, DAffine3::IDENTITY);
    let placed = scene.instances[1].value.transform * shape.transform;
    assert!((placed.translation - DVec3::new(0.0, 5.0, 2.0)).length() < 1e-12);
    assert!(scene.warnings.iter().any(|warning| warning.message.contains("does not emit")));
    assert!(read("ObjectInstance \"a\"").unwrap_err().contains("no object `a`"));
    let nested = read("ObjectBegin \"a\" ObjectInstance \"a\" ObjectEnd").unwrap_err();
    assert!(nested.contains("stands in an object"), "{nested}");
}

#[test]
fn names_may_be_used_before_they_are_defined() {
    let scene = scene(
        "NamedMaterial \"late\" Shape \"sphere\"
        MakeNamedMaterial \"late\" \"string type\" \"diffuse\" \"rgb reflectance\" [0 0 1]",
    );
    assert_eq!(scene.shapes.len(), 1);
    let error = read("NamedMaterial \"lost\" Shape \"sphere\"").unwrap_err();
    assert!(error.contains("a.pbrt:2:1: there is no material `lost`"), "{error}");
}

#[test]
fn files_are_included_from_the_folder_of_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(PATH);
    let inner = folder.path().join("inner");
    fs::create_dir(&inner).unwrap();
    fs::write(inner.join("b.pbrt"), "Include \"inner/c.pbrt\"\nTranslate 0 0 1\n").unwrap();
    fs::write(inner.join("c.pbrt"), "Translate 1 0 0\n").unwrap();
    let mut packed = GzEncoder::new(fs::File::create(inner.join("d.pbrt.gz")).unwrap(), Compression::fast());
    packed.write_all(b"Shape \"sphere\"").unwrap();
    packed.finish().unwrap();
    let read = |text: &str| {
        fs::write(&path, format!("WorldBegin\n{text}")).unwrap();
        pbrt_scene(&path).map_err(|error| error.to_string())
    };
    let scene = read("Include \"inner/b.pbrt\" Import \"inner/c.pbrt\" Include \"inner/d.pbrt.gz\"").unwrap();
    assert_eq!(scene.shapes[0].value.transform.translation, DVec3::new(1.0, 0.0, 1.0));
    assert_eq!(scene.further_files.len(), 4);
    let before = photon_content_hash(&scene).unwrap();
    fs::write(inner.join("c.pbrt"), "Translate 2 0 0\n").unwrap();
    let scene = read("Include \"inner/b.pbrt\" Import \"inner/c.pbrt\" Include \"inner/d.pbrt.gz\"").unwrap();
    assert_ne!(photon_content_hash(&scene).unwrap(), before);
    // Errors name the included file and its line.
    fs::write(inner.join("c.pbrt"), "\nTranslate 1 0\n").unwrap();
    let error = read("Include \"inner/b.pbrt\"").unwrap_err();
    assert!(error.contains("c.pbrt:2:1: `Translate` takes 3 numbers"), "{error}");
    fs::write(inner.join("c.pbrt"), "Include \"inner/c.pbrt\"").unwrap();
    assert!(read("Include \"inner/c.pbrt\"").unwrap_err().contains("include itself"));
    for name in ["../b.pbrt", "inner/../../b.pbrt", "..\\\\b.pbrt"] {
        let error = read(&format!("Include \"{name}\"")).unwrap_err();
        assert!(error.contains("outside of the folder"), "{error}");
    }
    let absolute = inner.join("d.pbrt.gz");
    assert_eq!(read(&format!("Include \"{}\"", absolute.display())).unwrap().shapes.len(), 1);
}

#[test]
fn errors_tell_where_and_what_to_do() {
    for (text, told) in [
        ("Shap \"sphere\"", "did you mean `Shape`?"),
        ("Shape \"spere\"", "did you mean `sphere`?"),
        ("Shape \"sphere\" \"float raduis\" 2", "did you mean `radius`?"),
        ("Shape \"sphere\" \"flaot radius\" 2", "did you mean `float`?"),
        ("Shape \"sphere\" \"float radius\" \"2\"", "this is no value of `radius`"),
        ("Shape \"sphere\" \"float radius\" [1 2]", "a number is expected"),
        ("Shape \"sphere\" \"float radius\" [1", "no end"),
        ("Shape \"sphere\" \"float radius\" nan", "no number"),
        ("Shape \"sphere", "closing quotation mark"),
        ("Shape \"sphere\" \"radius\" 1", "no parameter"),
        ("Shape \"loopsubdiv\"", "`loopsubdiv` is not modelled"),
        ("Shape \"curve\"", "`curve` is not modelled"),
        (
            "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 3]",
            "the index 3",
        ),
        ("Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1]", "3 numbers each"),
        ("Shape \"plymesh\" \"string filename\" \"none.ply\"", "no file `none.ply`"),
        ("Material \"hair\" Shape \"sphere\"", "`hair` is not modelled"),
        ("Material \"difuse\" Shape \"sphere\"", "did you mean `diffuse`?"),
        ("LightSource \"spott\"", "did you mean `spot`?"),
        ("LightSource \"projection\"", "`projection` is not modelled"),
        ("AreaLightSource \"diffus\" Shape \"sphere\"", "did you mean `diffuse`?"),
        ("Camera \"perspective\"", "behind WorldBegin"),
        (
            "Texture \"a\" \"spectrum\" \"fbm\" Material \"diffuse\" \"texture reflectance\" \"a\" Shape \"sphere\"",
            "bake it",
        ),
        ("Material \"diffuse\" \"texture reflectance\" \"a\" Shape \"sphere\"", "no spectrum texture `a`"),
        ("ColorSpace \"rec709\"", "no colour space"),
        ("\"sphere\"", "where a directive is expected"),
        (
            "MakeNamedMedium \"m\" \"string type\" \"nanovdb\" MediumInterface \"m\" \"\" Material \"interface\" Shape \"sphere\"",
            "varies in space",
        ),
    ] {
        let error = read(text).unwrap_err();
        assert!(
            error.starts_with("a.pbrt:2:") && error.contains(told) && error.contains("help:"),
            "{text}: {error}"
        );
    }
    assert!(whole("Shape \"sphere\"").unwrap_err().contains("before WorldBegin"));
    assert!(whole("Film \"rgb\"").unwrap_err().contains("no WorldBegin"));
    let error = whole("Camera \"realistic\" WorldBegin").unwrap_err();
    assert!(error.contains("`realistic` is not modelled") && error.contains("lensradius"), "{error}");
    let error = whole("Camera \"spherical\" WorldBegin").unwrap_err();
    assert!(error.contains("`equalarea`") && error.contains("equirectangular"), "{error}");
    let odd = scene("Shape \"sphere\" \"float wibble\" 3");
    assert!(odd.warnings.iter().any(|warning| warning.message.contains("`wibble` is not known")));
}

#[test]
fn meshes_have_their_normals_and_coordinates() {
    let plain = scene(TRIANGLE);
    let GeometryDescription::Loaded { mesh, .. } = &plain.shapes[0].value.geometry else { panic!() };
    assert!(mesh.normals.is_none() && mesh.triangles == [[0, 1, 2]]);
    // Normals decide the front.
    let turned = scene(&format!("{TRIANGLE} \"normal N\" [0 0 -1 0 0 -1 0 0 -1]"));
    let GeometryDescription::Loaded { mesh, .. } = &turned.shapes[0].value.geometry else { panic!() };
    assert_eq!(mesh.triangles, [[0, 2, 1]]);
    // Flat patches are two triangles, others a grid that is smooth.
    let patch = |z: f64| scene(&format!("Shape \"bilinearmesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 {z}]"));
    let GeometryDescription::Loaded { mesh, .. } = &patch(0.0).shapes[0].value.geometry else { panic!() };
    assert_eq!(mesh.triangles.len(), 2);
    for triangle in &mesh.triangles {
        let [a, b, c] = mesh.positions.corners(*triangle);
        assert!((b - a).cross(c - a).z > 0.0);
    }
    let bent = patch(0.5);
    let GeometryDescription::Loaded { mesh, .. } = &bent.shapes[0].value.geometry else { panic!() };
    assert!(mesh.triangles.len() == 512 && mesh.normals.is_some());
    assert!(bent.notes.iter().any(|note| note.message.contains("not flat")));
    let part = scene("Shape \"sphere\" \"float zmin\" 0");
    assert!(matches!(part.shapes[0].value.geometry, GeometryDescription::Loaded { .. }));
    let oval = scene("Scale 1 2 1 Shape \"disk\"");
    assert!(matches!(oval.shapes[0].value.geometry, GeometryDescription::Loaded { .. }));
}

#[test]
fn ply_files_are_read_packed_or_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(PATH);
    let ply = |normals: &str, n: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n{normals}\
            element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0{n}\n1 0 0{n}\n0 1 0{n}\n3 0 1 2\n"
        )
    };
    let declared = "property float nx\nproperty float ny\nproperty float nz\n";
    fs::write(folder.path().join("flat.ply"), ply("", "")).unwrap();
    fs::write(folder.path().join("smooth.ply"), ply(declared, " 0 0 1")).unwrap();
    let mut packed = GzEncoder::new(Vec::new(), Compression::fast());
    packed.write_all(ply("", "").as_bytes()).unwrap();
    fs::write(folder.path().join("c.ply.gz"), packed.finish().unwrap()).unwrap();
    let geometry = |name: &str| {
        fs::write(&path, format!("WorldBegin Shape \"plymesh\" \"string filename\" \"{name}\"")).unwrap();
        pbrt_scene(&path)
            .map(|scene| scene.shapes[0].value.geometry.clone())
            .map_err(|error| error.to_string())
    };
    let normals = |name: &str| match geometry(name).unwrap() {
        GeometryDescription::MeshFile { normals, .. } => normals,
        other => panic!("{other:?}"),
    };
    assert_eq!((normals("flat.ply"), normals("smooth.ply")), (MeshNormals::Flat, MeshNormals::Leading));
    let GeometryDescription::Loaded { mesh, .. } = geometry("c.ply.gz").unwrap() else { panic!() };
    assert_eq!(mesh.triangles.len(), 1);
    fs::write(folder.path().join("c.ply.gz"), b"\x1f\x8b not gzip").unwrap();
    assert!(geometry("c.ply.gz").unwrap_err().contains("unpacked"));
}

#[test]
fn lights_shine_as_in_pbrt() {
    let light = |text: &str| scene(&format!("LightSource {text}")).lights[0].value.clone();
    let LightDescription::Point { position, intensity } =
        light("\"point\" \"point3 from\" [1 2 3] \"rgb I\" [1 1 1] \"float power\" 25")
    else {
        panic!()
    };
    assert!(position == DVec3::new(1.0, 2.0, 3.0) && (intensity - 25.0 / (4.0 * PI)).length() < 1e-12);
    let LightDescription::Directional { direction, irradiance } =
        light("\"distant\" \"point3 from\" [0 4 0] \"point3 to\" [0 0 0] \"float illuminance\" 100")
    else {
        panic!()
    };
    assert_eq!((direction, irradiance), (DVec3::NEG_Y, DVec3::splat(100.0)));
    let LightDescription::Environment { radiance } = light("\"infinite\" \"float illuminance\" 3") else {
        panic!()
    };
    assert!((radiance - 3.0 / PI).length() < 1e-12);
    // The colour of a black body has the luminance one in pbrt-v4.
    let LightDescription::Environment { radiance } =
        light("\"infinite\" \"blackbody L\" 3000 \"float scale\" 2")
    else {
        panic!()
    };
    assert!((paint::luminance(radiance) - 2.0).abs() < 1e-9 && radiance.x > radiance.z, "{radiance}");
    let LightDescription::Spot { direction, outer, .. } =
        light("\"spot\" \"point3 from\" [0 0 1] \"point3 to\" [0 0 0] \"float coneangle\" 45")
    else {
        panic!()
    };
    assert!(direction == DVec3::NEG_Z && (outer - PI / 4.0).abs() < 1e-12);
    assert!(read("LightSource \"distant\" \"point3 to\" [0 0 0]").unwrap_err().contains("same point"));
    // Two triangles of one area: each emits the power.
    let lamp = scene(
        "AreaLightSource \"diffuse\" \"float power\" 10 Scale 2 2 2 Shape \"trianglemesh\"
        \"point3 P\" [0 0 0 1 0 0 1 1 0 0 1 0] \"integer indices\" [0 1 2 0 2 3]",
    );
    let radiance = lamp.shapes[0].value.emission.unwrap().emitted.radiance(1.0);
    assert!((radiance - 10.0 / (PI * 2.0)).length() < 1e-9, "{radiance}");
    let uneven = scene(
        "AreaLightSource \"diffuse\" \"float power\" 10 \"bool twosided\" true Shape \"trianglemesh\"
        \"point3 P\" [0 0 0 1 0 0 0 1 0 5 0 0] \"integer indices\" [0 1 2 0 3 2]",
    );
    let of = |i: usize| uneven.shapes[i].value.emission.unwrap().emitted.radiance(1.0).x;
    assert!((of(0) - 10.0 / PI).abs() < 1e-9 && (of(1) - 2.0 / PI).abs() < 1e-9, "{} {}", of(0), of(1));
    let ball = scene("AreaLightSource \"diffuse\" \"float power\" 10 Scale 2 2 2 Shape \"sphere\"");
    let radiance = ball.shapes[0].value.emission.unwrap().emitted.radiance(1.0).x;
    assert!((radiance - 10.0 / (PI * 16.0 * PI)).abs() < 1e-12);
}

/// The picture of all directions of pbrt-v3 has z up and begins at +x.
#[test]
fn pictures_of_all_directions_stand_upright() {
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("sky.exr");
    fs::write(&picture, b"never read").unwrap();
    let light = |text: &str| scene(&format!("{text} \"{}\"", picture.display())).lights[0].value.clone();
    let LightDescription::EnvironmentMap { layout, axes, turn, .. } =
        light("LightSource \"infinite\" \"string filename\"")
    else {
        panic!()
    };
    assert!(layout == EnvironmentLayout::EqualArea && turn == 0.0);
    assert!((axes.unwrap() - glam::DMat3::IDENTITY).to_cols_array().iter().all(|d| d.abs() < 1e-12));
    let LightDescription::EnvironmentMap { layout, axes, .. } =
        light("Rotate 90 1 0 0 LightSource \"infinite\" \"string mapname\"")
    else {
        panic!()
    };
    let axes = axes.unwrap();
    // Up is the z of the light, which the rotation brings to -y; the left edge (+z of the map) is its x.
    assert_eq!(layout, EnvironmentLayout::LatitudeLongitude);
    assert!((axes * DVec3::Y - DVec3::NEG_Y).length() < 1e-9 && (axes * DVec3::Z - DVec3::X).length() < 1e-9);
    assert!((axes * DVec3::NEG_X - DVec3::Z).length() < 1e-9, "{axes}");
}

#[test]
fn mutated_scenes_are_read_or_refused() {
    use proptest::prelude::*;
    let seed = include_bytes!("../../../fuzz/rich.pbrt");
    assert!(
        parse_pbrt_bytes(seed, Path::new(PATH)).is_ok(),
        "{:?}",
        parse_pbrt_bytes(seed, Path::new(PATH)).err()
    );
    let mut runner = proptest::test_runner::TestRunner::new(ProptestConfig::with_cases(300));
    let changes = prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0..6u8), 1..6);
    runner
        .run(&changes, |changes| {
            let mut bytes = seed.to_vec();
            for (index, byte, how) in changes {
                if bytes.is_empty() {
                    break;
                }
                let at = index.index(bytes.len());
                let end = (at + usize::from(byte) % 40).min(bytes.len());
                match how {
                    0 => bytes[at] = byte,
                    1 => drop(bytes.drain(at..end)),
                    2 => {
                        let part = bytes[at..end].to_vec();
                        bytes.splice(at..at, part);
                    }
                    3 => bytes.truncate(at.max(1)),
                    4 => drop(bytes.splice(at..at, *b" 1e300 ")),
                    _ => drop(bytes.splice(at..at, *b"\" ] [")),
                }
            }
            if let Err(error) = parse_pbrt_bytes(&bytes, Path::new(PATH)) {
                prop_assert!(error.to_string().contains(PATH), "{}", error);
            }
            Ok(())
        })
        .unwrap();
}
