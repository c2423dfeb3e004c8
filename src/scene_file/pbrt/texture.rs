//! Textures: colours and numbers that may vary over a surface.

use super::Importer;
use super::error::{Fault, fail};
use super::object::{Object, Parameter};
use super::paint::{Amount, Paint, Use, luminance};
use super::pictures::{checkers, texel_of, texture_of};
use super::report::Subject;
use super::spectrum::Meaning;
use super::text::shown;
use crate::scene_file::diagnostic::suggestion;
use crate::textures::{Sampler, TextureSlot, Wrap};
use glam::{Affine2, DVec3, Mat2, Vec2, Vec4};
use std::rc::Rc;
use std::sync::Arc;

/// Pictures with more texels are not computed with.
const MOST_TEXELS: u64 = 1 << 26;

/// Deepest nesting of textures; deeper ones contain each other.
const DEEPEST: usize = 64;

/// Classes of textures that are functions of the place, and not pictures.
const COMPUTED: [&str; 9] =
    ["bilerp", "dots", "fbm", "wrinkled", "windy", "marble", "ptex", "directionmix", "ptexture"];

/// What a number of the file means for the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Curve {
    /// The number itself.
    Same,
    /// Its square root: roughness of pbrt-v4.
    Root,
    /// The polynomial of pbrt-v3 for roughness.
    Polynomial,
}

impl Curve {
    pub(super) fn at(self, value: f64) -> f64 {
        match self {
            Self::Same => value,
            Self::Root => value.max(0.0).sqrt(),
            Self::Polynomial => {
                // The fit of pbrt-v3 between its roughness and the slope of facets (documented there for the Beckmann and
                // Trowbridge-Reitz distributions).
                let x = value.max(1e-3).ln();
                1.621_42 + x * (0.819_955 + x * (0.1734 + x * (0.017_120_1 + x * 0.000_640_711)))
            }
        }
    }
}

/// A texture with these texels in the place of those of another.
fn replaced(slot: &TextureSlot, [width, height]: [u32; 2], texels: &[Vec4]) -> TextureSlot {
    TextureSlot { texture: Arc::new(texture_of(width, height, texels)), ..slot.clone() }
}

/// The texels of a picture of this size, where it is sampled at their centres.
fn texels(slot: &TextureSlot, [width, height]: [u32; 2]) -> Vec<Vec4> {
    let sampler = Sampler { nearest: true, finest: true, ..slot.sampler };
    (0..height)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .map(|(x, y)| {
            let at = Vec2::new((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32);
            slot.texture.at(at, 0.0, &sampler)
        })
        .collect()
}

/// Combines colours texel by texel, where those that vary lie alike; `None` where they do not, or are too large.
fn baked<const N: usize>(paints: [&Paint; N], of: impl Fn([DVec3; N]) -> DVec3) -> Option<Paint> {
    let pictures = || {
        paints.iter().filter_map(|paint| match paint {
            Paint::Picture(slot, _) => Some(slot),
            Paint::Plain(_) | Paint::Vertices(_) => None,
        })
    };
    let Some(first) = pictures().next() else { return Some(Paint::Plain(of(paints.map(Paint::mean)))) };
    let is_alike = |slot: &TextureSlot| {
        slot.transform == first.transform && slot.sampler.wrap == first.sampler.wrap && slot.set == first.set
    };
    let size = pictures().fold([1, 1], |size, slot| {
        let own = slot.texture.size();
        [size[0].max(own[0]), size[1].max(own[1])]
    });
    if !pictures().all(is_alike) || u64::from(size[0]) * u64::from(size[1]) > MOST_TEXELS {
        return None;
    }
    let layers = paints.map(|paint| match paint {
        Paint::Picture(slot, factor) => (texels(slot, size), *factor),
        Paint::Plain(colour) | Paint::Vertices(colour) => (Vec::new(), *colour),
    });
    let colours: Vec<DVec3> = (0..size[0] as usize * size[1] as usize)
        .map(|i| {
            let value = |(texels, factor): &(Vec<Vec4>, DVec3)| {
                texels.get(i).map_or(*factor, |texel| texel.truncate().as_dvec3() * *factor)
            };
            let colour = of(std::array::from_fn(|layer| value(&layers[layer])));
            colour.map(|x| if x.is_finite() { x.max(0.0) } else { 0.0 })
        })
        .collect();
    let brightest = colours.iter().map(|colour| colour.max_element()).fold(1.0, f64::max);
    let texels: Vec<Vec4> =
        colours.iter().map(|colour| (*colour / brightest).as_vec3().extend(1.0)).collect();
    Some(Paint::Picture(replaced(first, size, &texels), DVec3::splat(brightest)))
}

/// [`baked`] for one colour: also for a picture that is too large, by its mean.
pub(super) fn mapped(paint: &Paint, of: impl Fn(DVec3) -> DVec3) -> Paint {
    baked([paint], |[colour]| of(colour)).unwrap_or_else(|| Paint::Plain(of(paint.mean())))
}

impl Importer<'_> {
    /// The texture that a parameter names.
    pub(super) fn texture_of(&mut self, parameter: &Parameter, is_float: bool) -> Result<Paint, Fault> {
        let Some(name) = parameter.text() else {
            return parameter.wrong("the name of a texture", "\"texture NAME\" \"wood\"");
        };
        match self.textures.get(&(is_float, name.to_owned())) {
            Some(texture) => {
                let texture = Rc::clone(texture);
                self.texture(&texture)
            }
            None => {
                let kind = if is_float { "float" } else { "spectrum" };
                let mut names: Vec<&str> = self
                    .textures
                    .keys()
                    .filter(|(float, _)| *float == is_float)
                    .map(|(_, name)| name.as_str())
                    .collect();
                names.sort_unstable();
                let message = format!("there is no {kind} texture `{}` before this place", shown(name));
                fail(&parameter.place, message, suggestion(name, &names))
            }
        }
    }

    /// A texture, which is evaluated once.
    fn texture(&mut self, object: &Rc<Object>) -> Result<Paint, Fault> {
        if let Some(paint) = self.paints.get(&object.serial) {
            return Ok(paint.clone());
        }
        self.texture_depth += 1;
        if self.texture_depth > DEEPEST {
            let message = format!("{} stands in too many others", object.label());
            return fail(&object.place, message, "do textures contain each other?");
        }
        let paint = self.evaluated(object)?;
        self.texture_depth -= 1;
        self.paints.insert(object.serial, paint.clone());
        Ok(paint)
    }

    fn evaluated(&mut self, object: &Rc<Object>) -> Result<Paint, Fault> {
        match object.kind.as_str() {
            "constant" => {
                let value = self.part(object, "value", 1.0)?;
                self.finish(object, &["value"])?;
                Ok(value)
            }
            "scale" => {
                let names = if object.has("tex1") || object.has("tex2") {
                    ["tex1", "tex2"]
                } else {
                    ["tex", "scale"]
                };
                let (a, b) = (self.part(object, names[0], 1.0)?, self.part(object, names[1], 1.0)?);
                self.finish(object, &["tex", "scale", "tex1", "tex2"])?;
                Ok(match (a, b) {
                    (Paint::Plain(a), b) => b.times(a),
                    (a, Paint::Plain(b)) => a.times(b),
                    (a, b) => self.together(object, [&a, &b], |[a, b]| a * b),
                })
            }
            "mix" => {
                let (a, b) = (self.part(object, "tex1", 0.0)?, self.part(object, "tex2", 1.0)?);
                let amount = self.number_paint(object, "amount", 0.5)?;
                self.finish(object, &["tex1", "tex2", "amount"])?;
                Ok(self.together(object, [&a, &b, &amount], |[a, b, share]| a + (b - a) * share))
            }
            "imagemap" => self.image(object),
            "checkerboard" => {
                if object.integer("dimension")?.unwrap_or(2) != 2 {
                    let remedy = "set \"integer dimension\" 2, or bake it into a picture";
                    return fail(
                        object.place_of("dimension"),
                        "checkerboards in space are not modelled",
                        remedy,
                    );
                }
                let (a, b) = (self.part(object, "tex1", 1.0)?, self.part(object, "tex2", 0.0)?);
                if a.plain().is_none() || b.plain().is_none() {
                    self.report.note(
                        object,
                        "its squares do not vary in themselves: the means of their textures count",
                    );
                }
                let mapping = self.mapping(object)?;
                self.ignore(object, &["aamode"], "textures are filtered in their own way");
                self.finish(object, &["tex1", "tex2", "dimension", "mapping"])?;
                let halved = Affine2::from_scale(Vec2::splat(0.5)) * mapping;
                Ok(checkers([a.mean(), b.mean()], Use::Colour, halved))
            }
            other if COMPUTED.contains(&other) => fail(
                &object.place,
                format!("the texture `{other}` is not modelled"),
                "bake it into a picture, and use `imagemap`",
            ),
            other => {
                let known = ["imagemap", "constant", "scale", "mix", "checkerboard"];
                let message = format!("the texture `{}` is not known", shown(other));
                fail(&object.place, message, suggestion(other, &known))
            }
        }
    }

    /// Combines colours, by their means where they lie differently on the surface.
    fn together<const N: usize>(
        &mut self,
        object: &Object,
        paints: [&Paint; N],
        of: impl Fn([DVec3; N]) -> DVec3,
    ) -> Paint {
        baked(paints, &of).unwrap_or_else(|| {
            self.report.warn(
                object,
                "its pictures lie differently on the surface, or are too large: their means count",
            );
            Paint::Plain(of(paints.map(Paint::mean)))
        })
    }

    /// A part of a texture, which is a texture, a number or a colour.
    fn part(&mut self, object: &Rc<Object>, name: &str, usual: f64) -> Result<Paint, Fault> {
        let Some(parameter) = object.get(name).map(Rc::clone) else {
            return Ok(Paint::Plain(DVec3::splat(usual)));
        };
        match parameter.kind {
            "texture" => {
                let is_known = |float: bool| {
                    parameter.text().is_some_and(|text| self.textures.contains_key(&(float, text.to_owned())))
                };
                // The scale of a coloured texture is a number.
                let is_float = is_known(true) && !is_known(false);
                self.texture_of(&parameter, is_float)
            }
            "float" | "integer" => Ok(Paint::Plain(DVec3::splat(object.float_or(name, usual)?))),
            _ => Ok(Paint::Plain(self.spectrum(&parameter)?.numbers())),
        }
    }

    fn image(&mut self, object: &Rc<Object>) -> Result<Paint, Fault> {
        let path = self.named_file(object, "filename")?;
        let wrap = match object.text("wrap")?.unwrap_or("repeat") {
            "repeat" => Wrap::Repeat,
            "clamp" => Wrap::Clamp,
            "black" | "octahedralsphere" => {
                self.report.note(object, "outside of the picture its border is shown (`clamp`)");
                Wrap::Clamp
            }
            other => {
                let known = suggestion(other, &["repeat", "clamp", "black"]);
                return fail(object.place_of("wrap"), format!("`{}` is no `wrap`", shown(other)), known);
            }
        };
        let (nearest, finest) = match object.text("filter")?.unwrap_or("bilinear") {
            "point" => (true, true),
            "bilinear" => (false, true),
            "trilinear" | "EWA" | "ewa" => (false, false),
            other => {
                let known = suggestion(other, &["bilinear", "point", "trilinear", "EWA"]);
                return fail(object.place_of("filter"), format!("`{}` is no `filter`", shown(other)), known);
            }
        };
        let encoding = object.text("encoding")?.unwrap_or("sRGB").to_owned();
        let is_raw = match encoding.split_whitespace().collect::<Vec<_>>()[..] {
            ["linear"] => true,
            ["sRGB" | "srgb"] => !object.boolean("gamma", true)?,
            ["gamma", _] => {
                self.report.note(object, "the gamma of the picture is taken for the curve of sRGB");
                false
            }
            _ => {
                let message = format!("`{}` is no `encoding`", shown(&encoding));
                return fail(object.place_of("encoding"), message, "write sRGB, linear or gamma 2.2");
            }
        };
        let scale = object.within("scale", 1.0, 0.0..=1e9)?;
        let is_inverse = object.boolean("invert", false)?;
        let transform = from_below(self.mapping(object)?);
        self.ignore(object, &["maxanisotropy", "trilinear"], "textures are filtered in their own way");
        self.finish(object, &["filename", "wrap", "filter", "encoding", "scale", "invert", "mapping"])?;
        let (texture, factor) = self.pictures.read(&path, Use::Colour, is_raw).or_else(|error| {
            let message = format!("the picture of {} cannot be read: {error}", object.label());
            fail(&object.place, message, "convert it to PNG, JPEG or EXR")
        })?;
        let slot =
            TextureSlot { texture, sampler: Sampler { wrap: [wrap; 2], nearest, finest }, set: 0, transform };
        let paint = Paint::Picture(slot, DVec3::splat(scale * factor));
        Ok(if is_inverse { mapped(&paint, |colour| (DVec3::ONE - colour).max(DVec3::ZERO)) } else { paint })
    }

    /// The transform from the coordinates of a surface to those of a texture, upwards.
    fn mapping(&mut self, object: &Object) -> Result<Affine2, Fault> {
        let mapping = object.text("mapping")?.unwrap_or("uv");
        if mapping != "uv" {
            return fail(
                object.place_of("mapping"),
                format!("the mapping `{}` is not modelled", shown(mapping)),
                "give the mesh texture coordinates, and use the mapping `uv`",
            );
        }
        let number = |name: &str, usual: f64| object.within(name, usual, -1e9..=1e9);
        let scale = Vec2::new(number("uscale", 1.0)? as f32, number("vscale", 1.0)? as f32);
        let offset = Vec2::new(number("udelta", 0.0)? as f32, number("vdelta", 0.0)? as f32);
        Ok(Affine2::from_mat2_translation(Mat2::from_diagonal(scale), offset))
    }

    /// Reads a colour that may vary.
    pub(super) fn paint(&mut self, object: &Rc<Object>, name: &str, usual: f64) -> Result<Paint, Fault> {
        match object.get(name).map(Rc::clone) {
            Some(parameter) if parameter.kind == "texture" => self.texture_of(&parameter, false),
            _ => Ok(Paint::Plain(self.colour(object, name, DVec3::splat(usual), Meaning::Reflectance)?)),
        }
    }

    /// Reads a number that may vary, as a colour of three such numbers.
    pub(super) fn number_paint(&mut self, object: &Object, name: &str, usual: f64) -> Result<Paint, Fault> {
        match object.get(name).map(Rc::clone) {
            Some(parameter) if parameter.kind == "texture" => self.texture_of(&parameter, true),
            _ => Ok(Paint::Plain(DVec3::splat(object.float_or(name, usual)?))),
        }
    }

    /// Reads a number that may vary, for this use.
    pub(super) fn amount(
        &mut self,
        object: &Object,
        (name, usual): (&str, f64),
        curve: Curve,
        how: Use,
    ) -> Result<Amount, Fault> {
        let paint = self.number_paint(object, name, usual)?;
        Ok(self.amount_of(object, &paint, curve, how))
    }

    /// A number as a material needs it.
    pub(super) fn amount_of(&mut self, object: &Object, paint: &Paint, curve: Curve, how: Use) -> Amount {
        let (slot, factor) = match paint {
            Paint::Plain(colour) | Paint::Vertices(colour) => {
                return Amount::Plain(curve.at(luminance(*colour)));
            }
            Paint::Picture(slot, factor) => (slot, *factor),
        };
        let size = slot.texture.size();
        if u64::from(size[0]) * u64::from(size[1]) > MOST_TEXELS {
            self.report.warn(object, "its picture of numbers is too large: its mean counts");
            return Amount::Plain(curve.at(luminance(paint.mean())));
        }
        let texels: Vec<Vec4> = texels(slot, size)
            .iter()
            .map(|texel| {
                // Numbers are the means of the channels.
                let value = (texel.truncate().as_dvec3() * factor).element_sum() / 3.0;
                texel_of(curve.at(value) as f32, how)
            })
            .collect();
        Amount::Picture(replaced(slot, size, &texels))
    }

    /// Reads a number that must be constant.
    pub(super) fn plain_amount(&mut self, object: &Object, name: &str, usual: f64) -> Result<f64, Fault> {
        let paint = self.number_paint(object, name, usual)?;
        if paint.plain().is_none() {
            self.report.note(object, format!("`{name}` does not vary here: its mean counts"));
        }
        Ok(paint.mean().element_sum() / 3.0)
    }
}

/// From coordinates that run upwards to those of a picture, which run downwards.
pub(super) fn from_below(mapping: Affine2) -> Affine2 {
    Affine2::from_mat2_translation(Mat2::from_diagonal(Vec2::new(1.0, -1.0)), Vec2::Y) * mapping
}
