//! Running a foreign library of FMI 2.0 for co-simulation. Source: FMI 2.0.4, `fmi2Functions.h` and section 4.2.4.
#![allow(unsafe_code, reason = "the library of an FMU is called by its C interface; it runs in a child process that may die of it")]

use std::ffi::{CString, c_char, c_int, c_void};

use libloading::{Library, Symbol};

use super::job::Job;

type Component = *mut c_void;
/// Called with more arguments than it takes: on the platforms of FMUs the caller clears them, and none is looked at.
type Logger = unsafe extern "C" fn(*mut c_void, *const c_char, c_int, *const c_char, *const c_char);

#[repr(C)]
struct Callbacks {
    logger: Logger,
    allocate_memory: unsafe extern "C" fn(usize, usize) -> *mut c_void,
    free_memory: unsafe extern "C" fn(*mut c_void),
    step_finished: *const c_void,
    environment: *mut c_void,
}

unsafe extern "C" {
    fn calloc(count: usize, size: usize) -> *mut c_void;
    fn free(memory: *mut c_void);
}

/// Status from which on a call has failed: `fmi2Discard`.
const FAILED: c_int = 2;

unsafe extern "C" fn log(_: *mut c_void, _: *const c_char, status: c_int, _: *const c_char, message: *const c_char) {
    if status >= FAILED && !message.is_null() {
        // SAFETY: the interface gives a text that ends with a zero byte; its format directives are shown as they stand.
        let text = unsafe { std::ffi::CStr::from_ptr(message) }.to_string_lossy();
        eprintln!("its log: {}", text.trim());
    }
}

/// Pressure at each sample [bar].
pub fn run(job: &Job) -> Result<Vec<f64>, String> {
    // SAFETY: loading runs the library's own initialisation; that is what the user has allowed.
    let library = unsafe { Library::new(&job.library) }.map_err(|e| format!("its library cannot be loaded: {e}"))?;
    // SAFETY: the types are those of the interface's header, which the description promises.
    unsafe {
        let instantiate: Symbol<
            unsafe extern "C" fn(*const c_char, c_int, *const c_char, *const c_char, *const Callbacks, c_int, c_int) -> Component,
        > = symbol(&library, "fmi2Instantiate")?;
        let set_up: Symbol<unsafe extern "C" fn(Component, c_int, f64, f64, c_int, f64) -> c_int> =
            symbol(&library, "fmi2SetupExperiment")?;
        let enter: Symbol<unsafe extern "C" fn(Component) -> c_int> = symbol(&library, "fmi2EnterInitializationMode")?;
        let exit: Symbol<unsafe extern "C" fn(Component) -> c_int> = symbol(&library, "fmi2ExitInitializationMode")?;
        let set: Symbol<unsafe extern "C" fn(Component, *const u32, usize, *const f64) -> c_int> = symbol(&library, "fmi2SetReal")?;
        let get: Symbol<unsafe extern "C" fn(Component, *const u32, usize, *mut f64) -> c_int> = symbol(&library, "fmi2GetReal")?;
        let step: Symbol<unsafe extern "C" fn(Component, f64, f64, c_int) -> c_int> = symbol(&library, "fmi2DoStep")?;
        let terminate: Symbol<unsafe extern "C" fn(Component) -> c_int> = symbol(&library, "fmi2Terminate")?;
        let free_instance: Symbol<unsafe extern "C" fn(Component)> = symbol(&library, "fmi2FreeInstance")?;

        let callbacks = Callbacks {
            logger: log,
            allocate_memory: calloc,
            free_memory: free,
            step_finished: std::ptr::null(),
            environment: std::ptr::null_mut(),
        };
        let text = |t: &str| CString::new(t).map_err(|e| e.to_string());
        let location = text(&format!("file://{}", percent(&job.resources.to_string_lossy())))?;
        let (name, token) = (text("base")?, text(&job.token)?);
        // 1: fmi2CoSimulation.
        let model = instantiate(name.as_ptr(), 1, token.as_ptr(), location.as_ptr(), &raw const callbacks, 0, 0);
        if model.is_null() {
            return Err("fmi2Instantiate gave no instance".into());
        }
        let done = |status: c_int, what: &str| if status < FAILED { Ok(()) } else { Err(format!("{what} ended with status {status}")) };
        let put = |reference: u32, value: f64| done(set(model, &raw const reference, 1, &raw const value), "fmi2SetReal");
        let mut pressure = Vec::with_capacity(job.current_a.len());
        let mut take = || {
            let mut value = f64::NAN;
            done(get(model, &raw const job.ports.pressure.reference, 1, &raw mut value), "fmi2GetReal")?;
            let (factor, offset) = job.ports.pressure.to_ours;
            pressure.push(factor * value + offset);
            Ok::<(), String>(())
        };
        let (factor, offset) = job.ports.current.to_ours;
        let command = |current_a: f64| put(job.ports.current.reference, (current_a - offset) / factor);
        done(set_up(model, 0, 0.0, 0.0, 0, 0.0), "fmi2SetupExperiment")?;
        command(job.current_a.first().copied().unwrap_or(0.0))?;
        done(enter(model), "fmi2EnterInitializationMode")?;
        done(exit(model), "fmi2ExitInitializationMode")?;
        take()?;
        for (k, current_a) in job.current_a.iter().enumerate().take(job.current_a.len().saturating_sub(1)) {
            command(*current_a)?;
            let now_s = k as f64 * job.dt_s;
            done(step(model, now_s, job.dt_s, 1), &format!("fmi2DoStep at {now_s} s"))?;
            take()?;
        }
        // The pressures are there: what the model says of its own end changes nothing about them.
        let _ = terminate(model);
        free_instance(model);
        Ok(pressure)
    }
}

/// A function of the library.
pub(super) unsafe fn symbol<'l, T>(library: &'l Library, name: &str) -> Result<Symbol<'l, T>, String> {
    // SAFETY: the caller gives the type that the interface's header gives this name.
    unsafe { library.get(name) }.map_err(|_| format!("its library has no {name}"))
}

/// A path as part of a URI.
fn percent(path: &str) -> String {
    let plain = |b: u8| b.is_ascii_alphanumeric() || b"/-_.~".contains(&b);
    path.bytes().map(|b| if plain(b) { char::from(b).to_string() } else { format!("%{b:02X}") }).collect()
}
