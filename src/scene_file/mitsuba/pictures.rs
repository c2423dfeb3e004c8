//! Pictures with their mapping to the surface.

use super::Importer;
use super::error::{Fault, fail};
use super::paint::Use;
use super::report::Subject;
use super::text::shown;
use super::value::Object;
use crate::scene_file::diagnostic::suggestion;
use crate::textures::{ImageTexture, Sampler, Wrap};
use glam::{Affine2, DAffine3, Mat2, Vec2};
use std::path::Path;
use std::sync::Arc;

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
        self.pictures.read(path, how, is_raw).or_else(|error| {
            fail(
                &object.place,
                format!("the picture of {} cannot be read: {error}", object.label()),
                "convert it to PNG, JPEG or EXR",
            )
        })
    }
}
