//! Materials of OBJ files (MTL), taken for the nearest that there is here. They were made for another kind of shading, so this
//! is a start and no measurement.

use super::super::mesh_file::{MeshFileError, MeshPlace, in_file, number, read_bytes, words};
use super::rest;
use glam::{Vec2, Vec3};
use std::path::{Path, PathBuf};

/// Longest file that is read.
const MOST_BYTES: usize = 8 << 20;

/// A material of an MTL file, as far as it is read.
#[derive(Clone, Debug, PartialEq)]
pub struct MtlMaterial {
    /// Name.
    pub name: String,
    /// What it becomes.
    pub finish: MtlFinish,
    /// `map_Kd`: a picture that multiplies `Kd`.
    pub picture: Option<MtlPicture>,
    /// `Ke`: emitted radiance, taken for W/(m^2 sr).
    pub emission: Vec3,
    /// Statements that would change its look and are not read, and their lines.
    pub unread: Vec<(String, usize)>,
}

/// A picture on a surface. The point of the mesh with coordinates `uv` shows that of the picture at `scale uv + offset`, from the lower left.
#[derive(Clone, Debug, PartialEq)]
pub struct MtlPicture {
    /// The file, relative to the folder of the MTL.
    pub file: PathBuf,
    /// `-s`.
    pub scale: Vec2,
    /// `-o`.
    pub offset: Vec2,
    /// `-clamp on`: the border goes on outside, in place of the picture again.
    pub clamped: bool,
}

/// What a material becomes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MtlFinish {
    /// Matt: `Kd`.
    Lambert(Vec3),
    /// `illum 3` or `5` with `Kd` black: a mirror of `Ks`.
    Mirror(Vec3),
    /// `Ks` above zero: Ward's model with the slope of the exponent `Ns`.
    Ward {
        /// `Kd`.
        diffuse: Vec3,
        /// `Ks`.
        gloss: Vec3,
        /// `sqrt(2 / (Ns + 2))`.
        roughness: f32,
    },
    /// Transparent by `d`, `Tr` or `illum`: clear glass of the index `Ni`.
    Glass(f64),
}

/// The values of a material as the file has them.
#[derive(Clone, Debug)]
struct Values {
    ke: Vec3,
    picture: Option<MtlPicture>,
    unread: Vec<(String, usize)>,
    kd: Vec3,
    ks: Vec3,
    ns: f64,
    ni: f64,
    dissolve: f64,
    illum: f64,
}

impl Default for Values {
    fn default() -> Self {
        Self {
            ke: Vec3::ZERO,
            picture: None,
            unread: Vec::new(),
            kd: Vec3::splat(0.8),
            ks: Vec3::ZERO,
            ns: 0.0,
            ni: 1.0,
            dissolve: 1.0,
            illum: 2.0,
        }
    }
}

impl Values {
    fn finish(&self) -> MtlFinish {
        /// A surface that lets less through is a cut-out or a mistake more often than glass.
        const CLEAR: f64 = 0.5;
        /// Reflectance that counts as none.
        const DARK: f32 = 0.01;
        let is_glass = matches!(self.illum as i64, 4 | 6 | 7 | 9);
        if self.dissolve < CLEAR || is_glass && self.dissolve < 1.0 {
            return MtlFinish::Glass(if self.ni > 1.0 && self.ni < 10.0 { self.ni } else { 1.5 });
        }
        let fraction = |colour: Vec3| colour.clamp(Vec3::ZERO, Vec3::ONE);
        let (kd, ks) = (fraction(self.kd), fraction(self.ks));
        if matches!(self.illum as i64, 3 | 5) && kd.max_element() <= DARK && ks.max_element() > DARK {
            return MtlFinish::Mirror(ks);
        }
        // `illum 0` and `1` have no highlight, whatever `Ks` says.
        if ks.max_element() <= DARK || self.illum < 2.0 {
            return MtlFinish::Lambert(kd);
        }
        // Together they reflect at most all.
        let most = (kd + ks).max_element().max(1.0);
        let roughness = (2.0 / (self.ns.max(0.0) + 2.0)).sqrt().clamp(1e-3, 1.0) as f32;
        MtlFinish::Ward { diffuse: kd / most, gloss: ks / most, roughness }
    }
}

/// Reads an MTL file.
///
/// # Errors
/// With the file, the line, what is wrong and what to do.
pub fn read_mtl(path: &Path) -> Result<Vec<MtlMaterial>, MeshFileError> {
    parse_mtl_bytes(&read_bytes(path)?, path)
}

/// Parses the bytes of a file of materials; `path` is only for messages.
///
/// # Errors
/// As [`read_mtl`].
pub fn parse_mtl_bytes(bytes: &[u8], path: &Path) -> Result<Vec<MtlMaterial>, MeshFileError> {
    let fail = |failure| in_file(path, failure);
    if bytes.len() > MOST_BYTES {
        let problem =
            format!("{} bytes of materials, at most {MOST_BYTES} are read; remove some", bytes.len());
        return Err(fail((MeshPlace::File, problem)));
    }
    let mut materials: Vec<(String, Values)> = Vec::new();
    for (index, text) in bytes.split(|&byte| byte == b'\n').enumerate() {
        let (text, line) = (text.trim_ascii(), index + 1);
        let mut parts = words(text);
        let Some(keyword) = parts.next() else { continue };
        if keyword == b"newmtl" {
            let name = String::from_utf8_lossy(rest(text, keyword)).into_owned();
            materials.push((name, Values::default()));
            continue;
        }
        let Some((_, values)) = materials.last_mut() else { continue };
        let mut value = |what: &str| {
            let value = number(parts.next(), line, what).map_err(fail)?;
            if value.is_finite() {
                return Ok(value);
            }
            let problem = format!("{what} is not finite; mend the line");
            Err(fail((MeshPlace::Line(line), problem)))
        };
        match keyword {
            // Colours by spectral files or other coordinates keep the default.
            b"Kd" | b"Ks" | b"Ke"
                if !text.windows(8).any(|word| word == b"spectral")
                    && !text.windows(3).any(|word| word == b"xyz") =>
            {
                let red = value("red")?;
                let colour = match words(text).nth(2) {
                    None => Vec3::splat(red as f32),
                    Some(_) => Vec3::new(red as f32, value("green")? as f32, value("blue")? as f32),
                };
                match keyword {
                    b"Kd" => values.kd = colour,
                    b"Ks" => values.ks = colour,
                    _ => values.ke = colour.max(Vec3::ZERO),
                }
            }
            b"Ns" => values.ns = value("the exponent")?,
            b"Ni" => values.ni = value("the index of refraction")?,
            b"d" if !text.windows(5).any(|word| word == b"-halo") => values.dissolve = value("the dissolve")?,
            b"Tr" => values.dissolve = 1.0 - value("the transparency")?,
            b"illum" => values.illum = value("the illumination model")?,
            b"map_Kd" => {
                let picture = picture(rest(text, keyword));
                let problem = "no picture is named; name one or remove the line".to_owned();
                values.picture = Some(picture.ok_or_else(|| fail((MeshPlace::Line(line), problem)))?);
            }
            // That of ambient light, which is computed here.
            b"map_Ka" => {}
            _ if UNREAD.contains(&keyword) || keyword.starts_with(b"map_") => {
                values.unread.push((String::from_utf8_lossy(keyword).into_owned(), line));
            }
            _ => {}
        }
    }
    let material = |(name, values): (String, Values)| {
        let finish = values.finish();
        let Values { picture, ke: emission, unread, .. } = values;
        MtlMaterial { name, finish, picture, emission, unread }
    };
    Ok(materials.into_iter().map(material).collect())
}

/// Statements, apart from those that begin with `map_`, that change the look of a material and are not read.
const UNREAD: [&[u8]; 11] =
    [b"bump", b"disp", b"decal", b"refl", b"norm", b"Tf", b"Pr", b"Pm", b"Ps", b"Pc", b"aniso"];

/// What `map_Kd` says: options, and the name of the file, which may have blanks.
fn picture(mut text: &[u8]) -> Option<MtlPicture> {
    let mut picture =
        MtlPicture { file: PathBuf::new(), scale: Vec2::ONE, offset: Vec2::ZERO, clamped: false };
    while text.starts_with(b"-") {
        let option = next_word(&mut text);
        // `-s`, `-o` and `-t` have one to three numbers, `-mm` two, all others one word.
        let mut numbers = [None; 3];
        let most = match option {
            b"-s" | b"-o" | b"-t" => 3,
            b"-mm" => 2,
            _ => 0,
        };
        for number in numbers.iter_mut().take(most) {
            let mut after = text;
            let word = std::str::from_utf8(next_word(&mut after)).ok();
            let Some(value) = word.and_then(|word| word.parse::<f32>().ok()).filter(|x| x.is_finite()) else {
                break;
            };
            *number = Some(value);
            text = after;
        }
        let pair = |default| Vec2::new(numbers[0].unwrap_or(default), numbers[1].unwrap_or(default));
        match option {
            b"-s" => picture.scale = pair(1.0),
            b"-o" => picture.offset = pair(0.0),
            b"-t" | b"-mm" => {}
            b"-clamp" => picture.clamped = next_word(&mut text) == b"on",
            _ => {
                next_word(&mut text);
            }
        }
    }
    let name = String::from_utf8_lossy(text).replace('\\', "/");
    picture.file = PathBuf::from(name);
    (!picture.file.as_os_str().is_empty()).then_some(picture)
}

/// Takes a word and the blanks behind it off a text.
fn next_word<'a>(text: &mut &'a [u8]) -> &'a [u8] {
    let end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
    let (word, left) = text.split_at(end);
    *text = left.trim_ascii_start();
    word
}
