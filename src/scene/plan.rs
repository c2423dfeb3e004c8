//! Render plan: what is built for a scene and an integrator, decided in one place, with reasons in words.
// A new variant of a setting does not compile until every match handles it.
#![deny(clippy::wildcard_enum_match_arm, clippy::match_wildcard_for_single_variants)]

use super::{Geometry, Material, Scene};
use crate::bsdf::GLOSS_THRESHOLD;
use crate::lights::{LIGHTS_SAMPLED_EACH, Light};
use crate::media::Medium;
use crate::settings::{GuideKind, IntegratorKind, MapKind, ShadowMode, Wavelengths};
use serde::Serialize;
use std::fmt;

/// Largest number of emitters for which glints are searched, because each of them is searched by itself.
const MOST_SEARCHED: usize = 256;

impl ShadowMode {
    /// Whether shadow photons decide visibility for `light`.
    ///
    /// `AsPrinted` uses them for all lights that shine from a position, as the paper does. `Bounded` uses them only for lights of finite
    /// size: at the sharp edge of a point light's shadow a wrong decision would be wrong by all of the light, and a single ray gives the
    /// exact answer.
    pub fn serves(self, light: &Light) -> bool {
        match (self, light) {
            (Self::Off, _) | (_, Light::Environment(_)) => false,
            (_, Light::Area(_) | Light::Sun(_)) => true,
            (Self::AsPrinted, Light::Point(_) | Light::Spot(_) | Light::Directional(_)) => true,
            (Self::Bounded, Light::Point(_) | Light::Spot(_) | Light::Directional(_)) => false,
        }
    }
}

/// Whether something is built, with the reason.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Decision {
    /// Built or left out.
    pub build: bool,
    /// The reason.
    pub reason: String,
}

impl Decision {
    fn yes(reason: impl Into<String>) -> Self {
        Self { build: true, reason: reason.into() }
    }

    fn no(reason: impl Into<String>) -> Self {
        Self { build: false, reason: reason.into() }
    }
}

impl fmt::Display for Decision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", if self.build { "yes" } else { "no" }, self.reason)
    }
}

/// What is built for one scene and one integrator. Whatever is left out costs no memory and no time.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct RenderPlan {
    /// The map of all photons on diffuse surfaces.
    pub global_map: Decision,
    /// The map of photons that only met specular surfaces.
    pub caustic_map: Decision,
    /// Photon beams: light of specular chains that media scatter.
    pub volume_caustics: Decision,
    /// Photons that media scatter for the second time or more.
    pub volume_map: Decision,
    /// Final gathering of soft indirect light.
    pub final_gather: Decision,
    /// Distribution rays from highly glossy surfaces.
    pub glossy_sampling: Decision,
    /// Irradiance cache: indirect light of Lambertian surfaces, gathered at a few places and interpolated.
    pub irradiance_cache: Decision,
    /// Directional distributions made from photons, which guide the sampling of gather rays and paths.
    pub guide: Decision,
    /// Shadow rays to sampled points of lights.
    pub light_sampling: Decision,
    /// BSDF-sampled rays that complete light sampling by multiple importance sampling.
    pub bsdf_sampling: Decision,
    /// Shadow rays instead of photons for the direct light of points with precomputed irradiance.
    pub direct_at_points: Decision,
    /// Caustics that are also precomputed at photons, for glossy and gather lookups.
    pub caustics_at_points: Decision,
    /// Maps of direct and shadow photons, one for each light, which decide where shadow rays are not needed.
    pub shadow_photons: Decision,
    /// Distribution of photons among the lights by their contribution to the image.
    pub photon_budget: Decision,
    /// A search for glints: emitters in glass and mirrors whose image is smaller than a pixel.
    pub glints: Decision,
    /// Absorption along rays.
    pub absorption: Decision,
    /// Wavelengths of paths that are refracted by an index that depends on the wavelength.
    pub wavelengths: Decision,
    /// Embree geometry kinds in the scene, with counts.
    pub geometry: Vec<String>,
}

impl RenderPlan {
    /// Makes the decisions. `show` is the map that [`IntegratorKind::Photons`] displays.
    pub fn new(scene: &Scene, integrator: IntegratorKind, show: MapKind) -> Self {
        let facts = Facts::of(scene);
        Self {
            global_map: facts.global_map(integrator, show),
            caustic_map: facts.caustic_map(integrator, show),
            volume_caustics: volume_caustics(scene, integrator),
            volume_map: volume_map(scene, integrator),
            final_gather: match integrator {
                IntegratorKind::PhotonMap | IntegratorKind::Progressive if facts.lit && facts.diffuse > 0 => {
                    Decision::yes("diffuse surfaces reflect light to each other")
                }
                IntegratorKind::PhotonMap | IntegratorKind::Progressive => {
                    Decision::no("no light reaches a diffuse surface")
                }
                IntegratorKind::Photons => Decision::no("the map is shown directly"),
                IntegratorKind::Path => Decision::no("path tracing needs no maps"),
            },
            glossy_sampling: facts.glossy_sampling(integrator),
            irradiance_cache: facts.irradiance_cache(integrator),
            guide: Decision::no("directions are drawn from BSDFs alone"),
            light_sampling: facts.light_sampling(integrator, scene.lights().len()),
            bsdf_sampling: match integrator {
                IntegratorKind::Photons => Decision::no("the map is shown directly"),
                IntegratorKind::Path => Decision::yes("paths that hit lights by chance carry caustics"),
                IntegratorKind::PhotonMap | IntegratorKind::Progressive => facts.bsdf_sampling(),
            },
            direct_at_points: Decision::no("no irradiance is precomputed"),
            caustics_at_points: Decision::no("no irradiance is precomputed"),
            shadow_photons: Decision::no("every shadow ray is traced"),
            photon_budget: if scene.scatters() {
                Decision::no("media scatter: photons are shared out by flux")
            } else {
                facts.photon_budget(integrator, scene.lights().len())
            },
            glints: Decision::no("lamps in glass and mirrors are met by chance"),
            wavelengths: dispersion(scene),
            absorption: if facts.absorbing > 0 {
                Decision::yes(format!("{} medium or media absorb", facts.absorbing))
            } else {
                Decision::no("no medium absorbs")
            },
            geometry: facts.geometry,
        }
    }

    /// The same plan for a measurement of the irradiance at `receivers` points. Their irradiance is needed whatever they reflect, so
    /// that maps are built even where nothing else would read them.
    #[must_use]
    pub fn with_receivers(mut self, scene: &Scene, integrator: IntegratorKind, receivers: usize) -> Self {
        let mut facts = Facts::of(scene);
        if receivers == 0 || facts.diffuse > 0 {
            return self;
        }
        facts.diffuse = receivers;
        self.global_map = facts.global_map(integrator, MapKind::Global);
        self.caustic_map = facts.caustic_map(integrator, MapKind::Caustic);
        self.light_sampling = facts.light_sampling(integrator, scene.lights().len());
        if !matches!(integrator, IntegratorKind::Path | IntegratorKind::Photons) {
            self.bsdf_sampling = facts.bsdf_sampling();
        }
        self
    }

    /// The same plan with these wavelengths of dispersed light.
    #[must_use]
    pub fn with_wavelengths(mut self, wavelengths: Wavelengths) -> Self {
        if self.wavelengths.build {
            match wavelengths {
                Wavelengths::Continuous => {}
                Wavelengths::Three => self.wavelengths.reason += ", one of three",
                Wavelengths::Off => {
                    self.wavelengths = Decision::no("switched off: all light is refracted as at the d line");
                }
            }
        }
        self
    }

    /// The same plan, without the irradiance cache unless it is `wanted`.
    #[must_use]
    pub fn with_cache(mut self, wanted: bool) -> Self {
        if !wanted && self.irradiance_cache.build {
            self.irradiance_cache = Decision::no("switched off: every camera sample gathers for itself");
        }
        self
    }

    /// The same plan with an irradiance atlas on disk in place of the global map.
    #[must_use]
    pub fn with_atlas(mut self) -> Self {
        if self.global_map.build {
            self.global_map = Decision::no("gather rays read the irradiance atlas on disk");
            self.direct_at_points = Decision::no("the atlas holds it");
            self.guide = Decision::no("an irradiance atlas holds no directions");
        }
        self
    }

    /// The same plan with irradiance precomputed at photons, for lookups at the ends of gather rays.
    #[must_use]
    pub fn with_precomputed(mut self, scene: &Scene, integrator: IntegratorKind, wanted: bool) -> Self {
        if !wanted || !self.final_gather.build {
            return self;
        }
        self.caustics_at_points = if !self.caustic_map.build {
            Decision::no("there is no caustic map")
        } else if integrator == IntegratorKind::Progressive {
            Decision::no("estimates shrink from round to round")
        } else if !self.glossy_sampling.build {
            Decision::no("no highly glossy surface shows them blurred")
        } else if Facts::of(scene).lambert == 0 {
            Decision::no("no Lambertian surface: what is reflected depends on where light comes from")
        } else {
            Decision::yes("behind glossy reflections, and for gather rays, the nearest point tells them")
        };
        let choice = scene.light_choice();
        self.direct_at_points = if scene.scatters() {
            Decision::no("media scatter, and points do not know what they lie in")
        } else if !choice.groups().is_empty() {
            Decision::no(format!("{} lights: not every point would ask each", scene.lights().len()))
        } else if self.bsdf_sampling.build {
            Decision::no(self.bsdf_sampling.reason.clone())
        } else if self.absorption.build {
            Decision::no("media absorb, and points do not know what they lie in")
        } else {
            Decision::yes(format!("{} light(s), each sampled well by its solid angle", choice.each().len()))
        };
        self
    }

    /// The same plan with guiding by photons; paths then need the global map.
    #[must_use]
    pub fn guided(mut self, scene: &Scene, integrator: IntegratorKind, guide: GuideKind) -> Self {
        if guide == GuideKind::None {
            return self;
        }
        let facts = Facts::of(scene);
        self.guide = match integrator {
            IntegratorKind::Photons => Decision::no("the map is shown directly"),
            _ if !facts.lit || facts.diffuse == 0 => Decision::no("no light reaches a diffuse surface"),
            IntegratorKind::PhotonMap | IntegratorKind::Path | IntegratorKind::Progressive => {
                Decision::yes("photons tell where indirect light comes from")
            }
        };
        if self.guide.build && !self.global_map.build {
            self.global_map = Decision::yes("its photons guide the paths; no path reads it");
        }
        self
    }

    /// The same plan with shadow photons in the requested mode; `show` if photons are displayed by class.
    #[must_use]
    pub fn with_shadow_photons(mut self, scene: &Scene, mode: ShadowMode, show: bool) -> Self {
        let sized = scene.lights().iter().filter(|light| mode.serves(light)).count();
        self.shadow_photons = if show {
            Decision::yes("photons are shown by their class")
        } else if mode == ShadowMode::Off {
            return self;
        } else if scene.scatters() {
            Decision::no("media scatter: a ray that is not blocked is not fully lit either")
        } else if !self.light_sampling.build {
            Decision::no(self.light_sampling.reason.clone())
        } else if !self.global_map.build {
            Decision::no("path tracing traces every shadow ray")
        } else if sized == 0 && mode == ShadowMode::Bounded {
            Decision::no(
                "no light has a size: from a point or parallel light one shadow ray tells exactly, and light from all \
                 around is nearly nowhere whole",
            )
        } else if sized == 0 {
            Decision::no("light from all around is nearly nowhere whole")
        } else if !scene.embree().finds_all_crossings() {
            Decision::no(
                "this Embree was built without filter functions, by which all crossings of a ray are found",
            )
        } else {
            Decision::yes(format!("{sized} light(s) are wholly seen or hidden from large areas"))
        };
        self
    }

    /// The same plan, with a search for glints if it is `wanted`.
    #[must_use]
    pub fn with_glints(mut self, scene: &Scene, integrator: IntegratorKind, wanted: bool) -> Self {
        let facts = Facts::of(scene);
        let lamps =
            scene.lights().iter().filter(|light| matches!(light, Light::Area(_) | Light::Sun(_))).count();
        if scene.scatters() {
            self.glints = Decision::no("media scatter, which chains of specular surfaces do not know");
            return self;
        }
        self.glints = match integrator {
            IntegratorKind::Photons => Decision::no("the map is shown directly"),
            _ if !wanted => return self,
            _ if facts.specular == 0 => Decision::no("no specular surface shows a lamp"),
            _ if lamps == 0 => Decision::no("no light can be seen as a lamp"),
            _ if lamps > MOST_SEARCHED => {
                Decision::no(format!("{lamps} lamps are too many to look at one by one"))
            }
            IntegratorKind::PhotonMap | IntegratorKind::Path | IntegratorKind::Progressive => {
                Decision::yes(format!(
                    "{} specular surface(s) may show {lamps} lamp(s) smaller than a pixel",
                    facts.specular
                ))
            }
        };
        self
    }

    /// Each decision with its name, for display.
    pub fn decisions(&self) -> [(&'static str, &Decision); 17] {
        [
            ("global photon map", &self.global_map),
            ("caustic photon map", &self.caustic_map),
            ("beams in media", &self.volume_caustics),
            ("photons in media", &self.volume_map),
            ("final gathering", &self.final_gather),
            ("glossy sampling", &self.glossy_sampling),
            ("irradiance cache", &self.irradiance_cache),
            ("guided directions", &self.guide),
            ("light sampling", &self.light_sampling),
            ("BSDF sampling of lights", &self.bsdf_sampling),
            ("direct light at points", &self.direct_at_points),
            ("caustics at points", &self.caustics_at_points),
            ("shadow photons", &self.shadow_photons),
            ("photons by contribution", &self.photon_budget),
            ("search for glints", &self.glints),
            ("absorption", &self.absorption),
            ("wavelengths", &self.wavelengths),
        ]
    }
}

/// Whether paths take wavelengths.
fn dispersion(scene: &Scene) -> Decision {
    let names: Vec<&str> = scene
        .media()
        .iter()
        .filter(|medium| medium.dispersion.is_some())
        .map(|medium| medium.name.as_str())
        .collect();
    if names.is_empty() {
        return Decision::no("no index of refraction depends on the wavelength");
    }
    /// Names that are listed.
    const LISTED: usize = 3;
    let more = if names.len() > LISTED { " and others" } else { "" };
    let listed = names[..names.len().min(LISTED)].join("`, `");
    Decision::yes(format!("a path takes one where it is first refracted by `{listed}`{more}"))
}

/// Names of the media that scatter, or the reason why no photons in them are needed.
fn scattering_media(scene: &Scene, integrator: IntegratorKind) -> Result<String, Decision> {
    if !scene.scatters() {
        return Err(Decision::no("no medium scatters"));
    }
    match integrator {
        IntegratorKind::Path => Err(Decision::no("path tracing needs no maps")),
        IntegratorKind::Photons => Err(Decision::no("a map of surfaces is shown")),
        IntegratorKind::PhotonMap | IntegratorKind::Progressive if scene.light_power().is_none() => {
            Err(Decision::no("there is no light"))
        }
        IntegratorKind::PhotonMap | IntegratorKind::Progressive => {
            let scatters = |medium: &&Medium| medium.volume.is_some();
            let names: Vec<&str> = scene.media().iter().filter(scatters).map(|m| m.name.as_str()).collect();
            Ok(names.join(", "))
        }
    }
}

fn volume_caustics(scene: &Scene, integrator: IntegratorKind) -> Decision {
    match scattering_media(scene, integrator) {
        Err(no) => no,
        Ok(_) if scene.casters().is_empty() => {
            Decision::no("no specular surface, so there are no caustics in media")
        }
        Ok(names) => Decision::yes(format!("{names} scatter(s) the light of specular surfaces")),
    }
}

fn volume_map(scene: &Scene, integrator: IntegratorKind) -> Decision {
    match scattering_media(scene, integrator) {
        Err(no) => no,
        Ok(names) => Decision::yes(format!("{names} scatter(s) light again and again")),
    }
}

/// Properties of the scene on which the decisions depend.
struct Facts {
    lit: bool,
    diffuse: usize,
    lambert: usize,
    specular: usize,
    glossy: usize,
    /// Whether media scatter and no surface casts caustics: the borders that seem specular are null interfaces.
    only_null: bool,
    absorbing: usize,
    wide_lights: usize,
    geometry: Vec<String>,
}

impl Facts {
    fn of(scene: &Scene) -> Self {
        let count = |test: fn(&Material) -> bool| {
            let tests = |material: u32| test(&scene.materials()[material as usize].1);
            scene.surfaces().iter().filter(|surface| surface.all_materials().any(tests)).count()
        };
        Self {
            lit: scene.light_power().is_some(),
            diffuse: count(Material::has_diffuse),
            lambert: count(|m| {
                m.has_diffuse() && matches!(m, Material::Lambert { .. } | Material::Layered { .. })
            }),
            specular: count(Material::is_specular),
            glossy: count(Material::has_glossy),
            only_null: scene.scatters() && scene.casters().is_empty(),
            absorbing: scene.media().iter().filter(|medium| medium.absorbs()).count(),
            wide_lights: scene.lights().iter().filter(|light| light.needs_bsdf_sampling()).count(),
            geometry: geometry_kinds(scene),
        }
    }

    fn global_map(&self, integrator: IntegratorKind, show: MapKind) -> Decision {
        match integrator {
            IntegratorKind::Path => Decision::no("path tracing needs no maps"),
            IntegratorKind::Photons if show != MapKind::Global => Decision::no("the other map is shown"),
            _ if !self.lit => Decision::no("there is no light"),
            _ if self.diffuse == 0 => Decision::no("there is no diffuse surface to store photons on"),
            IntegratorKind::PhotonMap | IntegratorKind::Photons | IntegratorKind::Progressive => {
                Decision::yes(format!("{} diffuse surface(s) pass light on", self.diffuse))
            }
        }
    }

    fn caustic_map(&self, integrator: IntegratorKind, show: MapKind) -> Decision {
        match integrator {
            IntegratorKind::Path => Decision::no("path tracing needs no maps"),
            IntegratorKind::Photons if show != MapKind::Caustic => Decision::no("the other map is shown"),
            _ if !self.lit => Decision::no("there is no light"),
            _ if self.specular == 0 => Decision::no("no specular surface, so there are no caustics"),
            _ if self.only_null => Decision::no("all borders of media have the same index on both sides"),
            _ if self.diffuse == 0 => Decision::no("there is no diffuse surface to store photons on"),
            IntegratorKind::PhotonMap | IntegratorKind::Photons | IntegratorKind::Progressive => {
                Decision::yes(format!("{} specular surface(s) cast caustics", self.specular))
            }
        }
    }

    fn glossy_sampling(&self, integrator: IntegratorKind) -> Decision {
        if self.glossy == 0 {
            return Decision::no("no surface is highly glossy");
        }
        let surfaces = self.glossy;
        match integrator {
            IntegratorKind::Path => Decision::no("path tracing follows one direction at a time"),
            IntegratorKind::PhotonMap | IntegratorKind::Photons | IntegratorKind::Progressive => {
                Decision::yes(format!(
                    "{surfaces} surface(s) of a roughness below {GLOSS_THRESHOLD}, too glossy for estimates from photons"
                ))
            }
        }
    }

    fn light_sampling(&self, integrator: IntegratorKind, lights: usize) -> Decision {
        match integrator {
            IntegratorKind::Photons => Decision::no("the map is shown directly"),
            _ if !self.lit => Decision::no("there is no light"),
            _ if self.diffuse + self.glossy == 0 => Decision::no("there is no diffuse or glossy surface"),
            _ if self.glossy == 0 => Decision::yes(format!("{lights} light(s) seen from diffuse surfaces")),
            IntegratorKind::PhotonMap | IntegratorKind::Path | IntegratorKind::Progressive => {
                Decision::yes(format!("{lights} light(s) seen from diffuse or glossy surfaces"))
            }
        }
    }

    fn irradiance_cache(&self, integrator: IntegratorKind) -> Decision {
        match integrator {
            IntegratorKind::Photons => Decision::no("the map is shown directly"),
            IntegratorKind::Path => Decision::no("path tracing needs no maps"),
            _ if !self.lit => Decision::no("there is no light"),
            _ if self.lambert == 0 => {
                Decision::no("no Lambertian surface: indirect light depends on the direction of view")
            }
            IntegratorKind::PhotonMap | IntegratorKind::Progressive => Decision::yes(format!(
                "indirect light changes slowly over {} Lambertian surface(s)",
                self.lambert
            )),
        }
    }

    fn photon_budget(&self, integrator: IntegratorKind, lights: usize) -> Decision {
        if !matches!(integrator, IntegratorKind::PhotonMap | IntegratorKind::Progressive) {
            Decision::no("photons are shared out by flux")
        } else if lights < 2 {
            Decision::no("one light has all photons")
        } else if lights <= LIGHTS_SAMPLED_EACH {
            Decision::yes(format!(
                "{lights} lights, by flux unless the picture shows one of them far more than that"
            ))
        } else if integrator == IntegratorKind::Progressive {
            Decision::no("many lights: photons are shared out by flux in each round")
        } else {
            Decision::yes(format!("{lights} lights, not all of which may matter to the picture"))
        }
    }

    fn bsdf_sampling(&self) -> Decision {
        if self.wide_lights == 0 || self.diffuse == 0 {
            Decision::no("every light is sampled well by its solid angle")
        } else {
            Decision::yes(format!(
                "{} light(s) can fill much of the hemisphere, or are sampled by area",
                self.wide_lights
            ))
        }
    }
}

fn geometry_kinds(scene: &Scene) -> Vec<String> {
    let mut meshes = 0;
    let mut triangles = 0;
    let mut procedural = 0;
    for surface in scene.surfaces() {
        match &surface.geometry {
            Geometry::Mesh(mesh) => {
                meshes += 1;
                triangles += mesh.buffers.triangles().len();
            }
            Geometry::Procedural(_) => procedural += 1,
        }
    }
    let instances = scene.nodes().iter().filter(|node| matches!(node, super::Node::Instance { .. })).count();
    let mut kinds = Vec::new();
    if meshes > 0 {
        kinds.push(format!("{triangles} triangles in {meshes} mesh(es)"));
    }
    if procedural > 0 {
        kinds.push(format!("{procedural} exact shape(s)"));
    }
    if instances > 0 {
        kinds.push(format!("{instances} instance(s)"));
    }
    kinds
}
