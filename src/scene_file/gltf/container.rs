//! From bytes to a checked document: the chunks of GLB, the JSON, the extensions it asks for.

use super::error::{Failure, fail};
use gltf::json;
use gltf::json::validation::{Error, Validate};
use serde_json::Value;

/// Extensions that are understood.
const KNOWN: &[&str] = &[
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "EXT_texture_webp",
];

/// Bytes of a GLB before its chunks.
const HEADER: usize = 12;

/// The parts of a file.
#[derive(Debug)]
pub(super) struct Container<'a> {
    pub json: &'a [u8],
    pub binary: Option<&'a [u8]>,
    pub warnings: Vec<String>,
}

fn number(bytes: &[u8], at: usize) -> Option<u32> {
    let four = bytes.get(at..at.checked_add(4)?)?;
    four.try_into().ok().map(u32::from_le_bytes)
}

/// Splits a GLB into its chunks; what does not begin like one is JSON.
pub(super) fn split(bytes: &[u8]) -> Result<Container<'_>, Failure> {
    let mut warnings = Vec::new();
    if bytes.is_empty() {
        return fail("", "the file is empty; write it again");
    }
    if !bytes.starts_with(b"glTF") {
        return Ok(Container { json: bytes, binary: None, warnings });
    }
    let (Some(version), Some(length)) = (number(bytes, 4), number(bytes, 8)) else {
        return fail(
            "the header",
            format!("{} bytes, and a GLB begins with {HEADER}; the file is cut off", bytes.len()),
        );
    };
    if version != 2 {
        return fail("the header", format!("version {version} of GLB; export the file as glTF 2.0"));
    }
    let length = length as usize;
    if length < HEADER || length > bytes.len() {
        let problem =
            format!("it declares {length} bytes, and the file has {}; it is cut off or damaged", bytes.len());
        return fail("the header", problem);
    }
    if bytes.len() > length {
        warnings.push(format!("{} bytes after the end of the GLB ignored", bytes.len() - length));
    }
    let bytes = &bytes[..length];
    let (mut at, mut index) = (HEADER, 0);
    let (mut json, mut binary) = (None, None);
    while at < bytes.len() {
        let object = format!("chunk {index}");
        let (Some(size), Some(kind)) = (number(bytes, at), number(bytes, at + 4)) else {
            return fail(object, "its header is cut off; write the file again");
        };
        at += 8;
        let Some(content) = bytes.get(at..at.saturating_add(size as usize)) else {
            let problem =
                format!("it declares {size} bytes, and {} follow; the file is damaged", bytes.len() - at);
            return fail(object, problem);
        };
        match (&kind.to_le_bytes(), index) {
            (b"JSON", 0) => json = Some(content),
            (_, 0) => {
                return fail(object, "the first chunk must be JSON; the file is no glTF, or is damaged");
            }
            (b"BIN\0", 1) => binary = Some(content),
            (b"JSON" | b"BIN\0", _) => {
                return fail(
                    object,
                    "a second JSON or binary chunk, or one out of its place; write the file again",
                );
            }
            _ => warnings.push(format!("chunk {index} is of an unknown kind and was skipped")),
        }
        if size % 4 != 0 {
            return fail(object, format!("{size} bytes, which is no multiple of 4; write the file again"));
        }
        at += size as usize;
        index += 1;
    }
    match json {
        Some(json) => Ok(Container { json, binary, warnings }),
        None => fail("the header", "there is no JSON chunk; the file is cut off"),
    }
}

/// Parses and checks the JSON, up to where every index in it leads to something.
pub(super) fn parse(text: &[u8], warnings: &mut Vec<String>) -> Result<(gltf::Document, Value), Failure> {
    if text.starts_with(&[0xef, 0xbb, 0xbf]) {
        return fail("the JSON", "it begins with a byte order mark, which glTF forbids; save it without one");
    }
    let value = serde_json::from_slice::<Value>(text);
    let mut value = value.or_else(|error| {
        fail("the JSON", format!("{error}; the file is damaged, or no glTF: write it again"))
    })?;
    check_extensions(&value, warnings)?;
    whole_numbers(&mut value);
    check_accessor_indices(&value)?;
    use_webp(&mut value);
    let root = serde_path_to_error::deserialize::<_, json::Root>(&value);
    let root = root.or_else(|error| {
        let path = error.path().to_string();
        let path = if path == "." { "the JSON".to_owned() } else { path };
        fail(path, format!("{}; the file is no valid glTF, write it again", error.into_inner()))
    })?;
    if root.asset.version.split('.').next() != Some("2") {
        let version = super::shown(&root.asset.version);
        return fail("asset.version", format!("glTF {version}, and 2.0 is read; export it anew"));
    }
    let mut errors = Vec::new();
    root.validate(&root, json::Path::new, &mut |path, error| errors.push((path(), error)));
    for (path, error) in errors {
        let path = path.as_str();
        // Bounds are not used, accessors without data are zero, textures may come from extensions, and meshes without
        // positions are told where they are used. Extensions were checked before.
        let last = path.rsplit(['.', '[']).next().unwrap_or_default();
        let is_harmless = matches!(last, "min" | "max" | "bufferView" | "source" | "\"POSITION\"]")
            && error == Error::Missing
            || matches!(last, "min" | "max") && path.starts_with("meshes")
            || error == Error::Unsupported;
        if !is_harmless {
            let what = match error {
                Error::IndexOutOfBounds => "an index that leads to nothing",
                Error::Invalid => "a value that glTF does not allow",
                Error::Missing => "missing, and glTF requires it",
                Error::Oversize => "too large for this machine",
                Error::Unsupported => "not supported",
            };
            return fail(path, format!("{what}; the file is damaged, write it again"));
        }
    }
    Ok((gltf::Document::from_json_without_validation(root), value))
}

/// Names in a list of the root.
fn names<'a>(value: &'a Value, key: &str) -> impl Iterator<Item = &'a str> {
    value.get(key).and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str)
}

fn check_extensions(value: &Value, warnings: &mut Vec<String>) -> Result<(), Failure> {
    for name in names(value, "extensionsRequired") {
        let remedy = match name {
            "KHR_draco_mesh_compression" | "EXT_meshopt_compression" | "KHR_meshopt_compression" => {
                "its meshes are compressed in a way that cannot be read; export them uncompressed (`gltf-transform copy` \
                 takes compression off)"
            }
            "KHR_texture_basisu" => "its pictures are in KTX 2; export them as PNG or JPEG",
            _ => "the file says that it cannot be shown without it; export it without",
        };
        if !KNOWN.contains(&name) {
            let name = super::shown(name);
            return fail(format!("extensionsRequired `{name}`"), format!("not supported: {remedy}"));
        }
    }
    let mut unknown: Vec<_> =
        names(value, "extensionsUsed").filter(|name| !KNOWN.contains(name)).map(super::shown).collect();
    unknown.dedup();
    if !unknown.is_empty() {
        warnings.push(format!("extensions that are not modelled and were left out: {}", unknown.join(", ")));
    }
    Ok(())
}

/// JSON does not tell 1.0 from 1, and the reader of the document does: whole numbers become integers where they are written
/// with a fraction.
fn whole_numbers(value: &mut Value) {
    match value {
        Value::Number(number) => {
            let whole =
                number.as_f64().filter(|x| x.fract() == 0.0 && (0.0..9e15).contains(x) && number.is_f64());
            if let Some(whole) = whole {
                *value = Value::from(whole as u64);
            }
        }
        Value::Array(items) => items.iter_mut().for_each(whole_numbers),
        Value::Object(items) => items.values_mut().for_each(whole_numbers),
        _ => {}
    }
}

/// Indices that are followed while the document is checked, and so have to be checked before.
fn check_accessor_indices(value: &Value) -> Result<(), Failure> {
    let list = |key: &str| value.get(key).and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let count = list("accessors").len() as u64;
    for (m, mesh) in list("meshes").iter().enumerate() {
        let primitives = mesh.get("primitives").and_then(Value::as_array);
        for (p, primitive) in primitives.into_iter().flatten().enumerate() {
            let attributes = primitive.get("attributes").and_then(Value::as_object);
            let attributes = attributes.into_iter().flatten().map(|(name, index)| (name.as_str(), index));
            let indices = primitive.get("indices").map(|index| ("indices", index));
            for (name, index) in attributes.chain(indices) {
                if index.as_u64().is_some_and(|index| index >= count) {
                    let object = format!("meshes[{m}].primitives[{p}], {}", super::shown(name));
                    return fail(
                        object,
                        format!("accessor {index}, and there are {count}; write the file again"),
                    );
                }
            }
        }
    }
    Ok(())
}

/// The pictures of EXT_texture_webp in the place of others.
fn use_webp(value: &mut Value) {
    let textures = value.get_mut("textures").and_then(Value::as_array_mut);
    for texture in textures.into_iter().flatten() {
        let source = texture.pointer("/extensions/EXT_texture_webp/source").cloned();
        if let (Some(source), Some(texture)) = (source, texture.as_object_mut()) {
            texture.insert("source".to_owned(), source);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn glb(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
        let body: Vec<u8> = chunks
            .iter()
            .flat_map(|(kind, content)| {
                let length = (content.len() as u32).to_le_bytes();
                [&length[..], &kind[..], content].concat()
            })
            .collect();
        let length = (HEADER + body.len()) as u32;
        [b"glTF".to_vec(), 2u32.to_le_bytes().to_vec(), length.to_le_bytes().to_vec(), body].concat()
    }

    const MINIMAL: &[u8] = br#"{"asset":{"version":"2.0"}} "#;

    #[test]
    fn glb_is_split_and_every_cut_is_told() {
        let whole = glb(&[(b"JSON", MINIMAL), (b"BIN\0", &[1, 2, 3, 4])]);
        let parts = split(&whole).unwrap();
        assert_eq!((parts.json, parts.binary), (MINIMAL, Some(&[1u8, 2, 3, 4][..])));
        assert!(parse(parts.json, &mut Vec::new()).is_ok());
        for end in 1..whole.len() {
            // As JSON, where not even the magic is whole.
            let cut = split(&whole[..end]).and_then(|parts| parse(parts.json, &mut Vec::new()).map(drop));
            assert!(cut.is_err(), "{end}");
        }
        let more = [whole, vec![0; 7]].concat();
        assert_eq!(split(&more).unwrap().warnings.len(), 1);
    }

    #[test]
    fn chunks_out_of_order_are_refused() {
        for chunks in [
            &[(b"BIN\0", &[0u8; 4][..]), (b"JSON", MINIMAL)][..],
            &[(b"JSON", MINIMAL), (b"JSON", MINIMAL)],
            &[(b"JSON", MINIMAL), (b"BIN\0", &[0; 4]), (b"BIN\0", &[0; 4])],
            &[(b"JSON", &MINIMAL[..27])],
        ] {
            assert!(split(&glb(chunks)).is_err(), "{chunks:?}");
        }
        assert_eq!(split(&glb(&[(b"JSON", MINIMAL), (b"LATE", &[0; 8])])).unwrap().warnings.len(), 1);
    }

    #[test]
    fn required_extensions_are_refused_by_name() {
        let text = br#"{"asset":{"version":"2.0"},"extensionsRequired":["KHR_draco_mesh_compression"]}"#;
        let (object, problem) = parse(text, &mut Vec::new()).unwrap_err();
        assert!(
            object.contains("KHR_draco_mesh_compression") && problem.to_string().contains("uncompressed")
        );
        let mut warnings = Vec::new();
        let text =
            br#"{"asset":{"version":"2.0"},"extensionsUsed":["KHR_materials_sheen","KHR_materials_ior"]}"#;
        parse(text, &mut warnings).unwrap();
        assert!(warnings.len() == 1 && warnings[0].contains("sheen") && !warnings[0].contains("ior"));
    }

    #[test]
    fn errors_name_the_place() {
        for (text, place) in [
            (r#"{"asset":{"version":"1.0"}}"#, "asset.version"),
            (r#"{"asset":{"version":2}}"#, "asset.version"),
            (r#"{"asset":{"version":"2.0"},"nodes":[{"mesh":3}]}"#, "nodes[0].mesh"),
            (
                r#"{"asset":{"version":"2.0"},"meshes":[{"primitives":[{"attributes":{"POSITION":9}}]}]}"#,
                "meshes[0].primitives[0], POSITION",
            ),
            (r#"{"asset":{"version":"2.0"},"accessors":{}}"#, "accessors"),
            ("[]", ""),
            ("{", "the JSON"),
        ] {
            let (object, _) = parse(text.as_bytes(), &mut Vec::new()).unwrap_err();
            assert!(object.contains(place), "{text}: {object}");
        }
    }
}
