//! Tests of the import of materials and textures.

use super::mitsuba_scene_within;
use super::tests::{layered, material, read, scene};
use crate::bsdf::{Body, Bsdf};
use crate::math::Rgb;
use crate::media::Phase;
use crate::memory::MemoryEstimate;
use crate::scene::Coverage;
use crate::scene_file::description::{GeometryDescription, MaterialDescription};
use glam::{DVec3, Vec2, Vec3};
use std::fs;

#[test]
fn borders_have_media_of_their_indices() {
    let indices = |inside: &str, outside: &str| {
        let (material, scene) = material(&format!(
            "<bsdf type=\"dielectric\"><float name=\"int_ior\" value=\"{inside}\"/><float name=\"ext_ior\" value=\"{outside}\"/></bsdf>"
        ));
        let MaterialDescription::Dielectric { inside, outside, roughness: 0.0 } = material else { panic!() };
        [inside, outside].map(|medium| scene.media[medium].value.ior)
    };
    assert_eq!(indices("1.5", "1"), [1.5, 1.0]);
    assert_eq!(indices("1.5", "1.33"), [1.5, 1.33]);
    // A bubble: the medium around it gets the index.
    let [inside, outside] = indices("0.763", "1");
    assert!(inside == 1.0 && (outside - 1.0 / 0.763).abs() < 1e-12);
    let (_, scene) =
        material("<bsdf type=\"roughdielectric\"><string name=\"int_ior\" value=\"water\"/></bsdf>");
    assert!((scene.media[1].value.ior - 1.333 / 1.000_277).abs() < 1e-12);
    assert!(scene.notes.iter().any(|note| note.message.contains("Beckmann")));
}

#[test]
fn an_interior_absorbs() {
    let glass = |medium: &str| {
        scene(&format!(
            "<medium type=\"homogeneous\" id=\"m\">{medium}</medium><shape type=\"sphere\"><bsdf type=\"dielectric\"/><ref name=\"interior\" id=\"m\"/></shape>
            <shape type=\"sphere\"><bsdf type=\"null\"/><ref name=\"interior\" id=\"m\"/></shape><shape type=\"sphere\"><bsdf type=\"null\"/></shape>"
        ))
    };
    let scene = glass(
        "<rgb name=\"sigma_t\" value=\"2, 1, 0.5\"/><float name=\"albedo\" value=\"0\"/><float name=\"scale\" value=\"3\"/>",
    );
    let absorption: Vec<_> =
        scene.media.iter().map(|medium| (medium.value.ior > 1.4, medium.value.absorption)).collect();
    assert!(absorption.contains(&(true, DVec3::new(6.0, 3.0, 1.5))), "{absorption:?}");
    assert!(absorption.contains(&(false, DVec3::new(6.0, 3.0, 1.5))), "{absorption:?}");
    // A null surface without a medium inside adds no shape.
    assert_eq!(scene.shapes.len(), 2);
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let scene = glass(
        "<rgb name=\"sigma_t\" value=\"2\"/><float name=\"albedo\" value=\"0.75\"/><phase type=\"hg\"><float name=\"g\" value=\"0.5\"/></phase>",
    );
    let volumes: Vec<_> = scene.media.iter().filter_map(|medium| medium.value.volume.clone()).collect();
    assert_eq!(volumes.len(), 2, "{volumes:?}");
    for volume in volumes {
        assert_eq!(volume.coefficients.absorption(), Rgb::splat(0.5));
        assert_eq!(volume.coefficients.scattering(), Rgb::splat(1.5));
        assert_eq!(volume.phase, Phase::henyey_greenstein(0.5).unwrap());
    }
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
}

#[test]
fn metals_are_by_name_or_index() {
    let metal = |inside: &str| match material(&format!(
        "<bsdf type=\"roughconductor\">{inside}<string name=\"distribution\" value=\"ggx\"/></bsdf>"
    ))
    .0
    {
        MaterialDescription::Glossy { bsdf: Bsdf::Conductor(conductor), two_sided: false, .. } => conductor,
        other => panic!("{other:?}"),
    };
    let gold = metal("<string name=\"material\" value=\"Au\"/><float name=\"alpha\" value=\"0.3\"/>");
    assert_eq!(gold.roughness(), 0.3);
    let by_index =
        metal("<rgb name=\"eta\" value=\"0.2, 0.9, 1.1\"/><rgb name=\"k\" value=\"3.9, 2.4, 2.1\"/>");
    assert_eq!(by_index.roughness(), 0.1);
    // A tint scales the reflectance at every angle.
    let tinted =
        layered("<bsdf type=\"conductor\"><rgb name=\"specular_reflectance\" value=\"0.5\"/></bsdf>");
    let model = tinted.representative();
    for cosine in [1.0f32, 0.5, 0.05] {
        let wo = Vec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
        let sample =
            Bsdf::Layered(model).sample(wo, 0.5, Vec2::splat(0.5), crate::bsdf::TransportMode::Radiance);
        let throughput = sample.unwrap().throughput.x;
        assert!((throughput - 0.5).abs() < 1e-3, "{cosine}: {throughput}");
    }
    let stretched = layered(
        "<bsdf type=\"roughconductor\"><float name=\"alpha_u\" value=\"0.4\"/><float name=\"alpha_v\" value=\"0.1\"/></bsdf>",
    );
    let (roughness, strength) = (stretched.roughness, stretched.anisotropy[0]);
    let across = roughness * roughness;
    assert!(
        (across - 0.1).abs() < 1e-6 && (across + (1.0 - across) * strength * strength - 0.4).abs() < 1e-6
    );
}

/// The diffuse base of a plastic with an index of 1.5: its internal reflectance for diffuse light is 0.596 (Egan & Hilgeman
/// 1973).
#[test]
fn light_in_plastic_is_thrown_back() {
    assert!((super::import::models::internal_reflectance(1.5) - 0.5963).abs() < 1e-3);
    let plastic = |is_nonlinear: bool| {
        layered(&format!(
            "<bsdf type=\"plastic\"><float name=\"int_ior\" value=\"1.5\"/><float name=\"ext_ior\" value=\"1\"/><rgb name=\"diffuse_reflectance\" value=\"0.5\"/>
            <boolean name=\"nonlinear\" value=\"{is_nonlinear}\"/></bsdf>"
        ))
    };
    assert_eq!(plastic(false).factors.base, Rgb::splat(0.5));
    assert!((plastic(true).factors.base.x - 0.5 * 0.4037 / (1.0 - 0.5 * 0.5963)).abs() < 1e-3);
    assert_eq!(plastic(false).roughness, 0.0);
}

#[test]
fn sheets_and_principled_materials_are_layers() {
    let sheet = layered(
        "<bsdf type=\"thindielectric\"><float name=\"int_ior\" value=\"1.5\"/><float name=\"ext_ior\" value=\"1\"/></bsdf>",
    );
    assert_eq!((sheet.factors.body, sheet.factors.transmission), (Body::Thin, 1.0));
    // Both sides reflect 4 %, and interreflection between them adds to it: 2 R / (1 + R).
    let normal = sheet.factors.specular_colour.x * 0.04;
    assert!((normal - 0.08 / 1.04).abs() < 1e-6, "{normal}");
    let paint = layered(
        "<bsdf type=\"principled\"><rgb name=\"base_color\" value=\"0.2, 0.4, 0.6\"/><float name=\"metallic\" value=\"0.7\"/>
        <float name=\"roughness\" value=\"0.3\"/><float name=\"clearcoat\" value=\"0.8\"/><float name=\"clearcoat_gloss\" value=\"1\"/></bsdf>",
    );
    assert_eq!((paint.factors.metallic, paint.roughness, paint.factors.coat), (0.7, 0.3, 0.2));
    let (glass, scene) = material(
        "<bsdf type=\"principled\"><float name=\"spec_trans\" value=\"1\"/><float name=\"eta\" value=\"1.4\"/><float name=\"roughness\" value=\"0\"/></bsdf>",
    );
    let MaterialDescription::Layered { media: Some([inside, 0]), .. } = glass else { panic!("{glass:?}") };
    assert_eq!(scene.media[inside].value.ior, 1.4);
}

#[test]
fn masks_blends_and_both_sides() {
    let grey = "<bsdf type=\"diffuse\"><rgb name=\"reflectance\" value=\"0.2\"/></bsdf>";
    let MaterialDescription::Lambert { two_sided: true, .. } =
        material(&format!("<bsdf type=\"twosided\">{grey}</bsdf>")).0
    else {
        panic!()
    };
    let masked =
        layered(&format!("<bsdf type=\"mask\"><float name=\"opacity\" value=\"0.3\"/>{grey}</bsdf>"));
    assert_eq!((masked.alpha, masked.coverage), (0.3, Coverage::Blend));
    let white = grey.replace("0.2", "0.6");
    let blend = |weight: &str, a: &str, b: &str| {
        format!("<bsdf type=\"blendbsdf\"><float name=\"weight\" value=\"{weight}\"/>{a}{b}</bsdf>")
    };
    let MaterialDescription::Lambert { reflectance, .. } = material(&blend("0.25", grey, &white)).0 else {
        panic!()
    };
    assert!((reflectance.x - 0.3).abs() < 1e-6);
    let half = layered(&blend("0.25", grey, "<bsdf type=\"null\"/>"));
    assert_eq!(half.alpha, 0.75);
    let (_, scene) = material(&blend("0.25", grey, "<bsdf type=\"dielectric\"/>"));
    assert!(scene.warnings.iter().any(|warning| warning.message.contains("cannot be modelled")));
}

#[test]
fn pictures_lie_on_meshes_with_coordinates() {
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("a.tga");
    // Two texels: black and white.
    fs::write(&picture, b"\0\0\x03\0\0\0\0\0\0\0\0\0\x02\0\x01\0\x08\x20\x00\xff").unwrap();
    let bitmap = |name: &str, more: &str| {
        format!(
            "<texture type=\"bitmap\" name=\"{name}\"><string name=\"filename\" value=\"{}\"/>{more}</texture>",
            picture.display()
        )
    };
    let repeated = bitmap(
        "reflectance",
        "<transform name=\"to_uv\"><scale x=\"3\" y=\"2\"/><translate x=\"0.5\"/></transform><string name=\"wrap_mode\" value=\"mirror\"/>",
    );
    let body = format!("<shape type=\"rectangle\"><bsdf type=\"diffuse\">{repeated}</bsdf></shape>");
    let scene_of = scene(&body);
    let GeometryDescription::Gltf { mesh, data } = &scene_of.shapes[0].value.geometry else { panic!() };
    assert_eq!(mesh.triangles.len(), 2);
    // The lower left corner has the coordinates 0, 0.
    let corner = (0..4).find(|i| mesh.positions.get(*i) == DVec3::new(-1.0, -1.0, 0.0)).unwrap();
    assert_eq!(data.uvs[0][corner as usize], Vec2::ZERO);
    let MaterialDescription::Layered { material, .. } =
        &scene_of.materials[scene_of.shapes[0].value.material].value
    else {
        panic!()
    };
    let slot = material.base.as_ref().unwrap();
    assert_eq!(slot.coordinates([Vec2::new(0.5, 0.25); 2]), Vec2::new(2.0, 0.5));
    assert_eq!(slot.sampler.wrap, [crate::textures::Wrap::Mirror; 2]);
    assert!(scene_of.further_files.contains(&picture));
    // Emission from a picture: its mean determines the flux, and its brightest colour is the factor.
    let glow = scene(&format!(
        "<shape type=\"rectangle\"><emitter type=\"area\">{}</emitter></shape>",
        bitmap("radiance", "")
    ));
    assert_eq!(glow.shapes[0].value.emission.unwrap().emitted.radiance(1.0), DVec3::ONE);
    let MaterialDescription::Layered { material, .. } = &glow.materials[glow.shapes[0].value.material].value
    else {
        panic!()
    };
    assert!((material.emission.as_ref().unwrap().texture.mean().x - 0.5).abs() < 1e-3);
    // Layers store the square roots of slopes: the root of 1, and 0.
    let rough = scene(&format!(
        "<shape type=\"rectangle\"><bsdf type=\"roughplastic\">{}</bsdf></shape>",
        bitmap("alpha", "<boolean name=\"raw\" value=\"true\"/>")
    ));
    let MaterialDescription::Layered { material, .. } =
        &rough.materials[rough.shapes[0].value.material].value
    else {
        panic!()
    };
    assert_eq!((material.roughness, material.metallic_roughness.is_some()), (1.0, true));
    // A mask on a colour becomes the alpha of the picture.
    let masked = scene(&format!(
        "<shape type=\"sphere\"><bsdf type=\"mask\">{}<bsdf type=\"diffuse\"/></bsdf></shape>",
        bitmap("opacity", "")
    ));
    let MaterialDescription::Layered { material, .. } =
        &masked.materials[masked.shapes[0].value.material].value
    else {
        panic!()
    };
    let mean = material.base.as_ref().unwrap().texture.mean();
    assert!((mean.w - 0.5).abs() < 1e-3 && mean.x == 1.0, "{mean}");
    let bumped = scene(&format!(
        "<shape type=\"rectangle\"><bsdf type=\"bumpmap\">{}<bsdf type=\"diffuse\"/></bsdf></shape>",
        bitmap("arbitrary", "")
    ));
    let MaterialDescription::Layered { material, .. } =
        &bumped.materials[bumped.shapes[0].value.material].value
    else {
        panic!()
    };
    assert!(material.normal.is_some());
    let GeometryDescription::Gltf { data, .. } = &bumped.shapes[0].value.geometry else { panic!() };
    assert_eq!(data.tangents[0], (Vec3::X, 1.0));
    // A file that is not a picture is reported.
    fs::write(&picture, b"\0\0\x03\0").unwrap();
    assert!(read(&body).unwrap_err().contains("cannot be read"));
}

/// The memory for a mesh under a picture is checked before the mesh is read; other meshes are checked when the scene is built.
#[test]
fn memory_is_asked_for_before_meshes_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.xml");
    fs::write(folder.path().join("a.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".repeat(1000)).unwrap();
    let text = |reflectance: &str| {
        format!(
            "<scene><shape type=\"obj\"><string name=\"filename\" value=\"a.obj\"/><bsdf type=\"diffuse\">{reflectance}</bsdf></shape></scene>"
        )
    };
    let squares = text("<texture type=\"checkerboard\" name=\"reflectance\"/>");
    let asked = |text: &str, most: u64| {
        fs::write(&path, text).unwrap();
        let allow = |estimate: &MemoryEstimate| match estimate.meshes {
            meshes if meshes > most => estimate.check(Some(1)),
            _ => Ok(()),
        };
        mitsuba_scene_within(&path, &[], &allow).map_err(|error| error.to_string())
    };
    assert!(asked(&squares, u64::MAX).is_ok());
    let error = asked(&squares, 1000).unwrap_err();
    assert!(error.contains("a.xml:1:8") && error.contains("the mesh of shape `obj`"), "{error}");
    assert!(asked(&text(""), 0).is_ok());
    fs::write(&path, &squares).unwrap();
    let none = |estimate: &MemoryEstimate| estimate.check(Some(1));
    assert!(mitsuba_scene_within(&path, &[], &none).is_err());
}

#[test]
fn checkerboards_begin_with_the_first_colour() {
    let material = layered(
        "<bsdf type=\"diffuse\"><texture type=\"checkerboard\" name=\"reflectance\"><rgb name=\"color0\" value=\"0.7\"/><rgb name=\"color1\" value=\"0.1\"/></texture></bsdf>",
    );
    let slot = material.base.unwrap();
    let at = |u: f32, v: f32| slot.at([Vec2::new(u, v); 2], 0.0).x;
    for (u, v, value) in
        [(0.25, 0.25, 0.7), (0.75, 0.25, 0.1), (0.25, 0.75, 0.1), (0.75, 0.75, 0.7), (1.25, 0.25, 0.7)]
    {
        assert!((at(u, v) - value).abs() < 1e-4, "{u} {v}: {}", at(u, v));
    }
}
