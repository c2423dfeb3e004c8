//! OBJ files with materials: pictures lie as they were meant to, light shines, and what is not read is told.

use cardioid::image_io::{Image, PngPixels, read, write_png};
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

const SCENE: &str = r#"
[camera]
eye = [0.0, 0.0, 3.0]
at = [0.0, 0.0, 0.0]
fov = 36.0

[film]
width = 40
height = 40

[materials.grey]
type = "lambert"
reflectance = 0.5

[[shapes]]
name = "model"
type = "mesh"
file = "model.obj"
materials = "file"
material = "grey"

[[lights]]
type = "environment"
radiance = 1.0
"#;

/// Renders the model in `folder`, and yields the picture and what was said.
fn render(folder: &Path, obj: &str, mtl: &str) -> (Image, String) {
    render_with(folder, obj, mtl, &[])
}

fn render_with(folder: &Path, obj: &str, mtl: &str, options: &[&str]) -> (Image, String) {
    fs::write(folder.join("scene.toml"), SCENE).unwrap();
    fs::write(folder.join("model.obj"), obj).unwrap();
    fs::write(folder.join("model.mtl"), mtl).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_cardioid"))
        .current_dir(folder)
        .stdin(Stdio::null())
        .args(["render", "scene.toml", "--quality", "draft", "--global-photons", "1000", "-o", "a.exr"])
        .args(options)
        .output()
        .unwrap();
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{told}");
    (read(folder.join("a.exr")).unwrap(), told)
}

fn pixel(image: &Image, layer: &str, x: u32, y: u32) -> [f32; 3] {
    let pixel = image.layer(layer).unwrap().pixel((y * image.width + x) as usize).unwrap();
    [pixel[0], pixel[1], pixel[2]]
}

#[test]
fn pictures_lie_as_they_were_meant_to() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::create_dir(folder.join("maps")).unwrap();
    // Red and green above, blue and white below.
    let texels = [255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255];
    write_png(folder.join("maps/four fields.png"), 2, 2, PngPixels::Rgb8(&texels)).unwrap();
    let obj = "mtllib model.mtl\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n\
        usemtl painted\nf 1/1/1 2/2/1 3/3/1 4/4/1\n";
    let mtl = |options: &str, ks: &str| {
        format!("newmtl painted\nKd 0.5 0.5 0.5\n{ks}map_Kd {options}maps\\four fields.png\nbump b.png\n")
    };
    let corners =
        |image: &Image| [(6, 6), (33, 6), (6, 33), (33, 33)].map(|(x, y)| pixel(image, "albedo", x, y));
    let within = |a: [[f32; 3]; 4], b: [[f32; 3]; 4], most: f32| {
        a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| (a - b).abs() < most)
    };
    let near = |a, b| within(a, b, 0.02);
    let (red, green, blue, white) = ([0.5, 0., 0.], [0., 0.5, 0.], [0., 0., 0.5], [0.5; 3]);
    let (image, told) = render(folder, obj, &mtl("-clamp on ", ""));
    assert!(near(corners(&image), [red, green, blue, white]), "{:?}", corners(&image));
    assert!(told.contains("model.mtl:4: `bump` is not read"), "{told}");
    // Half a picture further to the right, where fields fade into those of the next copy.
    let (image, _) = render(folder, obj, &mtl("-o 0.5 0 0 ", ""));
    assert!(within(corners(&image), [green, red, white, blue], 0.15), "{:?}", corners(&image));
    // Under a gloss the same, and what that reflects.
    let (image, _) = render(folder, obj, &mtl("-clamp on ", "Ks 0.1 0.1 0.1\nNs 50\n"));
    let [glossy, ..] = corners(&image);
    assert!(glossy[0] > 0.45 && (0.05..0.2).contains(&glossy[1]) && glossy[1] == glossy[2], "{glossy:?}");
    // Faces that cannot show it are told.
    let bare = obj.replace("1/1/1 2/2/1 3/3/1 4/4/1", "1 2 3 4");
    let (image, told) = render(folder, &bare, &mtl("", ""));
    assert!(near(corners(&image), [white; 4]), "{:?}", corners(&image));
    assert!(told.contains("`painted` is not used") && told.contains("no texture coordinates"), "{told}");
    let (_, told) = render(folder, &format!("{obj}f 1 2 3\n"), &mtl("", ""));
    assert!(told.contains("of one colour, that of its corner, on 1 of 2 faces"), "{told}");
    let (_, told) = render(folder, obj, &mtl("", "d 0.2\nNi 1.5\n"));
    assert!(told.contains("`painted` is not used: glass and mirrors"), "{told}");
    // A picture that is missing is told, and the rest of the material stays.
    fs::remove_dir_all(folder.join("maps")).unwrap();
    let (image, told) = render(folder, obj, &mtl("", ""));
    assert!(near(corners(&image), [white; 4]), "{:?}", corners(&image));
    assert!(told.contains("picture of `painted` is not used") && told.contains("four fields.png"), "{told}");
}

#[test]
fn pictures_beyond_the_memory_for_them_change_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let texels: Vec<u8> =
        (0..300 * 200 * 3u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    write_png(folder.join("noise.png"), 300, 200, PngPixels::Rgb8(&texels)).unwrap();
    let obj = "mtllib model.mtl\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 3 0\nvt 3 2\nvt 0 2\n\
        usemtl painted\nf 1/1 2/2 3/3 4/4\n";
    let mtl = "newmtl painted\nKd 0.5 0.5 0.5\nmap_Kd noise.png\n";
    let (whole, _) = render(folder, obj, mtl);
    let (tiled, told) = render_with(folder, obj, mtl, &["--texture-memory", "1kB"]);
    assert_eq!(told.matches("warning").count(), 0, "{told}");
    let beauty = |image: &Image| image.layer("").unwrap().data.clone();
    assert_eq!(beauty(&whole), beauty(&tiled));
}

#[test]
fn materials_that_emit_are_lights() {
    let folder = tempfile::tempdir().unwrap();
    let obj = "mtllib model.mtl\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nusemtl lamp\nf 1 2 3 4\n";
    let (image, _) = render(folder.path(), obj, "newmtl lamp\nKd 0 0 0\nKe 3 2 1\n");
    assert_eq!(pixel(&image, "emission", 20, 20), [3.0, 2.0, 1.0]);
}
