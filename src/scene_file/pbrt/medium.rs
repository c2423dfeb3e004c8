//! Media between surfaces.

use super::Importer;
use super::error::{Fault, Place, fail};
use super::import::material::Filling;
use super::object::Object;
use super::report::Subject;
use super::spectrum::Meaning;
use super::text::shown;
use crate::media::{Coefficients, NAMED_MEDIA, Phase};
use crate::scene_file::description::VolumeDescription;
use crate::scene_file::diagnostic::suggestion;
use glam::DVec3;
use std::rc::Rc;

/// Coefficients of a medium without any, per unit of length.
const USUAL_ABSORPTION: DVec3 = DVec3::new(0.0011, 0.0024, 0.014);
const USUAL_SCATTERING: DVec3 = DVec3::new(2.55, 3.21, 3.77);

/// Metres in a millimetre, the unit of measured coefficients.
const MILLIMETRE: f32 = 1e-3;

impl Importer<'_> {
    /// The filling of a named medium; nothing for an empty name.
    pub(super) fn filling(&mut self, name: &str, place: &Place) -> Result<Filling, Fault> {
        if name.is_empty() {
            return Ok(Filling::default());
        }
        if let Some(known) = self.fillings.get(name) {
            return Ok(known.clone());
        }
        let Some(object) = self.media.get(name).map(Rc::clone) else {
            let mut names: Vec<&str> = self.media.keys().map(String::as_str).collect();
            names.sort_unstable();
            return fail(place, format!("there is no medium `{}`", shown(name)), suggestion(name, &names));
        };
        let filling = self.medium(&object)?;
        self.fillings.insert(name.to_owned(), filling.clone());
        Ok(filling)
    }

    fn medium(&mut self, object: &Object) -> Result<Filling, Fault> {
        if object.kind != "homogeneous" {
            let known = ["uniformgrid", "rgbgrid", "cloud", "nanovdb", "heterogeneous"];
            let message = if known.contains(&object.kind.as_str()) {
                format!("the medium `{}` varies in space, which is not modelled", object.kind)
            } else {
                format!("the medium `{}` is not known", shown(&object.kind))
            };
            return fail(&object.place, message, "use `homogeneous`, or take its MediumInterface out");
        }
        let scale = object.within("scale", 1.0, 0.0..=1e9)?;
        let refused = |error: &dyn std::fmt::Display| {
            fail(&object.place, format!("{}: {error}", object.label()), "use other coefficients")
        };
        let coefficients = match object.text("preset")? {
            Some(preset) => {
                let letters = |name: &str| name.to_lowercase().replace(['-', ' '], "");
                let Some(named) = NAMED_MEDIA.iter().find(|medium| letters(medium.name) == letters(preset))
                else {
                    let known = NAMED_MEDIA.map(|medium| medium.name);
                    let message = format!("the measured medium `{}` is not known", shown(preset));
                    return fail(object.place_of("preset"), message, suggestion(preset, &known));
                };
                // The numbers of the table, which are per millimetre, count per unit of length of the scene.
                match named.coefficients().and_then(|c| c.per_length(MILLIMETRE)) {
                    Ok(coefficients) => coefficients,
                    Err(error) => return refused(&error),
                }
            }
            None => {
                let absorbed = self.colour(object, "sigma_a", USUAL_ABSORPTION, Meaning::Number)?;
                let scattered = self.colour(object, "sigma_s", USUAL_SCATTERING, Meaning::Number)?;
                match Coefficients::new(absorbed.as_vec3(), scattered.as_vec3()) {
                    Ok(coefficients) => coefficients,
                    Err(error) => return refused(&error),
                }
            }
        };
        let emitted = self.light_colour_or(object, "Le", DVec3::ZERO)?;
        let emitted = emitted * object.within("Lescale", 1.0, 0.0..=1e15)?;
        let g = object.within("g", 0.0, -1.0..=1.0)?;
        self.finish(object, &["sigma_a", "sigma_s", "scale", "preset", "g", "Le", "Lescale"])?;
        let scaled = coefficients.per_length(scale as f32).and_then(|c| c.with_source(emitted.as_vec3()));
        let coefficients = match scaled {
            Ok(coefficients) => coefficients,
            Err(error) => return refused(&error),
        };
        let nothing = crate::math::Rgb::ZERO;
        if coefficients.scattering() == nothing && coefficients.emission() == nothing {
            return Ok(Filling { absorption: coefficients.absorption().as_dvec3(), volume: None });
        }
        let phase = if g == 0.0 { Ok(Phase::Isotropic) } else { Phase::henyey_greenstein(g as f32) };
        match phase {
            Ok(phase) => Ok(Filling {
                absorption: DVec3::ZERO,
                volume: Some(VolumeDescription::even(coefficients, phase)),
            }),
            Err(error) => refused(&error),
        }
    }
}
