//! What a scene holds, by name, for `cardioid info`: lights with their power, textures, groups and surfaces.

use super::info::four_digits;
use cardioid::lights::Light;
use cardioid::scene::Scene;
use cardioid::scene_file::{Named, SceneDescription};
use cardioid::textures::TextureSlot;
use serde::Serialize;
use std::fmt::Write;

/// Lines of a list that are printed; JSON has all.
const SHOWN: usize = 24;

/// Lumens of a watt whose colour has the luminance 1.
const LUMENS_PER_WATT: f64 = 683.0;

/// A light.
#[derive(Serialize)]
pub(super) struct DescribedLight {
    /// Its number, as in statistics.
    id: usize,
    name: String,
    kind: String,
    /// W into the scene: red, green and blue.
    power: [f64; 3],
    /// The same, lm.
    lumens: f64,
}

/// An image of a material, or a solid texture.
#[derive(Serialize)]
pub(super) struct DescribedTexture {
    material: String,
    /// Which parameter of the material it gives.
    slot: &'static str,
    /// Width and height of an image, pixels; none for a solid texture.
    size: Option<[u32; 2]>,
    /// Memory of an image, bytes.
    bytes: usize,
}

/// A group of shapes.
#[derive(Serialize)]
pub(super) struct DescribedGroup {
    name: String,
    shapes: usize,
    instances: usize,
}

/// A surface of the scene.
#[derive(Serialize)]
pub(super) struct DescribedSurface {
    /// Its number, as in `probe` and in messages.
    id: usize,
    name: String,
    materials: Vec<String>,
    /// Number of the light that it is, if it emits.
    light: Option<u32>,
}

/// What a scene holds.
#[derive(Serialize)]
pub(super) struct Contents {
    pub(super) lights: Vec<DescribedLight>,
    pub(super) textures: Vec<DescribedTexture>,
    pub(super) groups: Vec<DescribedGroup>,
    pub(super) surfaces: Vec<DescribedSurface>,
}

impl Contents {
    pub(super) fn of(description: &SceneDescription, scene: &Scene) -> Self {
        Self {
            lights: lights(scene),
            textures: textures(scene),
            groups: groups(description),
            surfaces: surfaces(scene),
        }
    }

    /// The lights, a line each.
    pub(super) fn write_lights(&self, out: &mut impl Write) -> std::fmt::Result {
        for DescribedLight { name, kind, power: [r, g, b], lumens, .. } in &self.lights {
            writeln!(
                out,
                "  light      {name}: {kind}, {r:.4} {g:.4} {b:.4} W, {} lm",
                four_digits(*lumens)
            )?;
        }
        Ok(())
    }

    /// Textures, groups and surfaces, a line each; of long lists the beginning.
    pub(super) fn write_rest(&self, out: &mut impl Write) -> std::fmt::Result {
        let textures = self.textures.iter().map(|texture| match texture.size {
            Some([width, height]) => format!(
                "{} of {}: {width} x {height} pixels, {} bytes",
                texture.slot, texture.material, texture.bytes
            ),
            None => format!("{} of {}: solid", texture.slot, texture.material),
        });
        write_list(out, "texture", textures)?;
        let groups = self.groups.iter().map(|group| {
            format!("{}: {} shape(s), {} instance(s)", group.name, group.shapes, group.instances)
        });
        write_list(out, "group", groups)?;
        let surfaces = self
            .surfaces
            .iter()
            .map(|surface| format!("{} {}: {}", surface.id, surface.name, surface.materials.join(", ")));
        write_list(out, "surface", surfaces)
    }
}

fn write_list(
    out: &mut impl Write,
    label: &str,
    lines: impl ExactSizeIterator<Item = String>,
) -> std::fmt::Result {
    let more = lines.len().saturating_sub(SHOWN);
    for line in lines.take(SHOWN) {
        writeln!(out, "  {label:10} {line}")?;
    }
    if more > 0 {
        writeln!(out, "  {label:10} and {more} more (--json lists all)")?;
    }
    Ok(())
}

fn lights(scene: &Scene) -> Vec<DescribedLight> {
    let flux_unit = 1.0 / (scene.space().power * scene.space().scale * scene.space().scale);
    let described = |(id, light): (usize, &Light)| {
        let kind = match light {
            Light::Area(area) => format!("area light, {}", area.shape()),
            Light::Point(_) => "point light".to_owned(),
            Light::Spot(spot) if spot.is_profile() => "measured light".to_owned(),
            Light::Spot(_) => "spot light".to_owned(),
            Light::Directional(_) => "parallel light".to_owned(),
            Light::Sun(_) => "sun".to_owned(),
            Light::Environment(_) => "environment".to_owned(),
        };
        let power = (light.flux(scene.bounds().1) * flux_unit).to_array();
        let [r, g, b] = power;
        let lumens = LUMENS_PER_WATT * (0.2126 * r + 0.7152 * g + 0.0722 * b);
        DescribedLight { id, name: scene.light_note(id).name.clone(), kind, power, lumens }
    };
    scene.lights().iter().enumerate().map(described).collect()
}

fn textures(scene: &Scene) -> Vec<DescribedTexture> {
    let mut found = Vec::new();
    for ((name, _), texture) in scene.materials().iter().zip(scene.textures()) {
        let mut solid = |slot| {
            found.push(DescribedTexture { material: name.clone(), slot, size: None, bytes: 0 });
        };
        if texture.colour.is_some() {
            solid("colour");
        }
        if texture.bump.is_some() {
            solid("bump");
        }
        let slots = texture.layers.iter().flat_map(|layers| layers.named_slots());
        found.extend(slots.map(|(slot, TextureSlot { texture, .. })| DescribedTexture {
            material: name.clone(),
            slot,
            size: Some(texture.size()),
            bytes: texture.bytes(),
        }));
    }
    found
}

fn groups(description: &SceneDescription) -> Vec<DescribedGroup> {
    let described = |(number, group): (usize, &Named<()>)| DescribedGroup {
        name: group.name.clone(),
        shapes: description.shapes.iter().filter(|shape| shape.value.group == Some(number)).count(),
        instances: description.instances.iter().filter(|it| it.value.group == number).count(),
    };
    description.groups.iter().enumerate().map(described).collect()
}

fn surfaces(scene: &Scene) -> Vec<DescribedSurface> {
    let material = |id: u32| scene.materials()[id as usize].0.clone();
    let described = |(id, surface): (usize, &cardioid::scene::Surface)| DescribedSurface {
        id,
        name: surface.name.clone(),
        materials: surface.all_materials().map(material).collect(),
        light: surface.light,
    };
    scene.surfaces().iter().enumerate().map(described).collect()
}
