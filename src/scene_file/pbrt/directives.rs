//! The directives of a scene: blocks, transforms, and what they define.

use super::colour::space_named;
use super::error::{Fault, Place, fail};
use super::file::File;
use super::object::{Object, Parameter};
use super::state::{Block, Chosen, DEEPEST_BLOCK, DEFAULTS, State};
use super::text::shown;
use super::transform::{inverse_look_at, matrix};
use super::{DEEPEST_INCLUDE, Importer, MOST_INCLUDES};
use crate::scene_file::description::{InstanceDescription, Named};
use crate::scene_file::diagnostic::suggestion;
use glam::{DAffine3, DVec3};
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::Arc;

/// All directives, for messages.
const DIRECTIVES: [&str; 37] = [
    "Accelerator",
    "ActiveTransform",
    "AreaLightSource",
    "Attribute",
    "AttributeBegin",
    "AttributeEnd",
    "Camera",
    "ColorSpace",
    "ConcatTransform",
    "CoordSysTransform",
    "CoordinateSystem",
    "Film",
    "Identity",
    "Import",
    "Include",
    "Integrator",
    "LightSource",
    "LookAt",
    "MakeNamedMaterial",
    "MakeNamedMedium",
    "Material",
    "MediumInterface",
    "NamedMaterial",
    "ObjectBegin",
    "ObjectEnd",
    "ObjectInstance",
    "Option",
    "PixelFilter",
    "ReverseOrientation",
    "Rotate",
    "Sampler",
    "Scale",
    "Shape",
    "Texture",
    "Transform",
    "Translate",
    "WorldBegin",
];

impl Importer<'_> {
    /// Reads a text to its end, with the files that it includes.
    pub(super) fn text(&mut self, path: PathBuf, text: String) -> Result<(), Fault> {
        let text = Arc::new(text);
        let number = self.sources.add(path.clone(), Arc::clone(&text));
        let mut file = File::new(&text, &path, number);
        while let Some((word, place)) = file.directive()? {
            if self.is_over {
                self.report
                    .warn_at(&place, "what stands behind WorldEnd is left out: one picture is rendered");
                break;
            }
            let is_known = self.transform(&mut file, word, &place)?
                || self.block(&mut file, word, &place)?
                || self.option(&mut file, word, &place)?
                || self.definition(&mut file, word, &place)?;
            if !is_known {
                let message = format!("`{}` is no directive", shown(word));
                return fail(&place, message, suggestion(word, &DIRECTIVES));
            }
        }
        Ok(())
    }

    /// Applies a directive that changes the transform; false for others.
    fn transform(&mut self, file: &mut File<'_>, word: &str, place: &Place) -> Result<bool, Fault> {
        let ctm = self.state.ctm;
        let changed = match word {
            "Identity" => DAffine3::IDENTITY,
            "Translate" => ctm * DAffine3::from_translation(DVec3::from_array(file.numbers(word, place)?)),
            "Scale" => ctm * DAffine3::from_scale(DVec3::from_array(file.numbers(word, place)?)),
            "Rotate" => {
                let [angle, x, y, z] = file.numbers(word, place)?;
                let Some(axis) = crate::math::unit_f64(DVec3::new(x, y, z)) else {
                    return fail(
                        place,
                        "the axis of the rotation is zero",
                        "write for example Rotate 90 0 1 0",
                    );
                };
                ctm * DAffine3::from_axis_angle(axis, angle.to_radians())
            }
            "LookAt" => {
                let [ex, ey, ez, ax, ay, az, ux, uy, uz] = file.numbers(word, place)?;
                let points = [DVec3::new(ex, ey, ez), DVec3::new(ax, ay, az), DVec3::new(ux, uy, uz)];
                ctm * inverse_look_at(points, place)?
            }
            "Transform" => matrix(file.numbers(word, place)?, place)?,
            "ConcatTransform" => ctm * matrix(file.numbers(word, place)?, place)?,
            "CoordSysTransform" => {
                let name = file.quoted(place, "the name of a coordinate system")?;
                match self.systems.get(&name) {
                    Some(system) => *system,
                    None => {
                        let mut names: Vec<&str> = self.systems.keys().map(String::as_str).collect();
                        names.sort_unstable();
                        let message = format!("there is no coordinate system `{}`", shown(&name));
                        return fail(place, message, suggestion(&name, &names));
                    }
                }
            }
            "CoordinateSystem" => {
                let name = file.quoted(place, "the name of a coordinate system")?;
                self.systems.insert(name, ctm);
                return Ok(true);
            }
            "ActiveTransform" => {
                self.state.is_active = match file.word(place, "StartTime, EndTime or All")? {
                    "StartTime" | "All" => true,
                    "EndTime" => false,
                    other => {
                        let known = suggestion(other, &["StartTime", "EndTime", "All"]);
                        return fail(place, format!("`{}` is no time", shown(other)), known);
                    }
                };
                return Ok(true);
            }
            "TransformTimes" => {
                let [_, _] = file.numbers(word, place)?;
                return Ok(true);
            }
            _ => return Ok(false),
        };
        if !self.state.is_active {
            self.report.warn_at(place, "nothing moves: transforms for EndTime are left out");
            return Ok(true);
        }
        if !changed.is_finite() {
            return fail(place, "the transform is out of range", "use smaller numbers");
        }
        self.state.ctm = changed;
        Ok(true)
    }

    /// Opens or closes a block; false for other directives.
    fn block(&mut self, file: &mut File<'_>, word: &str, place: &Place) -> Result<bool, Fault> {
        match word {
            "AttributeBegin" => self.open(Block::Attribute, place)?,
            "AttributeEnd" => self.close(Block::Attribute, place)?,
            "TransformBegin" => self.open(Block::Transform, place)?,
            "TransformEnd" => {
                let state = self.state.clone();
                self.close(Block::Transform, place)?;
                if self.is_old {
                    // Only the transform ends there; in pbrt-v4 everything.
                    self.state = State { ctm: self.state.ctm, is_active: self.state.is_active, ..state };
                }
            }
            "ObjectBegin" => {
                let name = file.quoted(place, "the name of an object")?;
                self.open(Block::Object, place)?;
                if self.group.is_some() {
                    return fail(
                        place,
                        format!("the object `{}` stands in another", shown(&name)),
                        "close the other by ObjectEnd before it",
                    );
                }
                if self.groups.contains_key(&name) {
                    let message = format!("there is an object `{}` already", shown(&name));
                    return fail(place, message, "give it another name");
                }
                let number = self.description.groups.len();
                let location = place.location.clone();
                self.description.groups.push(Named { name: shown(&name), location, value: () });
                self.groups.insert(name, number);
                self.group = Some(number);
            }
            "ObjectEnd" => {
                self.close(Block::Object, place)?;
                self.group = None;
            }
            "WorldBegin" => {
                if self.in_world {
                    return fail(place, "a second WorldBegin", "take it out: a file holds one scene");
                }
                self.in_world = true;
                self.state.ctm = DAffine3::IDENTITY;
                self.state.is_active = true;
                self.systems.insert("world".to_owned(), DAffine3::IDENTITY);
            }
            "WorldEnd" => {
                self.in_the_world(word, place)?;
                self.is_over = true;
            }
            "ReverseOrientation" => {
                self.in_the_world(word, place)?;
                self.state.reverse = !self.state.reverse;
            }
            "Include" => self.include(file, word, place)?,
            "Import" => {
                self.in_the_world(word, place)?;
                let state = self.state.clone();
                self.include(file, word, place)?;
                self.state = state;
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    fn open(&mut self, block: Block, place: &Place) -> Result<(), Fault> {
        self.in_the_world(block.begin(), place)?;
        if self.blocks.len() >= DEEPEST_BLOCK {
            let message = format!("blocks are nested deeper than {DEEPEST_BLOCK}");
            return fail(place, message, "close them by AttributeEnd");
        }
        self.blocks.push((block, self.state.clone(), place.clone()));
        Ok(())
    }

    fn close(&mut self, block: Block, place: &Place) -> Result<(), Fault> {
        match self.blocks.pop() {
            Some((opened, state, _)) if opened == block => {
                self.state = state;
                Ok(())
            }
            Some((opened, _, at)) => {
                let message =
                    format!("{} closes the {} of line {}", block.end(), opened.begin(), at.location.line);
                fail(place, message, format!("write {} before it", opened.end()))
            }
            None => fail(
                place,
                format!("{} without {}", block.end(), block.begin()),
                "take it out, or open the block before it",
            ),
        }
    }

    /// Refuses a directive that must stand behind WorldBegin.
    fn in_the_world(&self, word: &str, place: &Place) -> Result<(), Fault> {
        if self.in_world {
            return Ok(());
        }
        fail(place, format!("{word} stands before WorldBegin"), "write WorldBegin before it")
    }

    fn include(&mut self, file: &mut File<'_>, word: &str, place: &Place) -> Result<(), Fault> {
        let name = file.quoted(place, "the name of a file")?;
        let path = self.path_of(&name, place)?;
        self.includes += 1;
        if self.includes > MOST_INCLUDES || self.depth >= DEEPEST_INCLUDE {
            return fail(place, "too many files include each other", "does a file include itself?");
        }
        let open = self.blocks.len();
        self.depth += 1;
        let text = self.text_of_file(&path, place)?;
        self.text(path, text)?;
        self.depth -= 1;
        if word == "Import" && self.blocks.len() != open {
            let message = format!("`{}` opens blocks that it does not close, or closes others", shown(&name));
            return fail(place, message, "use Include, or close them in it");
        }
        Ok(())
    }

    /// Reads a directive about the view or the computation; false for others.
    fn option(&mut self, file: &mut File<'_>, word: &str, place: &Place) -> Result<bool, Fault> {
        let directive = match word {
            "Camera" => "Camera",
            "Film" => "Film",
            "PixelFilter" => "PixelFilter",
            "Sampler" => "Sampler",
            "Integrator" => "Integrator",
            "SurfaceIntegrator" => "SurfaceIntegrator",
            "VolumeIntegrator" => "VolumeIntegrator",
            "Accelerator" => "Accelerator",
            "Option" => {
                let parameters = file.parameters()?;
                let names: Vec<String> = parameters.iter().map(|p| format!("`{}`", shown(&p.name))).collect();
                self.report.note_at(place, format!("Option {} has no effect", names.join(", ")));
                return Ok(true);
            }
            "ColorSpace" => {
                let name = file.quoted(place, "the name of a colour space")?;
                self.state.space = space_named(&name, place)?;
                return Ok(true);
            }
            _ => return Ok(false),
        };
        if self.in_world {
            return fail(place, format!("{word} stands behind WorldBegin"), "move it before WorldBegin");
        }
        let kind = file.quoted(place, "a type")?;
        let object = self.object(file, (directive, kind, None), place, None)?;
        match directive {
            "Camera" => {
                self.systems.insert("camera".to_owned(), self.state.ctm.inverse());
                let outside = self.state.outside.clone();
                self.camera = Some((object, self.state.ctm, outside));
            }
            "Film" => self.film(&object)?,
            "PixelFilter" => self.filter(&object)?,
            "Sampler" => self.sampler(&object)?,
            "Accelerator" => {
                // How rays find surfaces is no part of the picture.
                object.unread();
            }
            _ => self.integrator(&object)?,
        }
        Ok(true)
    }

    /// Reads a directive about the world; false for others.
    fn definition(&mut self, file: &mut File<'_>, word: &str, place: &Place) -> Result<bool, Fault> {
        match word {
            "MediumInterface" => {
                let inside = file.quoted(place, "the name of a medium")?;
                let outside = file.more_quoted()?;
                self.state.outside = outside.unwrap_or_else(|| inside.clone());
                self.state.inside = inside;
                return Ok(true);
            }
            "MakeNamedMedium" => {
                let name = file.quoted(place, "the name of a medium")?;
                let object = self.typed(file, ("MakeNamedMedium", &name), place, "medium", "homogeneous")?;
                self.media.insert(name, object);
                return Ok(true);
            }
            "Attribute" => {
                let target = file.quoted(place, "shape, light, material, medium or texture")?;
                let Some(index) = DEFAULTS.iter().position(|known| *known == target) else {
                    let message = format!("there are no parameters of `{}` to set", shown(&target));
                    return fail(place, message, suggestion(&target, &DEFAULTS));
                };
                let mut parameters = self.in_space(file.parameters()?);
                parameters.iter_mut().for_each(|parameter| parameter.is_default = true);
                let mut all = (*self.state.defaults[index]).clone();
                all.extend(parameters.into_iter().map(Rc::new));
                if all.len() > super::state::MOST_DEFAULTS {
                    return fail(place, "too many parameters by Attribute", "set them where they are used");
                }
                self.state.defaults[index] = Rc::new(all);
                return Ok(true);
            }
            _ => {}
        }
        let known = [
            "Material",
            "NamedMaterial",
            "MakeNamedMaterial",
            "Texture",
            "AreaLightSource",
            "LightSource",
            "Shape",
            "ObjectInstance",
        ];
        if !known.contains(&word) {
            return Ok(false);
        }
        self.in_the_world(word, place)?;
        let name = file.quoted(place, "a name or a type")?;
        match word {
            "Material" => {
                let object = self.object(file, ("Material", name, None), place, Some("material"))?;
                self.state.material = Chosen::Object(object);
            }
            "NamedMaterial" => self.state.material = Chosen::Named(name, place.clone()),
            "MakeNamedMaterial" => {
                let object = self.typed(file, ("MakeNamedMaterial", &name), place, "material", "")?;
                self.materials.insert(name, object);
            }
            "Texture" => self.texture_definition(file, name, place)?,
            "AreaLightSource" => {
                let object = self.object(file, ("AreaLightSource", name, None), place, Some("light"))?;
                self.state.area_light = Some(object);
            }
            "LightSource" => {
                let object = self.object(file, ("LightSource", name, None), place, Some("light"))?;
                self.light(&object)?;
            }
            "Shape" => {
                let object = self.object(file, ("Shape", name, None), place, Some("shape"))?;
                self.shape(&object)?;
            }
            _ => self.instance(name, place)?,
        }
        Ok(true)
    }

    fn texture_definition(&mut self, file: &mut File<'_>, name: String, place: &Place) -> Result<(), Fault> {
        let kind = file.quoted(place, "`float` or `spectrum`")?;
        let is_float = match kind.as_str() {
            "float" => true,
            "spectrum" | "color" | "rgb" => false,
            other => {
                let message = format!("the texture `{}` is of type `{}`", shown(&name), shown(other));
                return fail(place, message, suggestion(other, &["float", "spectrum"]));
            }
        };
        let class = file.quoted(place, "the class of a texture, such as `imagemap`")?;
        let object = self.object(file, ("Texture", class, Some(name.clone())), place, Some("texture"))?;
        self.textures.insert((is_float, name), object);
        Ok(())
    }

    fn instance(&mut self, name: String, place: &Place) -> Result<(), Fault> {
        if self.group.is_some() {
            let message = format!("an instance of `{}` stands in an object", shown(&name));
            return fail(place, message, "objects hold shapes: place the instance behind ObjectEnd");
        }
        self.instances.push((name, self.state.ctm, place.clone()));
        Ok(())
    }

    /// Adds the instances, whose objects are known now.
    pub(super) fn place_instances(&mut self) -> Result<(), Fault> {
        for (name, transform, place) in std::mem::take(&mut self.instances) {
            let Some(&group) = self.groups.get(&name) else {
                let mut names: Vec<&str> = self.groups.keys().map(String::as_str).collect();
                names.sort_unstable();
                let message = format!("there is no object `{}`", shown(&name));
                return fail(&place, message, suggestion(&name, &names));
            };
            super::transform::check(&transform, &place)?;
            self.description.instances.push(Named {
                name: shown(&name),
                location: place.location,
                value: InstanceDescription { group, transform },
            });
        }
        Ok(())
    }

    /// Parameters with the colour space that holds here.
    fn in_space(&self, mut parameters: Vec<Parameter>) -> Vec<Parameter> {
        parameters.iter_mut().for_each(|parameter| parameter.space = self.state.space);
        parameters
    }

    /// Reads the parameters of an object.
    fn object(
        &mut self,
        file: &mut File<'_>,
        (directive, kind, id): (&'static str, String, Option<String>),
        place: &Place,
        target: Option<&str>,
    ) -> Result<Rc<Object>, Fault> {
        let own = self.in_space(file.parameters()?);
        if own.iter().any(|parameter| matches!(parameter.kind, "color" | "xyz")) {
            self.is_old = true;
        }
        let index = target.and_then(|target| DEFAULTS.iter().position(|known| *known == target));
        let mut parameters = index.map_or_else(Vec::new, |index| (*self.state.defaults[index]).clone());
        parameters.extend(own.into_iter().map(Rc::new));
        self.serial += 1;
        Ok(Rc::new(Object { serial: self.serial, directive, kind, id, parameters, place: place.clone() }))
    }

    /// Reads an object whose type is a parameter.
    fn typed(
        &mut self,
        file: &mut File<'_>,
        (directive, name): (&'static str, &str),
        place: &Place,
        target: &str,
        usual: &str,
    ) -> Result<Rc<Object>, Fault> {
        let of = (directive, String::new(), Some(name.to_owned()));
        let mut object = self.object(file, of, place, Some(target))?;
        let kind = match object.text("type")? {
            Some(kind) => kind.to_owned(),
            None if usual.is_empty() => {
                let message = format!("{directive} `{}` has no type", shown(name));
                return fail(place, message, "write for example \"string type\" \"diffuse\"");
            }
            None => usual.to_owned(),
        };
        if let Some(object) = Rc::get_mut(&mut object) {
            object.kind = kind;
        }
        Ok(object)
    }
}
