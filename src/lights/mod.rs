//! Light sources: the light that they send to a point, and the light that they emit.
//!
//! Every light answers two questions: which light arrives at a point ([`Light::sample_li`], for shadow rays), and how photons leave it
//! (`photons::emission`, from the values stored here). All quantities are in render space: radiance includes the power factor of
//! [`crate::scene::RenderSpace`], and flux also includes the squared length scale.

mod area;
mod choice;
mod cie_sky;
mod environment;
mod sky;
mod spot;
mod sun;
mod sun_position;
mod tree;

pub use area::{AreaLight, EmissionStart};
pub use choice::{LIGHTS_SAMPLED_EACH, LightChoice, LightGroup};
pub use cie_sky::{CieSky, CieSkyKind};
pub use environment::{EnvironmentLight, EnvironmentMap, Mended};
pub use sky::{SUN_ANGULAR_RADIUS, Sky};
pub use spot::{Cone, Profile, ProfileTable, SpotLight};
pub use sun::SunLight;
pub use sun_position::{SunPosition, julian_day, sun_position};
pub use tree::{LightBounds, LightTree};

use crate::math::{Rgb, unit};
use glam::{DVec3, Vec2, Vec3};
use std::f32::consts::PI;

/// Index of a light in its scene.
pub type LightId = u32;

/// A light.
#[derive(Clone, Debug)]
#[expect(
    clippy::large_enum_variant,
    reason = "lights are few, and a box would be one step more for every sample"
)]
pub enum Light {
    /// An emitting surface.
    Area(AreaLight),
    /// A point with equal intensity in all directions.
    Point(PointLight),
    /// A point with an intensity for each direction.
    Spot(SpotLight),
    /// Parallel light.
    Directional(DirectionalLight),
    /// A distant disc of constant radiance.
    Sun(SunLight),
    /// Light from all directions outside of the scene.
    Environment(EnvironmentLight),
}

/// A point that receives light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Receiver {
    /// Position.
    pub position: Vec3,
    /// Unit normal of a surface on the reflecting side; zero where light from all sides counts.
    pub normal: Vec3,
}

impl From<Vec3> for Receiver {
    fn from(position: Vec3) -> Self {
        Self { position, normal: Vec3::ZERO }
    }
}

/// A point light with equal intensity in all directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointLight {
    /// Position.
    pub position: Vec3,
    /// Radiant intensity, flux per solid angle.
    pub intensity: Rgb,
}

/// Parallel light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DirectionalLight {
    /// Direction in which the light travels, unit length.
    pub direction: Vec3,
    /// Irradiance of a surface perpendicular to the light.
    pub irradiance: Rgb,
}

/// A sampled direction from which light may arrive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSample {
    /// Unit direction to the light.
    pub wi: Vec3,
    /// Radiance along `wi` over its density per solid angle, without visibility. For a point or parallel light it is the irradiance of a
    /// surface perpendicular to the light. Does not include the cosine at the receiver.
    pub radiance_over_pdf: Rgb,
    /// Density of `wi` per solid angle; infinite for a point or parallel light.
    pub pdf_solid_angle: f32,
    /// End point of a shadow ray, already off the light's surface; `None` for light from infinity.
    pub target: Option<Vec3>,
    /// Distance over which a medium at the receiver absorbs: the distance to the light, or zero for light from infinity, which could not
    /// arrive through an unbounded medium.
    pub distance: f32,
}

impl Light {
    /// Samples a direction from which the light reaches a point. `None` where this `u` sends no light there.
    pub fn sample_li(&self, at: impl Into<Receiver>, u: Vec2) -> Option<LightSample> {
        let at = at.into();
        let from = at.position;
        match self {
            Self::Area(area) => area.sample_li(&at, u),
            Self::Spot(spot) => spot.arriving(from).map(|(wi, arriving, distance)| LightSample {
                wi,
                radiance_over_pdf: arriving,
                pdf_solid_angle: f32::INFINITY,
                target: Some(spot.position),
                distance,
            }),
            Self::Sun(sun) => Some(LightSample {
                wi: sun.sample(u),
                radiance_over_pdf: sun.radiance * sun.solid_angle(),
                pdf_solid_angle: sun.pdf_inside(),
                target: None,
                distance: 0.0,
            }),
            Self::Point(point) => {
                let to_light = point.position - from;
                let wi = unit(to_light)?;
                let distance = to_light.length();
                Some(LightSample {
                    wi,
                    radiance_over_pdf: point.intensity / (distance * distance),
                    pdf_solid_angle: f32::INFINITY,
                    target: Some(point.position),
                    distance,
                })
                .filter(|sample| sample.radiance_over_pdf.is_finite())
            }
            Self::Directional(sun) => Some(LightSample {
                wi: -sun.direction,
                radiance_over_pdf: sun.irradiance,
                pdf_solid_angle: f32::INFINITY,
                target: None,
                distance: 0.0,
            }),
            Self::Environment(environment) => {
                let (wi, radiance_over_pdf, pdf_solid_angle) = environment.sample(u)?;
                Some(LightSample { wi, radiance_over_pdf, pdf_solid_angle, target: None, distance: 0.0 })
            }
        }
    }

    /// Radiance from outside along the unit `direction`, which points away from the scene. `None` for lights that a ray leaving the
    /// scene cannot hit or does not hit.
    pub fn outside(&self, direction: Vec3) -> Option<Rgb> {
        match self {
            Self::Environment(environment) => Some(environment.radiance_from(direction)),
            Self::Sun(sun) if sun.covers(direction) => Some(sun.radiance),
            _ => None,
        }
    }

    /// Density per solid angle with which [`Self::sample_li`] samples a direction for which [`Self::outside`] is not `None`.
    pub fn outside_pdf(&self, direction: Vec3) -> f32 {
        match self {
            Self::Environment(environment) => environment.pdf_solid_angle(direction),
            Self::Sun(sun) => sun.pdf_inside(),
            _ => 0.0,
        }
    }

    /// Bounds of its light; `None` for light from outside.
    pub fn bounds(&self) -> Option<LightBounds> {
        match self {
            Self::Area(area) => area.bounds(),
            Self::Point(point) => {
                Some(LightBounds::point(point.position.as_dvec3(), point.intensity.max_element().into()))
            }
            Self::Spot(spot) => {
                let peak = f64::from(spot.peak().max_element());
                let (axis, reach) = spot.extent();
                let point = LightBounds::point(spot.position.as_dvec3(), peak);
                // Slightly more than the cone itself, for rounding. The intensity does not fall with the cosine, so that the whole cone
                // counts as normals.
                Some(LightBounds {
                    axis: axis.as_dvec3(),
                    spread: f64::from(reach) + 1e-4,
                    reach: 1e-3,
                    ..point
                })
            }
            Self::Directional(_) | Self::Sun(_) | Self::Environment(_) => None,
        }
    }

    /// Flux per channel that the light sends into a scene whose bounding sphere has this radius.
    pub fn flux(&self, scene_radius: f32) -> DVec3 {
        let disc = f64::from(PI) * f64::from(scene_radius) * f64::from(scene_radius);
        match self {
            Self::Area(area) => area.flux(),
            Self::Point(point) => point.intensity.as_dvec3() * (4.0 * std::f64::consts::PI),
            Self::Spot(spot) => spot.flux(),
            Self::Directional(sun) => sun.irradiance.as_dvec3() * disc,
            // Each direction sends light through the disc that faces it.
            Self::Sun(sun) => sun.radiance.as_dvec3() * (f64::from(sun.solid_angle()) * disc),
            Self::Environment(environment) => environment.integral() * disc,
        }
    }

    /// Whether no ray can hit the light by chance.
    pub fn is_delta(&self) -> bool {
        matches!(self, Self::Point(_) | Self::Spot(_) | Self::Directional(_))
    }

    /// Largest probability with which a direction sampled by the cosine at `position` (render space) hits the light, without occlusion:
    /// the square of the sine of its angular radius. Zero for lights that no ray can hit.
    pub fn chance_from(&self, position: Vec3) -> f64 {
        match self {
            Self::Area(area) => area.bounding_sphere().map_or(1.0, |(centre, radius)| {
                let ratio = radius / centre.distance(position.as_dvec3());
                if ratio < 1.0 { ratio * ratio } else { 1.0 }
            }),
            Self::Sun(sun) => f64::from(sun.angular_radius().sin().powi(2)),
            Self::Environment(_) => 1.0,
            Self::Point(_) | Self::Spot(_) | Self::Directional(_) => 0.0,
        }
    }

    /// Whether the light comes from outside of the scene.
    pub fn is_at_infinity(&self) -> bool {
        matches!(self, Self::Directional(_) | Self::Sun(_) | Self::Environment(_))
    }

    /// Whether the light comes from all directions outside of the scene.
    pub fn is_environment(&self) -> bool {
        matches!(self, Self::Environment(_))
    }

    /// Whether the density of [`Self::sample_li`] may differ greatly from the light's contribution, so that light sampling alone would
    /// be noisy. This holds for light from all directions, and for shapes sampled by area, close to which the contribution of a sample
    /// is unbounded.
    pub fn needs_bsdf_sampling(&self) -> bool {
        match self {
            Self::Area(area) => area.needs_bsdf_sampling(),
            // The sun is sampled by its solid angle, which is small.
            Self::Point(_) | Self::Spot(_) | Self::Directional(_) | Self::Sun(_) => false,
            Self::Environment(_) => true,
        }
    }

    /// Points just off the light, on the side of its normal or on its `back`, at which its medium is determined, each with the normal on
    /// that side (zero where there is none). For light from infinity the point lies outside of everything.
    pub fn points(&self, back: bool) -> Vec<(Vec3, Vec3)> {
        match self {
            Self::Area(area) => (0..4)
                .map(|i| {
                    // Centres of four cells, no two of which share a row or a column.
                    let u = Vec2::new(i as f32 + 0.5, [1.5, 3.5, 0.5, 2.5][i]) * 0.25;
                    let start = area.sample_side(back, u);
                    (start.off_surface(start.normal), start.normal)
                })
                .collect(),
            Self::Point(point) => vec![(point.position, Vec3::ZERO)],
            Self::Spot(spot) => vec![(spot.position, Vec3::ZERO)],
            Self::Sun(sun) => vec![(sun.towards() * 10.0, Vec3::ZERO)],
            // Render space fits into the unit sphere.
            Self::Directional(sun) => vec![(sun.direction * -10.0, Vec3::ZERO)],
            Self::Environment(_) => vec![(Vec3::new(0.0, 10.0, 0.0), Vec3::ZERO)],
        }
    }
}
