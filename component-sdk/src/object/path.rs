//! Fields by name: a path such as `linear.x` or `ticks[2]` is resolved once, then a check is an offset load.
#![allow(unsafe_code, reason = "address of unsafe: loads at described offsets")]

use std::ops::Range;

use super::descriptor::{Kind, TypeDescriptor};
use super::sequence::RawSequence;

/// Where the numbers of a field lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FieldPath {
    offset: usize,
    kind: Kind,
    /// Size of one number, in bytes.
    size: usize,
    shape: Shape,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shape {
    One,
    Array(usize),
    Sequence,
    /// One element of a sequence.
    Element(usize),
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
    /// The field holds several numbers where one is meant.
    Several,
    /// The field is an array of that many, all before this place, or nothing that has places.
    NoPlace {
        /// The place that was named.
        place: usize,
        /// How many there are.
        count: usize,
    },
}

impl FieldPath {
    /// Resolves a path; the empty one names the object itself. Of an array or a sequence it names all numbers, or with a place,
    /// counted from 0, one of them.
    ///
    /// # Errors
    /// When a part names no field, or the field holds no numbers, or not that many.
    pub fn resolve(descriptor: &'static TypeDescriptor, path: &str) -> Result<Self, PathError> {
        let (path, place) = with_place(path);
        let whole = Self::resolve_field(descriptor, path)?;
        place.map_or(Ok(whole), |place| whole.at(place))
    }

    /// One of the numbers of an array or a sequence.
    fn at(self, place: usize) -> Result<Self, PathError> {
        match self.shape {
            Shape::Array(count) if place < count => {
                Ok(Self { offset: self.offset + place * self.size, shape: Shape::One, ..self })
            }
            Shape::Sequence => Ok(Self { shape: Shape::Element(place), ..self }),
            Shape::Array(count) => Err(PathError::NoPlace { place, count }),
            Shape::One | Shape::Element(_) => Err(PathError::NoPlace { place, count: 0 }),
        }
    }

    fn resolve_field(descriptor: &'static TypeDescriptor, path: &str) -> Result<Self, PathError> {
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
        if kind.is_number() { Ok(Self { offset, kind, size: element.size, shape }) } else { Err(PathError::NoNumber) }
    }

    /// How many numbers it names; `None`: as many as a sequence has.
    #[must_use]
    pub const fn count(&self) -> Option<usize> {
        match self.shape {
            Shape::One | Shape::Element(_) => Some(1),
            Shape::Array(count) => Some(count),
            Shape::Sequence => None,
        }
    }

    /// True where it names one number, never several.
    #[must_use]
    pub const fn is_single(&self) -> bool {
        matches!(self.shape, Shape::One | Shape::Element(_))
    }

    /// True where it names a number that lies at one offset: no element of a sequence.
    #[must_use]
    pub const fn is_in_place(&self) -> bool {
        matches!(self.shape, Shape::One)
    }

    /// The number of a field that [lies in place](Self::is_in_place); the first one of an array.
    ///
    /// # Safety
    /// As [`Self::all`], and the path names no sequence.
    #[inline]
    pub unsafe fn in_place(&self, object: *const u8) -> f64 {
        // SAFETY: by contract a number of this kind lies at this offset.
        unsafe { self.load(object.add(self.offset), 0) }
    }

    /// The first number of the field; `None`: there is none, because a sequence is too short.
    ///
    /// # Safety
    /// As [`Self::all`].
    #[inline]
    pub unsafe fn first(&self, object: *const u8) -> Option<f64> {
        let mut found = None;
        let take = |number| {
            found = Some(number);
            false
        };
        // SAFETY: by contract.
        unsafe { self.all(object, take) };
        found
    }

    /// True where every number of the field satisfies `test`.
    ///
    /// # Safety
    /// `object` points to a valid object of the descriptor that the path was resolved with.
    #[inline]
    pub unsafe fn all(&self, object: *const u8, mut test: impl FnMut(f64) -> bool) -> bool {
        // SAFETY: by contract the field lies at this offset inside the object.
        let field = unsafe { object.add(self.offset) };
        let (start, places) = match self.shape {
            Shape::One => (field, 0..1),
            Shape::Array(count) => (field, 0..count),
            Shape::Sequence | Shape::Element(_) => {
                // SAFETY: by contract the field is a sequence, and all have this layout.
                let sequence = unsafe { &*field.cast::<RawSequence>() };
                (sequence.start.cast_const(), self.places(sequence.len))
            }
        };
        // SAFETY: numbers of this kind lie at `start`, at least as many as the last place needs.
        places.into_iter().all(|index| test(unsafe { self.load(start, index) }))
    }

    /// Which numbers of a sequence of that length it names.
    fn places(&self, len: usize) -> Range<usize> {
        match self.shape {
            Shape::Element(place) if place < len => place..place + 1,
            Shape::Element(_) => 0..0,
            _ => 0..len,
        }
    }

    /// The number at `index` of those at `start`.
    ///
    /// # Safety
    /// At least `index + 1` numbers of this kind lie at `start`.
    #[inline]
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

/// `ticks[2]`: the field, and the place in it.
fn with_place(path: &str) -> (&str, Option<usize>) {
    let split = path.strip_suffix(']').and_then(|rest| rest.rsplit_once('['));
    let parsed = split.and_then(|(field, place)| Some((field, Some(place.parse().ok()?))));
    parsed.unwrap_or((path, None))
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
    fn a_place_names_one_number_of_an_array_or_a_sequence() {
        let array = [1i32, 2, 3];
        let path = FieldPath::resolve(<[i32; 3]>::DESCRIPTOR, "[2]").unwrap();
        // SAFETY: the path was resolved with the descriptor of the array.
        assert_eq!(unsafe { path.first((&raw const array).cast()) }, Some(3.0));
        assert!(path.is_single());
        let beyond = FieldPath::resolve(<[i32; 3]>::DESCRIPTOR, "[3]");
        assert_eq!(beyond, Err(PathError::NoPlace { place: 3, count: 3 }));
        assert_eq!(
            FieldPath::resolve(Twist::DESCRIPTOR, "linear.x[0]"),
            Err(PathError::NoPlace { place: 0, count: 0 })
        );
        let scan = LaserScan { ranges: vec![1.0, 9.0].into(), ..LaserScan::default() };
        for (place, expected) in [("ranges[1]", Some(9.0)), ("ranges[2]", None)] {
            let path = FieldPath::resolve(LaserScan::DESCRIPTOR, place).unwrap();
            // SAFETY: the path was resolved with the descriptor of `LaserScan`.
            assert_eq!(unsafe { path.first((&raw const scan).cast()) }, expected);
        }
        assert!(!FieldPath::resolve(LaserScan::DESCRIPTOR, "ranges").unwrap().is_single());
    }

    #[test]
    fn an_unknown_field_names_those_that_are_there() {
        let error = FieldPath::resolve(Twist::DESCRIPTOR, "linear.w").unwrap_err();
        assert_eq!(error, PathError::Unknown { part: "w".into(), known: vec!["x".into(), "y".into(), "z".into()] });
        assert_eq!(FieldPath::resolve(Twist::DESCRIPTOR, "linear"), Err(PathError::NoNumber));
    }
}
