//! What is fuzzed, for `cargo fuzz` and for the driver that needs no other toolchain (`examples/mutate.rs`): each reader of files
//! gets bytes, and must read or refuse them.

use cardioid::bricks::{
    BrickCounters, BrickMap, BrickOwner, BrickParams, BrickReader, Disc, IrradianceAtlas, build_bricks,
    write_brick_file,
};
use cardioid::math::Rgb;
use cardioid::media::read_vdb;
use cardioid::photons::{
    GroupFile, GroupWriter, Photon, PhotonClass, PhotonMap, PhotonOrder, read_photon_maps, write_photon_file,
};
use cardioid::render::{
    MapKind, blank_checkpoint_bytes, blank_part_bytes, parse_checkpoint_bytes, parse_part_bytes,
};
use cardioid::scene_file::mesh::{MeshReport, TriangleMesh};
use cardioid::scene_file::obj::{ObjFile, parse_mtl_bytes, parse_obj_bytes};
use cardioid::scene_file::ply::{MEMORY_FACTOR, parse_ply};
use cardioid::scene_file::{
    parse_gltf_bytes, parse_ies_bytes, parse_mitsuba_bytes, parse_pbrt_bytes, parse_scene, parse_stl_bytes,
};
use glam::Vec3;
use openvdb_sys::{Dense, GridClass, is_compiled};
use std::path::Path;

/// Names of the targets.
pub(crate) const TARGETS: [&str; 14] = [
    "ply", "obj", "stl", "scene", "photons", "bricks", "groups", "gltf", "ies", "rounds", "mitsuba", "pbrt",
    "vdb", "parts",
];

/// Pixels of the render in rounds.
const ROUNDS_SIZE: (u32, u32) = (3, 2);

/// A nameless file with these bytes.
fn file_of(bytes: &[u8]) -> Option<std::fs::File> {
    let mut file = tempfile::tempfile().ok()?;
    std::io::Write::write_all(&mut file, bytes).ok()?;
    Some(file)
}

fn read_bricks(bytes: &[u8]) -> bool {
    let Some(file) = file_of(bytes) else { return false };
    match BrickMap::of_file(file, bytes.len() as u64, Path::new("a.bricks")) {
        Ok(map) => {
            let bricks = (0..map.bricks() as u32).all(|number| map.read(number).is_ok());
            let (low, side) = map.cube();
            let atlas = IrradianceAtlas::new(vec![map], [Some(0)], (1 << 16, 1));
            let (mut reader, mut counters) = (BrickReader::default(), BrickCounters::default());
            for i in 0..16 {
                let position = low + side * Vec3::new(i as f32 / 15.0, 0.4, 0.6);
                atlas.look_up((&mut reader, &mut counters), 0, (position, Vec3::X), side / (1 << i) as f32);
            }
            bricks
        }
        Err(error) => {
            assert!(error.to_string().contains("a.bricks"), "{error}");
            false
        }
    }
}

/// The same bytes with checksums that fit, as far as they are long enough.
fn sealed_bricks(bytes: &[u8]) -> Vec<u8> {
    const HEAD: usize = 88;
    let mut bytes = bytes.to_vec();
    let length = bytes.len() as u64;
    if bytes.len() < HEAD + 32 {
        return bytes;
    }
    bytes[16..24].copy_from_slice(&length.to_le_bytes());
    let count = u32::from_le_bytes([bytes[24], bytes[25], bytes[26], bytes[27]]) as usize;
    let sum = *blake3::hash(&bytes[..HEAD]).as_bytes();
    bytes[HEAD..HEAD + 32].copy_from_slice(&sum);
    let start = HEAD + 32;
    let Some(end) = count.checked_mul(11).map(|table| start + table).filter(|end| end + 32 <= bytes.len())
    else {
        return bytes;
    };
    let mut at = end + 32;
    for node in 0..count {
        let row = start + 11 * node;
        let size = usize::from(u16::from_le_bytes([bytes[row + 1], bytes[row + 2]]));
        if at + size > bytes.len() {
            break;
        }
        let sum = *blake3::hash(&bytes[at..at + size]).as_bytes();
        bytes[row + 3..row + 11].copy_from_slice(&sum[..8]);
        at += size;
    }
    let sum = *blake3::hash(&bytes[start..end]).as_bytes();
    bytes[end..end + 32].copy_from_slice(&sum);
    bytes
}

fn read_group(bytes: &[u8]) -> bool {
    let Some(file) = file_of(bytes) else { return false };
    match GroupFile::of_file(file, bytes.len() as u64, Path::new("a.photons")) {
        Ok(group) => {
            let mut photons = Vec::new();
            let all = group.within(Vec3::splat(-1e9), Vec3::splat(1e9), &mut photons).is_ok();
            all && (0..group.runs(1024)).all(|run| group.run(run, 1024).is_ok())
        }
        Err(error) => {
            assert!(error.to_string().contains("a.photons"), "{error}");
            false
        }
    }
}

/// The same bytes with checksums that fit, as far as they are long enough; one block.
fn sealed_group(bytes: &[u8]) -> Vec<u8> {
    const HEAD: usize = 72;
    let mut bytes = bytes.to_vec();
    let length = bytes.len();
    if length < HEAD + 32 + 64 {
        return bytes;
    }
    bytes[16..24].copy_from_slice(&(length as u64).to_le_bytes());
    let sum = *blake3::hash(&bytes[..HEAD]).as_bytes();
    bytes[HEAD..HEAD + 32].copy_from_slice(&sum);
    let (row, end) = (length - 64, length - 32);
    let sum = *blake3::hash(&bytes[HEAD + 32..row]).as_bytes();
    bytes[row + 24..end].copy_from_slice(&sum[..8]);
    let sum = *blake3::hash(&bytes[row..end]).as_bytes();
    bytes[end..].copy_from_slice(&sum);
    bytes
}

/// One execution: true where the bytes were read, false where they were refused.
///
/// # Panics
/// Where something is wrong with the reader.
pub(crate) fn execute(target: &str, bytes: &[u8]) -> bool {
    match target {
        "ply" => sound(parse_ply(bytes, Path::new("a.ply")).map_err(|error| error.to_string()), bytes),
        "obj" => {
            // Nearly all bytes are materials, so what is said of them says nothing.
            let _ = parse_mtl_bytes(bytes, Path::new("a.mtl"));
            let obj = parse_obj_bytes(bytes, Path::new("a.obj")).map(ObjFile::into_mesh);
            sound(obj.map_err(|error| error.to_string()), bytes)
        }
        "stl" => sound(parse_stl_bytes(bytes, Path::new("a.stl")).map_err(|error| error.to_string()), bytes),
        "scene" => match std::str::from_utf8(bytes) {
            Ok(text) => match parse_scene(text, Path::new("a.toml"), &[]) {
                Ok(_) => true,
                Err(error) => {
                    assert!(error.to_string().contains("a.toml"), "{error}");
                    false
                }
            },
            Err(_) => false,
        },
        "photons" => {
            // As it is, and with checksums that fit, or nothing would get past them.
            let first = read_photon_maps(&mut &bytes[..], bytes.len() as u64).is_ok();
            let sealed = sealed(bytes);
            match read_photon_maps(&mut &sealed[..], sealed.len() as u64) {
                Ok(file) => {
                    for map in file.maps {
                        assert!(map.photons.len() * 20 <= sealed.len());
                        let map = PhotonMap::build(map.photons, map.emitted);
                        assert_eq!(map.dropped(), 0);
                    }
                    true
                }
                Err(_) => first,
            }
        }
        "bricks" => read_bricks(bytes) | read_bricks(&sealed_bricks(bytes)),
        "groups" => read_group(bytes) | read_group(&sealed_group(bytes)),
        "gltf" => match parse_gltf_bytes(bytes, Path::new("a.gltf")) {
            Ok(scene) => {
                assert!(scene.shapes.len() + scene.groups.len() <= bytes.len());
                true
            }
            Err(error) => {
                assert!(error.to_string().contains("a.gltf"), "{error}");
                false
            }
        },
        "mitsuba" => match parse_mitsuba_bytes(bytes, Path::new("a.xml"), &[]) {
            Ok(scene) => {
                assert!(scene.shapes.len() + scene.instances.len() + scene.lights.len() <= bytes.len());
                true
            }
            Err(error) => {
                assert!(error.to_string().contains("a.xml"), "{error}");
                false
            }
        },
        "pbrt" => match parse_pbrt_bytes(bytes, Path::new("a.pbrt")) {
            Ok(scene) => {
                assert!(scene.shapes.len() + scene.instances.len() + scene.lights.len() <= bytes.len());
                true
            }
            Err(error) => {
                assert!(error.to_string().contains("a.pbrt"), "{error}");
                false
            }
        },
        "ies" => match parse_ies_bytes(bytes, Path::new("a.ies")) {
            Ok(_) => true,
            Err(error) => {
                assert!(error.to_string().contains("a.ies"), "{error}");
                false
            }
        },
        "vdb" => {
            let folder = tempfile::tempdir().expect("a folder for the file");
            let path = folder.path().join("a.vdb");
            std::fs::write(&path, bytes).expect("room for the file");
            match read_vdb(&path, None) {
                Ok(read) => {
                    let (most, bounds) = (read.grid.majorant(), read.grid.bounds());
                    assert!(
                        most > 0.0 && most.is_finite() && bounds.min.is_finite() && bounds.max.is_finite()
                    );
                    true
                }
                Err(error) => {
                    assert!(error.to_string().contains("a.vdb"), "{error}");
                    false
                }
            }
        }
        "rounds" => {
            // As it is, and with a checksum that fits.
            let read = |bytes: &[u8]| parse_checkpoint_bytes(bytes, Path::new("a.rounds"), ROUNDS_SIZE);
            let first = read(bytes).is_ok();
            let mut sealed = bytes.to_vec();
            if let Some(end) = bytes.len().checked_sub(32) {
                let sum = blake3::hash(&bytes[..end]);
                sealed[end..].copy_from_slice(sum.as_bytes());
            }
            match read(&sealed) {
                Ok(_) => true,
                Err(error) => {
                    assert!(error.to_string().contains("a.rounds"), "{error}");
                    first
                }
            }
        }
        "parts" => {
            // As it is, and with checksums that fit.
            let read = |bytes: &[u8]| parse_part_bytes(bytes, Path::new("a.part"), 1 << 16);
            let first = read(bytes).is_ok();
            match read(&with_checksums(bytes)) {
                Ok(_) => true,
                Err(error) => {
                    assert!(error.to_string().contains("a.part"), "{error}");
                    first
                }
            }
        }
        other => panic!("no target `{other}`"),
    }
}

/// The bytes of a part, whose chunks have the checksums of what they hold now.
fn with_checksums(bytes: &[u8]) -> Vec<u8> {
    let mut sealed = bytes.to_vec();
    let mut at = 20;
    while let Some(length) = sealed.get(at..at + 4).and_then(|four| four.try_into().ok()) {
        let content = at + 4;
        let Some(end) = content.checked_add(u32::from_le_bytes(length) as usize) else { break };
        let Some(sum) = sealed.get(content..end).map(blake3::hash) else { break };
        let Some(place) = sealed.get_mut(end..end + 32) else { break };
        place.copy_from_slice(sum.as_bytes());
        at = end + 32;
    }
    sealed
}

/// A mesh whose numbers are in range and which is not much larger than its file, or an error with a remedy.
fn sound(result: Result<(TriangleMesh, MeshReport), String>, bytes: &[u8]) -> bool {
    match result {
        Ok((mesh, _)) => {
            let count = mesh.positions.len() as u32;
            assert!(mesh.triangles.iter().flatten().all(|&corner| corner < count));
            let size = mesh.positions.len() * 24 + mesh.triangles.len() * 12;
            assert!(size as u64 <= MEMORY_FACTOR * bytes.len() as u64 + 64, "{size} of {}", bytes.len());
            true
        }
        Err(message) => {
            assert!(message.contains("; "), "no remedy: {message}");
            false
        }
    }
}

/// A file of photon maps with the checksums of what it holds, as far as it holds together.
fn sealed(bytes: &[u8]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let length = bytes.len();
    if length >= 64 {
        bytes[16..24].copy_from_slice(&(length as u64).to_le_bytes());
        let sum = blake3::hash(&bytes[..32]);
        bytes[32..64].copy_from_slice(sum.as_bytes());
    }
    let mut at = 64;
    while at + 16 <= length {
        let mut size = [0; 8];
        size.copy_from_slice(&bytes[at + 8..at + 16]);
        let end = usize::try_from(u64::from_le_bytes(size)).ok().and_then(|size| (at + 16).checked_add(size));
        let Some(end) = end.filter(|end| end.saturating_add(32) <= length) else { break };
        let sum = blake3::hash(&bytes[at..end]);
        bytes[end..end + 32].copy_from_slice(sum.as_bytes());
        at = end + 32;
    }
    bytes
}

/// Small files that are sound, to begin with.
pub(crate) fn seeds(target: &str) -> Vec<Vec<u8>> {
    match target {
        "ply" => {
            let header = |format: &str, rest: &str| {
                format!(
                    "ply\nformat {format} 1.0\ncomment a\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n{rest}"
                )
            };
            let faces = "element face 2\nproperty list uchar int vertex_indices\nend_header\n";
            let ascii = header("ascii", faces) + "0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n";
            let normals = "property double nx\nproperty double ny\nproperty double nz\nproperty float s\nproperty float t\n";
            let rich = header("ascii", &(normals.to_owned() + "element other 1\nproperty list int short a\n" + faces))
                + "0 0 0 0 0 1 0 0\n1 0 0 0 0 1 0 0\n1 1 0 0 0 0 0 0\n0 1 0 nan 0 1 0 0\n2 5 6\n4 0 1 2 3\n2 0 1\n";
            let mut files = vec![ascii.into_bytes(), rich.into_bytes()];
            for (format, big) in [("binary_little_endian", false), ("binary_big_endian", true)] {
                let mut bytes = header(format, faces).into_bytes();
                let float = |x: f32| if big { x.to_be_bytes() } else { x.to_le_bytes() };
                let int = |x: i32| if big { x.to_be_bytes() } else { x.to_le_bytes() };
                for [x, y] in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
                    [x, y, 0.0].iter().for_each(|&x| bytes.extend(float(x)));
                }
                for corners in [&[0, 1, 2][..], &[0, 2, 3]] {
                    bytes.push(corners.len() as u8);
                    corners.iter().for_each(|&corner| bytes.extend(int(corner)));
                }
                files.push(bytes);
            }
            files
        }
        "obj" => vec![
            b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\nusemtl red\nf 1/1/1 2//1 3//1\nf -4 -2 -1\n".to_vec(),
            b"# a\no x\ng y\ns 1\nv 0 0 0 1.0\nv 1e3 -.5 nan\nv 1 1 \\\n 2\nf 1 2 3 # end\nl 1 2\np 1\nusemtl b\nf 3 2 1 2 3\n".to_vec(),
            b"newmtl red\nKd 1 0 0\nKs .5 .5 .5\nNs 100\nNi 1.5\nd 0.5\nillum 7\nTf 1 1 1\nmap_Kd a.png\nnewmtl b\nTr 1\n".to_vec(),
        ],
        "stl" => {
            let facet = |corners: &str| format!(" facet normal 0 0 1\n  outer loop\n{corners}  endloop\n endfacet\n");
            let ascii = format!(
                "solid a\n{}{}endsolid a\n",
                facet("vertex 0 0 0\nvertex 1 0 0\nvertex 1 1 0\n"),
                facet("vertex 0 0 0\nvertex 1e0 1 0\nvertex 0 1 -0\n")
            );
            let mut binary = vec![b' '; 80];
            binary.extend(2u32.to_le_bytes());
            for corners in [[0.0f32, 0.0, 1.0, 0.0, 1.0, 1.0], [0.0, 0.0, 1.0, 1.0, 0.0, 1.0]] {
                binary.extend([0; 12]);
                for corner in corners.chunks(2) {
                    [corner[0], corner[1], 0.0].iter().for_each(|x| binary.extend(x.to_le_bytes()));
                }
                binary.extend([0; 2]);
            }
            vec![ascii.into_bytes(), binary]
        }
        "scene" => vec![
            b"name = \"a\"\nunit = \"cm\"\n[parameters.size]\ndefault = 2.0\nhelp = \"a size\"\n[camera]\neye = [0, 1, 5]\nat = [0, 0, 0]\nfov = 40.0\n\
[film]\nwidth = 64\nheight = 48\n[render]\nspp = 4\n[media.glass]\nior = 1.5\n[materials.grey]\ntype = \"lambert\"\nreflectance = 0.5\n\
[materials.clear]\ntype = \"dielectric\"\ninside = \"glass\"\n[[shapes]]\nname = \"ball\"\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 1.0\nmaterial = \"clear\"\n\
[[shapes]]\ntype = \"quad\"\ncorner = [-1, 3, -1]\nedge-u = [2, 0, 0]\nedge-v = [0, 0, 2]\nmaterial = \"grey\"\nemission = { radiance = [10, 9, 8] }\n".to_vec(),
            b"[materials.m]\ntype = \"mirror\"\nreflectance = [0.9, 0.9, 0.9]\n[[shapes]]\ntype = \"mesh\"\nvertices = [[0,0,0],[1,0,0],[0,1,0]]\nfaces = [[0,1,2]]\n\
material = \"m\"\ntransform = [{ translate = [1, 2, 3] }, { rotate = 30, axis = \"y\" }, { scale = 2 }]\n\
[[lights]]\ntype = \"point\"\nposition = [0, 5, 0]\nintensity = [10, 10, 10]\n".to_vec(),
        ],
        "bricks" => {
            let disc = |i: usize| {
                let normal = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::Z][i % 4];
                let position = Vec3::new(0.1 * i as f32, 0.3 * (i % 3) as f32, 0.2 * (i % 5) as f32);
                Disc { position, normal, radius: 0.1, detail: 0.1, irradiance: Rgb::splat(1.0 + i as f32) }
            };
            let discs: Vec<Disc> = (0..20).map(disc).collect();
            let params = BrickParams { max_error: 0.03, max_level: 2 };
            let mut bytes = Vec::new();
            // Where there is no disk for the temporary file there is nothing to begin with.
            if let Ok(built) = build_bricks(&discs, &params, &std::env::temp_dir()) {
                let _ = write_brick_file(&mut bytes, &built, BrickOwner([7; 32]));
            }
            vec![bytes]
        }
        "groups" => {
            let path = std::env::temp_dir().join(format!("cardioid-{}.photons", std::process::id()));
            let written = GroupWriter::new(&std::env::temp_dir()).and_then(|mut writer| {
                for i in 0..40 {
                    let position = Vec3::splat(i as f32);
                    writer.push(&Photon::new(position, Rgb::ONE, Vec3::Y, Vec3::Y, PhotonClass::Direct, 0.5))?;
                }
                Ok(writer)
            });
            let order = PhotonOrder::within(Vec3::ZERO, 100.0);
            let done = written.is_ok_and(|writer| writer.finish(&path, ([7; 32], 100), order, 1000).is_ok());
            let bytes = if done { std::fs::read(&path).unwrap_or_default() } else { Vec::new() };
            let _ = std::fs::remove_file(&path);
            vec![bytes]
        }
        "photons" => {
            let photon = |i: usize| {
                let x = i as f32;
                let class = [PhotonClass::Direct, PhotonClass::Indirect, PhotonClass::Caustic][i % 3];
                Photon::new(Vec3::new(x, 0.5 * x, -x), Rgb::splat(1.0 + x), Vec3::Y, Vec3::Y, class, 0.5)
            };
            let map = |count: usize| PhotonMap::build((0..count).map(photon).collect(), 100);
            let (global, caustic) = (map(9), map(3));
            let mut bytes = Vec::new();
            let maps = [(MapKind::Global, &global), (MapKind::Caustic, &caustic)];
            // A vector takes whatever is written.
            let _ = write_photon_file(&mut bytes, "{}", &maps, None);
            vec![bytes]
        }
        "gltf" => {
            // A triangle: three corners of twelve bytes, and their indices as bytes; as text, and in a container.
            let mut binary: Vec<u8> = [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|x| x.to_le_bytes()).collect();
            binary.extend([0u8, 1, 2, 0]);
            let json = |uri: &str| {
                format!(
                    r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0,"children":[1],"scale":[1,2,1]}},{{"camera":0,"translation":[0,0,5]}}],"cameras":[{{"type":"perspective","perspective":{{"yfov":0.7,"znear":0.1}}}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1,"material":0}}]}}],"materials":[{{"pbrMetallicRoughness":{{"baseColorFactor":[1,0.5,0,1],"roughnessFactor":0.5}},"extensions":{{"KHR_materials_ior":{{"ior":1.4}}}}}}],"extensionsUsed":["KHR_materials_ior"],"accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}},{{"bufferView":1,"componentType":5121,"count":3,"type":"SCALAR"}}],"bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":3}}],"buffers":[{{"byteLength":40{uri}}}]}}"#
                )
            };
            // The same forty bytes in base 64.
            let data = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAECAA==";
            let text = json(&format!(r#","uri":"data:application/octet-stream;base64,{data}""#));
            let mut inner = json("").into_bytes();
            inner.resize(inner.len().next_multiple_of(4), b' ');
            let mut container = b"glTF".to_vec();
            container.extend(2u32.to_le_bytes());
            container.extend((12 + 8 + inner.len() as u32 + 8 + binary.len() as u32).to_le_bytes());
            for (kind, chunk) in [(b"JSON", &inner), (b"BIN\0", &binary)] {
                container.extend((chunk.len() as u32).to_le_bytes());
                container.extend(kind);
                container.extend(chunk);
            }
            vec![text.into_bytes(), container, include_bytes!("rich.gltf").to_vec()]
        }
        "ies" => vec![
            b"IESNA:LM-63-2002\n[TEST] a\nTILT=NONE\n1 1000 1 3 1 1 2 0 0 0\n1.0 1.0 10\n0 45 90\n0\n100 50 0\n".to_vec(),
            b"IESNA91\nTILT=INCLUDE\n1\n2\n0 90\n1 1\n1 -1 0.5 2 2 1 1 0.1 0.1 0\n1 1 10\n0 180\n0 90\n1 2\n3 4\n".to_vec(),
        ],
        "mitsuba" => vec![
            include_bytes!("rich.xml").to_vec(),
            b"<scene version=\"0.6.0\"><shape type=\"sphere\"><bsdf type=\"diffuse\"><srgb name=\"diffuseReflectance\" value=\"#102030\"/></bsdf></shape></scene>".to_vec(),
        ],
        "pbrt" => vec![
            include_bytes!("rich.pbrt").to_vec(),
            b"WorldBegin Material \"matte\" \"color Kd\" [.1 .2 .3] Shape \"sphere\" \"float radius\" 2 WorldEnd".to_vec(),
        ],
        "rounds" => blank_checkpoint_bytes(ROUNDS_SIZE).into_iter().collect(),
        "vdb" => vdb_seeds(),
        "parts" => [1, 2].into_iter().filter_map(|blocks| blank_part_bytes(ROUNDS_SIZE, blocks).ok()).collect(),
        other => panic!("no target `{other}`"),
    }
}

/// Small files of voxels; none where there is no OpenVDB to write them.
fn vdb_seeds() -> Vec<Vec<u8>> {
    if !is_compiled() {
        return Vec::new();
    }
    let folder = tempfile::tempdir().expect("a folder for the files");
    let path = folder.path().join("seed.vdb");
    let values: Vec<f32> = (0..9 * 9 * 9).map(|i| (i % 97) as f32).collect();
    let turned = [[0.1, 0.1, 0.0], [-0.1, 0.1, 0.0], [0.0, 0.0, 0.3], [1.0, 2.0, 3.0]];
    let file = |(values, is_half): (&[f32], bool)| {
        let (name, origin, size, class) = ("density", [-3, 5, 6], [9; 3], GridClass::FogVolume);
        let grid = Dense { name, origin, size, values, to_world: turned, class, is_half };
        openvdb_sys::write(&path, &grid).expect("a file of voxels");
        std::fs::read(&path).expect("what was written")
    };
    [(&values[..], false), (&values[..], true), (&[0.5; 9 * 9 * 9][..], false)].map(file).to_vec()
}

/// Words that a mutation puts in: of the formats, and numbers at the ends of their types.
pub(crate) const WORDS: [&str; 45] = [
    "property list uchar int ",
    "property float ",
    "element vertex ",
    "element face ",
    "end_header\n",
    "format ascii 1.0\n",
    "binary_little_endian",
    "4294967295",
    "18446744073709551615",
    "-1",
    "1e400",
    "nan",
    "inf",
    "0",
    "\n",
    " ",
    "\t",
    "#",
    "f ",
    "v ",
    "vn ",
    "usemtl ",
    "\\\n",
    "//",
    "-9223372036854775808",
    "solid ",
    "endloop\n",
    "vertex ",
    "facet ",
    "[[shapes]]\n",
    "[",
    "]",
    "{",
    "}",
    "\"",
    " = ",
    "= \"${size}\"\n",
    "type = \"mesh\"\n",
    "fit = { size = 1 }\n",
    "group = \"a\"\n",
    " AttributeBegin ",
    " Shape \"sphere\" ",
    " \"float radius\" ",
    " \"texture reflectance\" ",
    " Scale 0 1 1 ",
];
