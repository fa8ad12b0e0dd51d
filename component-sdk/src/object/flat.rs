//! Any object into flat bytes and back, by its description alone: for shared memory, network and recordings.
//!
//! Form: fields in order, numbers little-endian, no padding; text and sequences are preceded by their length (u32).
#![allow(unsafe_code, reason = "address of unsafe: walks an object by its description")]

use std::mem::MaybeUninit;

use super::descriptor::{CommObject, Kind, TypeDescriptor};
use super::sequence::RawSequence;

/// Why bytes are no object of a type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlatError {
    /// They end too early.
    Short,
    /// They go on after the object.
    Long,
    /// A text is not UTF-8.
    NotUtf8,
    /// A boolean is neither 0 nor 1.
    NotBool,
}

/// Appends `object` to `out`.
pub fn flatten<T: CommObject>(object: &T, out: &mut Vec<u8>) {
    // SAFETY: `object` is a valid `T`, and the descriptor is `T`'s.
    unsafe { flatten_raw(T::DESCRIPTOR, std::ptr::from_ref(object).cast(), out) };
}

/// Reads an object of type `T`.
///
/// # Errors
/// When the bytes are not exactly one `T`.
pub fn unflatten<T: CommObject>(bytes: &[u8]) -> Result<T, FlatError> {
    let mut object = MaybeUninit::<T>::uninit();
    // SAFETY: the memory has size and alignment of `T`, whose descriptor this is.
    unsafe { unflatten_raw(T::DESCRIPTOR, bytes, object.as_mut_ptr().cast())? };
    // SAFETY: `unflatten_raw` returned `Ok`, so every field is written.
    Ok(unsafe { object.assume_init() })
}

/// Appends the object at `object` to `out`.
///
/// # Safety
/// `object` points to a valid object of that description.
pub unsafe fn flatten_raw(descriptor: &TypeDescriptor, object: *const u8, out: &mut Vec<u8>) {
    match descriptor.kind {
        Kind::Struct => {
            for field in descriptor.fields.iter() {
                // SAFETY: the description says that this field lies there.
                unsafe { flatten_raw(field.object, object.add(field.offset), out) };
            }
        }
        Kind::Array => {
            // SAFETY: an array is `count` elements in place.
            unsafe { flatten_elements(descriptor.element(), object, descriptor.count, out) };
        }
        Kind::Sequence | Kind::Text => {
            // SAFETY: all sequences and texts have this layout.
            let sequence = unsafe { &*object.cast::<RawSequence>() };
            out.extend_from_slice(
                &u32::try_from(sequence.len).expect("an object is smaller than 4 Gi elements").to_le_bytes(),
            );
            let element = descriptor.element().unwrap_or(u8::DESCRIPTOR);
            // SAFETY: `len` elements lie at `start`.
            unsafe { flatten_elements(Some(element), sequence.start, sequence.len, out) };
        }
        // SAFETY: a number is its bytes, little-endian on every architecture that we support.
        _ => out.extend_from_slice(unsafe { std::slice::from_raw_parts(object, descriptor.size) }),
    }
}

/// # Safety
/// `count` valid elements lie at `start`.
unsafe fn flatten_elements(element: Option<&TypeDescriptor>, start: *const u8, count: usize, out: &mut Vec<u8>) {
    let Some(element) = element else { return };
    if element.kind.is_number() {
        // SAFETY: by contract; numbers have no padding between them.
        out.extend_from_slice(unsafe { std::slice::from_raw_parts(start, count * element.size) });
        return;
    }
    for index in 0..count {
        // SAFETY: by contract.
        unsafe { flatten_raw(element, start.add(index * element.size), out) };
    }
}

/// Writes an object read from `bytes` to `object`.
///
/// # Errors
/// When the bytes are not exactly one object of that description; nothing is written or allocated then.
///
/// # Safety
/// `object` points to memory of the description's size and alignment that holds no object yet.
pub unsafe fn unflatten_raw(descriptor: &TypeDescriptor, bytes: &[u8], object: *mut u8) -> Result<(), FlatError> {
    // Checked whole before anything is built: there is no half-built object to take apart again.
    let mut rest = bytes;
    check(descriptor, &mut rest)?;
    if !rest.is_empty() {
        return Err(FlatError::Long);
    }
    let mut rest = bytes;
    // SAFETY: the memory is as `build` wants it, by contract; the bytes were checked.
    unsafe { build(descriptor, &mut rest, object) };
    Ok(())
}

fn take<'a>(bytes: &mut &'a [u8], count: usize) -> Result<&'a [u8], FlatError> {
    let (head, tail) = bytes.split_at_checked(count).ok_or(FlatError::Short)?;
    *bytes = tail;
    Ok(head)
}

fn take_len(bytes: &mut &[u8]) -> Result<usize, FlatError> {
    let mut len = [0; 4];
    len.copy_from_slice(take(bytes, 4)?);
    Ok(u32::from_le_bytes(len) as usize)
}

fn check(descriptor: &TypeDescriptor, bytes: &mut &[u8]) -> Result<(), FlatError> {
    match descriptor.kind {
        Kind::Struct => descriptor.fields.iter().try_for_each(|field| check(field.object, bytes)),
        Kind::Array => check_elements(descriptor, descriptor.count, bytes),
        Kind::Sequence => {
            let count = take_len(bytes)?;
            check_elements(descriptor, count, bytes)
        }
        Kind::Text => {
            let len = take_len(bytes)?;
            std::str::from_utf8(take(bytes, len)?).map_or(Err(FlatError::NotUtf8), |_| Ok(()))
        }
        Kind::Bool => {
            if take(bytes, 1)?[0] <= 1 {
                Ok(())
            } else {
                Err(FlatError::NotBool)
            }
        }
        _ => take(bytes, descriptor.size).map(drop),
    }
}

fn check_elements(descriptor: &TypeDescriptor, count: usize, bytes: &mut &[u8]) -> Result<(), FlatError> {
    let Some(element) = descriptor.element() else { return Ok(()) };
    // An element takes at least a byte unless it is an empty struct; a length beyond the input is a lie.
    if count > bytes.len() {
        return Err(FlatError::Short);
    }
    (0..count).try_for_each(|_| check(element, bytes))
}

/// # Safety
/// `bytes` passed `check` of this description; `object` is memory of its size and alignment, holding no object.
unsafe fn build(descriptor: &TypeDescriptor, bytes: &mut &[u8], object: *mut u8) {
    match descriptor.kind {
        Kind::Struct => {
            for field in descriptor.fields.iter() {
                // SAFETY: the description says that this field lies there.
                unsafe { build(field.object, bytes, object.add(field.offset)) };
            }
        }
        Kind::Array => {
            // SAFETY: an array is `count` elements in place.
            unsafe { build_elements(descriptor.element(), descriptor.count, bytes, object) };
        }
        Kind::Sequence | Kind::Text => {
            let element = descriptor.element().unwrap_or(u8::DESCRIPTOR);
            let sequence = RawSequence::with_room(take_len(bytes).unwrap_or(0), element);
            // SAFETY: there is room for `len` elements; the sequence is written where the object has one.
            unsafe {
                build_elements(Some(element), sequence.len, bytes, sequence.start);
                object.cast::<RawSequence>().write(sequence);
            }
        }
        _ => {
            let number = take(bytes, descriptor.size).unwrap_or_default();
            // SAFETY: the number has the description's size, and the memory too.
            unsafe { object.copy_from_nonoverlapping(number.as_ptr(), number.len()) };
        }
    }
}

/// # Safety
/// As `build`, for `count` elements at `start`.
unsafe fn build_elements(element: Option<&TypeDescriptor>, count: usize, bytes: &mut &[u8], start: *mut u8) {
    let Some(element) = element else { return };
    for index in 0..count {
        // SAFETY: by contract.
        unsafe { build(element, bytes, start.add(index * element.size)) };
    }
}

/// Drops the object at `object`: frees what its texts and sequences hold.
///
/// # Safety
/// `object` points to a valid object of that description, which nobody uses afterwards.
pub unsafe fn drop_raw(descriptor: &TypeDescriptor, object: *mut u8) {
    match descriptor.kind {
        Kind::Struct => {
            for field in descriptor.fields.iter() {
                // SAFETY: the description says that this field lies there.
                unsafe { drop_raw(field.object, object.add(field.offset)) };
            }
        }
        Kind::Array => {
            // SAFETY: an array is `count` elements in place.
            unsafe { drop_elements(descriptor.element(), object, descriptor.count) };
        }
        Kind::Sequence | Kind::Text => {
            let element = descriptor.element().unwrap_or(u8::DESCRIPTOR);
            // SAFETY: all sequences and texts have this layout; the object is read once and not used again.
            let sequence = unsafe { object.cast::<RawSequence>().read() };
            // SAFETY: `len` elements lie at `start`.
            unsafe { drop_elements(Some(element), sequence.start, sequence.len) };
            let size = sequence.capacity * element.size;
            if size != 0 {
                (sequence.free)(sequence.start, size, element.align);
            }
        }
        _ => {}
    }
}

/// # Safety
/// As `drop_raw`, for `count` elements at `start`.
unsafe fn drop_elements(element: Option<&TypeDescriptor>, start: *mut u8, count: usize) {
    let Some(element) = element.filter(|element| !element.kind.is_number()) else { return };
    for index in 0..count {
        // SAFETY: by contract.
        unsafe { drop_raw(element, start.add(index * element.size)) };
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::objects::{Image, JointState, Odometry};

    fn round_trip<T: CommObject + PartialEq + std::fmt::Debug>(object: &T) {
        let mut bytes = Vec::new();
        flatten(object, &mut bytes);
        assert_eq!(unflatten::<T>(&bytes).as_ref(), Ok(object));
        for short in 0..bytes.len() {
            assert!(unflatten::<T>(&bytes[..short]).is_err());
        }
        bytes.push(0);
        assert_eq!(unflatten::<T>(&bytes), Err(FlatError::Long));
    }

    #[test]
    fn objects_with_nested_parts_go_there_and_back() {
        let mut odometry = Odometry::default();
        odometry.header.frame_id = "odom".into();
        odometry.pose.covariance[35] = 2.5;
        round_trip(&odometry);
        round_trip(&Image { data: vec![1, 2, 3].into(), encoding: "rgb8".into(), ..Image::default() });
    }

    proptest! {
        #[test]
        fn joint_states_go_there_and_back(names in prop::collection::vec(".*", 0..4), position in prop::collection::vec(-1e9..1e9, 0..9)) {
            let name = names.iter().map(|name| name.as_str().into()).collect();
            round_trip(&JointState { name, position: position.into(), ..JointState::default() });
        }

        #[test]
        fn no_bytes_are_too_wild(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = unflatten::<JointState>(&bytes);
            let _ = unflatten::<Image>(&bytes);
        }
    }
}
