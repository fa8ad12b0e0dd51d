//! What is known of a communication object without its type.
#![allow(unsafe_code, reason = "address of unsafe: the trait whose implementors vouch for their description")]

use abi_stable::StableAbi;
use abi_stable::std_types::{ROption, RSlice, RStr};

/// A type that ports can carry. Derive it.
///
/// # Safety
/// `DESCRIPTOR` must say the truth about size, alignment and every field's place and type.
pub unsafe trait CommObject: Sized + Send + Sync + 'static {
    /// The description.
    const DESCRIPTOR: &'static TypeDescriptor;

    /// The object before anybody wrote to it: zeros and nothing. (`Default` stops at arrays of 32 elements.)
    fn empty() -> Self;
}

/// What a described type is made of.
#[repr(u8)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names say it all")]
pub enum Kind {
    Bool,
    U8,
    U16,
    U32,
    U64,
    I8,
    I16,
    I32,
    I64,
    F32,
    F64,
    /// UTF-8 text.
    Text,
    /// A fixed number of elements in place.
    Array,
    /// Any number of elements elsewhere.
    Sequence,
    /// Named fields.
    Struct,
}

impl Kind {
    /// Its name in an OPRoS `data_type`.
    #[must_use]
    pub const fn opros_name(self) -> &'static str {
        match self {
            Self::Bool => "bool",
            Self::U8 => "uint8_t",
            Self::U16 => "uint16_t",
            Self::U32 => "uint32_t",
            Self::U64 => "uint64_t",
            Self::I8 => "int8_t",
            Self::I16 => "int16_t",
            Self::I32 => "int32_t",
            Self::I64 => "int64_t",
            Self::F32 => "float",
            Self::F64 => "double",
            Self::Text => "std::string",
            Self::Array => "array",
            Self::Sequence => "std::vector",
            Self::Struct => "struct",
        }
    }

    /// True for what a range check can compare.
    #[must_use]
    pub const fn is_number(self) -> bool {
        (self as u8) <= (Self::F64 as u8)
    }
}

/// The description of a type.
#[repr(C)]
#[derive(StableAbi, Debug)]
pub struct TypeDescriptor {
    /// Name of the type.
    pub name: RStr<'static>,
    /// What it is made of.
    pub kind: Kind,
    /// Size in bytes.
    pub size: usize,
    /// Alignment in bytes.
    pub align: usize,
    /// Number of elements of an array; else 0.
    pub count: usize,
    /// Type of the elements of an array or sequence.
    pub element: ROption<&'static TypeDescriptor>,
    /// Fields of a struct, in order.
    pub fields: RSlice<'static, FieldDescriptor>,
    /// Hash of kinds, offsets and field names, all the way down; the type's own name does not count.
    pub layout_hash: u64,
}

/// One field of a struct.
#[repr(C)]
#[derive(StableAbi, Debug)]
pub struct FieldDescriptor {
    /// Name.
    pub name: RStr<'static>,
    /// Offset in bytes.
    pub offset: usize,
    /// Type.
    pub object: &'static TypeDescriptor,
}

impl TypeDescriptor {
    /// A scalar or text: no parts.
    #[must_use]
    pub const fn leaf(name: &'static str, kind: Kind, size: usize, align: usize) -> Self {
        Self {
            name: RStr::from_str(name),
            kind,
            size,
            align,
            count: 0,
            element: ROption::RNone,
            fields: RSlice::EMPTY,
            layout_hash: mix(mix(mix(SEED, kind as u64), size as u64), align as u64),
        }
    }

    /// An array or sequence.
    #[must_use]
    pub const fn of_elements(
        name: &'static str,
        kind: Kind,
        size: usize,
        align: usize,
        count: usize,
        element: &'static Self,
    ) -> Self {
        let own = Self::leaf(name, kind, size, align).layout_hash;
        Self {
            name: RStr::from_str(name),
            kind,
            size,
            align,
            count,
            element: ROption::RSome(element),
            fields: RSlice::EMPTY,
            layout_hash: mix(mix(own, count as u64), element.layout_hash),
        }
    }

    /// A struct. `names` are the names of `fields` again: `RStr` cannot be read in a constant.
    #[must_use]
    pub const fn of_fields(
        name: &'static str,
        size: usize,
        align: usize,
        names: &[&str],
        fields: &'static [FieldDescriptor],
    ) -> Self {
        let mut hash = Self::leaf(name, Kind::Struct, size, align).layout_hash;
        let mut index = 0;
        while index < fields.len() {
            hash = mix_text(hash, names[index]);
            hash = mix(mix(hash, fields[index].offset as u64), fields[index].object.layout_hash);
            index += 1;
        }
        Self {
            name: RStr::from_str(name),
            kind: Kind::Struct,
            size,
            align,
            count: 0,
            element: ROption::RNone,
            fields: RSlice::from_slice(fields),
            layout_hash: hash,
        }
    }

    /// Type of the elements of an array or sequence.
    #[must_use]
    pub fn element(&self) -> Option<&'static Self> {
        self.element.into_option()
    }

    /// The first field at which two layouts differ, as a path, with what each side has there; `None`: they agree.
    #[must_use]
    pub fn difference(&self, other: &Self) -> Option<String> {
        if self.layout_hash == other.layout_hash {
            return None;
        }
        for (mine, theirs) in self.fields.iter().zip(other.fields.iter()) {
            if mine.name != theirs.name || mine.offset != theirs.offset {
                return Some(format!(
                    "field `{}` at {} / `{}` at {}",
                    mine.name, mine.offset, theirs.name, theirs.offset
                ));
            }
            if let Some(inner) = mine.object.difference(theirs.object) {
                return Some(format!("field `{}`: {inner}", mine.name));
            }
        }
        Some(format!("{} of {} bytes / {} of {} bytes", self.name, self.size, other.name, other.size))
    }
}

/// Offset basis and prime of the 64-bit Fowler-Noll-Vo hash (FNV-1a).
const SEED: u64 = 0xcbf2_9ce4_8422_2325;
const PRIME: u64 = 0x0000_0100_0000_01b3;

const fn mix(mut hash: u64, value: u64) -> u64 {
    let bytes = value.to_le_bytes();
    let mut index = 0;
    while index < bytes.len() {
        hash = (hash ^ bytes[index] as u64).wrapping_mul(PRIME);
        index += 1;
    }
    hash
}

const fn mix_text(mut hash: u64, text: &str) -> u64 {
    let bytes = text.as_bytes();
    let mut index = 0;
    while index < bytes.len() {
        hash = (hash ^ bytes[index] as u64).wrapping_mul(PRIME);
        index += 1;
    }
    mix(hash, bytes.len() as u64)
}
