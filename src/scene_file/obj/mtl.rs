//! Materials of OBJ files (MTL), taken for the nearest that there is here. They were made for another kind of shading, so this
//! is a start and no measurement.

use super::super::mesh_file::{MeshFileError, MeshPlace, in_file, number, read_bytes, words};
use super::rest;
use glam::Vec3;
use std::path::Path;

/// Longest file that is read.
const MOST_BYTES: usize = 8 << 20;

/// A material of an MTL file, as far as it is read.
#[derive(Clone, Debug, PartialEq)]
pub struct MtlMaterial {
    /// Name.
    pub name: String,
    /// What it becomes.
    pub finish: MtlFinish,
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
#[derive(Clone, Copy, Debug)]
struct Values {
    kd: Vec3,
    ks: Vec3,
    ns: f64,
    ni: f64,
    dissolve: f64,
    illum: f64,
}

impl Default for Values {
    fn default() -> Self {
        Self { kd: Vec3::splat(0.8), ks: Vec3::ZERO, ns: 0.0, ni: 1.0, dissolve: 1.0, illum: 2.0 }
    }
}

impl Values {
    fn finish(self) -> MtlFinish {
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
            b"Kd" | b"Ks"
                if !text.windows(8).any(|word| word == b"spectral")
                    && !text.windows(3).any(|word| word == b"xyz") =>
            {
                let red = value("red")?;
                let colour = match words(text).nth(2) {
                    None => Vec3::splat(red as f32),
                    Some(_) => Vec3::new(red as f32, value("green")? as f32, value("blue")? as f32),
                };
                if keyword == b"Kd" { values.kd = colour } else { values.ks = colour }
            }
            b"Ns" => values.ns = value("the exponent")?,
            b"Ni" => values.ni = value("the index of refraction")?,
            b"d" if !text.windows(5).any(|word| word == b"-halo") => values.dissolve = value("the dissolve")?,
            b"Tr" => values.dissolve = 1.0 - value("the transparency")?,
            b"illum" => values.illum = value("the illumination model")?,
            _ => {}
        }
    }
    Ok(materials.into_iter().map(|(name, values)| MtlMaterial { name, finish: values.finish() }).collect())
}
