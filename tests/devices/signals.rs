//! Every signal that can be caught, in the midst of every command that talks to a device, which answers to the end: it is left without a
//! current by the command itself, and the command says that it was stopped.

use std::cell::Cell;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use hil::rig::signals::SIGNALS;

use super::fake::Fake;
use super::last_word::prepared;
use super::metronome::in_time;
use super::ways_out::COMMANDS;
use super::wire::driver;

/// Sends the signal after some slots with a current (a probe sends none: after some slots), and looks at the end. False where other work
/// on the machine had ended the command before, or let the watchdog act; an error where the command lost its samples before.
fn stopped(command: &str, name: &'static str, number: i32) -> Result<bool, String> {
    let folder = tempfile::tempdir().unwrap();
    let victim: Arc<Mutex<Option<u32>>> = Arc::default();
    let (known, slots, probe) = (Arc::clone(&victim), AtomicU64::new(0), command.starts_with("probe"));
    let device = Fake::start(&driver("emulator-tcp"), move |turn| {
        let current = turn.request.get(10..14).is_some_and(|bytes| bytes != [0; 4]);
        if turn.is_slot() && (current || probe) && slots.fetch_add(1, Ordering::Relaxed) == 10 {
            let child = known.lock().unwrap().take().unwrap();
            let sent = Command::new("sh").args(["-c", &format!("kill -{number} {child}")]).status().unwrap();
            assert!(sent.success(), "{name}");
        }
    });
    let line = format!("{command} --driver emulator-tcp --tcp {}", device.address);
    let child = prepared(folder.path(), &line, "").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    *victim.lock().unwrap() = Some(child.id());
    let done = child.wait_with_output().unwrap();
    if victim.lock().unwrap().is_some() {
        return Ok(false);
    }
    let said = format!("{}{}", String::from_utf8_lossy(&done.stdout), String::from_utf8_lossy(&done.stderr));
    let what = format!("{name}, {line}: {:?}\n{said}", done.status);
    assert_eq!(device.coil_a(), 0.0, "{what}");
    assert!(!said.contains("NOT CONFIRMED"), "{what}");
    if done.status.code() == Some(4) && said.contains("in a row") {
        return Err(what);
    }
    assert_eq!(done.status.code(), Some(5), "{what}");
    assert!(said.contains("stopped by"), "{what}");
    // Once at the start, where it is shown to be armed: the host wrote zero, not the watchdog. A machine that is busy with other work
    // may keep the host from it for longer than the watchdog waits.
    Ok(device.trips() <= 1)
}

#[test]
fn every_signal_ends_every_command_in_the_safe_state() {
    let all: Vec<_> = SIGNALS.iter().flat_map(|(name, number)| COMMANDS.map(|command| (command, *name, *number))).collect();
    assert!(all.len() >= 100);
    std::thread::scope(|scope| {
        for some in all.chunks(all.len().div_ceil(6)) {
            scope.spawn(move || {
                for (command, name, number) in some {
                    let by_itself = Cell::new(false);
                    for _ in 0..5 {
                        in_time(0.02, || stopped(command, name, *number).map(|by_host| by_itself.set(by_host)));
                        if by_itself.get() {
                            break;
                        }
                    }
                    assert!(by_itself.get(), "{name}, {command}: five times not by the host itself");
                }
            });
        }
    });
}
