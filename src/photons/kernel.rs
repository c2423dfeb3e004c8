use serde::Serialize;

/// Which of the photon maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum MapKind {
    /// All photons on diffuse surfaces.
    Global,
    /// Photons that met only specular surfaces between the light and the surface they are stored at.
    Caustic,
}

/// Kernel of a density estimate, a function of the distance `d` over the radius `r`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kernel {
    /// Constant (Jensen 1996, eq. 3).
    Constant,
    /// `max(0, 1 - d / (k r))` (Jensen 1996, eq. 4).
    Cone {
        /// Filter constant, at least 1.
        k: f32,
    },
    /// `1 - (d / r)^2`.
    Epanechnikov,
    /// The Gaussian of Pavicic (Graphics Gems I) with Jensen's constants, normalised exactly.
    Gaussian,
}

/// Whether density estimates carry the known bias of the printed formulas.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Estimator {
    /// Eq. (3) and (5) of Jensen 1996 as they stand: the N-th photon sets the radius and is counted as well.
    AsPrinted,
    /// Free of that bias (Garcia, Urena & Sbert 2012): the N-th photon only sets the radius.
    Corrected,
}

/// Region in which photons are searched.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SearchRegion {
    /// A sphere.
    Sphere,
    /// An ellipsoid flattened along the normal, so that surfaces nearby that face elsewhere are left out.
    Disc,
}
