//! Tests of the PLY reader.

use super::*;
use crate::files::BYTE_ORDER_MARK;
use crate::math::unit;
use crate::scene_file::mesh::{Cloud, Positions};
use glam::{DVec3, Vec2, Vec3};
use proptest::prelude::*;
use std::path::PathBuf;

const PATH: &str = "mesh.ply";

fn load(bytes: impl AsRef<[u8]>) -> Result<(TriangleMesh, MeshReport), String> {
    parse_ply(bytes.as_ref(), Path::new(PATH)).map_err(|error| error.to_string())
}

fn refused(bytes: impl AsRef<[u8]>) -> String {
    load(bytes).expect_err("should be refused")
}

/// The folder of test data beside the checkout, if it exists.
fn assets() -> Option<PathBuf> {
    let checkout = Path::new(env!("CARGO_MANIFEST_DIR"));
    let found =
        checkout.ancestors().map(|folder| folder.join("shared/assets")).find(|folder| folder.is_dir());
    if found.is_none() {
        println!("skipped: no folder shared/assets beside the checkout");
    }
    found
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Format {
    Ascii,
    Little,
    Big,
}

const FORMATS: [Format; 3] = [Format::Ascii, Format::Little, Format::Big];

impl Format {
    fn name(self) -> &'static str {
        match self {
            Self::Ascii => "ascii",
            Self::Little => "binary_little_endian",
            Self::Big => "binary_big_endian",
        }
    }
}

/// Writes files in the simplest way, one number at a time.
struct Writer {
    format: Format,
    bytes: Vec<u8>,
}

impl Writer {
    fn new(format: Format, declarations: &str) -> Self {
        let header = format!("ply\nformat {} 1.0\n{declarations}\nend_header\n", format.name());
        Self { format, bytes: header.into_bytes() }
    }

    /// Writes one number of the type with this name in the header.
    fn put(&mut self, kind: &str, value: f64) -> &mut Self {
        if self.format == Format::Ascii {
            let text = if kind.starts_with("float") { (value as f32).to_string() } else { value.to_string() };
            self.bytes.extend(text.bytes().chain([b' ']));
            return self;
        }
        let mut little = match kind {
            "char" | "int8" => (value as i8).to_le_bytes().to_vec(),
            "uchar" | "uint8" => (value as u8).to_le_bytes().to_vec(),
            "short" | "int16" => (value as i16).to_le_bytes().to_vec(),
            "ushort" | "uint16" => (value as u16).to_le_bytes().to_vec(),
            "int" | "int32" => (value as i32).to_le_bytes().to_vec(),
            "uint" | "uint32" => (value as u32).to_le_bytes().to_vec(),
            "float" | "float32" => (value as f32).to_le_bytes().to_vec(),
            "double" | "float64" => value.to_le_bytes().to_vec(),
            other => panic!("no type {other}"),
        };
        if self.format == Format::Big {
            little.reverse();
        }
        self.bytes.extend(little);
        self
    }

    fn end(&mut self) {
        if self.format == Format::Ascii {
            self.bytes.push(b'\n');
        }
    }

    fn record(&mut self, numbers: &[(&str, f64)]) -> &mut Self {
        numbers.iter().for_each(|(kind, value)| {
            self.put(kind, *value);
        });
        self.end();
        self
    }

    fn list(&mut self, count: &str, item: &str, items: &[f64]) -> &mut Self {
        self.put(count, items.len() as f64);
        items.iter().for_each(|value| {
            self.put(item, *value);
        });
        self.end();
        self
    }
}

/// Five vertices, a triangle and a quad, normals, texture coordinates, colours, and an unknown element.
fn rich(format: Format) -> Vec<u8> {
    let declarations = "comment made by hand\nobj_info nothing\nelement vertex 5\nproperty float x\nproperty float y\n\
        property float z\nproperty uchar red\nproperty float nx\nproperty float ny\nproperty float nz\n\
        property float s\nproperty float t\nelement camera 2\nproperty list uchar double matrix\n\
        property short id\nelement face 2\nproperty int flags\nproperty list uchar int vertex_indices";
    let mut writer = Writer::new(format, declarations);
    for vertex in 0..5 {
        let (x, y) = (f64::from(vertex % 3), f64::from(vertex / 3));
        let mut record: Vec<_> = [x, y, 0.25].map(|value| ("float", value)).to_vec();
        record.push(("uchar", 200.0));
        record.extend([0.0, 0.0, 2.0, x, y].map(|value| ("float", value)));
        writer.record(&record);
    }
    for camera in 0..2 {
        writer.put("uchar", f64::from(camera));
        (0..camera).for_each(|_| {
            writer.put("double", 1.5);
        });
        writer.put("short", 7.0).end();
    }
    writer.put("int", 0.0).list("uchar", "int", &[0.0, 1.0, 4.0]);
    writer.put("int", 0.0).list("uchar", "int", &[0.0, 1.0, 4.0, 3.0]);
    writer.bytes
}

/// A mesh of one triangle with only the required content.
fn plain(format: Format) -> Vec<u8> {
    let declarations = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices";
    let mut writer = Writer::new(format, declarations);
    for [x, y] in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]] {
        writer.record(&[("float", x), ("float", y), ("float", 0.0)]);
    }
    writer.list("uchar", "int", &[0.0, 1.0, 2.0]);
    writer.bytes
}

#[test]
fn all_formats_give_the_same_mesh() {
    let (first, report) = load(rich(Format::Ascii)).unwrap();
    assert_eq!(report, MeshReport::default());
    assert_eq!(first.triangles, [[0, 1, 4], [0, 1, 4], [0, 4, 3]]);
    assert_eq!(first.positions.get(4), DVec3::new(1.0, 1.0, 0.25));
    assert_eq!(first.normals.as_deref(), Some(&[Vec3::Z; 5][..]));
    assert_eq!(first.uvs.as_ref().unwrap()[4], Vec2::new(1.0, 1.0));
    for format in FORMATS {
        assert_eq!(load(rich(format)).unwrap().0, first, "{format:?}");
    }
}

#[test]
fn carriage_returns_of_other_systems() {
    let unix = String::from_utf8(rich(Format::Ascii)).unwrap();
    let expected = load(&unix).unwrap();
    assert_eq!(load(unix.replace('\n', "\r\n")).unwrap(), expected);
    assert_eq!(load(unix.replace('\n', "\r")).unwrap(), expected);
    for format in [Format::Little, Format::Big] {
        let bytes = rich(format);
        let end = bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
        for line_end in ["\r\n", "\r"] {
            let header = std::str::from_utf8(&bytes[..end]).unwrap().replace('\n', line_end);
            assert_eq!(load([header.as_bytes(), &bytes[end..]].concat()).unwrap(), expected, "{format:?}");
        }
    }
}

#[test]
fn all_types_of_numbers_by_both_names() {
    let types = [
        ["char", "int8"],
        ["uchar", "uint8"],
        ["short", "int16"],
        ["ushort", "uint16"],
        ["int", "int32"],
        ["uint", "uint32"],
        ["float", "float32"],
        ["double", "float64"],
    ];
    for (number, [kind, other]) in types.iter().enumerate() {
        for format in FORMATS {
            // The types of lengths and of indices are integers.
            let integer = types[number.min(5)][0];
            let declarations = format!(
                "element vertex 3\nproperty {kind} x\nproperty {other} y\nproperty {kind} z\n\
                 element face 1\nproperty list {integer} {} vertex_index",
                types[number.min(5)][1]
            );
            let mut writer = Writer::new(format, &declarations);
            for [x, y] in [[100.0, 3.0], [7.0, 120.0], [1.0, 2.0]] {
                writer.record(&[(kind, x), (other, y), (kind, 9.0)]);
            }
            writer.list(integer, integer, &[2.0, 1.0, 0.0]);
            let (mesh, report) = load(&writer.bytes).unwrap();
            assert_eq!(report, MeshReport::default());
            assert_eq!(mesh.positions.get(1), DVec3::new(7.0, 120.0, 9.0), "{kind} {format:?}");
            assert_eq!(mesh.triangles, [[2, 1, 0]]);
            let needs_doubles = matches!(*kind, "int" | "uint" | "double");
            assert_eq!(matches!(mesh.positions, Positions::Double(_)), needs_doubles, "{kind}");
        }
    }
}

#[test]
fn doubles_keep_georeferenced_coordinates() {
    let declarations = "element vertex 3\nproperty double x\nproperty double y\nproperty double z\n\
        element face 1\nproperty list uchar uint vertex_indices";
    for format in FORMATS {
        let mut writer = Writer::new(format, declarations);
        let east = 4_812_345.678_9;
        for [x, y] in [[0.0, 0.0], [0.001, 0.0], [0.0, 0.001]] {
            writer.record(&[("double", east + x), ("double", y), ("double", 0.0)]);
        }
        writer.list("uchar", "uint", &[0.0, 1.0, 2.0]);
        let (mesh, _) = load(&writer.bytes).unwrap();
        assert_eq!(mesh.positions.get(1).x, east + 0.001);
        assert_eq!(mesh.triangles.len(), 1);
    }
}

#[test]
fn texture_coordinates_under_all_names_and_only_in_pairs() {
    for (names, expected) in [
        (["u", "v"], true),
        (["s", "t"], true),
        (["texture_u", "texture_v"], true),
        (["texture_s", "texture_t"], true),
        (["u", "t"], false),
    ] {
        let text = format!(
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
             property float {}\nproperty float {}\nend_header\n0 0 0 0.25 0.75\n",
            names[0], names[1]
        );
        let uvs = load(text).unwrap().0.uvs;
        assert_eq!(uvs, expected.then(|| vec![Vec2::new(0.25, 0.75)]), "{names:?}");
    }
}

#[test]
fn faces_may_come_before_vertices() {
    for format in FORMATS {
        let declarations = "element face 1\nproperty list uchar int vertex_indices\nelement vertex 3\n\
            property float x\nproperty float y\nproperty float z";
        let mut writer = Writer::new(format, declarations);
        writer.list("uchar", "int", &[0.0, 1.0, 2.0]);
        for [x, y] in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]] {
            writer.record(&[("float", x), ("float", y), ("float", 0.0)]);
        }
        assert_eq!(load(&writer.bytes).unwrap().0.triangles, [[0, 1, 2]], "{format:?}");
    }
}

#[test]
fn lists_of_vertices_are_walked() {
    let declarations = "element vertex 3\nproperty float x\nproperty list uchar float weights\nproperty float y\n\
        property float z\nelement face 1\nproperty list uchar int vertex_indices";
    for format in FORMATS {
        let mut writer = Writer::new(format, declarations);
        for (vertex, [x, y]) in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].into_iter().enumerate() {
            writer.put("float", x).put("uchar", vertex as f64);
            (0..vertex).for_each(|_| {
                writer.put("float", 0.5);
            });
            writer.record(&[("float", y), ("float", 3.0)]);
        }
        writer.list("uchar", "int", &[0.0, 1.0, 2.0]);
        let (mesh, _) = load(&writer.bytes).unwrap();
        assert_eq!(mesh.positions.get(2), DVec3::new(0.0, 1.0, 3.0), "{format:?}");
    }
}

/// Vertices on a circle, and faces with the given numbers of corners.
fn polygons(format: Format, corners: &[usize]) -> Vec<u8> {
    let declarations = format!(
        "element vertex 12\nproperty float x\nproperty float y\nproperty float z\nelement face {}\n\
         property list uchar ushort vertex_indices\nproperty uchar material",
        corners.len()
    );
    let mut writer = Writer::new(format, &declarations);
    for vertex in 0..12 {
        let (y, x) = (f64::from(vertex) * std::f64::consts::TAU / 12.0).sin_cos();
        writer.record(&[("float", x), ("float", y), ("float", 0.0)]);
    }
    for &count in corners {
        let indices: Vec<_> = (0..count).map(|corner| corner as f64).collect();
        writer.put("uchar", count as f64);
        indices.iter().for_each(|index| {
            writer.put("ushort", *index);
        });
        writer.put("uchar", 5.0).end();
    }
    writer.bytes
}

#[test]
fn polygons_become_fans() {
    for format in FORMATS {
        for (faces, triangles, short) in [
            (&[3, 3, 3][..], 3, 0),
            (&[4, 4], 4, 0),
            (&[12, 12], 20, 0),
            (&[3, 4, 5, 12], 1 + 2 + 3 + 10, 0),
            (&[3, 3, 4], 4, 0),
            (&[2, 3, 0, 1], 1, 3),
        ] {
            let (mesh, report) = load(polygons(format, faces)).unwrap();
            assert_eq!(mesh.triangles.len(), triangles, "{format:?} {faces:?}");
            assert_eq!(report, MeshReport { short_faces: short, ..MeshReport::default() });
        }
    }
}

#[test]
fn what_cannot_be_used_is_dropped_and_counted() {
    let text = "ply\nformat ascii 1.0\nelement vertex 7\nproperty float x\nproperty float y\nproperty float z\n\
        property float nx\nproperty float ny\nproperty float nz\nproperty float u\nproperty float v\n\
        element face 6\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 0 0 1 0 0\n1 0 0 0 0 0 0 inf\n0 1 0 nan 0 1 0 0\n0.5 0.5 0 0 inf 0 0 0\n\
        nan 0 0 0 0 1 0 0\n-nan(ind) 1.#IND 0 0 0 1 0 0\n1e39 0 0 0 0 5 0 nan\n\
        3 0 1 2\n3 0 1 4\n3 5 6 0\n3 0 1 1\n3 1 3 2\n2 0 1\ngarbage at the end";
    let (mesh, report) = load(text).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    let expected = MeshReport {
        short_faces: 1,
        non_finite_triangles: 2,
        degenerate_triangles: 2,
        unusable_normals: 3,
        unusable_uvs: 2,
        trailing_bytes: 18,
        ..MeshReport::default()
    };
    assert_eq!(report, expected);
    assert_eq!(report.findings().len(), 6);
    assert_eq!(mesh.normals.unwrap()[1..4], [Vec3::ZERO; 3]);
    assert!(mesh.uvs.unwrap().iter().all(|uv| uv.is_finite()));
}

#[test]
fn empty_meshes_are_legal() {
    for format in FORMATS {
        for declarations in [
            "comment nothing",
            "element vertex 0",
            "element vertex 0\nproperty float x\nelement face 0\nproperty list uchar float vertex_indices",
        ] {
            let (mesh, report) = load(Writer::new(format, declarations).bytes).unwrap();
            assert!(mesh.positions.is_empty() && mesh.triangles.is_empty() && mesh.bounds().is_empty());
            assert_eq!(report, MeshReport::default());
        }
    }
}

#[test]
fn trailing_bytes_are_tolerated_and_counted() {
    for format in FORMATS {
        let mut bytes = plain(format);
        bytes.extend(b"12345");
        assert_eq!(load(bytes).unwrap().1.trailing_bytes, 5, "{format:?}");
    }
}

#[test]
fn errors_of_the_header_name_line_and_remedy() {
    let vertex = "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n";
    for (text, parts) in [
        ("", &["mesh.ply: not a PLY file", "convert"][..]),
        ("solid cube\nfacet\n", &["mesh.ply: not a PLY file", "STL", "the ending of its kind"]),
        ("ply\nformat ascii 1.0\n", &["no line `end_header`", "write or copy it again"]),
        ("ply\nelement vertex 1\n", &["mesh.ply:2: ", "no line `format`", "`format ascii 1.0`"]),
        ("ply\nend_header\n", &["mesh.ply:2: ", "no line `format`"]),
        ("ply\nformat ascii 2.0\n", &["mesh.ply:2: ", "`format NAME 1.0`"]),
        ("ply\nformat middle_endian 1.0\n", &["mesh.ply:2: ", "`binary_little_endian`"]),
        ("ply\nformat ascii 1.0\nformat ascii 1.0\n", &["mesh.ply:3: ", "one line `format` only"]),
        ("ply\nformat ascii 1.0\nelement vertex -1\n", &["mesh.ply:3: ", "whole number"]),
        ("ply\nformat ascii 1.0\nelement vertex 99999999999999999999\n", &["mesh.ply:3: ", "whole number"]),
        ("ply\nformat ascii 1.0\nproperty float x\n", &["mesh.ply:3: ", "`element` before"]),
        ("ply\nformat ascii 1.0\nelement a 1\nproperty half x\n", &["mesh.ply:4: ", "`property TYPE NAME`"]),
        ("ply\nformat ascii 1.0\nelement a 1\nproperty list float int x\n", &["mesh.ply:4: "]),
        (
            "ply\nformat ascii 1.0\nelement a 1\nelement a 1\n",
            &["mesh.ply:4: ", "element `a` is declared twice"],
        ),
        (
            "ply\nformat ascii 1.0\nelement a 1\nproperty int b\nproperty int b\n",
            &["mesh.ply:5: ", "property `b` is declared twice", "rename"],
        ),
        ("ply\nformat ascii 1.0\nwhatever\n", &["mesh.ply:3: ", "`whatever`", "`end_header`"]),
        (
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nend_header\n0 0\n",
            &["mesh.ply:3: ", "no property `z`", "x, y and z"],
        ),
        (
            &format!("ply\nformat ascii 1.0\n{vertex}element face 1\nend_header\n0 0 0\n"),
            &["mesh.ply:7: ", "no list of integers `vertex_indices`"],
        ),
        (
            &format!(
                "ply\nformat ascii 1.0\n{vertex}element tristrips 1\nproperty list int int a\nend_header\n"
            ),
            &["mesh.ply:7: ", "`tristrips`", "write the faces with one"],
        ),
    ] {
        let message = refused(text);
        assert!(parts.iter().all(|part| message.contains(part)), "{text:?}: {message}");
    }
}

#[test]
fn errors_of_ascii_bodies_name_line_and_record() {
    let good = String::from_utf8(plain(Format::Ascii)).unwrap();
    for (from, to, parts) in [
        ("3 0 1 2", "3 0 1 3", &["mesh.ply:13: face 0: corner 3 is not one of the 3 vertices"][..]),
        ("3 0 1 2", "3 0 1 -1", &["mesh.ply:13: face 0: corner -1"]),
        ("3 0 1 2", "3 0 1 1.5", &["mesh.ply:13: face 0: `1.5` is not an integer"]),
        ("3 0 1 2", "3 0 1", &["mesh.ply:13: face 0: the line ends before its 4 numbers"]),
        ("3 0 1 2", "3 0 1 2 7", &["mesh.ply:13: face 0: the line goes on after its 4 numbers"]),
        ("3 0 1 2", "-3 0 1 2", &["mesh.ply:13: face 0: a list of length -3"]),
        ("3 0 1 2", "9999999 0 1 2", &["mesh.ply:13: face 0: the line ends"]),
        ("1 0 0", "1 zero 0", &["mesh.ply:11: vertex 1: `zero` is not a number"]),
        ("1 0 0", "1 0", &["mesh.ply:11: vertex 1: the line ends before its 3 numbers"]),
        ("1 0 0 \n", "", &["mesh.ply:12: vertex 2: the line goes on"]),
        ("3 0 1 2 \n", "\n\n\n", &["face", "1 records of `face` are declared, but the file ends"]),
    ] {
        assert!(good.contains(from), "{from}");
        let message = refused(good.replacen(from, to, 1));
        assert!(parts.iter().all(|part| message.contains(part)), "{to:?}: {message}");
    }
}

#[test]
fn errors_of_binary_bodies_name_record_and_byte() {
    for format in [Format::Little, Format::Big] {
        let good = plain(format);
        let face = good.len() - 13;
        let mut bad = good.clone();
        bad[face + 9..].copy_from_slice(&[3; 4]);
        let message = refused(&bad);
        assert!(message.contains(&format!("mesh.ply: face 0 (byte {face}): corner 50529027")), "{message}");
        let message = refused(&good[..face - 5]);
        assert!(
            message.contains("vertex 2 (byte") && message.contains("exactly 5 bytes are missing"),
            "{message}"
        );
        let message = refused(&good[..face + 5]);
        assert!(message.contains("face 0 (byte") && message.contains("at least 8 bytes"), "{message}");
        let text = String::from_utf8_lossy(&good).replace("list uchar int", "list char int");
        let header = text.find("end_header\n").unwrap() + 11;
        let mut bad = [&text.as_bytes()[..header], &good[header + 1..]].concat();
        let face = bad.len() - 13;
        bad[face] = 0xff;
        let message = refused(&bad);
        assert!(message.contains("face 0") && message.contains("a list of length -1"), "{message}");
    }
}

#[test]
fn numbers_that_the_file_cannot_hold_are_refused_at_once() {
    for format in FORMATS {
        for count in ["4000000000", "4294967295", "18446744073709551615", "4294967296"] {
            let declarations =
                format!("element vertex {count}\nproperty float x\nproperty float y\nproperty float z");
            let message = refused(Writer::new(format, &declarations).bytes);
            let expected = ["are declared, but the file ends", "at most 4294967295 are possible"];
            assert!(expected.iter().any(|part| message.contains(part)), "{message}");
            let declarations = format!(
                "element a {count}\nproperty list uchar double b\nelement vertex 0\nproperty float x"
            );
            let message = refused(Writer::new(format, &declarations).bytes);
            assert!(message.contains("are declared, but the file ends"), "{message}");
        }
        // Records without properties take no memory, whatever their number.
        let nothing = "element a 18446744073709551615\nelement vertex 0";
        assert!(load(Writer::new(format, nothing).bytes).is_ok());
    }
}

#[test]
fn headers_without_end_cost_no_time() {
    let mut text = "ply\nformat ascii 1.0\nelement a 1\n".to_string();
    (0..20_000).for_each(|number| text.push_str(&format!("property int p{number}\n")));
    assert!(refused(&text).contains("more than 1000 properties"));
    let mut text = "ply\nformat ascii 1.0\n".to_string();
    (0..20_000).for_each(|number| text.push_str(&format!("element e{number} 1\n")));
    assert!(refused(&text).contains("more than 1000 elements"));
}

/// Bytes of a mesh's content.
fn size(mesh: &TriangleMesh) -> usize {
    mesh.positions.len() * 24 + mesh.triangles.len() * 12 + mesh.normals.as_ref().map_or(0, |n| n.len() * 12)
}

/// A file that is read in pieces gives the same mesh as its bytes in memory.
#[test]
fn what_is_read_piece_by_piece_is_what_is_read_as_a_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.ply");
    let many: Vec<usize> = vec![3; 60_000];
    let quads: Vec<usize> = vec![4; 30_000];
    let mut streamed = 0;
    for format in FORMATS {
        for bytes in [
            plain(format),
            rich(format),
            polygons(format, &many),
            polygons(format, &quads),
            polygons(format, &[3, 5, 2]),
        ] {
            for bytes in [bytes.clone(), [&bytes[..], b"more"].concat(), bytes[..bytes.len() - 3].to_vec()] {
                std::fs::write(&path, &bytes).unwrap();
                let file = std::fs::File::open(&path).unwrap();
                streamed +=
                    usize::from(stream::read(&file, bytes.len() as u64, &MeshReading::ALL, false).is_some());
                let whole = load(&bytes);
                match (read_ply(&path), whole) {
                    (Ok(a), Ok(b)) => assert_eq!(a, b),
                    (Err(a), Err(b)) => {
                        let tail = |error: String| error.split("mesh.ply").last().unwrap().to_owned();
                        assert_eq!(tail(a.to_string()), tail(b));
                    }
                    (a, b) => panic!("{format:?}: {a:?} and {b:?}"),
                }
                if let Ok((mesh, _)) = load(&bytes) {
                    let reading =
                        MeshReading { normals: false, uvs: false, colours: false, progress: &|_, _| true };
                    let plain = TriangleMesh { normals: None, uvs: None, ..mesh };
                    assert_eq!(read_ply_with(&path, &reading).unwrap().0, plain);
                }
            }
        }
    }
    assert!(streamed >= 12, "{streamed}");
    // Reported as stopped, and not as damaged.
    std::fs::write(&path, polygons(Format::Little, &many)).unwrap();
    let reading = MeshReading { progress: &|_, _| false, ..MeshReading::ALL };
    let message = read_ply_with(&path, &reading).unwrap_err().to_string();
    assert!(message.contains("stopped"), "{message}");
}

#[test]
fn truncation_at_every_byte_is_an_error_and_never_a_panic() {
    for format in FORMATS {
        for bytes in [plain(format), rich(format), polygons(format, &[3, 5, 2])] {
            let last_record = match format {
                // If the last number of the last line loses digits, nothing can detect it.
                Format::Ascii => {
                    bytes[..bytes.len() - 1].iter().rposition(|&byte| byte == b'\n').unwrap() + 1
                }
                _ => bytes.len(),
            };
            for length in 0..bytes.len() {
                let result = load(&bytes[..length]);
                assert!(length >= last_record || result.is_err(), "{format:?}: {length} of {}", bytes.len());
            }
        }
    }
}

#[test]
fn flipped_bytes_never_panic_nor_take_much_memory() {
    let mut state = 0x9e37_79b9_7f4a_7c15u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize
    };
    for format in FORMATS {
        let files = [plain(format), rich(format), polygons(format, &[3, 5, 2, 3, 3])];
        for round in 0..6000 {
            let mut bytes = files[round % files.len()].clone();
            for _ in 0..1 + random() % 4 {
                let at = random() % bytes.len();
                bytes[at] =
                    if random() % 4 == 0 { b"0123456789 \n-.e"[random() % 15] } else { random() as u8 };
            }
            if let Ok((mesh, _)) = load(&bytes) {
                assert!(size(&mesh) as u64 <= MEMORY_FACTOR * bytes.len() as u64);
                let count = mesh.positions.len() as u32;
                assert!(mesh.triangles.iter().flatten().all(|corner| *corner < count));
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// A mesh that is written in any format is read back unchanged.
    #[test]
    fn round_trip(
        positions in prop::collection::vec(prop::array::uniform3(-1e6f32..1e6), 3..20),
        faces in prop::collection::vec(prop::collection::vec(0u32..20, 0..7), 0..12),
        normals in any::<bool>(),
    ) {
        let count = positions.len() as u32;
        let names = if normals { vec!["x", "y", "z", "nx", "ny", "nz"] } else { vec!["x", "y", "z"] };
        let properties: String = names.iter().map(|name| format!("property float {name}\n")).collect();
        let declarations = format!(
            "element vertex {count}\n{properties}element face {}\nproperty list uchar uint vertex_indices",
            faces.len()
        );
        let mut expected = Vec::new();
        let (mut short, mut crossed) = (0, 0);
        for face in &faces {
            let corners: Vec<_> = face.iter().map(|corner| corner % count).collect();
            short += u64::from(corners.len() < 3);
            let place = |vertex: u32| glam::Vec3::from_array(positions[vertex as usize]).as_dvec3();
            let is_sound =
                crate::scene_file::polygon::triangulate_polygon(&corners, place, &mut expected);
            crossed += u64::from(!is_sound);
        }
        let points = Positions::Single(positions.clone());
        let mut report = MeshReport { short_faces: short, crossed_polygons: crossed, cloud: faces.is_empty().then_some(Cloud::Points), ..MeshReport::default() };
        drop_unusable(&mut expected, &points, &mut report);
        for format in FORMATS {
            let mut writer = Writer::new(format, &declarations);
            for position in &positions {
                let mut record: Vec<_> = position.iter().map(|&value| ("float", f64::from(value))).collect();
                if normals {
                    record.extend(record.clone());
                }
                writer.record(&record);
            }
            for face in &faces {
                let corners: Vec<_> = face.iter().map(|corner| f64::from(corner % count)).collect();
                writer.list("uchar", "uint", &corners);
            }
            let (mesh, found) = load(&writer.bytes).unwrap();
            prop_assert_eq!(&mesh.positions, &points);
            prop_assert_eq!(&mesh.triangles, &expected);
            prop_assert_eq!(&found, &report);
            let units: Vec<_> = positions.iter().map(|p| unit(Vec3::from_array(*p)).unwrap_or(Vec3::ZERO)).collect();
            prop_assert_eq!(mesh.normals, normals.then_some(units));
        }
    }
}

/// `STRUCTURE.txt`, made by an independent reader, lists the files that must load.
#[test]
fn files_of_other_programs() {
    let Some(folder) = assets().map(|assets| assets.join("malformed/magnum-ply")) else { return };
    let structure = std::fs::read_to_string(folder.join("STRUCTURE.txt")).unwrap();
    let mut seen = 0;
    for line in structure.lines() {
        let (name, verdict) = line.split_once(' ').unwrap();
        let result = read_ply(&folder.join(name));
        match verdict.trim().strip_prefix("ok") {
            // Valid, but with unusual blanks in its header.
            None if name == "whitespace.ply" => assert!(result.is_ok(), "{name}"),
            None => {
                let message = result.expect_err(name).to_string();
                assert!(message.contains(name) && message.contains("; "), "{name}: {message}");
            }
            Some(counts) => {
                let (mesh, report) = result.unwrap_or_else(|error| panic!("{error}"));
                let vertices = counts.split("('vertex', ").nth(1).unwrap().split(')').next().unwrap();
                assert_eq!(mesh.positions.len().to_string(), vertices, "{name}");
                let triangles =
                    if counts.contains("polysizes [3, 4]") { 3 } else { usize::from(vertices == "3") };
                let kept = triangles - (report.degenerate_triangles + report.non_finite_triangles) as usize;
                assert_eq!(mesh.triangles.len(), kept, "{name}: {report:?}");
                assert_eq!((report.short_faces, report.trailing_bytes), (0, 0), "{name}");
            }
        }
        seen += 1;
    }
    assert_eq!(seen, 32);
    for name in [
        "empty",
        "ply_empty_header",
        "ply_empty_bin",
        "ply_empty_ascii",
        "ply_points_bin",
        "points_emptyface",
    ] {
        let (mesh, _) = read_ply(&folder.join("../trimesh").join(name).with_extension("ply")).unwrap();
        assert!(mesh.triangles.is_empty(), "{name}");
    }
}

#[test]
fn a_globe_of_a_million_triangles() {
    let Some(path) = assets().map(|assets| assets.join("meshes/relief_globe_1.16M.ply")) else { return };
    let bytes = std::fs::read(&path).unwrap();
    let start = std::time::Instant::now();
    let (mesh, report) = parse_ply(&bytes, &path).unwrap();
    let parsed = start.elapsed();
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (582_122, 1_164_240));
    assert_eq!(report, MeshReport::default());
    let start = std::time::Instant::now();
    let normals = mesh.smooth_normals();
    println!("parsed in {parsed:?}, smooth normals in {:?}", start.elapsed());
    let outward =
        |(vertex, normal): (usize, &Vec3)| normal.dot(mesh.positions.get(vertex as u32).as_vec3()) > 0.0;
    let share =
        normals.iter().enumerate().filter(|&pair| outward(pair)).count() as f64 / normals.len() as f64;
    assert!(share > 0.9, "{share}");
}

/// A square with its corners in this order in a strip, in every format, and a second strip after a break.
#[test]
fn triangle_strips_are_read() {
    for format in FORMATS {
        let declarations = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement tristrips 1\nproperty list \
            int int vertex_indices";
        let mut writer = Writer::new(format, declarations);
        for [x, y] in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]] {
            writer.record(&[("float", x), ("float", y), ("float", 0.0)]);
        }
        writer.list("int", "int", &[0.0, 1.0, 2.0, 3.0, -1.0, 2.0, 0.0, 1.0]);
        let (mesh, report) = load(&writer.bytes).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [2, 1, 3], [2, 0, 1]], "{format:?}");
        assert_eq!(report, MeshReport::default());
    }
}

#[test]
fn a_mark_and_a_cloud() {
    let (mesh, _) = load([BYTE_ORDER_MARK, rich(Format::Little).as_slice()].concat()).unwrap();
    assert_eq!(mesh, load(rich(Format::Little)).unwrap().0);
    let cloud = |properties: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n{properties}end_header\n\
             0 0 0{}\n",
            " 0".repeat(properties.lines().count())
        )
    };
    assert_eq!(load(cloud("")).unwrap().1.cloud, Some(Cloud::Points));
    let splats = cloud("property float f_dc_0\nproperty float opacity\n");
    assert_eq!(load(splats).unwrap().1.cloud, Some(Cloud::Splats));
}

#[test]
fn looks_are_read_in_all_formats() {
    for format in FORMATS {
        let declarations = "comment TextureFile a picture.png\ncomment texturefile b.png\nelement vertex 4\nproperty float x\nproperty \
            float y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face 2\nproperty list \
            uchar int vertex_indices\nproperty list uchar float texcoord\nproperty int texnumber";
        let mut writer = Writer::new(format, declarations);
        for [x, y] in [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
            let channel = |value: f64| ("uchar", 255.0 * value);
            writer.record(&[
                ("float", x),
                ("float", y),
                ("float", 0.0),
                channel(x),
                channel(y),
                channel(1.0),
            ]);
        }
        for (number, corners) in [[0.0, 1.0, 2.0], [0.0, 2.0, 3.0]].iter().enumerate() {
            // One line in ascii.
            let uvs = [0.0, 0.0, 1.0, 0.0, 1.0, number as f64];
            writer.put("uchar", 3.0);
            corners.iter().for_each(|corner| {
                writer.put("int", *corner);
            });
            writer.put("uchar", 6.0);
            uvs.iter().for_each(|uv| {
                writer.put("float", *uv);
            });
            writer.put("int", number as f64).end();
        }
        let model = parse_ply_model(&writer.bytes, Path::new("a.ply")).unwrap();
        assert_eq!(model.textures, ["a picture.png", "b.png"], "{format:?}");
        assert_eq!(model.triangle_textures, Some(vec![0, 1]));
        // Corners with the same vertex and coordinates are merged.
        assert_eq!(model.mesh.positions.len(), 4);
        let (uvs, colours) = (model.mesh.uvs.unwrap(), model.colours.unwrap());
        let [a, b, c] = model.mesh.triangles[1].map(|vertex| vertex as usize);
        assert_eq!(
            [uvs[a], uvs[b], uvs[c]],
            [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]].map(glam::Vec2::from_array)
        );
        assert_eq!(
            [colours[a], colours[b], colours[c]],
            [[0., 0., 1.], [1., 1., 1.], [0., 1., 1.]].map(Vec3::from_array)
        );
        // A reader of the mesh alone gets the mesh without face data.
        let (plain, _) = load(&writer.bytes).unwrap();
        assert_eq!((plain.positions.len(), plain.uvs), (4, None));
    }
}
