//! Writing: a file appears whole under its name or not at all.

use std::io::Write;
use std::path::Path;

use super::table::{Column, Values};
use super::whole::replace_file;
use super::{Channel, Recording, RecordingError, Run};
use crate::output::inert;

impl Recording {
    /// The channels that any run holds, the current first.
    pub fn channels(&self) -> Vec<Channel> {
        Channel::ALL.into_iter().filter(|c| *c == Channel::Current || self.has(*c)).collect()
    }

    /// Whether the file needs a `run` column.
    fn named(&self) -> bool {
        self.runs.len() > 1 || self.runs.iter().any(|r| r.name.is_some())
    }

    /// Writes the recording; the format follows from the extension (`.csv`, `.parquet`, `.mf4`).
    ///
    /// # Errors
    /// [`RecordingError::UnknownFormat`], or what the file system says; the file is whole or not there.
    pub fn write(&self, path: &Path) -> Result<(), RecordingError> {
        match super::Format::of(path)? {
            super::Format::Csv => replace_file(path, |file| self.write_csv(file)),
            super::Format::Parquet => super::parquet::write_parquet_stating(path, &self.tables(), self.input),
            super::Format::Mdf4 => replace_file(path, |file| super::mdf4::write(self, file)),
        }
    }

    /// Writes the recording as CSV: every number with as many digits as read back the same value, gaps empty.
    ///
    /// # Errors
    /// What `out` says.
    pub fn write_csv(&self, out: &mut impl Write) -> std::io::Result<()> {
        let (channels, named) = (self.channels(), self.named());
        let names: Vec<&str> = named.then_some("run").into_iter().chain(["time_s"]).chain(channels.iter().map(|c| c.name())).collect();
        writeln!(out, "{}", names.join(","))?;
        for run in &self.runs {
            let name = quoted(run.name.as_deref().unwrap_or_default());
            let columns: Vec<Option<&[f64]>> = channels.iter().map(|c| run.channel(*c)).collect();
            for (sample, time) in run.time_s.iter().enumerate() {
                if named {
                    write!(out, "{name},")?;
                }
                write!(out, "{time}")?;
                for values in &columns {
                    match values.and_then(|v| v.get(sample)).filter(|v| v.is_finite()) {
                        Some(value) => write!(out, ",{value}")?,
                        None => write!(out, ",")?,
                    }
                }
                writeln!(out)?;
            }
        }
        Ok(())
    }

    /// One table per run, all with the same columns.
    fn tables(&self) -> Vec<Vec<Column<'_>>> {
        let (channels, named) = (self.channels(), self.named());
        fn columns<'a>(run: &'a Run, channels: &[Channel], named: bool) -> Vec<Column<'a>> {
            let mut columns = Vec::new();
            if named {
                columns.push(Column { name: "run", values: Values::Same(run.name.as_deref().unwrap_or_default(), run.len()) });
            }
            columns.push(Column { name: "time_s", values: Values::Numbers(&run.time_s) });
            for channel in channels {
                let values = run.channel(*channel).map_or(Values::Absent(run.len()), Values::Numbers);
                columns.push(Column { name: channel.name(), values });
            }
            columns
        }
        self.runs.iter().map(|run| columns(run, &channels, named)).collect()
    }
}

/// A cell of text; in quotes where it holds what would end it.
fn quoted(text: &str) -> String {
    let text = inert(text).replace(['\n', '\r'], " ");
    if text.contains([',', '"', '#', ';', '\t']) || text.trim() != text { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Mapping;
    use proptest::prelude::*;

    const FORMATS: [&str; 3] = ["csv", "parquet", "mf4"];

    /// The recording after a round trip through a file.
    fn again(recording: &Recording, extension: &str, map: &[&str]) -> Recording {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(format!("r.{extension}"));
        recording.write(&path).unwrap();
        let map: Vec<Mapping> = map.iter().map(|m| Mapping::parse(m).unwrap()).collect();
        let files = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(files, 1, "nothing else is left in the folder");
        Recording::read(&path, &map).unwrap()
    }

    fn two_runs() -> Recording {
        let text = "run,time_s,current_a,pressure_bar,oil_temp_c\n\"a, first\",-0.2,0.1,1.25,\n\"a, first\",-0.19,,2.5,80\n\
                    b,0,0.3,,80.5\nb,0.5,0.4,4,81\n";
        Recording::from_csv(text, "r.csv", &[]).unwrap()
    }

    #[test]
    fn every_format_gives_back_what_was_written() {
        let recording = two_runs();
        for extension in FORMATS {
            let back = again(&recording, extension, &[]);
            assert_eq!(format!("{:?}", back.runs), format!("{:?}", recording.runs), "{extension}");
        }
    }

    #[test]
    fn a_mapping_reads_every_format() {
        let recording = two_runs();
        for extension in FORMATS {
            let back = again(&recording, extension, &["current_meas_a=current_a [mA]", "pressure_bar=2 * current_a + 1"]);
            let run = &back.runs[0];
            assert_eq!(run.pressure_bar.as_ref().unwrap()[0], 1.2, "{extension}");
            assert!((run.current_meas_a.as_ref().unwrap()[0] - 1e-4).abs() < 1e-15, "{extension}");
        }
    }

    #[test]
    fn the_same_recording_gives_the_same_bytes() {
        let folder = tempfile::tempdir().unwrap();
        for extension in FORMATS {
            let [a, b] = ["a", "b"].map(|name| {
                let path = folder.path().join(format!("{name}.{extension}"));
                two_runs().write(&path).unwrap();
                std::fs::read(path).unwrap()
            });
            assert_eq!(a, b, "{extension}");
        }
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r.csv");
        std::fs::write(&path, "old").unwrap();
        let failed = replace_file(&path, |file| {
            file.write_all(b"half")?;
            Err::<(), std::io::Error>(std::io::Error::other("full"))
        });
        assert!(failed.unwrap_err().to_string().ends_with("r.csv: full"));
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn an_unknown_extension_is_refused_with_what_is_allowed() {
        let message = Recording::read(Path::new("log.xlsx"), &[]).unwrap_err().to_string();
        insta::assert_snapshot!(message, @"log.xlsx: the extension `xlsx` names no format of recordings; allowed: .csv, .tsv, .txt, .parquet, .mf4");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn any_numbers_survive_every_format(values in prop::collection::vec((any::<f64>(), 0.0f64..50.0), 1..40)) {
            // A zero that is read has no sign.
            let finite = |v: f64| if v.is_finite() { v + 0.0 } else { f64::NAN };
            let mut run = Run { time_s: (0..values.len()).map(|k| k as f64 * 0.01).collect(), ..Run::default() };
            run.pressure_bar = Some(values.iter().map(|v| v.1).collect());
            run.current_a = values.iter().map(|v| finite(v.0)).collect();
            run.current_a[0] = 0.5;
            let recording = Recording { source: "r".into(), runs: vec![run], notes: Vec::new(), input: None };
            for extension in FORMATS {
                prop_assert_eq!(format!("{:?}", again(&recording, extension, &[]).runs), format!("{:?}", recording.runs));
            }
        }
    }
}
