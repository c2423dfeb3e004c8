//! Materials, textures and samplers.

use super::check::Report;
use super::data::{Data, Resource};
use super::error::{Failure, GltfProblem, fail};
use crate::bsdf::{Body, Dielectric, LayeredParameters};
use crate::image_io::{Image, ImageError};
use crate::math::Rgb;
use crate::scene::{Coverage, LayeredMaterial};
use crate::scene_file::description::{MaterialDescription, MediumDescription, Named, SceneDescription};
use crate::spectra::Dispersion;
use crate::textures::{
    Encoding, ImageTexture, Sampler, TEXTURE_LIMIT, TextureBudget, TextureSlot, Wrap, read_picture,
    read_picture_bytes,
};
use glam::{Affine2, DVec3, Mat2, Vec2};
use serde_json::Value;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Luminous flux of one watt (of green light), lm/W: the factor between photometric and radiometric units.
pub(super) const LUMENS_PER_WATT: f64 = 683.0;

/// Smallest transmittance of a medium over the attenuation distance; smaller values are raised to it.
const LEAST_ATTENUATION: f64 = 1e-6;

/// An index of refraction so high that facets reflect all light. An `ior` of 0 stands for it, and with it the specular colour is
/// the reflectance.
const TOTAL_IOR: f32 = 1e9;

const SPECULAR_GLOSSINESS: &str = "/extensions/KHR_materials_pbrSpecularGlossiness";

/// Interpretation of a picture's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Use {
    Srgb,
    Linear,
    /// Alpha is glossiness, scaled by a factor (given by its bits). The complement becomes the roughness, in the green channel.
    Glossiness(u32),
}

/// Source of a picture's bytes.
enum Picture<'a> {
    Bytes(Cow<'a, [u8]>),
    File(PathBuf),
}
/// Smallest transmission at which a material without a volume may be solid glass.
const MOSTLY: f32 = 0.5;

/// The result of converting a material.
#[derive(Clone, Debug)]
pub(super) struct Converted {
    /// Index into the description's materials.
    pub material: usize,
    /// Emitted radiance, W/(m^2 sr).
    pub emission: Option<DVec3>,
    /// Whether both sides emit.
    pub two_sided: bool,
}

/// Materials of one file, converted when they are first used.
pub(super) struct Materials<'a> {
    document: &'a gltf::Document,
    json: &'a Value,
    converted: BTreeMap<(Option<usize>, bool, bool), Converted>,
    images: BTreeMap<(usize, Use), Arc<ImageTexture>>,
    budget: TextureBudget,
}

/// A part of the JSON with its name in messages.
struct Part<'a> {
    value: &'a Value,
    object: &'a str,
}

static NOTHING: Value = Value::Null;

impl<'a> Part<'a> {
    fn at(&self, pointer: &str) -> &'a Value {
        self.value.pointer(pointer).unwrap_or(&NOTHING)
    }

    fn has(&self, pointer: &str) -> bool {
        self.value.pointer(pointer).is_some()
    }

    fn refuse<T>(&self, pointer: &str, what: &str) -> Result<T, Failure> {
        let place = pointer.trim_start_matches('/').replace('/', ".");
        fail(self.object, format!("`{place}` is not {what}; the file is damaged, write it again"))
    }

    fn number(&self, pointer: &str, default: f32) -> Result<f32, Failure> {
        match self.at(pointer) {
            Value::Null => Ok(default),
            Value::Number(number) => match number.as_f64().map(|x| x as f32).filter(|x| x.is_finite()) {
                Some(number) => Ok(number),
                None => self.refuse(pointer, "a number that can be used"),
            },
            _ => self.refuse(pointer, "a number"),
        }
    }

    fn numbers<const N: usize>(&self, pointer: &str, default: [f32; N]) -> Result<[f32; N], Failure> {
        match self.at(pointer) {
            Value::Null => Ok(default),
            Value::Array(items) if items.len() == N => {
                let mut numbers = default;
                for (number, item) in numbers.iter_mut().zip(items) {
                    match item.as_f64().map(|x| x as f32).filter(|x| x.is_finite()) {
                        Some(value) => *number = value,
                        None => return self.refuse(pointer, "a list of numbers"),
                    }
                }
                Ok(numbers)
            }
            _ => self.refuse(pointer, &format!("a list of {N} numbers")),
        }
    }

    fn colour(&self, pointer: &str, default: f32) -> Result<Rgb, Failure> {
        self.numbers(pointer, [default; 3]).map(Rgb::from_array)
    }
}

impl<'a> Materials<'a> {
    pub(super) fn new(document: &'a gltf::Document, json: &'a Value) -> Self {
        Self {
            document,
            json,
            converted: BTreeMap::new(),
            images: BTreeMap::new(),
            budget: TextureBudget::default(),
        }
    }

    /// Whether a material transmits most of the light, refracts it, and declares no volume. By the file alone it is a sheet.
    pub(super) fn is_sheet(&self, index: usize) -> Result<bool, Failure> {
        let Some(value) = self.json.pointer(&format!("/materials/{index}")) else { return Ok(false) };
        let object = super::label("materials", index, value.get("name").and_then(Value::as_str));
        let part = Part { value, object: &object };
        let transmission = "/extensions/KHR_materials_transmission";
        Ok(part.number(&format!("{transmission}/transmissionFactor"), 0.0)? >= MOSTLY
            && !part.has(&format!("{transmission}/transmissionTexture"))
            && !part.has("/extensions/KHR_materials_unlit")
            && part.number("/extensions/KHR_materials_volume/thicknessFactor", 0.0)? <= 0.0
            && part.number("/extensions/KHR_materials_ior/ior", 1.5)? > 1.0)
    }

    /// The material of a primitive. `coloured`: its vertices have colours. `is_body`: the file declares no volume, but the mesh
    /// is a body.
    pub(super) fn convert(
        &mut self,
        index: Option<usize>,
        (coloured, is_body): (bool, bool),
        data: &mut Data<'_>,
        description: &mut SceneDescription,
    ) -> Result<Converted, Failure> {
        let index = index.filter(|index| *index < self.document.materials().len());
        if let Some(known) = self.converted.get(&(index, coloured, is_body)) {
            return Ok(known.clone());
        }
        let value =
            index.and_then(|index| self.json.pointer(&format!("/materials/{index}"))).unwrap_or(&NOTHING);
        let name = value.get("name").and_then(Value::as_str);
        let object =
            index.map_or("the default material".to_owned(), |index| super::label("materials", index, name));
        let part = Part { value, object: &object };
        let mut material = self.factors(&part, coloured)?;
        if part.has(SPECULAR_GLOSSINESS) && !material.unlit {
            specular_glossiness(&part, &mut material)?;
        }
        self.textures(&part, &mut material, data)?;
        let media = self.volume(&part, &mut material, (name.unwrap_or("glass"), is_body), description)?;
        let strength =
            part.number("/extensions/KHR_materials_emissive_strength/emissiveStrength", 1.0)?.max(0.0);
        let emitted = if material.unlit {
            material.factors.base
        } else {
            part.colour("/emissiveFactor", 0.0)?.max(Rgb::ZERO) * strength
        };
        // A black picture removes the emission.
        let picture = if material.unlit { None } else { material.emission.as_ref() };
        let emitted = picture.map_or(emitted, |slot| {
            if slot.texture.mean().truncate() == Rgb::ZERO { Rgb::ZERO } else { emitted }
        });
        let is_two_sided = part.at("/doubleSided").as_bool().unwrap_or(false);
        let two_sided = material.unlit || is_two_sided;
        let converted = Converted {
            material: description.materials.len(),
            emission: (emitted.max_element() > 0.0).then(|| emitted.as_dvec3() / LUMENS_PER_WATT),
            two_sided,
        };
        description.materials.push(Named {
            name: name.map_or_else(|| object.clone(), str::to_owned),
            location: description.location.clone(),
            value: MaterialDescription::Layered { material: Arc::new(material), media },
        });
        self.converted.insert((index, coloured, is_body), converted.clone());
        Ok(converted)
    }

    fn factors(&self, part: &Part<'_>, coloured: bool) -> Result<LayeredMaterial, Failure> {
        let [r, g, b, alpha] = part.numbers("/pbrMetallicRoughness/baseColorFactor", [1.0; 4])?;
        let coverage = match part.at("/alphaMode").as_str() {
            Some("MASK") => Coverage::Mask(part.number("/alphaCutoff", 0.5)?),
            Some("BLEND") => Coverage::Blend,
            _ => Coverage::Whole,
        };
        let anisotropy = "/extensions/KHR_materials_anisotropy";
        let (specular, coat) = ("/extensions/KHR_materials_specular", "/extensions/KHR_materials_clearcoat");
        let ior = match part.number("/extensions/KHR_materials_ior/ior", 1.5)? {
            0.0 => TOTAL_IOR,
            ior => ior,
        };
        let factors = LayeredParameters {
            base: Rgb::new(r, g, b).clamp(Rgb::ZERO, Rgb::ONE),
            metallic: part.number("/pbrMetallicRoughness/metallicFactor", 1.0)?,
            ior,
            specular: part.number(&format!("{specular}/specularFactor"), 1.0)?,
            specular_colour: part.colour(&format!("{specular}/specularColorFactor"), 1.0)?,
            transmission: part.number("/extensions/KHR_materials_transmission/transmissionFactor", 0.0)?,
            coat: part.number(&format!("{coat}/clearcoatFactor"), 0.0)?.clamp(0.0, 1.0),
            ..LayeredParameters::default()
        };
        Ok(LayeredMaterial {
            factors,
            alpha: alpha.clamp(0.0, 1.0),
            coverage,
            roughness: part.number("/pbrMetallicRoughness/roughnessFactor", 1.0)?.clamp(0.0, 1.0),
            coat_roughness: part.number(&format!("{coat}/clearcoatRoughnessFactor"), 0.0)?.clamp(0.0, 1.0),
            anisotropy: [
                part.number(&format!("{anisotropy}/anisotropyStrength"), 0.0)?.clamp(0.0, 1.0),
                part.number(&format!("{anisotropy}/anisotropyRotation"), 0.0)?,
            ],
            normal_scales: [
                part.number("/normalTexture/scale", 1.0)?,
                part.number(&format!("{coat}/clearcoatNormalTexture/scale"), 1.0)?,
            ],
            coloured,
            unlit: part.has("/extensions/KHR_materials_unlit"),
            ..LayeredMaterial::default()
        })
    }

    fn textures(
        &mut self,
        part: &Part<'_>,
        material: &mut LayeredMaterial,
        data: &mut Data<'_>,
    ) -> Result<(), Failure> {
        let mut slot = |pointer: &str, encoding| self.slot(part, pointer, encoding, data);
        let coat = "/extensions/KHR_materials_clearcoat";
        if part.has(SPECULAR_GLOSSINESS) && !material.unlit {
            let map = format!("{SPECULAR_GLOSSINESS}/specularGlossinessTexture");
            material.base = slot(&format!("{SPECULAR_GLOSSINESS}/diffuseTexture"), Use::Srgb)?;
            material.specular_colour = slot(&map, Use::Srgb)?;
            let glossiness = 1.0 - material.roughness;
            material.metallic_roughness = slot(&map, Use::Glossiness(glossiness.to_bits()))?;
            if material.metallic_roughness.is_some() {
                material.roughness = 1.0;
            }
            material.normal = slot("/normalTexture", Use::Linear)?;
            material.emission = slot("/emissiveTexture", Use::Srgb)?;
            return Ok(());
        }
        material.base = slot("/pbrMetallicRoughness/baseColorTexture", Use::Srgb)?;
        if material.unlit {
            return Ok(());
        }
        material.metallic_roughness = slot("/pbrMetallicRoughness/metallicRoughnessTexture", Use::Linear)?;
        material.normal = slot("/normalTexture", Use::Linear)?;
        material.emission = slot("/emissiveTexture", Use::Srgb)?;
        material.transmission =
            slot("/extensions/KHR_materials_transmission/transmissionTexture", Use::Linear)?;
        material.specular = slot("/extensions/KHR_materials_specular/specularTexture", Use::Linear)?;
        material.specular_colour =
            slot("/extensions/KHR_materials_specular/specularColorTexture", Use::Srgb)?;
        material.anisotropy_map =
            slot("/extensions/KHR_materials_anisotropy/anisotropyTexture", Use::Linear)?;
        material.coat = slot(&format!("{coat}/clearcoatTexture"), Use::Linear)?;
        material.coat_roughness_map = slot(&format!("{coat}/clearcoatRoughnessTexture"), Use::Linear)?;
        material.coat_normal = slot(&format!("{coat}/clearcoatNormalTexture"), Use::Linear)?;
        Ok(())
    }

    /// Decides what is below the surface: a thin sheet or a volume. For a volume, yields the media on both sides.
    fn volume(
        &self,
        part: &Part<'_>,
        material: &mut LayeredMaterial,
        (name, is_body): (&str, bool),
        description: &mut SceneDescription,
    ) -> Result<Option<[usize; 2]>, Failure> {
        if material.factors.transmission <= 0.0 || material.unlit {
            return Ok(None);
        }
        let volume = "/extensions/KHR_materials_volume";
        if is_body {
            // Light that crosses a body is tinted twice, and light that crosses a sheet of the same colour once.
            material.factors.base = material.factors.base.map(f32::sqrt);
        } else if part.number(&format!("{volume}/thicknessFactor"), 0.0)? <= 0.0 {
            material.factors.body = Body::Thin;
            return Ok(None);
        }
        // The ray tracer finds the thickness of the body.
        if material.factors.ior == TOTAL_IOR {
            let problem = "an index of refraction of 0 reflects all light, and so has no volume below it; give it an index";
            return fail(part.object, problem);
        }
        let ior = material.factors.ior.clamp(1.0, 100.0);
        material.factors.ior = ior;
        material.factors.body = Body::Interface(Dielectric::new(1.0, f64::from(ior)));
        // Partial coverage is ignored: an interface between media must not be crossed at random.
        material.coverage = Coverage::Whole;
        let colour = part.colour(&format!("{volume}/attenuationColor"), 1.0)?.as_dvec3();
        let distance = f64::from(part.number(&format!("{volume}/attenuationDistance"), f32::INFINITY)?);
        let absorption = if distance > 0.0 {
            colour.clamp(DVec3::splat(LEAST_ATTENUATION), DVec3::ONE).map(|share| -share.ln() / distance)
        } else {
            DVec3::ZERO
        };
        let strength = f64::from(part.number("/extensions/KHR_materials_dispersion/dispersion", 0.0)?);
        let dispersion = if strength > 0.0 && ior > 1.0 {
            // The extension's number is twenty over that of Abbe.
            match Dispersion::from_abbe(f64::from(ior), 20.0 / strength) {
                Ok(dispersion) => Some(dispersion),
                Err(error) => return fail(part.object, format!("a dispersion of {strength}, {error}")),
            }
        } else {
            None
        };
        description.media.push(Named {
            name: format!("inside of {name}"),
            location: description.location.clone(),
            value: MediumDescription {
                ior: f64::from(ior),
                dispersion,
                absorption,
                priority: 0,
                volume: None,
            },
        });
        Ok(Some([description.media.len() - 1, 0]))
    }

    /// The texture that a part of a material names. `None` where it names none, or one without a picture.
    fn slot(
        &mut self,
        part: &Part<'_>,
        pointer: &str,
        wanted: Use,
        data: &mut Data<'_>,
    ) -> Result<Option<TextureSlot>, Failure> {
        if !part.has(pointer) {
            return Ok(None);
        }
        let Some(index) = part.at(&format!("{pointer}/index")).as_u64() else {
            return part.refuse(pointer, "a texture with an index");
        };
        let textures = &self.document.as_json().textures;
        let Some(texture) = usize::try_from(index).ok().and_then(|index| textures.get(index)) else {
            return fail(part.object, format!("texture {index}, and there are {}", textures.len()));
        };
        let image = texture.source.value();
        if image >= self.document.as_json().images.len() {
            let name = pointer.trim_start_matches('/').replace('/', ".");
            data.report.warn("no picture", || {
                format!(
                    "{}: `{name}` is a texture without a picture that can be read; it is left out",
                    part.object
                )
            });
            return Ok(None);
        }
        let sampler = texture.sampler.and_then(|sampler| self.document.samplers().nth(sampler.value()));
        let sampler = sampler.map_or_else(Sampler::default, |sampler| sampler_of(&sampler));
        let texture = self.image(image, wanted, data)?;
        let transform = format!("{pointer}/extensions/KHR_texture_transform");
        let [x, y] = part.numbers(&format!("{transform}/offset"), [0.0; 2])?;
        let scale = part.numbers(&format!("{transform}/scale"), [1.0; 2])?;
        let turn = part.number(&format!("{transform}/rotation"), 0.0)?;
        let own_set = part.number(&format!("{pointer}/texCoord"), 0.0)?;
        let set = part.number(&format!("{transform}/texCoord"), own_set)? as usize;
        if set > 1 {
            let problem =
                format!("`{}` reads texture coordinates {set}, and 0 and 1 are read", &pointer[1..]);
            return fail(part.object, problem);
        }
        // Counter-clockwise in the picture, where v points down.
        let linear = Mat2::from_angle(-turn) * Mat2::from_diagonal(Vec2::from_array(scale));
        let transform = Affine2::from_mat2_translation(linear, Vec2::new(x, y));
        Ok(Some(TextureSlot { texture, sampler, set, transform }))
    }

    fn image(
        &mut self,
        index: usize,
        wanted: Use,
        data: &mut Data<'_>,
    ) -> Result<Arc<ImageTexture>, Failure> {
        let key = (index, wanted);
        if let Some(known) = self.images.get(&key) {
            return Ok(Arc::clone(known));
        }
        let name = self.document.as_json().images.get(index).and_then(|image| image.name.as_deref());
        let object = super::label("images", index, name);
        let failed = |error: ImageError| (object.clone(), GltfProblem::from(error));
        let inside = Path::new("the picture in the file");
        let picture = self.picture(index, &object, data)?;
        let texture = match (&picture, wanted) {
            (Picture::Bytes(bytes), Use::Srgb) => ImageTexture::from_bytes(bytes, inside, Encoding::Srgb),
            (Picture::Bytes(bytes), Use::Linear) => ImageTexture::from_bytes(bytes, inside, Encoding::Linear),
            (Picture::File(path), Use::Srgb) => ImageTexture::read(path, Encoding::Srgb),
            (Picture::File(path), Use::Linear) => ImageTexture::read(path, Encoding::Linear),
            (Picture::Bytes(bytes), Use::Glossiness(factor)) => {
                read_picture_bytes(bytes, inside, TEXTURE_LIMIT).map(|image| roughness(image, factor))
            }
            (Picture::File(path), Use::Glossiness(factor)) => {
                read_picture(path, TEXTURE_LIMIT).map(|image| roughness(image, factor))
            }
        };
        let texture = texture.map_err(failed)?;
        if let Picture::File(path) = picture {
            data.files.push(path);
        }
        let texture = Arc::new(self.budget.take(texture, Path::new(&object)).map_err(failed)?);
        self.images.insert(key, Arc::clone(&texture));
        Ok(texture)
    }

    /// The bytes of an image. Their first bytes decide the format, whatever the file declares.
    fn picture<'d>(
        &self,
        index: usize,
        object: &str,
        data: &'d mut Data<'_>,
    ) -> Result<Picture<'d>, Failure> {
        let Some(image) = self.document.as_json().images.get(index) else {
            return fail(object, "there is no such image; write the file again");
        };
        let said = image.mime_type.as_ref().map(|kind| kind.0.clone());
        let bytes: Cow<'d, [u8]> = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => match data.resolve(uri).or_else(|problem| fail(object, problem))? {
                Resource::Inline(bytes) => Cow::Owned(bytes),
                Resource::File(path) => return Ok(Picture::File(path)),
            },
            (None, Some(view)) => {
                let Some(view) = self.document.views().nth(view.value()) else {
                    return fail(object, "there is no such buffer view; write the file again");
                };
                // Looked up twice: the first borrow ends before the warning is added to the same data.
                let kind = kind_of(data.view(&view)?);
                warn_of_kind(&mut data.report, object, said.as_deref(), kind);
                return data.view(&view).map(Cow::Borrowed).map(Picture::Bytes);
            }
            (None, None) => {
                return fail(
                    object,
                    "it has neither a URI nor a buffer view, so there is no picture; write the file again",
                );
            }
        };
        warn_of_kind(&mut data.report, object, said.as_deref(), kind_of(&bytes));
        Ok(Picture::Bytes(bytes))
    }
}

/// MIME type by the first bytes of a picture, among the types of glTF.
fn kind_of(bytes: &[u8]) -> Option<&'static str> {
    const KINDS: [(&[u8], &str); 3] =
        [(b"\x89PNG", "image/png"), (b"\xff\xd8\xff", "image/jpeg"), (b"RIFF", "image/webp")];
    KINDS.iter().find(|(magic, _)| bytes.starts_with(magic)).map(|(_, kind)| *kind)
}

fn warn_of_kind(report: &mut Report, object: &str, said: Option<&str>, found: Option<&str>) {
    if let (Some(said), Some(found)) = (said, found)
        && said != found
    {
        report.warn("kind of picture", || {
            format!("{object} is said to be {}, and is {found}; it is read as that", super::shown(said))
        });
    }
}

/// A material of KHR_materials_pbrSpecularGlossiness. Its specular colour is the reflectance of the facets at normal incidence,
/// and the diffuse base receives the rest.
fn specular_glossiness(part: &Part<'_>, material: &mut LayeredMaterial) -> Result<(), Failure> {
    let at = |key: &str| format!("{SPECULAR_GLOSSINESS}/{key}");
    let [r, g, b, alpha] = part.numbers(&at("diffuseFactor"), [1.0; 4])?;
    let glossiness = part.number(&at("glossinessFactor"), 1.0)?.clamp(0.0, 1.0);
    material.factors = LayeredParameters {
        base: Rgb::new(r, g, b).clamp(Rgb::ZERO, Rgb::ONE),
        metallic: 0.0,
        ior: TOTAL_IOR,
        specular: 1.0,
        specular_colour: part.colour(&at("specularFactor"), 1.0)?,
        transmission: 0.0,
        coat: 0.0,
        ..material.factors
    };
    material.alpha = alpha.clamp(0.0, 1.0);
    material.roughness = 1.0 - glossiness;
    material.anisotropy = [0.0; 2];
    Ok(())
}

/// Converts a picture with glossiness in alpha, scaled by `factor` (as bits), to roughness in the green channel.
fn roughness(mut image: Image, factor: u32) -> ImageTexture {
    let factor = f32::from_bits(factor);
    image.layers.truncate(1);
    for layer in &mut image.layers {
        let channels = layer.channels.len().max(1);
        let rough = |pixel: &[f32]| {
            let alpha = match channels {
                2 => pixel.get(1),
                4.. => pixel.get(3),
                _ => None,
            };
            1.0 - factor * alpha.copied().unwrap_or(1.0)
        };
        layer.data = layer.data.chunks_exact(channels).map(rough).collect();
        layer.channels.truncate(1);
    }
    ImageTexture::new(&image, Encoding::Linear)
}

fn sampler_of(sampler: &gltf::texture::Sampler<'_>) -> Sampler {
    use gltf::texture::{MagFilter, MinFilter, WrappingMode};
    let wrap = |mode| match mode {
        WrappingMode::ClampToEdge => Wrap::Clamp,
        WrappingMode::MirroredRepeat => Wrap::Mirror,
        WrappingMode::Repeat => Wrap::Repeat,
    };
    Sampler {
        wrap: [wrap(sampler.wrap_s()), wrap(sampler.wrap_t())],
        nearest: sampler.mag_filter() == Some(MagFilter::Nearest),
        finest: matches!(sampler.min_filter(), Some(MinFilter::Nearest | MinFilter::Linear)),
    }
}
