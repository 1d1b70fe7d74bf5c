//! The child process that runs a foreign model: its task as JSON on stdin, the pressure as numbers in a file.

use std::io::{Read, Write};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use super::description::Ports;
use super::job::Job;
use super::{ForeignError, ForeignFmu, Trust, fmi2, fmi3};
use crate::course::Run;
use crate::diagnose::Plant;

/// How long a model may take for one run, where the user does not say otherwise.
pub const TIME_LIMIT: Duration = Duration::from_secs(60);
/// How often the parent looks whether the child has ended.
const LOOK: Duration = Duration::from_millis(1);
/// Part of a step that is rounding.
const WHOLE: f64 = 1e-6;
/// Most that is read of what a model says before its end [bytes].
const MOST_SAID: u64 = 1 << 16;

/// The child: reads its job, runs it, writes the pressures.
///
/// # Errors
/// What the model refused, in words.
pub fn serve(input: &mut dyn Read) -> Result<(), String> {
    let job: Job = serde_json::from_reader(input).map_err(|e| format!("the task cannot be read: {e}"))?;
    let pressure = if job.version == 2 { fmi2::run(&job) } else { fmi3::run(&job) }?;
    let bytes: Vec<u8> = pressure.iter().flat_map(|p| p.to_le_bytes()).collect();
    std::fs::write(&job.result, bytes).map_err(|e| format!("{}: {e}", job.result.display()))
}

/// A foreign model that the user has allowed to run, unpacked.
#[derive(Debug)]
pub struct Unpacked {
    file: String,
    job: Job,
    step_s: Option<f64>,
    limit: Duration,
    folder: Scratch,
    runs: AtomicUsize,
}

impl ForeignFmu {
    /// Unpacks the model for runs that take `limit` at most; stepped every `step_s`, or as the model and the recording have it.
    ///
    /// # Errors
    /// [`ForeignError::NotTrusted`], [`ForeignError::File`] where there is no library for this machine.
    pub fn unpacked(&self, ports: &Ports, trust: &Trust, step_s: Option<f64>, limit: Duration) -> Result<Unpacked, ForeignError> {
        if !trust.holds(&self.sha256) {
            return Err(ForeignError::NotTrusted { file: self.file.clone(), sha256: self.sha256.clone() });
        }
        let failed = |what: String| ForeignError::Run { file: self.file.clone(), what };
        let folder = Scratch::new().map_err(|e| failed(format!("no folder to unpack it in: {e}")))?;
        let (library, resources) = self.unpack(&folder.0)?;
        let job = Job {
            version: self.description.version,
            library,
            resources,
            token: self.description.token.clone(),
            ports: ports.clone(),
            dt_s: 0.0,
            current_a: Vec::new(),
            result: PathBuf::new(),
        };
        Ok(Unpacked { file: self.file.clone(), job, step_s: step_s.or(self.description.step_s), limit, folder, runs: AtomicUsize::new(0) })
    }
}

impl Unpacked {
    /// The pressure at each sample [bar], the current held from sample to sample; each run is a process of its own.
    ///
    /// A model whose own step does not divide that of the samples runs with its own step, and its pressure is read between.
    ///
    /// # Errors
    /// [`ForeignError::Run`] where the model refuses, crashes or takes longer than it may.
    pub fn simulate(&self, dt_s: f64, current_a: &[f64]) -> Result<Vec<f64>, ForeignError> {
        let whole = |h: f64| (dt_s / h).round() >= 1.0 && (dt_s / h - (dt_s / h).round()).abs() < WHOLE;
        match self.step_s.filter(|h| !whole(*h)) {
            None => self.run(dt_s, current_a.to_vec()),
            Some(own_s) => {
                let last = current_a.len().saturating_sub(1);
                let steps = (last as f64 * dt_s / own_s).ceil() as usize;
                let held = |j: usize| current_a[((j as f64 * own_s / dt_s + WHOLE) as usize).min(last)];
                let pressure = self.run(own_s, (0..=steps).map(held).collect())?;
                let at = |k: usize| {
                    let x = (k as f64 * dt_s / own_s).min(steps as f64);
                    let from = pressure[x as usize];
                    from + x.fract() * (pressure[(x as usize + 1).min(steps)] - from)
                };
                Ok((0..current_a.len()).map(at).collect())
            }
        }
    }

    fn run(&self, dt_s: f64, current_a: Vec<f64>) -> Result<Vec<f64>, ForeignError> {
        let failed = |what: String| ForeignError::Run { file: self.file.clone(), what };
        let result = self.folder.0.join(format!("result-{}", self.runs.fetch_add(1, Ordering::Relaxed)));
        let job = Job { dt_s, current_a, result, ..self.job.clone() };
        child(&job, self.limit).map_err(failed)?;
        let bytes = std::fs::read(&job.result).map_err(|e| failed(format!("left no result: {e}")))?;
        // What is left of it goes with the folder.
        let _ = std::fs::remove_file(&job.result);
        if bytes.len() != 8 * job.current_a.len() {
            return Err(failed(format!("gave {} samples of {}", bytes.len() / 8, job.current_a.len())));
        }
        let pressure: Vec<f64> = bytes.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap_or_default())).collect();
        match pressure.iter().position(|p| !p.is_finite()) {
            Some(at) => Err(failed(format!("its pressure at {} s is {}", at as f64 * dt_s, pressure[at]))),
            None => Ok(pressure),
        }
    }
}

impl Plant for Unpacked {
    fn pressure(&self, run: &Run, current_a: &[f64]) -> Result<Vec<f64>, String> {
        self.simulate(run.dt_s, current_a).map_err(|e| match e {
            ForeignError::Run { what, .. } => what,
            other => other.to_string(),
        })
    }

    fn runs_again(&self) -> bool {
        true
    }
}

/// Runs a job in a process of its own; in words how it ended, where it did not end well.
fn child(job: &Job, limit: Duration) -> Result<(), String> {
    let program = std::env::current_exe().map_err(|e| e.to_string())?;
    let task = serde_json::to_vec(job).map_err(|e| e.to_string())?;
    let mut command = Command::new(program);
    command.arg("run-fmu").stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
    let mut child = command.spawn().map_err(|e| format!("no process to run it in: {e}"))?;
    let (stdin, stderr) = (child.stdin.take(), child.stderr.take());
    std::thread::scope(|scope| {
        // A child that dies early breaks the pipe; how it ended is told below.
        scope.spawn(move || stdin.map(|mut pipe| pipe.write_all(&task)));
        let err = scope.spawn(move || said(stderr));
        let begun = Instant::now();
        let status = loop {
            match child.try_wait() {
                Ok(Some(status)) => break Ok(status),
                Ok(None) if begun.elapsed() > limit => {
                    // It may have ended in this very moment.
                    let _ = child.kill();
                    let _ = child.wait();
                    break Err(format!("took longer than {} s and was ended", limit.as_secs_f64()));
                }
                Ok(None) => std::thread::sleep(LOOK),
                Err(e) => break Err(e.to_string()),
            }
        };
        let err = err.join().unwrap_or_default();
        let status = status?;
        if status.success() {
            return Ok(());
        }
        let said = String::from_utf8_lossy(&err);
        let said = said.trim().lines().last().unwrap_or("said nothing").trim_start_matches("error: ").to_string();
        #[cfg(unix)]
        if let Some(signal) = std::os::unix::process::ExitStatusExt::signal(&status) {
            return Err(format!("crashed (signal {signal}): {said}"));
        }
        Err(said)
    })
}

/// What a pipe says, as much of it as anybody reads.
fn said(pipe: Option<impl Read>) -> Vec<u8> {
    let mut bytes = Vec::new();
    if let Some(mut pipe) = pipe {
        // What came before an error of the pipe is what there is; a flood goes by unread.
        let _ = pipe.by_ref().take(MOST_SAID).read_to_end(&mut bytes);
        let _ = std::io::copy(&mut pipe, &mut std::io::sink());
    }
    bytes
}

/// A folder that goes with its value.
#[derive(Debug)]
struct Scratch(PathBuf);

impl Scratch {
    fn new() -> std::io::Result<Self> {
        let base = std::env::temp_dir();
        for n in 0..1000u32 {
            let folder = base.join(format!("hil-fmu-{}-{n}", std::process::id()));
            let mut builder = std::fs::DirBuilder::new();
            #[cfg(unix)]
            std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
            match builder.create(&folder) {
                Ok(()) => return Ok(Self(folder)),
                Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {}
                Err(e) => return Err(e),
            }
        }
        Err(std::io::Error::other("no free name for a folder"))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // A folder that cannot be removed is the system's to clear: it lies among the temporary files.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
