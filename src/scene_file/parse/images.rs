//! Image textures: `type = "image"` in `[textures.NAME]`, and the slots of materials that take one in place of a colour or a number.

use super::names::Names;
use crate::scene_file::import::paint::{Amount, Paint, Use};
use crate::scene_file::import::pictures::Pictures;
use crate::scene_file::reader::{Context, Expected, FRACTION, NUMBER, Table, Value};
use crate::textures::{Sampler, TextureSlot, Wrap};
use glam::{Affine2, DVec3, Mat2, Vec2};
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::ops::Range;
use std::path::PathBuf;

const REPEAT: Expected = Expected { what: "a number other than 0", example: "2.0", holds: |x| x != 0.0 };

/// An image and how it lies on surfaces.
struct Entry {
    path: PathBuf,
    /// Whether its numbers are used as they are; none where its file decides.
    is_linear: Option<bool>,
    sampler: Sampler,
    transform: Affine2,
}

/// The image textures of a scene, by name. An image is read when a material first uses it.
pub(super) struct Images {
    names: Names,
    /// In the order of the names; none for one with errors.
    entries: Vec<Option<Entry>>,
    pictures: RefCell<Pictures>,
    /// Files of the images that materials use.
    used: RefCell<BTreeSet<PathBuf>>,
}

impl Images {
    pub(super) fn new() -> Self {
        Self {
            names: Names::new("image texture"),
            entries: Vec::new(),
            pictures: RefCell::default(),
            used: RefCell::default(),
        }
    }

    /// Whether an image has this name.
    pub(super) fn has(&self, name: &str) -> bool {
        self.names.has(name)
    }

    /// Adds the image that a table describes.
    pub(super) fn add(&mut self, context: &Context<'_>, name: &str, span: &Range<usize>, table: Table<'_>) {
        if self.names.declare(context, name, span).is_some() {
            self.entries.push(read_entry(table));
        }
    }

    /// Files of the images that materials use.
    pub(super) fn files(&self) -> Vec<PathBuf> {
        self.used.borrow().iter().cloned().collect()
    }

    pub(super) fn warn_unused(&self, context: &Context<'_>) {
        self.names.warn_unused(context, "is used by no material");
    }

    /// The image that a value names, converted for its use.
    fn slot(&self, value: Value<'_>, how: Use) -> Option<TextureSlot> {
        let entry = self.entries[self.names.find(value)?].as_ref()?;
        // Numbers are no colours: they are as the file has them, unless the texture says otherwise.
        let is_raw = entry.is_linear.unwrap_or(how != Use::Colour);
        match self.pictures.borrow_mut().read(&entry.path, how, is_raw) {
            Ok((texture, _)) => {
                self.used.borrow_mut().insert(entry.path.clone());
                Some(TextureSlot { texture, sampler: entry.sampler, set: 0, transform: entry.transform })
            }
            Err(error) => {
                let message = format!("`{}`: {} cannot be read: {error}", value.name(), entry.path.display());
                value.context().error(&value.span(), message, "name a picture: PNG, JPEG, EXR and others");
                None
            }
        }
    }

    /// A colour, or `{ texture = "NAME" }` with an optional `factor`.
    pub(super) fn paint(&self, value: Value<'_>) -> Option<Paint> {
        if !value.is_table() {
            return value.colour(&FRACTION).map(Paint::Plain);
        }
        let mut table = value.table(format!("`{}`", value.name()), "")?;
        let slot = table.required("texture", "\"NAME\"", |value| self.slot(value, Use::Colour));
        let factor = table.or("factor", DVec3::ONE, |value| value.colour(&FRACTION));
        table.finish();
        Some(Paint::Picture(slot?, factor?))
    }

    /// A number in a range, or `{ texture = "NAME" }`.
    pub(super) fn amount(&self, value: Value<'_>, range: &Expected, how: Use) -> Option<Amount> {
        if !value.is_table() {
            return value.number(range).map(Amount::Plain);
        }
        let mut table = value.table(format!("`{}`", value.name()), "")?;
        let slot = table.required("texture", "\"NAME\"", |value| self.slot(value, how));
        table.finish();
        slot.map(Amount::Picture)
    }

    /// A normal map and the factor on its slopes: a name, or `{ texture = "NAME", scale = 1.0 }`.
    pub(super) fn normals(&self, value: Value<'_>) -> Option<(TextureSlot, f32)> {
        if !value.is_table() {
            return self.slot(value, Use::Raw).map(|slot| (slot, 1.0));
        }
        let mut table = value.table(format!("`{}`", value.name()), "")?;
        let slot = table.required("texture", "\"NAME\"", |value| self.slot(value, Use::Raw));
        let scale = table.or("scale", 1.0, |value| value.number(&NUMBER));
        table.finish();
        Some((slot?, scale? as f32))
    }
}

fn read_entry(mut table: Table<'_>) -> Option<Entry> {
    table.get("type");
    let path = table.required("file", "\"wood.png\"", super::lights::read_file);
    let encodings = [("srgb", false), ("linear", true)];
    let is_linear = table.optional("encoding", |value| value.choice(&encodings));
    let wraps = [("repeat", Wrap::Repeat), ("mirror", Wrap::Mirror), ("clamp", Wrap::Clamp)];
    let wrap = table.or("wrap", Wrap::Repeat, |value| value.choice(&wraps));
    let nearest = table.or("filter", false, |value| value.choice(&[("smooth", false), ("nearest", true)]));
    let repeat = table.or("repeat", [1.0; 2], |value| value.pair(&REPEAT, "[2, 2]"));
    let offset = table.or("offset", [0.0; 2], |value| value.pair(&NUMBER, "[0.5, 0.0]"));
    let rotate = table.or("rotate", 0.0, |value| value.number(&NUMBER));
    table.finish();
    let vector = |[x, y]: [f64; 2]| Vec2::new(x as f32, y as f32);
    // Coordinates have v downwards, where the file has it upwards: the lower left corner stays where it is.
    let flip = Affine2::from_mat2_translation(Mat2::from_diagonal(Vec2::new(1.0, -1.0)), Vec2::Y);
    let turn = (rotate?.to_radians()) as f32;
    let placed = Affine2::from_scale_angle_translation(Vec2::ONE, -turn, -vector(offset?));
    let scaled = Affine2::from_scale(vector(repeat?));
    Some(Entry {
        path: path?,
        is_linear: is_linear?,
        sampler: Sampler { wrap: [wrap?; 2], nearest: nearest?, finest: false },
        transform: flip * scaled * placed * flip,
    })
}
