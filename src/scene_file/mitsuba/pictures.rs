//! Converts pictures to textures, with their mapping to the surface.

use super::Importer;
use super::error::{Fault, fail};
use super::texture::{Use, luminance};
use super::value::{Object, shown};
use crate::image_io::{Image, Layer};
use crate::scene_file::diagnostic::suggestion;
use crate::textures::{Encoding, ImageTexture, Sampler, TEXTURE_LIMIT, Wrap, read_picture, srgb_to_linear};
use glam::{Affine2, DAffine3, Mat2, Vec2, Vec4};
use std::path::Path;
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
pub(super) fn texture_of(width: u32, height: u32, pixels: &[Vec4]) -> ImageTexture {
    let data = pixels.iter().flat_map(|pixel| pixel.to_array()).collect();
    let mut image = Image::new(width, height);
    image.layers.push(Layer::new("", &["R", "G", "B", "A"], data));
    ImageTexture::new(&image, Encoding::Linear)
}

impl Importer<'_> {
    /// Wrapping and filtering of a texture.
    pub(super) fn sampler(&mut self, object: &Object) -> Result<Sampler, Fault> {
        let mut wrap = [Wrap::Repeat; 2];
        for (name, axes) in [("wrap_mode", &[0, 1][..]), ("wrap_mode_u", &[0]), ("wrap_mode_v", &[1])] {
            let Some(mode) = object.text(name)? else { continue };
            let mode = match mode {
                "repeat" => Wrap::Repeat,
                "mirror" => Wrap::Mirror,
                "clamp" => Wrap::Clamp,
                "zero" | "one" => {
                    self.report.note(object, "outside of the picture its border is shown (`clamp`)");
                    Wrap::Clamp
                }
                other => {
                    let known = ["repeat", "mirror", "clamp"];
                    let known = suggestion(other, &known);
                    return fail(&object.place, format!("`{}` is no `{name}`", shown(other)), known);
                }
            };
            axes.iter().for_each(|axis| wrap[*axis] = mode);
        }
        let nearest = match object.text("filter_type")?.unwrap_or("bilinear") {
            "nearest" => true,
            "bilinear" | "trilinear" | "ewa" => false,
            other => {
                let known = suggestion(other, &["bilinear", "nearest"]);
                return fail(&object.place, format!("`{}` is no `filter_type`", shown(other)), known);
            }
        };
        self.ignore(
            object,
            &["accel", "format", "max_anisotropy", "cache"],
            "textures are kept and filtered in their own way",
        );
        // Textures of current versions have no mipmaps.
        Ok(Sampler { wrap, nearest, finest: !object.is_old })
    }

    /// Transform from the mesh's coordinates to those of the texture.
    pub(super) fn to_uv(object: &Object) -> Result<Affine2, Fault> {
        let transform: DAffine3 = object.transform("to_uv")?;
        let m = transform.matrix3;
        let mut linear = Mat2::from_cols(
            Vec2::new(m.x_axis.x as f32, m.x_axis.y as f32),
            Vec2::new(m.y_axis.x as f32, m.y_axis.y as f32),
        );
        let mut offset = transform.translation.truncate().as_vec2();
        // In versions before 2.0: uv * scale + offset.
        let scale = Vec2::new(object.float_or("uscale", 1.0)? as f32, object.float_or("vscale", 1.0)? as f32);
        let moved =
            Vec2::new(object.float_or("uoffset", 0.0)? as f32, object.float_or("voffset", 0.0)? as f32);
        linear = Mat2::from_diagonal(scale) * linear;
        offset = scale * offset + moved;
        Ok(Affine2::from_mat2_translation(linear, offset))
    }

    /// A picture converted for its use, and the factor that the conversion divided out.
    pub(super) fn picture(
        &mut self,
        object: &Object,
        path: &Path,
        how: Use,
        is_raw: bool,
    ) -> Result<(Arc<ImageTexture>, f64), Fault> {
        let key = (path.to_path_buf(), how, is_raw);
        if let Some((texture, factor)) = self.pictures.get(&key) {
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
                        *pixel = match how {
                            Use::Slope => Vec4::new(1.0, value.max(0.0).sqrt(), 1.0, 1.0),
                            Use::Roughness => Vec4::new(1.0, value, 1.0, 1.0),
                            Use::Blue => Vec4::new(1.0, 1.0, value, 1.0),
                            _ => Vec4::new(1.0, 1.0, 1.0, value),
                        };
                    }
                }
                texture_of(image.width, image.height, &pixels)
            }),
        };
        let texture = texture.and_then(|texture| self.budget.take(texture, path));
        match texture {
            Ok(texture) => {
                let texture = Arc::new(texture);
                self.pictures.insert(key, (Arc::clone(&texture), factor));
                Ok((texture, factor))
            }
            Err(error) => fail(
                &object.place,
                format!("the picture of {} cannot be read: {error}", object.label()),
                "convert it to PNG, JPEG or EXR",
            ),
        }
    }
}
