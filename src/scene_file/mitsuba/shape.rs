//! Shapes: mesh files, spheres and other primitives, groups and instances.

use super::Importer;
use super::error::{Fault, fail};
use super::import::material::{Filling, Look, Needs};
use super::import::shape::{Form, MOST_SHAPES, Placed, foresee, is_distorted, mesh};
use super::paint::{Paint, luminance};
use super::report::Subject;
use super::serialized;
use super::spectrum::Meaning;
use super::surface::{Base, Surface};
use super::tessellate;
use super::text::shown;
use super::value::{Object, Value};
use crate::media::{Coefficients, Phase};
use crate::scene_file::MeshReading;
use crate::scene_file::description::{
    EmissionDescription, Emitted, GeometryDescription, InstanceDescription, MeshNormals, Named,
    ShapeDescription, VolumeDescription,
};
use crate::scene_file::diagnostic::suggestion;
use crate::scene_file::obj::read_obj_with;
use crate::scene_file::ply::read_ply_model;
use glam::{DAffine3, DMat3, DVec3, Vec2};
use std::rc::Rc;

/// Parameters of every shape, for messages.
const COMMON: [&str; 2] = ["to_world", "flip_normals"];

impl Importer<'_> {
    /// Adds a shape to the scene, or to a group.
    pub(super) fn shape(&mut self, object: &Rc<Object>, group: Option<usize>) -> Result<(), Fault> {
        self.enter(object)?;
        let added = self.add_shape(object, group);
        self.leave();
        added
    }

    fn add_shape(&mut self, object: &Rc<Object>, group: Option<usize>) -> Result<(), Fault> {
        match object.plugin.as_str() {
            // It becomes visible where an instance refers to it.
            "shapegroup" if group.is_none() => Ok(()),
            "instance" if group.is_none() => self.instance(object),
            "shapegroup" | "instance" => fail(
                &object.place,
                format!("{} stands in a group", object.label()),
                "groups hold shapes; place the group by an instance at the top of the scene",
            ),
            "merge" => {
                for part in self.parts(object, "shape")? {
                    self.shape(&part, group)?;
                }
                self.finish(object, &[])
            }
            _ => self.single(object, group),
        }
    }

    fn instance(&mut self, object: &Rc<Object>) -> Result<(), Fault> {
        let group = self.only_part(object, "shape")?;
        let transform = object.transform("to_world")?;
        self.finish(object, &["to_world"])?;
        if group.plugin != "shapegroup" {
            let message = format!("an instance of {}", group.label());
            return fail(&object.place, message, "name a <shape type=\"shapegroup\">");
        }
        let key = Rc::as_ptr(&group);
        let number = match self.groups.get(&key) {
            Some(known) => *known,
            None => {
                let number = self.description.groups.len();
                let location = group.place.location.clone();
                self.description.groups.push(Named { name: group.name(), location, value: () });
                self.groups.insert(key, number);
                for part in self.parts(&group, "shape")? {
                    self.shape(&part, Some(number))?;
                }
                self.finish(&group, &[])?;
                number
            }
        };
        check_transform(object, &transform)?;
        self.description.instances.push(Named {
            name: object.name(),
            location: object.place.location.clone(),
            value: InstanceDescription { group: number, transform },
        });
        Ok(())
    }

    fn single(&mut self, object: &Rc<Object>, group: Option<usize>) -> Result<(), Fault> {
        if self.description.shapes.len() >= MOST_SHAPES {
            return fail(&object.place, "too many shapes", "merge meshes, or place groups by instances");
        }
        let bsdfs = self.parts(object, "bsdf")?;
        let emitters = self.parts(object, "emitter")?;
        let subsurface = self.parts(object, "subsurface")?;
        if !subsurface.is_empty() {
            self.report.warn(object, "subsurface scattering is not modelled and left out");
        }
        let bsdf = match bsdfs.last() {
            Some(bsdf) => Rc::clone(bsdf),
            None => Rc::clone(&self.usual_bsdf),
        };
        if bsdfs.len() > 1 {
            self.report.warn(object, "of several materials the last counts");
        }
        let mut surface = self.surface(&bsdf)?;
        let emission = match emitters.last() {
            Some(emitter) => Some((self.area_light(emitter)?, Rc::clone(emitter))),
            None => None,
        };
        let inside = self.inside(object, &surface)?;
        let glow = emission.as_ref().and_then(|(radiance, _)| radiance.slot());
        let is_nothing = matches!(surface.base, Base::Null);
        if is_nothing && inside.is_none() {
            if emission.is_none() {
                // A null interface without emission has no effect, but its parameters are still checked.
                self.placed(object, Needs::default())?;
                return Ok(());
            }
            surface.base = Base::Diffuse(Paint::Plain(DVec3::ZERO));
            self.report.note(object, "emits, and light that should pass it ends there");
        }
        let inside = inside.unwrap_or_default();
        let mut finished = self.material(&bsdf, &surface, inside.clone(), glow.clone());
        let needs = finished.needs.with_bumps(surface.bump.is_some());
        let Placed { form, to_world, flip } = self.placed(object, needs)?;
        check_transform(object, &to_world)?;
        let look = Look { bsdf: &*bsdf, surface: &surface, fillings: [inside, Filling::default()], glow };
        let geometry = self.building().geometry(&**object, &look, (form, &to_world), &mut finished, needs);
        let emission = emission.map(|(radiance, _)| EmissionDescription {
            emitted: Emitted::Radiance(radiance.tint()),
            two_sided: false,
            photons: 1.0,
        });
        self.description.shapes.push(Named {
            name: object.name(),
            location: object.place.location.clone(),
            value: ShapeDescription {
                geometry,
                transform: to_world,
                flip_normal: flip,
                material: finished.number,
                caustic_photons: 1.0,
                illumination: None,
                emission,
                displacement: None,
                group,
            },
        });
        Ok(())
    }

    /// Radiance of an emitting surface.
    fn area_light(&mut self, object: &Rc<Object>) -> Result<Paint, Fault> {
        if object.plugin != "area" {
            let message = format!("{} cannot stand in a shape", object.label());
            return fail(&object.place, message, "surfaces emit by <emitter type=\"area\">");
        }
        let meaning = Meaning::Light { is_old: object.is_old };
        let radiance = self.paint(object, "radiance", 1.0, meaning)?;
        self.ignore(object, &["sampling_weight", "samples"], "lights are chosen by what they give");
        self.finish(object, &["radiance"])?;
        if let Paint::Vertices(_) = radiance {
            self.report.warn(object, "emission does not vary by the colours of vertices");
        }
        if luminance(radiance.mean()) == 0.0 {
            self.report.note(object, "gives no light");
        }
        Ok(radiance)
    }

    /// The interior of a shape; `None` where it names no medium.
    fn inside(&mut self, object: &Object, surface: &Surface) -> Result<Option<Filling>, Fault> {
        let mut found = None;
        let names = object
            .properties
            .iter()
            .filter(|property| matches!(property.value, Value::Object(_) | Value::Reference(_)));
        let mut media = Vec::new();
        for property in names {
            if let Some(medium) = self.object_of(property)?.filter(|medium| medium.tag == "medium") {
                property.mark();
                media.push((property.name.clone(), medium));
            }
        }
        for (side, medium) in media {
            if side == "exterior" {
                self.report.note(object, "the medium around it is that of the body that it is in");
                continue;
            }
            let is_passed = matches!(surface.base, Base::Null | Base::Glass { .. } | Base::Border(..));
            let inside = self.filling(&medium)?;
            if is_passed {
                found = inside;
            } else {
                self.report
                    .note(object, "the medium in it is left out: its surface is not the border of one here");
            }
        }
        Ok(found)
    }

    /// What a medium absorbs and scatters; `None` for an unsupported medium.
    fn filling(&mut self, object: &Rc<Object>) -> Result<Option<Filling>, Fault> {
        if object.plugin != "homogeneous" {
            self.report.warn(object, "media that vary in space are not modelled, and left out");
            return Ok(None);
        }
        let scale = object.float_or("scale", 1.0)?;
        let mut colour = |name: &str, usual: f64| self.plain_colour(object, name, usual, Meaning::Number);
        let (absorbed, scattered) = if object.has("sigma_a") || object.has("sigma_s") {
            (colour("sigma_a", 0.0)?, colour("sigma_s", 0.0)?)
        } else {
            let (extinction, albedo) = (colour("sigma_t", 1.0)?, colour("albedo", 0.75)?.min(DVec3::ONE));
            (extinction * (1.0 - albedo), extinction * albedo)
        };
        if let Some(name) = object.text("material")? {
            self.report
                .warn(object, format!("the material `{}` is not known: its numbers count", shown(name)));
        }
        let phase = self.phase(object)?;
        self.ignore(
            object,
            &["sample_emitters", "has_spectral_extinction", "strategy"],
            "sampling is another",
        );
        self.finish(object, &["scale", "sigma_a", "sigma_s", "sigma_t", "albedo"])?;
        let [absorbed, scattered] = [absorbed, scattered].map(|value| (value * scale).max(DVec3::ZERO));
        if scattered == DVec3::ZERO {
            return Ok(Some(Filling { absorption: absorbed, volume: None }));
        }
        match Coefficients::new(absorbed.as_vec3(), scattered.as_vec3()) {
            Ok(coefficients) => {
                let volume = Some(VolumeDescription::even(coefficients, phase));
                Ok(Some(Filling { absorption: DVec3::ZERO, volume }))
            }
            Err(error) => fail(&object.place, error.to_string(), "write coefficients that are finite"),
        }
    }

    /// The phase function of a medium.
    fn phase(&mut self, object: &Rc<Object>) -> Result<Phase, Fault> {
        let parts = self.parts(object, "phase")?;
        let Some(part) = parts.first() else { return Ok(Phase::Isotropic) };
        let phase = match part.plugin.as_str() {
            "isotropic" => Phase::Isotropic,
            "rayleigh" => Phase::Rayleigh,
            "hg" => {
                let g = part.float_or("g", 0.8)?;
                match Phase::henyey_greenstein(g as f32) {
                    Ok(phase) => phase,
                    Err(error) => return fail(&part.place, error.to_string(), "choose another `g`"),
                }
            }
            _ => {
                let text = format!(
                    "the phase function `{}` is not modelled: isotropic instead",
                    shown(&part.plugin)
                );
                self.report.warn(&**part, text);
                return Ok(Phase::Isotropic);
            }
        };
        self.finish(part, &["g"])?;
        Ok(phase)
    }

    /// The form of a shape, with the vertex data that its material needs.
    fn placed(&mut self, object: &Rc<Object>, needs: Needs) -> Result<Placed, Fault> {
        let to_world = object.transform("to_world")?;
        let flip = object.boolean("flip_normals", false)?;
        self.ignore(object, &["silhouette_sampling_weight"], "nothing is differentiated");
        let plugin = object.plugin.as_str();
        let with =
            |names: &[&'static str]| -> Vec<&'static str> { COMMON.iter().chain(names).copied().collect() };
        match plugin {
            "obj" | "ply" | "serialized" | "stl" => self.mesh_file(object, needs, to_world, flip),
            "sphere" => {
                let center = object.vector("center")?.unwrap_or(DVec3::ZERO);
                let radius = object.float_or("radius", 1.0)?;
                self.finish(object, &with(&["center", "radius"]))?;
                if !(radius > 0.0) {
                    return fail(&object.place, format!("a radius of {radius}"), "write a number above 0");
                }
                let form = if needs.any() {
                    self.report
                        .note(object, "is taken for a mesh of triangles, as pictures lie on meshes alone");
                    let own = DAffine3::from_translation(center) * DAffine3::from_scale(DVec3::splat(radius));
                    mesh(tessellate::sphere().moved(&own))
                } else {
                    Form::Exact(GeometryDescription::Sphere { center, radius })
                };
                Ok(Placed { form, to_world, flip })
            }
            "rectangle" => {
                self.finish(object, &COMMON)?;
                let form = if needs.any() {
                    mesh(tessellate::rectangle())
                } else {
                    Form::Exact(GeometryDescription::Quad {
                        corner: DVec3::new(-1.0, -1.0, 0.0),
                        edge_u: DVec3::new(2.0, 0.0, 0.0),
                        edge_v: DVec3::new(0.0, 2.0, 0.0),
                    })
                };
                Ok(Placed { form, to_world, flip })
            }
            "disk" => {
                self.finish(object, &COMMON)?;
                let form = if needs.any() || is_distorted(&to_world) {
                    self.report.note(object, "is taken for a mesh of triangles, as pictures lie on meshes alone, and exact discs are round");
                    mesh(tessellate::disk())
                } else {
                    Form::Exact(GeometryDescription::Disc {
                        center: DVec3::ZERO,
                        normal: DVec3::Z,
                        radius: 1.0,
                    })
                };
                Ok(Placed { form, to_world, flip })
            }
            "cube" => {
                self.finish(object, &COMMON)?;
                Ok(Placed { form: mesh(tessellate::cube()), to_world, flip })
            }
            "cylinder" => {
                let base = object.vector("p0")?.unwrap_or(DVec3::ZERO);
                let top = object.vector("p1")?.unwrap_or(DVec3::Z);
                let radius = object.float_or("radius", 1.0)?;
                self.finish(object, &with(&["p0", "p1", "radius"]))?;
                let axis = top - base;
                if !(radius > 0.0 && axis.length() > 0.0) {
                    let remedy = "give it a radius above 0 and two different ends";
                    return fail(&object.place, "a cylinder without extent", remedy);
                }
                let form = if needs.any() || is_distorted(&to_world) {
                    self.report.note(object, "is taken for a mesh of triangles, as pictures lie on meshes alone, and exact cylinders are round");
                    let along = axis.normalize();
                    let (x, y) = along.any_orthonormal_pair();
                    let own =
                        DAffine3::from_mat3_translation(DMat3::from_cols(x * radius, y * radius, axis), base);
                    mesh(tessellate::cylinder().moved(&own))
                } else {
                    Form::Exact(GeometryDescription::Cylinder { base, top, radius })
                };
                Ok(Placed { form, to_world, flip })
            }
            "hair" | "bsplinecurve" | "linearcurve" | "heightfield" | "sdfgrid" | "ellipsoids"
            | "ellipsoidsmesh" | "deformable" => fail(
                &object.place,
                format!("the shape `{plugin}` is not modelled"),
                "export it as a mesh (PLY or OBJ), or take it out",
            ),
            other => {
                let known = [
                    "obj",
                    "ply",
                    "serialized",
                    "sphere",
                    "rectangle",
                    "disk",
                    "cube",
                    "cylinder",
                    "shapegroup",
                    "instance",
                ];
                fail(
                    &object.place,
                    format!("the shape `{}` is not known", shown(other)),
                    suggestion(other, &known),
                )
            }
        }
    }

    fn mesh_file(
        &mut self,
        object: &Rc<Object>,
        needs: Needs,
        to_world: DAffine3,
        flip: bool,
    ) -> Result<Placed, Fault> {
        let plugin = object.plugin.as_str();
        let path = self.file(object, "filename")?;
        let is_flat = object.boolean("face_normals", false)?;
        let flips_v = object.boolean("flip_tex_coords", plugin == "obj")?;
        if let Some(angle) = object.float("max_smooth_angle")? {
            self.report.note(
                object,
                format!("edges sharper than {angle} degrees are smooth too where the file has no normals"),
            );
        }
        let known =
            ["filename", "face_normals", "flip_tex_coords", "shape_index", "to_world", "flip_normals"];
        let shape = object.integer("shape_index")?.unwrap_or(0);
        self.ignore(object, &["srgb", "collapse", "load_materials"], "the materials of the scene count");
        self.finish(object, &known)?;
        let told = |error: &dyn std::fmt::Display| {
            fail(&object.place, format!("the mesh of {} cannot be read: {error}", object.label()), "")
        };
        let is_named = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(plugin));
        if plugin != "serialized" && is_named && !needs.any() {
            // Normals determine the front side, as in Mitsuba; they are computed where there are none.
            let normals = if is_flat { MeshNormals::Flat } else { MeshNormals::Leading };
            return Ok(Placed { form: Form::File { path, normals }, to_world, flip });
        }
        foresee((&mut self.taken, self.allow), &**object, &path)?;
        let reading = MeshReading {
            normals: !is_flat,
            uvs: needs.coordinates,
            colours: needs.colours,
            ..MeshReading::ALL
        };
        let (mut mesh, colours) = match plugin {
            "obj" => match read_obj_with(&path, &reading, |_| true) {
                Ok(mut obj) => {
                    let colours = obj.colours.take();
                    (obj.into_mesh().0, colours)
                }
                Err(error) => return told(&error),
            },
            "ply" => match read_ply_model(&path, &reading) {
                Ok(model) => (model.mesh, model.colours),
                Err(error) => return told(&error),
            },
            "stl" => match crate::scene_file::read_stl(&path) {
                Ok((mesh, _)) => (mesh, None),
                Err(error) => return told(&error),
            },
            _ => match serialized::read(&path, shape) {
                Ok(serialized) => (serialized, None),
                Err(problem) => return told(&problem),
            },
        };
        if is_flat {
            mesh.normals = None;
        } else {
            mesh.follow_normals();
        }
        if let (Some(uvs), true) = (&mut mesh.uvs, flips_v) {
            uvs.iter_mut().for_each(|uv| *uv = Vec2::new(uv.x, 1.0 - uv.y));
        }
        let colours = colours.unwrap_or_default().into_iter().map(|colour| colour.extend(1.0)).collect();
        Ok(Placed { form: Form::Mesh { mesh, colours }, to_world, flip })
    }
}

fn check_transform(object: &Object, transform: &DAffine3) -> Result<(), Fault> {
    let determinant = transform.matrix3.determinant();
    if determinant != 0.0 && determinant.is_finite() {
        return Ok(());
    }
    let place = object.get("to_world").map_or(&object.place, |property| &property.place);
    fail(
        place,
        format!("the transform of {} flattens everything", object.label()),
        "give it a scale that is not zero",
    )
}
