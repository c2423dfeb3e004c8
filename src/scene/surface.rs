//! Points on surfaces, with error bounds that make tuning of ray offsets unnecessary.

use super::contact::Borders;
use super::layered::Painted;
use super::material::Material;
use super::shading::Shading;
use super::texture::tinted;
use crate::bsdf::{Bsdf, Dielectric};
use crate::embree::{NearEdge, SurfacePoint};
use crate::math::rounding::UNIT_ROUNDOFF;
use crate::math::{Frame, Ray, Rgb, unit, unit_f64};
use glam::{DAffine3, DMat3, DVec3, Vec2, Vec3, Vec3A, Vec3Swizzles};

/// Geometry of a hit before its material is known: a point, a normal, and the distance that a ray must start from the point to be on a
/// known side of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HitPoint {
    /// Position, rounded to `f32`.
    pub position: Vec3,
    /// Unit normal of the geometry on its outer side: by winding for triangles, outward for closed shapes.
    pub normal: Vec3,
    /// Distance along the normal within which the side of the surface is uncertain, because of the rounding of this point and of the
    /// intersection test of a ray that starts here.
    pub offset: f32,
    /// Surface parameters; barycentric for triangles.
    pub uv: Vec2,
}

/// Largest retreat of ray origins next to an edge, as a share of the size of the geometry there.
const RETREAT: f64 = 1.0 / 16.0;

/// Safety factor on the first-order bounds below, for the neglected second-order terms.
const SAFETY: f32 = 2.0;

impl HitPoint {
    /// The point of a triangle with these barycentric coordinates of the second and third corner. `None` for a triangle without area.
    #[inline(always)]
    pub fn on_triangle(corners: [[f32; 3]; 3], uv: [f32; 2]) -> Option<Self> {
        let Some(point) = TrianglePoint::new(corners, uv) else {
            return Self::on_tiny_triangle(corners, uv);
        };
        Some(Self {
            position: point.position.into(),
            normal: point.normal.into(),
            offset: point.offset(),
            uv: Vec2::from_array(uv),
        })
    }

    /// The point of a triangle that `ray`, of unit direction, met at its parameter `t`, see [`TrianglePoint::closer`]; and how far back
    /// along that ray further rays are to start, see [`TrianglePoint::retreat`].
    #[inline(always)]
    pub(super) fn on_triangle_along(
        corners: [[f32; 3]; 3],
        uv: [f32; 2],
        ray: &Ray,
        t: f32,
    ) -> Option<(Self, f32)> {
        let Some(point) = TrianglePoint::new(corners, uv) else {
            return Some((Self::on_tiny_triangle(corners, uv)?, 0.0));
        };
        let point = point.closer(ray, t);
        let offset = point.offset();
        let on_triangle = Self {
            position: point.position.into(),
            normal: point.normal.into(),
            offset,
            uv: Vec2::from_array(uv),
        };
        let retreat = if point.is_at_edge(uv, ray, offset) { point.retreat(t) } else { 0.0 };
        Some((on_triangle, retreat))
    }

    /// [`Self::on_triangle`] for triangles whose area exceeds the range of `f32`.
    #[cold]
    fn on_tiny_triangle(corners: [[f32; 3]; 3], uv: [f32; 2]) -> Option<Self> {
        let [v0, v1, v2] = corners.map(|v| Vec3::from_array(v).as_dvec3());
        let (e1, e2) = (v1 - v0, v2 - v0);
        let normal = unit_f64(e1.cross(e2))?.as_vec3();
        let position = (v0 + e1 * f64::from(uv[0]) + e2 * f64::from(uv[1])).as_vec3();
        // Uses the whole extent instead of its share along the normal, because Embree's result for such a triangle is not predictable.
        let extent = e1.abs().max(e2.abs()).as_vec3();
        let error = position.abs() * UNIT_ROUNDOFF + extent * 1e-3;
        Some(Self { position, normal, offset: SAFETY * error.dot(Vec3::ONE), uv: Vec2::from_array(uv) })
    }

    /// A point of a procedural object, which supplies its own error bound.
    #[inline]
    pub fn on_procedural(point: &SurfacePoint) -> Self {
        let position = point.position.as_vec3();
        let normal = point.normal.as_vec3();
        let error = point.error + position.abs() * UNIT_ROUNDOFF;
        Self { position, normal, offset: SAFETY * normal.abs().dot(error), uv: point.uv }
    }

    /// Parts of [`SurfaceInteraction::retreat`] next to an edge of a procedural object: the offset back along the ray, towards `wo` in
    /// render space, and the offset away from the other face. The ray `local` met this point at `t`. `None` away from edges.
    pub(super) fn retreat_from(
        &self,
        edge: &NearEdge,
        placement: Option<&Placement>,
        (local, t, wo): (&Ray, f32, Vec3),
    ) -> Option<(Vec3, Vec3)> {
        /// Room for errors of the other face, and for an overestimated [`NearEdge::distance`].
        const ROOM: f64 = 16.0;
        let stretch = f64::from(local.direction.length());
        let rounding = f64::from(4.0 * UNIT_ROUNDOFF * self.position.abs().max_element() + self.offset);
        let error = rounding + placement.map_or(0.0, |placement| placement.error_in_object(self.position));
        let cosine = f64::from(self.normal.dot(local.direction).abs()) / stretch;
        if edge.distance * cosine > ROOM * error {
            return None;
        }
        let (there, normal) = edge.other;
        let turned = |normal: Vec3, above: f32| if above < 0.0 { -normal } else { normal };
        let to_render =
            |normal: Vec3| placement.map_or(normal, |placement| placement.normal_to_world(normal));
        let own = to_render(turned(self.normal, -local.direction.dot(self.normal)));
        let above = (local.origin.as_dvec3() - there).dot(normal) as f32;
        let other = to_render(turned(normal.as_vec3(), above));
        let most = (RETREAT * edge.extent / stretch) as f32;
        let off = if normal == DVec3::ZERO {
            Vec3::ZERO
        } else {
            between([own, other], (error / stretch) as f32, most)
        };
        Some((wo * most.min(0.5 * t), off))
    }

    /// The same point seen through an instance. Adds the error of Embree's transformation of the ray.
    pub fn transformed(&self, placement: &Placement) -> Self {
        let local = self.position.as_dvec3();
        let world = placement.to_world.transform_point3(local);
        let normal = placement.normal_matrix * self.normal.as_dvec3();
        let length = normal.length();
        let unit = normal / length;
        let magnitude = placement.magnitude * local.abs() + placement.to_world.translation.abs();
        let moved = f64::from(UNIT_ROUNDOFF * SAFETY) * 4.0 * unit.abs().dot(magnitude + world.abs());
        Self {
            position: world.as_vec3(),
            normal: unit.as_vec3(),
            // A height above the object's surface is divided by this factor in world space.
            offset: (f64::from(self.offset) / length + moved) as f32,
            uv: self.uv,
        }
    }

    /// The point moved off the surface, to the side that `direction` points to.
    #[inline]
    pub fn moved_towards(&self, direction: Vec3) -> Vec3 {
        self.position + self.normal * self.offset.copysign(direction.dot(self.normal))
    }
}

/// A point of a triangle in registers, with the data of its error bound, which only rays that start there need.
#[derive(Clone, Copy, Debug)]
pub(super) struct TrianglePoint {
    corners: [Vec3A; 3],
    edges: [Vec3A; 2],
    /// As in [`HitPoint`].
    pub(super) position: Vec3A,
    /// As in [`HitPoint`].
    pub(super) normal: Vec3A,
    /// Inverse length of the cross product of the edges.
    inverse_length: f32,
}

impl TrianglePoint {
    /// `None` outside the range in which neither the cross product of the edges nor its square loses digits.
    #[inline(always)]
    pub(super) fn new([v0, v1, v2]: [[f32; 3]; 3], uv: [f32; 2]) -> Option<Self> {
        let (v0, v1, v2) = (Vec3A::from_array(v0), Vec3A::from_array(v1), Vec3A::from_array(v2));
        let (e1, e2) = (v1 - v0, v2 - v0);
        let n = e1.cross(e2);
        let length_squared = n.length_squared();
        if !(1e-28..1e28).contains(&length_squared) {
            return None;
        }
        let inverse_length = 1.0 / length_squared.sqrt();
        let normal = n * inverse_length;
        let position = v0 + e1 * uv[0] + e2 * uv[1];
        Some(Self { corners: [v0, v1, v2], edges: [e1, e2], position, normal, inverse_length })
    }

    /// The same point, computed again along a ray of unit direction that met the triangle at `t`, where the distance is short compared
    /// with the triangle.
    ///
    /// Barycentric coordinates locate a point to within a roundoff of the *triangle*: a tenth of a millimetre on a plane of a kilometre,
    /// which would turn the caustic of a jewel into a lattice. The ray locates it to within a roundoff of the distance.
    #[inline(always)]
    pub(super) fn closer(self, ray: &Ray, t: f32) -> Self {
        /// Ratio of the edge length to the distance from which on the distance counts as short.
        const SHORT: f32 = 64.0;
        let [e1, e2] = self.edges;
        let way = SHORT * t;
        if e1.length_squared() + e2.length_squared() < way * way { self } else { self.along(ray) }
    }

    /// Intersection of the ray with the plane in `f64`; the unchanged point where that lies outside of the triangle.
    #[cold]
    fn along(self, ray: &Ray) -> Self {
        let [corner, e1, e2] = {
            let [v0, v1, v2] = self.corners.map(|v| Vec3::from(v).as_dvec3());
            [v0, v1 - v0, v2 - v0]
        };
        let (origin, direction) = (ray.origin.as_dvec3() - corner, ray.direction.as_dvec3());
        let normal = e1.cross(e2);
        let t = -normal.dot(origin) / normal.dot(direction);
        let from_corner = origin + direction * t;
        let area = normal.length_squared();
        let (u, v) = (from_corner.cross(e2).dot(normal) / area, e1.cross(from_corner).dot(normal) / area);
        // Embree, which reported the hit, is no more accurate than this. The test is also false for NaN.
        let edge = -8.0 * f64::from(UNIT_ROUNDOFF);
        if !(u >= edge && v >= edge && 1.0 - u - v >= edge) {
            return self;
        }
        // Not computed from the distance along the ray, whose roundoff points off the plane: on a plane through the origin, the error
        // bound would be zero, the next ray would not be moved, and it would hit the plane again.
        let position = corner + e1 * u + e2 * v;
        Self { position: position.as_vec3().into(), ..self }
    }

    /// Whether a ray of unit direction met the triangle so close to an edge that, by rounding, an origin off this triangle may lie
    /// beyond another triangle that rises from that edge at any angle.
    ///
    /// The origin differs from the true hit point by an error `e` at most: the error of the point itself in all directions, plus
    /// [`HitPoint::offset`]. Another triangle that rises at an angle `a` from an edge at the distance `d` passes the point at the
    /// distance `d sin(a)`. The ray came from between the two triangles, so that its cosine with the normal here is less than `sin(a)`,
    /// unless it started at the other triangle right here; then that origin was too close to the edge. The origin is therefore safe
    /// where `d` times that cosine exceeds `e`, and the other triangle need not be known.
    #[inline(always)]
    pub(super) fn is_at_edge(&self, uv: [f32; 2], ray: &Ray, offset: f32) -> bool {
        /// Room for the errors of both triangles and of the intersection tests of rays that start between them.
        const ROOM: f32 = 4.0;
        let [e1, e2] = self.edges;
        let edge = e1.abs().max(e2.abs());
        let error = UNIT_ROUNDOFF * SAFETY * (self.position.abs() + 7.0 * edge).max_element() + offset;
        // Multiplied by the largest edge length that the bounds of two edges allow: the distance from an edge is a barycentric
        // coordinate times twice the area over the length of that edge.
        let longest = 2.0 * f32::sqrt(3.0) * edge.max_element();
        let least = uv[0].min(uv[1]).min(1.0 - uv[0] - uv[1]);
        let cosine = self.normal.dot(Vec3A::from(ray.direction)).abs();
        !(least * cosine > ROOM * error * longest * self.inverse_length)
    }

    /// How far back, along the ray that met the triangle at `t`, the next ray starts if it stays on the same side, another surface rises
    /// there and [`Self::is_at_edge`] holds. No ray can find anything on that segment. The distance is large enough to separate the
    /// point from whatever rises from the edge, unless the ray came along that surface to within a millionth.
    #[cold]
    pub(super) fn retreat(&self, t: f32) -> f32 {
        let [e1, e2] = self.edges;
        let longest = e1.length_squared().max(e2.length_squared()).max((e2 - e1).length_squared()).sqrt();
        (RETREAT as f32 * longest).min(0.5 * t)
    }

    /// Computes [`HitPoint::offset`]. Bounds three errors, to first order in the unit roundoff `u`, component by component, so that an
    /// axis-aligned wall of any size has no error in its plane:
    ///
    /// - the position is computed in `f32`: `u |p|` for the result, `3 u` of each edge for the intermediate steps;
    /// - Embree first moves corners to the ray's origin: `u |v_k - p|` each, and a few roundings in their product with the normal;
    /// - Embree computes the normal from those moved corners: `u (|v - p|_j |e|_k + |v - p|_k |e|_j)` in component i.
    #[inline(always)]
    pub(super) fn offset(&self) -> f32 {
        let ([v0, v1, v2], [e1, e2], position) = (self.corners, self.edges, self.position);
        let reach = (v0 - position).abs().max((v1 - position).abs()).max((v2 - position).abs());
        let edge = e1.abs().max(e2.abs());
        // Component i holds the products of components j and k.
        let tilt = (reach.yzx() * edge.zxy() + reach.zxy() * edge.yzx()).dot(reach) * self.inverse_length;
        let error = position.abs() + 4.0 * reach + 3.0 * edge;
        UNIT_ROUNDOFF * SAFETY * (self.normal.abs().dot(error) + 3.0 * tilt)
    }
}

/// A hit on the reflecting side of a flat Lambert triangle.
#[derive(Clone, Copy, Debug)]
pub struct DiffuseHit {
    pub(super) point: TrianglePoint,
    /// The geometric normal on the side from which the ray arrived.
    pub(super) facing: Vec3A,
    /// Reflectance of the surface on that side; not black.
    pub reflectance: Rgb,
    /// Index of the surface in [`super::Scene::surfaces`].
    pub surface: u32,
}

impl DiffuseHit {
    /// Position, rounded to `f32`.
    #[inline]
    pub fn position(&self) -> Vec3 {
        self.point.position.into()
    }

    /// The unit geometric normal on the side from which the ray arrived.
    #[inline]
    pub fn facing_normal(&self) -> Vec3 {
        self.facing.into()
    }

    /// A ray from here in a unit `direction` on the side of the facing normal, as by [`SurfaceInteraction::spawn`].
    #[inline]
    pub fn spawn(&self, direction: Vec3) -> Ray {
        let origin = self.point.position + self.facing * self.point.offset();
        Ray::new(origin.into(), direction)
    }
}

/// Offset that moves a point at the edge of two surfaces with these unit normals away from both, along the middle of the wedge, by a few
/// times the `error` and at most `most`. The normals point to the side of the point.
#[cold]
pub(super) fn between([a, b]: [Vec3; 2], error: f32, most: f32) -> Vec3 {
    const ROOM: f32 = 4.0;
    let along = (a + b) / (1.0 + a.dot(b)).max(f32::EPSILON);
    (along * (ROOM * error)).clamp_length_max(most)
}

/// An edge of a triangle, seen from a point close to it.
pub(super) struct TriangleEdge {
    /// Unit vector in the plane of the triangle, perpendicular to the edge and pointing out of the triangle.
    pub(super) out: Vec3,
    /// Error bound of points near the edge.
    pub(super) error: f32,
    /// Largest distance of ray origins from their hits, see [`RETREAT`].
    pub(super) most: f32,
}

impl TriangleEdge {
    /// The edge closest to the point with these barycentric coordinates; `None` for triangles without area.
    #[cold]
    pub(super) fn nearest(corners: [Vec3; 3], uv: Vec2, offset: f32) -> Option<Self> {
        let shares = [1.0 - uv.x - uv.y, uv.x, uv.y];
        let [a, b, c] = corners;
        let opposite = [(b, c), (c, a), (a, b)];
        let distance = |i: usize| shares[i] / opposite[i].0.distance(opposite[i].1);
        let nearest = (0..3).min_by(|&i, &j| distance(i).total_cmp(&distance(j)))?;
        let (from, to) = opposite[nearest];
        let edge = to - from;
        let inward = corners[nearest] - from;
        let out = unit(edge * (inward.dot(edge) / edge.length_squared()) - inward)?;
        let most = corners.iter().fold(Vec3::ZERO, |most, corner| most.max(corner.abs())).max_element();
        let longest = opposite.iter().map(|(from, to)| from.distance(*to)).fold(0.0, f32::max);
        let error = offset + UNIT_ROUNDOFF * SAFETY * 8.0 * most;
        Some(Self { out, error, most: RETREAT as f32 * longest })
    }
}

/// Transform of an instance.
#[derive(Clone, Debug)]
pub struct Placement {
    /// Transform from object space to render space.
    pub to_world: DAffine3,
    /// Transform from render space to object space.
    pub to_object: DAffine3,
    /// Inverse transpose of the linear part.
    normal_matrix: DMat3,
    /// Absolute values of the linear part, for error bounds.
    magnitude: DMat3,
    /// Absolute values of the inverse linear part.
    inverse_magnitude: DMat3,
}

impl Placement {
    /// `None` where the transform cannot be inverted.
    pub fn new(to_world: DAffine3) -> Option<Self> {
        let to_object = to_world.inverse();
        if !(to_object.is_finite() && to_world.is_finite()) {
            return None;
        }
        Some(Self {
            to_world,
            to_object,
            normal_matrix: to_object.matrix3.transpose(),
            magnitude: to_world.matrix3.abs(),
            inverse_magnitude: to_object.matrix3.abs(),
        })
    }

    /// [`TrianglePoint::retreat`] in render space. A ray of unit direction met a triangle of the object in `point`, given in object
    /// space. Zero except at edges.
    pub(super) fn retreat(&self, corners: [[f32; 3]; 3], point: &HitPoint, ray: &Ray, t: f32) -> f32 {
        let Some(triangle) = TrianglePoint::new(corners, point.uv.to_array()) else { return 0.0 };
        let mut local = self.ray_to_object(ray);
        let stretch = local.direction.length();
        local.direction /= stretch;
        let error = self.error_in_object(point.position) as f32;
        if !triangle.is_at_edge(point.uv.to_array(), &local, point.offset + error) {
            return 0.0;
        }
        triangle.retreat(t * stretch) / stretch
    }

    /// Bound on the error of a point of the object that rounding in render space causes, in object space.
    fn error_in_object(&self, position: Vec3) -> f64 {
        let world = self.magnitude * position.as_dvec3().abs() + self.to_world.translation.abs();
        // Doubled: the point in render space and the ray in object space are both rounded.
        let moved = self.inverse_magnitude * (2.0 * world);
        f64::from(UNIT_ROUNDOFF * SAFETY) * 4.0 * moved.max_element()
    }

    /// The ray in object space, with the same parameter.
    pub fn ray_to_object(&self, ray: &Ray) -> Ray {
        Ray {
            origin: self.to_object.transform_point3(ray.origin.as_dvec3()).as_vec3(),
            direction: self.to_object.transform_vector3(ray.direction.as_dvec3()).as_vec3(),
            t_max: ray.t_max,
        }
    }

    /// A normal of the object in render space; zero where it vanishes.
    pub fn normal_to_world(&self, normal: Vec3) -> Vec3 {
        (self.normal_matrix * normal.as_dvec3()).normalize_or_zero().as_vec3()
    }
}

/// A hit with everything that shading needs.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceInteraction {
    /// Geometry of the hit; the normal is the surface's own, after `flip_normal`.
    pub point: HitPoint,
    /// Interpolated normal, unit length, on the same side of the surface as the geometric one.
    pub shading_normal: Vec3,
    /// Unit direction back along the ray.
    pub wo: Vec3,
    /// Distance travelled in render space.
    pub distance: f32,
    /// Index of the surface in [`super::Scene::surfaces`].
    pub surface: u32,
    /// Primitive of the surface.
    pub primitive: u32,
    /// Index of the material in [`super::Scene::materials`]: that of the surface, or of the part that was hit.
    pub material: u32,
    /// Factor on the material's reflectance: the colour of its texture here, or 1.
    pub tint: Rgb,
    /// Factor on the light's radiance, where the surface emits.
    pub glow: Rgb,
    /// Parameters at this point of a material whose parameters vary.
    pub painted: Option<Painted>,
    /// All interfaces between media at this point, where other surfaces lie there too.
    pub borders: Borders,
    /// Offset of the origins of rays that stay on the side of the incoming ray: back along that ray, and away from the surface at the
    /// other side of an edge. Zero except next to edges, where an origin at the hit itself might lie beyond that surface.
    pub retreat: Vec3,
}

impl SurfaceInteraction {
    /// Whether the ray arrived on the side of the normal.
    #[inline]
    pub fn is_front(&self) -> bool {
        self.point.normal.dot(self.wo) > 0.0
    }

    /// The geometric normal, turned to the side from which the ray arrived.
    #[inline]
    pub fn facing_normal(&self) -> Vec3 {
        if self.is_front() { self.point.normal } else { -self.point.normal }
    }

    /// BSDF and frame for `material`. Opaque two-sided materials are turned to the side from which the ray arrived; the back of a
    /// one-sided material is black; an interface keeps the side of its normal.
    #[inline]
    pub fn shading(&self, material: &Material) -> Shading {
        self.shading_between(material, None)
    }

    /// [`Self::shading`], with an `interface` that replaces the material's own where it separates other media.
    #[inline]
    pub(super) fn shading_between(&self, material: &Material, interface: Option<Dielectric>) -> Shading {
        let front = self.is_front();
        let turned = |n: Vec3| if front { n } else { -n };
        let (mut bsdf, keeps_side) = material.bsdf(front);
        if let (Some(painted), Bsdf::Layered(_)) = (&self.painted, &bsdf) {
            bsdf = Bsdf::Layered(painted.bsdf);
        }
        if self.tint != Rgb::ONE {
            bsdf = tinted(bsdf, self.tint);
        }
        if let Some(interface) = interface {
            bsdf = bsdf.between(interface);
        }
        let (geometric, mut shading) = if keeps_side {
            (self.point.normal, self.shading_normal)
        } else {
            (turned(self.point.normal), turned(self.shading_normal))
        };
        // An interpolated normal that faces away from the viewer would make a visible surface black.
        if !(shading.dot(self.wo) * geometric.dot(self.wo) > 0.0) {
            shading = geometric;
        }
        let frame = match (material.tangent(), &self.painted) {
            (None, Some(painted)) if painted.tangent != Vec3::ZERO => {
                Frame::with_tangent(shading, painted.tangent)
            }
            (None, _) => Frame::from_z(shading),
            (Some(tangent), _) => Frame::with_tangent(shading, tangent.at(shading)),
        };
        let wo_local = frame.to_local(self.wo);
        if let Bsdf::Layered(mut layers) = bsdf {
            if let Some(normal) = self.painted.and_then(|painted| painted.coat_normal) {
                layers.set_coat_normal(frame.to_local(if keeps_side { normal } else { turned(normal) }));
            }
            bsdf = Bsdf::Layered(layers.seen_from(wo_local));
        }
        Shading::new(bsdf, frame, geometric, wo_local)
    }

    /// A ray from here in a unit `direction`, moved off the surface by this hit's own error bound.
    #[inline]
    pub fn spawn(&self, direction: Vec3) -> Ray {
        Ray::new(self.start_towards(direction), direction)
    }

    /// Origin of rays that leave from here to the side that `direction` points to.
    #[inline]
    pub fn start_towards(&self, direction: Vec3) -> Vec3 {
        let start = self.point.moved_towards(direction);
        if self.retreat == Vec3::ZERO { start } else { self.retreated(start, direction) }
    }

    #[cold]
    fn retreated(&self, start: Vec3, direction: Vec3) -> Vec3 {
        let normal = self.point.normal;
        if direction.dot(normal) * self.wo.dot(normal) > 0.0 { start + self.retreat } else { start }
    }

    /// The segment from here to `target`, a point that has already been moved off its own surface.
    #[inline]
    pub fn spawn_to(&self, target: Vec3) -> Ray {
        Ray::segment(self.start_towards(target - self.point.position), target)
    }
}

/// Smallest cosine between shading normal and geometric normal. Photons are weighted by up to its inverse (`bsdf::Bend`), which must
/// remain bounded where the vertex normals of a mesh contradict each other.
const LEAST_NORMAL_COSINE: f32 = 0.1;

/// The unit shading normal, bent towards the unit geometric normal on the same side until their cosine reaches [`LEAST_NORMAL_COSINE`].
#[inline]
pub(super) fn within_reach(shading: Vec3, geometric: Vec3) -> Vec3 {
    let cosine = shading.dot(geometric);
    if cosine >= LEAST_NORMAL_COSINE {
        return shading;
    }
    let sine = (1.0 - LEAST_NORMAL_COSINE * LEAST_NORMAL_COSINE).sqrt();
    let along = unit(shading - geometric * cosine);
    along.map_or(geometric, |along| geometric * LEAST_NORMAL_COSINE + along * sine)
}

/// A point on a light at which a shadow ray ends, moved off the light's surface towards `from`.
pub fn shadow_target(position: DVec3, error: Vec3, normal: Vec3, from: Vec3) -> Vec3 {
    let point = SurfacePoint::new(position, error, normal.as_dvec3(), Vec2::ZERO);
    let point = HitPoint::on_procedural(&point);
    point.moved_towards(from - point.position)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shading_normals_stay_near_the_surface() {
        let geometric = Vec3::Z;
        for shading in [Vec3::X, Vec3::new(-1.0, 0.0, 1e-7).normalize_or_zero(), Vec3::Y] {
            let bent = within_reach(shading, geometric);
            assert!(
                (bent.length() - 1.0).abs() < 1e-6 && (bent.z - LEAST_NORMAL_COSINE).abs() < 1e-6,
                "{bent}"
            );
            assert!(bent.dot(shading) > 0.99, "{bent} for {shading}");
        }
        let tilted = Vec3::new(0.6, 0.0, 0.8);
        assert_eq!(within_reach(tilted, geometric), tilted);
        assert_eq!(within_reach(geometric, geometric), geometric);
    }
}
