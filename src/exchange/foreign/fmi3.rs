//! Running a foreign library of FMI 3.0 for co-simulation. Source: FMI 3.0.1, `fmi3Functions.h` and section 4.
#![allow(unsafe_code, reason = "the library of an FMU is called by its C interface; it runs in a child process that may die of it")]

use std::ffi::{CString, c_char, c_int, c_void};

use libloading::{Library, Symbol};

use super::fmi2::symbol;
use super::job::Job;

type Instance = *mut c_void;
type Logger = unsafe extern "C" fn(*mut c_void, c_int, *const c_char, *const c_char);
type Instantiate = unsafe extern "C" fn(
    *const c_char,
    *const c_char,
    *const c_char,
    bool,
    bool,
    bool,
    bool,
    *const u32,
    usize,
    *mut c_void,
    Logger,
    *const c_void,
) -> Instance;
type DoStep = unsafe extern "C" fn(Instance, f64, f64, bool, *mut bool, *mut bool, *mut bool, *mut f64) -> c_int;

/// Status from which on a call has failed: `fmi3Discard`.
const FAILED: c_int = 2;

unsafe extern "C" fn log(_: *mut c_void, status: c_int, _: *const c_char, message: *const c_char) {
    if status >= FAILED && !message.is_null() {
        // SAFETY: the interface gives a text that ends with a zero byte.
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
        let instantiate: Symbol<Instantiate> = symbol(&library, "fmi3InstantiateCoSimulation")?;
        let enter: Symbol<unsafe extern "C" fn(Instance, bool, f64, f64, bool, f64) -> c_int> =
            symbol(&library, "fmi3EnterInitializationMode")?;
        let exit: Symbol<unsafe extern "C" fn(Instance) -> c_int> = symbol(&library, "fmi3ExitInitializationMode")?;
        let set: Symbol<unsafe extern "C" fn(Instance, *const u32, usize, *const f64, usize) -> c_int> =
            symbol(&library, "fmi3SetFloat64")?;
        let get: Symbol<unsafe extern "C" fn(Instance, *const u32, usize, *mut f64, usize) -> c_int> = symbol(&library, "fmi3GetFloat64")?;
        let step: Symbol<DoStep> = symbol(&library, "fmi3DoStep")?;
        let terminate: Symbol<unsafe extern "C" fn(Instance) -> c_int> = symbol(&library, "fmi3Terminate")?;
        let free_instance: Symbol<unsafe extern "C" fn(Instance)> = symbol(&library, "fmi3FreeInstance")?;

        let text = |t: &str| CString::new(t).map_err(|e| e.to_string());
        // The interface wants the folder with a separator at its end.
        let folder = text(&format!("{}/", job.resources.to_string_lossy().trim_end_matches('/')))?;
        let (name, token) = (text("base")?, text(&job.token)?);
        let (nothing, none) = (std::ptr::null(), std::ptr::null_mut());
        let model = instantiate(
            name.as_ptr(),
            token.as_ptr(),
            folder.as_ptr(),
            false,
            false,
            false,
            false,
            nothing,
            0,
            none,
            log,
            std::ptr::null(),
        );
        if model.is_null() {
            return Err("fmi3InstantiateCoSimulation gave no instance".into());
        }
        let done = |status: c_int, what: &str| if status < FAILED { Ok(()) } else { Err(format!("{what} ended with status {status}")) };
        let put = |reference: u32, value: f64| done(set(model, &raw const reference, 1, &raw const value, 1), "fmi3SetFloat64");
        let mut pressure = Vec::with_capacity(job.current_a.len());
        let mut take = || {
            let mut value = f64::NAN;
            done(get(model, &raw const job.ports.pressure.reference, 1, &raw mut value, 1), "fmi3GetFloat64")?;
            let (factor, offset) = job.ports.pressure.to_ours;
            pressure.push(factor * value + offset);
            Ok::<(), String>(())
        };
        let (factor, offset) = job.ports.current.to_ours;
        let command = |current_a: f64| put(job.ports.current.reference, (current_a - offset) / factor);
        command(job.current_a.first().copied().unwrap_or(0.0))?;
        done(enter(model, false, 0.0, 0.0, false, 0.0), "fmi3EnterInitializationMode")?;
        done(exit(model), "fmi3ExitInitializationMode")?;
        take()?;
        for (k, current_a) in job.current_a.iter().enumerate().take(job.current_a.len().saturating_sub(1)) {
            command(*current_a)?;
            let now_s = k as f64 * job.dt_s;
            let (mut event, mut end, mut early, mut last_s) = (false, false, false, now_s);
            let status = step(model, now_s, job.dt_s, true, &raw mut event, &raw mut end, &raw mut early, &raw mut last_s);
            done(status, &format!("fmi3DoStep at {now_s} s"))?;
            if end || early {
                return Err(format!("it ended by itself at {last_s} s"));
            }
            take()?;
        }
        // The pressures are there: what the model says of its own end changes nothing about them.
        let _ = terminate(model);
        free_instance(model);
        Ok(pressure)
    }
}
