//! Lights without a surface: reads their files and scales them to render space.

use super::BuildProblem;
use crate::lights::{
    CieSky, Cone, DirectionalLight, EnvironmentLight, EnvironmentMap, Light, PointLight, Profile,
    SUN_ANGULAR_RADIUS, Sky, SpotLight, SunLight,
};
use crate::math::{Rgb, unit_f64};
use crate::scene::RenderSpace;
use crate::scene_file::description::{EnvironmentLayout, LightDescription, ProfileBrightness, ProfileLayout};
use crate::scene_file::directions::{colours_of, latitude_longitude, mean, profile_table};
use crate::scene_file::ies::read_ies;
use crate::textures::read_picture;
use glam::{DMat3, DVec3};
use std::f64::consts::PI;
use std::path::Path;
use std::sync::Arc;

/// Most values of an environment map, at 24 bytes of memory for each pixel: 8192 by 4096 pixels of four values.
const MOST_VALUES: u64 = 1 << 27;

/// Rows of the table that holds a sky.
const SKY_ROWS: usize = 512;

/// A light with the data of its files; metres and watts.
#[derive(Debug)]
pub(super) enum LightSource {
    Point {
        position: DVec3,
        intensity: DVec3,
    },
    Directional {
        direction: DVec3,
        irradiance: DVec3,
    },
    Sun {
        direction: DVec3,
        irradiance: DVec3,
        radius: f64,
    },
    Environment {
        radiance: DVec3,
    },
    Map {
        map: Arc<EnvironmentMap>,
        turn: f64,
        axes: Option<DMat3>,
        factor: DVec3,
    },
    /// `sun`: direction towards the sun, and its irradiance.
    Sky {
        map: Arc<EnvironmentMap>,
        axes: Option<DMat3>,
        factor: DVec3,
        sun: Option<(DVec3, DVec3)>,
    },
    Spot {
        position: DVec3,
        direction: DVec3,
        intensity: DVec3,
        cone: Cone,
    },
    Profile {
        position: DVec3,
        direction: DVec3,
        along: DVec3,
        factor: DVec3,
        profile: Arc<Profile>,
    },
}

impl LightSource {
    /// Reads the light of a description, with warnings for the user.
    pub(super) fn read(light: &LightDescription) -> Result<(Self, Vec<String>), BuildProblem> {
        let mut findings = Vec::new();
        let source = match *light {
            LightDescription::Point { position, intensity } => Self::Point { position, intensity },
            LightDescription::Directional { direction, irradiance } => {
                Self::Directional { direction, irradiance }
            }
            LightDescription::Sun { direction, irradiance, radius } => {
                Self::Sun { direction, irradiance, radius }
            }
            LightDescription::Environment { radiance } => Self::Environment { radiance },
            LightDescription::EnvironmentMap { ref image, layout, turn, axes, factor } => {
                let (map, mended) = read_map(image, layout, &mut findings)?;
                Self::Map { map: Arc::new(map), turn, axes, factor: factor * mended }
            }
            LightDescription::Sky { elevation, azimuth, turbidity, albedo, factor, sun, axes } => {
                let sky =
                    Sky::new(elevation, azimuth, turbidity, albedo.as_vec3()).ok_or(BuildProblem::Sky)?;
                let map = Arc::new(sky.map(SKY_ROWS, sun).ok_or(BuildProblem::Sky)?);
                let turned = |direction: DVec3| axes.map_or(direction, |axes| axes * direction);
                let sun = sun.then(|| (turned(sky.towards_sun()), sky.sun_irradiance()));
                Self::Sky { map, axes, factor, sun }
            }
            LightDescription::CieSky { kind, elevation, azimuth, irradiance, sun, albedo, factor } => {
                let sky = CieSky::new(kind, elevation, azimuth).ok_or(BuildProblem::Sky)?;
                let of_sun = sun.unwrap_or(DVec3::ZERO);
                let map = sky.map(SKY_ROWS, irradiance, of_sun, albedo.as_vec3());
                let sun = sun.map(|irradiance| (sky.towards_sun(), irradiance));
                Self::Sky { map: Arc::new(map.ok_or(BuildProblem::Sky)?), axes: None, factor, sun }
            }
            LightDescription::Spot { position, direction, intensity, inner, outer } => {
                Self::Spot { position, direction, intensity, cone: Cone::new(inner, outer) }
            }
            LightDescription::Profile { ref file, layout, position, direction, along, brightness } => {
                let table = match layout {
                    ProfileLayout::Photometric => {
                        let ies = read_ies(file)?;
                        let told = |warning| format!("{}: {warning}", file.display());
                        findings.extend(ies.warnings.into_iter().map(told));
                        ies.table
                    }
                    ProfileLayout::EqualArea { is_mirrored } => {
                        let (side, pixels) = read_square(file, &mut findings)?;
                        profile_table(side, &pixels, is_mirrored)
                    }
                };
                let dark =
                    BuildProblem::NoLight { path: file.clone(), why: "nothing shines; name another file" };
                let profile = Profile::new(table).ok_or(dark)?;
                let factor = match brightness {
                    ProfileBrightness::PerCandela(factor) => factor,
                    ProfileBrightness::Power(power) => power / profile.flux(),
                };
                Self::Profile { position, direction, along, factor, profile: Arc::new(profile) }
            }
        };
        Ok((source, findings))
    }

    /// Flux into a scene of this radius (render units), in render units before the power factor.
    pub(super) fn flux(&self, space: &RenderSpace, radius: f64) -> DVec3 {
        let disc = PI * radius * radius;
        let area = space.scale * space.scale;
        match self {
            Self::Point { intensity, .. } => *intensity * (4.0 * PI * area),
            Self::Directional { irradiance, .. } | Self::Sun { irradiance, .. } => *irradiance * disc,
            Self::Environment { radiance } => *radiance * (4.0 * PI * disc),
            Self::Map { map, factor, .. } => *factor * map.integral() * disc,
            Self::Sky { map, factor, sun, .. } => {
                *factor * (map.integral() + sun.map_or(DVec3::ZERO, |(_, irradiance)| irradiance)) * disc
            }
            Self::Spot { intensity, cone, .. } => *intensity * (cone.flux() * area),
            Self::Profile { factor, profile, .. } => *factor * (profile.flux() * area),
        }
    }

    /// The light in render space: one light, or those of a sky, each with a suffix for its name.
    pub(super) fn lights(&self, space: &RenderSpace) -> Vec<(&'static str, Light)> {
        let scaled = |colour: DVec3| (colour * space.power).as_vec3();
        let of_point = |colour: DVec3| scaled(colour * (space.scale * space.scale));
        let place = |position: DVec3| space.position(position).as_vec3();
        let unit = |direction: DVec3| unit_f64(direction).unwrap_or(DVec3::NEG_Y).as_vec3();
        let light = match self {
            Self::Point { position, intensity } => {
                Light::Point(PointLight { position: place(*position), intensity: of_point(*intensity) })
            }
            Self::Directional { direction, irradiance } => Light::Directional(DirectionalLight {
                direction: unit(*direction),
                irradiance: scaled(*irradiance),
            }),
            Self::Sun { direction, irradiance, radius } => {
                Light::Sun(SunLight::new(-unit(*direction), *radius, scaled(*irradiance)))
            }
            Self::Environment { radiance } => {
                Light::Environment(EnvironmentLight::constant(scaled(*radiance)))
            }
            Self::Map { map, turn, axes, factor } => {
                let light = EnvironmentLight::of_map(Arc::clone(map), *turn, scaled(*factor));
                Light::Environment(light.with_axes(axes.map(|axes| axes.as_mat3())))
            }
            Self::Sky { map, axes, factor, sun } => {
                let sky = EnvironmentLight::of_map(Arc::clone(map), 0.0, scaled(*factor));
                let sky = sky.with_axes(axes.map(|axes| axes.as_mat3()));
                let sun = sun.map(|(towards, irradiance)| {
                    let sun = SunLight::new(unit(towards), SUN_ANGULAR_RADIUS, scaled(irradiance * *factor));
                    (" (sun)", Light::Sun(sun))
                });
                return [("", Light::Environment(sky))].into_iter().chain(sun).collect();
            }
            Self::Spot { position, direction, intensity, cone } => {
                Light::Spot(SpotLight::cone(place(*position), unit(*direction), of_point(*intensity), *cone))
            }
            Self::Profile { position, direction, along, factor, profile } => {
                let axes = (unit(*direction), unit(*along));
                Light::Spot(SpotLight::profile(
                    place(*position),
                    axes,
                    of_point(*factor),
                    Arc::clone(profile),
                ))
            }
        };
        vec![("", light)]
    }
}

/// The size and the pixels of a picture: its unnamed layer, or the only one.
fn read_pixels(path: &Path, findings: &mut Vec<String>) -> Result<([usize; 2], Vec<Rgb>), BuildProblem> {
    let refuse = |why| BuildProblem::NoLight { path: path.to_path_buf(), why };
    let image = read_picture(path, MOST_VALUES)?;
    findings.extend(image.findings.iter().map(|finding| format!("{}: {finding}", path.display())));
    let texels = colours_of(&image).ok_or_else(|| {
        refuse("the picture has neither channels R, G and B nor a single one; name another")
    })?;
    Ok(([image.width as usize, image.height as usize], texels))
}

/// The side and the pixels of a square picture of all directions.
fn read_square(path: &Path, findings: &mut Vec<String>) -> Result<(usize, Vec<Rgb>), BuildProblem> {
    let ([width, height], texels) = read_pixels(path, findings)?;
    if width != height {
        return Err(BuildProblem::NoLight {
            path: path.to_path_buf(),
            why: "an equal-area octahedral picture is a square; make one of it (pbrt's `imgtool makeequiarea`)",
        });
    }
    Ok((width, texels))
}

/// An image of all directions, and a factor that keeps what it gives in all.
fn read_map(
    path: &Path,
    layout: EnvironmentLayout,
    findings: &mut Vec<String>,
) -> Result<(EnvironmentMap, DVec3), BuildProblem> {
    let (width, texels, whole) = match layout {
        EnvironmentLayout::LatitudeLongitude => {
            let (width, texels) = read_wide(path, findings)?;
            (width, texels, None)
        }
        EnvironmentLayout::EqualArea => {
            let (side, mut pixels) = read_square(path, findings)?;
            // What is no radiance is counted below, and does not spread to its neighbours.
            let counted = pixels.iter().any(|pixel| !pixel.is_finite() || pixel.min_element() < 0.0);
            if counted {
                let mended = |x: f32| if x.is_nan() { 0.0 } else { x.clamp(0.0, EnvironmentMap::LARGEST) };
                pixels.iter_mut().for_each(|pixel| *pixel = pixel.map(mended));
                findings.push(format!(
                    "{}: pixels that are negative or no numbers count as zero, infinite ones as {:e}",
                    path.display(),
                    EnvironmentMap::LARGEST
                ));
            }
            let whole = mean(&pixels) * (4.0 * PI);
            let (width, texels) = latitude_longitude(side, &pixels);
            (width, texels, Some(whole))
        }
    };
    let map = finished_map(path, width, texels, findings)?;
    let factor = whole.map_or(DVec3::ONE, |whole| {
        let ratio = whole / map.integral();
        DVec3::select(ratio.is_finite_mask(), ratio, DVec3::ONE)
    });
    Ok((map, factor))
}

/// An image in longitude and latitude.
fn read_wide(path: &Path, findings: &mut Vec<String>) -> Result<(usize, Vec<Rgb>), BuildProblem> {
    let ([width, height], texels) = read_pixels(path, findings)?;
    if width != 2 * height {
        findings.push(format!(
            "{}: {width} x {height} pixels, where a picture in longitude and latitude is twice as wide as high; it is \
             stretched over all directions",
            path.display()
        ));
    }
    Ok((width, texels))
}

fn finished_map(
    path: &Path,
    width: usize,
    texels: Vec<Rgb>,
    findings: &mut Vec<String>,
) -> Result<EnvironmentMap, BuildProblem> {
    let (map, mended) = EnvironmentMap::new(width, texels);
    if mended.negative > 0 {
        findings.push(format!(
            "{}: {} pixels are negative or no numbers there, and count as zero",
            path.display(),
            mended.negative
        ));
    }
    if mended.too_large > 0 {
        findings.push(format!(
            "{}: {} pixels are infinite or above {:e}, and count as that",
            path.display(),
            mended.too_large,
            EnvironmentMap::LARGEST
        ));
    }
    map.ok_or_else(|| BuildProblem::NoLight {
        path: path.to_path_buf(),
        why: "no pixel of the picture is above zero, so it gives no light; leave the light out",
    })
}
