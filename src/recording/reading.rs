//! How a foreign log is read: mapping, selection, header, encoding; as options, or as a file beside the log.

use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Mapping, Recording, RecordingError, Run};
use crate::document;
use crate::units::Time;
use crate::valve::Input;

/// The schema key of a mapping file.
pub const MAPPING_SCHEMA: &str = "hil.mapping/1";

/// How a recording is read.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Reading {
    /// Where each channel comes from.
    pub map: Vec<Mapping>,
    /// Number of the line that holds the header, counted from 1; found where it is not given.
    pub header_row: Option<usize>,
    /// Encoding of a text; UTF-8, or what the file shows, where it is not given.
    pub encoding: Option<Encoding>,
    /// What is kept of what was read.
    pub select: Selection,
    /// What the command does between its samples, where that is known.
    pub input: Option<Input>,
}

/// Encodings of a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Encoding {
    /// UTF-8.
    #[serde(rename = "utf-8")]
    Utf8,
    /// UTF-16, either byte order.
    #[serde(rename = "utf-16")]
    Utf16,
    /// Windows-1252, which holds Latin-1.
    #[serde(rename = "latin-1", alias = "windows-1252")]
    Latin1,
}

impl Encoding {
    /// Every encoding.
    pub const ALL: [Self; 3] = [Self::Utf8, Self::Utf16, Self::Latin1];

    /// As it is typed.
    pub fn name(self) -> &'static str {
        match self {
            Self::Utf8 => "utf-8",
            Self::Utf16 => "utf-16",
            Self::Latin1 => "latin-1",
        }
    }
}

impl std::str::FromStr for Encoding {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        match text.to_ascii_lowercase().as_str() {
            "utf-8" | "utf8" => Ok(Self::Utf8),
            "utf-16" | "utf16" => Ok(Self::Utf16),
            "latin-1" | "latin1" | "iso-8859-1" | "windows-1252" | "cp1252" => Ok(Self::Latin1),
            _ => Err(format!("`{text}` is no encoding that is known; allowed: {}", Self::ALL.map(Self::name).join(", "))),
        }
    }
}

/// What is kept of a recording.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Selection {
    /// Names of the runs; empty for all.
    pub runs: Vec<String>,
    /// From this time of each run's clock on [s].
    pub from_s: Option<f64>,
    /// Up to this time of each run's clock [s].
    pub to_s: Option<f64>,
}

/// A mapping file: what `hil inspect` writes.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MappingFile {
    /// `hil.mapping/1`.
    pub schema: String,
    /// Where each channel comes from, as after `--map`: `current_a = "I_cmd [mA]"`.
    #[serde(default)]
    pub map: std::collections::BTreeMap<String, String>,
    /// What is kept.
    #[serde(default)]
    pub select: SelectFile,
    /// How the text is read.
    #[serde(default)]
    pub read: ReadFile,
}

/// What is kept of a recording, as it is written.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SelectFile {
    /// Names of the runs; all where it is not given.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub run: Vec<String>,
    /// From this time of each run's clock on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from: Option<Time>,
    /// Up to this time of each run's clock.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub to: Option<Time>,
}

/// How a text is read, as it is written.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReadFile {
    /// Number of the line that holds the header, counted from 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub header_row: Option<usize>,
    /// Encoding of the text.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub encoding: Option<Encoding>,
    /// What the command does between its samples: `held` from message to message, or on a straight line (`ramp`).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub input: Option<Input>,
}

impl Reading {
    /// Reads a mapping file.
    ///
    /// # Errors
    /// What is wrong with its place in the file.
    pub fn load(path: &Path) -> Result<Self, RecordingError> {
        let wrong = |e: document::DocumentError| RecordingError::MappingFile(e.to_string());
        let text = document::read(path).map_err(wrong)?;
        let name = path.display().to_string();
        document::expect_schema(&text, &name, MAPPING_SCHEMA, "a mapping file").map_err(wrong)?;
        let file: MappingFile = document::parse(&text, &name).map_err(wrong)?;
        let refused = |key: &str, problem: &str| wrong(document::underline_key(&text, &name, key, problem));
        let mut map = Vec::new();
        for (channel, text) in &file.map {
            map.push(Mapping::parse(&format!("{channel}={text}")).map_err(|e| match e {
                RecordingError::Mapping { what, .. } => refused(&format!("map.{channel}"), &what),
                other => other,
            })?);
        }
        let select = Selection { runs: file.select.run, from_s: file.select.from.map(Time::value), to_s: file.select.to.map(Time::value) };
        Ok(Self { map, header_row: file.read.header_row, encoding: file.read.encoding, select, input: file.read.input })
    }

    /// What was typed beside a mapping file goes before what stands in it.
    pub fn or(mut self, file: Self) -> Self {
        for mapping in file.map {
            if !self.map.iter().any(|m| m.role == mapping.role) {
                self.map.push(mapping);
            }
        }
        if self.select.runs.is_empty() {
            self.select.runs = file.select.runs;
        }
        self.select.from_s = self.select.from_s.or(file.select.from_s);
        self.select.to_s = self.select.to_s.or(file.select.to_s);
        self.header_row = self.header_row.or(file.header_row);
        self.encoding = self.encoding.or(file.encoding);
        self.input = self.input.or(file.input);
        self
    }
}

impl Recording {
    /// Several recordings of one valve as one: their runs in a row, each named by its recording where it has no name of its own
    /// or shares it with another.
    pub fn together(parts: Vec<Self>) -> Self {
        if parts.len() == 1 {
            return parts.into_iter().next().unwrap_or_default();
        }
        let source = parts.iter().map(|p| p.source.as_str()).collect::<Vec<_>>().join(", ");
        let input = parts.iter().find_map(|p| p.input);
        let (mut runs, mut notes) = (Vec::new(), Vec::new());
        for part in parts {
            notes.extend(part.notes.iter().map(|note| format!("{}: {note}", part.source)));
            runs.extend(part.runs.into_iter().map(|run| {
                let name = run.name.as_ref().map_or_else(|| part.source.clone(), |name| format!("{}/{name}", part.source));
                Run { name: Some(name), ..run }
            }));
        }
        Self { source, runs, notes, input }
    }

    /// Keeps the runs and the stretch of time that are selected, and notes what that leaves.
    ///
    /// # Errors
    /// A run that is not there, a stretch that holds no sample.
    pub fn selected(mut self, select: &Selection) -> Result<Self, RecordingError> {
        if *select == Selection::default() {
            return Ok(self);
        }
        let (runs, samples) = (self.runs.len(), self.runs.iter().map(Run::len).sum::<usize>());
        let names: Vec<String> = self.runs.iter().map(|r| r.name.clone().unwrap_or_default()).collect();
        for wanted in &select.runs {
            if !names.contains(wanted) {
                let near = names.iter().min_by_key(|n| strsim::osa_distance(n, wanted)).filter(|n| strsim::osa_distance(n, wanted) <= 2);
                let near = near.filter(|n| !n.is_empty()).map_or_else(String::new, |n| format!(" (did you mean `{n}`?)"));
                let there = match names.as_slice() {
                    [one] if one.is_empty() => "one nameless run".to_string(),
                    names => names.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", "),
                };
                return Err(RecordingError::format(&self.source, format!("there is no run `{wanted}`{near}; there are: {there}")));
            }
        }
        let (from, to) = (select.from_s.unwrap_or(f64::NEG_INFINITY), select.to_s.unwrap_or(f64::INFINITY));
        let clock = |runs: &[Run]| {
            let ends = runs.iter().filter_map(|r| Some((*r.time_s.first()?, *r.time_s.last()?)));
            ends.fold((f64::INFINITY, f64::NEG_INFINITY), |all, run| (all.0.min(run.0), all.1.max(run.1)))
        };
        if !select.runs.is_empty() {
            self.runs.retain(|r| r.name.as_ref().is_some_and(|n| select.runs.contains(n)));
        }
        let span = clock(&self.runs);
        for run in &mut self.runs {
            let keep: Vec<bool> = run.time_s.iter().map(|t| (from..=to).contains(t)).collect();
            run.retain(&keep);
        }
        self.runs.retain(|r| !r.is_empty());
        let kept: usize = self.runs.iter().map(Run::len).sum();
        if kept == 0 {
            let asked = [select.from_s.map(|t| format!("from {t} s")), select.to_s.map(|t| format!("to {t} s"))];
            let asked: Vec<String> = asked.into_iter().flatten().collect();
            return Err(RecordingError::format(
                &self.source,
                format!("no sample {}: the recording goes from {} s to {} s", asked.join(" "), span.0, span.1),
            ));
        }
        self.notes.push(format!("selected: {} of {runs} runs, {kept} of {samples} samples", self.runs.len()));
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recording() -> Recording {
        let text = "run,time_s,current_a\na,0,0.1\na,1,0.2\na,2,0.3\nb,0,0.4\nb,1,0.5\n";
        Recording::from_csv(text, "x.csv", &[]).unwrap()
    }
    fn select(runs: &[&str], from_s: Option<f64>, to_s: Option<f64>) -> Result<Recording, RecordingError> {
        recording().selected(&Selection { runs: runs.iter().map(|r| r.to_string()).collect(), from_s, to_s })
    }

    #[test]
    fn runs_and_stretches_are_kept_and_said() {
        let kept = select(&["a"], Some(1.0), None).unwrap();
        assert_eq!((kept.runs.len(), &kept.runs[0].current_a[..]), (1, &[0.2, 0.3][..]));
        assert_eq!(kept.notes.last().unwrap(), "selected: 1 of 2 runs, 2 of 5 samples");
        assert_eq!(select(&[], Some(2.0), None).unwrap().runs.len(), 1, "a run without a sample is gone");
        assert_eq!(recording().selected(&Selection::default()).unwrap(), recording());
    }

    #[test]
    fn what_is_not_there_is_refused_with_what_is() {
        let said = |r: Result<Recording, RecordingError>| r.unwrap_err().to_string();
        insta::assert_snapshot!(said(select(&["aa"], None, None)), @"x.csv: there is no run `aa` (did you mean `a`?); there are: `a`, `b`");
        insta::assert_snapshot!(said(select(&[], Some(5.0), Some(6.0))), @"x.csv: no sample from 5 s to 6 s: the recording goes from 0 s to 2 s");
    }

    #[test]
    fn a_mapping_file_is_read_and_what_was_typed_goes_before_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.toml");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            Reading::load(&path).map_err(|e| e.to_string().replace(&path.display().to_string(), "m.toml"))
        };
        let file = read("schema = \"hil.mapping/1\"\n[map]\ntime_s = \"Datum + Zeit\"\ncurrent_a = \"I [mA]\"\n[select]\nrun = [\"a\"]\nfrom = \"1 s\"\n[read]\nencoding = \"latin-1\"\n").unwrap();
        assert_eq!((file.map.len(), file.select.from_s, file.encoding), (2, Some(1.0), Some(Encoding::Latin1)));
        let typed = Reading { map: vec![Mapping::parse("current_a=J").unwrap()], ..Reading::default() };
        let both = typed.or(file);
        assert_eq!(both.map.iter().map(|m| m.text.as_str()).collect::<Vec<_>>(), ["J", "Datum + Zeit"]);
        assert_eq!(both.select.runs, ["a"]);
        insta::assert_snapshot!(read("schema = \"hil.mapping/1\"\n[map]\npressure_bar = \"p [kp/cm2]\"\n").unwrap_err(), @r#"
        map.pressure_bar: the unit `kp/cm2` is not one of a pressure; allowed: bar, mbar, Pa, kPa, MPa, psi
         --> m.toml:3:16
          |
        3 | pressure_bar = "p [kp/cm2]"
          |                ^^^^^^^^^^^^
        "#);
        let unknown = read("schema = \"hil.mapping/1\"\n[map]\npresure_bar = \"p\"\n").unwrap_err();
        assert!(unknown.contains("did you mean `pressure_bar`?"), "{unknown}");
    }
}
