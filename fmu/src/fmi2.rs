//! FMI 2.0 for co-simulation: names, types and status codes of `fmi2Functions.h` (2.0.4, appendix A).
#![allow(unsafe_code, reason = "`no_mangle` gives the functions the names that the interface demands")]
#![allow(non_snake_case, reason = "the interface gives the names")]

use std::ffi::{c_char, c_int, c_void};
use std::path::PathBuf;

use crate::c::{Handle, free, get_each, read, set_each, text, with};
use crate::{Instance, Refused};

const OK: c_int = 0;
const ERROR: c_int = 3;
/// `fmi2CoSimulation` of `fmi2Type`.
const CO_SIMULATION: c_int = 1;

/// `fmi2CallbackFunctions`; memory is our own, steps are never pending.
#[repr(C)]
pub struct Callbacks {
    logger: Option<unsafe extern "C" fn(*mut c_void, *const c_char, c_int, *const c_char, *const c_char, ...)>,
    allocate_memory: Option<unsafe extern "C" fn(usize, usize) -> *mut c_void>,
    free_memory: Option<unsafe extern "C" fn(*mut c_void)>,
    step_finished: Option<unsafe extern "C" fn(*mut c_void, c_int)>,
    environment: *mut c_void,
}

fn status(done: bool) -> c_int {
    if done { OK } else { ERROR }
}

fn call(handle: *mut c_void, work: impl FnOnce(&mut Instance) -> Result<(), Refused>) -> c_int {
    status(with(handle, work))
}

/// The types that this library was built for.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetTypesPlatform() -> *const c_char {
    c"default".as_ptr()
}

/// Version of the interface.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetVersion() -> *const c_char {
    c"2.0".as_ptr()
}

/// Makes an instance; null where the model is not the one of the description.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2Instantiate(
    name: *const c_char,
    kind: c_int,
    guid: *const c_char,
    resources: *const c_char,
    callbacks: *const Callbacks,
    _visible: c_int,
    _logging: c_int,
) -> *mut c_void {
    let logger = read(callbacks, 1).ok().and_then(|c| c.first()).map(|c| (c.logger, c.environment));
    let name = text(name).unwrap_or_default().into_owned();
    let tell = move |why: &str| {
        let Some((Some(logger), environment)) = logger else { return };
        let (Ok(name), Ok(why)) = (std::ffi::CString::new(name.as_str()), std::ffi::CString::new(why.replace('\0', " "))) else { return };
        // SAFETY: the master's own function, with the arguments that the interface gives it; `%s` takes the one that follows.
        unsafe { logger(environment, name.as_ptr(), ERROR, c"logStatusError".as_ptr(), c"%s".as_ptr(), why.as_ptr()) };
    };
    if kind != CO_SIMULATION {
        tell("this FMU is for co-simulation");
        return std::ptr::null_mut();
    }
    let made = std::panic::catch_unwind(|| {
        let guid = text(guid).unwrap_or_default();
        let location = text(resources).unwrap_or_default();
        Instance::new(&folder_of(&location), &guid)
    });
    match made {
        Ok(Ok(instance)) => Handle { instance, tell: Box::new(tell) }.leak(),
        Ok(Err(Refused(why))) => {
            tell(&why);
            std::ptr::null_mut()
        }
        Err(_) => std::ptr::null_mut(),
    }
}

/// The folder that a URI of scheme `file` names; masters also give plain paths.
pub fn folder_of(location: &str) -> PathBuf {
    let Some(rest) = location.strip_prefix("file:") else { return PathBuf::from(location) };
    // file:///path, file:/path, file://localhost/path
    let path = rest.strip_prefix("//").map_or(rest, |host| host.find('/').map_or(host, |at| &host[at..]));
    let bytes = path.as_bytes();
    let mut plain = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        let coded = (bytes[at] == b'%').then(|| bytes.get(at + 1..at + 3)).flatten();
        let byte = coded.and_then(|two| u8::from_str_radix(std::str::from_utf8(two).ok()?, 16).ok());
        plain.push(byte.unwrap_or(bytes[at]));
        at += if byte.is_some() { 3 } else { 1 };
    }
    PathBuf::from(String::from_utf8_lossy(&plain).into_owned())
}

/// Ends an instance.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2FreeInstance(handle: *mut c_void) {
    free(handle);
}

/// Errors are always told.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2SetDebugLogging(_: *mut c_void, _: c_int, _: usize, _: *const *const c_char) -> c_int {
    OK
}

/// Begin of the master's time.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2SetupExperiment(handle: *mut c_void, _: c_int, _: f64, start_s: f64, _: c_int, _: f64) -> c_int {
    call(handle, |instance| instance.set_start(start_s))
}

/// Begin of the initialisation.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2EnterInitializationMode(handle: *mut c_void) -> c_int {
    call(handle, Instance::enter_initialization)
}

/// End of the initialisation.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2ExitInitializationMode(handle: *mut c_void) -> c_int {
    call(handle, Instance::exit_initialization)
}

/// End of the simulation.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2Terminate(handle: *mut c_void) -> c_int {
    call(handle, Instance::terminate)
}

/// Back to the moment after the instantiation.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2Reset(handle: *mut c_void) -> c_int {
    call(handle, Instance::reset)
}

/// Values of real variables.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetReal(handle: *mut c_void, references: *const u32, count: usize, values: *mut f64) -> c_int {
    call(handle, |instance| get_each(references, count, values, |reference| instance.real(reference)))
}

/// Sets real variables.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2SetReal(handle: *mut c_void, references: *const u32, count: usize, values: *const f64) -> c_int {
    call(handle, |instance| set_each(references, count, values, |reference, value| instance.set_real(reference, value)))
}

/// Values of integer variables.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetInteger(handle: *mut c_void, references: *const u32, count: usize, values: *mut c_int) -> c_int {
    call(handle, |instance| get_each(references, count, values, |reference| instance.integer(reference)))
}

/// Sets integer variables.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2SetInteger(handle: *mut c_void, references: *const u32, count: usize, values: *const c_int) -> c_int {
    call(handle, |instance| set_each(references, count, values, |reference, value| instance.set_integer(reference, value)))
}

/// A step of the master.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2DoStep(handle: *mut c_void, now_s: f64, step_s: f64, _no_set_state: c_int) -> c_int {
    call(handle, |instance| instance.do_step(now_s, step_s))
}

/// Functions of the interface that this model has no use for: an error, told to the master. None of nothing is no error.
macro_rules! refused {
    ($($name:ident($($argument:ident: $kind:ty),*) $($empty:ident)?;)+) => {$(
        #[doc = concat!("`", stringify!($name), "`: not served by this model.")]
        #[unsafe(no_mangle)]
        pub extern "C" fn $name(handle: *mut c_void, $($argument: $kind),*) -> c_int {
            $(if $empty == 0 { return OK; })?
            $(let _ = $argument;)*
            call(handle, |_| Err(Refused(concat!(stringify!($name), ": not served by this model").into())))
        }
    )+};
}

refused! {
    fmi2GetBoolean(references: *const u32, count: usize, values: *mut c_int) count;
    fmi2SetBoolean(references: *const u32, count: usize, values: *const c_int) count;
    fmi2GetString(references: *const u32, count: usize, values: *mut *const c_char) count;
    fmi2SetString(references: *const u32, count: usize, values: *const *const c_char) count;
    fmi2GetFMUstate(state: *mut *mut c_void);
    fmi2SetFMUstate(state: *mut c_void);
    fmi2FreeFMUstate(state: *mut *mut c_void);
    fmi2SerializedFMUstateSize(state: *mut c_void, size: *mut usize);
    fmi2SerializeFMUstate(state: *mut c_void, bytes: *mut c_char, size: usize);
    fmi2DeSerializeFMUstate(bytes: *const c_char, size: usize, state: *mut *mut c_void);
    fmi2GetDirectionalDerivative(unknown: *const u32, unknowns: usize, known: *const u32, knowns: usize, seed: *const f64, derivative: *mut f64);
    fmi2SetRealInputDerivatives(references: *const u32, count: usize, orders: *const c_int, values: *const f64);
    fmi2GetRealOutputDerivatives(references: *const u32, count: usize, orders: *const c_int, values: *mut f64);
    fmi2CancelStep();
    fmi2GetStatus(kind: c_int, value: *mut c_int);
    fmi2GetRealStatus(kind: c_int, value: *mut f64);
    fmi2GetIntegerStatus(kind: c_int, value: *mut c_int);
    fmi2GetBooleanStatus(kind: c_int, value: *mut c_int);
    fmi2GetStringStatus(kind: c_int, value: *mut *const c_char);
    fmi2EnterEventMode();
    fmi2NewDiscreteStates(info: *mut c_void);
    fmi2EnterContinuousTimeMode();
    fmi2CompletedIntegratorStep(no_set_state: c_int, event: *mut c_int, terminate: *mut c_int);
    fmi2SetTime(time_s: f64);
    fmi2SetContinuousStates(values: *const f64, count: usize);
    fmi2GetDerivatives(values: *mut f64, count: usize);
    fmi2GetEventIndicators(values: *mut f64, count: usize);
    fmi2GetContinuousStates(values: *mut f64, count: usize);
    fmi2GetNominalsOfContinuousStates(values: *mut f64, count: usize);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_location_is_read_in_all_its_spellings() {
        for text in ["file:///tmp/a%20b/resources", "file:/tmp/a b/resources", "file://localhost/tmp/a%20b/resources", "/tmp/a b/resources"]
        {
            assert_eq!(folder_of(text), PathBuf::from("/tmp/a b/resources"), "{text}");
        }
        assert_eq!(folder_of("file:///tmp/100%"), PathBuf::from("/tmp/100%"));
    }
}
