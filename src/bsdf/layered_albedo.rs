//! Total albedo of GGX facets with Schlick's reflectance, by angle and roughness, which determines the light left for the layers below.

use super::ggx::{Ggx, SMOOTH_ROUGHNESS, reflect_about};
use glam::{Vec2, Vec3};
use std::sync::OnceLock;

/// Number of table steps along each axis: the square root of the cosine, and the square root of the slope.
const STEPS: usize = 32;

/// Root of the number of facets per table entry: directions are at the centres of a grid.
const FACETS: usize = 16;

/// Margin added to the table's values, which covers their error, so that layers never receive more light than is left.
const MARGIN: f32 = 0.004;

/// Albedo of facets that reflect everything, and albedo of facets that reflect `(1 - cos)^5`.
type Entry = [f32; 2];

struct Table {
    /// Entries by slope, then by cosine.
    entries: Vec<[Entry; STEPS]>,
    /// Cosine-weighted means over the hemisphere, by slope.
    means: [Entry; STEPS],
}

fn table() -> &'static Table {
    static TABLE: OnceLock<Table> = OnceLock::new();
    TABLE.get_or_init(Table::new)
}

impl Table {
    fn new() -> Self {
        let at = |step: usize| (step as f32 / (STEPS - 1) as f32).powi(2);
        let row = |slope: usize| {
            let slope = at(slope).max(SMOOTH_ROUGHNESS);
            let facets = Ggx { along: slope, across: slope };
            // The albedo is undefined at exactly grazing incidence; the entry is taken very close to it.
            std::array::from_fn(|cosine| albedo(&facets, at(cosine).max(1e-4)))
        };
        let entries: Vec<[Entry; STEPS]> = (0..STEPS).map(row).collect();
        let means = std::array::from_fn(|slope| mean(&entries[slope]));
        Self { entries, means }
    }
}

/// Single-scattering albedo of facets seen at this cosine.
fn albedo(facets: &Ggx, cosine: f32) -> Entry {
    let wo = Vec3::new(((1.0 - cosine) * (1.0 + cosine)).sqrt(), 0.0, cosine);
    let middle = |i: usize| (i as f32 + 0.5) / FACETS as f32;
    let mut sums = [0f64; 2];
    for u in (0..FACETS * FACETS).map(|i| Vec2::new(middle(i / FACETS), middle(i % FACETS))) {
        let h = facets.sample_visible(wo, u);
        let wi = reflect_about(wo, h);
        if wi.z > 0.0 {
            let weight = f64::from(facets.masking_ratio(wo, wi));
            sums[0] += weight;
            sums[1] += weight * f64::from((1.0 - wo.dot(h)).clamp(0.0, 1.0)).powi(5);
        }
    }
    sums.map(|sum| (sum / (FACETS * FACETS) as f64) as f32)
}

/// Cosine-weighted mean over the hemisphere of the interpolated table.
fn mean(row: &[Entry; STEPS]) -> Entry {
    const POINTS: usize = 512;
    let mut sums = [0f64; 2];
    for i in 0..POINTS {
        let cosine = (i as f32 + 0.5) / POINTS as f32;
        let entry = along(row, cosine);
        for (sum, value) in sums.iter_mut().zip(entry) {
            *sum += f64::from(2.0 * cosine * value);
        }
    }
    sums.map(|sum| (sum / POINTS as f64) as f32)
}

#[inline]
fn mixed(a: Entry, b: Entry, t: f32) -> Entry {
    [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t]
}

/// Lower index and fraction for a value whose square root is tabulated in even steps.
#[inline]
fn place(value: f32) -> (usize, f32) {
    let x = value.clamp(0.0, 1.0).sqrt() * (STEPS - 1) as f32;
    let below = (x as usize).min(STEPS - 2);
    (below, x - below as f32)
}

#[inline]
fn along(row: &[Entry; STEPS], cosine: f32) -> Entry {
    let (below, rest) = place(cosine);
    mixed(row[below], row[below + 1], rest)
}

#[inline]
fn of_schlick([all, grazing]: Entry, f0: f32, f90: f32) -> f32 {
    f0 * (all - grazing) + f90 * grazing
}

/// Upper estimate of the albedo at this cosine of facets with slope `roughness` that reflect `f0 + (f90 - f0) (1 - cos)^5`, in `[0, 1]`;
/// exact for smooth facets (zero slope), zero where `f0` and `f90` are zero.
#[inline]
pub(super) fn gloss_albedo(cosine: f32, roughness: f32, f0: f32, f90: f32) -> f32 {
    if f0 <= 0.0 && f90 <= 0.0 {
        return 0.0;
    }
    if roughness < SMOOTH_ROUGHNESS {
        let x = (1.0 - cosine).clamp(0.0, 1.0);
        return of_schlick([1.0, x * x * x * x * x], f0, f90).clamp(0.0, 1.0);
    }
    let table = table();
    let (below, rest) = place(roughness);
    let entry = mixed(along(&table.entries[below], cosine), along(&table.entries[below + 1], cosine), rest);
    (of_schlick(entry, f0, f90) + MARGIN * f90.max(f0)).clamp(0.0, 1.0)
}

/// Cosine-weighted mean of [`gloss_albedo`] over the hemisphere; less than one.
#[inline]
pub(super) fn mean_gloss_albedo(roughness: f32, f0: f32, f90: f32) -> f32 {
    /// Largest value, so that a division by the remaining light is possible.
    const MOST: f32 = 0.999;
    if f0 <= 0.0 && f90 <= 0.0 {
        return 0.0;
    }
    if roughness < SMOOTH_ROUGHNESS {
        // The integral of 2 c (1 - c)^5 is 1/21.
        return of_schlick([1.0, 1.0 / 21.0], f0, f90).clamp(0.0, MOST);
    }
    let table = table();
    let (below, rest) = place(roughness);
    let entry = mixed(table.means[below], table.means[below + 1], rest);
    (of_schlick(entry, f0, f90) + MARGIN * f90.max(f0)).clamp(0.0, MOST)
}
