//! Fields by name: a path such as `linear.x` is resolved once, then a check is an offset load.
#![allow(unsafe_code, reason = "address of unsafe: loads at described offsets")]

use super::descriptor::{Kind, TypeDescriptor};
use super::sequence::RawSequence;

/// Where the numbers of a field lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FieldPath {
    offset: usize,
    kind: Kind,
    shape: Shape,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shape {
    One,
    Array(usize),
    Sequence,
}

/// Why a path leads nowhere.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PathError {
    /// No such field; these are there.
    Unknown {
        /// The part of the path that was not found.
        part: String,
        /// The fields at that place.
        known: Vec<String>,
    },
    /// The field is no number, nor an array or sequence of numbers.
    NoNumber,
}

impl FieldPath {
    /// Resolves a path; the empty one names the object itself.
    ///
    /// # Errors
    /// When a part names no field, or the field holds no numbers.
    pub fn resolve(descriptor: &'static TypeDescriptor, path: &str) -> Result<Self, PathError> {
        let mut offset = 0;
        let mut object = descriptor;
        for part in path.split('.').filter(|part| !part.is_empty()) {
            let field = object.fields.iter().find(|field| field.name.as_str() == part).ok_or_else(|| {
                let known = object.fields.iter().map(|field| field.name.to_string()).collect();
                PathError::Unknown { part: part.to_owned(), known }
            })?;
            offset += field.offset;
            object = field.object;
        }
        let (shape, element) = match (object.kind, object.element()) {
            (Kind::Array, Some(element)) => (Shape::Array(object.count), element),
            (Kind::Sequence, Some(element)) => (Shape::Sequence, element),
            _ => (Shape::One, object),
        };
        let kind = element.kind;
        if kind.is_number() { Ok(Self { offset, kind, shape }) } else { Err(PathError::NoNumber) }
    }

    /// True where every number of the field satisfies `test`.
    ///
    /// # Safety
    /// `object` points to a valid object of the descriptor that the path was resolved with.
    pub unsafe fn all(&self, object: *const u8, mut test: impl FnMut(f64) -> bool) -> bool {
        // SAFETY: by contract the field lies at this offset inside the object.
        let field = unsafe { object.add(self.offset) };
        let (start, count) = match self.shape {
            Shape::One => (field, 1),
            Shape::Array(count) => (field, count),
            Shape::Sequence => {
                // SAFETY: by contract the field is a sequence, and all have this layout.
                let sequence = unsafe { &*field.cast::<RawSequence>() };
                (sequence.start.cast_const(), sequence.len)
            }
        };
        // SAFETY: `count` numbers of this kind lie at `start`.
        (0..count).all(|index| test(unsafe { self.load(start, index) }))
    }

    /// The number at `index` of those at `start`.
    ///
    /// # Safety
    /// At least `index + 1` numbers of this kind lie at `start`.
    unsafe fn load(&self, start: *const u8, index: usize) -> f64 {
        macro_rules! number {
            ($scalar:ty) => {
                // SAFETY: by contract.
                unsafe { *start.cast::<$scalar>().add(index) as f64 }
            };
        }
        match self.kind {
            Kind::Bool => f64::from(number!(u8) != 0.0),
            Kind::U8 => number!(u8),
            Kind::U16 => number!(u16),
            Kind::U32 => number!(u32),
            Kind::U64 => number!(u64),
            Kind::I8 => number!(i8),
            Kind::I16 => number!(i16),
            Kind::I32 => number!(i32),
            Kind::I64 => number!(i64),
            Kind::F32 => number!(f32),
            _ => number!(f64),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::object::CommObject;
    use crate::objects::{LaserScan, Twist};

    #[test]
    fn a_nested_field_is_loaded_by_its_path() {
        let mut twist = Twist::default();
        twist.angular.z = 1.5;
        let path = FieldPath::resolve(Twist::DESCRIPTOR, "angular.z").unwrap();
        let mut seen = Vec::new();
        // SAFETY: the path was resolved with the descriptor of `Twist`.
        unsafe { path.all((&raw const twist).cast(), |number| (seen.push(number), true).1) };
        assert_eq!(seen, [1.5]);
    }

    #[test]
    fn every_element_of_a_sequence_is_tested() {
        let scan = LaserScan { ranges: vec![1.0, 9.0, 2.0].into(), ..LaserScan::default() };
        let path = FieldPath::resolve(LaserScan::DESCRIPTOR, "ranges").unwrap();
        // SAFETY: the path was resolved with the descriptor of `LaserScan`.
        assert!(!unsafe { path.all((&raw const scan).cast(), |number| number < 5.0) });
    }

    #[test]
    fn an_unknown_field_names_those_that_are_there() {
        let error = FieldPath::resolve(Twist::DESCRIPTOR, "linear.w").unwrap_err();
        assert_eq!(error, PathError::Unknown { part: "w".into(), known: vec!["x".into(), "y".into(), "z".into()] });
        assert_eq!(FieldPath::resolve(Twist::DESCRIPTOR, "linear"), Err(PathError::NoNumber));
    }
}
