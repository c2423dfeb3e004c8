//! Shapes: meshes, quadrics, and what they emit.

use super::Importer;
use super::error::{Fault, fail};
use super::import::material::{Filling, Look};
use super::import::shape::{Form, MOST_SHAPES, foresee, is_distorted, mesh};
use super::mesh::{areas, bilinear, inline, one_triangle, unpacked_mesh, with_coordinates};
use super::object::Object;
use super::paint::{Amount, Paint, Use, luminance};
use super::quadric::Quadric;
use super::report::Subject;
use super::state::{Chosen, State};
use super::surface::{Base, Surface};
use super::text::shown;
use super::texture::{Curve, from_below};
use crate::scene_file::MeshReading;
use crate::scene_file::description::{
    EmissionDescription, Emitted, GeometryDescription, MeshNormals, Named, ShapeDescription,
};
use crate::scene_file::diagnostic::suggestion;
use crate::scene_file::mesh_size::mesh_size;
use crate::scene_file::ply::read_ply_model;
use crate::textures::{Sampler, TextureSlot};
use glam::{Affine2, DAffine3, DVec3};
use std::f64::consts::PI;
use std::rc::Rc;

/// Areas within this ratio count as one, for lights by their power.
const SAME_AREA: f64 = 1.01;

/// Most triangles of a mesh that become shapes of their own.
const MOST_LIGHTS: usize = 4096;

/// Light that a surface emits.
struct Emission {
    radiance: DVec3,
    picture: Option<TextureSlot>,
    two_sided: bool,
    /// Luminous power of each triangle or other shape, in the place of the size of the radiance.
    power: Option<f64>,
}

impl Importer<'_> {
    /// Adds a shape, now or as soon as the names that it uses are known.
    pub(super) fn shape(&mut self, object: &Rc<Object>) -> Result<(), Fault> {
        let is_known = |name: &str| name.is_empty() || self.media.contains_key(name);
        let state = self.state.clone();
        if self.chosen(&state.material).is_some() && is_known(&state.inside) && is_known(&state.outside) {
            return self.add_shape(object, &state, self.group);
        }
        if self.waiting.len() >= MOST_SHAPES {
            return fail(&object.place, "too many shapes", "merge meshes, or place objects by instances");
        }
        self.waiting.push((Rc::clone(object), state, self.group));
        Ok(())
    }

    /// Adds the shapes whose names were not known before.
    pub(super) fn place_waiting(&mut self) -> Result<(), Fault> {
        for (object, state, group) in std::mem::take(&mut self.waiting) {
            self.add_shape(&object, &state, group)?;
        }
        Ok(())
    }

    fn add_shape(&mut self, object: &Rc<Object>, state: &State, group: Option<usize>) -> Result<(), Fault> {
        if self.description.shapes.len() >= MOST_SHAPES {
            return fail(&object.place, "too many shapes", "merge meshes, or place objects by instances");
        }
        super::transform::check(&state.ctm, &object.place)?;
        let bsdf = match (self.chosen(&state.material), &state.material) {
            (Some(bsdf), _) => bsdf,
            (None, Chosen::Named(name, place)) => return self.no_material(name, place),
            (None, Chosen::Object(object)) => Rc::clone(object),
        };
        let mut surface = self.surface(&bsdf)?;
        let alpha = self.alpha(object)?;
        let fillings =
            [self.filling(&state.inside, &object.place)?, self.filling(&state.outside, &object.place)?];
        let mut emission = match &state.area_light {
            Some(light) => self.area_light(light)?,
            None => None,
        };
        if emission.is_some() && group.is_some() {
            self.report.warn(&**object, "does not emit, as shapes in objects do not in pbrt");
            emission = None;
        }
        if matches!(surface.base, Base::Null) && fillings[0] == fillings[1] {
            if emission.is_none() {
                // Nothing is to be seen of it, but its parameters are checked.
                self.form(object, state, false, false)?;
                return Ok(());
            }
            surface.base = Base::Diffuse(Paint::Plain(DVec3::ZERO));
            self.report.note(&**object, "emits, and light that should pass it ends there");
        }
        if let Some(alpha) = &alpha {
            self.mask(object, &mut surface, alpha, emission.is_some());
        }
        let fillings = self.kept_fillings(object, &surface, fillings);
        let glow = emission.as_ref().and_then(|emission| emission.picture.clone());
        let key = (bsdf.serial, state.inside.clone(), state.outside.clone());
        let is_shared = glow.is_none() && alpha.is_none() && emission.is_none();
        let look = Look { bsdf: &*bsdf, surface: &surface, fillings, glow };
        let mut finished = match self.finished.get(&key) {
            Some(known) if is_shared => *known,
            _ => {
                let finished = self.building().material(&look, None);
                if is_shared {
                    self.finished.insert(key, finished);
                }
                finished
            }
        };
        let needs = finished.needs.with_bumps(surface.bump.is_some());
        let is_loaded = emission.as_ref().is_some_and(|emission| emission.power.is_some());
        let form = self.form(object, state, needs.any(), is_loaded)?;
        let parts = self.lit(object, emission, form, &state.ctm);
        for (form, emission) in parts {
            let geometry =
                self.building().geometry(&**object, &look, (form, &state.ctm), &mut finished, needs);
            self.description.shapes.push(Named {
                name: object.name(),
                location: object.place.location.clone(),
                value: ShapeDescription {
                    geometry,
                    transform: state.ctm,
                    flip_normal: state.reverse,
                    material: finished.number,
                    caustic_photons: 1.0,
                    illumination: None,
                    emission,
                    displacement: None,
                    group,
                },
            });
        }
        Ok(())
    }

    /// The share of the surface that is there, where it is not whole.
    fn alpha(&mut self, object: &Rc<Object>) -> Result<Option<Amount>, Fault> {
        if object.has("shadowalpha") {
            object.get("shadowalpha");
            self.report.warn(&**object, "`shadowalpha` is left out: shadows are those of `alpha`");
        }
        if !object.has("alpha") {
            return Ok(None);
        }
        let alpha = self.amount(object, ("alpha", 1.0), Curve::Same, Use::Alpha)?;
        Ok(match alpha {
            Amount::Plain(share) if share >= 1.0 => None,
            Amount::Plain(share) => Some(Amount::Plain(share.max(0.0))),
            picture @ Amount::Picture(_) => Some(picture),
        })
    }

    fn mask(&mut self, object: &Rc<Object>, surface: &mut Surface, alpha: &Amount, emits: bool) {
        if emits && alpha.plain() == Some(0.0) {
            // In pbrt such a light gives light and is not seen.
            self.report.warn(&**object, "is a light that is not to be seen (`alpha` 0), and is seen here");
            return;
        }
        if surface.opacity.is_some() {
            self.report.warn(&**object, "`alpha` over the opacity of its material: `alpha` counts");
        }
        surface.opacity = Some(alpha.clone());
    }

    /// The media on both sides of a surface that light can cross.
    fn kept_fillings(
        &mut self,
        object: &Rc<Object>,
        surface: &Surface,
        fillings: [Filling; 2],
    ) -> [Filling; 2] {
        let is_crossed = matches!(surface.base, Base::Null | Base::Glass { .. } | Base::Border(..));
        if !is_crossed && fillings[0] != fillings[1] {
            self.report
                .note(&**object, "the media at its sides are left out: light does not cross its surface");
        }
        if is_crossed { fillings } else { Default::default() }
    }

    /// What a surface emits; `None` for a light that gives nothing.
    fn area_light(&mut self, object: &Rc<Object>) -> Result<Option<Emission>, Fault> {
        if object.kind != "diffuse" && object.kind != "area" {
            let message = format!("the area light `{}` is not known", shown(&object.kind));
            return fail(&object.place, message, suggestion(&object.kind, &["diffuse"]));
        }
        let mut radiance = self.light_colour(object, "L")? * self.light_scale(object)?;
        let two_sided = object.boolean("twosided", false)?;
        let power = self.positive(object, "power")?;
        self.ignore(object, &["nsamples", "samples"], "lights are sampled by what they give");
        let mut picture = None;
        let mut mean = 1.0;
        if object.has("filename") {
            if object.has("L") {
                let message = format!("{} has both `L` and a picture", object.label());
                return fail(object.place_of("L"), message, "keep one of them");
            }
            let path = self.named_file(object, "filename")?;
            let (texture, factor) = self.pictures.read(&path, Use::Glow, false).or_else(|error| {
                let message = format!("the picture of {} cannot be read: {error}", object.label());
                fail(&object.place, message, "convert it to PNG, JPEG or EXR")
            })?;
            mean = luminance(texture.mean().truncate().as_dvec3()) * factor;
            radiance *= factor;
            let sampler = Sampler { finest: true, ..Sampler::default() };
            picture =
                Some(TextureSlot { texture, sampler, set: 0, transform: from_below(Affine2::IDENTITY) });
        }
        self.finish(object, &["L", "scale", "twosided", "power", "filename"])?;
        if radiance == DVec3::ZERO {
            self.report.note(&**object, "gives no light");
            return Ok(None);
        }
        // The power is divided by that of the picture.
        let power = power.map(|power| power / (mean * if two_sided { 2.0 } else { 1.0 }));
        Ok(Some(Emission { radiance, picture, two_sided, power }))
    }

    /// A form with its emission. By its power, each triangle of a mesh is a light: they are parts of their own where their areas
    /// differ.
    fn lit(
        &mut self,
        object: &Rc<Object>,
        emission: Option<Emission>,
        form: Form,
        to_world: &DAffine3,
    ) -> Vec<(Form, Option<EmissionDescription>)> {
        let Some(Emission { radiance, two_sided, power, .. }) = emission else { return vec![(form, None)] };
        let of = |radiance: DVec3| {
            Some(EmissionDescription { emitted: Emitted::Radiance(radiance), two_sided, photons: 1.0 })
        };
        let Some(power) = power else { return vec![(form, of(radiance))] };
        let triangles = match form {
            Form::Mesh { mesh, .. } if matches!(object.kind.as_str(), "trianglemesh" | "plymesh") => mesh,
            form => {
                let area = area_of(&form, to_world).max(f64::MIN_POSITIVE);
                return vec![(form, of(radiance * (power / (PI * area))))];
            }
        };
        if triangles.triangles.len() > 1 {
            self.report.note(&**object, "each of its triangles emits the power of its light, as in pbrt");
        }
        let areas = areas(&triangles, to_world);
        let sum: f64 = areas.iter().sum();
        let least = areas.iter().copied().fold(f64::INFINITY, f64::min);
        let is_even = areas.iter().all(|area| *area <= SAME_AREA * least);
        if !is_even && areas.len() > MOST_LIGHTS {
            self.report.warn(
                &**object,
                "its light has one radiance, of the same power in all: it has too many triangles",
            );
        }
        if is_even || areas.len() > MOST_LIGHTS {
            let whole = power * areas.len() as f64 / (PI * sum).max(f64::MIN_POSITIVE);
            return vec![(mesh(triangles), of(radiance * whole))];
        }
        let part = |(triangle, area): (&[u32; 3], &f64)| {
            (mesh(one_triangle(&triangles, *triangle)), of(radiance * (power / (PI * area))))
        };
        triangles.triangles.iter().zip(&areas).map(part).collect()
    }

    /// The geometry of a shape. `detailed`: with the vertex data that textures need; `loaded`: with its triangles.
    fn form(
        &mut self,
        object: &Rc<Object>,
        state: &State,
        detailed: bool,
        loaded: bool,
    ) -> Result<Form, Fault> {
        let form = match object.kind.as_str() {
            "trianglemesh" if detailed => mesh(with_coordinates(inline(object)?)),
            "trianglemesh" => mesh(inline(object)?),
            "bilinearmesh" => {
                let (patches, is_flat) = bilinear(object, |vertices| self.foresee_mesh(object, vertices))?;
                if !is_flat {
                    self.report.note(&**object, "its patches are not flat, and are taken for triangles");
                }
                if object.has("emissionfilename") {
                    object.get("emissionfilename");
                    self.report.warn(&**object, "`emissionfilename` only steers samples, and is left out");
                }
                mesh(patches)
            }
            "plymesh" => return self.ply(object, detailed, loaded),
            "sphere" | "cylinder" | "disk" => {
                let quadric = Quadric::read(object)?;
                match quadric.exact().filter(|_| !detailed) {
                    Some(exact) if object.kind == "sphere" || !is_distorted(&state.ctm) => Form::Exact(exact),
                    _ => {
                        self.report.note(
                            &**object,
                            "is taken for a mesh of triangles, as it is a part, is distorted, or has a picture",
                        );
                        self.foresee_mesh(object, quadric.vertices())?;
                        mesh(quadric.tessellated())
                    }
                }
            }
            "loopsubdiv" => {
                return fail(
                    &object.place,
                    "the shape `loopsubdiv` is not modelled",
                    "subdivide it where it was made, and export it as a mesh (`plymesh`)",
                );
            }
            "curve" | "cone" | "paraboloid" | "hyperboloid" | "nurbs" | "heightfield" => {
                return fail(
                    &object.place,
                    format!("the shape `{}` is not modelled", object.kind),
                    "export it as a mesh (`plymesh`), or take it out",
                );
            }
            other => {
                let known = ["trianglemesh", "plymesh", "bilinearmesh", "sphere", "cylinder", "disk"];
                let message = format!("the shape `{}` is not known", shown(other));
                return fail(&object.place, message, suggestion(other, &known));
            }
        };
        self.finish(
            object,
            &["indices", "P", "N", "uv", "radius", "zmin", "zmax", "phimax", "height", "alpha"],
        )?;
        Ok(form)
    }

    fn ply(&mut self, object: &Rc<Object>, detailed: bool, loaded: bool) -> Result<Form, Fault> {
        let path = self.named_file(object, "filename")?;
        if object.has("displacement") || object.has("edgelength") {
            object.get("displacement");
            object.get("edgelength");
            self.report
                .warn(&**object, "its displacement is left out: subdivide and move it where it was made");
        }
        self.finish(object, &["filename", "alpha"])?;
        let ends_in =
            |ending: &str| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(ending));
        if !detailed && !loaded && ends_in("ply") {
            let has_normals = mesh_size(&path, MeshNormals::FromFile).is_ok_and(|size| size.has_normals);
            // Normals determine the front side; without them it is flat.
            let normals = if has_normals { MeshNormals::Leading } else { MeshNormals::Flat };
            return Ok(Form::File { path, normals });
        }
        foresee((&mut self.taken, self.allow), &**object, &path)?;
        let told = |error: &dyn std::fmt::Display| {
            let message = format!("the mesh of {} cannot be read: {error}", object.label());
            fail(&object.place, message, "name a mesh in PLY, which may be compressed by gzip")
        };
        let reading = MeshReading { colours: false, ..MeshReading::ALL };
        let read = if ends_in("gz") {
            let allow = self.allow;
            unpacked_mesh(&path, (&mut self.taken, allow))
        } else {
            read_ply_model(&path, &reading).map(|model| model.mesh).map_err(|error| error.to_string())
        };
        match read {
            Ok(mut read) => {
                if read.normals.is_some() {
                    read.follow_normals();
                }
                Ok(mesh(if detailed { with_coordinates(read) } else { read }))
            }
            Err(error) => told(&error),
        }
    }
}

/// The area of a placed form; 0 for a file that was not read.
fn area_of(form: &Form, to_world: &DAffine3) -> f64 {
    let scale = to_world.matrix3.x_axis.length();
    match form {
        Form::Exact(GeometryDescription::Sphere { radius, .. }) if is_distorted(to_world) => {
            areas(&Quadric::ball(*radius).tessellated(), to_world).iter().sum()
        }
        Form::Exact(GeometryDescription::Sphere { radius, .. }) => 4.0 * PI * (radius * scale).powi(2),
        Form::Exact(GeometryDescription::Cylinder { base, top, radius }) => {
            2.0 * PI * radius * (*top - *base).length() * scale * scale
        }
        Form::Exact(GeometryDescription::Disc { radius, .. }) => PI * (radius * scale).powi(2),
        Form::Mesh { mesh, .. } => areas(mesh, to_world).iter().sum(),
        Form::Exact(_) | Form::File { .. } => 0.0,
    }
}
