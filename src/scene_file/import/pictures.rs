//! Reads pictures and converts them to textures for their use.

use super::paint::{Paint, Use, luminance};
use crate::image_io::{Image, ImageError, Layer};
use crate::textures::{
    Encoding, ImageTexture, Sampler, TEXTURE_LIMIT, TextureBudget, TextureSlot, read_picture, srgb_to_linear,
};
use glam::{Affine2, DVec3, Vec4};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// File formats with linear values of any size.
fn is_linear(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    ["exr", "hdr", "rgbe", "pfm", "pic"].iter().any(|known| extension.eq_ignore_ascii_case(known))
}

/// The pixels as four numbers each, with the colour decoded where `is_encoded`.
fn pixels(image: &Image, is_encoded: bool) -> Vec<Vec4> {
    let Some(layer) = image.layers.first() else { return Vec::new() };
    let count = layer.channels.len().max(1);
    let decoded = |x: f32| if is_encoded { srgb_to_linear(x.clamp(0.0, 1.0)) } else { x };
    layer
        .data
        .chunks_exact(count)
        .map(|pixel| match *pixel {
            [grey] => Vec4::new(decoded(grey), decoded(grey), decoded(grey), 1.0),
            [grey, alpha] => Vec4::new(decoded(grey), decoded(grey), decoded(grey), alpha),
            [r, g, b] => Vec4::new(decoded(r), decoded(g), decoded(b), 1.0),
            [r, g, b, a, ..] => Vec4::new(decoded(r), decoded(g), decoded(b), a),
            [] => Vec4::ZERO,
        })
        .collect()
}

/// A texture with these pixels.
pub(crate) fn texture_of(width: u32, height: u32, pixels: &[Vec4]) -> ImageTexture {
    let data = pixels.iter().flat_map(|pixel| pixel.to_array()).collect();
    let mut image = Image::new(width, height);
    image.layers.push(Layer::new("", &["R", "G", "B", "A"], data));
    ImageTexture::new(&image, Encoding::Linear)
}

/// A texel that holds `value` where this use expects it.
pub(crate) fn texel_of(value: f32, how: Use) -> Vec4 {
    match how {
        Use::Slope => Vec4::new(1.0, value.max(0.0).sqrt(), 1.0, 1.0),
        Use::Roughness => Vec4::new(1.0, value, 1.0, 1.0),
        Use::Blue => Vec4::new(1.0, 1.0, value, 1.0),
        Use::Alpha => Vec4::new(1.0, 1.0, 1.0, value),
        Use::Colour | Use::Glow | Use::Raw => Vec4::new(value, value, value, 1.0),
    }
}

/// Two colours in squares of half a unit, the first at the origin.
pub(crate) fn checkers(colours: [DVec3; 2], how: Use, transform: Affine2) -> Paint {
    let brightest = colours[0].max(colours[1]).max_element().max(1.0);
    let texel = |colour: DVec3| match how {
        Use::Colour | Use::Glow | Use::Raw => (colour / brightest).as_vec3().extend(1.0),
        _ => texel_of(luminance(colour) as f32, how),
    };
    let [a, b] = colours.map(texel);
    let texture = Arc::new(texture_of(2, 2, &[a, b, b, a]));
    let sampler = Sampler { nearest: true, finest: true, ..Sampler::default() };
    let slot = TextureSlot { texture, sampler, set: 0, transform };
    Paint::Picture(slot, DVec3::splat(brightest))
}

/// The pictures of a scene, each read once for each use.
#[derive(Debug, Default)]
pub(crate) struct Pictures {
    known: HashMap<(PathBuf, Use, bool), (Arc<ImageTexture>, f64)>,
    budget: TextureBudget,
}

impl Pictures {
    /// A picture converted for its use, and the factor that the conversion divided out.
    ///
    /// # Errors
    /// Where the file cannot be read as a picture.
    pub(crate) fn read(
        &mut self,
        path: &Path,
        how: Use,
        is_raw: bool,
    ) -> Result<(Arc<ImageTexture>, f64), ImageError> {
        let key = (path.to_path_buf(), how, is_raw);
        if let Some((texture, factor)) = self.known.get(&key) {
            return Ok((Arc::clone(texture), *factor));
        }
        let is_encoded = !is_raw && !is_linear(path);
        let encoding = if is_encoded { Encoding::Srgb } else { Encoding::Linear };
        let mut factor = 1.0;
        let texture = match how {
            Use::Colour => ImageTexture::read(path, encoding),
            Use::Raw => ImageTexture::read(path, if is_raw { Encoding::Linear } else { encoding }),
            Use::Glow if is_encoded => ImageTexture::read(path, encoding),
            _ => read_picture(path, TEXTURE_LIMIT).map(|image| {
                let mut pixels = pixels(&image, is_encoded);
                if how == Use::Glow {
                    let finite =
                        |pixel: &Vec4| pixel.truncate().map(|x| if x.is_finite() { x.max(0.0) } else { 0.0 });
                    let brightest =
                        pixels.iter().map(|pixel| finite(pixel).max_element()).fold(0.0f32, f32::max);
                    if brightest > 1.0 {
                        factor = f64::from(brightest);
                        pixels.iter_mut().for_each(|pixel| *pixel = (finite(pixel) / brightest).extend(1.0));
                    }
                } else {
                    for pixel in &mut pixels {
                        let value = luminance(pixel.truncate().as_dvec3()) as f32;
                        *pixel = texel_of(value, how);
                    }
                }
                texture_of(image.width, image.height, &pixels)
            }),
        };
        let texture = Arc::new(texture.and_then(|texture| self.budget.take(texture, path))?);
        self.known.insert(key, (Arc::clone(&texture), factor));
        Ok((texture, factor))
    }
}
