//! What touches the memory of the master: instances behind opaque pointers, arrays, texts.
#![allow(unsafe_code, reason = "the C interface of FMI hands over pointers; every use of one stands in this file")]

use std::ffi::{CStr, c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::{Instance, Refused};

/// Tells the master why a call was refused.
pub type Tell = Box<dyn Fn(&str)>;

/// What an opaque pointer of the interface points to.
pub struct Handle {
    /// The model.
    pub instance: Instance,
    /// The master's log.
    pub tell: Tell,
}

impl Handle {
    /// An opaque pointer; [`free`] takes it back.
    pub fn leak(self) -> *mut c_void {
        Box::into_raw(Box::new(self)).cast()
    }
}

/// Runs `work` on an instance; `false`, with the reason told, where it is refused, panics or there is no instance.
pub fn with(handle: *mut c_void, work: impl FnOnce(&mut Instance) -> Result<(), Refused>) -> bool {
    // SAFETY: the interface demands that the pointer is one that the instantiation returned and that was not freed, and that
    // no other thread uses it meanwhile (FMI 2.0.4, section 2.1.4; FMI 3.0.1, section 2.2.1).
    let Some(handle) = (unsafe { handle.cast::<Handle>().as_mut() }) else { return false };
    match catch_unwind(AssertUnwindSafe(|| work(&mut handle.instance))) {
        Ok(Ok(())) => true,
        Ok(Err(Refused(why))) => {
            (handle.tell)(&why);
            false
        }
        Err(_) => {
            (handle.tell)("this is a bug of the library inside the FMU");
            false
        }
    }
}

/// Ends an instance.
pub fn free(handle: *mut c_void) {
    if !handle.is_null() {
        // SAFETY: as in [`with`]; the interface demands that a freed pointer is used no more.
        drop(unsafe { Box::from_raw(handle.cast::<Handle>()) });
    }
}

/// An array that the master gives to read; nothing where the pointer is null although it should hold something.
pub fn read<'a, T>(pointer: *const T, count: usize) -> Result<&'a [T], Refused> {
    match (pointer.is_null(), count) {
        (_, 0) => Ok(&[]),
        (true, _) => Err(Refused("a null pointer instead of an array".into())),
        // SAFETY: the interface demands that the array holds `count` values for the time of the call.
        (false, _) => Ok(unsafe { std::slice::from_raw_parts(pointer, count) }),
    }
}

/// An array that the master gives to fill.
pub fn write<'a, T>(pointer: *mut T, count: usize) -> Result<&'a mut [T], Refused> {
    match (pointer.is_null(), count) {
        (_, 0) => Ok(&mut []),
        (true, _) => Err(Refused("a null pointer instead of an array".into())),
        // SAFETY: as in [`read`]; the master owns the array and does not use it during the call.
        (false, _) => Ok(unsafe { std::slice::from_raw_parts_mut(pointer, count) }),
    }
}

/// Fills the values of the variables `references`, `count` of both.
pub fn get_each<T>(references: *const u32, count: usize, values: *mut T, get: impl Fn(u32) -> Result<T, Refused>) -> Result<(), Refused> {
    for (reference, value) in read(references, count)?.iter().zip(write(values, count)?) {
        *value = get(*reference)?;
    }
    Ok(())
}

/// Sets the variables `references`, `count` of both, up to the first that is refused.
pub fn set_each<T: Copy>(
    references: *const u32,
    count: usize,
    values: *const T,
    mut set: impl FnMut(u32, T) -> Result<(), Refused>,
) -> Result<(), Refused> {
    read(references, count)?.iter().zip(read(values, count)?).try_for_each(|(reference, value)| set(*reference, *value))
}

/// A text of the master; nothing for a null pointer.
pub fn text<'a>(pointer: *const c_char) -> Option<std::borrow::Cow<'a, str>> {
    // SAFETY: the interface demands a text that ends with a zero byte.
    (!pointer.is_null()).then(|| unsafe { CStr::from_ptr(pointer) }.to_string_lossy())
}
