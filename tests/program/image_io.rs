//! Pictures survive the way to a file and back, and no file can harm.

use std::fs;
use std::path::{Path, PathBuf};

use cardioid::image_io::{
    Image, ImageError, Layer, MetadataValue, PngPixels, read, read_with_limit, write_exr, write_png,
};

const WIDTH: u32 = 13;
const HEIGHT: u32 = 150;

/// Numbers that are hard to store: extremes, denormal, negative zero, NaN with a payload, and noise.
fn hard_numbers(count: usize) -> Vec<f32> {
    let special = [
        0.0,
        -0.0,
        1.0,
        f32::MIN_POSITIVE,
        f32::from_bits(1),
        f32::MAX,
        f32::MIN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::from_bits(0x7fc0_1234),
        16_777_215.0,
        0.1,
    ];
    let noise = (0_u32..).map(|i| f32::from_bits(i.wrapping_mul(2_654_435_761) & 0xbfff_ffff));
    special.into_iter().chain(noise).take(count).collect()
}

fn picture() -> Image {
    let pixels = WIDTH as usize * HEIGHT as usize;
    let mut image = Image::new(WIDTH, HEIGHT);
    image.layers = vec![
        Layer::new("", &["R", "G", "B"], hard_numbers(pixels * 3)),
        Layer::new("caustic", &["R", "G", "B"], hard_numbers(pixels * 3).into_iter().rev().collect()),
        Layer::new("depth", &["Z"], hard_numbers(pixels)),
        Layer::new("normal", &["X", "Y", "Z"], hard_numbers(pixels * 3)),
        Layer::new("object.id", &["id"], (0..pixels).map(|i| i as f32).collect()),
    ];
    image.metadata = vec![
        ("cardioid:scene".to_owned(), "café, 心臓形".into()),
        ("cardioid:settings".to_owned(), "[photons]\ncount = 100_000\n".repeat(100).into()),
        ("cardioid:seed".to_owned(), (-1).into()),
        ("cardioid:photons".to_owned(), 4_294_967_297.0.into()),
        ("cardioid:radius".to_owned(), 1e-300.into()),
        ("Software".to_owned(), "cardioid".into()),
    ];
    image
}

fn bits(data: &[f32]) -> Vec<u32> {
    data.iter().map(|number| number.to_bits()).collect()
}

fn names_in(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("folder");
    entries.map(|entry| entry.expect("entry").file_name().to_string_lossy().into_owned()).collect()
}

#[test]
fn exr_keeps_every_bit_of_every_layer() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("a b.exr");
    let written = picture();
    write_exr(&path, &written).expect("written");
    let found = read(&path).expect("read");
    assert_eq!((found.width, found.height), (WIDTH, HEIGHT));
    assert_eq!(found.layers.len(), written.layers.len());
    for layer in &written.layers {
        let same = found.layer(&layer.name).expect("layer");
        assert_eq!(same.channels, layer.channels, "{}", layer.name);
        assert_eq!(bits(&same.data), bits(&layer.data), "{}", layer.name);
    }
    assert_eq!(names_in(folder.path()), ["a b.exr"]);
}

#[test]
fn exr_keeps_metadata_and_what_was_read_can_be_written() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("picture.exr");
    let written = picture();
    write_exr(&path, &written).expect("written");
    let found = read(&path).expect("read");
    for (name, value) in &written.metadata {
        assert_eq!(found.metadata(name), Some(value), "{name}");
    }
    write_exr(&path, &found).expect("written again");
    let again = read(&path).expect("read again");
    assert_eq!(again.metadata, found.metadata);
}

#[test]
fn png_keeps_every_bit_of_every_kind() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("picture.png");
    let bytes: Vec<u8> = (0..7 * 5 * 4).map(|i| (i * 37 % 256) as u8).collect();
    let words: Vec<u16> = (0..7 * 5 * 4).map(|i| (i * 7919 % 65_536) as u16).collect();
    let pixels = 7 * 5;
    let kinds = [
        (PngPixels::Grey8(&bytes[..pixels]), 1, 255.0),
        (PngPixels::Rgb8(&bytes[..pixels * 3]), 3, 255.0),
        (PngPixels::Rgba8(&bytes), 4, 255.0),
        (PngPixels::Grey16(&words[..pixels]), 1, 65_535.0),
        (PngPixels::Rgb16(&words[..pixels * 3]), 3, 65_535.0),
        (PngPixels::Rgba16(&words), 4, 65_535.0),
    ];
    for (kind, channels, scale) in kinds {
        write_png(&path, 7, 5, kind).expect("written");
        let found = read(&path).expect("read");
        let [layer] = found.layers.as_slice() else { panic!("{found:?}") };
        assert_eq!((found.width, found.height, layer.channels.len()), (7, 5, channels));
        for (i, value) in layer.data.iter().enumerate() {
            let expected = if scale == 255.0 { f32::from(bytes[i]) } else { f32::from(words[i]) };
            assert!((value * scale - expected).abs() < 0.01, "{kind:?}: value {i} is {}", value * scale);
        }
    }
    assert_eq!(names_in(folder.path()), ["picture.png"]);
}

#[test]
fn same_picture_gives_the_same_file_at_any_time() {
    let folder = tempfile::tempdir().expect("folder");
    let [first, second] = ["first.exr", "second.exr"].map(|name| folder.path().join(name));
    write_exr(&first, &picture()).expect("written");
    // The resolution of the dates that formats may store.
    std::thread::sleep(std::time::Duration::from_millis(1100));
    write_exr(&second, &picture()).expect("written");
    assert!(fs::read(&first).expect("read") == fs::read(&second).expect("read"));
    assert_eq!(read(&first).expect("read").metadata("DateTime"), None);
}

#[test]
fn smallest_picture_is_a_picture() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("picture.exr");
    let mut image = Image::new(1, 1);
    image.layers.push(Layer::new("", &["Y"], vec![0.5]));
    write_exr(&path, &image).expect("written");
    assert_eq!(read(&path).expect("read").layers, image.layers);
}

#[test]
fn contradictions_are_refused_before_anything_is_touched() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("picture.exr");
    fs::write(&path, "precious").expect("written");
    let layer = |name: &str, channels: &[&str], count| Layer::new(name, channels, vec![0.0; count]);
    let metadata = |name: &str| (name.to_owned(), MetadataValue::Int(1));
    let ok = layer("", &["R"], 4);
    let cases = [
        (2, 2, vec![], vec![]),
        (0, 2, vec![layer("", &["R"], 0)], vec![]),
        (2, 2, vec![layer("", &["R"], 5)], vec![]),
        (2, 2, vec![layer("", &[], 0)], vec![]),
        (2, 2, vec![layer("a", &["R", "R"], 8)], vec![]),
        (2, 2, vec![layer("a", &["R"], 4), layer("a", &["R"], 4)], vec![]),
        (2, 2, vec![layer("a", &["b.R"], 4)], vec![]),
        (2, 2, vec![layer("a", &[""], 4)], vec![]),
        (2, 2, vec![layer("a\0", &["R"], 4)], vec![]),
        (2, 2, vec![layer(&"a".repeat(254), &["R"], 4)], vec![]),
        (2, 2, vec![ok.clone()], vec![metadata("")]),
        (2, 2, vec![ok.clone()], vec![metadata("oiio:ioproxy")]),
        (2, 2, vec![ok.clone()], vec![metadata("PNG:compressionLevel")]),
        (2, 2, vec![ok.clone()], vec![metadata("Compression")]),
        (2, 2, vec![ok.clone()], vec![metadata("twice"), metadata("twice")]),
        (u32::MAX, u32::MAX, vec![ok], vec![]),
    ];
    for (width, height, layers, metadata) in cases {
        let image = Image { layers, metadata, ..Image::new(width, height) };
        let error = write_exr(&path, &image).expect_err("refused");
        assert!(matches!(error, ImageError::Inconsistent { .. }), "{error}");
    }
    let error = write_png(&path, 2, 2, PngPixels::Rgb8(&[0; 11])).expect_err("refused");
    assert!(matches!(error, ImageError::Inconsistent { .. }), "{error}");
    assert_eq!(fs::read(&path).expect("read"), b"precious");
    assert_eq!(names_in(folder.path()), ["picture.exr"]);
}

#[test]
fn errors_name_the_file_and_the_remedy() {
    let folder = tempfile::tempdir().expect("folder");
    let text = folder.path().join("notes.exr");
    fs::write(&text, "not a picture").expect("written");
    let truncated = folder.path().join("truncated.png");
    write_png(&truncated, 64, 64, PngPixels::Grey8(&[7; 64 * 64])).expect("written");
    let bytes = fs::read(&truncated).expect("read");
    fs::write(&truncated, &bytes[..bytes.len() / 2]).expect("written");
    let tone = PngPixels::Grey8(&[0]);
    let missing = folder.path().join("missing/picture.png");
    let cases = [
        (write_png(&missing, 1, 1, tone).expect_err("no folder"), missing, "does not exist; create it"),
        (
            write_png(text.join("picture.png"), 1, 1, tone).expect_err("no folder"),
            text.join("picture.png"),
            "is not a folder",
        ),
        (
            write_png(folder.path(), 1, 1, tone).expect_err("a folder"),
            folder.path().to_owned(),
            "is a folder",
        ),
        (read(folder.path()).expect_err("a folder"), folder.path().to_owned(), "is a folder"),
        (
            read(folder.path().join("none.exr")).expect_err("none"),
            folder.path().join("none.exr"),
            "no such file",
        ),
        (read(&text).expect_err("text"), text, "not a picture of a known kind"),
        (read(&truncated).expect_err("truncated"), truncated, "damaged or incomplete"),
    ];
    for (error, path, remedy) in cases {
        let message = error.to_string();
        assert!(message.contains(&path.display().to_string()), "{message} does not name {}", path.display());
        assert!(message.contains(remedy), "{message} does not say {remedy:?}");
    }
}

#[test]
fn larger_than_the_limit_is_not_read() {
    let folder = tempfile::tempdir().expect("folder");
    let exr = folder.path().join("picture.exr");
    let mut image = Image::new(20, 10);
    image.layers.push(Layer::new("", &["Y"], vec![0.5; 200]));
    write_exr(&exr, &image).expect("written");
    let png = folder.path().join("picture.png");
    write_png(&png, 20, 10, PngPixels::Grey8(&[0; 200])).expect("written");
    for path in [exr, png] {
        read_with_limit(&path, 200).expect("within");
        let error = read_with_limit(&path, 199).expect_err("beyond");
        assert!(matches!(error, ImageError::TooLarge { values: 200, limit: 199, .. }), "{error}");
    }
}

/// An EXR of two parts without compression, byte by byte after its specification, as this renderer writes only one part.
/// The first has `R` (float) and `id` (32-bit integer), the second `Y` (float).
fn exr_of_two_parts(second_width: i32) -> Vec<u8> {
    fn attribute(name: &str, kind: &str, value: &[u8]) -> Vec<u8> {
        let size = (value.len() as i32).to_le_bytes();
        [name.as_bytes(), &[0], kind.as_bytes(), &[0], &size, value].concat()
    }
    fn header(name: &str, width: i32, channels: &[(&str, i32)]) -> Vec<u8> {
        let ints = |numbers: &[i32]| numbers.iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<_>>();
        let mut list: Vec<u8> = channels
            .iter()
            .flat_map(|&(name, kind)| [name.as_bytes(), &[0], &ints(&[kind, 0, 1, 1])].concat())
            .collect();
        list.push(0);
        let window = ints(&[0, 0, width - 1, 0]);
        [
            attribute("channels", "chlist", &list),
            attribute("chunkCount", "int", &ints(&[1])),
            attribute("compression", "compression", &[0]),
            attribute("dataWindow", "box2i", &window),
            attribute("displayWindow", "box2i", &ints(&[0, 0, 1, 0])),
            attribute("lineOrder", "lineOrder", &[0]),
            attribute("name", "string", name.as_bytes()),
            attribute("pixelAspectRatio", "float", &1.0_f32.to_le_bytes()),
            attribute("screenWindowCenter", "v2f", &[0; 8]),
            attribute("screenWindowWidth", "float", &1.0_f32.to_le_bytes()),
            attribute("type", "string", b"scanlineimage"),
            vec![0],
        ]
        .concat()
    }
    fn chunk(part: i32, values: &[u32]) -> Vec<u8> {
        let head = [part, 0, 4 * values.len() as i32];
        head.iter().flat_map(|n| n.to_le_bytes()).chain(values.iter().flat_map(|n| n.to_le_bytes())).collect()
    }
    const FLOAT: i32 = 2;
    const UINT: i32 = 0;
    let start = [
        &[0x76, 0x2f, 0x31, 0x01][..],
        &(2_u32 | 0x1000).to_le_bytes(),
        &header("first", 2, &[("R", FLOAT), ("id", UINT)]),
        &header("second", second_width, &[("Y", FLOAT)]),
        &[0],
    ]
    .concat();
    let first = chunk(0, &[0.25_f32.to_bits(), 0.5_f32.to_bits(), 7, 16_777_215]);
    let second = chunk(1, &vec![0.75_f32.to_bits(); second_width as usize]);
    let offset = start.len() as u64 + 16;
    [
        start,
        offset.to_le_bytes().to_vec(),
        (offset + first.len() as u64).to_le_bytes().to_vec(),
        first,
        second,
    ]
    .concat()
}

#[test]
fn parts_are_layers_and_integers_are_not_fractions() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("parts.exr");
    fs::write(&path, exr_of_two_parts(2)).expect("written");
    let image = read(&path).expect("read");
    assert_eq!((image.width, image.height), (2, 1));
    let expected = [
        Layer::new("first", &["R", "id"], vec![0.25, 7.0, 0.5, 16_777_215.0]),
        Layer::new("second", &["Y"], vec![0.75, 0.75]),
    ];
    assert_eq!(image.layers, expected);

    fs::write(&path, exr_of_two_parts(3)).expect("written");
    let error = read(&path).expect_err("two sizes");
    assert!(matches!(error, ImageError::Unsupported { .. }), "{error}");
}

/// Peak memory of this process, in bytes.
fn peak_memory() -> u64 {
    let status = fs::read_to_string("/proc/self/status").expect("this is Linux");
    let line = status.lines().find(|line| line.starts_with("VmHWM:")).expect("VmHWM");
    let kibibytes: u64 = line.split_whitespace().nth(1).expect("a number").parse().expect("a number");
    kibibytes * 1024
}

/// Files that once made OpenEXR or its users crash, hang or take all memory.
#[test]
fn malformed_files_are_errors_within_bounds() {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/assets/malformed/exr");
    let Ok(entries) = fs::read_dir(&folder) else {
        eprintln!("skipped: {} is not there", folder.display());
        return;
    };
    let mut paths: Vec<_> = entries.map(|entry| entry.expect("entry").path()).collect();
    paths.sort();
    assert!(!paths.is_empty());
    let before = peak_memory();
    for path in paths {
        let error = read_with_limit(&path, 1 << 22).expect_err("malformed");
        eprintln!("{error}");
    }
    let taken = peak_memory() - before;
    eprintln!("{} MiB taken", taken >> 20);
    // The values are few; the largest blocks allowed have 128 MiB, and the decoder holds a few.
    assert!(taken < 1 << 30, "{taken} bytes");
}
