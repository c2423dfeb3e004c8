//! Errors of picture files.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::atomic::folder_of;

/// An error of writing or reading a picture. The message names the file, the problem and a remedy.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The system refused to write.
    #[error("cannot write {}: {}", path.display(), write_remedy(path, cause))]
    Write {
        /// The file that was to be written.
        path: PathBuf,
        /// The error of the system.
        cause: io::Error,
    },

    /// The system refused to read.
    #[error("cannot read {}: {}", path.display(), read_remedy(cause))]
    Read {
        /// The file that was to be read.
        path: PathBuf,
        /// The error of the system.
        cause: io::Error,
    },

    /// The picture cannot be stored in a file of this kind.
    #[error("cannot write {}: OpenImageIO says: {reason}", path.display())]
    Encode {
        /// The file that was to be written.
        path: PathBuf,
        /// The message of OpenImageIO.
        reason: String,
    },

    /// OpenImageIO or a library that it needs is missing.
    #[error(
        "no picture can be written or read, as OpenImageIO cannot be loaded ({reason}): install it, or add its folder to \
         LD_LIBRARY_PATH"
    )]
    Library {
        /// The message of the loader.
        reason: String,
    },

    /// The picture is inconsistent, which is an error of the caller.
    #[error("cannot write {}: {reason}", path.display())]
    Inconsistent {
        /// The file that was to be written.
        path: PathBuf,
        /// The inconsistency.
        reason: String,
    },

    /// The file does not start like a picture of a known format.
    #[error(
        "{} is not a picture of a known kind (EXR, PNG, JPEG, Radiance HDR, TIFF, BMP, WebP, or TGA by its extension)",
        path.display()
    )]
    NotAPicture {
        /// The file that was to be read.
        path: PathBuf,
    },

    /// The file starts like a picture, but is damaged or incomplete.
    #[error("{} is damaged or incomplete ({reason}): make it anew, or copy it again", path.display())]
    Damaged {
        /// The file that was to be read.
        path: PathBuf,
        /// The damage found.
        reason: String,
    },

    /// The file is a picture of an unsupported kind.
    #[error("{} is {what}, which is not supported: convert it to a flat picture", path.display())]
    Unsupported {
        /// The file that was to be read.
        path: PathBuf,
        /// The kind of picture.
        what: &'static str,
    },

    /// Decoding the picture would take more memory than is allowed.
    #[error(
        "decoding {} takes {:.0} MB, and {:.0} MB are allowed for that: scale it down, or raise --memory-limit",
        path.display(), *needed as f64 / 1e6, *allowed as f64 / 1e6
    )]
    Memory {
        /// The file that was to be read.
        path: PathBuf,
        /// Bytes that decoding takes.
        needed: u64,
        /// Bytes that are allowed.
        allowed: u64,
    },

    /// The picture has more values than the caller allowed.
    #[error("{} holds {values} values, more than the {limit} allowed: scale it down, or split it", path.display())]
    TooLarge {
        /// The file that was to be read.
        path: PathBuf,
        /// Width times height times channels, of the picture or of one block that is decoded at once.
        values: u64,
        /// Allowed number of values.
        limit: u64,
    },
}

impl ImageError {
    /// The same error with `name` in place of the path `old`, for a file that was read from a temporary path.
    pub(super) fn renamed(self, old: &Path, name: &Path) -> Self {
        let path = name.to_owned();
        match self {
            Self::Read { cause, .. } => Self::Read { path, cause },
            Self::NotAPicture { .. } => Self::NotAPicture { path },
            Self::Damaged { reason, .. } => {
                let reason = reason.replace(&*old.to_string_lossy(), &name.to_string_lossy());
                Self::Damaged { path, reason }
            }
            Self::Unsupported { what, .. } => Self::Unsupported { path, what },
            Self::TooLarge { values, limit, .. } => Self::TooLarge { path, values, limit },
            other => other,
        }
    }
}

/// Message for an error of writing, with a remedy for common causes.
fn write_remedy(path: &Path, cause: &io::Error) -> String {
    let folder = match folder_of(path) {
        here if here == Path::new(".") => "the current folder".to_owned(),
        folder => folder.display().to_string(),
    };
    match cause.kind() {
        ErrorKind::NotFound if path.is_symlink() => {
            "it is a symbolic link into a folder that does not exist; create that, or remove the link"
                .to_owned()
        }
        // A system folder such as /proc.
        ErrorKind::NotFound if folder_of(path).is_dir() => {
            format!("{folder} takes no new files; write elsewhere")
        }
        ErrorKind::NotFound => format!("{folder} does not exist; create it, or write elsewhere"),
        ErrorKind::NotADirectory => format!("{folder} is not a folder; write elsewhere"),
        ErrorKind::IsADirectory => "it is a folder; name a file in it".to_owned(),
        ErrorKind::PermissionDenied => {
            format!("no permission to write in {folder}; change its permissions, or write elsewhere")
        }
        ErrorKind::ReadOnlyFilesystem => format!("{folder} is on a read-only disk; write elsewhere"),
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            format!("the disk of {folder} is full; free some space, or write elsewhere")
        }
        ErrorKind::FileTooLarge => {
            "it would be larger than this user may write (`ulimit -f`) or than its disk allows; raise the limit, or make a smaller \
             picture"
                .to_owned()
        }
        ErrorKind::InvalidFilename => {
            "the name is too long or has characters that the disk refuses".to_owned()
        }
        _ => cause.to_string(),
    }
}

fn read_remedy(cause: &io::Error) -> String {
    match cause.kind() {
        ErrorKind::NotFound => "there is no such file; check the path".to_owned(),
        ErrorKind::IsADirectory => "it is a folder; name a file in it".to_owned(),
        ErrorKind::PermissionDenied => "no permission to read it; change its permissions".to_owned(),
        _ => cause.to_string(),
    }
}
