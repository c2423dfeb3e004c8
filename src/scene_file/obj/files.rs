//! Finds the files that an OBJ or MTL names, also where the name was written on another system or in another folder.

use std::path::{Path, PathBuf};

/// Most entries of a folder that are searched for a name that differs in case.
const MOST_ENTRIES: usize = 100_000;

/// Most words in the name of a material file, and most files on one line.
const MOST_WORDS: usize = 12;
const MOST_FILES: usize = 64;

/// Folders that are searched for a picture that is not at its stated path.
const PICTURE_FOLDERS: [&str; 7] = ["textures", "texture", "maps", "images", "materials", "tex", "source"];

/// A file that another file names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::scene_file) struct NamedFile {
    /// Its path; where it was not found, the path where it should be.
    pub(in crate::scene_file) path: PathBuf,
    /// Whether the path is as stated; the kind of separators does not matter.
    pub(in crate::scene_file) is_as_named: bool,
}

/// Finds the file `name` that a file in `folder` names. It tries the stated path, then differences in case, which some systems
/// ignore, then the last part of the name in the same folder and in the folders for pictures.
pub(in crate::scene_file) fn find_file(folder: &Path, name: &Path) -> NamedFile {
    let found = |path: PathBuf, is_as_named| NamedFile { path, is_as_named };
    let exact = folder.join(name);
    if exact.exists() {
        return found(exact, true);
    }
    let name = name.to_string_lossy().replace('\\', "/");
    let slashed = folder.join(&name);
    if slashed.exists() {
        return found(slashed, true);
    }
    if let Some(path) = in_other_letters(folder, &name) {
        return found(path, false);
    }
    let last = name.rsplit('/').next().unwrap_or_default();
    let folders = std::iter::once(folder.to_path_buf())
        .chain(PICTURE_FOLDERS.iter().filter_map(|name| in_other_letters(folder, name)));
    for folder in folders {
        let beside = folder.join(last);
        if !last.is_empty() && beside.is_file() {
            return found(beside, false);
        }
        if let Some(path) = in_other_letters(&folder, last) {
            return found(path, false);
        }
    }
    found(slashed, true)
}

/// A path to an existing file that differs from `name` only in case.
fn in_other_letters(folder: &Path, name: &str) -> Option<PathBuf> {
    let mut path = folder.to_path_buf();
    if name.is_empty() || name.starts_with('/') {
        return None;
    }
    for part in name.split('/').filter(|part| !part.is_empty() && *part != ".") {
        let next = path.join(part);
        if part == ".." || next.exists() {
            path = next;
            continue;
        }
        let here = if path.as_os_str().is_empty() { Path::new(".") } else { &path };
        let mut same: Vec<_> = std::fs::read_dir(here)
            .ok()?
            .take(MOST_ENTRIES)
            .filter_map(|entry| entry.ok().map(|entry| entry.file_name()))
            .filter(|entry| entry.to_string_lossy().to_lowercase() == part.to_lowercase())
            .collect();
        // The result does not depend on the order in which the system lists the files.
        same.sort();
        path.push(same.first()?);
    }
    Some(path)
}

/// The files after `mtllib`. Names may contain blanks, and blanks separate names. The longest name that exists is taken. Where no
/// file exists, each word is a name if the text contains `.mtl` more than once; otherwise the whole text is one name.
pub(in crate::scene_file) fn library_files(folder: &Path, text: &Path) -> Vec<NamedFile> {
    let text = text.to_string_lossy();
    let text = text.trim();
    let is_quoted = |text: &&str| text.len() > 2 && text.starts_with('"') && text.ends_with('"');
    let unquoted = Some(text).filter(is_quoted).map(|text| text.trim_matches('"'));
    let whole = find_file(folder, Path::new(unquoted.unwrap_or(text)));
    let is_there = |file: &NamedFile| file.path.exists();
    let words: Vec<(usize, usize)> = words_of(text);
    if unquoted.is_some() || words.len() <= 1 || is_there(&whole) {
        return vec![whole];
    }
    let mut files = Vec::new();
    let mut start = 0;
    let mut all_missing = true;
    while start < words.len() && files.len() < MOST_FILES {
        let name = |end: usize| Path::new(&text[words[start].0..words[end].1]);
        let longest =
            (start..words.len().min(start + MOST_WORDS)).rev().map(|end| (end, find_file(folder, name(end))));
        let (end, file) = longest
            .into_iter()
            .find(|(_, file)| is_there(file))
            .unwrap_or_else(|| (start, find_file(folder, name(start))));
        all_missing &= !is_there(&file);
        files.push(file);
        start = end + 1;
    }
    let names = text.to_ascii_lowercase().matches(".mtl").count();
    if all_missing && names <= 1 { vec![whole] } else { files }
}

/// Byte ranges of the words of a text.
fn words_of(text: &str) -> Vec<(usize, usize)> {
    let base = text.as_ptr() as usize;
    text.split_ascii_whitespace()
        .map(|word| (word.as_ptr() as usize - base, word.as_ptr() as usize - base + word.len()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn files_are_found_as_programs_name_them() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        fs::create_dir(folder.join("Textures")).unwrap();
        fs::write(folder.join("Textures/Wood.png"), "").unwrap();
        fs::write(folder.join("two words.png"), "").unwrap();
        let wood = folder.join("Textures/Wood.png");
        for (name, path, is_as_named) in [
            ("Textures/Wood.png", &wood, true),
            ("Textures\\Wood.png", &wood, true),
            ("textures/wood.PNG", &wood, false),
            ("C:\\Users\\artist\\Desktop\\wood.png", &wood, false),
            ("/artist/maps/Wood.png", &wood, false),
            ("..\\elsewhere\\two words.png", &folder.join("two words.png"), false),
        ] {
            let found = find_file(folder, Path::new(name));
            assert_eq!((&found.path, found.is_as_named), (path, is_as_named), "{name}");
        }
        assert!(!find_file(folder, Path::new("none.png")).path.exists());
    }

    #[test]
    fn several_libraries_and_names_with_blanks() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        for name in ["a.mtl", "red.mtl", "spaced name.mtl"] {
            fs::write(folder.join(name), "").unwrap();
        }
        let names = |text: &str| -> Vec<String> {
            let files = library_files(folder, Path::new(text));
            files.iter().map(|file| file.path.file_name().unwrap().to_string_lossy().into_owned()).collect()
        };
        assert_eq!(names("a.mtl red.mtl"), ["a.mtl", "red.mtl"]);
        assert_eq!(names("spaced name.mtl"), ["spaced name.mtl"]);
        assert_eq!(names("\"spaced name.mtl\""), ["spaced name.mtl"]);
        assert_eq!(names("a.mtl  spaced name.mtl red.mtl"), ["a.mtl", "spaced name.mtl", "red.mtl"]);
        assert_eq!(names("a.mtl none.mtl"), ["a.mtl", "none.mtl"]);
        assert_eq!(names("not there.mtl"), ["not there.mtl"]);
        assert_eq!(names("not.mtl there.mtl"), ["not.mtl", "there.mtl"]);
        assert_eq!(names("A.MTL"), ["a.mtl"]);
    }
}
