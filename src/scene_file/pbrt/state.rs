//! What directives set for those that follow.

use super::error::Place;
use super::object::{Object, Parameter};
use glam::{DAffine3, DMat3};
use std::rc::Rc;

/// Deepest nesting of blocks.
pub(super) const DEEPEST_BLOCK: usize = 1024;

/// Objects that take parameters from `Attribute`.
pub(super) const DEFAULTS: [&str; 5] = ["shape", "light", "material", "medium", "texture"];

/// Most parameters by `Attribute` for one kind of objects.
pub(super) const MOST_DEFAULTS: usize = 256;

/// A kind of block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Block {
    Attribute,
    Transform,
    Object,
}

impl Block {
    pub(super) fn begin(self) -> &'static str {
        match self {
            Self::Attribute => "AttributeBegin",
            Self::Transform => "TransformBegin",
            Self::Object => "ObjectBegin",
        }
    }

    pub(super) fn end(self) -> &'static str {
        match self {
            Self::Attribute => "AttributeEnd",
            Self::Transform => "TransformEnd",
            Self::Object => "ObjectEnd",
        }
    }
}

/// The material of the shapes that follow.
#[derive(Clone, Debug)]
pub(super) enum Chosen {
    Object(Rc<Object>),
    Named(String, Place),
}

/// What holds for the directives that follow.
#[derive(Clone, Debug)]
pub(super) struct State {
    /// From the space of objects to the world; before `WorldBegin`, from the world to the camera.
    pub ctm: DAffine3,
    /// Whether directives change the transform at the start of the exposure.
    pub is_active: bool,
    /// Whether normals are reversed.
    pub reverse: bool,
    pub material: Chosen,
    pub area_light: Option<Rc<Object>>,
    /// Names of the media on both sides of surfaces; empty for none.
    pub inside: String,
    pub outside: String,
    /// From the colour space of `rgb` parameters to linear Rec. 709; `None` where it is that.
    pub space: Option<DMat3>,
    /// Parameters by `Attribute`, in the order of [`DEFAULTS`].
    pub defaults: [Rc<Vec<Rc<Parameter>>>; 5],
}
