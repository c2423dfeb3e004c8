//! Points on surfaces, with the error bounds that make ray offsets unnecessary to tune.

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

/// Geometry of a hit before anything is known of its material: a point, a normal, and how far a ray must start from
/// the point to be on a known side of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HitPoint {
    /// Position, rounded to `f32`.
    pub position: Vec3,
    /// Unit normal of the geometry on its outer side: by winding for triangles, outward for closed shapes.
    pub normal: Vec3,
    /// Distance along the normal within which neither this point's rounding nor that of an intersection test of a
    /// ray that starts here can tell on which side of the surface a point lies.
    pub offset: f32,
    /// Surface parameters; barycentric for triangles.
    pub uv: Vec2,
}

/// How far back rays start that leave from next to an edge, as a share of the size of what is there.
const RETREAT: f64 = 1.0 / 16.0;

/// Allowance over the first-order bounds below, for the terms of second order they leave out.
const SAFETY: f32 = 2.0;

impl HitPoint {
    /// The point of a triangle with these barycentric coordinates of the second and third corner. `None` for a
    /// triangle without area.
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

    /// The point of a triangle that `ray`, of unit direction, met at its parameter `t`, see [`TrianglePoint::closer`]; and how
    /// far back along that ray others are to start, see [`TrianglePoint::retreat`].
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

    /// [`Self::on_triangle`] where the area leaves the range of `f32`.
    #[cold]
    fn on_tiny_triangle(corners: [[f32; 3]; 3], uv: [f32; 2]) -> Option<Self> {
        let [v0, v1, v2] = corners.map(|v| Vec3::from_array(v).as_dvec3());
        let (e1, e2) = (v1 - v0, v2 - v0);
        let normal = unit_f64(e1.cross(e2))?.as_vec3();
        let position = (v0 + e1 * f64::from(uv[0]) + e2 * f64::from(uv[1])).as_vec3();
        // The whole extent instead of its share along the normal: what Embree makes of such a triangle is anyone's
        // guess.
        let extent = e1.abs().max(e2.abs()).as_vec3();
        let error = position.abs() * UNIT_ROUNDOFF + extent * 1e-3;
        Some(Self { position, normal, offset: SAFETY * error.dot(Vec3::ONE), uv: Vec2::from_array(uv) })
    }

    /// The point of a procedural object, which states its own error.
    #[inline]
    pub fn on_procedural(point: &SurfacePoint) -> Self {
        let position = point.position.as_vec3();
        let normal = point.normal.as_vec3();
        let error = point.error + position.abs() * UNIT_ROUNDOFF;
        Self { position, normal, offset: SAFETY * normal.abs().dot(error), uv: point.uv }
    }

    /// Parts of [`SurfaceInteraction::retreat`] next to an edge of a procedural object, in which `local` met this point at `t`: back along
    /// the ray, to where `wo` points in render space, and off the other face. `None` elsewhere.
    pub(super) fn retreat_from(
        &self,
        edge: &NearEdge,
        placement: Option<&Placement>,
        (local, t, wo): (&Ray, f32, Vec3),
    ) -> Option<(Vec3, Vec3)> {
        /// For errors of the other face, and for what [`NearEdge::distance`] may be too large by.
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
            // A height over the surface of the object is a height divided by that factor in the world.
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

/// A point of a triangle in registers, and what its error bound is made of: only rays that start there need that.
#[derive(Clone, Copy, Debug)]
pub(super) struct TrianglePoint {
    corners: [Vec3A; 3],
    edges: [Vec3A; 2],
    /// As in [`HitPoint`].
    pub(super) position: Vec3A,
    /// As in [`HitPoint`].
    pub(super) normal: Vec3A,
    /// Of the cross product of the edges.
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

    /// The same point, found again along a ray of unit direction that met the triangle at `t`, where the way is short
    /// against the triangle.
    ///
    /// Barycentrics place a point within a roundoff of the *triangle*: a tenth of a millimetre on a plane of a
    /// kilometre, where the caustic of a jewel would become a lattice. The ray places it within a roundoff of
    /// the way.
    #[inline(always)]
    pub(super) fn closer(self, ray: &Ray, t: f32) -> Self {
        /// Length of the edges over the way.
        const SHORT: f32 = 64.0;
        let [e1, e2] = self.edges;
        let way = SHORT * t;
        if e1.length_squared() + e2.length_squared() < way * way { self } else { self.along(ray) }
    }

    /// Where the ray meets the plane, in `f64`; the point as it was where that is beside the triangle.
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
        // Embree, who said that the ray meets this triangle, tells no finer; false as well for what is not a number.
        let edge = -8.0 * f64::from(UNIT_ROUNDOFF);
        if !(u >= edge && v >= edge && 1.0 - u - v >= edge) {
            return self;
        }
        // Not by the way along the ray, whose roundoff is off the plane: one through the origin would have no error of its own to
        // move the next ray's start by, and be met again.
        let position = corner + e1 * u + e2 * v;
        Self { position: position.as_vec3().into(), ..self }
    }

    /// Whether a ray of unit direction met the triangle so close to an edge that, by rounding, a start off this triangle may lie
    /// beyond another one that rises from that edge at any angle.
    ///
    /// A start is off the place of the hit by an error `e` at most: that of the place itself in all directions, and
    /// [`HitPoint::offset`]. Another triangle that rises at an angle `a` from an edge at the distance `d` passes the place
    /// at the distance `d sin(a)`. The ray came from between the two, so its cosine with the normal here is
    /// less than `sin(a)`, unless it came from the other one right here: then that start was too close to the edge. So
    /// nothing is in question where `d` times that cosine is more than `e`, and the other triangle need not be known.
    #[inline(always)]
    pub(super) fn is_at_edge(&self, uv: [f32; 2], ray: &Ray, offset: f32) -> bool {
        /// For the errors of both triangles and of the tests of rays that start in between.
        const ROOM: f32 = 4.0;
        let [e1, e2] = self.edges;
        let edge = e1.abs().max(e2.abs());
        let error = UNIT_ROUNDOFF * SAFETY * (self.position.abs() + 7.0 * edge).max_element() + offset;
        // Times the longest edge that the bounds of two allow: the distance from an edge is a barycentric coordinate times
        // twice the area over the length of that edge.
        let longest = 2.0 * f32::sqrt(3.0) * edge.max_element();
        let least = uv[0].min(uv[1]).min(1.0 - uv[0] - uv[1]);
        let cosine = self.normal.dot(Vec3A::from(ray.direction)).abs();
        !(least * cosine > ROOM * error * longest * self.inverse_length)
    }

    /// How far back along the ray that met the triangle at `t` the next ray starts, where it goes to the same side, another surface
    /// rises there and [`Self::is_at_edge`]. That segment is free as far as any ray can tell. Far enough for what rises from the
    /// edge to be told from the place unless the ray came along it within a millionth.
    #[cold]
    pub(super) fn retreat(&self, t: f32) -> f32 {
        let [e1, e2] = self.edges;
        let longest = e1.length_squared().max(e2.length_squared()).max((e2 - e1).length_squared()).sqrt();
        (RETREAT as f32 * longest).min(0.5 * t)
    }

    /// [`HitPoint::offset`]. Bounds three errors, to first order in the unit roundoff `u`, component by component so
    /// that an axis-aligned wall of any size has none in its plane:
    ///
    /// - the position is computed in `f32`: `u |p|` for the result, `3 u` of each edge for the way there;
    /// - Embree moves corners to the ray's origin first: `u |v_k - p|` each, a few roundings in their product with
    ///   the normal;
    /// - and takes the normal from those moved corners: `u (|v - p|_j |e|_k + |v - p|_k |e|_j)` in component i.
    #[inline(always)]
    pub(super) fn offset(&self) -> f32 {
        let ([v0, v1, v2], [e1, e2], position) = (self.corners, self.edges, self.position);
        let reach = (v0 - position).abs().max((v1 - position).abs()).max((v2 - position).abs());
        let edge = e1.abs().max(e2.abs());
        // Component i holds the products of j and k.
        let tilt = (reach.yzx() * edge.zxy() + reach.zxy() * edge.yzx()).dot(reach) * self.inverse_length;
        let error = position.abs() + 4.0 * reach + 3.0 * edge;
        UNIT_ROUNDOFF * SAFETY * (self.normal.abs().dot(error) + 3.0 * tilt)
    }
}

/// A hit on the reflecting side of a flat Lambert triangle.
#[derive(Clone, Copy, Debug)]
pub struct DiffuseHit {
    pub(super) point: TrianglePoint,
    /// The geometric normal on the side the ray arrived from.
    pub(super) facing: Vec3A,
    /// Of the surface on that side; not black.
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

    /// The unit geometric normal on the side the ray arrived from.
    #[inline]
    pub fn facing_normal(&self) -> Vec3 {
        self.facing.into()
    }

    /// A ray from here in a unit `direction` on the side of the facing normal, as [`SurfaceInteraction::spawn`].
    #[inline]
    pub fn spawn(&self, direction: Vec3) -> Ray {
        let origin = self.point.position + self.facing * self.point.offset();
        Ray::new(origin.into(), direction)
    }
}

/// What takes a place at the edge of two surfaces with these unit normals, on their sides of it, off both by a few times the
/// `error`: out of the wedge, in the middle, and `most` at most.
#[cold]
pub(super) fn between([a, b]: [Vec3; 2], error: f32, most: f32) -> Vec3 {
    const ROOM: f32 = 4.0;
    let along = (a + b) / (1.0 + a.dot(b)).max(f32::EPSILON);
    (along * (ROOM * error)).clamp_length_max(most)
}

/// An edge of a triangle, as seen from a place next to it.
pub(super) struct TriangleEdge {
    /// Unit vector in the plane of the triangle, across the edge and out of the triangle.
    pub(super) out: Vec3,
    /// What places near the edge may be off by.
    pub(super) error: f32,
    /// How far rays may start from their hits: [`RETREAT`].
    pub(super) most: f32,
}

impl TriangleEdge {
    /// The edge next to the place with these barycentric coordinates; `None` for triangles without area.
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

/// Where an instance stands.
#[derive(Clone, Debug)]
pub struct Placement {
    /// From the object's space to render space.
    pub to_world: DAffine3,
    /// From render space to the object's space.
    pub to_object: DAffine3,
    /// Inverse transpose of the linear part.
    normal_matrix: DMat3,
    /// Absolute values of the linear part, for error bounds.
    magnitude: DMat3,
    /// The same of its inverse.
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

    /// [`TrianglePoint::retreat`] in render space, where a ray of unit direction met a triangle of the object in `point` of
    /// the object's space; zero but at edges.
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

    /// What rounding in render space may move a point of the object by, in the object's space.
    fn error_in_object(&self, position: Vec3) -> f64 {
        let world = self.magnitude * position.as_dvec3().abs() + self.to_world.translation.abs();
        // Twice: of the place there, and of the ray here.
        let moved = self.inverse_magnitude * (2.0 * world);
        f64::from(UNIT_ROUNDOFF * SAFETY) * 4.0 * moved.max_element()
    }

    /// The ray in the object's space, with the same parameter.
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
    /// What a material whose parameters vary is here.
    pub painted: Option<Painted>,
    /// All borders between media at this place, where other surfaces lie there too.
    pub borders: Borders,
    /// How far from where rays start else those start that stay on the side of this one: back along the ray, and off what is on
    /// the other side of an edge. Zero but next to edges, where a start right at the hit might be beyond that.
    pub retreat: Vec3,
}

impl SurfaceInteraction {
    /// True where the ray arrived on the side of the normal.
    #[inline]
    pub fn is_front(&self) -> bool {
        self.point.normal.dot(self.wo) > 0.0
    }

    /// The geometric normal turned to the side the ray arrived from.
    #[inline]
    pub fn facing_normal(&self) -> Vec3 {
        if self.is_front() { self.point.normal } else { -self.point.normal }
    }

    /// BSDF and frame for `material`. Opaque two-sided materials are turned to the side the ray arrived from; the back
    /// of a one-sided one is black; an interface keeps the side of its normal.
    #[inline]
    pub fn shading(&self, material: &Material) -> Shading {
        self.shading_between(material, None)
    }

    /// [`Self::shading`], where an `interface` between other media than the material states takes the place of its own.
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

    /// A ray from here in a unit `direction`, started off the surface by this hit's own error bound.
    #[inline]
    pub fn spawn(&self, direction: Vec3) -> Ray {
        Ray::new(self.start_towards(direction), direction)
    }

    /// Where rays start that leave from here to the side that `direction` points to.
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

    /// The segment from here to `target`, a point that is already off its own surface.
    #[inline]
    pub fn spawn_to(&self, target: Vec3) -> Ray {
        Ray::segment(self.start_towards(target - self.point.position), target)
    }
}

/// Smallest cosine between shading normal and geometric normal. Photons are weighted by up to its inverse (`bsdf::Bend`), which
/// must not grow without bound where the normals of a mesh's vertices contradict each other.
const LEAST_NORMAL_COSINE: f32 = 0.1;

/// The unit shading normal, bent to the unit geometric normal on whose side it is as far as [`LEAST_NORMAL_COSINE`] asks for.
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

/// A point on a light for a shadow ray to end at, moved off the light's surface towards `from`.
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
