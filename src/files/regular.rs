//! Opening and reading regular files.

use std::fs::{File, FileType, Metadata, OpenOptions};
use std::io::{self, Read};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::Path;

/// Name of a kind of file that is not regular.
fn odd_kind(kind: FileType) -> &'static str {
    if kind.is_dir() {
        "a folder"
    } else if kind.is_fifo() {
        "a pipe"
    } else if kind.is_socket() {
        "a socket"
    } else {
        "a device"
    }
}

fn check(metadata: &Metadata) -> io::Result<()> {
    let kind = metadata.file_type();
    if kind.is_file() {
        return Ok(());
    }
    let remedy = if kind.is_fifo() { ": save what comes through it as a file, and name that" } else { "" };
    let message = format!("it is {} and not a regular file{remedy}", odd_kind(kind));
    let error = if kind.is_dir() { io::ErrorKind::IsADirectory } else { io::ErrorKind::InvalidInput };
    Err(io::Error::new(error, message))
}

/// Opens a regular file for reading and returns its length in bytes. It never blocks: a pipe without a writer is refused like any other
/// file that is not regular.
///
/// # Errors
/// If the system reports an error, or if the file is not regular.
pub fn open_regular(path: impl AsRef<Path>) -> io::Result<(File, u64)> {
    let path = path.as_ref();
    // The check comes first, as opening a device may have side effects.
    check(&std::fs::metadata(path)?)?;
    // The file may have been replaced since the check, so it is opened without blocking and checked again.
    let file =
        OpenOptions::new().read(true).custom_flags(rustix::fs::OFlags::NONBLOCK.bits() as i32).open(path)?;
    let metadata = file.metadata()?;
    check(&metadata)?;
    Ok((file, metadata.len()))
}

/// Reads a regular file of at most `limit` bytes.
///
/// # Errors
/// As for [`open_regular`], and if the file is longer than `limit` or than its length when it was opened.
pub fn read_regular(path: impl AsRef<Path>, limit: u64) -> io::Result<Vec<u8>> {
    let (file, length) = open_regular(path)?;
    if length > limit {
        let message = format!("it has {length} bytes, and at most {limit} are read");
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, message));
    }
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(length as usize)?;
    // System files may be endless, whatever length they report.
    file.take(length + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > length {
        let message = format!("it has more than the {length} bytes it had when it was opened");
        return Err(io::Error::new(io::ErrorKind::InvalidData, message));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;
    use std::time::{Duration, Instant};

    #[test]
    fn only_regular_files_are_opened_and_nothing_is_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&pipe, &link).unwrap();
        let start = Instant::now();
        for (path, what) in [
            (pipe.as_path(), "a pipe"),
            (&link, "a pipe"),
            (folder.path(), "a folder"),
            (Path::new("/dev/zero"), "a device"),
        ] {
            let message = read_regular(path, u64::MAX).unwrap_err().to_string();
            assert!(message.contains(what) && message.contains("not a regular file"), "{message}");
        }
        assert!(start.elapsed() < Duration::from_secs(10));
        assert!(open_regular(folder.path().join("none")).is_err());
    }

    #[test]
    fn lengths_are_bounds() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, b"12345").unwrap();
        assert_eq!(read_regular(&path, 5).unwrap(), b"12345");
        assert!(read_regular(&path, 4).unwrap_err().to_string().contains("5 bytes"));
        // A sparse file takes no disk; it must not take memory.
        File::create(&path).unwrap().set_len(1 << 40).unwrap();
        assert!(read_regular(&path, 1 << 20).is_err());
        // This file is regular and has a length of zero, but is not empty.
        assert!(read_regular("/proc/self/status", 1 << 20).is_err());
    }
}
