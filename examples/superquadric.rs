//! An object of one's own, never tessellated: a superquadric `|x|^n + |y|^n + |z|^n = 1` as a [`Procedural`] of two
//! functions, in a scene that is put together by code.
//!
//! `cargo run --release --example superquadric` writes `superquadric.png`. Photons land on the object, it casts caustics if it is
//! specular, and it is shadowed and shadows like any other.

use cardioid::bsdf::Dielectric;
use cardioid::camera::Camera;
use cardioid::embree::{Device, ObjectHit, Procedural, SceneBuilder, TriangleBuffers};
use cardioid::film::{Filter, LayerSet, ToneMap};
use cardioid::image_io::{PngPixels, write_png};
use cardioid::lights::{AreaLight, Light};
use cardioid::math::{Bounds3, Ray, Rgb};
use cardioid::media::Medium;
use cardioid::render::{Quality, RenderRequest, Silent, render};
use cardioid::scene::{
    Geometry, LightNote, Material, Mesh, Node, RenderSpace, Scene, SceneParts, Surface, Target,
};
use cardioid::shapes::{EmitterShape, Quad};
use glam::DVec3;
use std::error::Error;
use std::sync::Arc;

const SIZE: (u32, u32) = (320, 240);

/// A superquadric; convex for exponents of at least 1.
#[derive(Clone, Copy, Debug)]
struct Superquadric {
    center: DVec3,
    radius: f64,
    exponent: f64,
}

impl Superquadric {
    /// Negative inside, and convex along every line.
    fn value(&self, p: DVec3) -> f64 {
        p.to_array().map(|x| x.abs().powf(self.exponent)).iter().sum::<f64>() - 1.0
    }

    fn gradient(&self, p: DVec3) -> DVec3 {
        DVec3::from_array(p.to_array().map(|x| self.exponent * x.abs().powf(self.exponent - 1.0).copysign(x)))
    }
}

/// The root of a convex function that lies next to `start`, where it is positive: Newton's method, which comes closer from
/// one side and never passes it. `None` where the function turns before it is zero.
fn next_root(start: f64, falls: bool, f: impl Fn(f64) -> (f64, f64)) -> Option<f64> {
    let mut t = start;
    for _ in 0..60 {
        let (value, slope) = f(t);
        if value <= 0.0 {
            break;
        }
        if (slope < 0.0) != falls || slope == 0.0 {
            return None;
        }
        let step = value / slope;
        t -= step;
        if step.abs() <= 4.0 * f64::EPSILON * t.abs() {
            break;
        }
    }
    Some(t)
}

impl Procedural for Superquadric {
    fn bounds(&self, _primitive: u32) -> Bounds3 {
        Bounds3 { min: self.center - self.radius, max: self.center + self.radius }
    }

    fn nearest(&self, _primitive: u32, ray: &Ray) -> Option<ObjectHit> {
        // In the object's own space the parameter stays the same.
        let origin = (ray.origin.as_dvec3() - self.center) / self.radius;
        let direction = ray.direction.as_dvec3() / self.radius;
        let at = |t: f64| origin + t * direction;
        // The part of the line within a sphere around the cube around the object.
        let middle = -origin.dot(direction) / direction.length_squared();
        let half = (3.0 - at(middle).length_squared()).max(0.0).sqrt() / direction.length();
        if !(half > 0.0) {
            return None;
        }
        let f = |t: f64| (self.value(at(t)), self.gradient(at(t)).dot(direction));
        let roots = [next_root(middle - half, true, f)?, next_root(middle + half, false, f)?];
        let t = roots.into_iter().find(|&t| t as f32 > 0.0 && t <= f64::from(ray.t_max))?;
        Some(ObjectHit { t, normal: self.gradient(at(t)).normalize(), error: 1e-14 * self.radius })
    }
}

/// A parallelogram as triangles.
fn parallelogram(corner: DVec3, u: DVec3, v: DVec3) -> Result<Geometry, Box<dyn Error>> {
    let corners = [corner, corner + u, corner + u + v, corner + v];
    let positions = corners.iter().map(|corner| corner.as_vec3().to_array()).collect();
    let buffers = TriangleBuffers::new(positions, vec![[0, 1, 2], [0, 2, 3]])?;
    Ok(Geometry::Mesh(Mesh { buffers, normals: None, data: None }))
}

fn main() -> Result<(), Box<dyn Error>> {
    // The scene is made in render space at once: it fits the unit sphere, one unit is one metre.
    let lamp = [DVec3::new(-0.3, 0.9, -0.2), DVec3::new(0.2, 0.0, 0.0), DVec3::new(0.0, 0.0, 0.2)];
    let superquadric = |x: f64, z: f64, exponent| {
        let object = Superquadric { center: DVec3::new(x, -0.2, z), radius: 0.2, exponent };
        Geometry::Procedural(Arc::new(object))
    };
    let floor = parallelogram(DVec3::new(-0.7, -0.4, 0.6), 1.4 * DVec3::X, -1.2 * DVec3::Z)?;
    let lamp_geometry = parallelogram(lamp[0], lamp[1], lamp[2])?;
    // Name, geometry, material.
    let objects = [
        ("floor", floor, 0),
        ("cushion", superquadric(-0.25, 0.0, 4.0), 1),
        ("glass", superquadric(0.25, 0.1, 2.5), 2),
        ("lamp", lamp_geometry, 0),
    ];
    let device = Arc::new(Device::new(0)?);
    let mut builder = SceneBuilder::new(&device)?;
    let (mut nodes, mut surfaces) = (Vec::new(), Vec::new());
    for (index, (name, geometry, material)) in objects.into_iter().enumerate() {
        match &geometry {
            Geometry::Mesh(mesh) => builder.add_triangles(mesh.buffers.clone())?,
            Geometry::Procedural(object) => builder.add_procedural(Arc::clone(object))?,
        };
        nodes.push(Node::Surface(index as u32));
        surfaces.push(Surface {
            name: name.to_owned(),
            geometry,
            flip_normal: false,
            material,
            part_materials: Vec::new(),
            light: (name == "lamp").then_some(0),
            illumination: None,
            charts: Vec::new(),
        });
    }
    let lambert = |reflectance| Material::Lambert { reflectance, two_sided: true };
    let glass = Material::Dielectric { inside: 1, outside: 0, interface: Dielectric::new(1.0, 1.5) };
    let medium = |name: &str, ior, rank| Medium {
        name: name.to_owned(),
        ior,
        dispersion: None,
        absorption: Rgb::ZERO,
        volume: None,
        rank,
    };
    let emitter = EmitterShape::Quad(Quad::new(lamp[0], lamp[1], lamp[2])?);
    let light = AreaLight::new(vec![emitter], Rgb::new(70.0, 66.0, 60.0), false, false).ok_or("no light")?;
    let scene = Scene::new(SceneParts {
        name: "superquadrics".to_owned(),
        embree: builder.commit()?,
        nodes,
        surfaces,
        materials: vec![
            ("white".to_owned(), lambert(Rgb::splat(0.7))),
            ("red".to_owned(), lambert(Rgb::new(0.75, 0.2, 0.15))),
            ("glass".to_owned(), glass),
        ],
        textures: Vec::new(),
        pixel: cardioid::camera::PixelSpread::default(),
        media: vec![medium("air", 1.0, 1), medium("inside", 1.5, 0)],
        lights: vec![Light::Area(light)],
        space: RenderSpace::fitting(DVec3::ZERO, 0.99),
        bounds: (glam::Vec3::ZERO, 1.0),
        // What photons are aimed at: everything, and those of caustics at the glass alone.
        targets: vec![
            Target::of_sphere(glam::Vec3::ZERO, 1.0),
            Target { density: 1.0, surface: 2, ..Target::of_sphere(glam::Vec3::new(0.25, -0.2, 0.1), 0.35) },
        ],
        light_notes: vec![LightNote { name: "lamp".to_owned(), photons: 1.0 }],
    });
    let aspect = f64::from(SIZE.0) / f64::from(SIZE.1);
    let camera =
        Camera::look_at(DVec3::new(0.0, 0.35, 1.4), DVec3::new(0.0, -0.2, 0.0), DVec3::Y, 38.0, aspect)
            .ok_or("the camera looks nowhere")?;
    let request = RenderRequest {
        width: SIZE.0,
        height: SIZE.1,
        crop: None,
        filter: Filter::Box { radius: 0.5 },
        layers: LayerSet::default(),
        settings: Quality::Draft.settings(),
    };
    let rendered = render(&scene, &camera, &request, &Silent)?;
    let developed = rendered.film.develop();
    let pixels = ToneMap::default().to_srgb8(developed.beauty());
    write_png("superquadric.png", SIZE.0, SIZE.1, PngPixels::Rgb8(&pixels))?;
    println!("wrote superquadric.png");
    Ok(())
}
