//! What mesh files of other programs say of their surfaces is shown, or told: colours, pictures, materials, polygons with holes. Files
//! that never end, and files of other kinds, are refused at once.

use cardioid::image_io::{Image, PngPixels, read, write_png};
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

const SCENE: &str = r#"
[parameters]
mesh = "none.ply"

[camera]
eye = [0.0, 0.0, 3.0]
at = [0.0, 0.0, 0.0]
fov = 36.0

[film]
width = 40
height = 40

[materials.grey]
type = "lambert"
reflectance = 0.25

[[shapes]]
name = "model"
type = "mesh"
file = "${mesh}"
material = "grey"
materials = "file"

[[lights]]
type = "environment"
radiance = 1.0
"#;

/// Runs the program in a folder, and ends it where it does not end itself.
#[track_caller]
fn run(folder: &Path, args: &[&str]) -> (Output, Duration) {
    const LONGEST: Duration = Duration::from_secs(100);
    let start = Instant::now();
    let mut child = Command::new(env!("CARGO_BIN_EXE_cardioid"))
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .args(args)
        .spawn()
        .unwrap();
    while child.try_wait().unwrap().is_none() {
        if start.elapsed() > LONGEST {
            child.kill().unwrap();
            panic!("{args:?} does not end");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    (child.wait_with_output().unwrap(), start.elapsed())
}

fn told(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Renders a mesh, and yields the picture and what was said.
#[track_caller]
fn render(folder: &Path, mesh: &str) -> (Image, String) {
    render_scene(folder, SCENE, mesh)
}

#[track_caller]
fn render_scene(folder: &Path, scene: &str, mesh: &str) -> (Image, String) {
    fs::write(folder.join("scene.toml"), scene).unwrap();
    let set = format!("mesh={mesh}");
    let options = ["--integrator", "path", "--spp", "4", "-o", "a.exr"];
    let (output, _) = run(folder, &[&["render", "scene.toml", "--set", &set][..], &options].concat());
    let told = told(&output);
    assert!(output.status.success(), "{mesh}: {told}");
    (read(folder.join("a.exr")).unwrap(), told)
}

#[track_caller]
fn albedo(image: &Image, x: u32, y: u32) -> [f32; 3] {
    let pixel = image.layer("albedo").unwrap().pixel((y * image.width + x) as usize).unwrap();
    [pixel[0], pixel[1], pixel[2]]
}

/// The four quarters of the picture: upper left and right, lower left and right.
fn quarters(image: &Image) -> [[f32; 3]; 4] {
    [(6, 6), (33, 6), (6, 33), (33, 33)].map(|(x, y)| albedo(image, x, y))
}

#[track_caller]
fn near(found: [f32; 3], expected: [f32; 3]) {
    let far = found.iter().zip(expected).any(|(a, b)| (a - b).abs() > 0.02);
    assert!(!far, "{found:?} for {expected:?}");
}

/// A square from -1 to 1 in ascii PLY, with what is added to its vertices and faces.
fn square(comments: &str, vertex: &str, values: [&str; 4], face: &str, of_face: &str) -> String {
    let [a, b, c, d] = values;
    format!(
        "ply\nformat ascii 1.0\n{comments}element vertex 4\nproperty float x\nproperty float y\nproperty float z\n{vertex}element face \
         1\nproperty list uchar int vertex_indices\n{face}end_header\n-1 -1 0 {a}\n1 -1 0 {b}\n1 1 0 {c}\n-1 1 0 {d}\n4 0 1 2 3 {of_face}\n"
    )
}

/// Red and green above, blue and white below, each of eight by eight texels.
fn four_fields(path: &Path) {
    let field = |x: usize, y: usize| FIELDS[2 * (y / 8) + x / 8].map(|channel| 255 * channel as u8);
    let texels: Vec<u8> = (0..16).flat_map(|y| (0..16).flat_map(move |x| field(x, y))).collect();
    write_png(path, 16, 16, PngPixels::Rgb8(&texels)).unwrap();
}

const FIELDS: [[f32; 3]; 4] = [[1., 0., 0.], [0., 1., 0.], [0., 0., 1.], [1., 1., 1.]];

#[test]
fn colours_of_vertices_and_faces_are_the_reflectance() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let properties =
        |kind: &str| format!("property {kind} red\nproperty {kind} green\nproperty {kind} blue\n");
    // sRGB of 0.5029, 0.2140 and 0.
    let bytes = square("", &properties("uchar"), ["188 128 0"; 4], "", "");
    let floats = square("", &properties("float"), ["0.7373 0.50196 0"; 4], "", "");
    let face = square("", "", [""; 4], &properties("uchar"), "188 128 0");
    let vertex = |at: &str| format!("v {at} 0 0.7373 0.50196 0\n");
    let obj = ["-1 -1", "1 -1", "1 1", "-1 1"].map(vertex).concat() + "f 1 2 3 4\n";
    for (name, text) in [("bytes.ply", &bytes), ("floats.ply", &floats), ("face.ply", &face), ("a.obj", &obj)]
    {
        fs::write(folder.join(name), text).unwrap();
        let (image, told) = render(folder, name);
        near(albedo(&image, 20, 20), [0.5029, 0.2140, 0.0]);
        assert!(!told.contains("warning"), "{name}: {told}");
        // Not where the scene says what the mesh is made of.
        let with_material = SCENE.replace("materials = \"file\"", "");
        let (image, _) = render_scene(folder, &with_material, name);
        near(albedo(&image, 20, 20), [0.25; 3]);
    }
}

#[test]
fn pictures_of_ply_files_lie_as_they_were_meant_to() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    four_fields(&folder.join("four fields.png"));
    let comment = "comment TextureFile four fields.png\n";
    let corners = ["0 0", "1 0", "1 1", "0 1"];
    let by_vertex = square(comment, "property float s\nproperty float t\n", corners, "", "");
    let by_corner = square(comment, "", [""; 4], "property list uchar float texcoord\n", "8 0 0 1 0 1 1 0 1");
    for (name, text) in [("vertex.ply", &by_vertex), ("corner.ply", &by_corner)] {
        fs::write(folder.join(name), text).unwrap();
        let (image, told) = render(folder, name);
        quarters(&image).into_iter().zip(FIELDS).for_each(|(found, expected)| near(found, expected));
        assert!(!told.contains("warning"), "{name}: {told}");
    }
    fs::write(folder.join("none.ply"), by_vertex.replace("four fields", "gone")).unwrap();
    let (_, told) = render(folder, "none.ply");
    assert!(told.contains("gone.png") && told.contains("not used"), "{told}");
    fs::write(folder.join("bare.ply"), square(comment, "", [""; 4], "", "")).unwrap();
    let (_, told) = render(folder, "bare.ply");
    assert!(told.contains("no texture coordinates"), "{told}");
}

const SQUARE: &str = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";
const RED: &str = "newmtl red\nKd 0.8 0.1 0.1\n";

#[test]
fn libraries_and_texts_of_all_systems_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("other.mtl"), "newmtl other\nKd 0 0 1\n").unwrap();
    fs::write(folder.join("red.mtl"), RED).unwrap();
    fs::write(folder.join("spaced name.mtl"), RED).unwrap();
    fs::write(folder.join("marked.mtl"), format!("\u{feff}{RED}")).unwrap();
    fs::write(folder.join("returns.mtl"), RED.replace('\n', "\r")).unwrap();
    fs::write(folder.join("loud.mtl"), RED.to_uppercase().replace("RED", "red")).unwrap();
    fs::write(folder.join("open.mtl"), RED.trim_end()).unwrap();
    let obj = |libraries: &str| format!("mtllib {libraries}\n{SQUARE}usemtl red\nf 1/1 2/2 3/3 4/4\n");
    let is_red = |text: &[u8], what: &str| {
        fs::write(folder.join("a.obj"), text).unwrap();
        let (image, told) = render(folder, "a.obj");
        near(albedo(&image, 20, 20), [0.8, 0.1, 0.1]);
        assert!(!told.contains("warning"), "{what}: {told}");
    };
    for libraries in
        ["other.mtl red.mtl", "spaced name.mtl", "marked.mtl", "returns.mtl", "loud.mtl", "open.mtl"]
    {
        is_red(obj(libraries).as_bytes(), libraries);
    }
    is_red(format!("\u{feff}{}", obj("red.mtl")).as_bytes(), "a mark");
    is_red(obj("red.mtl").replace('\n', "\r").as_bytes(), "carriage returns");
    let wide: Vec<u8> = "\u{feff}v 0 0 0\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    for name in ["wide.obj", "wide.ply", "wide.stl", "wide.toml"] {
        fs::write(folder.join(name), &wide).unwrap();
        let (output, _) = run(folder, &["info", name]);
        let told = told(&output);
        assert!(
            !output.status.success() && told.contains("UTF-16") && told.contains("UTF-8"),
            "{name}: {told}"
        );
    }
}

#[test]
fn opaque_is_opaque_whoever_wrote_it_and_cut_outs_are_cut() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    four_fields(&folder.join("pic.png"));
    // The left half is there.
    let half: Vec<u8> = (0..16).flat_map(|x| [if x < 8 { 255 } else { 0 }; 3]).collect();
    write_png(folder.join("half.png"), 16, 1, PngPixels::Rgb8(&half)).unwrap();
    fs::write(folder.join("a.obj"), format!("mtllib a.mtl\n{SQUARE}usemtl t\nf 1/1 2/2 3/3 4/4\n")).unwrap();
    let look = |mtl: &str| {
        fs::write(folder.join("a.mtl"), format!("newmtl t\nKd 1 1 1\nKs 0 0 0\nillum 1\n{mtl}\n")).unwrap();
        render(folder, "a.obj")
    };
    for (mtl, note) in [
        ("Tr 1.000000\nmap_Kd pic.png", "a.mtl:5: `Tr 1`"),
        ("d 1.0\nTr 1.0\nmap_Kd pic.png", "a.mtl:6: `Tr 1`"),
        ("d 0.0\nmap_Kd pic.png", "a.mtl:5: `d 0`"),
        ("d 1.0\nTr 0.0\nmap_Kd pic.png", ""),
        ("Kd 0 0 0\nmap_Kd pic.png", "a.mtl:5: `Kd 0 0 0`"),
        ("map_Kd PIC.PNG", "PIC.PNG"),
        ("map_Kd C:\\Users\\artist\\Desktop\\pic.png", "is not where it is named"),
        ("map_Kd -mm 0 2 -bm 0.5 pic.png", "`map_Kd -mm`"),
    ] {
        let (image, told) = look(mtl);
        near(albedo(&image, 6, 6), [1.0, 0.0, 0.0]);
        assert!(told.contains(note) && (!note.is_empty() || !told.contains("warning")), "{mtl}: {told}");
    }
    let (image, told) = look("map_d half.png");
    near(albedo(&image, 4, 20), [1.0; 3]);
    near(albedo(&image, 35, 20), [0.0; 3]);
    assert!(!told.contains("warning"), "{told}");
    let (image, _) = look("Kd 0.9 0.7 0.2\nPm 0\nPr 0.3");
    let found = albedo(&image, 20, 20);
    assert!(found[0] > 0.8 && found[0] > 3.0 * found[2], "{found:?}");
}

#[test]
fn a_window_is_open() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let outline = "f 1 2 3 4 1 5 8 7 6 5\n";
    let corners = |text: &str| {
        ["-0.9 -0.9", "0.9 -0.9", "0.9 0.9", "-0.9 0.9", "-0.4 -0.4", "0.4 -0.4", "0.4 0.4", "-0.4 0.4"]
            .map(|at| format!("{text}{at} 0\n"))
            .concat()
    };
    fs::write(folder.join("window.obj"), corners("v ") + outline).unwrap();
    let ply = format!(
        "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list \
         uchar int vertex_indices\nend_header\n{}10 0 1 2 3 0 4 7 6 5 4\n",
        corners("")
    );
    fs::write(folder.join("window.ply"), ply).unwrap();
    for name in ["window.obj", "window.ply"] {
        let (image, told) = render(folder, name);
        near(albedo(&image, 20, 20), [0.0; 3]);
        for (x, y) in [(6, 6), (20, 6), (33, 20), (20, 33), (6, 20)] {
            assert!(albedo(&image, x, y)[0] > 0.2, "{name} at {x}, {y}");
        }
        assert!(!told.contains("warning"), "{name}: {told}");
    }
}

#[test]
fn what_never_ends_is_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    assert!(Command::new("mkfifo").arg(folder.join("pipe")).status().unwrap().success());
    for name in ["pipe.toml", "pipe.ply", "pipe.obj", "pipe.glb", "pipe.exr", "pipe.hdr"] {
        std::os::unix::fs::symlink(folder.join("pipe"), folder.join(name)).unwrap();
    }
    // Not read, but told.
    for library in ["/dev/zero", "pipe"] {
        fs::write(folder.join("a.obj"), format!("mtllib {library}\n{SQUARE}usemtl a\nf 1 2 3 4\n")).unwrap();
        let (output, _) = run(folder, &["info", "a.obj"]);
        assert!(told(&output).contains("not a regular file"), "{library}: {}", told(&output));
    }
    for picture in ["/dev/zero", "pipe"] {
        fs::write(folder.join("b.mtl"), format!("newmtl a\nmap_Kd {picture}\n")).unwrap();
        fs::write(folder.join("b.obj"), format!("mtllib b.mtl\n{SQUARE}usemtl a\nf 1/1 2/2 3/3 4/4\n"))
            .unwrap();
        let (output, _) = run(folder, &["info", "b.obj"]);
        assert!(told(&output).contains("not a regular file"), "{picture}: {}", told(&output));
    }
    let sphere = "[materials.grey]\ntype = \"lambert\"\nreflectance = 0.5\n[[shapes]]\ntype = \"sphere\"\nradius = 1.0\nmaterial = \"grey\"\n";
    let light = "[[lights]]\ntype = \"environment\"\nimage = \"pipe.hdr\"\n";
    fs::write(folder.join("sky.toml"), format!("{sphere}{light}")).unwrap();
    let ies = "[[lights]]\ntype = \"ies\"\nfile = \"pipe\"\nposition = [0, 3, 0]\n";
    fs::write(folder.join("ies.toml"), format!("{sphere}{ies}")).unwrap();
    fs::write(
        folder.join("mesh.toml"),
        sphere.replace("type = \"sphere\"\nradius = 1.0", "type = \"mesh\"\nfile = \"pipe.ply\""),
    )
    .unwrap();
    fs::write(folder.join("plain.toml"), sphere).unwrap();
    for args in [
        &["info", "pipe.toml"][..],
        &["info", "pipe.ply"],
        &["info", "pipe.obj"],
        &["info", "pipe.glb"],
        &["info", "sky.toml"],
        &["info", "ies.toml"],
        &["info", "mesh.toml"],
        &["compare", "pipe.exr", "pipe.exr"],
        &["render", "plain.toml", "--photon-map", "pipe"],
        &[
            "render",
            "plain.toml",
            "--integrator",
            "progressive",
            "--resume",
            "pipe",
            "--resolution",
            "8x8",
            "-o",
            "c.png",
        ],
        &["probe", "plain.toml", "--points", "pipe"],
        &["render", "/dev/zero"],
    ] {
        let (output, _) = run(folder, args);
        let told = told(&output);
        assert!(!output.status.success() && told.contains("not a regular file"), "{args:?}: {told}");
    }
}

#[test]
fn files_of_other_kinds_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let cloud = |properties: &str, values: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n{properties}end_header\n0 0 \
             0{values}\n"
        )
    };
    let splats = cloud("property float f_dc_0\nproperty float scale_0\nproperty float rot_0\n", " 0 0 0");
    for (name, bytes, parts) in [
        ("a.fbx", &b"Kaydara FBX Binary  \0\x1a\0\x17\x1d\0\0"[..], ["an FBX file", "glTF"]),
        ("a.usdz", b"PK\x03\x04\x0a\0\0\0\0\0", ["a USD archive", "glTF"]),
        ("a.usd", b"#usda 1.0\n", ["a USD file", "glTF"]),
        ("a.ply.gz", b"\x1f\x8b\x08\0\0\0\0\0\0\x03", ["gzip", "gunzip"]),
        ("packed.ply", b"\x1f\x8b\x08\0\0\0\0\0\0\x03", ["gzip", "gunzip"]),
        ("packed.obj", b"\x1f\x8b\x08\0\0\0\0\0\0\x03", ["gzip", "gunzip"]),
        ("packed.stl", b"\x1f\x8b\x08\0\0\0\0\0\0\x03", ["gzip", "gunzip"]),
        ("a.zip", b"PK\x03\x04\x0a\0\0\0\0\0", ["a ZIP archive", "unpack"]),
        ("a.blend", b"BLENDER-v405REND\0\0", ["a Blender file", "glTF"]),
        ("a.3ds", b"MM\x10\0\0\0\x02\0", ["a 3D Studio file", "glTF"]),
        ("a.dae", b"<?xml version=\"1.0\"?><COLLADA>", ["a COLLADA file", "glTF"]),
        ("a.step", b"ISO-10303-21;\nHEADER;\n", ["a STEP file", "mesh"]),
        ("a.scene", b"<scene version=\"3.0.0\">\n</scene>", ["Mitsuba", ".xml"]),
        ("b.scene", b"LookAt 0 0 5 0 0 0 0 1 0\nWorldBegin\n", ["pbrt", ".pbrt"]),
        ("a.dat", b"\0\x01\x02\x03\xff", ["a binary file", "TOML"]),
        ("photo.png", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", ["a picture", "scene"]),
        ("points.ply", cloud("", "").as_bytes(), ["a point cloud", "make a mesh"]),
        ("splats.ply", splats.as_bytes(), ["Gaussian splats", "mesh"]),
        ("points.obj", b"v 0 0 0\nv 1 0 0\np 1 2\n", ["no faces", "export"]),
    ] {
        fs::write(folder.join(name), bytes).unwrap();
        let (output, _) = run(folder, &["info", name]);
        let told = told(&output);
        assert!(output.status.code() == Some(1) && told.contains(name), "{name}: {told}");
        assert!(parts.iter().all(|part| told.contains(part)), "{name}: {told}");
        assert!(told.lines().count() <= 3 && !told.contains('\0'), "{name}: {told}");
    }
    fs::write(folder.join("scene.toml"), "[[shapes]]\ntype = \"mesh\"\nfile = \"a.fbx\"\n").unwrap();
    let (output, _) = run(folder, &["info", "scene.toml"]);
    assert!(told(&output).contains("an FBX file"), "{}", told(&output));
}

/// Pixels of a Radiance file of 3 by 2: red is 1 to 6 by rows from the top, green twice and blue half of it.
#[test]
fn radiance_pictures_are_as_bright_and_as_upright_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.hdr");
    let write = |variables: &str, resolution: &str, order: [u8; 6]| {
        let mut bytes =
            format!("#?RADIANCE\n{variables}FORMAT=32-bit_rle_rgbe\n\n{resolution}\n").into_bytes();
        // Mantissas of 8 bits: 16 n, with an exponent that makes them n.
        bytes.extend(order.into_iter().flat_map(|n| [16 * n, 32 * n, 8 * n, 128 + 4]));
        fs::write(&path, bytes).unwrap();
        let image = read(&path).unwrap();
        let pixels: Vec<[f32; 3]> =
            image.layers[0].data.chunks_exact(3).map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
        (image, pixels)
    };
    let (plain, expected) = write("", "-Y 2 +X 3", [1, 2, 3, 4, 5, 6]);
    assert_eq!((plain.width, plain.height, plain.findings.len()), (3, 2, 0));
    let ratio = expected[5][0] / expected[0][0];
    assert!((5.0..7.0).contains(&ratio) && expected[0][1] > 1.5 * expected[0][0], "{expected:?}");
    for (resolution, order) in [
        ("+Y 2 +X 3", [4, 5, 6, 1, 2, 3]),
        ("-Y 2 -X 3", [3, 2, 1, 6, 5, 4]),
        ("+X 3 -Y 2", [1, 4, 2, 5, 3, 6]),
        ("-X 3 +Y 2", [6, 3, 5, 2, 4, 1]),
    ] {
        let (image, pixels) = write("", resolution, order);
        assert_eq!((image.width, image.height), (3, 2), "{resolution}");
        assert_eq!(pixels, expected, "{resolution}");
    }
    let (_, pixels) = write("EXPOSURE=4\nEXPOSURE=0.5\n", "-Y 2 +X 3", [1, 2, 3, 4, 5, 6]);
    assert_eq!(pixels[5][0], expected[5][0] / 2.0);
    let (image, pixels) =
        write("COLORCORR=1 2 1\nPRIMARIES=0.7 0.3 0.2 0.7 0.1 0.1 0.3 0.3\n", "-Y 2 +X 3", [1; 6]);
    assert_eq!(pixels[0][1], expected[0][1] / 2.0);
    assert_eq!(image.findings.len(), 2, "{:?}", image.findings);
    fs::write(&path, "#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n1234").unwrap();
    assert!(read(&path).unwrap_err().to_string().contains("CIE XYZ"));
}

#[test]
fn a_dash_is_standard_output_for_texts_alone() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let scene = SCENE.replace("type = \"mesh\"\nfile = \"${mesh}\"", "type = \"sphere\"\nradius = 0.5");
    let scene = scene.replace("materials = \"file\"", "").replace("[parameters]\nmesh = \"none.ply\"", "");
    fs::write(folder.join("a.toml"), scene).unwrap();
    let options = ["--quality", "draft", "--global-photons", "500", "--resolution", "8x8", "--spp", "1"];
    let (output, _) =
        run(folder, &[&["render", "a.toml", "-o", "a.png", "--stats", "-"][..], &options].concat());
    assert!(output.status.success(), "{}", told(&output));
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.starts_with('{') && text.trim_end().ends_with('}'), "{text}");
    let probe =
        ["probe", "a.toml", "--from", "0,0.5,0", "--samples", "4", "--global-photons", "500", "-o", "-"];
    let (output, _) = run(folder, &probe);
    assert!(output.status.success() && !output.stdout.is_empty(), "{}", told(&output));
    for args in [
        &["photons", "a.toml", "-o", "-"][..],
        &["render", "a.toml", "--integrator", "progressive", "--checkpoint", "-"],
        &["render", "a.toml", "-o", "-"],
    ] {
        let (output, _) = run(folder, args);
        assert_eq!(output.status.code(), Some(1), "{args:?}: {}", told(&output));
    }
    assert!(!folder.join("-").exists());
}
