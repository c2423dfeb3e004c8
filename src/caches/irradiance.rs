//! The irradiance cache: records, their radii, and the interpolation between them.

use super::hemisphere::Irradiance;
use super::neighbours::Neighbours;
use super::octree::Octree;
use crate::math::Rgb;
use crate::media::MediumStack;
use glam::{Mat3, Vec3};

/// Ratio of the radius of a record when a picture is read from the cache to its radius when the cache is filled. With
/// overlap, places have several records around them and no record ends with a step. At twice the radius a place has
/// four times as many records, whose noise is averaged. At larger ratios the loss of detail exceeds the gain in noise
/// (docs/results.md).
const OVERLAP: f32 = 2.0;

/// The least ratio, where other surfaces limit the radius of a record.
const LEAST_OVERLAP: f32 = 1.4;

/// Least radius of a record in pixels, and as a share of the scene's radius; the smaller of the two counts. Near other
/// surfaces half of that is enough.
const LEAST_REACH: (f32, f32) = (2.0, 0.02);

/// Largest radius of a record, in the same units.
const LARGEST_REACH: (f32, f32) = (20.0, 0.2);

/// Height above or below the plane of a record from which on a place counts as another surface, as a share of the
/// record's radius while the cache is filled.
const LARGEST_STEP: f32 = 0.14;

/// Settings of a cache.
#[derive(Clone, Copy, Debug)]
pub struct CacheSettings {
    /// Largest error of an interpolation after Ward, Rubinstein & Clear 1988, their `a`: distance over harmonic mean
    /// distance, plus `sqrt(1 - cos)` of the angle between the normals.
    pub error: f32,
    /// Centre and radius of the scene.
    pub bounds: (Vec3, f32),
}

/// A place where irradiance may be needed.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// Where.
    pub position: Vec3,
    /// Unit shading normal, on the side that is lit.
    pub normal: Vec3,
    /// Medium stack at the place.
    pub medium: MediumStack,
    /// Side of a pixel projected to the place.
    pub footprint: f32,
}

/// Irradiance at a place.
#[derive(Clone, Copy, Debug)]
pub struct Record {
    /// Where.
    pub place: Place,
    /// The irradiance; its gradients are in the space of the position.
    pub irradiance: Irradiance,
}

/// The domain of a record: what decides whether it is used at a place.
#[derive(Clone, Copy, Debug)]
struct Reach {
    position: Vec3,
    radius: f32,
    /// Distance of the nearest surface that the record or its neighbours saw: up to this distance nothing is between
    /// the record and a place.
    open: f32,
    normal: Vec3,
    medium: MediumStack,
}

/// Search structure for the records that cover a place.
#[derive(Clone, Debug)]
struct Reaches {
    settings: CacheSettings,
    /// Factor on the radius that the error allows: [`OVERLAP`] where the cache is read, one where it is filled.
    overlap: f32,
    tree: Octree,
    all: Vec<Reach>,
}

impl Reaches {
    fn new(settings: CacheSettings, overlap: f32) -> Self {
        let (centre, radius) = settings.bounds;
        // Larger than the scene by a margin for the rounding of hits on its boundary.
        Self { settings, overlap, tree: Octree::new(centre, radius * 1.01), all: Vec::new() }
    }

    fn push(&mut self, place: &Place, radius: f32, open: f32) {
        let Place { position, normal, medium, .. } = *place;
        let index = self.all.len() as u32;
        self.all.push(Reach { position, radius, open, normal, medium });
        let all = &self.all;
        let sphere_of = |i: u32| (all[i as usize].position, all[i as usize].radius);
        self.tree.insert(index, (position, radius), sphere_of);
    }

    /// Whether any record covers a place.
    fn covers(&self, position: Vec3, normal: Vec3, medium: MediumStack) -> bool {
        self.tree
            .at(position)
            .iter()
            .any(|&index| self.relative_error(&self.all[index as usize], position, normal, medium).is_some())
    }

    /// Error of the record at a place in units of the largest allowed error; `None` where it exceeds one, or the record
    /// belongs to another surface.
    #[inline]
    fn relative_error(
        &self,
        reach: &Reach,
        position: Vec3,
        normal: Vec3,
        medium: MediumStack,
    ) -> Option<f32> {
        let offset = position - reach.position;
        let distance_squared = offset.length_squared();
        if !(distance_squared < reach.radius * reach.radius) || medium != reach.medium {
            return None;
        }
        let turned = (1.0 - normal.dot(reach.normal)).max(0.0);
        let error =
            distance_squared.sqrt() / reach.radius + turned.sqrt() / (self.overlap * self.settings.error);
        if error >= 1.0 {
            return None;
        }
        // Tests whether the place is in front of the record or behind it, as on the next step of a stair. Along a
        // curved surface the mean normal is at right angles to the offset.
        let step = 0.5 * offset.dot(normal + reach.normal);
        (step.abs() * self.overlap <= LARGEST_STEP * reach.radius).then_some(error)
    }

    /// Radius of a record: as large as the error allows, within limits that depend on the pixel size. It is no larger
    /// than the distance of the nearest surface the record saw, behind which the record is not valid, or about a pixel
    /// if that is larger; while the cache is filled, this limit is divided by [`LEAST_OVERLAP`].
    fn radius(&self, place: &Place, harmonic: f32, nearest: f32) -> f32 {
        let limit =
            |(pixels, share): (f32, f32)| (pixels * place.footprint).min(share * self.settings.bounds.1);
        let low = limit(LEAST_REACH);
        let allowed = (self.settings.error * harmonic).clamp(low, limit(LARGEST_REACH).max(low));
        let open = nearest.max(0.5 * low) * (self.overlap / LEAST_OVERLAP).min(1.0);
        (self.overlap * allowed).min(open)
    }
}

/// The values that are interpolated.
#[derive(Clone, Copy, Debug)]
struct Linear {
    value: Rgb,
    shift: Mat3,
    tilt: Mat3,
}

/// Irradiance on Lambertian surfaces for interpolation. Immutable; made by [`Filling`].
#[derive(Clone, Debug)]
pub struct IrradianceCache {
    reaches: Reaches,
    linears: Vec<Linear>,
}

impl IrradianceCache {
    fn new(settings: CacheSettings) -> Self {
        Self { reaches: Reaches::new(settings, OVERLAP), linears: Vec::new() }
    }

    /// Number of records.
    pub fn len(&self) -> usize {
        self.linears.len()
    }

    /// True where there is no record.
    pub fn is_empty(&self) -> bool {
        self.linears.is_empty()
    }

    /// Position and radius of each record, in the order in which they were accepted.
    pub fn reaches(&self) -> impl ExactSizeIterator<Item = (Vec3, f32)> {
        self.reaches.all.iter().map(|reach| (reach.position, reach.radius))
    }

    /// Irradiance in W m^-2, cosine included, at a place with this unit shading normal in this medium stack; `None`
    /// where no record covers it.
    ///
    /// Each record is extrapolated to the place by its gradients. Its weight falls with the error, down to zero at its
    /// radius (a tent over the error of Ward, Rubinstein & Clear 1988; their inverse of the error would favour the
    /// nearest record and its noise). The result is never negative. Records that agree give their value to the bit.
    ///
    /// A record that is farther away than the nearest surface it saw, as one may be next to a wall, takes part only
    /// where `connects` finds a free way to it (position, normal).
    #[inline]
    pub fn interpolate(
        &self,
        position: Vec3,
        normal: Vec3,
        medium: MediumStack,
        connects: impl Fn(Vec3, Vec3) -> bool,
    ) -> Option<Rgb> {
        let mut first: Option<Rgb> = None;
        let (mut sum, mut weights) = (Rgb::ZERO, 0.0);
        for &index in self.reaches.tree.at(position) {
            let reach = &self.reaches.all[index as usize];
            let Some(error) = self.reaches.relative_error(reach, position, normal, medium) else { continue };
            let is_open = reach.radius <= reach.open || reach.position.distance(position) <= reach.open;
            if !is_open && !connects(reach.position, reach.normal) {
                continue;
            }
            let weight = 1.0 - error;
            let linear = &self.linears[index as usize];
            let value = linear.value
                + linear.shift * (position - reach.position)
                + linear.tilt * (normal - reach.normal);
            let first = *first.get_or_insert(value);
            sum += weight * (value - first);
            weights += weight;
        }
        first.map(|first| (first + sum / weights).max(Rgb::ZERO))
    }

    fn push(&mut self, record: &Record, radius: f32, (harmonic, nearest): (f32, f32)) {
        let Irradiance { value, shift, tilt, .. } = record.irradiance;
        // Where the least radius replaces the radius that the distances allow, the gradient is not valid up to the
        // radius.
        let tame = (OVERLAP * self.reaches.settings.error * harmonic / radius).min(1.0);
        let tame = if tame.is_finite() { tame } else { 1.0 };
        // Nor is a gradient that would make the irradiance negative within the radius.
        let steepest = steepest(&shift);
        let limit = |channel: usize| {
            let change = steepest[channel] * tame * radius;
            if change > value[channel] { tame * (value[channel] / change).max(0.0) } else { tame }
        };
        let limits = Vec3::new(limit(0), limit(1), limit(2));
        let shift = Mat3::from_cols(shift.x_axis * limits, shift.y_axis * limits, shift.z_axis * limits);
        self.reaches.push(&record.place, radius, nearest);
        self.linears.push(Linear { value, shift, tilt });
    }
}

/// Length of the gradient of each channel.
fn steepest(gradient: &Mat3) -> Vec3 {
    let square = |v: Vec3| v * v;
    let sum = square(gradient.x_axis) + square(gradient.y_axis) + square(gradient.z_axis);
    Vec3::new(sum.x.sqrt(), sum.y.sqrt(), sum.z.sqrt())
}

/// A cache that is being filled.
#[derive(Clone, Debug)]
pub struct Filling {
    records: Vec<Record>,
    harmonic: Neighbours,
    nearest: Neighbours,
    reaches: Reaches,
    rejected: u64,
}

impl Filling {
    /// An empty cache.
    pub fn new(settings: CacheSettings) -> Self {
        Self {
            records: Vec::new(),
            harmonic: Neighbours::default(),
            nearest: Neighbours::default(),
            reaches: Reaches::new(settings, 1.0),
            rejected: 0,
        }
    }

    /// Whether a record is needed at a place: no accepted one covers it.
    pub fn wants(&self, place: &Place) -> bool {
        !self.reaches.covers(place.position, place.normal, place.medium)
    }

    /// Numbers of those of `places` that are to be computed. They are chosen one by one in order: a place is chosen if
    /// neither an accepted record covers it, nor one of the places chosen before, whose radius is predicted from its
    /// neighbours.
    pub fn choose(&self, places: &[Place]) -> Vec<usize> {
        let mut reaches = self.reaches.clone();
        let mut chosen = Vec::new();
        for (number, place) in places.iter().enumerate() {
            if place.position.is_finite() && !reaches.covers(place.position, place.normal, place.medium) {
                let harmonic = self.harmonic.least(place.position);
                let nearest = self.nearest.least(place.position);
                reaches.push(place, reaches.radius(place, harmonic, nearest), nearest);
                chosen.push(number);
            }
        }
        chosen
    }

    /// Inserts a batch of records in order, and reduces all radii to what the neighbours allow.
    pub fn accept(&mut self, batch: impl IntoIterator<Item = Record>) {
        let before = self.records.len();
        let mut all = 0;
        let sound =
            |record: &Record| record.place.position.is_finite() && record.irradiance.value.is_finite();
        self.records.extend(batch.into_iter().inspect(|_| all += 1).filter(sound));
        self.rejected += all - (self.records.len() - before) as u64;
        let measured = |length: fn(&Irradiance) -> f32| {
            let of = |record: &Record| (record.place.position, length(&record.irradiance));
            Neighbours::new(self.records.iter().map(of).collect())
        };
        self.harmonic = measured(|irradiance| irradiance.harmonic);
        self.nearest = measured(|irradiance| irradiance.nearest);
        let (harmonic, nearest) = (self.harmonic.clamped(), self.nearest.clamped());
        let mut reaches = Reaches::new(self.reaches.settings, 1.0);
        for (i, record) in self.records.iter().enumerate() {
            let radius = reaches.radius(&record.place, harmonic[i], nearest[i]);
            reaches.push(&record.place, radius, nearest[i]);
        }
        self.reaches = reaches;
    }

    /// Number of records that were rejected because they were not finite.
    pub fn rejected(&self) -> u64 {
        self.rejected
    }

    /// The cache of the records so far.
    pub fn finish(self) -> IrradianceCache {
        let (harmonic, nearest) = (self.harmonic.clamped(), self.nearest.clamped());
        let mut cache = IrradianceCache::new(self.reaches.settings);
        for (i, record) in self.records.iter().enumerate() {
            let radius = cache.reaches.radius(&record.place, harmonic[i], nearest[i]);
            cache.push(record, radius, (harmonic[i], nearest[i]));
        }
        cache
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{Rng, Stream};

    const IN_AIR: MediumStack = MediumStack::AIR;

    const SETTINGS: CacheSettings = CacheSettings { error: 0.2, bounds: (Vec3::ZERO, 1.0) };

    fn place(position: Vec3) -> Place {
        Place { position, normal: Vec3::Z, medium: IN_AIR, footprint: 0.01 }
    }

    fn record(position: Vec3, value: Rgb) -> Record {
        let irradiance =
            Irradiance { value, shift: Mat3::ZERO, tilt: Mat3::ZERO, harmonic: 0.5, nearest: f32::INFINITY };
        Record { place: place(position), irradiance }
    }

    /// Places on the square `[-0.5, 0.5]^2` of the plane z = 0.
    fn places(count: u64, seed: u64) -> impl Iterator<Item = Vec3> {
        (0..count).map(move |i| (Rng::new(seed, Stream::Measure, i).next_2d() - 0.5).extend(0.0))
    }

    fn filled(records: impl Iterator<Item = Record>) -> IrradianceCache {
        let mut filling = Filling::new(SETTINGS);
        let records: Vec<Record> = records.collect();
        // In batches, as radii are predicted from earlier records.
        for batch in records.chunks(50) {
            let places: Vec<Place> = batch.iter().map(|record| record.place).collect();
            filling
                .accept(filling.choose(&places).into_iter().map(|number| batch[number]).collect::<Vec<_>>());
        }
        filling.finish()
    }

    #[test]
    fn equal_records_give_their_value_to_the_bit() {
        let value = Rgb::new(0.1, 2.7, 1e-5);
        let cache = filled(places(2000, 1).map(|p| record(p, value)));
        assert!((20..500).contains(&cache.len()), "{}", cache.len());
        for p in places(1000, 2) {
            assert_eq!(cache.interpolate(p, Vec3::Z, IN_AIR, |_, _| true), Some(value));
        }
    }

    #[test]
    fn linear_fields_are_interpolated_exactly() {
        let slopes = [Vec3::new(0.5, -0.2, 0.1), Vec3::new(-0.3, 0.4, 0.2)];
        let field = |p: Vec3| Rgb::ONE + slopes[0] * p.x + slopes[1] * p.y;
        let shift = Mat3::from_cols(slopes[0], slopes[1], Vec3::ZERO);
        let with_gradient = |p: Vec3| {
            let mut record = record(p, field(p));
            record.irradiance.shift = shift;
            record
        };
        let cache = filled(places(3000, 1).map(with_gradient));
        let flat = filled(places(3000, 1).map(|p| record(p, field(p))));
        let mut worst = (0.0f32, 0.0f32);
        for p in places(1000, 2).filter(|p| p.abs().max_element() < 0.45) {
            let off = |cache: &IrradianceCache| {
                (cache.interpolate(p, Vec3::Z, IN_AIR, |_, _| true).unwrap() - field(p)).abs().max_element()
            };
            worst = (worst.0.max(off(&cache)), worst.1.max(off(&flat)));
        }
        println!("largest error {worst:?} of {} records", cache.len());
        assert!(worst.0 < 2e-6 && worst.1 > 1e-3, "{worst:?}");
        // Irradiances that follow the normal are exact as well.
        let mut turned = record(Vec3::ZERO, Rgb::ONE);
        turned.irradiance.tilt = Mat3::from_cols(slopes[0], slopes[1], Vec3::ZERO);
        let cache = filled(std::iter::once(turned));
        let normal = Vec3::new(0.1, 0.05, (1.0f32 - 0.0125).sqrt());
        let want = Rgb::ONE + 0.1 * slopes[0] + 0.05 * slopes[1];
        assert!(
            (cache.interpolate(Vec3::ZERO, normal, IN_AIR, |_, _| true).unwrap() - want).abs().max_element()
                < 1e-6
        );
    }

    #[test]
    fn other_surfaces_are_not_reached() {
        let cache = filled(std::iter::once(record(Vec3::ZERO, Rgb::ONE)));
        let reach = cache.reaches().next().unwrap().1;
        assert!((reach - 2.0 * 0.1).abs() < 1e-6);
        let near = Vec3::new(0.02, 0.0, 0.0);
        assert!(cache.interpolate(near, Vec3::Z, IN_AIR, |_, _| true).is_some());
        assert!(cache.interpolate(near, Vec3::NEG_Z, IN_AIR, |_, _| true).is_none());
        assert!(cache.interpolate(near, Vec3::X, IN_AIR, |_, _| true).is_none());
        assert!(cache.interpolate(near, Vec3::Z, MediumStack::of(1), |_, _| true).is_none());
        assert!(
            cache.interpolate(near + 0.05 * Vec3::Z, Vec3::Z, IN_AIR, |_, _| true).is_none(),
            "a step above"
        );
        assert!(
            cache.interpolate(near - 0.05 * Vec3::Z, Vec3::Z, IN_AIR, |_, _| true).is_none(),
            "a step below"
        );
        assert!(cache.interpolate(Vec3::X * 0.2, Vec3::Z, IN_AIR, |_, _| true).is_none());
        assert!(cache.interpolate(Vec3::NAN, Vec3::Z, IN_AIR, |_, _| true).is_none());
    }

    #[test]
    fn nothing_is_carried_past_what_was_seen() {
        let wall = |nearest: f32, at: Vec3| {
            let mut record = record(at, Rgb::ONE);
            record.irradiance.nearest = nearest;
            record
        };
        let cache = filled(std::iter::once(wall(0.03, Vec3::ZERO)));
        assert!(cache.interpolate(Vec3::X * 0.029, Vec3::Z, IN_AIR, |_, _| true).is_some());
        assert!(cache.interpolate(Vec3::X * 0.031, Vec3::Z, IN_AIR, |_, _| true).is_none());
        // Next to a wall records have half of the least radius, where there is a free way.
        let cache = filled(std::iter::once(wall(0.001, Vec3::ZERO)));
        for (x, needs_way) in [(0.0009, false), (0.0011, true), (0.0099, true)] {
            assert!(cache.interpolate(Vec3::X * x, Vec3::Z, IN_AIR, |_, _| true).is_some());
            assert_eq!(cache.interpolate(Vec3::X * x, Vec3::Z, IN_AIR, |_, _| false).is_none(), needs_way);
        }
        // A neighbour that missed the wall gets its distance from the record that saw it.
        let mut filling = Filling::new(SETTINGS);
        filling.accept([wall(0.03, Vec3::ZERO), wall(f32::INFINITY, Vec3::Y * 0.06)]);
        let cache = filling.finish();
        let reaches: Vec<f32> = cache.reaches().map(|(_, radius)| radius).collect();
        assert_eq!(cache.len(), 2);
        assert!((reaches[1] - 0.09).abs() < 1e-6, "{reaches:?}");
    }

    #[test]
    fn steep_gradients_do_not_turn_light_negative() {
        let mut steep = record(Vec3::ZERO, Rgb::new(1.0, 0.0, 1.0));
        steep.irradiance.shift = Mat3::from_cols(Vec3::new(1e6, 1e6, 0.0), Vec3::ZERO, Vec3::ZERO);
        let cache = filled(std::iter::once(steep));
        for x in [-0.13, -0.05, 0.05, 0.13] {
            let value = cache.interpolate(Vec3::X * x, Vec3::Z, IN_AIR, |_, _| true).unwrap();
            assert!((0.0..=2.0).contains(&value.x) && value.y == 0.0 && value.z == 1.0, "{value}");
        }
    }

    #[test]
    fn batches_fill_what_is_missing_and_nothing_else() {
        let mut filling = Filling::new(SETTINGS);
        let all: Vec<Place> = places(400, 1).map(place).collect();
        assert!(all.iter().all(|place| filling.wants(place)));
        // The radii of the first records cannot be predicted, so the first batch is small; later batches fill the gaps
        // that predictions of too large radii left.
        let mut batches = 0;
        loop {
            let chunk = if batches == 0 { &all[..10] } else { &all[..] };
            let chosen = filling.choose(chunk);
            assert!(chosen.is_sorted());
            if batches > 0 && chosen.is_empty() {
                break;
            }
            batches += 1;
            assert!(batches < 10, "{} still wanted", chosen.len());
            filling.accept(chosen.iter().map(|&n| record(chunk[n].position, Rgb::ONE)).collect::<Vec<_>>());
        }
        assert!(!all.iter().any(|place| filling.wants(place)));
        assert!(filling.records.len() < 200, "{}", filling.records.len());
        let before = filling.records.len();
        filling.accept([record(Vec3::new(f32::NAN, 0.0, 0.0), Rgb::ONE), record(Vec3::ZERO, Rgb::NAN)]);
        assert!(filling.records.len() == before && filling.rejected() == 2);
    }
}
