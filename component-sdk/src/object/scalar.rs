//! Numbers and arrays are objects.
#![allow(unsafe_code, reason = "address of unsafe: descriptions of std's own types")]

use super::descriptor::{CommObject, Kind, TypeDescriptor};

macro_rules! scalars {
    ($($scalar:ty = $kind:ident),+ $(,)?) => { $(
        // SAFETY: size and alignment are the compiler's, and the kind names the type.
        unsafe impl CommObject for $scalar {
            const DESCRIPTOR: &'static TypeDescriptor = &TypeDescriptor::leaf(
                Kind::$kind.opros_name(), Kind::$kind, size_of::<$scalar>(), align_of::<$scalar>());

            fn empty() -> Self {
                Self::default()
            }
        }
    )+ };
}

scalars! {
    bool = Bool, u8 = U8, u16 = U16, u32 = U32, u64 = U64, i8 = I8, i16 = I16, i32 = I32, i64 = I64, f32 = F32, f64 = F64,
}

// Nothing: the parameters of a method that has none, the answer of one that only says that it is done.
// SAFETY: it has neither size nor fields.
unsafe impl CommObject for () {
    const DESCRIPTOR: &'static TypeDescriptor =
        &TypeDescriptor::of_fields("void", size_of::<Self>(), align_of::<Self>(), &[], &[]);

    fn empty() -> Self {}
}

// SAFETY: an array is its elements, one after the other.
unsafe impl<T: CommObject, const N: usize> CommObject for [T; N] {
    const DESCRIPTOR: &'static TypeDescriptor =
        &TypeDescriptor::of_elements("array", Kind::Array, size_of::<Self>(), align_of::<Self>(), N, T::DESCRIPTOR);

    fn empty() -> Self {
        std::array::from_fn(|_| T::empty())
    }
}
