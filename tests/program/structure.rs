//! The shape of the code itself: which room uses which, where `unsafe` is, and that nothing names a machine.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Rooms by layer; each may use those of its own layer and of the layers above it in this list.
const LAYERS: [&[&str]; 12] = [
    &["math", "sampling", "files", "memory", "observer", "settings"],
    &["embree", "image_io", "film", "spectra"],
    &["shapes", "textures", "bsdf", "media", "lights", "camera"],
    &["scene"],
    &["scene_file"],
    &["transport"],
    &["bricks", "photons"],
    &["caches", "radiosity"],
    &["integrators"],
    &["render"],
    &["measure"],
    &["cli", "main"],
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// All files under `folder` of the repository with one of these extensions, in order of their paths.
fn files(folder: &str, extensions: &[&str]) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![root().join(folder)];
    while let Some(folder) = folders.pop() {
        let Ok(entries) = fs::read_dir(&folder) else { continue };
        for entry in entries.map(|entry| entry.unwrap().path()) {
            if entry.is_dir() {
                folders.push(entry);
            } else if entry.extension().is_some_and(|e| extensions.iter().any(|&wanted| e == wanted)) {
                found.push(entry);
            }
        }
    }
    found.sort();
    found
}

fn name(path: &Path) -> String {
    path.strip_prefix(root()).unwrap().display().to_string()
}

/// The room of a file in `src`.
fn room(path: &Path) -> String {
    let inside = path.strip_prefix(root().join("src")).unwrap();
    inside.components().next().unwrap().as_os_str().to_str().unwrap().trim_end_matches(".rs").to_owned()
}

fn layer(room: &str) -> Option<usize> {
    LAYERS.iter().position(|rooms| rooms.contains(&room))
}

/// Code without comments, strings' contents and what is compiled for tests only; line breaks stay.
fn code_of(source: &str) -> String {
    let code = without_comments_and_strings(source);
    let mut kept = String::new();
    let mut rest = code.as_str();
    while let Some(at) = rest.find("#[cfg(test)]") {
        kept.push_str(&rest[..at]);
        let after = &rest[at..];
        // Up to the end of the item: a `;` before any brace, or the brace that closes the first one.
        let mut depth = 0;
        let mut end = after.len();
        for (i, c) in after.char_indices() {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                _ => {}
            }
            if depth == 0 && (c == ';' || c == '}') {
                end = i + 1;
                break;
            }
        }
        kept.extend(after[..end].chars().filter(|&c| c == '\n'));
        rest = &after[end..];
    }
    kept.push_str(rest);
    kept
}

fn without_comments_and_strings(source: &str) -> String {
    let mut code = String::new();
    let bytes: Vec<char> = source.chars().collect();
    let at = |i: usize| bytes.get(i).copied().unwrap_or('\0');
    let mut i = 0;
    while i < bytes.len() {
        if at(i) == '/' && at(i + 1) == '/' {
            while i < bytes.len() && at(i) != '\n' {
                i += 1;
            }
        } else if at(i) == '/' && at(i + 1) == '*' {
            while i < bytes.len() && !(at(i) == '*' && at(i + 1) == '/') {
                if at(i) == '\n' {
                    code.push('\n');
                }
                i += 1;
            }
            i += 2;
        } else if at(i) == 'r' && (at(i + 1) == '"' || at(i + 1) == '#' && matches!(at(i + 2), '"' | '#')) {
            let hashes = bytes[i + 1..].iter().take_while(|&&c| c == '#').count();
            i += hashes + 2;
            let closes = |i: usize| at(i) == '"' && (1..=hashes).all(|k| at(i + k) == '#');
            while i < bytes.len() && !closes(i) {
                if at(i) == '\n' {
                    code.push('\n');
                }
                i += 1;
            }
            i += hashes + 1;
            code.push_str("\"\"");
        } else if at(i) == '"' {
            i += 1;
            while i < bytes.len() && at(i) != '"' {
                if at(i) == '\n' {
                    code.push('\n');
                }
                i += if at(i) == '\\' { 2 } else { 1 };
            }
            i += 1;
            code.push_str("\"\"");
        } else if at(i) == '\'' && (at(i + 2) == '\'' || at(i + 1) == '\\') {
            // A character, not a lifetime.
            i += if at(i + 1) == '\\' { 3 } else { 2 };
            while i < bytes.len() && at(i) != '\'' {
                i += 1;
            }
            i += 1;
            code.push_str("' '");
        } else {
            code.push(at(i));
            i += 1;
        }
    }
    code
}

/// The rooms that `code` names by a path from `crate` (or `cardioid`, in the program), with the line of each.
fn uses(code: &str) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    for prefix in ["crate::", "cardioid::"] {
        for (at, _) in code.match_indices(prefix) {
            let before = code[..at].chars().next_back().unwrap_or(' ');
            if before.is_alphanumeric() || before == '_' {
                continue;
            }
            let line = code[..at].matches('\n').count() + 1;
            let after = &code[at + prefix.len()..];
            let mut add = |text: &str| {
                let end = text.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(text.len());
                if end > 0 {
                    found.push((line, text[..end].to_owned()));
                }
            };
            let Some(group) = after.strip_prefix('{') else {
                add(after);
                continue;
            };
            // `use crate::{a::b, c::{d, e}}`: what follows the opening brace and each comma on its level.
            let mut depth = 1;
            let mut start = 0;
            for (i, c) in group.char_indices() {
                match c {
                    '{' => depth += 1,
                    '}' => depth -= 1,
                    _ => {}
                }
                if depth == 0 || depth == 1 && c == ',' {
                    add(group[start..i].trim());
                    start = i + 1;
                }
                if depth == 0 {
                    break;
                }
            }
        }
    }
    found
}

#[test]
fn no_room_uses_one_below_it() {
    let mut climbs = Vec::new();
    let mut seen = BTreeMap::new();
    for path in files("src", &["rs"]) {
        let from = room(&path);
        if from == "lib" {
            continue;
        }
        let Some(own) = layer(&from) else {
            panic!("{}: the room `{from}` has no place in the list of layers", name(&path));
        };
        for (line, to) in uses(&code_of(&fs::read_to_string(&path).unwrap())) {
            match layer(&to) {
                None => {
                    climbs.push(format!("{}:{line}: `{to}` has no place in the list of layers", name(&path)))
                }
                Some(other) if other > own => {
                    climbs.push(format!(
                        "{}:{line}: {from} (layer {own}) uses {to} (layer {other})",
                        name(&path)
                    ));
                }
                Some(_) => *seen.entry((from.clone(), to)).or_insert(0) += 1,
            }
        }
    }
    assert!(climbs.is_empty(), "{}", climbs.join("\n"));
    // The reader of the code reads: these uses exist.
    for (from, to) in [
        ("scene", "lights"),
        ("photons", "scene"),
        ("integrators", "photons"),
        ("cli", "render"),
        ("scene_file", "settings"),
    ] {
        assert!(
            seen.contains_key(&(from.to_owned(), to.to_owned())),
            "no use of {to} found in {from}: {seen:?}"
        );
    }
}

#[test]
fn the_reader_of_uses_finds_climbs() {
    let code = code_of(
        "//! crate::cli in a comment\nuse crate::math::Ray;\nuse crate::{film::{Film, Tile}, cli};\n\
         const A: &str = \"crate::measure\";\nconst B: &str = r#\"crate::photons \" \"#; const C: char = '\"';\n\
         #[cfg(test)]\nmod tests { use crate::render::x; fn f() { { } } }\nfn f<'a>() { crate::scene::g() }\n\
         #[cfg(test)]\nmod more;\nuse crate::bsdf;",
    );
    let found: Vec<(usize, String)> = uses(&code);
    let rooms: Vec<(usize, &str)> = found.iter().map(|(line, room)| (*line, room.as_str())).collect();
    assert_eq!(rooms, [(2, "math"), (3, "film"), (3, "cli"), (8, "scene"), (11, "bsdf")], "{code}");
}

/// True where `word` stands in `code` by itself.
fn has_word(code: &str, word: &str) -> bool {
    let is_part = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
    code.match_indices(word).any(|(at, _)| {
        !is_part(code[..at].chars().next_back()) && !is_part(code[at + word.len()..].chars().next())
    })
}

#[test]
fn unsafe_code_stays_in_two_rooms() {
    let mut rooms_with = Vec::new();
    for path in files("src", &["rs"]) {
        if has_word(&without_comments_and_strings(&fs::read_to_string(&path).unwrap()), "unsafe") {
            rooms_with.push(room(&path));
        }
    }
    rooms_with.dedup();
    assert_eq!(rooms_with, ["embree", "image_io"]);
}

#[test]
fn only_the_command_line_knows_clap_and_anyhow() {
    for path in files("src", &["rs"]) {
        let code = without_comments_and_strings(&fs::read_to_string(&path).unwrap());
        for word in ["clap", "anyhow", "indicatif", "signal_hook"] {
            assert!(room(&path) == "cli" || !has_word(&code, word), "{} uses {word}", name(&path));
        }
    }
}

#[test]
fn nothing_names_a_machine() {
    let text = ["rs", "toml", "md", "sh", "cpp", "h", "c", "json", "yml", "html", "svg"];
    let mut all: Vec<PathBuf> =
        ["src", "tests", "benches", "docs", "scenes", "embree4-sys", "oiio-sys", "openvdb-sys"]
            .iter()
            .flat_map(|folder| files(folder, &text))
            .collect();
    all.extend(
        ["Cargo.toml", "Makefile", "README.md", "CHANGELOG.md", "build.rs", "setup.sh", ".ci/run"]
            .map(|f| root().join(f)),
    );
    assert!(all.len() > 100, "only {} files found", all.len());
    let home = std::env::var("HOME").unwrap_or_default();
    // Of the present machine, and as homes are called elsewhere.
    let mut places =
        vec![format!("{}/", root().display()), ["/ho", "me/"].concat(), ["/Us", "ers/"].concat()];
    if home.len() > 1 {
        places.push(format!("{home}/"));
    }
    if let Some(parent) = root().parent().filter(|parent| parent.components().count() > 2) {
        places.push(format!("{}/", parent.display()));
    }
    for path in all {
        let Ok(text) = fs::read_to_string(&path) else { continue };
        for place in &places {
            assert!(!text.contains(place.as_str()), "{} names {place}", name(&path));
        }
    }
}

/// The words of `line` between single backquotes.
fn quoted(line: &str) -> impl Iterator<Item = &str> {
    line.split('`').skip(1).step_by(2)
}

/// A page that leads through the code leads to what is there: each file that a line names exists, and each function or type beside it is
/// in one of the files of that line, or in a drawing in one of those above it.
#[test]
fn the_map_of_the_code_names_what_there_is() {
    let is_name =
        |word: &&str| word.chars().all(|c| c.is_alphanumeric() || "_:".contains(c)) && !word.is_empty();
    for (page, least) in [("docs/architecture.md", 60), ("docs/recipes.md", 0)] {
        let text = fs::read_to_string(root().join(page)).unwrap();
        let (mut checked, mut before) = (0, String::new());
        for (number, line) in text.lines().enumerate() {
            let at = format!("{page}:{}", number + 1);
            let words = line.split(|c: char| c.is_whitespace() || "`|(),;".contains(c));
            let paths: Vec<&str> = words
                .clone()
                .filter(|word| word.starts_with("src/") && word.len() > 4)
                .map(|word| word.trim_end_matches(['.', ':']))
                .collect();
            for path in &paths {
                assert!(root().join(path).exists(), "{at}: there is no {path}");
            }
            if line.starts_with("```") || line.starts_with('|') {
                before.clear();
            }
            let files = paths.iter().map(|path| root().join(path));
            before.extend(files.filter_map(|file| fs::read_to_string(file).ok()));
            let is_row = line.starts_with("| ") && !paths.is_empty();
            let in_drawing = words.filter(|word| word.contains("::") && !line.contains('`'));
            let in_row = quoted(line).filter(|word| is_row && !word.contains('/'));
            for name in in_drawing.chain(in_row).filter(is_name) {
                let last = name.rsplit("::").next().unwrap_or(name);
                assert!(has_word(&before, last), "{at}: {name} is not in {paths:?}");
                checked += 1;
            }
        }
        assert!(checked >= least, "{page}: only {checked} names found");
    }
}

#[test]
fn links_of_the_documents_lead_to_files() {
    let mut pages = files("docs", &["md"]);
    pages.extend(["README.md", "CHANGELOG.md"].map(|page| root().join(page)));
    let mut links = 0;
    for page in pages {
        let text = fs::read_to_string(&page).unwrap();
        for (at, open) in text.match_indices("](") {
            let after = &text[at + open.len()..];
            let target = after.split([')', '#', ' ']).next().unwrap_or_default();
            if target.is_empty() || target.contains("://") {
                continue;
            }
            assert!(page.with_file_name(target).exists(), "{}: there is no {target}", name(&page));
            links += 1;
        }
    }
    assert!(links > 100, "{links}");
}
