//! Checks the memory that an EXR would require, before the decoder opens it.
//!
//! When OpenEXR opens a file, it allocates memory for tables and blocks as the header claims: gigabytes for a damaged file of a few bytes.
//! So the claims of the header are read here first, and only a file with claims within the limits is opened. The layout is that of
//! <https://openexr.com/en/latest/OpenEXRFileLayout.html>.

use std::io::{self, BufRead, Read, Seek, SeekFrom};

/// First bytes of each EXR.
pub(super) const MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// Most values (of 2 or 4 bytes) of one block. A block is a tile or the rows that are compressed together. The decoder holds a few blocks
/// per thread, of at most 128 MiB each. Rows of 16384 pixels with 128 channels, compressed as this renderer does, reach the limit.
pub(super) const BLOCK_LIMIT: u64 = 1 << 25;

/// Longest name of an attribute or channel that the format allows.
const LONGEST_NAME: u64 = 255;

/// Longest accepted list of channels: 1024 channels (the most that OpenImageIO accepts) with the longest names.
const LONGEST_CHANNEL_LIST: u64 = 1024 * (LONGEST_NAME + 17) + 1;

const FLAG_DEEP: u32 = 0x800;
const FLAG_PARTS: u32 = 0x1000;

/// Reason to refuse a file.
#[derive(Debug)]
pub(super) enum Fault {
    /// The file cannot be read.
    System(io::Error),
    /// The header is damaged.
    Damaged(&'static str),
    /// The picture is deep: its pixels have many samples.
    Deep,
    /// The file or one block has more values than allowed.
    TooLarge { values: u64, limit: u64 },
}

impl From<io::Error> for Fault {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::UnexpectedEof => Self::Damaged("the header ends early"),
            _ => Self::System(error),
        }
    }
}

/// Claims of the header of one part.
#[derive(Default)]
struct Claims {
    width: Option<u64>,
    height: Option<u64>,
    channels: Option<u64>,
    rows_per_block: Option<u64>,
    tile: Option<(u64, u64)>,
    chunks: Option<u64>,
}

/// Checks that all claims of the file are within the limits.
pub(super) fn check(mut file: impl BufRead + Seek, limit: u64) -> Result<(), Fault> {
    let magic: [u8; 4] = read_array(&mut file)?;
    let version = u32::from_le_bytes(read_array(&mut file)?);
    if magic != MAGIC {
        return Err(Fault::Damaged("no EXR"));
    }
    if version & FLAG_DEEP != 0 {
        return Err(Fault::Deep);
    }
    let mut total = 0_u64;
    while let Some(claims) = read_part(&mut file)? {
        total = total.saturating_add(check_part(&claims, limit)?);
        within(total, limit)?;
        if version & FLAG_PARTS == 0 {
            break;
        }
    }
    Ok(())
}

/// Number of values of a part, after a check against the limits.
fn check_part(claims: &Claims, limit: u64) -> Result<u64, Fault> {
    let (Some(width), Some(height), Some(channels)) = (claims.width, claims.height, claims.channels) else {
        return Err(Fault::Damaged("the header lacks the size or the channels"));
    };
    let rows = claims.rows_per_block.ok_or(Fault::Damaged("the header lacks the compression"))?;
    let strip = (width, rows);
    for (block_width, block_height) in [strip].into_iter().chain(claims.tile) {
        within(block_width.saturating_mul(block_height).saturating_mul(channels), BLOCK_LIMIT)?;
    }
    within(claims.chunks.unwrap_or(0), limit)?;
    let values = width.saturating_mul(height).saturating_mul(channels);
    within(values, limit)?;
    Ok(values)
}

fn within(values: u64, limit: u64) -> Result<(), Fault> {
    if values > limit { Err(Fault::TooLarge { values, limit }) } else { Ok(()) }
}

/// Reads the header of one part; `None` after the last part.
fn read_part(file: &mut (impl BufRead + Seek)) -> Result<Option<Claims>, Fault> {
    let mut claims = Claims::default();
    let mut name = read_name(file)?;
    if name.is_empty() {
        return Ok(None);
    }
    while !name.is_empty() {
        let kind = read_name(file)?;
        let size = i32::from_le_bytes(read_array(file)?);
        let size = u64::try_from(size).map_err(|_| Fault::Damaged("an attribute has a negative size"))?;
        let end = file.stream_position()?.saturating_add(size);
        read_claim(file, &name, &kind, size, &mut claims)?;
        file.seek(SeekFrom::Start(end))?;
        name = read_name(file)?;
    }
    Ok(Some(claims))
}

/// Reads the value of an attribute that affects memory; other attributes are ignored.
fn read_claim(
    file: &mut impl BufRead,
    name: &[u8],
    kind: &[u8],
    size: u64,
    claims: &mut Claims,
) -> Result<(), Fault> {
    match (name, kind, size) {
        (b"dataWindow", b"box2i", 16) => {
            let [left, top, right, bottom] =
                [read_i32(file)?, read_i32(file)?, read_i32(file)?, read_i32(file)?];
            set(&mut claims.width, extent(left, right)?)?;
            set(&mut claims.height, extent(top, bottom)?)
        }
        (b"channels", b"chlist", _) => set(&mut claims.channels, count_channels(file, size)?),
        (b"compression", b"compression", 1) => {
            let [code] = read_array(file)?;
            set(&mut claims.rows_per_block, rows_per_block(code))
        }
        (b"tiles", b"tiledesc", 9) => {
            let width = u32::from_le_bytes(read_array(file)?);
            let height = u32::from_le_bytes(read_array(file)?);
            set(&mut claims.tile, (width.into(), height.into()))
        }
        (b"chunkCount", b"int", 4) => {
            set(&mut claims.chunks, u64::try_from(read_i32(file)?).unwrap_or(u64::MAX))
        }
        (b"type", _, _) if size < LONGEST_NAME => {
            let mut value = Vec::new();
            file.take(size).read_to_end(&mut value)?;
            if value.starts_with(b"deep") { Err(Fault::Deep) } else { Ok(()) }
        }
        (b"dataWindow" | b"channels" | b"compression" | b"tiles" | b"chunkCount", _, _) => {
            Err(Fault::Damaged("an attribute has the wrong type"))
        }
        _ => Ok(()),
    }
}

fn set<T>(claim: &mut Option<T>, value: T) -> Result<(), Fault> {
    match claim.replace(value) {
        None => Ok(()),
        Some(_) => Err(Fault::Damaged("the header says the same twice")),
    }
}

/// Number of pixels from the first to the last, inclusive.
fn extent(first: i32, last: i32) -> Result<u64, Fault> {
    u64::try_from(i64::from(last) - i64::from(first) + 1)
        .ok()
        .filter(|&extent| extent > 0)
        .ok_or(Fault::Damaged("the size is not positive"))
}

/// Number of channels in a list: each a name, its type (4 bytes), a flag (1), padding (3) and its sampling (8).
fn count_channels(file: &mut impl BufRead, size: u64) -> Result<u64, Fault> {
    if size > LONGEST_CHANNEL_LIST {
        return Err(Fault::Damaged("the list of channels is too long"));
    }
    let mut list = file.take(size);
    let mut count = 0;
    while !read_name(&mut list)?.is_empty() {
        let _: [u8; 16] = read_array(&mut list)?;
        count += 1;
    }
    Ok(count)
}

/// Number of rows that are compressed together; for an unknown compression, the largest of all known ones.
const fn rows_per_block(compression: u8) -> u64 {
    match compression {
        0..=2 => 1,
        3 | 5 => 16,
        4 | 6..=8 => 32,
        _ => 256,
    }
}

/// Reads a name up to its NUL, which is not returned.
fn read_name(file: &mut impl BufRead) -> Result<Vec<u8>, Fault> {
    let mut name = Vec::new();
    file.take(LONGEST_NAME + 1).read_until(0, &mut name)?;
    match name.pop() {
        Some(0) => Ok(name),
        _ => Err(Fault::Damaged("a name in the header does not end")),
    }
}

fn read_i32(file: &mut impl Read) -> io::Result<i32> {
    read_array(file).map(i32::from_le_bytes)
}

fn read_array<const N: usize>(file: &mut impl Read) -> io::Result<[u8; N]> {
    let mut bytes = [0; N];
    file.read_exact(&mut bytes)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    fn attribute(name: &str, kind: &str, value: &[u8]) -> Vec<u8> {
        let size = i32::try_from(value.len()).expect("short").to_le_bytes();
        [name.as_bytes(), &[0], kind.as_bytes(), &[0], &size, value].concat()
    }

    fn part(width: i32, height: i32, channels: u32, compression: u8, more: &[Vec<u8>]) -> Vec<u8> {
        let window: Vec<u8> =
            [0, 0, width - 1, height - 1].iter().flat_map(|n: &i32| n.to_le_bytes()).collect();
        let mut list: Vec<u8> = (0..channels).flat_map(|_| [&b"c\0"[..], &[0; 16]].concat()).collect();
        list.push(0);
        [
            attribute("channels", "chlist", &list),
            attribute("compression", "compression", &[compression]),
            attribute("dataWindow", "box2i", &window),
            more.concat(),
            vec![0],
        ]
        .concat()
    }

    fn exr(flags: u32, parts: &[Vec<u8>]) -> Cursor<Vec<u8>> {
        Cursor::new([&MAGIC[..], &(2 | flags).to_le_bytes(), &parts.concat()].concat())
    }

    fn tiles(width: u32, height: u32) -> Vec<u8> {
        attribute("tiles", "tiledesc", &[&width.to_le_bytes()[..], &height.to_le_bytes(), &[0]].concat())
    }

    #[test]
    fn values_of_all_parts_count_towards_the_limit() {
        let one = part(10, 20, 3, 3, &[]);
        check(exr(0, std::slice::from_ref(&one)), 600).expect("within");
        assert!(matches!(
            check(exr(0, std::slice::from_ref(&one)), 599),
            Err(Fault::TooLarge { values: 600, limit: 599 })
        ));
        let two = [one.clone(), one, vec![0]];
        check(exr(FLAG_PARTS, &two), 1200).expect("within");
        assert!(matches!(
            check(exr(FLAG_PARTS, &two), 1199),
            Err(Fault::TooLarge { values: 1200, limit: 1199 })
        ));
    }

    #[test]
    fn blocks_have_a_limit_of_their_own() {
        let wide = |compression| exr(0, &[part(1 << 20, 1, 1, compression, &[])]);
        check(wide(4), u64::MAX).expect("32 rows are within");
        assert!(matches!(check(wide(9), u64::MAX), Err(Fault::TooLarge { limit: BLOCK_LIMIT, .. })));
        let tiled = |width| exr(0x200, &[part(1, 1, 1, 0, &[tiles(width, 1 << 15)])]);
        check(tiled(1 << 10), u64::MAX).expect("within");
        assert!(matches!(check(tiled((1 << 10) + 1), u64::MAX), Err(Fault::TooLarge { .. })));
        let chunks = attribute("chunkCount", "int", &(-1_i32).to_le_bytes());
        assert!(matches!(
            check(exr(0, &[part(1, 1, 1, 0, &[chunks])]), 1 << 30),
            Err(Fault::TooLarge { .. })
        ));
    }

    #[test]
    fn largest_claims_do_not_overflow() {
        let window: Vec<u8> =
            [i32::MIN, i32::MIN, i32::MAX, i32::MAX].iter().flat_map(|n| n.to_le_bytes()).collect();
        let list = [&b"c\0"[..], &[0; 16], &[0]].concat();
        let part = [
            attribute("channels", "chlist", &list),
            attribute("compression", "compression", &[0]),
            attribute("dataWindow", "box2i", &window),
            vec![0],
        ]
        .concat();
        assert!(matches!(check(exr(0, &[part]), u64::MAX - 1), Err(Fault::TooLarge { .. })));
    }

    #[test]
    fn deep_files_are_told_by_flag_and_by_type() {
        assert!(matches!(check(exr(FLAG_DEEP, &[part(1, 1, 1, 0, &[])]), 9), Err(Fault::Deep)));
        let deep = attribute("type", "string", b"deepscanline");
        assert!(matches!(check(exr(FLAG_PARTS, &[part(1, 1, 1, 0, &[deep])]), 9), Err(Fault::Deep)));
    }

    #[test]
    fn damage_is_an_error_wherever_the_file_ends() {
        let whole = exr(0, &[part(10, 20, 3, 3, &[tiles(8, 8)])]).into_inner();
        check(Cursor::new(&whole), 600).expect("whole");
        for length in 0..whole.len() {
            assert!(matches!(check(Cursor::new(&whole[..length]), 600), Err(Fault::Damaged(_))), "{length}");
        }
        let twice = part(1, 1, 1, 0, &[attribute("compression", "compression", &[0])]);
        assert!(matches!(check(exr(0, &[twice]), 9), Err(Fault::Damaged(_))));
        let wrong_type = part(1, 1, 1, 0, &[attribute("tiles", "string", b"8")]);
        assert!(matches!(check(exr(0, &[wrong_type]), 9), Err(Fault::Damaged(_))));
        let negative = part(0, 1, 1, 0, &[]);
        assert!(matches!(check(exr(0, &[negative]), 9), Err(Fault::Damaged(_))));
    }
}
