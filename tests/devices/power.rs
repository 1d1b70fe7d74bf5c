//! A power cut after every system call of a batch: what was told is there, nothing is there twice, nothing is torn.
//!
//! `strace` writes down what the program asks of the system; this replays it call by call on a model of a disk that
//! forgets whatever was not put on it (`fsync`), and opens what would be left.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;

use hil::batch::store;
use hil::rig::emulator::{Emulator, Faults, Listening};

use super::metronome::{BUSY, in_time};
use super::wire::{driver, listen, simple_valve};

const PLAN: &str = r#"
schema = "hil.plan/1"
name = "power"
rate = "50 Hz"
[[phase]]
name = "hold"
stimulus.hold = { at = "8 bar", for = "300 ms" }
measure = [{ metric.rmse = {}, limit = { max = "30 bar" } }]
"#;

/// A call with its arguments, and what came of it.
#[derive(Debug, Clone)]
struct Call {
    name: String,
    args: String,
    result: i64,
}

/// The calls of a log in the order in which they ended; a call that was cut in two by another thread is joined again.
fn calls(log: &str) -> Vec<Call> {
    let mut open: BTreeMap<String, String> = BTreeMap::new();
    let mut calls = Vec::new();
    for line in log.lines() {
        let Some((pid, rest)) = line.split_once(' ') else { continue };
        let rest = rest.trim_start();
        let whole = if let Some(begin) = rest.strip_suffix("<unfinished ...>") {
            open.insert(pid.into(), begin.trim_end().into());
            continue;
        } else if let Some((_, end)) = rest.strip_prefix("<... ").and_then(|r| r.split_once(" resumed>")) {
            format!("{}{end}", open.remove(pid).unwrap_or_default())
        } else {
            rest.to_string()
        };
        let Some((call, result)) = whole.rsplit_once(" = ") else { continue };
        let Some((name, args)) = call.trim_end().strip_suffix(')').and_then(|c| c.split_once('(')) else { continue };
        let result = result.split(|c: char| !c.is_ascii_digit() && c != '-').next().unwrap_or_default().parse().unwrap_or(-1);
        calls.push(Call { name: name.into(), args: args.into(), result });
    }
    calls
}

/// The bytes of the strings of a call: `"\x68\x69"`.
fn strings(args: &str) -> Vec<Vec<u8>> {
    args.split('"')
        .skip(1)
        .step_by(2)
        .map(|s| s.split("\\x").skip(1).filter_map(|h| u8::from_str_radix(h.get(..2)?, 16).ok()).collect())
        .collect()
}

/// The path that stands behind a descriptor: `5</a/b>`.
fn of_descriptor(args: &str) -> Option<PathBuf> {
    let inside = args.split_once('<')?.1.split_once('>')?.0;
    // strace writes the path in the same hex as strings, or as it is.
    let bytes: Vec<u8> = inside.split("\\x").skip(1).filter_map(|h| u8::from_str_radix(h.get(..2)?, 16).ok()).collect();
    let text = if bytes.is_empty() { inside.to_string() } else { String::from_utf8_lossy(&bytes).into_owned() };
    Some(PathBuf::from(text.trim_end_matches(" (deleted)")))
}

#[derive(Debug, Clone, Default)]
struct File {
    now: Vec<u8>,
    on_disk: Vec<u8>,
}

/// A disk: what the program sees, and what is left of it without power.
#[derive(Debug, Clone, Default)]
struct Disk {
    root: PathBuf,
    files: Vec<File>,
    names: BTreeMap<PathBuf, usize>,
    folders: BTreeSet<PathBuf>,
    names_on_disk: BTreeMap<PathBuf, usize>,
    folders_on_disk: BTreeSet<PathBuf>,
}

impl Disk {
    fn path(&self, text: &[u8]) -> PathBuf {
        self.root.join(PathBuf::from(String::from_utf8_lossy(text).into_owned()))
    }

    fn apply(&mut self, call: &Call) {
        if call.result < 0 {
            return;
        }
        let texts = strings(&call.args);
        let at = |k: usize| texts.get(k).map(|t| self.path(t));
        match call.name.as_str() {
            "openat" | "open" | "creat" => {
                let Some(path) = at(0) else { return };
                let new = || File::default();
                if call.args.contains("O_CREAT") && !self.names.contains_key(&path) {
                    self.files.push(new());
                    self.names.insert(path.clone(), self.files.len() - 1);
                }
                if let (true, Some(file)) = (call.args.contains("O_TRUNC"), self.names.get(&path)) {
                    self.files[*file].now.clear();
                }
            }
            "write" | "pwrite64" | "writev" => {
                let Some(file) = of_descriptor(&call.args).and_then(|p| self.names.get(&p).copied()) else { return };
                let bytes: Vec<u8> = texts.concat();
                self.files[file].now.extend(&bytes[..(call.result as usize).min(bytes.len())]);
            }
            "ftruncate" => {
                let length = call.args.rsplit(", ").next().and_then(|n| n.parse().ok()).unwrap_or(0);
                if let Some(file) = of_descriptor(&call.args).and_then(|p| self.names.get(&p).copied()) {
                    self.files[file].now.truncate(length);
                }
            }
            "fsync" | "fdatasync" => {
                let Some(path) = of_descriptor(&call.args) else { return };
                if let Some(file) = self.names.get(&path) {
                    self.files[*file].on_disk = self.files[*file].now.clone();
                    return;
                }
                let inside = |p: &PathBuf| p.parent() == Some(path.as_path());
                self.names_on_disk.retain(|p, _| !inside(p));
                self.names_on_disk.extend(self.names.iter().filter(|(p, _)| inside(p)).map(|(p, f)| (p.clone(), *f)));
                self.folders_on_disk.extend(self.folders.iter().filter(|p| inside(p)).cloned());
            }
            "rename" | "renameat" | "renameat2" => {
                let (Some(from), Some(to)) = (at(0), at(1)) else { return };
                if let Some(file) = self.names.remove(&from) {
                    self.names.insert(to, file);
                }
            }
            "mkdir" | "mkdirat" => drop(at(0).map(|path| self.folders.insert(path))),
            "unlink" | "unlinkat" => drop(at(0).map(|path| self.names.remove(&path))),
            _ => {}
        }
    }

    /// Writes what is left into a folder. `names`: whether names survive that were not put on the disk, with what their files have
    /// there; some file systems order it so.
    fn left(&self, into: &Path, names: bool) {
        let (files, folders) = if names { (&self.names, &self.folders) } else { (&self.names_on_disk, &self.folders_on_disk) };
        let place = |path: &Path| path.strip_prefix(&self.root).map(|p| into.join(p));
        for folder in folders {
            if let Ok(place) = place(folder) {
                std::fs::create_dir_all(place).unwrap();
            }
        }
        for (path, file) in files {
            let known = path.ancestors().skip(1).take_while(|p| *p != self.root).all(|p| folders.contains(p));
            if let (Ok(place), true, false) = (place(path), known, path.to_string_lossy().contains("index.sqlite")) {
                std::fs::write(place, &self.files[*file].on_disk).unwrap();
            }
        }
    }
}

fn hil(folder: &Path, line: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hil"));
    command.current_dir(folder).args(line.split_whitespace()).stdin(Stdio::null());
    command
}

/// Runs a batch under `strace` and gives its calls; `None` where there is no `strace` here, unless the tests are those of CI. An error where
/// the batch had no verdict for each valve.
fn traced(folder: &Path, line: &str) -> Result<Option<Vec<Call>>, String> {
    let log = folder.join("strace.log");
    let trace =
        "openat,open,creat,write,pwrite64,writev,ftruncate,fsync,fdatasync,rename,renameat,renameat2,mkdir,mkdirat,unlink,unlinkat,sendto";
    let mut command = Command::new("strace");
    command.current_dir(folder).args(["-f", "-y", "-qq", "-xx", "-s", "1000000", "-e", &format!("trace={trace}"), "-o"]).arg(&log);
    let status = command
        .arg(env!("CARGO_BIN_EXE_hil"))
        .args(line.split_whitespace())
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    match status {
        Ok(status) if status.code().is_some_and(|c| c <= 1) => Ok(Some(calls(&std::fs::read_to_string(log).unwrap()))),
        Ok(status) => Err(format!("under strace: {status}")),
        Err(error) => {
            assert!(std::env::var_os("HIL_PEERS").is_none(), "strace: {error}");
            Ok(None)
        }
    }
}

fn bench() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let root = env!("CARGO_MANIFEST_DIR");
    std::fs::write(folder.path().join("plan.toml"), [BUSY, PLAN].concat()).unwrap();
    std::fs::write(folder.path().join("lot.csv"), "serial\nA-1\nA-2\nA-3\n").unwrap();
    for shipped in ["valves", "drivers"] {
        std::os::unix::fs::symlink(format!("{root}/{shipped}"), folder.path().join(shipped)).unwrap();
    }
    folder
}

/// The serial numbers whose verdict was told by now.
fn told(call: &Call) -> Vec<String> {
    let on_terminal = call.name == "write" && (call.args.starts_with("1<") || call.args.starts_with("2<"));
    let text = if on_terminal { String::from_utf8_lossy(&strings(&call.args).concat()).into_owned() } else { String::new() };
    text.lines()
        .filter(|l| l.contains("PASS"))
        .filter_map(|l| l.split_whitespace().next().filter(|s| s.starts_with("A-")).map(String::from))
        .collect()
}

/// Cuts the power after every call and looks at what is left.
fn cut_after_every_call(folder: &Path, line: &str, calls: &[Call], resume: bool) -> usize {
    let root = folder.canonicalize().unwrap();
    let mut disk = Disk { root, ..Disk::default() };
    let mut verdicts: BTreeSet<String> = BTreeSet::new();
    let (mut cuts, mut currents) = (0, BTreeSet::new());
    for (k, call) in calls.iter().enumerate() {
        disk.apply(call);
        verdicts.extend(told(call));
        let energises = call.name == "sendto"
            && strings(&call.args).first().is_some_and(|f| f.get(7) == Some(&23) && f.get(17..21).is_some_and(|s| s != [0; 4]));
        if call.name == "sendto" && !energises {
            continue;
        }
        for names in [false, true] {
            let left = tempfile::tempdir().unwrap();
            disk.left(left.path(), names);
            let out = left.path().join("out");
            cuts += 1;
            let loaded = store::load(&out).unwrap_or_else(|e| panic!("cut {k}, {call:?}: {e}"));
            assert!(loaded.damage.is_empty(), "cut {k}: {:?}", loaded.damage);
            let there: Vec<&str> = loaded.tally.attempts().iter().map(|a| a.dut.serial.as_str()).collect();
            let once: BTreeSet<&str> = there.iter().copied().collect();
            assert_eq!(once.len(), there.len(), "cut {k}: a valve is there twice");
            for serial in &verdicts {
                assert!(once.contains(serial.as_str()), "cut {k}: the verdict of {serial} was told, and is lost");
            }
            if energises {
                let begun = there.len() + loaded.interrupted.len();
                assert!(begun > 0, "cut {k}: a current flows, and the journal does not know of it");
                currents.insert(begun);
            }
            // What is left can be gone on with, to the end of the batch.
            if resume && !energises && k % 40 == 0 {
                for shared in ["plan.toml", "lot.csv", "valves", "drivers"] {
                    std::os::unix::fs::symlink(folder.join(shared), left.path().join(shared)).unwrap();
                }
                let done = hil(left.path(), &format!("{line} --resume --retest")).output().unwrap();
                assert!(done.status.code().is_some_and(|c| c <= 1), "cut {k}: {}", String::from_utf8_lossy(&done.stderr));
                assert_eq!(store::load(&out).unwrap().last.len(), 3, "cut {k}");
            }
        }
    }
    assert_eq!(verdicts.len(), 3, "{verdicts:?}");
    assert!(resume || currents.len() == 3, "each valve's attempt is on the disk before its current: {currents:?}");
    cuts
}

#[test]
fn a_power_cut_after_any_call_of_a_batch_loses_tears_and_doubles_nothing() {
    let folder = bench();
    let line = "batch plan.toml --duts lot.csv --sim --threads 1 --out out";
    let Some(calls) = traced(folder.path(), line).unwrap() else { return };
    let cuts = cut_after_every_call(folder.path(), line, &calls, true);
    println!("{cuts} cuts after {} calls", calls.len());
    assert!(cuts > 100, "{cuts} cuts in {} calls", calls.len());
}

#[test]
fn the_disk_knows_of_an_attempt_before_its_current_flows() {
    in_time(0.02, || {
        let folder = bench();
        let profile = driver("emulator-tcp");
        let emulator = Emulator::start(Arc::new(profile.clone()), simple_valve(), &listen(&profile), Faults::none(), false).unwrap();
        let Listening::Tcp(address) = emulator.listening() else { panic!("TCP") };
        let line = format!("batch plan.toml --duts lot.csv --driver emulator-tcp --tcp {address} --out out");
        let Some(calls) = traced(folder.path(), &line)? else { return Ok(()) };
        let cuts = cut_after_every_call(folder.path(), &line, &calls, false);
        println!("{cuts} cuts after {} calls", calls.len());
        assert!(cuts > 100, "{cuts} cuts in {} calls", calls.len());
        Ok(())
    });
}

#[test]
fn calls_are_read_as_strace_writes_them() {
    let log = "7 openat(AT_FDCWD</w>, \"\\x6f\\x75\\x74\", O_WRONLY|O_CREAT, 0666) = 5</w/out>\n7 write(5</w/out>, \"\\x68\\x69\", 2 <unfinished ...>\n8 fsync(6</w>) = 0\n7 <... write resumed>) = 2\n";
    let calls = calls(log);
    assert_eq!(calls.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["openat", "fsync", "write"]);
    let mut disk = Disk { root: "/w".into(), ..Disk::default() };
    calls.iter().for_each(|c| disk.apply(c));
    assert_eq!(disk.files[0].now, b"hi");
    assert_eq!((disk.names_on_disk.len(), disk.files[0].on_disk.len()), (1, 0), "the name was put on the disk, the bytes were not");
}
