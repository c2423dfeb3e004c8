//! Materials of OBJ files (MTL), converted to the nearest models of this renderer. They were made for another shading model, so
//! the result is a start and not a measurement.

use super::super::mesh_file::{Failure, MeshFileError, MeshPlace, in_file, number, shown, words};
use super::rest;
use crate::files::{foreign_by_content, read_regular, text_of};
use glam::{Vec2, Vec3};
use std::path::{Path, PathBuf};

/// Longest file that is read.
const MOST_BYTES: usize = 8 << 20;

/// A material of an MTL file, as far as it is supported.
#[derive(Clone, Debug, PartialEq)]
pub struct MtlMaterial {
    /// Name.
    pub name: String,
    /// The model that it becomes.
    pub finish: MtlFinish,
    /// `map_Kd`: a picture that multiplies `Kd`.
    pub picture: Option<MtlPicture>,
    /// `map_d`: a picture of the surface's coverage (1 or 0), from its alpha, or from its red channel where it has no alpha.
    pub cutout: Option<MtlPicture>,
    /// `Ke`: emitted radiance, interpreted as W/(m^2 sr).
    pub emission: Vec3,
    /// Unsupported statements that would change the look, with their lines.
    pub unread: Vec<(String, usize)>,
    /// Statements that were interpreted differently, with their lines.
    pub notes: Vec<(&'static str, usize)>,
}

/// A picture on a surface. A point of the mesh with the coordinates `uv` shows the picture at `scale uv + offset`, from the lower
/// left.
#[derive(Clone, Debug, PartialEq)]
pub struct MtlPicture {
    /// The file, relative to the folder of the MTL.
    pub file: PathBuf,
    /// `-s`.
    pub scale: Vec2,
    /// `-o`.
    pub offset: Vec2,
    /// `-clamp on`: outside the picture its edge is continued, instead of a repetition of the picture.
    pub clamped: bool,
}

/// The model that a material becomes.
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
    /// With `Pm` or `Pr`: the metallic-roughness model of glTF.
    Metallic {
        /// `Kd`.
        base: Vec3,
        /// `Pm`.
        metallic: f32,
        /// `Pr`, or derived from `Ns`: the square root of the facets' slope.
        roughness: f32,
        /// `Pc`.
        coat: f32,
        /// `Pcr`.
        coat_roughness: f32,
    },
    /// Transparent by `d`, `Tr` or `illum`: clear glass with the index `Ni`.
    Glass(f64),
}

/// The values of a material as given in the file.
#[derive(Clone, Debug)]
struct Values {
    ke: Vec3,
    picture: Option<MtlPicture>,
    cutout: Option<MtlPicture>,
    unread: Vec<(String, usize)>,
    notes: Vec<(&'static str, usize)>,
    /// With its line, or 0 for the default.
    kd: (Vec3, usize),
    ks: Vec3,
    ns: f64,
    ni: f64,
    /// `d` and `Tr`, with their lines.
    dissolve: Option<(f64, usize)>,
    transparency: Option<(f64, usize)>,
    /// `Tf` and its line.
    filter: Option<(Vec3, usize)>,
    illum: f64,
    metallic: Option<f64>,
    roughness: Option<f64>,
    coat: f64,
    coat_roughness: f64,
}

impl Default for Values {
    fn default() -> Self {
        Self {
            ke: Vec3::ZERO,
            picture: None,
            cutout: None,
            unread: Vec::new(),
            notes: Vec::new(),
            kd: (Vec3::splat(0.8), 0),
            ks: Vec3::ZERO,
            ns: 0.0,
            ni: 1.0,
            dissolve: None,
            transparency: None,
            filter: None,
            illum: 2.0,
            metallic: None,
            roughness: None,
            coat: 0.0,
            coat_roughness: 0.0,
        }
    }
}

impl Values {
    /// Opacity of the surface, from `d` or `Tr`, whichever is plausible.
    fn opacity(&mut self) -> f64 {
        const TR_ONE: &str = "`Tr 1` is taken for opaque, as MeshLab and the tools of scanners mean it; write `d 0` and `illum 4` for clear \
                              glass";
        /// Rounding errors of printed values.
        const SAME: f64 = 1e-3;
        match (self.dissolve, self.transparency) {
            (None, None) => 1.0,
            (None, Some((tr, line))) if tr >= 1.0 => {
                self.notes.push((TR_ONE, line));
                1.0
            }
            (None, Some((tr, _))) => 1.0 - tr,
            (Some((d, _)), Some((tr, line))) if (d + tr - 1.0).abs() > SAME => {
                let note = if d >= 1.0 && tr >= 1.0 {
                    TR_ONE
                } else {
                    "`Tr` contradicts `d` of the same material, as `d` is 1 less `Tr`: `d` counts"
                };
                self.notes.push((note, line));
                d
            }
            (Some((d, line)), None) if d <= 0.0 && !self.is_raytraced() && self.picture.is_some() => {
                let note = "`d 0` would hide a surface that has a picture: it is taken for opaque; write `illum 4` for clear glass";
                self.notes.push((note, line));
                1.0
            }
            (Some((d, _)), _) => d,
        }
    }

    /// Whether `illum` selects refraction.
    fn is_raytraced(&self) -> bool {
        matches!(self.illum as i64, 4 | 6 | 7 | 9)
    }

    /// Chooses the model, and notes values that are interpreted differently.
    fn finish(&mut self) -> MtlFinish {
        /// Largest opacity of glass. A more opaque surface is a cut-out or a mistake more often than glass.
        const CLEAR: f64 = 0.5;
        /// Reflectance below which a colour counts as black.
        const DARK: f32 = 0.01;
        let opacity = self.opacity();
        let is_glass = self.is_raytraced();
        if let Some((filter, line)) = self.filter
            && (opacity < CLEAR || is_glass)
            && filter != Vec3::ONE
        {
            self.unread.push(("Tf".to_owned(), line));
        }
        if opacity < CLEAR || is_glass && opacity < 1.0 {
            return MtlFinish::Glass(if self.ni > 1.0 && self.ni < 10.0 { self.ni } else { 1.5 });
        }
        if opacity < 1.0
            && let Some((_, line)) = self.dissolve.or(self.transparency)
        {
            let note = "a surface that lets up to half of the light through is taken for opaque; write `illum 4` for clear glass";
            self.notes.push((note, line));
        }
        let fraction = |colour: Vec3| colour.clamp(Vec3::ZERO, Vec3::ONE);
        let (mut kd, ks) = (fraction(self.kd.0), fraction(self.ks));
        if kd == Vec3::ZERO && self.picture.is_some() {
            let note = "`Kd 0 0 0` would hide the picture of `map_Kd`: it is taken for white";
            self.notes.push((note, self.kd.1));
            kd = Vec3::ONE;
        }
        if self.metallic.is_some() || self.roughness.is_some() {
            let share = |value: f64| value.clamp(0.0, 1.0) as f32;
            return MtlFinish::Metallic {
                base: kd,
                metallic: share(self.metallic.unwrap_or(0.0)),
                roughness: share(self.roughness.unwrap_or_else(|| self.slope().sqrt())),
                coat: share(self.coat),
                coat_roughness: share(self.coat_roughness),
            };
        }
        if matches!(self.illum as i64, 3 | 5) && kd.max_element() <= DARK && ks.max_element() > DARK {
            return MtlFinish::Mirror(ks);
        }
        // `illum 0` and `1` mean no highlight, whatever `Ks` is.
        if ks.max_element() <= DARK || self.illum < 2.0 {
            return MtlFinish::Lambert(kd);
        }
        // Together they reflect at most all light.
        let most = (kd + ks).max_element().max(1.0);
        MtlFinish::Ward { diffuse: kd / most, gloss: ks / most, roughness: self.slope() as f32 }
    }

    /// Slope of the facets for the exponent `Ns`.
    fn slope(&self) -> f64 {
        (2.0 / (self.ns.max(0.0) + 2.0)).sqrt().clamp(1e-3, 1.0)
    }
}

/// Reads an MTL file.
///
/// # Errors
/// With the file, the line, the problem, and what to do.
pub fn read_mtl(path: &Path) -> Result<Vec<MtlMaterial>, MeshFileError> {
    let unreadable = |error| {
        let problem = format!("cannot be read: {error}; check its name and permissions");
        in_file(path, (MeshPlace::File, problem))
    };
    parse_mtl_bytes(&read_regular(path, MOST_BYTES as u64).map_err(unreadable)?, path)
}

/// Parses the bytes of a material file. Messages call it `path`.
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
    let whole = |problem| fail((MeshPlace::File, problem));
    if let Some(foreign) = foreign_by_content(Path::new(""), bytes) {
        return Err(whole(format!("no file of materials: it {foreign}")));
    }
    let bytes = &*text_of(bytes).map_err(|what| whole(what.to_owned()))?;
    let mut materials: Vec<(String, Values)> = Vec::new();
    for (index, text) in bytes.split(|&byte| byte == b'\n').enumerate() {
        let (text, line) = (text.trim_ascii(), index + 1);
        let Some(keyword) = words(text).next() else { continue };
        if keyword.eq_ignore_ascii_case(b"newmtl") {
            let name = String::from_utf8_lossy(rest(text, keyword)).into_owned();
            materials.push((name, Values::default()));
        } else if let Some((_, values)) = materials.last_mut() {
            values.statement(keyword, text, line).map_err(fail)?;
        }
    }
    let material = |(name, mut values): (String, Values)| {
        let finish = values.finish();
        let Values { picture, cutout, ke: emission, unread, notes, .. } = values;
        MtlMaterial { name, finish, picture, cutout, emission, unread, notes }
    };
    Ok(materials.into_iter().map(material).collect())
}

impl Values {
    /// Applies a statement after `newmtl`.
    fn statement(&mut self, keyword: &[u8], text: &[u8], line: usize) -> Result<(), Failure> {
        let mut parts = words(text).skip(1);
        let mut value = |what: &str| match number(parts.next(), line, what)? {
            value if value.is_finite() => Ok(value),
            _ => Err((MeshPlace::Line(line), format!("{what} is not finite; mend the line"))),
        };
        let known = keyword.to_ascii_lowercase();
        // Colours given by spectral files or in other colour spaces keep the default.
        let is_plain = !words(text).nth(1).is_some_and(|word| word == b"spectral" || word == b"xyz");
        match known.as_slice() {
            b"kd" | b"ks" | b"ke" | b"tf" if is_plain => {
                let red = value("red")?;
                let colour = match words(text).nth(2).filter(|word| !word.starts_with(b"#")) {
                    None => Vec3::splat(red as f32),
                    Some(_) => Vec3::new(red as f32, value("green")? as f32, value("blue")? as f32),
                };
                match known.as_slice() {
                    b"kd" => self.kd = (colour, line),
                    b"ks" => self.ks = colour,
                    b"ke" => self.ke = colour.max(Vec3::ZERO),
                    _ => self.filter = Some((colour, line)),
                }
            }
            b"ns" => self.ns = value("the exponent")?,
            b"ni" => self.ni = value("the index of refraction")?,
            b"d" if words(text).nth(1) != Some(b"-halo") => {
                self.dissolve = Some((value("the dissolve")?, line))
            }
            b"tr" => self.transparency = Some((value("the transparency")?, line)),
            b"illum" => self.illum = value("the illumination model")?,
            b"pm" => self.metallic = Some(value("the metallic share")?),
            b"pr" => self.roughness = Some(value("the roughness")?),
            b"pc" => self.coat = value("the clear coat")?,
            b"pcr" => self.coat_roughness = value("the roughness of the clear coat")?,
            b"map_kd" | b"map_d" => {
                let picture = picture(rest(text, keyword)).ok_or_else(|| {
                    (MeshPlace::Line(line), "no picture is named; name one or remove the line".to_owned())
                })?;
                let name = String::from_utf8_lossy(keyword);
                self.unread.extend(picture.1.into_iter().map(|option| (format!("{name} {option}"), line)));
                let of = if known == b"map_kd" { &mut self.picture } else { &mut self.cutout };
                *of = Some(picture.0);
            }
            // Without effect here: ambient light, which is computed, and the sharpening or blending of pictures.
            b"ka" | b"km" | b"map_ka" | b"sharpness" | b"map_aat" => {}
            // Without effect where the number is zero.
            b"ps" | b"aniso" | b"anisor" if value("the number")? == 0.0 => {}
            comment if comment.starts_with(b"#") => {}
            _ => self.unread.push((shown(keyword), line)),
        }
        Ok(())
    }
}

/// Parses `map_Kd`: options, and the file name, which may contain blanks. Also yields the unsupported options that would change
/// the picture.
fn picture(mut text: &[u8]) -> Option<(MtlPicture, Vec<&'static str>)> {
    let mut picture =
        MtlPicture { file: PathBuf::new(), scale: Vec2::ONE, offset: Vec2::ZERO, clamped: false };
    let mut unread = Vec::new();
    while text.starts_with(b"-") {
        let option = next_word(&mut text).to_ascii_lowercase();
        // `-s`, `-o` and `-t` have one to three numbers, `-mm` has two, all other options have one word.
        let mut numbers = [None; 3];
        let most = match option.as_slice() {
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
        match option.as_slice() {
            b"-s" => picture.scale = pair(1.0),
            b"-o" => picture.offset = pair(0.0),
            b"-t" if numbers.iter().flatten().any(|&number| number != 0.0) => unread.push("-t"),
            b"-mm" if pair(0.0) != Vec2::new(0.0, 1.0) => unread.push("-mm"),
            b"-t" | b"-mm" => {}
            b"-clamp" => picture.clamped = next_word(&mut text).eq_ignore_ascii_case(b"on"),
            b"-imfchan" => {
                next_word(&mut text);
                unread.push("-imfchan");
            }
            _ => {
                next_word(&mut text);
            }
        }
    }
    let name = String::from_utf8_lossy(text).replace('\\', "/");
    picture.file = PathBuf::from(name.trim_matches('"'));
    (!picture.file.as_os_str().is_empty()).then_some((picture, unread))
}

/// Removes a word and the following blanks from the start of a text.
fn next_word<'a>(text: &mut &'a [u8]) -> &'a [u8] {
    let end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
    let (word, left) = text.split_at(end);
    *text = left.trim_ascii_start();
    word
}
