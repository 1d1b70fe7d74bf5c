//! Every command that moves a valve by every way out, on a device that falls silent for good: what was not confirmed is said and
//! ends with 4, and where a record can still be written, every view of it says so.

use std::process::Stdio;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use rustix::process::{Pid, Signal, kill_process};

use super::fake::Fake;
use super::last_word::{Said, prepared, silent_after_then, told};
use super::wire::driver;

pub const COMMANDS: [&str; 5] = [
    "run plan.toml --out out/run",
    "batch plan.toml --duts lot.csv --valve-reports all --out out/batch",
    "master plan.toml --station station.toml --serial GOOD",
    "msa plan.toml --metric hold/rmse --parts 2 --appraisers 2 --trials 2 --out out/msa",
    "probe",
];

/// What happens besides, at the moment at which the device falls silent or before.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Way {
    ByItself,
    Signal(Signal),
    /// Nothing that it prints on its standard output can be written.
    Deaf,
    /// No file grows beyond so many blocks of 512 bytes.
    FullDisk,
    /// The folder that it writes to is taken away.
    FolderGone,
}

fn one(command: &str, way: Way) {
    let folder = tempfile::tempdir().unwrap();
    let victim: Arc<Mutex<Option<Pid>>> = Arc::default();
    let (out, known) = (folder.path().to_path_buf(), Arc::clone(&victim));
    let device = silent_after_then(150, move || match way {
        Way::Signal(signal) => {
            let child = known.lock().unwrap().take();
            child.into_iter().for_each(|child| kill_process(child, signal).unwrap());
        }
        Way::FolderGone => ["out", "reports"].iter().for_each(|name| drop(std::fs::remove_dir_all(out.join(name)))),
        _ => (),
    });
    let before = match (way, command.starts_with("batch")) {
        // A batch needs its head and its journal before the valve moves.
        (Way::FullDisk, true) => "ulimit -f 8;",
        (Way::FullDisk, false) => "ulimit -f 0;",
        _ => "",
    };
    let after = if way == Way::Deaf { "> /dev/full" } else { "" };
    let line = format!("{command} --driver emulator-tcp --tcp {} {after}", device.address);
    let mut begun = prepared(folder.path(), &line, before);
    let child = begun.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    *victim.lock().unwrap() = Some(Pid::from_child(&child));
    let done = child.wait_with_output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let said = Said { code: done.status.code().unwrap_or(-1), out: text(&done.stdout), err: text(&done.stderr) };
    let what = format!("{way:?}, {line}");
    told(&what, &said);
    if matches!(way, Way::ByItself | Way::Signal(_)) {
        assert!(victim.lock().unwrap().is_none() || way == Way::ByItself, "{what}: the signal was never sent");
        if command.starts_with("run") {
            let read = |name: &str| std::fs::read_to_string(folder.path().join("out/run").join(name)).unwrap();
            for name in ["record.json", "report.html", "junit.xml"] {
                assert!(read(name).contains("SAFE STATE NOT CONFIRMED"), "{what}: {name} does not say so");
            }
        }
    }
}

#[test]
fn every_command_says_it_by_every_way_out() {
    let signals = [Signal::INT, Signal::TERM, Signal::HUP, Signal::QUIT, Signal::USR1].map(Way::Signal);
    let ways = [Way::ByItself, Way::Deaf, Way::FullDisk, Way::FolderGone].into_iter().chain(signals);
    let all: Vec<(&str, Way)> = ways.flat_map(|way| COMMANDS.map(|command| (command, way))).collect();
    std::thread::scope(|scope| {
        for some in all.chunks(all.len().div_ceil(5)) {
            scope.spawn(move || some.iter().for_each(|(command, way)| one(command, *way)));
        }
    });
}

/// A person who ends a probe finds the device at rest, and is told so.
#[test]
fn a_probe_that_is_stopped_leaves_the_device_at_rest() {
    let folder = tempfile::tempdir().unwrap();
    let victim: Arc<Mutex<Option<Pid>>> = Arc::default();
    let (known, slots) = (Arc::clone(&victim), AtomicU64::new(0));
    let device = Fake::start(&driver("emulator-tcp"), move |turn| {
        if turn.is_slot() && slots.fetch_add(1, Ordering::Relaxed) > 20 {
            let child = known.lock().unwrap().take();
            child.into_iter().for_each(|child| kill_process(child, Signal::INT).unwrap());
        }
    });
    let mut begun = prepared(folder.path(), &format!("probe --driver emulator-tcp --tcp {}", device.address), "");
    let child = begun.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    *victim.lock().unwrap() = Some(Pid::from_child(&child));
    let done = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&done.stderr);
    assert!(victim.lock().unwrap().is_none(), "the signal was never sent");
    assert!(done.status.code() == Some(5) && said.contains("stopped by a signal; safe state confirmed"), "{:?} {said}", done.status);
}
