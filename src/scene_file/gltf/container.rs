//! Parses the bytes of a file to a checked document: the chunks of a GLB, the JSON, and the required extensions.

use super::check::{self, Report};
use super::error::{Failure, fail};
use super::semantics;
use gltf::json;
use gltf::json::validation::{Error, Validate};
use serde_json::Value;
use std::collections::BTreeSet;
use std::io::{self, Read};
use std::path::Path;

/// Supported extensions.
const KNOWN: &[&str] = &[
    "EXT_mesh_gpu_instancing",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "EXT_texture_webp",
];

/// Extensions that do not change the picture of the file: metadata and animation.
const WITHOUT_LOOK: &[&str] = &["KHR_animation_pointer", "KHR_xmp", "KHR_xmp_json_ld"];

/// Bytes of a GLB before its first chunk.
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

/// The JSON of a file, and the length of the file. Of a GLB only the JSON chunk is read.
pub(super) fn split_head(path: &Path) -> io::Result<(Vec<u8>, u64)> {
    let (mut file, length) = crate::files::open_regular(path)?;
    let mut head = Vec::new();
    Read::by_ref(&mut file).take(HEADER as u64 + 8).read_to_end(&mut head)?;
    let mut text = Vec::new();
    match number(&head, HEADER).filter(|_| head.starts_with(b"glTF")) {
        Some(size) => drop(file.take(size.into()).read_to_end(&mut text)?),
        None => {
            text = head;
            file.read_to_end(&mut text)?;
        }
    }
    Ok((text, length))
}

/// Splits a GLB into its chunks. A file without the magic number of GLB is JSON.
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
            let problem = format!(
                "its header is cut off at byte {length}, where the file ends by its own header; write the file again"
            );
            return fail(object, problem);
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

/// A document in which every index is valid.
#[derive(Debug)]
pub(super) struct Parsed {
    pub document: gltf::Document,
    /// The same JSON as it was read, for what the crate does not represent. Values out of range are repaired in both.
    pub json: Value,
    /// Number of animations.
    pub animations: u64,
}

/// Parses and checks the JSON.
pub(super) fn parse(text: &[u8], warnings: &mut Vec<String>) -> Result<Parsed, Failure> {
    if text.starts_with(&[0xef, 0xbb, 0xbf]) {
        return fail("the JSON", "it begins with a byte order mark, which glTF forbids; save it without one");
    }
    let value = serde_json::from_slice::<Value>(text);
    let mut value = value.or_else(|error| {
        fail("the JSON", format!("{error}; the file is damaged, or no glTF: write it again"))
    })?;
    let mut report = Report::default();
    whole_numbers(&mut value);
    check_version(&value, &mut report)?;
    check_required(&value)?;
    check::check(&mut value, &mut report)?;
    check_used(&value, &mut report);
    let animations = value.get("animations").and_then(Value::as_array).map_or(0, Vec::len) as u64;
    check_transforms(&value)?;
    use_webp(&mut value);
    let document = typed(&mut value)?;
    semantics::check(&document, &value, &mut report)?;
    warnings.extend(report.into_warnings());
    Ok(Parsed { document, json: value, animations })
}

/// The document in the types of the crate `gltf`.
fn typed(value: &mut Value) -> Result<gltf::Document, Failure> {
    if let Value::Object(root) = value {
        // Animations are not applied, and the crate supports less of them than glTF allows.
        root.remove("animations");
        // The crate requires a list that is optional in glTF.
        let scenes = root.get_mut("scenes").and_then(Value::as_array_mut);
        for scene in scenes.into_iter().flatten().filter_map(Value::as_object_mut) {
            scene.entry("nodes").or_insert_with(|| Value::Array(Vec::new()));
        }
    }
    let root = serde_path_to_error::deserialize::<_, json::Root>(&*value);
    let root = root.or_else(|error| {
        let path = error.path().to_string();
        let path = if path == "." { "the JSON".to_owned() } else { path };
        fail(path, format!("{}; the file is no valid glTF, write it again", error.into_inner()))
    })?;
    let mut errors = Vec::new();
    root.validate(&root, json::Path::new, &mut |path, error| errors.push((path(), error)));
    for (path, error) in errors {
        let path = path.as_str();
        // These errors are harmless: bounds are not used, accessors without data are zero, and textures may come from extensions.
        // Meshes without positions are reported where they are used. Extensions were checked before.
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
    Ok(gltf::Document::from_json_without_validation(root))
}

/// Major and minor number of a version.
fn version(text: &str) -> Option<(u32, u32)> {
    let (major, minor) = text.split_once('.')?;
    Some((major.parse().ok()?, minor.parse().ok()?))
}

fn check_version(value: &Value, report: &mut Report) -> Result<(), Failure> {
    let Some(asset) = value.get("asset") else {
        return fail("asset", "missing, and glTF requires it; the file is no glTF, or is damaged");
    };
    let Some(text) = asset.get("version").and_then(Value::as_str) else {
        return fail("asset.version", "missing, or not a text, and glTF requires it; write the file again");
    };
    let shown = super::shown(text);
    if text.split('.').next() != Some("2") {
        return fail("asset.version", format!("glTF {shown}, and 2.0 is read; export it anew"));
    }
    if version(text) != Some((2, 0)) {
        report.warn("version", || {
            format!("asset.version is {shown}, and 2.0 is read; what came later is ignored")
        });
    }
    if let Some(least) = asset.get("minVersion").and_then(Value::as_str)
        && version(least).is_none_or(|least| least > (2, 0))
    {
        let least = super::shown(least);
        return fail(
            "asset.minVersion",
            format!("needs a reader of glTF {least}, and 2.0 is read; export it as 2.0"),
        );
    }
    Ok(())
}

/// Names in a list of the root.
fn names<'a>(value: &'a Value, key: &str) -> impl Iterator<Item = &'a str> {
    value.get(key).and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str)
}

fn check_required(value: &Value) -> Result<(), Failure> {
    for name in names(value, "extensionsRequired") {
        let remedy = match name {
            "KHR_draco_mesh_compression" | "EXT_meshopt_compression" | "KHR_meshopt_compression" => {
                "its meshes are compressed in a way that cannot be read; export them uncompressed (`gltf-transform copy` \
                 takes compression off)"
            }
            "KHR_texture_basisu" => "its pictures are in KTX 2; export them as PNG or JPEG",
            _ => "the file says that it cannot be shown without it; export it without",
        };
        if !KNOWN.contains(&name) && !WITHOUT_LOOK.contains(&name) {
            let name = super::shown(name);
            return fail(format!("extensionsRequired `{name}`"), format!("not supported: {remedy}"));
        }
    }
    Ok(())
}

/// Warns about extensions that are not read, and about extensions that are read but not declared.
fn check_used(value: &Value, report: &mut Report) {
    let declared: Vec<&str> = names(value, "extensionsUsed").collect();
    let found: Vec<String> = report.extensions.iter().cloned().collect();
    let all = declared.iter().copied().chain(found.iter().map(String::as_str));
    let all: BTreeSet<&str> = all.filter(|name| !WITHOUT_LOOK.contains(name)).collect();
    let (known, unknown): (Vec<&str>, Vec<&str>) = all.into_iter().partition(|name| KNOWN.contains(name));
    let listed = |names: &[&str]| names.iter().map(|name| super::shown(name)).collect::<Vec<_>>().join(", ");
    if !unknown.is_empty() {
        report.warn("unknown extensions", || {
            format!("extensions that are not modelled and were left out: {}", listed(&unknown))
        });
    }
    let undeclared: Vec<&str> = known.into_iter().filter(|name| !declared.contains(name)).collect();
    if !undeclared.is_empty() {
        report.warn("undeclared extensions", || {
            format!("extensions that are used without being declared in extensionsUsed, and read all the same: {}", listed(&undeclared))
        });
    }
    let required: Vec<&str> =
        names(value, "extensionsRequired").filter(|name| !declared.contains(name)).collect();
    if !required.is_empty() {
        report.warn("required extensions", || {
            format!("extensions that are required without being in extensionsUsed: {}", listed(&required))
        });
    }
}

/// A node has either a matrix or the parts of a transform, and no projective matrix.
fn check_transforms(value: &Value) -> Result<(), Failure> {
    let nodes = value.get("nodes").and_then(Value::as_array);
    for (index, node) in nodes.into_iter().flatten().enumerate() {
        let Some(matrix) = node.get("matrix").and_then(Value::as_array) else { continue };
        let name = || super::label("nodes", index, node.get("name").and_then(Value::as_str));
        if ["translation", "rotation", "scale"].iter().any(|key| node.get(key).is_some()) {
            let problem = "a matrix, and translation, rotation or scale as well; only one of both is allowed";
            return fail(name(), format!("{problem}: write the file again"));
        }
        let row = [3, 7, 11, 15].map(|i| matrix.get(i).and_then(Value::as_f64));
        if row != [0.0, 0.0, 0.0, 1.0].map(Some) {
            return fail(
                name(),
                "the last row of its matrix is not 0, 0, 0, 1; the file is damaged, write it again",
            );
        }
    }
    Ok(())
}

/// JSON does not distinguish 1.0 from 1, but the reader of the document does. Whole numbers that are written with a fraction
/// become integers.
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

/// Replaces pictures by those of EXT_texture_webp.
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
            // Read as JSON where even the magic number is truncated.
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
                "meshes[0].primitives[0].attributes",
            ),
            (r#"{"asset":{"version":"2.0"},"accessors":{}}"#, "accessors"),
            (r#"{"asset":{"version":"2.0","minVersion":"2.5"}}"#, "asset.minVersion"),
            (r#"{"scenes":[]}"#, "asset"),
            ("[]", "asset"),
            ("{", "the JSON"),
        ] {
            let (object, _) = parse(text.as_bytes(), &mut Vec::new()).unwrap_err();
            assert!(object.contains(place), "{text}: {object}");
        }
    }
}
