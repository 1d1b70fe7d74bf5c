//! The child process that runs a foreign model: its task as JSON on stdin, the pressure as numbers on stdout.

use std::io::{Read, Write};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::description::Ports;
use super::{ForeignError, ForeignFmu, Trust, fmi2, fmi3};

/// How long a model may take for one run, where the user does not say otherwise.
pub const TIME_LIMIT: Duration = Duration::from_secs(60);
/// How often the parent looks whether the child has ended.
const LOOK: Duration = Duration::from_millis(5);

/// What the child is asked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Job {
    /// FMI 2 or 3.
    pub version: u8,
    /// The library.
    pub library: PathBuf,
    /// The folder of the resources.
    pub resources: PathBuf,
    /// `guid` or `instantiationToken`.
    pub token: String,
    /// Where current goes in and pressure comes out.
    pub ports: Ports,
    /// Real variables that are set before the initialisation, by value reference, in the model's units.
    pub set: Vec<(u32, f64)>,
    /// Time between two samples [s].
    pub dt_s: f64,
    /// Command at each sample, held until the next [A].
    pub current_a: Vec<f64>,
}

/// The child: reads its job, runs it, writes the pressures as little-endian numbers [bar].
///
/// # Errors
/// What the model refused, in words.
pub fn serve(input: &mut dyn Read, output: &mut dyn Write) -> Result<(), String> {
    let job: Job = serde_json::from_reader(input).map_err(|e| format!("the task cannot be read: {e}"))?;
    let pressure = if job.version == 2 { fmi2::run(&job) } else { fmi3::run(&job) }?;
    let bytes: Vec<u8> = pressure.iter().flat_map(|p| p.to_le_bytes()).collect();
    output.write_all(&bytes).and_then(|()| output.flush()).map_err(|e| e.to_string())
}

impl ForeignFmu {
    /// The pressure of each run [bar], the current held from sample to sample; each run is a process of its own.
    ///
    /// # Errors
    /// [`ForeignError::NotTrusted`], [`ForeignError::Run`] where the model refuses, crashes or takes longer than `limit`.
    pub fn simulate(&self, ports: &Ports, dt_s: f64, current_a: &[f64], trust: &Trust, limit: Duration) -> Result<Vec<f64>, ForeignError> {
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
            set: Vec::new(),
            dt_s,
            current_a: current_a.to_vec(),
        };
        let bytes = child(&job, limit).map_err(failed)?;
        if bytes.len() != 8 * current_a.len() {
            return Err(failed(format!("gave {} samples of {}", bytes.len() / 8, current_a.len())));
        }
        let pressure: Vec<f64> = bytes.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap_or_default())).collect();
        match pressure.iter().position(|p| !p.is_finite()) {
            Some(at) => Err(failed(format!("its pressure at {} s is {}", at as f64 * dt_s, pressure[at]))),
            None => Ok(pressure),
        }
    }
}

/// Runs a job in a process of its own; what it wrote, or in words how it ended.
fn child(job: &Job, limit: Duration) -> Result<Vec<u8>, String> {
    let program = std::env::current_exe().map_err(|e| e.to_string())?;
    let task = serde_json::to_vec(job).map_err(|e| e.to_string())?;
    let mut command = Command::new(program);
    command.arg("run-fmu").stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().map_err(|e| format!("no process to run it in: {e}"))?;
    let (stdin, stdout, stderr) = (child.stdin.take(), child.stdout.take(), child.stderr.take());
    std::thread::scope(|scope| {
        // A child that dies early breaks the pipe; how it ended is told below.
        scope.spawn(move || stdin.map(|mut pipe| pipe.write_all(&task)));
        let out = scope.spawn(move || all(stdout));
        let err = scope.spawn(move || all(stderr));
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
        let (out, err) = (out.join().unwrap_or_default(), err.join().unwrap_or_default());
        let status = status?;
        if status.success() {
            return Ok(out);
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

fn all(pipe: Option<impl Read>) -> Vec<u8> {
    let mut bytes = Vec::new();
    if let Some(mut pipe) = pipe {
        // What came before an error of the pipe is what there is.
        let _ = pipe.read_to_end(&mut bytes);
    }
    bytes
}

/// A folder that goes with its value.
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
