//! The recordings that a model was identified from: data of the good valve, found again by their names and their SHA-256.

use std::path::{Path, PathBuf};

use super::identify::sha256;
use crate::recording::{Recording, RecordingError};
use crate::valve::{Identification, Valve};

/// What a model was identified from, where it was found.
#[derive(Default)]
pub struct GoodData {
    /// The same files as then, none of them in question.
    pub recordings: Vec<Recording>,
    /// What was not found or not read, and why: nothing is said of a change by it.
    pub missing: Vec<String>,
}

impl GoodData {
    /// Looks beside the model, then beside the recordings in question: projects keep models and recordings in folders of their own.
    pub fn of((model, valve): (&Path, &Valve), in_question: &[PathBuf], read: impl Fn(&Path) -> Result<Recording, RecordingError>) -> Self {
        let mut good = Self::default();
        let sources: Vec<_> = valve.identification.iter().flat_map(Identification::sources).collect();
        // A recording in question says nothing against itself, under whatever name it lies there.
        let asked: Vec<String> = if sources.is_empty() { Vec::new() } else { in_question.iter().filter_map(|p| sha256(p).ok()).collect() };
        for (name, digest) in sources.into_iter().filter(|(_, digest)| !asked.iter().any(|asked| asked == digest)) {
            let places =
                || std::iter::once(model).chain(in_question.iter().map(PathBuf::as_path)).map(|beside| beside.with_file_name(name));
            match places().find(|path| sha256(path).is_ok_and(|found| found == digest)) {
                Some(path) => match read(&path) {
                    Ok(recording) => good.recordings.push(recording),
                    Err(e) => good.missing.push(e.to_string()),
                },
                None if places().any(|path| path.exists()) => good.missing.push(format!("{name} is another file by now")),
                None => good.missing.push(format!("{name} lies neither beside the model nor beside the recording")),
            }
        }
        good
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::digest::sha256_of_file;

    #[test]
    fn it_is_found_beside_the_model_or_the_recording_and_only_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let text = "time_s,current_a,pressure_bar\n0,0,0\n0.1,0.5,5\n0.2,0.6,6\n";
        for name in ["valves", "recordings"] {
            std::fs::create_dir(at(name)).unwrap();
        }
        std::fs::write(at("recordings/good.csv"), text).unwrap();
        std::fs::write(at("recordings/drive.csv"), text.replace("0,0,0", "0,0,1")).unwrap();
        let digest = sha256_of_file(&at("recordings/good.csv")).unwrap();
        let mut valve = Valve::from_toml(include_str!("../../valves/paper.toml"), "paper").unwrap();
        let look = |valve: &Valve, asked: &str| {
            let good = GoodData::of((&at("valves/valve.toml"), valve), &[at(asked)], |path| Recording::read(path, &[]));
            (good.recordings.len(), good.missing)
        };
        assert_eq!(look(&valve, "recordings/drive.csv"), (0, vec![]));
        valve.identification = Some(Identification { recording: "good.csv".into(), sha256: Some(digest), ..Identification::default() });
        assert_eq!(look(&valve, "recordings/drive.csv"), (1, vec![]));
        assert_eq!(look(&valve, "recordings/good.csv"), (0, vec![]));
        std::fs::copy(at("recordings/good.csv"), at("recordings/again.csv")).unwrap();
        assert_eq!(look(&valve, "recordings/again.csv"), (0, vec![]));
        std::fs::rename(at("recordings/good.csv"), at("valves/good.csv")).unwrap();
        assert_eq!(look(&valve, "recordings/drive.csv"), (1, vec![]));
        // A newer recording of that name beside the model does not hide the one that was meant.
        std::fs::rename(at("valves/good.csv"), at("recordings/good.csv")).unwrap();
        std::fs::write(at("valves/good.csv"), "another").unwrap();
        assert_eq!(look(&valve, "recordings/drive.csv"), (1, vec![]));
        std::fs::remove_file(at("recordings/good.csv")).unwrap();
        assert_eq!(look(&valve, "recordings/drive.csv"), (0, vec!["good.csv is another file by now".to_owned()]));
        std::fs::remove_file(at("valves/good.csv")).unwrap();
        let (found, missing) = look(&valve, "recordings/drive.csv");
        assert!(found == 0 && missing[0].contains("good.csv lies neither beside"), "{missing:?}");
    }
}
