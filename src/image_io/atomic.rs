//! Files that are complete or not there at all.

use std::fs::{File, Permissions};
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

/// Writes a file through `fill`, so that `path` changes only where everything succeeded.
///
/// The temporary file is in the folder of `path`, since only there can it be renamed in one step, and is removed on every
/// error and on unwinding.
pub(super) fn write_atomically<E: From<io::Error>>(
    path: &Path,
    fill: impl FnOnce(&File) -> Result<(), E>,
) -> Result<(), E> {
    if path.is_dir() {
        return Err(io::Error::from(io::ErrorKind::IsADirectory).into());
    }
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let Some(name) = path.file_name() else {
        return Err(io::Error::from(io::ErrorKind::InvalidFilename).into());
    };
    let mut prefix = std::ffi::OsString::from(".");
    prefix.push(name);
    prefix.push(".");
    let file = tempfile::Builder::new()
        .prefix(&prefix)
        .suffix(".tmp")
        // A picture is like any other file: for whom the user's umask says. (The default is the user alone.)
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(folder)
        .map_err(without_path)?;
    fill(file.as_file())?;
    // Before the rename, or a power cut could leave the final name on an empty file.
    file.as_file().sync_all()?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

/// The same error without the name of the temporary file, which tells the user nothing.
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
    use std::fs;
    use std::io::Write;
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
}
