//! The options that say how a recording is read; the same for every command that reads one.

use std::fs::Metadata;
use std::path::{Path, PathBuf};

use clap::Args;

use super::CliError;
use super::input::InputShape;
use crate::digest::sha256_of_file;
use crate::recording::{Encoding, Mapping, Reading, Recording, RecordingError, Selection};
use crate::units::TIME;

/// How a foreign recording is read.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Recording")]
pub struct ReadArgs {
    /// Take a channel from a foreign column: current_a="I_cmd [mA]", time_s="Datum + Zeit", pressure_bar="0.98 * p"
    #[arg(long, value_name = "CH=EXPR")]
    pub map: Vec<String>,
    /// Mapping file, as `hil inspect` writes it; --map and the options below go before what it says
    #[arg(long, value_name = "FILE")]
    pub mapping: Option<PathBuf>,
    /// Take this run only; more than once for more of them
    #[arg(long = "run", value_name = "NAME")]
    pub runs: Vec<String>,
    /// Leave out what lies before this time of each run's clock; a plain number is in s
    #[arg(long, value_name = "TIME", value_parser = time, allow_hyphen_values = true)]
    pub from: Option<f64>,
    /// Leave out what lies behind this time of each run's clock; a plain number is in s
    #[arg(long, value_name = "TIME", value_parser = time, allow_hyphen_values = true)]
    pub to: Option<f64>,
    /// Line of a text that holds the names, counted from 1; found where it is not given
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub header_row: Option<u32>,
    /// Encoding of a text: utf-8, utf-16, latin-1
    #[arg(long, value_name = "NAME")]
    pub encoding: Option<Encoding>,
    /// What the command does between its samples; found from the data, or as the model was identified, where it is not
    /// given
    #[arg(long, value_enum)]
    pub input: Option<InputShape>,
}

fn time(text: &str) -> Result<f64, String> {
    let with_unit = if text.trim().parse::<f64>().is_ok() { format!("{text} s") } else { text.to_string() };
    TIME.parse(&with_unit).map_err(|e| e.to_string())
}

/// Refuses a recording that is named twice, and a copy of one: what it shows would count twice, and confirm itself.
pub fn distinct(recordings: &[PathBuf]) -> Result<(), CliError> {
    let mut seen = Vec::new();
    let mut files: Vec<(u64, &PathBuf)> = Vec::new();
    for path in recordings {
        let place = path.canonicalize().unwrap_or_else(|_| path.clone());
        if seen.contains(&place) {
            return Err(CliError::usage(format!("{}: is named twice, and would count twice", path.display())));
        }
        seen.push(place);
        // What cannot be read is told where it is read, and a pipe can be read only once.
        let Some(length) = path.metadata().ok().filter(Metadata::is_file).map(|file| file.len()) else { continue };
        let is_copy = |of: &Path| sha256_of_file(path).ok().zip(sha256_of_file(of).ok()).is_some_and(|(one, other)| one == other);
        if let Some((_, first)) = files.iter().find(|(known, first)| *known == length && is_copy(first)) {
            return Err(CliError::usage(format!("{}: is a copy of {}, and would count twice", path.display(), first.display())));
        }
        files.push((length, path));
    }
    Ok(())
}

impl ReadArgs {
    /// What was typed, and what the mapping file says beside it.
    pub fn reading(&self) -> Result<Reading, CliError> {
        let mut typed = Reading {
            map: Vec::new(),
            header_row: self.header_row.map(|row| row as usize),
            encoding: self.encoding,
            select: Selection { runs: self.runs.clone(), from_s: self.from, to_s: self.to },
            input: self.input.map(Into::into),
        };
        let mut file = self.mapping.clone();
        for text in &self.map {
            // `--map log.map.toml` can only mean the file.
            if !text.contains('=') && text.ends_with(".toml") && file.is_none() {
                file = Some(text.into());
            } else {
                typed.map.push(Mapping::parse(text).map_err(CliError::usage)?);
            }
        }
        if let (Some(from), Some(to)) = (self.from, self.to)
            && from >= to
        {
            return Err(CliError::usage(format!("--from {from} s does not lie before --to {to} s")));
        }
        match file {
            Some(path) => Ok(typed.or(Reading::load(&path).map_err(CliError::input)?)),
            None => Ok(typed),
        }
    }

    /// The files beside the recording that it is read with.
    pub fn files(&self) -> Vec<PathBuf> {
        let typed = self.map.iter().filter(|m| !m.contains('=') && m.ends_with(".toml")).map(PathBuf::from);
        self.mapping.iter().cloned().chain(typed).collect()
    }

    /// Reads a recording as it was asked for.
    pub fn read(&self, path: &Path) -> Result<Recording, CliError> {
        Recording::read_as(path, &self.reading()?).map_err(|e| match e {
            RecordingError::Mapping { .. } => CliError::usage(e),
            other => CliError::input(other),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_copy_of_a_recording_is_refused_and_what_is_not_there_is_left_to_the_reader() {
        let folder = tempfile::tempdir().unwrap();
        let of = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            path
        };
        let (a, copy, b) = (of("a.csv", "1"), of("copy.csv", "1"), of("b.csv", "2"));
        assert!(distinct(&[a.clone(), b, folder.path().join("gone.csv")]).is_ok());
        let refused = distinct(&[a, copy]).unwrap_err().to_string();
        assert!(refused.contains("copy.csv: is a copy of") && refused.contains("would count twice"), "{refused}");
    }

    #[cfg(unix)]
    #[test]
    fn a_pipe_is_left_to_the_one_who_reads_it() {
        let folder = tempfile::tempdir().unwrap();
        let pipes = ["a", "b"].map(|name| folder.path().join(name));
        for pipe in &pipes {
            assert!(std::process::Command::new("mkfifo").arg(pipe).status().unwrap().success());
        }
        // To open a pipe that nobody writes to would wait for ever.
        assert!(distinct(&pipes).is_ok());
    }
}
