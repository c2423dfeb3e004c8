//! Tests of the glTF importer, with files written here and with collections of unusual files.

use super::*;
use crate::bsdf::Body;
use crate::embree::Device;
use crate::scene::LayeredMaterial;
use crate::scene_file::{LightDescription, MaterialDescription, build_scene};
use base64::Engine;
use serde_json::json;
use std::fs;

/// A right triangle in the plane z = 0, with interleaved attributes in one buffer, 32 bytes for each vertex: position, normal,
/// uv. Then follow the indices 0 1 2 as bytes, shorts and integers.
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

/// A file with that triangle in a white dielectric, with indices of four bytes.
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

/// The value with replacements at some paths.
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

/// Corners of the triangles of all shapes, in the coordinates of the file.
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
    // Vertex 2 moves to (0, 5, 0). A second accessor has only sparse data over zeros.
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
    // Two corners are at the origin, so no triangle is left, and a warning says so.
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
    // One mesh becomes one group with two instances; a warning counts the flat one.
    assert_eq!((found.groups.len(), found.instances.len()), (1, 2));
    let place = |i: usize| found.instances[i].value.transform.transform_point3(DVec3::X);
    assert!((place(0) - DVec3::new(12.0, 0.0, 0.0)).length() < 1e-6);
    assert!((place(1) - DVec3::new(10.0, 1.0, 0.0)).length() < 1e-6);
    assert!(found.warnings.iter().any(|warning| warning.message.contains("flat")));
    let device = Arc::new(Device::new(1).unwrap());
    let built = build_scene(&found, &device, (32, 32)).unwrap();
    assert_eq!(built.scene.nodes().len(), 2 + 2); // with lamp and ground
}

/// The text of all warnings.
fn warnings(description: &SceneDescription) -> String {
    description.warnings.iter().map(|warning| warning.message.as_str()).collect::<Vec<_>>().join("\n")
}

/// A file with every supported feature and no errors by the Khronos validator. The fuzzers start from it as well.
fn rich() -> Value {
    serde_json::from_str(include_str!("../../../fuzz/rich.gltf")).unwrap()
}

#[test]
fn a_file_with_every_feature_is_read() {
    let found = read(&rich()).unwrap();
    let said = warnings(&found);
    assert!(said.contains("animations"), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    assert_eq!((found.lights.len(), found.groups.len(), found.instances.len()), (2, 1, 2));
}

/// Removes and replaces every value of the file: it is either read or refused, and never panics.
#[test]
fn every_key_may_be_missing_or_of_another_type() {
    fn pointers(value: &Value, at: &str, found: &mut Vec<String>) {
        let children: Vec<(String, &Value)> = match value {
            Value::Object(items) => items.iter().map(|(key, value)| (key.clone(), value)).collect(),
            Value::Array(items) => items.iter().enumerate().map(|(i, item)| (i.to_string(), item)).collect(),
            _ => Vec::new(),
        };
        for (key, child) in children {
            let pointer = format!("{at}/{key}");
            pointers(child, &pointer, found);
            found.push(pointer);
        }
    }
    let whole = rich();
    let mut places = Vec::new();
    pointers(&whole, "", &mut places);
    assert!(places.len() > 500);
    let others = [json!(null), json!("a"), json!([]), json!({}), json!(-1), json!(0.5), json!(1)];
    let path = Path::new("a.gltf");
    let (mut refused, mut tried) = (0, 0);
    for (number, pointer) in places.iter().enumerate() {
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        let mut without = whole.clone();
        match without.pointer_mut(parent).unwrap() {
            Value::Object(items) => drop(items.remove(key)),
            Value::Array(items) => drop(items.remove(key.parse().unwrap())),
            _ => unreachable!(),
        }
        // The driver (`examples/mutate.rs`) tries all others; here each place gets one of them in turn.
        let with = changed(whole.clone(), &[(pointer, others[number % others.len()].clone())]);
        for value in [without, with] {
            tried += 1;
            refused += usize::from(parse_gltf_bytes(value.to_string().as_bytes(), path).is_err());
        }
    }
    assert!(refused > tried / 4 && refused < tried, "{refused} of {tried}");
}

#[test]
fn pictures_are_known_by_their_first_bytes() {
    let mut value = rich();
    value["images"][0].as_object_mut().unwrap().remove("mimeType");
    let said = warnings(&read(&value).unwrap());
    assert!(said.contains("images[0] lacks its `mimeType`"), "{said}");
    value["images"][0]["mimeType"] = json!("image/jpeg");
    let said = warnings(&read(&value).unwrap());
    assert!(said.contains("said to be image/jpeg, and is image/png"), "{said}");
    value["images"][0] = json!({ "name": "lost" });
    let error = read(&value).unwrap_err().to_string();
    assert!(error.contains("images[0] `lost`: it has neither"), "{error}");
}

#[test]
fn pictures_without_coordinates_are_told() {
    let mut value = rich();
    value["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("TEXCOORD_0");
    let said = warnings(&read(&value).unwrap());
    assert!(
        said.contains("meshes[0], primitive 0: its material has pictures on texture coordinates 0"),
        "{said}"
    );
}

#[test]
fn a_camera_must_have_the_projection_that_it_names() {
    let mut value = rich();
    value["cameras"][0] =
        json!({ "type": "perspective", "orthographic": value["cameras"][1]["orthographic"] });
    let error = read(&value).unwrap_err().to_string();
    assert!(error.contains("cameras[0]: it lacks the projection"), "{error}");
}

/// Files that the Khronos validator accepts.
#[test]
fn valid_files_are_read() {
    for extras in [json!(42), json!("a"), json!([1]), json!(null), json!({ "a": 1 })] {
        let value = changed(triangle(), &[("/nodes/0/extras", extras.clone()), ("/asset/extras", extras)]);
        assert_eq!(warnings(&read(&value).unwrap()), "");
    }
    let scenes = json!([{ "nodes": [0] }, { "name": "empty" }]);
    let value = changed(triangle(), &[("/scenes", scenes)]);
    assert_eq!(warnings(&read(&value).unwrap()), "");
    assert!(read_with(&value, &[("scene", "empty")]).unwrap().shapes.is_empty());
    let pointer = json!({ "sampler": 0, "target": { "path": "pointer", "extensions": {
        "KHR_animation_pointer": { "pointer": "/nodes/0/translation" } } } });
    let animation = json!([{ "channels": [pointer], "samplers": [{ "input": 0, "output": 0 }] }]);
    let used = json!(["KHR_animation_pointer"]);
    let value = changed(
        triangle(),
        &[("/animations", animation), ("/extensionsUsed", used.clone()), ("/extensionsRequired", used)],
    );
    let said = warnings(&read(&value).unwrap());
    assert!(said.contains("animations not played") && !said.contains('\n'), "{said}");
}

/// Files that the Khronos validator calls wrong and that have no meaning to show.
#[test]
fn invalid_files_are_refused_by_place() {
    let light = |light: Value| json!({ "KHR_lights_punctual": { "lights": [light] } });
    let material = |name: &str, value: Value| json!([{ "extensions": { name: value } }]);
    for (pointer, value, place) in [
        ("/asset/minVersion", json!("2.5"), "asset.minVersion"),
        ("/asset/version", json!("3.0"), "asset.version"),
        ("/accessors/0/type", json!("VEC2"), "POSITION"),
        ("/accessors/1/type", json!("VEC2"), "NORMAL"),
        ("/accessors/2/type", json!("VEC3"), "accessors[2]"),
        ("/accessors/0/componentType", json!(5125), "POSITION"),
        ("/accessors/2/count", json!(2), "elements"),
        ("/accessors/0/count", json!(0), "accessors[0].count"),
        ("/bufferViews/0/byteLength", json!(4000), "bufferViews[0]"),
        ("/bufferViews/0/byteStride", json!(30), "bufferViews[0].byteStride"),
        ("/meshes/0/primitives/0/mode", json!(9), "meshes[0].primitives[0].mode"),
        ("/meshes/0/weights", json!([1]), "weights for 0 morph targets"),
        ("/nodes/0/translation", json!([1, 2]), "nodes[0].translation"),
        ("/nodes/0/mesh", json!(7), "nodes[0].mesh"),
        (
            "/nodes/0/matrix",
            json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0, 0, 1]),
            "nodes[0] `corner`: the last row",
        ),
        (
            "/nodes/0",
            json!({ "mesh": 0, "scale": [1, 1, 1], "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1] }),
            "only one of both",
        ),
        ("/scene", json!(1), "scene"),
        ("/extensions", light(json!({ "type": "point", "intensity": -1 })), "lights[0].intensity"),
        ("/extensions", light(json!({ "type": "point", "color": [1, -1, 1] })), "lights[0].color[1]"),
        ("/extensions", light(json!({ "type": "lamp" })), "lights[0].type"),
        ("/extensions", light(json!({ "type": "spot" })), "spot"),
        ("/materials", material("KHR_materials_ior", json!({ "ior": 0.5 })), "at least 1 or 0"),
        ("/materials", material("KHR_materials_volume", json!({ "attenuationDistance": 0 })), "above 0"),
        ("/materials", material("KHR_materials_volume", json!({ "thicknessFactor": -1 })), "thicknessFactor"),
        (
            "/materials",
            material("KHR_materials_emissive_strength", json!({ "emissiveStrength": -1 })),
            "emissiveStrength",
        ),
        ("/materials/0/alphaCutoff", json!(-0.1), "materials[0].alphaCutoff"),
        ("/materials/0/emissiveFactor", json!([1, 1]), "materials[0].emissiveFactor"),
        ("/materials/0/normalTexture", json!({ "index": 3 }), "materials[0].normalTexture.index"),
        (
            "/cameras",
            json!([{ "type": "perspective", "perspective": { "yfov": -1, "znear": 1 } }]),
            "cameras[0].perspective.yfov",
        ),
    ] {
        let error = read(&changed(triangle(), &[(pointer, value)])).unwrap_err().to_string();
        assert!(error.contains(place), "{pointer}: no `{place}` in {error}");
    }
}

/// Files that the validator calls wrong as well, but that can mean only one thing.
#[test]
fn invalid_files_with_a_plain_meaning_are_shown_with_a_warning() {
    let pbr = |key: &str, value: Value| json!([{ "pbrMetallicRoughness": { key: value } }]);
    for (pointer, value, part) in [
        ("/asset/version", json!("2.1"), "asset.version"),
        ("/nodes/0/rotation", json!([0, 0, 0, 0]), "rotation is zero"),
        ("/nodes/0/rotation", json!([0, 0, 0.5, 0.5]), "normalized"),
        ("/nodes/0/matrix", json!([1, 0, 0, 0, 0.5, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]), "matrix shears"),
        ("/nodes/0/children", json!([]), "empty lists"),
        ("/nodes/0/weights", json!([]), "empty lists"),
        ("/scenes/0/nodes", json!([0, 0]), "scenes[0].nodes names 0 more than once"),
        ("/materials", pbr("metallicFactor", json!(1.5)), "metallicFactor is 1.5"),
        ("/materials", pbr("roughnessFactor", json!(-1)), "it counts as 0"),
        ("/materials/0/emissiveFactor", json!([2, 1, 1]), "used as it is"),
        ("/materials/0/alphaMode", json!("GLASS"), "the default is used"),
        ("/materials/0/metalness", json!(1), "properties that glTF does not have were ignored: metalness"),
        ("/materials/0/extensions", json!({ "KHR_materials_ior": { "ior": 1.4 } }), "without being declared"),
        ("/materials/0/extensions", json!({ "EXT_other": {} }), "not modelled and were left out: EXT_other"),
        ("/extensionsUsed", json!(["EXT_other"]), "not modelled and were left out: EXT_other"),
        ("/samplers", json!([{ "wrapS": 1 }]), "samplers[0].wrapS"),
        ("/accessors/0/normalized", json!(true), "normalized"),
        ("/accessors/2/byteOffset", json!(23), "multiple"),
    ] {
        let found = read(&changed(triangle(), &[(pointer, value)])).unwrap();
        let said = warnings(&found);
        assert!(said.contains(part), "{pointer}: no `{part}` in {said}");
        assert_eq!(corners(&found).len(), 1, "{pointer}");
    }
}

/// A node that the scene lists and that has a parent is shown once, where its parent places it.
#[test]
fn nodes_below_others_are_shown_once() {
    let nodes = json!([{ "children": [1], "translation": [10, 0, 0] }, { "mesh": 0 }]);
    let value = changed(triangle(), &[("/nodes", nodes), ("/scenes/0/nodes", json!([0, 1]))]);
    let found = read(&value).unwrap();
    assert_eq!((corners(&found).len(), found.instances.len()), (1, 0));
    assert_eq!(found.shapes[0].value.transform.translation, DVec3::X * 10.0);
    assert!(warnings(&found).contains("shown once"));
    let alone = read(&changed(value, &[("/scenes/0/nodes", json!([1]))])).unwrap();
    assert_eq!(alone.shapes[0].value.transform.translation, DVec3::ZERO);
    assert!(warnings(&alone).contains("without its parent's place"));
}

#[test]
fn files_outside_of_the_folder_need_leave() {
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("model");
    fs::create_dir_all(inner.join("parts")).unwrap();
    let outer = folder.path().join("a b.bin");
    fs::write(&outer, buffer()).unwrap();
    fs::write(inner.join("parts/in.bin"), buffer()).unwrap();
    let path = inner.join("test.gltf");
    let try_uri = |uri: &str, outside: &str| {
        fs::write(&path, changed(triangle(), &[("/buffers/0/uri", json!(uri))]).to_string()).unwrap();
        gltf_scene(&path, &[("outside".to_owned(), outside.to_owned())])
    };
    assert!(try_uri("parts/in.bin", "no").is_ok() && try_uri("parts/../parts/in.bin", "no").is_ok());
    let absolute = outer.display().to_string().replace(' ', "%20");
    for uri in [
        "../a%20b.bin",
        "parts/../../a%20b.bin",
        &absolute,
        &format!("file://{absolute}"),
        "..\\..\\x/../../a b.bin",
    ] {
        let error = try_uri(uri, "no").unwrap_err().to_string();
        assert!(error.contains("outside") || uri.contains('\\'), "{uri}: {error}");
        assert!(try_uri(uri, "yes").is_ok() || uri.contains('\\'), "{uri}: {:?}", try_uri(uri, "yes").err());
    }
    for scheme in ["http", "https", "ftp"] {
        assert!(try_uri(&format!("{scheme}://a.org/in.bin"), "yes").is_err());
    }
    assert!(try_uri("parts/in.bin", "maybe").unwrap_err().to_string().contains("write yes or no"));
}

/// The changes, for [`changed`], that add an accessor over a new buffer with `values`; yields the accessor's number as well.
fn with_floats(mut value: Value, kind: &str, values: &[f32]) -> (Value, usize) {
    let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
    let numbers = match kind {
        "SCALAR" => 1,
        "VEC3" => 3,
        "VEC4" => 4,
        "MAT4" => 16,
        other => panic!("{other}"),
    };
    let mut push = |list: &str, item: Value| {
        let list = value[list].as_array_mut().unwrap();
        list.push(item);
        list.len() - 1
    };
    let buffer = push("buffers", json!({ "byteLength": bytes.len(), "uri": uri(&bytes) }));
    let view = push("bufferViews", json!({ "buffer": buffer, "byteLength": bytes.len() }));
    let count = values.len() / numbers;
    let accessor =
        push("accessors", json!({ "bufferView": view, "componentType": 5126, "count": count, "type": kind }));
    (value, accessor)
}

#[test]
fn every_instance_of_a_node_is_placed() {
    let translations: Vec<f32> =
        (0..125).flat_map(|i| [(i % 5) as f32, (i / 5 % 5) as f32, (i / 25) as f32]).collect();
    let (value, at) = with_floats(triangle(), "VEC3", &translations);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let (value, turned) = with_floats(value, "VEC4", &[0.0, 0.0, half, half].repeat(125));
    let (value, scaled) = with_floats(value, "VEC3", &[2.0; 375]);
    let attributes = json!({ "TRANSLATION": at, "ROTATION": turned, "SCALE": scaled, "_ID": at });
    let value = changed(
        value,
        &[
            ("/nodes/0/extensions", json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } })),
            ("/nodes/0/translation", json!([100, 0, 0])),
            ("/extensionsUsed", json!(["EXT_mesh_gpu_instancing"])),
            ("/extensionsRequired", json!(["EXT_mesh_gpu_instancing"])),
        ],
    );
    let found = read(&value).unwrap();
    assert_eq!((found.groups.len(), found.instances.len(), warnings(&found).as_str()), (1, 125, ""));
    let corner = found.instances[124].value.transform.transform_point3(DVec3::X);
    assert!((corner - DVec3::new(104.0, 6.0, 4.0)).length() < 1e-6, "{corner}");
    let short = changed(value, &[(&format!("/accessors/{turned}/count"), json!(3))]);
    assert!(read(&short).unwrap_err().to_string().contains("of its instances has"));
}

#[test]
fn specular_and_glossiness_are_read() {
    let mut value = triangle();
    value["extensionsUsed"] = json!(["KHR_materials_pbrSpecularGlossiness"]);
    value["materials"] = json!([{ "extensions": { "KHR_materials_pbrSpecularGlossiness": {
        "diffuseFactor": [0.5, 0.25, 0.125, 1], "specularFactor": [0.25, 0.5, 0.75], "glossinessFactor": 0.75
    } } }]);
    let found = read(&value).unwrap();
    let made = material(&found, 0);
    assert_eq!(warnings(&found), "");
    assert_eq!((made.factors.base, made.factors.metallic), (glam::Vec3::new(0.5, 0.25, 0.125), 0.0));
    assert_eq!((made.factors.specular_colour, made.roughness), (glam::Vec3::new(0.25, 0.5, 0.75), 0.25));
    let normal = ((made.factors.ior - 1.0) / (made.factors.ior + 1.0)).powi(2);
    assert!((normal - 1.0).abs() < 1e-6, "what is specular is reflected as it is");
    // With a picture, alpha is glossiness; that of the rich file is 255, 128, 255 and 0.
    let mut rich = rich();
    rich["meshes"][0]["primitives"][0]["material"] = json!(5);
    let found = read(&rich).unwrap();
    let made = material(&found, 0);
    let map = made.metallic_roughness.as_ref().unwrap();
    let mean = 1.0 - 0.7 * (255.0 + 128.0 + 255.0) / (4.0 * 255.0);
    assert!((map.texture.mean().y - mean).abs() < 1e-3 && made.roughness == 1.0, "{}", map.texture.mean());
    assert!(made.specular_colour.is_some());
    // An index of 0 reflects all light, too.
    let ior = json!([{ "extensions": { "KHR_materials_ior": { "ior": 0 } } }]);
    let found = read(&changed(triangle(), &[("/materials", ior)])).unwrap();
    assert!(material(&found, 0).factors.ior > 1e6);
}

#[test]
fn morph_targets_have_the_weights_of_the_file() {
    let (value, up) = with_floats(triangle(), "VEC3", &[0.0, 0.0, 2.0].repeat(3));
    let (value, right) = with_floats(value, "VEC3", &[4.0, 0.0, 0.0].repeat(3));
    let targets = json!([{ "POSITION": up }, { "POSITION": right }]);
    let value = changed(value, &[("/meshes/0/primitives/0/targets", targets)]);
    let first = |value: &Value| {
        let found = read(value).unwrap();
        assert_eq!(warnings(&found), "");
        corners(&found)[0][0]
    };
    assert_eq!(first(&value), DVec3::ZERO);
    let value = changed(value, &[("/meshes/0/weights", json!([0.5, 0]))]);
    assert_eq!(first(&value), DVec3::Z);
    assert_eq!(first(&changed(value.clone(), &[("/nodes/0/weights", json!([0, 0.25]))])), DVec3::X);
    // Nodes with different weights do not share a mesh.
    let nodes = json!([{ "mesh": 0 }, { "mesh": 0, "weights": [1, 0] }, { "mesh": 0 }]);
    let found =
        read(&changed(value.clone(), &[("/nodes", nodes), ("/scenes/0/nodes", json!([0, 1, 2]))])).unwrap();
    assert_eq!((found.shapes.len() - 2, found.groups.len(), found.instances.len()), (2, 1, 2));
    assert!(read(&changed(value, &[("/nodes/0/weights", json!([1]))])).is_err());
}

/// The joints place a skinned mesh; the node's transform is ignored.
#[test]
fn skinned_meshes_stand_as_their_joints_do() {
    let mut inverse = vec![1f32, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    inverse.extend_from_within(..);
    inverse[12] = -1.0; // The first joint was at (1, 0, 0) when the mesh was bound to it.
    let (value, bind) = with_floats(triangle(), "MAT4", &inverse);
    let (value, weights) =
        with_floats(value, "VEC4", &[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0]);
    let joints = json!({ "bufferView": 1, "componentType": 5121, "count": 3, "type": "VEC4" });
    let mut value = value;
    value["accessors"].as_array_mut().unwrap().push(joints);
    let joints = value["accessors"].as_array().unwrap().len() - 1;
    // Joints 0 and 1 of each vertex, in a separate buffer.
    let bytes = [0u8, 1, 0, 0].repeat(3);
    value["buffers"].as_array_mut().unwrap().push(json!({ "byteLength": 12, "uri": uri(&bytes) }));
    let buffer = value["buffers"].as_array().unwrap().len() - 1;
    value["bufferViews"].as_array_mut().unwrap().push(json!({ "buffer": buffer, "byteLength": 12 }));
    value["accessors"][joints]["bufferView"] = json!(value["bufferViews"].as_array().unwrap().len() - 1);
    let attributes = json!({ "POSITION": 0, "NORMAL": 1, "JOINTS_0": joints, "WEIGHTS_0": weights });
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let value = changed(
        value,
        &[
            ("/meshes/0/primitives/0/attributes", attributes),
            ("/skins", json!([{ "joints": [1, 3], "inverseBindMatrices": bind }])),
            (
                "/nodes",
                json!([
                    { "mesh": 0, "skin": 0, "translation": [50, 50, 50], "scale": [9, 9, 9] },
                    { "translation": [1, 0, 5] },
                    { "children": [3], "translation": [0, 10, 0] },
                    { "rotation": [half, 0, 0, half] },
                ]),
            ),
            ("/scenes/0/nodes", json!([0, 1, 2])),
        ],
    );
    let found = read(&value).unwrap();
    assert_eq!(warnings(&found), "");
    assert_eq!(found.shapes[0].value.transform, DAffine3::IDENTITY);
    // The first joint moves by 5 along z; the second moves to y = 10 and rotates y to z.
    let want = [DVec3::new(0.0, 0.0, 5.0), DVec3::new(1.0, 10.0, 0.0), DVec3::new(0.0, 5.5, 3.0)];
    for (corner, want) in corners(&found)[0].into_iter().zip(want) {
        assert!((corner - want).length() < 1e-5, "{corner} {want}");
    }
    let GeometryDescription::Gltf { mesh, .. } = &found.shapes[0].value.geometry else { panic!() };
    let normals = mesh.normals.as_ref().unwrap();
    assert!((normals[0] - glam::Vec3::Z).length() < 1e-5 && (normals[1] + glam::Vec3::Y).length() < 1e-5);
    let off = changed(value.clone(), &[("/skins/0/joints", json!([1]))]);
    assert!(read(&off).unwrap_err().to_string().contains("hangs on joint 1"));
    // A skin on a mesh without joints has no effect, and a warning says so.
    let attributes = json!({ "POSITION": 0, "NORMAL": 1 });
    let found = read(&changed(value, &[("/meshes/0/primitives/0/attributes", attributes)])).unwrap();
    assert!(warnings(&found).contains("its mesh no joints"));
    assert_eq!(found.shapes[0].value.transform.translation, DVec3::splat(50.0));
}

#[test]
fn quantized_positions_are_read() {
    let bytes: Vec<u8> = [[0i16, 0, 0, 0], [32767, 0, 0, 0], [0, -32767, 0, 0]]
        .iter()
        .flatten()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    let mut value = triangle();
    value["buffers"].as_array_mut().unwrap().push(json!({ "byteLength": 24, "uri": uri(&bytes) }));
    value["bufferViews"]
        .as_array_mut()
        .unwrap()
        .push(json!({ "buffer": 1, "byteLength": 24, "byteStride": 8 }));
    for (normalized, want) in [(true, 1.0), (false, 32767.0)] {
        value["accessors"][0] = json!({ "bufferView": 2, "componentType": 5122, "normalized": normalized, "count": 3, "type": "VEC3" });
        let found = read(&value).unwrap();
        assert_eq!(corners(&found), [[DVec3::ZERO, DVec3::X * want, DVec3::NEG_Y * want]]);
        assert!(warnings(&found).contains("KHR_mesh_quantization"));
        let declared = changed(value.clone(), &[("/extensionsUsed", json!(["KHR_mesh_quantization"]))]);
        assert_eq!(warnings(&read(&declared).unwrap()), "");
    }
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
    let radiance = found.shapes[0].value.emission.unwrap().emitted.radiance(1.0);
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
    assert!((camera.perspective().unwrap().0.to_radians() - 0.5).abs() < 1e-6 && found.film.height == 320);
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

/// The result of reading and building a picture's file: success, or the reason of the failure.
fn read_and_build(path: &Path) -> Result<(), String> {
    let description = gltf_scene(path, &[]).map_err(|error| error.to_string())?;
    let device = Arc::new(Device::new(1).unwrap());
    build_scene(&description, &device, (16, 16)).map(drop).map_err(|error| error.to_string())
}

/// The malformed files of other readers' test collections, where they lie beside the checkout.
#[test]
fn malformed_collections_are_read_or_told() {
    /// Files that other readers refuse for content that is not read here: bounds of accessors, and unused accessors.
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

/// Random changes of bytes and files cut at any position: either read or refused, and never a panic.
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
            // Mostly digits, so that the file remains JSON.
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
    zeros["meshes"][0]["primitives"][0]["attributes"] = json!({ "POSITION": 0 });
    assert!(read(&zeros).unwrap_err().to_string().contains("without data"));
}
