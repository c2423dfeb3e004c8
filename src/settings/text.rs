//! Comments of declarations as texts for people, and values as they are written.

use super::choices::{
    Choices, Estimator, GuideKind, IntegratorKind, Kernel, MapKind, Quality, SearchRegion, ShadowMode, Show,
    Wavelengths,
};
use super::kind::Asked;
use std::fmt::Debug;

/// The paragraphs of a comment, each in one line.
pub(super) fn paragraphs(comment: &str) -> Vec<String> {
    let mut found = vec![String::new()];
    for line in comment.lines().map(str::trim) {
        match found.last_mut() {
            Some(last) if !line.is_empty() => {
                if !last.is_empty() {
                    last.push(' ');
                }
                last.push_str(line);
            }
            _ => found.push(String::new()),
        }
    }
    found.retain(|paragraph| !paragraph.is_empty());
    found
}

/// The type of a setting's field.
pub(super) trait Field: Copy + Debug {
    /// As users write it; empty where there is none.
    fn text(&self) -> String;

    /// Equal for equal values alone, for keys of what depends on them.
    fn key(&self) -> String {
        format!("{self:?}")
    }
}

impl Field for bool {
    fn text(&self) -> String {
        self.to_string()
    }
}

impl Field for u32 {
    fn text(&self) -> String {
        self.to_string()
    }
}

impl Field for u64 {
    fn text(&self) -> String {
        self.to_string()
    }
}

impl Field for f32 {
    fn text(&self) -> String {
        self.to_string()
    }

    fn key(&self) -> String {
        self.to_bits().to_string()
    }
}

impl Field for f64 {
    fn text(&self) -> String {
        self.to_string()
    }

    fn key(&self) -> String {
        self.to_bits().to_string()
    }
}

impl<T: Field> Field for Option<T> {
    fn text(&self) -> String {
        self.as_ref().map(T::text).unwrap_or_default()
    }

    fn key(&self) -> String {
        self.as_ref().map_or_else(|| "None".to_owned(), |value| format!("Some({})", value.key()))
    }
}

/// What a field may be asked for.
pub(super) trait FromAsked: Sized {
    /// The value; `None` where `asked` is of another kind or beyond the type.
    fn from_asked(asked: Asked) -> Option<Self>;
}

macro_rules! from_asked {
    ($($type:ty, $asked:pat => $value:expr;)+) => {$(
        impl FromAsked for $type {
            fn from_asked(asked: Asked) -> Option<Self> {
                if let $asked = asked { $value } else { None }
            }
        }
    )+};
}

from_asked! {
    bool, Asked::Flag(value) => Some(value);
    u32, Asked::Count(value) => Self::try_from(value).ok();
    u64, Asked::Count(value) => Some(value);
    f32, Asked::Number(value) => Some(value as Self);
    f64, Asked::Number(value) => Some(value);
}

macro_rules! choice_fields {
    ($($type:ty),+) => {$(
        impl Field for $type {
            fn text(&self) -> String {
                self.name().to_owned()
            }
        }

        impl FromAsked for $type {
            fn from_asked(asked: Asked) -> Option<Self> {
                if let Asked::Choice(name, parameter) = asked { Self::named(name, parameter) } else { None }
            }
        }
    )+};
}

choice_fields!(
    Quality,
    IntegratorKind,
    MapKind,
    ShadowMode,
    GuideKind,
    Show,
    Estimator,
    SearchRegion,
    Wavelengths,
    Kernel
);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_have_paragraphs() {
        assert_eq!(paragraphs(" One\n two.\n\n Three.\n"), ["One two.", "Three."]);
        assert!(paragraphs("\n").is_empty());
    }

    #[test]
    fn keys_tell_values_apart() {
        assert_eq!((0.1f32 + 0.2).key() == 0.3f32.key(), (0.1f32 + 0.2).to_bits() == 0.3f32.to_bits());
        assert_eq!(
            (Some(2.0f64).key(), None::<f64>.key()),
            (format!("Some({})", 2.0f64.to_bits()), "None".to_owned())
        );
        assert_eq!(Estimator::Corrected.key(), "Corrected");
    }
}
