//! Files that an OBJ or MTL names, found where programs of other systems and other folders left their names.

use std::path::{Path, PathBuf};

/// Entries of a folder that are looked through for a name in other letters.
const MOST_ENTRIES: usize = 100_000;

/// Words of a name of a file of materials, and files of one line, at most.
const MOST_WORDS: usize = 12;
const MOST_FILES: usize = 64;

/// Folders beside a file that its pictures are looked for in, where they are not where it says.
const PICTURE_FOLDERS: [&str; 7] = ["textures", "texture", "maps", "images", "materials", "tex", "source"];

/// A file that was named.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::scene_file) struct NamedFile {
    /// Where it is; where it should be if it is nowhere.
    pub(in crate::scene_file) path: PathBuf,
    /// Whether it is where its name says; separators of either kind do not count.
    pub(in crate::scene_file) is_as_named: bool,
}

/// The file called `name`, of a file in `folder`: as it says; then in other letters (upper or lower case), which some systems do not
/// tell apart; then by the last part of its name beside the file, and in folders of pictures beside it.
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

/// A path whose parts differ from the files there in nothing but upper and lower case.
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
        // The same whichever the system lists first.
        same.sort();
        path.push(same.first()?);
    }
    Some(path)
}

/// The files that follow `mtllib`: names may have blanks, and blanks stand between names. As long a name as there is a file of
/// that is taken; where there is none, the whole text is one name if it has one ending `.mtl`, else each word.
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

/// Where the words of a text are.
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
