//! Scenes of Mitsuba mutated as trees: elements and attributes left out, copied, moved, renamed, and given other values.

use cardioid::embree::Device;
use cardioid::sampling::{Rng, Stream};
use cardioid::scene_file::{build_scene, parse_mitsuba_bytes};
use std::error::Error;
use std::fs;
use std::panic::catch_unwind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Elements that a mutated scene has, at most.
const MOST_ELEMENTS: usize = 600;

/// Tags, plugins and names that others are replaced by.
const WORDS: [&str; 64] = [
    "scene",
    "shape",
    "bsdf",
    "texture",
    "emitter",
    "sensor",
    "film",
    "rfilter",
    "sampler",
    "integrator",
    "medium",
    "float",
    "integer",
    "boolean",
    "string",
    "rgb",
    "srgb",
    "spectrum",
    "blackbody",
    "point",
    "vector",
    "transform",
    "ref",
    "default",
    "include",
    "path",
    "alias",
    "translate",
    "rotate",
    "scale",
    "lookat",
    "matrix",
    "sphere",
    "cube",
    "rectangle",
    "disk",
    "cylinder",
    "obj",
    "ply",
    "serialized",
    "shapegroup",
    "instance",
    "diffuse",
    "dielectric",
    "roughdielectric",
    "thindielectric",
    "conductor",
    "roughconductor",
    "plastic",
    "roughplastic",
    "principled",
    "twosided",
    "mask",
    "bumpmap",
    "normalmap",
    "blendbsdf",
    "null",
    "bitmap",
    "checkerboard",
    "area",
    "envmap",
    "to_world",
    "reflectance",
    "value",
];

/// Values that others are replaced by.
const VALUES: [&str; 32] = [
    "",
    "0",
    "1",
    "-1",
    "2",
    "0.5",
    "1e30",
    "1e308",
    "-1e308",
    "1e-308",
    "nan",
    "inf",
    "4294967296",
    "9223372036854775807",
    "-9223372036854775808",
    "true",
    "false",
    "$",
    "$spp",
    "$alpha$alpha",
    "0 0 0",
    "1, 2, 3",
    "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1",
    "0 0 0 0 0 0 0 0 0",
    "400:1, 700:2",
    "700:1, 400:2",
    "#ffffff",
    "#12",
    "red",
    "floor",
    "pair",
    "\u{e9}\u{1f600}",
];

#[derive(Clone)]
struct Node {
    tag: String,
    attributes: Vec<(String, String)>,
    children: Vec<Node>,
}

impl Node {
    fn of(element: roxmltree::Node<'_, '_>) -> Self {
        let attributes = element.attributes();
        Self {
            tag: element.tag_name().name().to_owned(),
            attributes: attributes.map(|a| (a.name().to_owned(), a.value().to_owned())).collect(),
            children: element.children().filter(|child| child.is_element()).map(Self::of).collect(),
        }
    }

    fn count(&self) -> usize {
        1 + self.children.iter().map(Self::count).sum::<usize>()
    }

    /// Element number `index` in the order of the text.
    fn at(&mut self, index: &mut usize) -> Option<&mut Self> {
        if *index == 0 {
            return Some(self);
        }
        *index -= 1;
        self.children.iter_mut().find_map(|child| child.at(index))
    }

    fn write(&self, out: &mut String) {
        let escaped = |text: &str| text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;");
        out.push_str(&format!("<{}", self.tag));
        for (number, (name, value)) in self.attributes.iter().enumerate() {
            // XML itself refuses a name that comes twice; that is tried now and then.
            if self.attributes[..number].iter().any(|(other, _)| other == name) && number % 7 != 0 {
                continue;
            }
            out.push_str(&format!(" {name}=\"{}\"", escaped(value)));
        }
        out.push('>');
        self.children.iter().for_each(|child| child.write(out));
        out.push_str(&format!("</{}>\n", self.tag));
    }
}

fn below(rng: &mut Rng, count: usize) -> usize {
    (rng.next_u64() % count.max(1) as u64) as usize
}

fn mutate(root: &mut Node, rng: &mut Rng) {
    let count = root.count();
    let mut other = below(rng, count);
    let elsewhere = root.at(&mut other).cloned();
    let mut index = below(rng, count);
    let kind = below(rng, 12);
    let Some(node) = root.at(&mut index) else { return };
    let (child, attribute) = (below(rng, node.children.len()), below(rng, node.attributes.len()));
    let (has_child, has_attribute) = (!node.children.is_empty(), !node.attributes.is_empty());
    let word = WORDS[below(rng, WORDS.len())];
    match kind {
        0 if has_child => drop(node.children.remove(child)),
        1 if has_child && count < MOST_ELEMENTS => node.children.push(node.children[child].clone()),
        2 if has_child => node.children.swap(0, child),
        3 => {
            if let Some(elsewhere) = elsewhere.filter(|elsewhere| count + elsewhere.count() < MOST_ELEMENTS) {
                node.children.insert(child, elsewhere);
            }
        }
        4 => node.tag = word.to_owned(),
        5 if has_attribute => drop(node.attributes.remove(attribute)),
        6 if has_attribute => node.attributes.push(node.attributes[attribute].clone()),
        7 if has_attribute => {
            node.attributes[attribute].0 =
                ["name", "value", "type", "id", "x", "angle", "filename", "a"][below(rng, 8)].to_owned()
        }
        8 if has_attribute => node.attributes[attribute].1 = word.to_owned(),
        9 if has_attribute => {
            let others = elsewhere.map(|elsewhere| elsewhere.attributes).unwrap_or_default();
            if let Some((_, value)) = others.get(below(rng, others.len())) {
                node.attributes[attribute].1 = value.clone();
            }
        }
        _ if has_attribute => node.attributes[attribute].1 = VALUES[below(rng, VALUES.len())].to_owned(),
        _ => {}
    }
}

/// A scene with files of every kind, which are written to `folder`.
fn with_files(folder: &Path) -> Result<String, Box<dyn Error>> {
    let corners = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n";
    fs::write(folder.join("flat.obj"), format!("{corners}f 1/1 2/2 3/3\nf 1 3 4\n"))?;
    fs::write(folder.join("smooth.obj"), format!("{corners}vn 0 0 1\nf 1/1/1 2/2/1 3/3/1\n"))?;
    fs::write(
        folder.join("a.ply"),
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty float s\nproperty float t\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 0 0 255 0 0\n1 0 0 1 0 0 255 0\n0 1 0 0 1 0 0 255\n3 0 1 2\n",
    )?;
    fs::write(folder.join("a.tga"), b"\0\0\x03\0\0\0\0\0\0\0\0\0\x02\0\x02\0\x08\x20\x00\x40\x80\xff")?;
    fs::write(folder.join("a.spd"), "# nm, value\n400 0.2\n600 0.5\n700 0.9\n")?;
    fs::write(
        folder.join("inner.xml"),
        "<scene version=\"0.5.0\"><default name=\"spp\" value=\"3\"/><shape type=\"obj\" id=\"inner\"><string name=\"filename\" value=\"flat.obj\"/><boolean name=\"faceNormals\" value=\"true\"/></shape></scene>",
    )?;
    let picture = |name: &str| {
        format!(
            "<texture type=\"bitmap\" name=\"{name}\"><string name=\"filename\" value=\"a.tga\"/><boolean name=\"raw\" value=\"true\"/></texture>"
        )
    };
    let shape = |kind: &str, file: &str, inside: &str| {
        format!("<shape type=\"{kind}\"><string name=\"filename\" value=\"{file}\"/>{inside}</shape>")
    };
    let bsdf = |kind: &str, inside: &str| format!("<bsdf type=\"{kind}\">{inside}</bsdf>");
    Ok(format!(
        "<scene version=\"3.0.0\"><path value=\".\"/><include filename=\"inner.xml\"/>{}{}{}{}{}{}{}</scene>",
        shape("obj", "smooth.obj", &bsdf("diffuse", &picture("reflectance"))),
        shape("obj", "flat.obj", &bsdf("roughplastic", &picture("alpha"))),
        shape(
            "ply",
            "a.ply",
            &bsdf(
                "diffuse",
                "<texture type=\"mesh_attribute\" name=\"reflectance\"><string name=\"name\" value=\"vertex_color\"/></texture>"
            )
        ),
        shape(
            "ply",
            "a.ply",
            &format!(
                "{}<emitter type=\"area\">{}</emitter>",
                bsdf("mask", &format!("{}{}", picture("opacity"), bsdf("diffuse", &picture("reflectance")))),
                picture("radiance")
            )
        ),
        shape(
            "obj",
            "smooth.obj",
            &bsdf(
                "bumpmap",
                &format!(
                    "{}{}",
                    picture("a"),
                    bsdf("principled", &format!("{}{}", picture("roughness"), picture("metallic")))
                )
            )
        ),
        shape(
            "obj",
            "smooth.obj",
            &bsdf(
                "roughconductor",
                "<spectrum name=\"eta\" filename=\"a.spd\"/><spectrum name=\"k\" filename=\"a.spd\"/>"
            )
        ),
        "<emitter type=\"envmap\"><string name=\"filename\" value=\"a.tga\"/><transform name=\"to_world\"><rotate x=\"1\" angle=\"90\"/></transform></emitter>",
    ))
}

/// Mutates `rich`, a scene with files, and the scenes of `folder` if there is one; each second result that is read is built as well.
pub(crate) fn run(
    rich: &[u8],
    executions: u64,
    seed: u64,
    folder: Option<&Path>,
) -> Result<(), Box<dyn Error>> {
    let place = std::env::temp_dir().join(format!("cardioid-xml-{}", std::process::id()));
    fs::create_dir_all(&place)?;
    let own = place.join("a.xml");
    let mut texts: Vec<(PathBuf, String)> =
        vec![(own.clone(), String::from_utf8(rich.to_vec())?), (own, with_files(&place)?)];
    for entry in folder.map(fs::read_dir).transpose()?.into_iter().flatten() {
        let path = entry?.path();
        if path.extension().is_some_and(|extension| extension == "xml") {
            let text = fs::read_to_string(&path)?;
            texts.push((path, text));
        }
    }
    let mut seeds = Vec::new();
    for (path, text) in &texts {
        parse_mitsuba_bytes(text.as_bytes(), path, &[])
            .map_err(|error| format!("a seed is refused: {error}"))?;
        seeds.push((path, Node::of(roxmltree::Document::parse(text)?.root_element())));
    }
    let device = Arc::new(Device::new(1)?);
    let start = Instant::now();
    let (mut read, mut built, mut longest) = (0u64, 0u64, 0.0f64);
    for execution in 0..executions {
        let mut rng = Rng::new(seed, Stream::Measure, execution);
        let (path, mut root) = seeds[below(&mut rng, seeds.len())].clone();
        for _ in 0..1 + below(&mut rng, 4) {
            mutate(&mut root, &mut rng);
        }
        let mut text = String::new();
        root.write(&mut text);
        let begun = Instant::now();
        let outcome = catch_unwind(|| {
            let scene = parse_mitsuba_bytes(text.as_bytes(), path, &[]).map_err(|error| {
                let message = error.to_string();
                let is_placed = message.contains(".xml") || message.contains(&*place.to_string_lossy());
                assert!(is_placed, "no place: {message}");
                assert!(message.contains('\n') || message.contains(';'), "no remedy: {message}");
            });
            scene.map(|scene| execution % 8 == 0 && build_scene(&scene, &device, (16, 16)).is_ok())
        });
        let Ok(outcome) = outcome else {
            fs::write("xml.failure", &text)?;
            return Err(
                format!("execution {execution} of seed {seed} failed; its file is xml.failure").into()
            );
        };
        longest = longest.max(begun.elapsed().as_secs_f64());
        read += u64::from(outcome.is_ok());
        built += u64::from(outcome == Ok(true));
    }
    fs::remove_dir_all(&place)?;
    println!(
        "xml: {executions} executions, {read} read, {built} of every eighth built, the others refused; {:.1} s, the longest {:.1} ms",
        start.elapsed().as_secs_f64(),
        1e3 * longest
    );
    Ok(())
}
