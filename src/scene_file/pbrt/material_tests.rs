//! Tests of the import of materials, textures and media.

use super::tests::{read, scene};
use crate::bsdf::{Body, Bsdf};
use crate::scene::{Coverage, LayeredMaterial};
use crate::scene_file::SceneDescription;
use crate::scene_file::description::{GeometryDescription, MaterialDescription};
use glam::{DVec3, Vec2};
use std::fs;

/// The material of a sphere behind these directives.
fn material(text: &str) -> (MaterialDescription, SceneDescription) {
    let scene = scene(&format!("{text} Shape \"sphere\""));
    let number = scene.shapes[0].value.material;
    (scene.materials[number].value.clone(), scene)
}

fn layered(text: &str) -> LayeredMaterial {
    match material(text).0 {
        MaterialDescription::Layered { material, .. } => (*material).clone(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn glass_and_metal_have_their_indices() {
    let (glass, scene) = material("Material \"dielectric\" \"float eta\" 1.8 \"float roughness\" 0.09");
    let MaterialDescription::Dielectric { inside, outside: 0, roughness } = glass else {
        panic!("{glass:?}")
    };
    // Roughness is the square of the slope, unless it is not remapped.
    assert!((roughness - 0.3).abs() < 1e-9 && scene.media[inside].value.ior == 1.8);
    let (glass, scene) = material("Material \"dielectric\" \"spectrum eta\" \"glass-SF11\"");
    let MaterialDescription::Dielectric { inside, roughness: 0.0, .. } = glass else { panic!() };
    assert!((scene.media[inside].value.ior - 1.78472).abs() < 1e-6);
    let metal = |text: &str| match material(&format!("Material \"conductor\" {text}")).0 {
        MaterialDescription::Glossy { bsdf: Bsdf::Conductor(conductor), two_sided: true, .. } => conductor,
        other => panic!("{other:?}"),
    };
    let silver =
        metal("\"spectrum eta\" \"metal-Ag-eta\" \"spectrum k\" \"metal-Ag-k\" \"float roughness\" 0.04");
    assert!((silver.roughness() - 0.2).abs() < 1e-6);
    let raw = metal(
        "\"rgb eta\" [0.2 0.9 1.1] \"rgb k\" [3.9 2.4 2.1] \"float roughness\" 0.04 \"bool remaproughness\" false",
    );
    assert!((raw.roughness() - 0.04).abs() < 1e-6);
    let sheet = layered("Material \"thindielectric\"");
    assert_eq!((sheet.factors.body, sheet.factors.transmission), (Body::Thin, 1.0));
    assert!(
        read("Material \"dielectric\" \"spectrum eta\" \"glass-BK8\" Shape \"sphere\"")
            .unwrap_err()
            .contains("did you mean")
    );
    assert!(
        read("Material \"conductor\" \"spectrum eta\" \"metal-Xx-eta\" Shape \"sphere\"")
            .unwrap_err()
            .contains("not known")
    );
}

/// A conductor by its reflectance reflects that along the normal.
#[test]
fn conductors_by_reflectance() {
    let (metal, _) = material("Material \"conductor\" \"rgb reflectance\" [0.9 0.5 0.1]");
    let MaterialDescription::Glossy { bsdf: Bsdf::Conductor(conductor), .. } = metal else { panic!() };
    let sample = Bsdf::Conductor(conductor).sample(
        glam::Vec3::Z,
        0.5,
        Vec2::splat(0.5),
        crate::bsdf::TransportMode::Radiance,
    );
    let reflected = sample.unwrap().throughput;
    assert!((reflected - glam::Vec3::new(0.9, 0.5, 0.1)).abs().max_element() < 1e-3, "{reflected}");
}

#[test]
fn coats_are_layers() {
    let paint = layered("Material \"coateddiffuse\" \"rgb reflectance\" [0.5 0.5 0.5]");
    assert!(
        (paint.factors.base.x - 0.5 * 0.4037 / (1.0 - 0.5 * 0.5963)).abs() < 1e-3 && paint.roughness == 0.0
    );
    let coated = layered(
        "Material \"coatedconductor\" \"float interface.roughness\" 0.0001 \"float conductor.roughness\" 0.01",
    );
    assert_eq!((coated.factors.metallic, coated.factors.coat), (1.0, 1.0));
    // The slope is 0.1, and layers keep its root.
    assert!((coated.roughness - 0.1f32.sqrt()).abs() < 1e-5 && (coated.coat_roughness - 0.1).abs() < 1e-5);
    let (_, scene) = material("Material \"coateddiffuse\" \"rgb albedo\" [0.5 0.5 0.5]");
    assert!(scene.warnings.iter().any(|warning| warning.message.contains("`albedo`")));
}

#[test]
fn mixes_and_alpha() {
    let two = "MakeNamedMaterial \"a\" \"string type\" \"diffuse\" \"rgb reflectance\" [0.2 0.2 0.2]
        MakeNamedMaterial \"b\" \"string type\" \"diffuse\" \"rgb reflectance\" [0.6 0.6 0.6]
        MakeNamedMaterial \"c\" \"string type\" \"dielectric\" MakeNamedMaterial \"none\" \"string type\" \"interface\"";
    let mix = |a: &str, b: &str| {
        material(&format!(
            "{two} Material \"mix\" \"string materials\" [\"{a}\" \"{b}\"] \"float amount\" 0.25"
        ))
    };
    let MaterialDescription::Lambert { reflectance, .. } = mix("a", "b").0 else { panic!() };
    assert!((reflectance.x - 0.3).abs() < 1e-6);
    let MaterialDescription::Layered { material: half, .. } = mix("a", "none").0 else { panic!() };
    assert_eq!((half.alpha, half.coverage), (0.75, Coverage::Blend));
    let (_, scene) = mix("a", "c");
    assert!(scene.warnings.iter().any(|warning| warning.message.contains("cannot be modelled")));
    let scene = super::tests::scene("Shape \"sphere\" \"float alpha\" 0.4 Shape \"sphere\"");
    let MaterialDescription::Layered { material, .. } =
        &scene.materials[scene.shapes[0].value.material].value
    else {
        panic!()
    };
    assert_eq!(material.alpha, 0.4);
    assert!(matches!(
        scene.materials[scene.shapes[1].value.material].value,
        MaterialDescription::Lambert { .. }
    ));
    let circle = "MakeNamedMaterial \"m\" \"string type\" \"mix\" \"string materials\" [\"m\" \"m\"] NamedMaterial \"m\" Shape \"sphere\"";
    assert!(read(circle).unwrap_err().contains("contain each other"));
}

/// Old materials, with the slope of the old polynomial.
#[test]
fn materials_of_the_third_version() {
    let (matte, scene) = material("Material \"matte\" \"color Kd\" [0.1 0.2 0.3]");
    assert!(matches!(matte, MaterialDescription::Lambert { .. }));
    assert!(scene.notes.iter().any(|note| note.message.contains("pbrt-v3")));
    let (glass, scene) = material("Material \"glass\" \"float index\" 1.4");
    let MaterialDescription::Dielectric { inside, roughness: 0.0, .. } = glass else { panic!("{glass:?}") };
    assert_eq!(scene.media[inside].value.ior, 1.4);
    let (metal, _) = material("Material \"metal\" \"float roughness\" 0.1");
    let MaterialDescription::Glossy { bsdf: Bsdf::Conductor(metal), .. } = metal else { panic!() };
    // 1.62142 + 0.819955 x + 0.1734 x^2 + 0.0171201 x^3 + 0.000640711 x^4 for x = ln 0.1.
    assert!((metal.roughness() - 0.4618).abs() < 1e-3, "{}", metal.roughness());
    assert!(matches!(material("Material \"mirror\"").0, MaterialDescription::Glossy { .. }));
    let plastic = layered("Material \"plastic\" \"rgb Kd\" [0.3 0.3 0.3] \"rgb Ks\" [0.5 0.5 0.5]");
    assert!((plastic.factors.specular - 0.5).abs() < 1e-6 && plastic.factors.metallic == 0.0);
    let uber = layered("Material \"uber\" \"rgb opacity\" [0.5 0.5 0.5]");
    assert_eq!(uber.alpha, 0.5);
    let substrate = layered("Material \"substrate\" \"rgb Ks\" [0.1 0.1 0.1]");
    assert!((substrate.factors.specular_colour.x - 2.5).abs() < 1e-4 && substrate.factors.specular == 1.0);
}

#[test]
fn pictures_run_upwards() {
    let folder = tempfile::tempdir().unwrap();
    let picture = folder.path().join("a.tga");
    // Two rows of one texel from the top: black and white.
    fs::write(&picture, b"\0\0\x03\0\0\0\0\0\0\0\0\0\x01\0\x02\0\x08\x20\x00\xff").unwrap();
    let image = |name: &str, more: &str| {
        format!(
            "Texture \"{name}\" \"spectrum\" \"imagemap\" \"string filename\" \"{}\" {more}",
            picture.display()
        )
    };
    let painted = |text: &str| layered(&format!("{text} Material \"diffuse\" \"texture reflectance\" \"t\""));
    let plain = painted(&image("t", ""));
    let slot = plain.base.unwrap();
    let at = |v: f32| slot.at([Vec2::new(0.5, v); 2], 0.0).x;
    // The upper row is that of v near one.
    assert!(at(0.75) < 0.01 && at(0.25) > 0.99, "{} {}", at(0.75), at(0.25));
    let moved = painted(&image("t", "\"float vscale\" 1 \"float vdelta\" 0.5 \"float scale\" 0.5"));
    assert!(moved.factors.base.x == 0.5);
    let slot = moved.base.unwrap();
    assert!(slot.at([Vec2::new(0.5, 0.75); 2], 0.0).x > 0.99);
    let inverse = painted(&image("t", "\"bool invert\" true")).base.unwrap();
    assert!(inverse.at([Vec2::new(0.5, 0.75); 2], 0.0).x > 0.99);
    // A mix between two colours by a picture.
    let mixed = painted(&format!(
        "Texture \"f\" \"float\" \"imagemap\" \"string filename\" \"{}\" Texture \"t\" \"spectrum\" \"mix\"
        \"rgb tex1\" [1 0 0] \"rgb tex2\" [0 0 1] \"texture amount\" \"f\"",
        picture.display()
    ));
    let slot = mixed.base.unwrap();
    let (above, below) = (slot.at([Vec2::new(0.5, 0.75); 2], 0.0), slot.at([Vec2::new(0.5, 0.25); 2], 0.0));
    assert!(above.x > 0.99 && above.z < 0.01 && below.z > 0.99 && below.x < 0.01, "{above} {below}");
    // Roughness by a picture: the roots of slopes, which are the roots of its numbers.
    let rough = layered(&format!(
        "Texture \"r\" \"float\" \"imagemap\" \"string filename\" \"{}\" \"string encoding\" \"linear\" \"float scale\" 0.0625
        Material \"coateddiffuse\" \"texture roughness\" \"r\"",
        picture.display()
    ));
    let value = rough.metallic_roughness.unwrap().at([Vec2::new(0.5, 0.25); 2], 0.0).y;
    assert!((value - 0.5).abs() < 1e-3, "{value}");
    // Without coordinates each triangle has its own.
    let bare = scene(&format!(
        "{} Material \"diffuse\" \"texture reflectance\" \"t\" Shape \"trianglemesh\"
        \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 0] \"integer indices\" [0 1 2 2 1 3]",
        image("t", "")
    ));
    let GeometryDescription::Gltf { mesh, data } = &bare.shapes[0].value.geometry else { panic!() };
    assert_eq!((mesh.positions.len(), data.uvs[0].len(), data.uvs[0][4]), (6, 6, Vec2::X));
    let masked = scene(&format!(
        "Texture \"m\" \"float\" \"imagemap\" \"string filename\" \"{}\" Shape \"sphere\" \"texture alpha\" \"m\"",
        picture.display()
    ));
    let shape = &masked.shapes[0].value;
    assert!(matches!(shape.geometry, GeometryDescription::Gltf { .. }));
    let MaterialDescription::Layered { material, .. } = &masked.materials[shape.material].value else {
        panic!()
    };
    assert!((material.base.as_ref().unwrap().texture.mean().w - 0.5).abs() < 1e-3);
}

#[test]
fn checkerboards_begin_with_the_first_colour() {
    let material = layered(
        "Texture \"c\" \"spectrum\" \"checkerboard\" \"rgb tex1\" [0.7 0.7 0.7] \"rgb tex2\" [0.1 0.1 0.1]
        \"float uscale\" 2 \"float vscale\" 2 Material \"diffuse\" \"texture reflectance\" \"c\"",
    );
    let slot = material.base.unwrap();
    let at = |u: f32, v: f32| slot.at([Vec2::new(u, v); 2], 0.0).x;
    for (u, v, value) in [(0.25, 0.25, 0.7), (0.75, 0.25, 0.1), (0.25, 0.75, 0.1), (0.75, 0.75, 0.7)] {
        assert!((at(u, v) - value).abs() < 1e-4, "{u} {v}: {}", at(u, v));
    }
    let scaled = material_of_scale();
    assert!((scaled.x - 0.1).abs() < 1e-6, "{scaled}");
}

fn material_of_scale() -> glam::Vec3 {
    let (material, _) = material(
        "Texture \"half\" \"float\" \"constant\" \"float value\" 0.5
        Texture \"s\" \"spectrum\" \"scale\" \"rgb tex\" [0.2 0.4 0.6] \"texture scale\" \"half\"
        Material \"diffuse\" \"texture reflectance\" \"s\"",
    );
    match material {
        MaterialDescription::Lambert { reflectance, .. } => reflectance,
        other => panic!("{other:?}"),
    }
}

#[test]
fn media_absorb_and_scatter() {
    let scene = scene(
        "MakeNamedMedium \"ink\" \"string type\" \"homogeneous\" \"rgb sigma_a\" [1 2 3] \"rgb sigma_s\" [0 0 0] \"float scale\" 2
        MakeNamedMedium \"fog\" \"string type\" \"homogeneous\" \"rgb sigma_a\" [0 0 0] \"rgb sigma_s\" [1 1 1] \"float g\" 0.5
        MakeNamedMedium \"milk\" \"string type\" \"homogeneous\" \"string preset\" \"Wholemilk\"
        Material \"dielectric\" MediumInterface \"ink\" \"\" Shape \"sphere\"
        Material \"interface\" MediumInterface \"fog\" \"\" Shape \"sphere\"
        MediumInterface \"milk\" \"fog\" Shape \"sphere\"
        MediumInterface \"\" Shape \"sphere\"
        Material \"diffuse\" MediumInterface \"ink\" \"\" Shape \"sphere\"",
    );
    // A border between nothing and nothing is no surface.
    assert_eq!(scene.shapes.len(), 4);
    let sides = |i: usize| match scene.materials[scene.shapes[i].value.material].value {
        MaterialDescription::Dielectric { inside, outside, .. } => {
            [inside, outside].map(|m| scene.media[m].value.clone())
        }
        ref other => panic!("{other:?}"),
    };
    let [ink, air] = sides(0);
    assert!((ink.absorption - DVec3::new(2.0, 4.0, 6.0)).length() < 1e-6 && ink.ior == 1.5 && air.ior == 1.0);
    let [fog, air] = sides(1);
    let volume = fog.volume.unwrap();
    assert!(volume.coefficients.scattering().x == 1.0 && fog.ior == 1.0 && air.volume.is_none());
    let [milk, around] = sides(2);
    assert!((milk.volume.unwrap().coefficients.scattering().x - 2.55).abs() < 1e-4);
    assert_eq!(around.volume, Some(volume));
    assert!(scene.notes.iter().any(|note| note.message.contains("the media at its sides")));
}
