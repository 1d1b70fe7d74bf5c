//! The last word of a command: a current that nobody saw go stands above every other message, and above every other exit
//! code.

use std::sync::{Arc, Mutex};

use super::exit;
use super::lock::lock;
use crate::rig::SafeState;
use crate::rig::loop_thread::LoopControl;

/// What was left energised by this process, as far as anybody knows.
static UNCONFIRMED: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// Notes that the safe state of a rig was not confirmed.
pub fn unconfirmed(evidence: &str) {
    lock(&UNCONFIRMED).push(evidence.into());
}

/// Watches over one rig: whatever way leads out of its run, a panic included, an unconfirmed safe state is noted.
pub struct Watched(pub Arc<LoopControl>);

impl Drop for Watched {
    fn drop(&mut self) {
        if self.0.left_energised() {
            let state = self.0.safe_state();
            unconfirmed(state.as_ref().map_or("the program ended before it could be read back", |s| s.evidence.as_str()));
        }
    }
}

/// Notes the outcome of a safe state that no loop watched over.
pub fn note(state: &SafeState) {
    if !state.confirmed {
        unconfirmed(&state.evidence);
    }
}

/// Somebody has taken away what was left energised.
pub fn settled(evidence: &str) {
    lock(&UNCONFIRMED).retain(|known| known != evidence);
}

/// Says it, where there is anything to say; the exit code of the process.
pub fn say(code: u8) -> u8 {
    let unconfirmed = std::mem::take(&mut *lock(&UNCONFIRMED));
    if unconfirmed.is_empty() {
        return code;
    }
    super::note(&banner(&unconfirmed));
    exit::RIG
}

fn banner(unconfirmed: &[String]) -> String {
    let rule = "#".repeat(72);
    let mut lines = vec![rule.clone(), "###".into(), "###   SAFE STATE NOT CONFIRMED - REMOVE POWER NOW".into(), "###".into(), rule];
    lines.extend(unconfirmed.iter().map(|evidence| format!("  {evidence}")));
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unconfirmed_safe_state_stands_above_every_exit_code() {
        assert_eq!(say(exit::NOT_STORED), exit::NOT_STORED);
        let control = Arc::new(LoopControl::default());
        drop(Watched(Arc::clone(&control)));
        control.energised();
        control.note_safe(&SafeState::of(true, "0 A"));
        drop(Watched(Arc::clone(&control)));
        assert_eq!(say(exit::DONE), exit::DONE);
        control.energised();
        let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            let _watched = Watched(Arc::clone(&control));
            panic!("on purpose")
        }));
        assert!(result.is_err());
        note(&SafeState::of(false, "current still reads 0.5"));
        assert_eq!((say(exit::DONE), say(exit::DONE)), (exit::RIG, exit::DONE), "said once");
        assert!(banner(&["x".into()]).contains("SAFE STATE NOT CONFIRMED - REMOVE POWER"));
    }
}
