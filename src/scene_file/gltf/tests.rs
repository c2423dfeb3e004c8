//! Files written here, and collections of odd ones.

use super::*;
use crate::bsdf::Body;
use crate::embree::Device;
use crate::scene::LayeredMaterial;
use crate::scene_file::{LightDescription, MaterialDescription, build_scene};
use base64::Engine;
use serde_json::json;
use std::fs;

/// A right triangle in the plane z = 0, its attributes in turn in one buffer, 32 bytes a vertex: position, normal, uv; then
/// the indices 0 1 2 as bytes, shorts and integers.
fn buffer() -> Vec<u8> {
    let vertices = [[0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let mut bytes = Vec::new();
    for [x, y, z] in vertices {
        [x, y, z, 0.0, 0.0, 1.0, x, 1.0 - y].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    }
    bytes.extend([0u8, 1, 2, 0]);
    [0u16, 1, 2, 0].iter().for_each(|i| bytes.extend(i.to_le_bytes()));
    [0u32, 1, 2].iter().for_each(|i| bytes.extend(i.to_le_bytes()));
    bytes
}

fn uri(bytes: &[u8]) -> String {
    format!(
        "data:application/octet-stream;base64,{}",
        base64::engine::general_purpose::STANDARD.encode(bytes)
    )
}

/// A file with that triangle, indices of four bytes, in a white dielectric.
fn triangle() -> Value {
    let bytes = buffer();
    json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": "corner" }],
        "meshes": [{ "primitives": [{
            "attributes": { "POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2 }, "indices": 5, "material": 0
        }] }],
        "materials": [{ "pbrMetallicRoughness": { "metallicFactor": 0 } }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] },
            { "bufferView": 0, "byteOffset": 12, "componentType": 5126, "count": 3, "type": "VEC3" },
            { "bufferView": 0, "byteOffset": 24, "componentType": 5126, "count": 3, "type": "VEC2" },
            { "bufferView": 1, "componentType": 5121, "count": 3, "type": "SCALAR" },
            { "bufferView": 1, "byteOffset": 4, "componentType": 5123, "count": 3, "type": "SCALAR" },
            { "bufferView": 1, "byteOffset": 12, "componentType": 5125, "count": 3, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": 96, "byteStride": 32 },
            { "buffer": 0, "byteOffset": 96, "byteLength": bytes.len() - 96 },
        ],
        "buffers": [{ "byteLength": bytes.len(), "uri": uri(&bytes) }],
    })
}

fn read_with(value: &Value, parameters: &[(&str, &str)]) -> Result<SceneDescription, GltfError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("test.gltf");
    fs::write(&path, value.to_string()).unwrap();
    let parameters: Vec<_> = parameters.iter().map(|(a, b)| ((*a).to_owned(), (*b).to_owned())).collect();
    gltf_scene(&path, &parameters)
}

fn read(value: &Value) -> Result<SceneDescription, GltfError> {
    read_with(value, &[])
}

/// The same value with another at some places.
fn changed(mut value: Value, changes: &[(&str, Value)]) -> Value {
    for (pointer, new) in changes {
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        let parent = if parent.is_empty() { &mut value } else { value.pointer_mut(parent).unwrap() };
        match parent {
            Value::Array(items) => items[key.parse::<usize>().unwrap()] = new.clone(),
            other => other[key] = new.clone(),
        }
    }
    value
}

/// Corners of the triangles of all shapes, as in the file.
fn corners(description: &SceneDescription) -> Vec<[DVec3; 3]> {
    let mut found = Vec::new();
    for shape in &description.shapes {
        if let GeometryDescription::Gltf { mesh, .. } = &shape.value.geometry {
            found.extend(mesh.triangles.iter().map(|triangle| mesh.positions.corners(*triangle)));
        }
    }
    found
}

fn material(description: &SceneDescription, shape: usize) -> &LayeredMaterial {
    match &description.materials[description.shapes[shape].value.material].value {
        MaterialDescription::Layered { material, .. } => material,
        other => panic!("{other:?}"),
    }
}

#[test]
fn indices_of_every_type_and_interleaved_attributes() {
    let want = corners(&read(&triangle()).unwrap());
    assert_eq!(want, [[DVec3::ZERO, DVec3::X, DVec3::Y]]);
    for index in 3..6 {
        let value = changed(triangle(), &[("/meshes/0/primitives/0/indices", json!(index))]);
        assert_eq!(corners(&read(&value).unwrap()), want);
    }
    let mut without = triangle();
    without.pointer_mut("/meshes/0/primitives/0").unwrap().as_object_mut().unwrap().remove("indices");
    let found = read(&without).unwrap();
    assert_eq!(corners(&found), want);
    let GeometryDescription::Gltf { mesh, data } = &found.shapes[0].value.geometry else { panic!() };
    assert_eq!(mesh.normals.as_ref().unwrap()[..], [glam::Vec3::Z; 3]);
    assert_eq!(data.uvs[0], [glam::Vec2::Y, glam::Vec2::ONE, glam::Vec2::ZERO]);
}

#[test]
fn sparse_accessors_replace_what_they_name() {
    // Vertex 2 moves to (0, 5, 0); a second accessor has nothing but sparse data, over zeros.
    let mut bytes = buffer();
    let at = bytes.len();
    bytes.extend([2u8, 0, 0, 0]);
    [0f32, 5.0, 0.0].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    let sparse = json!({
        "count": 1,
        "indices": { "bufferView": 2, "componentType": 5121 },
        "values": { "bufferView": 2, "byteOffset": 4 },
    });
    let value = changed(
        triangle(),
        &[
            ("/buffers/0", json!({ "byteLength": bytes.len(), "uri": uri(&bytes) })),
            (
                "/bufferViews",
                json!([
                    { "buffer": 0, "byteLength": 96, "byteStride": 32 },
                    { "buffer": 0, "byteOffset": 96, "byteLength": at - 96 },
                    { "buffer": 0, "byteOffset": at, "byteLength": 16 },
                ]),
            ),
            ("/accessors/0/sparse", sparse.clone()),
        ],
    );
    assert_eq!(corners(&read(&value).unwrap()), [[DVec3::ZERO, DVec3::X, DVec3::Y * 5.0]]);
    let out_of_range =
        changed(value.clone(), &[("/accessors/0/count", json!(2)), ("/accessors/1/count", json!(2))]);
    assert!(read(&out_of_range).is_err());
    let zeros = changed(
        value,
        &[(
            "/accessors/0",
            json!({
                "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [0, 5, 0], "sparse": sparse
            }),
        )],
    );
    // Two corners at the origin: no triangle is left, which is told.
    let found = read(&zeros).unwrap();
    assert!(corners(&found).is_empty() && !found.warnings.is_empty());
}

#[test]
fn nodes_place_meshes_and_share_them() {
    let value = changed(
        triangle(),
        &[
            (
                "/nodes",
                json!([
                    { "children": [1, 2], "translation": [10, 0, 0] },
                    { "mesh": 0, "scale": [2, 2, 2] },
                    { "mesh": 0, "rotation": [0, 0, 0.707_106_77, 0.707_106_77] },
                    { "mesh": 0, "scale": [0, 1, 1] },
                ]),
            ),
            ("/scenes/0/nodes", json!([0, 3])),
        ],
    );
    let found = read(&value).unwrap();
    // One mesh, one group, two places; the flat one is told.
    assert_eq!((found.groups.len(), found.instances.len()), (1, 2));
    let place = |i: usize| found.instances[i].value.transform.transform_point3(DVec3::X);
    assert!((place(0) - DVec3::new(12.0, 0.0, 0.0)).length() < 1e-6);
    assert!((place(1) - DVec3::new(10.0, 1.0, 0.0)).length() < 1e-6);
    assert!(found.warnings.iter().any(|warning| warning.message.contains("flat")));
    let device = Arc::new(Device::new(1).unwrap());
    let built = build_scene(&found, &device, (32, 32)).unwrap();
    assert_eq!(built.scene.nodes().len(), 2 + 2); // with lamp and ground
}

#[test]
fn cycles_and_shared_children_are_refused() {
    for nodes in [
        json!([{ "children": [0] }]),
        json!([{ "children": [1] }, { "children": [0] }]),
        json!([{ "children": [2] }, { "children": [2] }, {}]),
    ] {
        let error = read(&changed(triangle(), &[("/nodes", nodes)])).unwrap_err();
        assert!(error.object.starts_with("nodes["), "{error}");
    }
}

#[test]
fn materials_keep_their_factors_and_units() {
    let value = changed(
        triangle(),
        &[(
            "/materials/0",
            json!({
                "name": "amber",
                "pbrMetallicRoughness": { "baseColorFactor": [0.5, 0.25, 1, 0.5], "metallicFactor": 0.25, "roughnessFactor": 0.5 },
                "emissiveFactor": [1, 0.5, 0],
                "alphaMode": "MASK",
                "extensions": {
                    "KHR_materials_emissive_strength": { "emissiveStrength": 683 },
                    "KHR_materials_clearcoat": { "clearcoatFactor": 0.75, "clearcoatRoughnessFactor": 0.5 },
                    "KHR_materials_anisotropy": { "anisotropyStrength": 0.5, "anisotropyRotation": 1 },
                    "KHR_materials_transmission": { "transmissionFactor": 1 },
                    "KHR_materials_volume": {
                        "thicknessFactor": 0.1, "attenuationDistance": 2, "attenuationColor": [1, 0.5, 0]
                    },
                    "KHR_materials_ior": { "ior": 1.75 },
                },
            }),
        )],
    );
    let found = read(&value).unwrap();
    let amber = material(&found, 0);
    assert_eq!((amber.factors.base, amber.alpha), (glam::Vec3::new(0.5, 0.25, 1.0), 0.5));
    assert_eq!((amber.factors.metallic, amber.roughness, amber.factors.coat), (0.25, 0.5, 0.75));
    assert_eq!((amber.coat_roughness, amber.anisotropy, amber.factors.ior), (0.5, [0.5, 1.0], 1.75));
    assert!(matches!(amber.factors.body, Body::Interface(_)));
    let medium = &found.media[1].value;
    let [none, half, _] = (medium.absorption * -2.0).exp().to_array();
    assert!((none - 1.0).abs() < 1e-12 && (half - 0.5).abs() < 1e-12 && medium.ior == 1.75);
    let radiance = found.shapes[0].value.emission.unwrap().radiance;
    assert!((radiance - DVec3::new(1.0, 0.5, 0.0)).length() < 1e-9, "{radiance}");
    // Without a thickness the wall is thin, and there is no medium.
    let mut thin = value.clone();
    thin.pointer_mut("/materials/0/extensions")
        .unwrap()
        .as_object_mut()
        .unwrap()
        .remove("KHR_materials_volume");
    let found = read(&thin).unwrap();
    assert_eq!((material(&found, 0).factors.body, found.media.len()), (Body::Thin, 1));
    let wrong = changed(value, &[("/materials/0/extensions/KHR_materials_ior/ior", json!("glass"))]);
    assert!(read(&wrong).is_err());
}

#[test]
fn cameras_lights_and_what_is_missing() {
    let bare = read(&triangle()).unwrap();
    let names: Vec<_> = bare.shapes.iter().map(|shape| shape.name.as_str()).collect();
    assert_eq!(names, ["meshes[0], primitive 0", "studio lamp", "ground"]);
    assert!(bare.camera.is_some() && bare.lights.len() == 1);
    let value = changed(
        triangle(),
        &[
            (
                "/nodes",
                json!([
                    { "mesh": 0 },
                    { "camera": 0, "translation": [0, 0, 5] },
                    { "translation": [0, 3, 0], "extensions": { "KHR_lights_punctual": { "light": 0 } } },
                    { "extensions": { "KHR_lights_punctual": { "light": 1 } } },
                ]),
            ),
            ("/scenes/0/nodes", json!([0, 1, 2, 3])),
            (
                "/cameras",
                json!([{ "type": "perspective", "perspective": { "yfov": 0.5, "znear": 0.1, "aspectRatio": 2 } }]),
            ),
            (
                "/extensions",
                json!({ "KHR_lights_punctual": { "lights": [
                { "type": "point", "intensity": 683 },
                { "type": "directional", "intensity": 1366, "color": [1, 0.5, 0] },
            ] } }),
            ),
        ],
    );
    let found = read(&value).unwrap();
    let camera = found.camera.as_ref().unwrap();
    assert!((camera.eye - DVec3::Z * 5.0).length() < 1e-6 && (camera.at - DVec3::Z * 4.0).length() < 1e-6);
    assert!((camera.fov.to_radians() - 0.5).abs() < 1e-6 && found.film.height == 320);
    match &found.lights[0].value {
        LightDescription::Point { position, intensity } => {
            assert!(
                (*position - DVec3::Y * 3.0).length() < 1e-6 && (*intensity - DVec3::ONE).length() < 1e-9
            );
        }
        other => panic!("{other:?}"),
    }
    match &found.lights[1].value {
        LightDescription::Directional { direction, irradiance } => {
            assert!((*direction - DVec3::NEG_Z).length() < 1e-9);
            assert!((*irradiance - DVec3::new(2.0, 1.0, 0.0)).length() < 1e-9);
        }
        other => panic!("{other:?}"),
    }
    assert_eq!(found.lights.len(), 2);
    assert!(
        !read_with(&value, &[("ground", "no")]).unwrap().shapes.iter().any(|shape| shape.name == "ground")
    );
    assert!(read_with(&value, &[("grund", "no")]).unwrap_err().to_string().contains("ground"));
    assert!(read_with(&value, &[("camera", "7")]).is_err());
    assert!(read_with(&value, &[("variant", "red")]).is_err());
}

/// What a test needs to know of a picture: whether the scene can be built, and is, or the reason in words.
fn read_and_build(path: &Path) -> Result<(), String> {
    let description = gltf_scene(path, &[]).map_err(|error| error.to_string())?;
    let device = Arc::new(Device::new(1).unwrap());
    build_scene(&description, &device, (16, 16)).map(drop).map_err(|error| error.to_string())
}

/// The collections of malformed files of other readers, where they lie beside the checkout.
#[test]
fn malformed_collections_are_read_or_told() {
    /// Which other readers refuse for what is not read here: bounds of accessors, and accessors that nothing uses.
    const TOLERATED: [&str; 7] = [
        "invalid_elements_float",
        "out_of_range_elements_float",
        "out_of_range_elements_sint16",
        "out_of_range_elements_sint8",
        "out_of_range_elements_uint16",
        "out_of_range_elements_uint32",
        "out_of_range_elements_uint8",
    ];
    let checkout = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut folders = checkout.ancestors().map(|folder| folder.join("shared/assets/malformed"));
    let Some(folder) = folders.find(|folder| folder.is_dir()) else {
        println!("skipped: no folder shared/assets/malformed beside the checkout");
        return;
    };
    let mut seen = 0;
    for part in
        ["gltf-validator/glb", "gltf-validator/json", "gltf-validator/accessor_data", "magnum-gltf", "assimp"]
    {
        let mut paths: Vec<_> =
            fs::read_dir(folder.join(part)).unwrap().map(|entry| entry.unwrap().path()).collect();
        paths.sort();
        for path in paths.into_iter().filter(|path| is_gltf_file(path)) {
            seen += 1;
            let loaded = gltf_scene(&path, &[]);
            let built = read_and_build(&path);
            let name = path.file_stem().unwrap().to_string_lossy().into_owned();
            println!("{part}/{name}: {built:?}");
            if let Err(message) = &built {
                assert!(message.contains(&*path.to_string_lossy()) && message.len() < 1000, "{message}");
                assert!(!message.chars().any(char::is_control), "{message}");
            }
            let verdict = fs::read_to_string(format!("{}.report.json", path.display())).ok();
            let Some(verdict) = verdict.and_then(|text| serde_json::from_str::<Value>(&text).ok()) else {
                continue;
            };
            let errors = verdict.pointer("/issues/numErrors").and_then(Value::as_u64).unwrap();
            if !TOLERATED.contains(&name.as_str()) {
                assert_eq!(errors > 0, loaded.is_err(), "{part}/{name}: {errors} errors, {:?}", loaded.err());
            }
        }
    }
    assert!(seen > 60, "{seen}");
}

/// Bytes changed at random, and files cut anywhere: read or told, never worse.
#[test]
fn damaged_files_are_read_or_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.gltf");
    let whole = triangle().to_string().into_bytes();
    let mut state = 1;
    for round in 0..1500 {
        let mut bytes = whole.clone();
        for _ in 0..1 + round % 4 {
            state = crate::sampling::mix(state);
            let at = state as usize % bytes.len();
            // Mostly digits, so that the file stays JSON.
            bytes[at] = if state >> 60 < 12 { b'0' + (state >> 40) as u8 % 10 } else { (state >> 40) as u8 };
        }
        if round % 10 == 0 {
            bytes.truncate(state as usize % whole.len());
        }
        fs::write(&path, &bytes).unwrap();
        let _ = gltf_scene(&path, &[]);
    }
}

#[test]
fn counts_that_lie_take_no_memory() {
    let huge = json!(9_007_199_254_740_000u64);
    for pointer in [
        "/accessors/0/count",
        "/accessors/5/count",
        "/accessors/0/byteOffset",
        "/bufferViews/0/byteLength",
        "/bufferViews/0/byteOffset",
        "/buffers/0/byteLength",
    ] {
        assert!(read(&changed(triangle(), &[(pointer, huge.clone())])).is_err(), "{pointer}");
    }
    let mut zeros = changed(triangle(), &[("/accessors/0/count", huge)]);
    zeros.pointer_mut("/accessors/0").unwrap().as_object_mut().unwrap().remove("bufferView");
    assert!(read(&zeros).unwrap_err().to_string().contains("without data"));
}
