//! Packed bricks in a temporary file without a name, until all are known and can be written in order.

use std::fs::File;
use std::io::{self, Write};
use std::os::unix::fs::FileExt;
use std::path::Path;

/// Bytes that are collected before they are written.
const BUFFER: usize = 1 << 20;

/// A packed brick.
#[derive(Clone, Copy, Debug)]
pub(super) struct Entry {
    pub(super) level: u8,
    /// Which of the eight children have bricks.
    pub(super) children: u8,
    /// Morton code of the node within its level.
    pub(super) code: u64,
    pub(super) bytes: u16,
    /// Checksum of the packed brick.
    pub(super) sum: u64,
    at: u64,
}

/// Packed bricks on disk. The file has no name, so that nothing is left of it however the process ends.
#[derive(Debug)]
pub(super) struct Spool {
    file: File,
    buffer: Vec<u8>,
    flushed: u64,
    pub(super) entries: Vec<Entry>,
}

impl Spool {
    /// A spool on the disk of `folder`.
    pub(super) fn new(folder: &Path) -> io::Result<Self> {
        let file = tempfile::tempfile_in(folder)?;
        Ok(Self { file, buffer: Vec::new(), flushed: 0, entries: Vec::new() })
    }

    pub(super) fn push(&mut self, level: u32, (code, children): (u64, u8), packed: &[u8]) -> io::Result<()> {
        self.entries.push(Entry {
            level: level as u8,
            children,
            code,
            bytes: packed.len() as u16,
            sum: checksum(packed),
            at: self.flushed + self.buffer.len() as u64,
        });
        self.buffer.extend(packed);
        if self.buffer.len() >= BUFFER { self.flush() } else { Ok(()) }
    }

    pub(super) fn flush(&mut self) -> io::Result<()> {
        (&self.file).write_all(&self.buffer)?;
        self.flushed += self.buffer.len() as u64;
        self.buffer.clear();
        Ok(())
    }

    /// Reads a packed brick, after [`Self::flush`].
    pub(super) fn read(&self, entry: &Entry, bytes: &mut Vec<u8>) -> io::Result<()> {
        bytes.resize(usize::from(entry.bytes), 0);
        self.file.read_exact_at(bytes, entry.at)
    }
}

/// The first eight bytes of BLAKE3: a damaged brick passes with a probability of 2^-64.
pub(super) fn checksum(bytes: &[u8]) -> u64 {
    let mut sum = [0; 8];
    sum.copy_from_slice(&blake3::hash(bytes).as_bytes()[..8]);
    u64::from_le_bytes(sum)
}
