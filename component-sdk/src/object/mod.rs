//! Communication objects: by value, immutable once sent, shared by reference inside the process.
//!
//! A type is one by `#[derive(CommObject)]` on a `#[repr(C)]` struct of scalars, arrays, [`Text`](crate::object::Text), [`Sequence`](crate::object::Sequence) and other
//! objects. Its [`TypeDescriptor`](crate::object::TypeDescriptor) says where each field lies, so that a profile can name a field and a check is an
//! offset load, and it suffices to copy any object into flat bytes and back: later transports need nothing more from
//! the author.
//!
//! `RVec` and `RString` of `abi_stable` were tried for the contents: their private vtable cannot be built from a
//! description, so nothing could be copied back from flat bytes without the type.

mod descriptor;

/// Flat bytes and back.
pub mod flat;

/// Fields by name.
pub mod path;

mod scalar;
mod sequence;
mod text;

pub use descriptor::{CommObject, FieldDescriptor, Kind, TypeDescriptor};
pub use sequence::Sequence;
pub use text::Text;
