//! Materials, textures and samplers.

use super::data::{Data, Resource, resolve};
use super::error::{Failure, GltfProblem, fail};
use crate::bsdf::{Body, Dielectric, LayeredParameters};
use crate::math::Rgb;
use crate::scene::{Coverage, LayeredMaterial};
use crate::scene_file::description::{MaterialDescription, MediumDescription, Named, SceneDescription};
use crate::textures::{Encoding, ImageTexture, Sampler, TextureBudget, TextureSlot, Wrap};
use glam::{Affine2, DVec3, Mat2, Vec2};
use gltf::image::Source;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Luminous flux of one watt (of green light), lm/W: how photometric units become radiometric ones.
pub(super) const LUMENS_PER_WATT: f64 = 683.0;

/// A medium that lets less than this through over the attenuation distance is taken to let this much through.
const LEAST_ATTENUATION: f64 = 1e-6;

/// What the loader keeps of a material.
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
    converted: BTreeMap<(Option<usize>, bool), Converted>,
    images: BTreeMap<(usize, bool), Arc<ImageTexture>>,
    budget: TextureBudget,
}

/// A part of the JSON, and what messages call it.
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

    /// The material of a primitive; `coloured` where its vertices have colours.
    pub(super) fn convert(
        &mut self,
        index: Option<usize>,
        coloured: bool,
        data: &mut Data<'_>,
        description: &mut SceneDescription,
    ) -> Result<Converted, Failure> {
        let index = index.filter(|index| *index < self.document.materials().len());
        if let Some(known) = self.converted.get(&(index, coloured)) {
            return Ok(known.clone());
        }
        let value =
            index.and_then(|index| self.json.pointer(&format!("/materials/{index}"))).unwrap_or(&NOTHING);
        let name = value.get("name").and_then(Value::as_str);
        let object =
            index.map_or("the default material".to_owned(), |index| super::label("materials", index, name));
        let part = Part { value, object: &object };
        let mut material = self.factors(&part, coloured)?;
        self.textures(&part, &mut material, data)?;
        let media = self.volume(&part, &mut material, name.unwrap_or("glass"), description)?;
        let strength =
            part.number("/extensions/KHR_materials_emissive_strength/emissiveStrength", 1.0)?.max(0.0);
        let emitted = if material.unlit {
            material.factors.base
        } else {
            part.colour("/emissiveFactor", 0.0)?.max(Rgb::ZERO) * strength
        };
        // A black picture puts it out.
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
        self.converted.insert((index, coloured), converted.clone());
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
        let factors = LayeredParameters {
            base: Rgb::new(r, g, b).clamp(Rgb::ZERO, Rgb::ONE),
            metallic: part.number("/pbrMetallicRoughness/metallicFactor", 1.0)?,
            ior: part.number("/extensions/KHR_materials_ior/ior", 1.5)?,
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
        material.base = slot("/pbrMetallicRoughness/baseColorTexture", Encoding::Srgb)?;
        if material.unlit {
            return Ok(());
        }
        material.metallic_roughness =
            slot("/pbrMetallicRoughness/metallicRoughnessTexture", Encoding::Linear)?;
        material.normal = slot("/normalTexture", Encoding::Linear)?;
        material.emission = slot("/emissiveTexture", Encoding::Srgb)?;
        material.transmission =
            slot("/extensions/KHR_materials_transmission/transmissionTexture", Encoding::Linear)?;
        material.specular = slot("/extensions/KHR_materials_specular/specularTexture", Encoding::Linear)?;
        material.specular_colour =
            slot("/extensions/KHR_materials_specular/specularColorTexture", Encoding::Srgb)?;
        material.anisotropy_map =
            slot("/extensions/KHR_materials_anisotropy/anisotropyTexture", Encoding::Linear)?;
        material.coat = slot(&format!("{coat}/clearcoatTexture"), Encoding::Linear)?;
        material.coat_roughness_map = slot(&format!("{coat}/clearcoatRoughnessTexture"), Encoding::Linear)?;
        material.coat_normal = slot(&format!("{coat}/clearcoatNormalTexture"), Encoding::Linear)?;
        Ok(())
    }

    /// Decides what is below the surface; the media on both sides where that is a volume.
    fn volume(
        &self,
        part: &Part<'_>,
        material: &mut LayeredMaterial,
        name: &str,
        description: &mut SceneDescription,
    ) -> Result<Option<[usize; 2]>, Failure> {
        if material.factors.transmission <= 0.0 || material.unlit {
            return Ok(None);
        }
        let volume = "/extensions/KHR_materials_volume";
        if part.number(&format!("{volume}/thicknessFactor"), 0.0)? <= 0.0 {
            material.factors.body = Body::Thin;
            return Ok(None);
        }
        // Rays find out how thick it is.
        let ior = material.factors.ior.clamp(1.0, 100.0);
        material.factors.ior = ior;
        material.factors.body = Body::Interface(Dielectric::new(1.0, f64::from(ior)));
        // Where light crosses the border of a medium is not a matter of chance.
        material.coverage = Coverage::Whole;
        let colour = part.colour(&format!("{volume}/attenuationColor"), 1.0)?.as_dvec3();
        let distance = f64::from(part.number(&format!("{volume}/attenuationDistance"), f32::INFINITY)?);
        let absorption = if distance > 0.0 {
            colour.clamp(DVec3::splat(LEAST_ATTENUATION), DVec3::ONE).map(|share| -share.ln() / distance)
        } else {
            DVec3::ZERO
        };
        description.media.push(Named {
            name: format!("inside of {name}"),
            location: description.location.clone(),
            value: MediumDescription { ior: f64::from(ior), absorption, priority: 0 },
        });
        Ok(Some([description.media.len() - 1, 0]))
    }

    /// The texture that a part of a material names; `None` where it names none, or one without a picture.
    fn slot(
        &mut self,
        part: &Part<'_>,
        pointer: &str,
        encoding: Encoding,
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
        let Some(image) = self.document.images().nth(image) else { return Ok(None) };
        let sampler = texture.sampler.and_then(|sampler| self.document.samplers().nth(sampler.value()));
        let sampler = sampler.map_or_else(Sampler::default, |sampler| sampler_of(&sampler));
        let texture = self.image(&image, encoding, data)?;
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
        // Counter-clockwise as one sees it, with v downwards.
        let linear = Mat2::from_angle(-turn) * Mat2::from_diagonal(Vec2::from_array(scale));
        let transform = Affine2::from_mat2_translation(linear, Vec2::new(x, y));
        Ok(Some(TextureSlot { texture, sampler, set, transform }))
    }

    fn image(
        &mut self,
        image: &gltf::Image<'_>,
        encoding: Encoding,
        data: &mut Data<'_>,
    ) -> Result<Arc<ImageTexture>, Failure> {
        let key = (image.index(), encoding == Encoding::Srgb);
        if let Some(known) = self.images.get(&key) {
            return Ok(Arc::clone(known));
        }
        let object = super::label("images", image.index(), image.name());
        let failed = |error: crate::image_io::ImageError| (object.clone(), GltfProblem::from(error));
        let inside = std::path::PathBuf::from("the picture in the file");
        let texture = match image.source() {
            Source::View { view, .. } => {
                ImageTexture::from_bytes(data.view(&view)?, &inside, encoding).map_err(failed)?
            }
            Source::Uri { uri, .. } => match resolve(uri, data.folder()) {
                Ok(Resource::Inline(bytes)) => {
                    ImageTexture::from_bytes(&bytes, &inside, encoding).map_err(failed)?
                }
                Ok(Resource::File(path)) => {
                    let texture = ImageTexture::read(&path, encoding).map_err(failed)?;
                    data.files.push(path);
                    texture
                }
                Err(problem) => return fail(object, problem),
            },
        };
        let texture = Arc::new(self.budget.take(texture, Path::new(&object)).map_err(failed)?);
        self.images.insert(key, Arc::clone(&texture));
        Ok(texture)
    }
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
