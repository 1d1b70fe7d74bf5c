//! FMI 3.0 for co-simulation: names, types and status codes of `fmi3Functions.h` (3.0.1).
#![allow(unsafe_code, reason = "`no_mangle` gives the functions the names that the interface demands")]
#![allow(non_snake_case, reason = "the interface gives the names")]

use std::ffi::{CString, c_char, c_int, c_void};
use std::path::Path;

use crate::c::{Handle, free, get_each, set_each, text, with, write};
use crate::{Instance, Refused};

const OK: c_int = 0;
const ERROR: c_int = 3;

/// `fmi3LogMessageCallback`.
type Logger = Option<unsafe extern "C" fn(*mut c_void, c_int, *const c_char, *const c_char)>;

fn call(handle: *mut c_void, work: impl FnOnce(&mut Instance) -> Result<(), Refused>) -> c_int {
    if with(handle, work) { OK } else { ERROR }
}

/// Version of the interface.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetVersion() -> *const c_char {
    c"3.0".as_ptr()
}

/// Errors are always told.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3SetDebugLogging(_: *mut c_void, _: bool, _: usize, _: *const *const c_char) -> c_int {
    OK
}

fn teller(environment: *mut c_void, logger: Logger) -> impl Fn(&str) {
    move |why: &str| {
        let (Some(logger), Ok(why)) = (logger, CString::new(why.replace('\0', " "))) else { return };
        // SAFETY: the master's own function, with the arguments that the interface gives it.
        unsafe { logger(environment, ERROR, c"logStatusError".as_ptr(), why.as_ptr()) };
    }
}

/// Makes an instance; null where the model is not the one of the description.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3InstantiateCoSimulation(
    _name: *const c_char,
    token: *const c_char,
    resources: *const c_char,
    _visible: bool,
    _logging: bool,
    _event_mode: bool,
    _early_return: bool,
    _intermediate: *const u32,
    _intermediate_count: usize,
    environment: *mut c_void,
    logger: Logger,
    _update: *const c_void,
) -> *mut c_void {
    let tell = teller(environment, logger);
    let made = std::panic::catch_unwind(|| {
        let (token, folder) = (text(token).unwrap_or_default(), text(resources).unwrap_or_default());
        Instance::new(Path::new(folder.as_ref()), &token)
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

/// Not served: this FMU is for co-simulation.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3InstantiateModelExchange(
    _name: *const c_char,
    _token: *const c_char,
    _resources: *const c_char,
    _visible: bool,
    _logging: bool,
    environment: *mut c_void,
    logger: Logger,
) -> *mut c_void {
    teller(environment, logger)("this FMU is for co-simulation");
    std::ptr::null_mut()
}

/// Not served: this FMU is for co-simulation.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3InstantiateScheduledExecution(
    _name: *const c_char,
    _token: *const c_char,
    _resources: *const c_char,
    _visible: bool,
    _logging: bool,
    environment: *mut c_void,
    logger: Logger,
    _clock_update: *const c_void,
    _lock: *const c_void,
    _unlock: *const c_void,
) -> *mut c_void {
    teller(environment, logger)("this FMU is for co-simulation");
    std::ptr::null_mut()
}

/// Ends an instance.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3FreeInstance(handle: *mut c_void) {
    free(handle);
}

/// Begin of the initialisation, with the begin of the master's time.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3EnterInitializationMode(handle: *mut c_void, _: bool, _: f64, start_s: f64, _: bool, _: f64) -> c_int {
    call(handle, |instance| {
        instance.set_start(start_s)?;
        instance.enter_initialization()
    })
}

/// End of the initialisation.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3ExitInitializationMode(handle: *mut c_void) -> c_int {
    call(handle, Instance::exit_initialization)
}

/// End of the simulation.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3Terminate(handle: *mut c_void) -> c_int {
    call(handle, Instance::terminate)
}

/// Back to the moment after the instantiation.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3Reset(handle: *mut c_void) -> c_int {
    call(handle, Instance::reset)
}

/// Values of real variables.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetFloat64(handle: *mut c_void, references: *const u32, count: usize, values: *mut f64, _size: usize) -> c_int {
    call(handle, |instance| {
        // Reference 0 is the time, which this version of the interface has as a variable.
        let of = |reference| instance.real(if reference == 0 { hil::exchange::fmu::MODEL_TIME_OUT } else { reference });
        get_each(references, count, values, of)
    })
}

/// Sets real variables.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3SetFloat64(handle: *mut c_void, references: *const u32, count: usize, values: *const f64, _size: usize) -> c_int {
    call(handle, |instance| set_each(references, count, values, |reference, value| instance.set_real(reference, value)))
}

/// Values of integer variables.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetInt32(handle: *mut c_void, references: *const u32, count: usize, values: *mut i32, _size: usize) -> c_int {
    call(handle, |instance| get_each(references, count, values, |reference| instance.integer(reference)))
}

/// Sets integer variables.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3SetInt32(handle: *mut c_void, references: *const u32, count: usize, values: *const i32, _size: usize) -> c_int {
    call(handle, |instance| set_each(references, count, values, |reference, value| instance.set_integer(reference, value)))
}

/// A step of the master; no event is needed, the step is never cut short.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3DoStep(
    handle: *mut c_void,
    now_s: f64,
    step_s: f64,
    _no_set_state: bool,
    event: *mut bool,
    terminate: *mut bool,
    early: *mut bool,
    last_s: *mut f64,
) -> c_int {
    call(handle, |instance| {
        for flag in [event, terminate, early] {
            write(flag, usize::from(!flag.is_null()))?.fill(false);
        }
        let reached = instance.do_step(now_s, step_s);
        write(last_s, usize::from(!last_s.is_null()))?.fill(if reached.is_ok() { now_s + step_s } else { now_s });
        reached
    })
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

/// The getter and the setter of a type that this model has no variable of.
macro_rules! without {
    ($($get:ident $set:ident $kind:ty;)+) => {
        refused! {$(
            $get(references: *const u32, count: usize, values: *mut $kind, size: usize) count;
            $set(references: *const u32, count: usize, values: *const $kind, size: usize) count;
        )+}
    };
}

without! {
    fmi3GetFloat32 fmi3SetFloat32 f32;
    fmi3GetInt8 fmi3SetInt8 i8;
    fmi3GetUInt8 fmi3SetUInt8 u8;
    fmi3GetInt16 fmi3SetInt16 i16;
    fmi3GetUInt16 fmi3SetUInt16 u16;
    fmi3GetUInt32 fmi3SetUInt32 u32;
    fmi3GetInt64 fmi3SetInt64 i64;
    fmi3GetUInt64 fmi3SetUInt64 u64;
    fmi3GetBoolean fmi3SetBoolean bool;
    fmi3GetString fmi3SetString *const c_char;
}

refused! {
    fmi3GetBinary(references: *const u32, count: usize, sizes: *mut usize, values: *mut *const u8, size: usize) count;
    fmi3SetBinary(references: *const u32, count: usize, sizes: *const usize, values: *const *const u8, size: usize) count;
    fmi3GetClock(references: *const u32, count: usize, values: *mut bool) count;
    fmi3SetClock(references: *const u32, count: usize, values: *const bool) count;
    fmi3GetNumberOfVariableDependencies(reference: u32, count: *mut usize);
    fmi3GetVariableDependencies(dependent: u32, elements: *mut usize, independents: *mut u32, others: *mut usize, kinds: *mut c_int, count: usize);
    fmi3GetFMUState(state: *mut *mut c_void);
    fmi3SetFMUState(state: *mut c_void);
    fmi3FreeFMUState(state: *mut *mut c_void);
    fmi3SerializedFMUStateSize(state: *mut c_void, size: *mut usize);
    fmi3SerializeFMUState(state: *mut c_void, bytes: *mut u8, size: usize);
    fmi3DeserializeFMUState(bytes: *const u8, size: usize, state: *mut *mut c_void);
    fmi3GetDirectionalDerivative(unknown: *const u32, unknowns: usize, known: *const u32, knowns: usize, seed: *const f64, seeds: usize, values: *mut f64, count: usize);
    fmi3GetAdjointDerivative(unknown: *const u32, unknowns: usize, known: *const u32, knowns: usize, seed: *const f64, seeds: usize, values: *mut f64, count: usize);
    fmi3EnterConfigurationMode();
    fmi3ExitConfigurationMode();
    fmi3GetIntervalDecimal(references: *const u32, count: usize, intervals: *mut f64, qualifiers: *mut c_int);
    fmi3GetIntervalFraction(references: *const u32, count: usize, counters: *mut u64, resolutions: *mut u64, qualifiers: *mut c_int);
    fmi3GetShiftDecimal(references: *const u32, count: usize, shifts: *mut f64);
    fmi3GetShiftFraction(references: *const u32, count: usize, counters: *mut u64, resolutions: *mut u64);
    fmi3SetIntervalDecimal(references: *const u32, count: usize, intervals: *const f64);
    fmi3SetIntervalFraction(references: *const u32, count: usize, counters: *const u64, resolutions: *const u64);
    fmi3SetShiftDecimal(references: *const u32, count: usize, shifts: *const f64);
    fmi3SetShiftFraction(references: *const u32, count: usize, counters: *const u64, resolutions: *const u64);
    fmi3EvaluateDiscreteStates();
    fmi3UpdateDiscreteStates(again: *mut bool, terminate: *mut bool, nominals: *mut bool, values: *mut bool, defined: *mut bool, next_s: *mut f64);
    fmi3EnterEventMode();
    fmi3EnterContinuousTimeMode();
    fmi3CompletedIntegratorStep(no_set_state: bool, event: *mut bool, terminate: *mut bool);
    fmi3SetTime(time_s: f64);
    fmi3SetContinuousStates(values: *const f64, count: usize);
    fmi3GetContinuousStateDerivatives(values: *mut f64, count: usize);
    fmi3GetEventIndicators(values: *mut f64, count: usize);
    fmi3GetContinuousStates(values: *mut f64, count: usize);
    fmi3GetNominalsOfContinuousStates(values: *mut f64, count: usize);
    fmi3GetNumberOfEventIndicators(count: *mut usize);
    fmi3GetNumberOfContinuousStates(count: *mut usize);
    fmi3EnterStepMode();
    fmi3GetOutputDerivatives(references: *const u32, count: usize, orders: *const i32, values: *mut f64, size: usize);
    fmi3ActivateModelPartition(clock: u32, activation_s: f64);
}
