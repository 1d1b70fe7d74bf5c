//! A diagnosis at the page: the command itself in a process of its own, so that it takes no time from a loop, and whatever is wrong
//! with a foreign file stays there.

use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};

use serde_json::{Value, json};

use super::super::lock::lock;
use crate::station::{Hub, Refused};

/// Endings of the recordings that are read.
const ENDINGS: [&str; 3] = ["csv", "parquet", "mf4"];
/// Pages of diagnoses that are kept.
const KEPT: usize = 8;
/// How much less than a test a diagnosis is worth to the computer (`nice`).
const NICENESS: &str = "19";

/// The diagnoses of a station: one at a time.
pub struct Diagnosing {
    hub: Arc<Hub>,
    state: Arc<Mutex<State>>,
}

#[derive(Default)]
struct State {
    last: u64,
    busy: bool,
    pages: VecDeque<(u64, String)>,
}

/// A folder of one diagnosis; gone with it.
struct Desk(PathBuf);

impl Drop for Desk {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

impl Diagnosing {
    /// Nothing is diagnosed yet.
    pub fn new(hub: Arc<Hub>) -> Self {
        Self { hub, state: Arc::default() }
    }

    /// Begins with a recording that was dropped on the page. Of its name only the ending counts.
    pub fn of_bytes(&self, name: &str, bytes: &[u8], model: &str) -> Result<u64, Refused> {
        let ending = name.rsplit('.').next().unwrap_or_default().to_lowercase();
        let Some(ending) = ENDINGS.iter().find(|e| **e == ending) else {
            return Err(Refused(format!("a recording ends with one of: .{}", ENDINGS.join(", ."))));
        };
        let number = self.take()?;
        self.begin(number, name, model, |desk| {
            let path = desk.join(format!("recording.{ending}"));
            std::fs::File::create_new(&path).and_then(|mut f| f.write_all(bytes))?;
            Ok(path)
        })
    }

    /// Begins with the trace of a record in `folder`.
    pub fn of_record(&self, folder: &Path, serial: &str, model: &str) -> Result<u64, Refused> {
        let trace = folder.join("trace.parquet");
        if !trace.is_file() {
            return Err(Refused::because("this record has no trace"));
        }
        let number = self.take()?;
        self.begin(number, serial, model, |_| Ok(trace))
    }

    /// The page of a diagnosis.
    pub fn page(&self, number: u64) -> Result<String, Refused> {
        let state = lock(&self.state);
        let found = state.pages.iter().find(|p| p.0 == number).map(|p| p.1.clone());
        found.ok_or_else(|| Refused::because("this diagnosis is not kept any more"))
    }

    fn take(&self) -> Result<u64, Refused> {
        let mut state = lock(&self.state);
        if state.busy {
            return Err(Refused::because("a diagnosis is at work; one at a time"));
        }
        state.busy = true;
        state.last += 1;
        Ok(state.last)
    }

    fn begin(
        &self,
        number: u64,
        name: &str,
        model: &str,
        recording: impl FnOnce(&Path) -> std::io::Result<PathBuf>,
    ) -> Result<u64, Refused> {
        let free = || lock(&self.state).busy = false;
        let started = || -> std::io::Result<(Desk, Child)> {
            let desk = Desk(std::env::temp_dir().join(format!("hil-{:032x}", rand::random::<u128>())));
            make_private(&desk.0)?;
            let path = recording(&desk.0)?;
            let child = command(&desk.0, &path, model)?.spawn()?;
            Ok((desk, child))
        };
        let (desk, child) = started().map_err(|e| {
            free();
            Refused(format!("the diagnosis cannot begin: {e}"))
        })?;
        let (hub, state, name) = (Arc::clone(&self.hub), Arc::clone(&self.state), name.to_string());
        let watched = std::thread::Builder::new().name("diagnosis".into()).spawn(move || watch(&hub, &state, number, &name, desk, child));
        watched.map(|_| number).map_err(|e| {
            free();
            Refused(format!("the diagnosis cannot begin: {e}"))
        })
    }
}

fn make_private(folder: &Path) -> std::io::Result<()> {
    let mut builder = std::fs::DirBuilder::new();
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(folder)
}

/// `hil diagnose`, behind everything else that this computer does.
fn command(desk: &Path, recording: &Path, model: &str) -> std::io::Result<Command> {
    let program = std::env::current_exe()?;
    let mut command = Command::new("nice");
    command.args(["-n", NICENESS]).arg(program).arg("diagnose").arg(std::path::absolute(recording)?);
    command.args(["--model", model, "--watch", "--color", "never", "--report"]).arg(desk.join("page.html"));
    // One core stays for the loops.
    let cores = std::thread::available_parallelism().map_or(1, usize::from).saturating_sub(1).max(1);
    command.env("RAYON_NUM_THREADS", cores.to_string());
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    Ok(command)
}

/// Shows the candidates as they come, and the end.
fn watch(hub: &Hub, state: &Mutex<State>, number: u64, name: &str, desk: Desk, mut child: Child) {
    let tell = |mut value: Value| {
        value["id"] = number.into();
        hub.tell("diagnosis", &value);
    };
    tell(json!({ "state": "begun", "name": name }));
    let summary = child.stdout.take().map(|out| std::thread::spawn(move || std::io::read_to_string(out).unwrap_or_default()));
    let mut said = String::new();
    for line in child.stderr.take().into_iter().flat_map(|err| BufReader::new(err).lines().map_while(Result::ok)) {
        match serde_json::from_str::<Value>(&line) {
            Ok(tried) if tried["candidate"].is_string() => tell(json!({ "state": "tried", "tried": tried })),
            _ => said = if said.is_empty() { line } else { format!("{said}\n{line}") },
        }
    }
    let code = child.wait().ok().and_then(|s| s.code());
    let summary = summary.and_then(|s| s.join().ok()).unwrap_or_default();
    let page = std::fs::read_to_string(desk.0.join("page.html"));
    drop(desk);
    let mut held = lock(state);
    held.busy = false;
    match (code, page) {
        (Some(0), Ok(page)) => {
            held.pages.push_back((number, page));
            if held.pages.len() > KEPT {
                held.pages.pop_front();
            }
            drop(held);
            tell(json!({ "state": "done", "summary": summary }));
        }
        _ => {
            drop(held);
            let said = said.strip_prefix("error: ").unwrap_or(&said).to_string();
            tell(json!({ "state": "failed", "why": if said.is_empty() { "the diagnosis ended without an answer".into() } else { said } }));
        }
    }
}
