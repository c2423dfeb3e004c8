//! Constructive solid geometry.

use super::roots::accept;
use super::solid::{MOST_CROSSINGS, Solid};
use super::{Chart, ShapeError, nearest_by_refining};
use crate::embree::{NearEdge, ObjectHit, Procedural, SurfacePoint};
use crate::math::{Bounds3, Ray};
use arrayvec::ArrayVec;
use glam::{DAffine3, DVec3};

/// Constructive solid geometry: unions, intersections and differences of up to [`Csg::MOST_SOLIDS`] bodies. A single body is valid too.
///
/// All crossings of a ray with all bodies are sorted; the surface is where the result of the operations changes. Normals point out of the
/// whole object, so normals of a subtracted body are flipped. Each body is a part of the object and may have its own material.
#[derive(Clone, Debug, PartialEq)]
pub struct Csg {
    solids: Vec<Solid>,
    /// Bounding sphere of each body: centre and squared radius.
    around: Vec<(DVec3, f64)>,
    /// The operations in postfix order.
    program: Vec<Step>,
    bounds: Bounds3,
}

/// Operation that combines two bodies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CsgOperation {
    /// Inside of either.
    Union,
    /// Inside of both.
    Intersection,
    /// Inside of the first and not of the second.
    Difference,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Step {
    Solid(u8),
    Combine(CsgOperation),
}

/// Crossing of a ray with one body.
#[derive(Clone, Copy, Debug)]
struct Crossing {
    t: f64,
    solid: u8,
    face: u8,
}

/// Crossing of a ray with the surface of the whole object.
#[derive(Clone, Copy, Debug)]
struct Boundary {
    crossing: Crossing,
    /// Whether the normal of the whole object is opposite to that of the body.
    flip: bool,
}

/// Most crossings with all bodies, which fit into one array on the stack.
const MOST: usize = Csg::MOST_SOLIDS * MOST_CROSSINGS;

impl Csg {
    /// Most bodies of one object.
    pub const MOST_SOLIDS: usize = 64;

    /// An object of one body.
    pub fn of(solid: Solid) -> Self {
        let bounds = solid.bounds();
        let (center, radius) = solid.around();
        Self {
            solids: vec![solid],
            around: vec![(center, radius * radius)],
            program: vec![Step::Solid(0)],
            bounds,
        }
    }

    /// This object combined with another, whose parts are numbered after those of this one.
    ///
    /// # Errors
    /// If both together have more than [`Self::MOST_SOLIDS`] bodies.
    pub fn combined(mut self, operation: CsgOperation, other: &Self) -> Result<Self, ShapeError> {
        let count = self.solids.len();
        if count + other.solids.len() > Self::MOST_SOLIDS {
            return Err(ShapeError::TooManySolids);
        }
        self.bounds = match operation {
            CsgOperation::Union => self.bounds.union(other.bounds),
            CsgOperation::Intersection => Bounds3 {
                min: self.bounds.min.max(other.bounds.min),
                max: self.bounds.max.min(other.bounds.max),
            },
            CsgOperation::Difference => self.bounds,
        };
        self.solids.extend(&other.solids);
        self.around.extend(&other.around);
        self.program.extend(other.program.iter().map(|step| match *step {
            Step::Solid(index) => Step::Solid(index + count as u8),
            combine => combine,
        }));
        self.program.push(Step::Combine(operation));
        Ok(self)
    }

    /// Number of bodies.
    pub fn parts(&self) -> usize {
        self.solids.len()
    }

    /// The transformed object. The transform must be invertible.
    pub fn transformed(&self, transform: &DAffine3) -> Result<Self, ShapeError> {
        let mut whole: Vec<Self> = Vec::new();
        for step in &self.program {
            match *step {
                Step::Solid(index) => {
                    whole.push(Self::of(self.solids[usize::from(index)].transformed(transform)?));
                }
                Step::Combine(operation) => {
                    let second = whole.pop().ok_or(ShapeError::NoArea)?;
                    let first = whole.pop().ok_or(ShapeError::NoArea)?;
                    whole.push(first.combined(operation, &second)?);
                }
            }
        }
        whole.pop().ok_or(ShapeError::NoArea)
    }

    /// Charts of the faces of a single box; `None` for other objects.
    pub fn charts(&self) -> Option<Vec<Chart>> {
        match &*self.solids {
            [solid] => solid.charts(),
            _ => None,
        }
    }

    /// A bounding box of the whole object; empty where an intersection is empty.
    pub fn bounds(&self) -> Bounds3 {
        self.bounds
    }

    /// A bounding sphere of the whole object.
    pub fn around(&self) -> (DVec3, f64) {
        let of_box = (self.bounds.center(), self.bounds.radius());
        match self.solids.as_slice() {
            [solid] if solid.around().1 < of_box.1 => solid.around(),
            _ => of_box,
        }
    }

    /// Whether a point is inside the object, where bit `i` of `inside` tells whether it is inside body `i`.
    fn is_inside(&self, inside: u64) -> bool {
        // A stack of bits whose top is the lowest bit.
        let mut stack = 0u64;
        for step in &self.program {
            match *step {
                Step::Solid(index) => stack = stack << 1 | (inside >> index & 1),
                Step::Combine(operation) => {
                    let second = stack & 1;
                    stack >>= 1;
                    match operation {
                        CsgOperation::Union => stack |= second,
                        CsgOperation::Intersection => stack &= !1 | second,
                        CsgOperation::Difference => stack &= !second,
                    }
                }
            }
        }
        stack & 1 == 1
    }

    /// The face of any body that is nearest to the point at `t`.
    fn nearest_face(&self, ray: &Ray, t: f64) -> Crossing {
        let point = ray.origin.as_dvec3() + t * ray.direction.as_dvec3();
        let all = self.solids.iter().enumerate().flat_map(|(index, solid)| {
            let solids = index as u8;
            (0..solid.faces()).map(move |face| Crossing { t, solid: solids, face })
        });
        let distance = |crossing: &Crossing| {
            let solid = &self.solids[usize::from(crossing.solid)];
            (solid.refine(ray, t, crossing.face).position - point).length_squared()
        };
        all.min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(Crossing { t, solid: 0, face: 0 })
    }

    /// The edge with the nearest other face, even where the operations remove that face.
    fn edge_near(&self, point: DVec3, at: &Crossing) -> Option<NearEdge> {
        let faces = self.solids.iter().enumerate().filter_map(|(index, solid)| {
            let own = (index == usize::from(at.solid)).then_some(at.face);
            Some((solid.nearest_face(point, own)?, solid.least_extent()))
        });
        let ((distance, there, normal), extent) = faces.min_by(|a, b| a.0.0.total_cmp(&b.0.0))?;
        let extent = extent.min(self.solids[usize::from(at.solid)].least_extent());
        Some(NearEdge { distance, extent, other: (there, normal) })
    }

    /// Calls `visit` for each boundary of the whole object along the line, in order, until it returns false.
    fn visit(&self, ray: &Ray, mut visit: impl FnMut(Boundary) -> bool) {
        if let [solid] = self.solids.as_slice() {
            for (t, face) in solid.crossings(ray) {
                if !visit(Boundary { crossing: Crossing { t, solid: 0, face }, flip: false }) {
                    return;
                }
            }
            return;
        }
        let mut crossings: ArrayVec<Crossing, MOST> = ArrayVec::new();
        let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let squared = direction.length_squared();
        for (index, (center, radius_squared)) in self.around.iter().enumerate() {
            if (center - origin).cross(direction).length_squared() > radius_squared * squared {
                continue;
            }
            let solid = index as u8;
            let found = self.solids[index].crossings(ray);
            crossings.extend(found.into_iter().map(|(t, face)| Crossing { t, solid, face }));
        }
        crossings.sort_unstable_by(|a, b| a.t.total_cmp(&b.t).then(a.solid.cmp(&b.solid)));
        // Coplanar faces are crossed at once, whichever rounding puts first, as a body without thickness does not count.
        let size = (self.bounds.center() - origin).length() + self.bounds.radius();
        let same = 8.0 * f64::EPSILON * size / squared.sqrt();
        let (mut inside, mut was_inside) = (0u64, false);
        let mut rest = crossings.as_slice();
        while let Some(first) = rest.first() {
            let count = rest.iter().take_while(|crossing| crossing.t - first.t <= same).count();
            let (together, after) = rest.split_at(count.max(1));
            rest = after;
            let mut last = None;
            let mut now = was_inside;
            for &crossing in together {
                let bit = 1u64 << crossing.solid;
                inside ^= bit;
                let next = self.is_inside(inside);
                if next != now {
                    last = Some(Boundary { crossing, flip: (inside & bit != 0) != next });
                }
                now = next;
            }
            if now != was_inside {
                was_inside = now;
                if let Some(boundary) = last
                    && !visit(boundary)
                {
                    return;
                }
            }
        }
    }
}

impl Procedural for Csg {
    fn bounds(&self, _primitive: u32) -> Bounds3 {
        self.bounds
    }

    fn may_be_in(&self, _primitive: u32, region: &Bounds3) -> bool {
        self.solids.iter().any(|solid| solid.may_be_in(region))
    }

    fn nearest(&self, primitive: u32, ray: &Ray) -> Option<ObjectHit> {
        nearest_by_refining(self, primitive, ray)
    }

    fn intersect(&self, _primitive: u32, ray: &Ray) -> Option<f32> {
        let mut nearest = None;
        self.visit(ray, |boundary| {
            nearest = accept(boundary.crossing.t, ray.t_max);
            // The search continues only past crossings behind the origin.
            boundary.crossing.t as f32 <= 0.0
        });
        nearest
    }

    fn intersect_all(&self, _primitive: u32, ray: &Ray, hits: &mut Vec<f32>) {
        self.visit(ray, |boundary| {
            hits.extend(accept(boundary.crossing.t, ray.t_max));
            true
        });
    }

    fn refine(&self, _primitive: u32, ray: &Ray, t: f32) -> SurfacePoint {
        let mut best: Option<Boundary> = None;
        let distance = |crossing: &Crossing| (crossing.t - f64::from(t)).abs();
        self.visit(ray, |boundary| {
            if best.is_none_or(|best| distance(&boundary.crossing) < distance(&best.crossing)) {
                best = Some(boundary);
            }
            true
        });
        // Rounding in an instance may lose a grazing hit: then the nearest face of any body is used.
        let Boundary { crossing, flip } =
            best.unwrap_or_else(|| Boundary { crossing: self.nearest_face(ray, f64::from(t)), flip: false });
        let mut point = self.solids[usize::from(crossing.solid)].refine(ray, crossing.t, crossing.face);
        if flip {
            point.normal = -point.normal;
            point.shading_normal = -point.shading_normal;
        }
        point.part = u32::from(crossing.solid);
        point.edge = self.edge_near(point.position, &crossing);
        point
    }
}
