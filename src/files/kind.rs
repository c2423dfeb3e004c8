//! Detection of files of an unexpected kind, by their first bytes or, where these do not decide, by their name.

use super::text::wide;
use std::fmt;
use std::io::Read;
use std::path::Path;

/// Bytes at the start of a file that are examined.
const HEAD: u64 = 4096;

/// A kind of file that cannot be read as a scene or a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ForeignFile {
    /// Name of the kind, with an article.
    pub what: &'static str,
    /// Remedy for the user.
    pub remedy: &'static str,
}

impl fmt::Display for ForeignFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "is {}; {}", self.what, self.remedy)
    }
}

const TO_GLTF: &str = "export the model as glTF (.glb), and render that";
const UNPACK: &str = "unpack it, and name the file in it";
const PICTURE: &str =
    "name a scene (TOML), a glTF file or a mesh (PLY, OBJ, STL); pictures are named in these";
const SCENE_OF_OTHERS: &str =
    "export the model as glTF, OBJ or PLY; a scene of cardioid is TOML (docs/scene-format.md)";
const PBRT: &str = "give its name the ending .pbrt, and render that";
const POINTS: &str = "points have no surface to render: make a mesh of them (as Poisson reconstruction does in MeshLab or CloudCompare), and save it as PLY";
const CAD: &str =
    "tessellate it in the program that made it, or in FreeCAD, and export a mesh as glTF, OBJ or STL";
const MESH: &str = "convert the mesh to PLY, OBJ, STL or glTF (Blender and MeshLab do)";
const RENAME: &str = "give its name the ending of its kind (.ply, .obj, .stl, .glb or .gltf)";

/// Magic bytes at an offset that identify one kind of file: offset, bytes, name, remedy.
const BY_CONTENT: &[(usize, &[u8], &str, &str)] = &[
    (0, b"Kaydara FBX Binary", "an FBX file", TO_GLTF),
    (0, b"; FBX", "an FBX file (text)", TO_GLTF),
    (0, b"BLENDER", "a Blender file", "export it as glTF (File > Export > glTF 2.0), and render that"),
    (0, b"PXR-USDC", "a USD file (binary)", TO_GLTF),
    (0, b"#usda", "a USD file (text)", TO_GLTF),
    (0, b"Ogawa", "an Alembic file", TO_GLTF),
    (0, b"glTF", "binary glTF under another name", "rename it to end in .glb"),
    (0, b"\x89PNG\r\n\x1a\n", "a picture (PNG)", PICTURE),
    (0, b"\xff\xd8\xff", "a picture (JPEG)", PICTURE),
    (0, b"\x76\x2f\x31\x01", "a picture (EXR)", PICTURE),
    (0, b"#?RADIANCE", "a picture (Radiance HDR)", PICTURE),
    (0, b"#?RGBE", "a picture (Radiance HDR)", PICTURE),
    (0, b"II*\0", "a picture (TIFF)", PICTURE),
    (0, b"MM\0*", "a picture (TIFF)", PICTURE),
    (8, b"WEBP", "a picture (WebP)", PICTURE),
    (0, b"GIF8", "a picture (GIF)", PICTURE),
    (0, b"%PDF-", "a PDF document", "name a scene (TOML), a glTF file or a mesh (PLY, OBJ, STL)"),
    (0, b"ISO-10303-21", "a STEP file (CAD)", CAD),
    (0, b"Rhinoceros Binary", "a Rhino file", "export it as OBJ, or as glTF, and render that"),
    (0, b"\x1f\x8b", "compressed by gzip", "unpack it (`gunzip FILE`), and name what comes out"),
    (0, b"BZh", "compressed by bzip2", "unpack it (`bunzip2 FILE`), and name what comes out"),
    (0, b"\xfd7zXZ\0", "compressed by xz", "unpack it (`unxz FILE`), and name what comes out"),
    (0, b"\x28\xb5\x2f\xfd", "compressed by Zstandard", "unpack it (`unzstd FILE`), and name what comes out"),
    (0, b"7z\xbc\xaf\x27\x1c", "a 7z archive", UNPACK),
    (0, b"Rar!\x1a\x07", "a RAR archive", UNPACK),
    (0, b"PK\x03\x04", "a ZIP archive", UNPACK),
    (257, b"ustar", "a tar archive", UNPACK),
    (0, b"LASF", "a point cloud (LAS)", POINTS),
    (0, b"ASTM-E57", "a point cloud (E57)", POINTS),
    (0, b"#VRML", "a VRML file", MESH),
    (0, b"OFF\n", "a mesh in OFF", MESH),
    (0, b"OFF\r", "a mesh in OFF", MESH),
    (0, b"COFF", "a mesh in OFF", MESH),
    (0, b"solid ", "a mesh in STL under another name", RENAME),
    (0, b"ply\n", "a mesh in PLY under another name", RENAME),
    (0, b"ply\r", "a mesh in PLY under another name", RENAME),
    (0, b"\x7fELF", "a program", "name a scene (TOML), a glTF file or a mesh (PLY, OBJ, STL)"),
];

/// Words near the start of a text that identify one kind of file: word, name, remedy.
const BY_WORD: &[(&[u8], &str, &str)] = &[
    (b"<COLLADA", "a COLLADA file", TO_GLTF),
    (b"<X3D", "an X3D file", MESH),
    (b"<scene", "a scene of Mitsuba (XML)", "give its name the ending .xml, and render that"),
    (b"<?xml", "XML", SCENE_OF_OTHERS),
    (b"WorldBegin", "a scene of pbrt", PBRT),
    (b"\nAttributeBegin", "a scene of pbrt", PBRT),
    (b"\"perspective\"", "a scene of pbrt", PBRT),
    (b"//Maya ASCII", "a Maya scene", TO_GLTF),
    (b"IESNA", "a photometric file (IES)", "name it as the `file` of a light of type `ies` in a scene"),
    (b"newmtl ", "a file of materials (MTL)", "name the OBJ that it belongs to"),
];

/// File name extensions: extension, name, remedy. General compressed files and archives come last.
const BY_NAME: &[(&str, &str, &str)] = &[
    ("fbx", "an FBX file", TO_GLTF),
    ("usdz", "a USD archive", TO_GLTF),
    ("usd", "a USD file", TO_GLTF),
    ("usda", "a USD file (text)", TO_GLTF),
    ("usdc", "a USD file (binary)", TO_GLTF),
    ("blend", "a Blender file", "export it as glTF (File > Export > glTF 2.0), and render that"),
    ("abc", "an Alembic file", TO_GLTF),
    ("dae", "a COLLADA file", TO_GLTF),
    ("3ds", "a 3D Studio file", "open it in Blender or MeshLab, and export it as glTF or OBJ"),
    ("max", "a 3ds Max scene", TO_GLTF),
    ("ma", "a Maya scene", TO_GLTF),
    ("mb", "a Maya scene", TO_GLTF),
    ("c4d", "a Cinema 4D scene", TO_GLTF),
    ("hip", "a Houdini scene", TO_GLTF),
    ("lwo", "a LightWave object", TO_GLTF),
    ("skp", "a SketchUp model", "export it as glTF, OBJ or COLLADA in SketchUp; glTF is rendered as it is"),
    ("3dm", "a Rhino file", "export it as OBJ, or as glTF, and render that"),
    ("3mf", "a 3MF archive", "export the mesh as STL, OBJ or PLY, and render that"),
    ("amf", "an AMF file", MESH),
    ("step", "a STEP file (CAD)", CAD),
    ("stp", "a STEP file (CAD)", CAD),
    ("iges", "an IGES file (CAD)", CAD),
    ("igs", "an IGES file (CAD)", CAD),
    ("brep", "a BREP file (CAD)", CAD),
    ("ifc", "an IFC file (buildings)", CAD),
    ("dwg", "an AutoCAD drawing", CAD),
    ("dxf", "an AutoCAD drawing", CAD),
    ("x3d", "an X3D file", MESH),
    ("wrl", "a VRML file", MESH),
    ("off", "a mesh in OFF", MESH),
    ("vtk", "a VTK file", MESH),
    ("vtp", "a VTK file", MESH),
    ("pbrt", "a scene of pbrt", PBRT),
    ("pov", "a scene of POV-Ray", SCENE_OF_OTHERS),
    ("rib", "a RenderMan scene", SCENE_OF_OTHERS),
    ("xml", "XML", SCENE_OF_OTHERS),
    ("las", "a point cloud (LAS)", POINTS),
    ("laz", "a point cloud (LAZ)", POINTS),
    ("e57", "a point cloud (E57)", POINTS),
    ("pcd", "a point cloud (PCD)", POINTS),
    ("xyz", "a point cloud (XYZ)", POINTS),
    ("pts", "a point cloud (PTS)", POINTS),
    ("splat", "a file of Gaussian splats", POINTS),
    ("ksplat", "a file of Gaussian splats", POINTS),
    ("spz", "a file of Gaussian splats", POINTS),
    ("mtl", "a file of materials (MTL)", "name the OBJ that it belongs to"),
    ("ies", "a photometric file (IES)", "name it as the `file` of a light of type `ies` in a scene"),
    ("png", "a picture", PICTURE),
    ("jpg", "a picture", PICTURE),
    ("jpeg", "a picture", PICTURE),
    ("exr", "a picture", PICTURE),
    ("hdr", "a picture", PICTURE),
    ("tif", "a picture", PICTURE),
    ("tiff", "a picture", PICTURE),
    ("tga", "a picture", PICTURE),
    ("gz", "compressed by gzip", "unpack it (`gunzip FILE`), and name what comes out"),
    ("zip", "a ZIP archive", UNPACK),
];

/// Extensions of compressed files and archives that are more specific than their first bytes.
const NAMED_ARCHIVES: [&str; 4] = ["usdz", "3mf", "blend", "spz"];

fn by_name(path: &Path) -> Option<ForeignFile> {
    let extension = path.extension()?;
    let found = BY_NAME.iter().find(|(ending, ..)| extension.eq_ignore_ascii_case(ending));
    found.map(|&(_, what, remedy)| ForeignFile { what, remedy })
}

/// The kind of a file that begins with `head`, as far as its first bytes identify it; `path` distinguishes archives with extensions of
/// their own. Text formats such as scenes, MTL and IES files are not detected here.
pub fn foreign_by_content(path: &Path, head: &[u8]) -> Option<ForeignFile> {
    if let Some(text) = wide(head) {
        // The message has the form "is ...: ..." and is split at the colon.
        let (what, remedy) = text.split_once(": ").unwrap_or((text, "save it as UTF-8"));
        return Some(ForeignFile { what: what.trim_start_matches("is "), remedy });
    }
    let starts = |&&(at, magic, ..): &&(usize, &[u8], &str, &str)| {
        head.get(at..).is_some_and(|head| head.starts_with(magic))
    };
    let found = BY_CONTENT.iter().find(starts)?;
    let is_packed = found.3 == UNPACK || found.2.starts_with("compressed");
    let is_named = path
        .extension()
        .is_some_and(|extension| NAMED_ARCHIVES.iter().any(|named| extension.eq_ignore_ascii_case(named)));
    match by_name(path) {
        Some(named) if is_packed && is_named => Some(named),
        _ => Some(ForeignFile { what: found.2, remedy: found.3 }),
    }
}

/// The kind of a file that cannot be read as a scene or a mesh: by its first bytes, then by words in it, then by its name, then by whether
/// it is text. `None` where it may be a text with errors, or cannot be opened.
pub fn foreign_file(path: &Path) -> Option<ForeignFile> {
    let mut head = Vec::new();
    let (file, _) = super::open_regular(path).ok()?;
    file.take(HEAD).read_to_end(&mut head).ok()?;
    if let Some(found) = foreign_by_content(path, &head) {
        return Some(found);
    }
    let has = |word: &[u8]| head.windows(word.len()).any(|window| window == word);
    if let Some(&(_, what, remedy)) = BY_WORD.iter().find(|(word, ..)| has(word)) {
        return Some(ForeignFile { what, remedy });
    }
    by_name(path).or_else(|| {
        let remedy = "name a scene (TOML text), a glTF file (.glb, .gltf) or a mesh (.ply, .obj, .stl)";
        // Texts contain no zero bytes.
        head.contains(&0).then_some(ForeignFile { what: "a binary file of no known kind", remedy })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_known_by_content_and_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let mut archive = b"PK\x03\x04\x14\0\0\0".to_vec();
        archive.resize(200, 0);
        for (name, bytes, what) in [
            ("a.fbx", &b"Kaydara FBX Binary  \0\x1a\0"[..], "an FBX file"),
            ("b.toml", b"Kaydara FBX Binary  \0\x1a\0", "an FBX file"),
            ("c.usdz", &archive, "a USD archive"),
            ("d.zip", &archive, "a ZIP archive"),
            ("e.ply", &archive, "a ZIP archive"),
            ("f.ply.gz", b"\x1f\x8b\x08\0\0", "compressed by gzip"),
            ("g.blend", b"BLENDER-v300", "a Blender file"),
            ("h.blend", b"\x28\xb5\x2f\xfd\0\0", "a Blender file"),
            ("i.3ds", b"MM\x20\0\0\0", "a 3D Studio file"),
            ("j.dae", b"<?xml version=\"1.0\"?>\n<COLLADA xmlns", "a COLLADA file"),
            ("k.step", b"ISO-10303-21;\n", "a STEP file"),
            ("l.xml", b"<scene version=\"3.0.0\">", "Mitsuba"),
            ("m.pbrt", b"LookAt 0 0 5  0 0 0  0 1 0\n", "pbrt"),
            ("n.usd", b"PXR-USDC\0", "a USD file (binary)"),
            ("o.toml", b"[\0c\0a\0m\0e\0r\0a\0]\0\n\0", "UTF-16"),
            ("p.dat", b"\x01\x02\0\x03", "a binary file"),
            ("q.png", b"\x89PNG\r\n\x1a\n\0\0", "a picture (PNG)"),
        ] {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            let found = foreign_file(&path).unwrap_or_else(|| panic!("{name}"));
            assert!(found.to_string().contains(what), "{name}: {found}");
        }
        for (name, bytes) in [("a.toml", &b"name = 3"[..]), ("b", b"[camera]\n"), ("c.txt", b"")] {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            assert_eq!(foreign_file(&path), None, "{name}");
        }
    }
}
