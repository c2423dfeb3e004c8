//! Picture files: EXR with many layers, PNG, and the formats that OpenImageIO reads.
//!
//! [`write_exr`], [`write_png`], [`write_text`] and [`write_bytes`] are atomic. The data go to a temporary file in the same folder. It is
//! renamed to the final name only when it is complete and on the disk. After a failure or an interruption, the final name holds either the
//! whole new file or the old one, and the temporary file is removed. (A process that ends by `SIGKILL` or a power cut cannot remove it:
//! `.NAME.*.cardioid.tmp` is then left, and the next write to the same file removes it.)
//!
//! [`read`] does not trust its input: the size of a picture is checked against a limit before memory is allocated, and a damaged file is an
//! error.

mod atomic;
mod error;
mod exr_header;
mod image;
mod oiio;
mod radiance;
mod read;
mod tiled;
mod write;

pub use error::ImageError;
pub use image::{Image, Layer, MetadataValue, Window};
pub use oiio::{library_failure, library_version, load_library};
pub use read::{DEFAULT_LIMIT, read, read_bytes, read_with_limit};
pub use tiled::{TiledImage, set_tile_memory, take_tile_failures};
pub use write::{
    PngPixels, check_writable, is_same_file, is_standard_output, is_written_by_cardioid, time_to_write_exr,
    write_bytes, write_exr, write_png, write_text, write_with,
};

/// Whether an attribute describes the storage of a file and not its content. Such attributes are instructions to OpenImageIO on writing
/// and its findings on reading.
fn is_storage(name: &str) -> bool {
    const NAMES: [&str; 4] = ["compression", "PixelAspectRatio", "screenWindowCenter", "screenWindowWidth"];
    const PREFIXES: [&str; 9] = ["oiio", "openexr", "png", "jpeg", "hdr", "tiff", "bmp", "webp", "targa"];
    match name.split_once(':') {
        None => NAMES.iter().any(|known| name.eq_ignore_ascii_case(known)),
        Some((prefix, _)) => PREFIXES.iter().any(|known| prefix.eq_ignore_ascii_case(known)),
    }
}
