//! Pictures of MTL and PLY files as textures: found, read once, cut out, and placed.

use crate::image_io::{Image, ImageError, Layer};
use crate::scene_file::obj::{MtlFinish, MtlMaterial, MtlPicture, ObjPart, find_file};
use crate::textures::{
    Encoding, ImageTexture, Sampler, TEXTURE_LIMIT, TextureBudget, TextureSlot, Wrap, read_picture,
};
use glam::{Affine2, Mat2, Vec2};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Pictures of a file; each is read once.
#[derive(Default)]
pub(super) struct Pictures {
    /// By the file of the colours and the file of the cut-out.
    read: HashMap<(PathBuf, PathBuf), Option<Arc<ImageTexture>>>,
    budget: TextureBudget,
}

impl Pictures {
    /// The picture of a material, with its cut-out as alpha.
    pub(super) fn slot(
        &mut self,
        material: &MtlMaterial,
        folder: &Path,
        messages: &mut Vec<String>,
    ) -> Option<TextureSlot> {
        let name = &material.name;
        let mut file = |picture: &Option<MtlPicture>| {
            let Some(picture) = picture else { return PathBuf::new() };
            let file = find_file(folder, &picture.file);
            if !file.is_as_named {
                messages.push(format!(
                    "the picture `{}` of `{name}` is not where it is named; {} is used",
                    picture.file.display(),
                    file.path.display()
                ));
            }
            file.path
        };
        let placed = material.picture.as_ref().or(material.cutout.as_ref())?;
        let mut cutout = file(&material.cutout);
        let same = |other: &MtlPicture| {
            (other.scale, other.offset, other.clamped) == (placed.scale, placed.offset, placed.clamped)
        };
        let colours = file(&material.picture);
        if material.cutout.as_ref().is_some_and(|other| !same(other)) {
            messages.push(format!(
                "the cut-out (`map_d`) of `{name}` is not used: it lies otherwise than `map_Kd`"
            ));
            cutout = PathBuf::new();
        }
        let Self { read, budget } = self;
        let texture = read.entry((colours.clone(), cutout.clone())).or_insert_with(|| {
            let is_cut = !cutout.as_os_str().is_empty();
            let texture = if is_cut {
                cut_texture(&colours, &cutout)
            } else {
                ImageTexture::read(&colours, Encoding::Srgb)
            };
            let shown = if colours.as_os_str().is_empty() { &cutout } else { &colours };
            match texture.and_then(|texture| budget.take(texture, shown)) {
                Ok(texture) => Some(Arc::new(texture)),
                Err(error) => {
                    messages.push(format!("the picture of `{name}` is not used: {error}"));
                    None
                }
            }
        });
        texture.clone().map(|texture| slot(placed, texture))
    }
}

/// A picture with the alpha channel of another, or with its red channel where it has no alpha. White where `colours` is empty.
fn cut_texture(colours: &Path, cutout: &Path) -> Result<ImageTexture, ImageError> {
    let cut = read_picture(cutout, TEXTURE_LIMIT)?;
    let has_colours = !colours.as_os_str().is_empty();
    let colours = if has_colours { Some(read_picture(colours, TEXTURE_LIMIT)?) } else { None };
    let pixel = |image: &Image, x: u32, y: u32| {
        let index = y as usize * image.width as usize + x as usize;
        let layer = image.layers.first();
        layer.and_then(|layer| layer.pixel(index)).unwrap_or_default().to_vec()
    };
    // An alpha channel that is 1 everywhere carries no information.
    let has_alpha = cut.layers.first().is_some_and(|layer| {
        let count = layer.channels.len();
        matches!(count, 2 | 4) && layer.data.chunks_exact(count).any(|pixel| pixel[count - 1] < 1.0)
    });
    let size = colours.as_ref().unwrap_or(&cut);
    let mut image = Image::new(size.width, size.height);
    let mut data = Vec::with_capacity(4 * image.pixel_count());
    for y in 0..image.height {
        for x in 0..image.width {
            let colour = colours.as_ref().map(|colours| pixel(colours, x, y)).unwrap_or_else(|| vec![1.0; 3]);
            match colour.as_slice() {
                [red, green, blue, ..] => data.extend([*red, *green, *blue]),
                [grey, ..] => data.extend([*grey; 3]),
                [] => data.extend([0.0; 3]),
            }
            // The pixel of the other picture at the centre of this pixel.
            let scaled = |at: u32, of: u32, to: u32| {
                ((2 * u64::from(at) + 1) * u64::from(to) / (2 * u64::from(of))) as u32
            };
            let alpha = pixel(&cut, scaled(x, image.width, cut.width), scaled(y, image.height, cut.height));
            data.push(*if has_alpha { alpha.last() } else { alpha.first() }.unwrap_or(&1.0));
        }
    }
    image.layers.push(Layer::new("", &["R", "G", "B", "A"], data));
    Ok(ImageTexture::new(&image, Encoding::Srgb))
}

/// The picture of a material if the faces of the part can show it, and a message where one is due.
pub(super) fn usable_picture<'a>(
    material: &'a MtlMaterial,
    part: &ObjPart,
) -> (Option<&'a MtlPicture>, Option<String>) {
    let Some(picture) = material.picture.as_ref().or(material.cutout.as_ref()) else { return (None, None) };
    match material.finish {
        MtlFinish::Glass(_) | MtlFinish::Mirror(_) => {
            let why = "is not used: glass and mirrors have no diffuse part that it could colour";
            (None, Some(why.to_owned()))
        }
        _ if part.unmapped_faces == 0 => (Some(picture), None),
        _ if part.unmapped_faces == part.faces => {
            let why = "is not used: its faces have no texture coordinates (`f` with numbers of `vt`)";
            (None, Some(why.to_owned()))
        }
        _ => {
            let why = format!(
                "is of one colour, that of its corner, on {} of {} faces, which have no texture coordinates",
                part.unmapped_faces, part.faces
            );
            (Some(picture), Some(why))
        }
    }
}

/// Texture slot of a picture: the file has v upwards, but pictures are read from the top.
pub(super) fn slot(picture: &MtlPicture, texture: Arc<ImageTexture>) -> TextureSlot {
    let wrap = if picture.clamped { Wrap::Clamp } else { Wrap::Repeat };
    let scale = Mat2::from_diagonal(picture.scale * Vec2::new(1.0, -1.0));
    let offset = Vec2::new(picture.offset.x, 1.0 - picture.offset.y);
    TextureSlot {
        texture,
        sampler: Sampler { wrap: [wrap; 2], ..Sampler::default() },
        set: 0,
        transform: Affine2::from_mat2_translation(scale, offset),
    }
}
