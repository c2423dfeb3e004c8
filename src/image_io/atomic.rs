//! Atomic writing: a file is complete or unchanged.

use std::ffi::OsString;
use std::fs::{self, File, Permissions};
use std::io::{self, ErrorKind, Write};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

/// Bytes that [`check`] writes: one block, as a full disk may still accept an empty file.
const PROBE: [u8; 4096] = [0; 4096];

/// Most symbolic links that are followed before they count as a cycle; the system has the same limit.
const MOST_LINKS: usize = 40;

/// Writes a file with `fill`. `path` changes only if everything succeeds. Where `path` is a symbolic link, the file that it leads to is
/// replaced.
///
/// The temporary file is in the folder of that file, since only there can it be renamed in one step. It is removed on every error and on
/// unwinding. Temporary files that a killed process left for the same file are removed first.
pub(super) fn write_atomically<E: From<io::Error>>(
    path: &Path,
    fill: impl FnOnce(&File) -> Result<(), E>,
) -> Result<(), E> {
    let path = destination(path)?;
    let file = temporary_beside(&path)?;
    fill(file.as_file())?;
    // The data must be on the disk before the rename, or a power cut could leave an empty file under the final name.
    file.as_file().sync_all()?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

/// Checks whether [`write_atomically`] can write to `path` at present, and leaves nothing behind.
pub(super) fn check(path: &Path) -> io::Result<()> {
    let file = temporary_beside(&destination(path)?)?;
    // Written through the plain file, as errors of `NamedTempFile` contain the temporary name.
    file.as_file().write_all(&PROBE).and_then(|()| file.as_file().sync_all())
}

/// Fills a temporary file as [`write_atomically`] does, but removes it instead of renaming it.
pub(super) fn try_beside<E: From<io::Error>>(
    path: &Path,
    fill: impl FnOnce(&File) -> Result<(), E>,
) -> Result<(), E> {
    let file = temporary_beside(&destination(path)?)?;
    fill(file.as_file())?;
    Ok(file.as_file().sync_all()?)
}

/// The file that `path` means, after symbolic links. It must be a regular file or not exist yet. Its folder is in canonical form, so that
/// two names of one file are equal.
pub(super) fn destination(path: &Path) -> io::Result<PathBuf> {
    let mut path = path.to_owned();
    for _ in 0..MOST_LINKS {
        match fs::symlink_metadata(&path).map(|found| found.file_type()) {
            Ok(kind) if kind.is_symlink() => path = folder_of(&path).join(fs::read_link(&path)?),
            Ok(kind) if kind.is_dir() => return Err(ErrorKind::IsADirectory.into()),
            Ok(kind) if !kind.is_file() => {
                return Err(io::Error::other(
                    "it is a device or a pipe, which cannot be replaced as a whole; name a file",
                ));
            }
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
            _ => {
                let name = path.file_name().ok_or(ErrorKind::InvalidFilename)?;
                return Ok(folder_of(&path).canonicalize()?.join(name));
            }
        }
    }
    Err(io::Error::other("its symbolic links lead in a circle; remove them, or write elsewhere"))
}

/// The folder of a file.
pub(super) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Suffix of the names of temporary files.
const SUFFIX: &str = ".cardioid.tmp";

/// Random letters in the name of a temporary file.
const RANDOM: usize = 6;

/// Attempts to create a temporary file that no other process removes as abandoned.
const ATTEMPTS: usize = 8;

/// Environment variable that names this attempt at a task. It becomes part of the names of temporary files, so that attempts on several
/// machines do not remove each other's: locks do not hold between machines on every network drive.
const ATTEMPT: &str = "CARDIOID_ATTEMPT";

/// Longest name of an attempt in the name of a file.
const LONGEST_ATTEMPT: usize = 64;

/// A temporary file for `path`. It is locked while it is open, which distinguishes it from files that killed processes left.
fn temporary_beside(path: &Path) -> io::Result<NamedTempFile> {
    temporary_of(path, &std::env::var(ATTEMPT).unwrap_or_default())
}

/// A temporary file for `path` of this attempt, which may have no name.
fn temporary_of(path: &Path, attempt: &str) -> io::Result<NamedTempFile> {
    let mut prefix = OsString::from(".");
    prefix.push(path.file_name().unwrap_or_default());
    prefix.push(".");
    let plain = |c: &char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
    let attempt: String = attempt.chars().filter(plain).take(LONGEST_ATTEMPT).collect();
    if !attempt.is_empty() {
        prefix.push(format!("{attempt}."));
    }
    remove_abandoned(folder_of(path), prefix.as_bytes());
    let create = || {
        tempfile::Builder::new()
            .prefix(&prefix)
            .suffix(SUFFIX)
            .rand_bytes(RANDOM)
            // The user's umask decides who may read a picture, as for any other file. (The default would be the user alone.)
            .permissions(Permissions::from_mode(0o666))
            .tempfile_in(folder_of(path))
            .map_err(without_path)
    };
    for _ in 1..ATTEMPTS {
        let file = create()?;
        // On a disk without locks, no process removes such files.
        let _ = file.as_file().try_lock();
        // Another process may have removed the file between creation and lock.
        if is_at(file.as_file(), file.path()) {
            return Ok(file);
        }
    }
    create()
}

/// Whether this open file is the one with this name.
fn is_at(file: &File, path: &Path) -> bool {
    let identity = |found: fs::Metadata| (found.dev(), found.ino());
    let found = (file.metadata().map(identity), fs::symlink_metadata(path).map(identity));
    matches!(found, (Ok(a), Ok(b)) if a == b)
}

/// Removes temporary files with this prefix that no process has locked, as their process is gone. Files that cannot be read, locked or
/// removed stay.
fn remove_abandoned(folder: &Path, prefix: &[u8]) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let middle =
            name.as_bytes().strip_prefix(prefix).and_then(|rest| rest.strip_suffix(SUFFIX.as_bytes()));
        let is_ours = middle.is_some_and(|middle| middle.len() == RANDOM);
        if !is_ours || !entry.file_type().is_ok_and(|kind| kind.is_file()) {
            continue;
        }
        let path = entry.path();
        let Ok(file) = File::options().read(true).write(true).open(&path) else { continue };
        if file.try_lock().is_ok() && is_at(&file, &path) {
            // If this fails, the next run tries again.
            let _ = fs::remove_file(&path);
        }
    }
}

/// The same error without the name of the temporary file, which is of no use to the user.
fn without_path(error: io::Error) -> io::Error {
    error
        .get_ref()
        .and_then(|inner| inner.source())
        .and_then(|source| source.downcast_ref::<io::Error>())
        .map_or_else(
            || io::Error::from(error.kind()),
            |inner| {
                inner
                    .raw_os_error()
                    .map_or_else(|| io::Error::from(inner.kind()), io::Error::from_raw_os_error)
            },
        )
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;
    use std::panic::{AssertUnwindSafe, catch_unwind};

    use super::*;

    fn names_in(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).expect("folder");
        entries.map(|entry| entry.expect("entry").file_name().to_string_lossy().into_owned()).collect()
    }

    #[test]
    fn success_replaces_the_file_and_leaves_nothing_else() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("picture");
        fs::write(&path, "old").expect("written");
        write_atomically(&path, |mut file| file.write_all(b"new")).expect("written");
        assert_eq!(fs::read(&path).expect("read"), b"new");
        assert_eq!(names_in(folder.path()), ["picture"]);
    }

    #[test]
    fn failure_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("picture");
        fs::write(&path, "old").expect("written");
        let result = write_atomically(&path, |mut file| {
            file.write_all(b"half of the n")?;
            Err(io::Error::from(io::ErrorKind::StorageFull))
        });
        assert_eq!(result.expect_err("refused").kind(), io::ErrorKind::StorageFull);
        assert_eq!(fs::read(&path).expect("read"), b"old");
        assert_eq!(names_in(folder.path()), ["picture"]);
    }

    /// The next write to a file removes what a killed process left for it, and nothing else.
    #[test]
    fn abandoned_files_are_removed_and_those_in_use_are_not() {
        let folder = tempfile::tempdir().expect("folder");
        let at = |name: &str| folder.path().join(name);
        let abandoned = [".picture.aaaaaa.cardioid.tmp", ".picture.bbbbbb.cardioid.tmp"];
        let kept = [
            ".other.aaaaaa.cardioid.tmp",
            ".picture.aaaaaa.tmp",
            ".picture.aaaaaaa.cardioid.tmp",
            ".picture.in-use.cardioid.tmp",
        ];
        for name in abandoned.iter().chain(&kept) {
            fs::write(at(name), "half").expect("written");
        }
        let in_use = File::open(at(kept[3])).expect("open");
        in_use.try_lock().expect("locked");
        write_atomically(&at("picture"), |mut file| {
            // A second process that writes the same file at the same time.
            write_atomically(&at("picture"), |mut file| file.write_all(b"other"))?;
            file.write_all(b"new")
        })
        .expect("written");
        assert_eq!(fs::read(at("picture")).expect("read"), b"new");
        let mut names = names_in(folder.path());
        names.sort();
        let mut expected: Vec<_> = kept.iter().chain(&["picture"]).map(|name| (*name).to_owned()).collect();
        expected.sort();
        assert_eq!(names, expected);
    }

    /// Locks may not hold between machines: attempts with names of their own do not touch each other's files.
    #[test]
    fn attempts_leave_each_others_files() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("picture");
        let others = [".picture.aaaaaa.cardioid.tmp", ".picture.job-7_1.aaaaaa.cardioid.tmp"];
        for name in others {
            fs::write(folder.path().join(name), "half").expect("written");
        }
        let file = temporary_of(&path, "job-7/2").expect("created");
        let name = file.path().file_name().expect("name").to_string_lossy().into_owned();
        assert!(name.starts_with(".picture.job-72.") && name.ends_with(SUFFIX), "{name}");
        assert!(others.iter().all(|name| folder.path().join(name).exists()));
        // The next file of the same attempt removes what that attempt has left, and one without a name does not.
        drop(temporary_of(&path, "job-7_1").expect("created"));
        assert!(folder.path().join(others[0]).exists() && !folder.path().join(others[1]).exists());
        fs::write(folder.path().join(others[1]), "half").expect("written");
        drop(temporary_of(&path, "").expect("created"));
        assert!(!folder.path().join(others[0]).exists() && folder.path().join(others[1]).exists());
    }

    #[test]
    fn unwinding_leaves_nothing() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("picture");
        let result = catch_unwind(AssertUnwindSafe(|| {
            write_atomically::<io::Error>(&path, |_| panic!("interrupted"))
        }));
        assert!(result.is_err());
        assert!(names_in(folder.path()).is_empty());
    }

    #[test]
    fn others_may_read_it_as_any_new_file() {
        let folder = tempfile::tempdir().expect("folder");
        let (ours, plain) = (folder.path().join("ours"), folder.path().join("plain"));
        write_atomically::<io::Error>(&ours, |_| Ok(())).expect("written");
        fs::write(&plain, "").expect("written");
        let mode = |path| fs::metadata(path).expect("metadata").permissions().mode();
        assert_eq!(mode(&ours), mode(&plain));
    }

    #[test]
    fn missing_folder_and_folder_as_file_are_told_apart() {
        let folder = tempfile::tempdir().expect("folder");
        let fill = |_: &File| Ok::<(), io::Error>(());
        let missing = write_atomically(&folder.path().join("none/picture"), fill).expect_err("refused");
        assert_eq!(missing.kind(), io::ErrorKind::NotFound);
        let is_folder = write_atomically(folder.path(), fill).expect_err("refused");
        assert_eq!(is_folder.kind(), io::ErrorKind::IsADirectory);
        fs::write(folder.path().join("file"), "").expect("written");
        let in_file = write_atomically(&folder.path().join("file/picture"), fill).expect_err("refused");
        assert_eq!(in_file.kind(), io::ErrorKind::NotADirectory);
    }

    #[test]
    fn links_are_followed_to_the_file_they_lead_to() {
        let folder = tempfile::tempdir().expect("folder");
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("store")).expect("folder");
        fs::write(at("store/old"), "old").expect("written");
        symlink("store/old", at("link")).expect("linked");
        symlink("link", at("chain")).expect("linked");
        symlink("store/new", at("dangling")).expect("linked");
        for (name, file) in [("link", "store/old"), ("chain", "store/old"), ("dangling", "store/new")] {
            check(&at(name)).expect("writable");
            write_atomically(&at(name), |mut file| file.write_all(name.as_bytes())).expect("written");
            assert!(fs::symlink_metadata(at(name)).expect("there").is_symlink(), "{name}");
            assert_eq!(fs::read_to_string(at(file)).expect("read"), name);
            assert_eq!(destination(&at(name)).expect("there"), destination(&at(file)).expect("there"));
        }
        assert_eq!(names_in(&at("store")).len(), 2);
        symlink("circle", at("circle")).expect("linked");
        assert!(check(&at("circle")).expect_err("refused").to_string().contains("circle"));
        symlink("nowhere/file", at("lost")).expect("linked");
        assert_eq!(check(&at("lost")).expect_err("refused").kind(), ErrorKind::NotFound);
    }

    #[test]
    fn what_is_no_file_is_refused_before_anything_is_written() {
        for path in ["/dev/full", "/dev/null"] {
            assert!(check(Path::new(path)).expect_err("refused").to_string().contains("device"), "{path}");
        }
        assert!(check(Path::new("/proc/picture")).is_err());
        let folder = tempfile::tempdir().expect("folder");
        assert_eq!(check(folder.path()).expect_err("refused").kind(), ErrorKind::IsADirectory);
        let path = folder.path().join("picture");
        check(&path).expect("writable");
        fs::write(&path, "old").expect("written");
        check(&path).expect("writable");
        assert_eq!(fs::read(&path).expect("read"), b"old");
        assert_eq!(names_in(folder.path()), ["picture"]);
    }
}
