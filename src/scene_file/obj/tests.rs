//! Tests of the OBJ reader.

use super::*;

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

fn parse(text: &str) -> Result<ObjFile, String> {
    parse_obj(text.as_bytes(), &MeshReading::ALL, |_| true)
        .map_err(|(place, problem)| format!("x.obj{place}: {problem}"))
}

#[test]
fn faces_normals_and_materials() {
    let text = format!(
        "# made by hand\nmtllib a b.mtl\n{SQUARE}vt 0 0\nvn 0 0 2\nf 1//1 2//1 \\\n 3//1\nusemtl red\nf -4 -2/1 -1/-1/1 # back\n\
         usemtl blue\nf 1 2 3 4\nusemtl red\nf 1 2 4\nl 1 2\nf 1 2\nf 1 1 2\n"
    );
    let obj = parse(&text).unwrap();
    assert_eq!(obj.libraries, [(PathBuf::from("a b.mtl"), 2)]);
    let parts: Vec<_> =
        obj.parts.iter().map(|part| (part.material.as_deref(), part.triangles.len())).collect();
    assert_eq!(parts, [(None, 1), (Some("red"), 2), (Some("blue"), 2)]);
    assert_eq!(
        (obj.report.short_faces, obj.report.degenerate_triangles, obj.report.other_elements),
        (1, 1, 1)
    );
    // A position with and without a normal or a coordinate makes two vertices.
    assert_eq!(obj.positions.len(), 3 + 4 + 2);
    let normals = obj.normals.as_ref().unwrap();
    assert_eq!(obj.parts[0].triangles[0].map(|v| normals[v as usize]), [Vec3::Z; 3]);
    let meshes = obj.clone().into_meshes();
    assert_eq!(meshes[1].mesh.positions.len(), 5);
    for (ObjMesh { mesh, .. }, part) in meshes.iter().zip(&obj.parts) {
        for (own, whole) in mesh.triangles.iter().zip(&part.triangles) {
            assert_eq!(mesh.positions.corners(*own), obj.positions.corners(*whole));
        }
    }
    assert_eq!(obj.into_mesh().0.triangles.len(), 5);
}

#[test]
fn what_is_wrong_is_told_with_its_line() {
    for (text, parts) in [
        (format!("{SQUARE}f 1 2 5"), [":5:", "5 is not one of the 4 vertices"]),
        (format!("{SQUARE}f 0 1 2"), [":5:", "0 is not one of the 4 vertices"]),
        (format!("{SQUARE}f -5 1 2"), [":5:", "-5 is not one"]),
        (format!("{SQUARE}f 1/1 2 3"), [":5:", "1 is not one of the 0 texture coordinates"]),
        (format!("{SQUARE}f 1//2 2 3"), [":5:", "2 is not one of the 0 normals"]),
        (format!("{SQUARE}f 1 2 x"), [":5:", "`x` is not a number"]),
        (format!("{SQUARE}f 1 2 99999999999999999999"), [":5:", "is not a number"]),
        ("v 0 0".to_owned(), [":1:", "ends before z"]),
        ("v 0 0 zero".to_owned(), [":1:", "`zero`"]),
    ] {
        let message = parse(&text).unwrap_err();
        assert!(parts.iter().all(|part| message.contains(part)), "{text}: {message}");
    }
}

#[test]
fn empty_nan_and_cut_files() {
    assert!(parse("").unwrap().into_mesh().0.triangles.is_empty());
    let (mesh, report) = parse("v nan 0 0\nv 1.#IND 0 0\nv 0 1 0\nf 1 2 3").unwrap().into_mesh();
    assert_eq!((mesh.triangles.len(), report.non_finite_triangles), (0, 1));
    let text = format!("{SQUARE}vn 0 0 1\nusemtl a\nf 1//1 2//1 3//1\nf 1//1 3//1 4//1\n");
    for sixteenth in 0..=16 {
        // Either a mesh of the complete statements, or an error.
        match parse(&text[..text.len() * sixteenth / 16]) {
            Ok(obj) => assert!(obj.into_mesh().0.triangles.len() <= 2),
            Err(message) => assert!(message.contains("again"), "{message}"),
        }
    }
}

#[test]
fn materials_become_the_nearest() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mtl");
    let text = "Kd 1 1 1\nnewmtl matt\nKd 0.2 0.4 0.6\nnewmtl shiny\nKd 0.5 0.5 0.5\nKs 0.3\nNs 198\nillum 2\n\
        newmtl glass\nd 0.1\nNi 1.33\nnewmtl mirror\nKd 0 0 0\nKs 0.9 0.9 0.9\nillum 3\nnewmtl loud\nKd 1 1 1\nKs 1 1 1\n";
    std::fs::write(&path, text).unwrap();
    let materials = read_mtl(&path).unwrap();
    let finish = |name: &str| materials.iter().find(|material| material.name == name).unwrap().finish;
    assert_eq!(finish("matt"), MtlFinish::Lambert(Vec3::new(0.2, 0.4, 0.6)));
    assert_eq!(
        finish("shiny"),
        MtlFinish::Ward { diffuse: Vec3::splat(0.5), gloss: Vec3::splat(0.3), roughness: 0.1 }
    );
    assert_eq!(finish("glass"), MtlFinish::Glass(1.33));
    assert_eq!(finish("mirror"), MtlFinish::Mirror(Vec3::splat(0.9)));
    assert_eq!(
        finish("loud"),
        MtlFinish::Ward { diffuse: Vec3::splat(0.5), gloss: Vec3::splat(0.5), roughness: 1.0 }
    );
    std::fs::write(&path, "newmtl a\nKd 1 x 1").unwrap();
    let message = read_mtl(&path).unwrap_err().to_string();
    assert!(message.contains("a.mtl:2: `x`"), "{message}");
}

#[test]
fn pictures_light_and_what_is_not_read() {
    let text = "newmtl a\nKe 1 2 3\nmap_Kd -s 2 3 1 -o 0.5 -blendu off -mm 0 1 -clamp on maps\\bark 1.png\nmap_Ka x.png\n\
        map_Bump -bm 0.2 b.png\nnorm n.png\nKa 1 1 1\nnewmtl b\nmap_Kd 2.png\n";
    let materials = parse_mtl_bytes(text.as_bytes(), Path::new("a.mtl")).unwrap();
    let picture = MtlPicture {
        file: PathBuf::from("maps/bark 1.png"),
        scale: Vec2::new(2.0, 3.0),
        offset: Vec2::new(0.5, 0.0),
        clamped: true,
    };
    assert_eq!(materials[0].picture.as_ref(), Some(&picture));
    assert_eq!(materials[0].emission, Vec3::new(1.0, 2.0, 3.0));
    assert_eq!(materials[0].unread, [("map_Bump".to_owned(), 5), ("norm".to_owned(), 6)]);
    assert_eq!(materials[1].picture.as_ref().unwrap().file, PathBuf::from("2.png"));
    assert!(materials[1].unread.is_empty());
    for empty in ["newmtl a\nmap_Kd\n", "newmtl a\nmap_Kd -s 1 1 1\n"] {
        let message = parse_mtl_bytes(empty.as_bytes(), Path::new("a.mtl")).unwrap_err().to_string();
        assert!(message.contains("a.mtl:2: no picture"), "{message}");
    }
}

#[test]
fn coordinates_are_kept_where_they_are_wanted() {
    let text = format!("{SQUARE}mtllib m.mtl\nvt 0 0\nvt 1\nvt 0.5 nan\nf 1/1 2/2 3/3\nf 1/2 3/3 4\n");
    let obj = parse(&text).unwrap();
    let uvs = obj.uvs.as_ref().unwrap();
    let corners: Vec<_> = obj.parts[0].triangles.iter().map(|t| t.map(|v| uvs[v as usize])).collect();
    let (zero, one) = (Vec2::ZERO, Vec2::X);
    assert_eq!(corners, [[zero, one, zero], [one, zero, zero]]);
    // The first position has two coordinates and becomes two vertices.
    assert_eq!(obj.positions.len(), 5);
    let plain = parse_obj(text.as_bytes(), &MeshReading::ALL, |libraries| {
        assert_eq!(libraries, [(PathBuf::from("m.mtl"), 5)]);
        false
    });
    let plain = plain.unwrap();
    assert_eq!((plain.positions.len(), plain.uvs), (4, None));
}

#[test]
fn colours_after_positions_are_read() {
    let text = "v 0 0 0 1 0 0\nv 1 0 0 1 0 0.5\nv 1 1 0 0.2\nv 0 1 0 0 0 1 0.5\nf 1 2 3 4\n";
    let obj = parse(text).unwrap();
    let colours = obj.colours.unwrap();
    // A single number is a weight, a fourth is alpha.
    assert_eq!((colours[0], colours[2], colours[3]), (Vec3::X, Vec3::ONE, Vec3::Z));
    assert!((colours[1].z - 0.214).abs() < 1e-3);
    assert_eq!(obj.report.colourless_vertices, 1);
    assert_eq!(parse(&text.replace("1 0 0.5", "255 0 127.5")).unwrap().colours.unwrap()[1], colours[1]);
    assert_eq!(parse(SQUARE).unwrap().colours, None);
    assert_eq!(parse("v 0 0 0 # 1 0 0\nv 1 0 0 red\nv 0 1 0\nf 1 2 3\n").unwrap().colours, None);
}

#[test]
fn statements_of_all_writers_are_read_or_told() {
    let of = |text: &str| {
        parse_mtl_bytes(format!("newmtl a\n{text}").as_bytes(), Path::new("a.mtl")).unwrap().remove(0)
    };
    let opaque = MtlFinish::Lambert(Vec3::splat(0.8));
    for (text, finish, lines) in [
        ("Tr 1", opaque, &[2][..]),
        ("Tr 0", opaque, &[]),
        ("d 1\nTr 1", opaque, &[3]),
        ("d 1\nTr 0.2", opaque, &[3]),
        ("d 0.7", opaque, &[2]),
        ("d 0\nmap_Kd a.png", opaque, &[2]),
        ("d 0\nTr 1", MtlFinish::Glass(1.5), &[]),
        ("Tr 0.9\nNi 1.33", MtlFinish::Glass(1.33), &[]),
        ("d 0.9\nillum 9", MtlFinish::Glass(1.5), &[]),
        ("KD 0.8", opaque, &[]),
        ("Kd 0 0 0\nmap_Kd a.png", MtlFinish::Lambert(Vec3::ONE), &[2]),
        (
            "Kd 1 1 1\nPm 1\nPr 0.3",
            MtlFinish::Metallic {
                base: Vec3::ONE,
                metallic: 1.0,
                roughness: 0.3,
                coat: 0.0,
                coat_roughness: 0.0,
            },
            &[],
        ),
    ] {
        let material = of(text);
        assert_eq!(material.finish, finish, "{text}");
        assert_eq!(material.notes.iter().map(|(_, line)| *line).collect::<Vec<_>>(), lines, "{text}");
        assert!(material.unread.is_empty(), "{text}: {:?}", material.unread);
    }
    for (text, unread) in [
        ("d 0.1\nTf 1 0.3 0.3", &["Tf"][..]),
        ("Tf 1 0.3 0.3", &[]),
        ("d 0.1\nTf 1 1 1", &[]),
        ("Ps 0\naniso 0\nsharpness 60\n# note", &[]),
        ("Ps 0.5\nmap_Pr r.png\nKd xyz 1 1 1\nfancy 1", &["Ps", "map_Pr", "Kd", "fancy"]),
        ("map_Kd -imfchan r -mm 0 2 -bm 0.3 -t 0 0 0 a.png", &["map_Kd -mm", "map_Kd -imfchan"]),
    ] {
        let mut found: Vec<_> = of(text).unread.into_iter().map(|(keyword, _)| keyword).collect();
        found.sort_by_key(|keyword| unread.iter().position(|other| other == keyword));
        assert_eq!(found, unread, "{text}");
    }
    assert_eq!(of("map_d leaf.png").cutout.unwrap().file, PathBuf::from("leaf.png"));
}
