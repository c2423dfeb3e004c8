//! Input files: opening of regular files, detection of file kinds, and texts with any line ends and byte-order mark.
//!
//! Every file that a command line or another file names is opened by [`open_regular`] or read by [`read_regular`]. So a pipe, a device or
//! a folder is an immediate error, and no read waits without end.

mod kind;
mod regular;
mod text;

pub use kind::{ForeignFile, foreign_by_content, foreign_file};
pub use regular::{open_regular, read_regular};
pub use text::{BYTE_ORDER_MARK, text_of};
