//! From a recording to a course: what was selected, split where the command is unknown, laid on even grids.

use super::grid::{self, Laid};
use super::split::{self, Parts};
use super::{Course, CourseError, Noise, Origin, Preparation, Run};
use crate::recording::{self, Recording, Selection};

/// What was done to the runs, for the notes.
#[derive(Default)]
struct Done {
    splits: usize,
    longest_gap_s: f64,
    outside: usize,
    uneven: usize,
    silent: usize,
}

/// Makes a recording ready, see [`Course::of`].
pub fn course(mut recording: Recording, preparation: &Preparation) -> Result<Course, CourseError> {
    let source = std::mem::take(&mut recording.source);
    let mut notes = std::mem::take(&mut recording.notes);
    let Selection { runs: wanted, from_s, to_s } = &preparation.selection;
    let named = |run: &recording::Run| run.name.clone().unwrap_or_else(|| "(nameless)".into());
    if let Some(run) = wanted.iter().find(|w| !recording.runs.iter().any(|run| run.name.as_ref() == Some(w))) {
        let known = recording.runs.iter().map(named).collect::<Vec<_>>().join(", ");
        return Err(CourseError::NoSuchRun { source_name: source, run: run.clone(), known });
    }
    let stated = preparation.input.or(recording.input);
    let input = stated.unwrap_or_default();
    let recorded = stretch(recording.runs.iter().flat_map(|run| run.time_s.first().into_iter().chain(run.time_s.last())));
    let current_s = when(&recording, |run| &run.current_a);
    let pressure_s = when(&recording, |run| run.pressure_bar.as_deref().unwrap_or_default());
    let mut done = Done::default();
    let mut runs = Vec::new();
    for (number, mut run) in recording.runs.into_iter().enumerate() {
        if !wanted.is_empty() && !run.name.as_ref().is_some_and(|name| wanted.contains(name)) {
            continue;
        }
        let begin = from_s.map_or(0, |from| run.time_s.partition_point(|t| *t < from));
        let end = to_s.map_or(run.len(), |to| run.time_s.partition_point(|t| *t <= to));
        if begin >= end {
            continue;
        }
        let origin_s = run.time_s[begin];
        let Parts { samples, longest_gap_s, outside } = split::parts(&run, begin..end);
        done.silent += usize::from(samples.is_empty());
        done.splits += samples.len().saturating_sub(1);
        done.longest_gap_s = done.longest_gap_s.max(longest_gap_s);
        done.outside += outside;
        for part in samples {
            let start_s = run.time_s[part.start];
            let Laid { dt_s, current_a, pressure_bar, offset_steps, oil_temp_c, supply_bar, uneven } =
                grid::lay(&mut run, part.clone(), input);
            done.uneven += uneven;
            runs.push(Run {
                name: run.name.clone(),
                origin: Origin { run: number, samples: part },
                start_s,
                elapsed_s: start_s - origin_s,
                dt_s,
                current_a,
                pressure_bar,
                oil_temp_c,
                supply_bar,
                offset_steps,
            });
        }
    }
    if runs.is_empty() {
        return Err(if current_s != NEVER {
            CourseError::NothingSelected { source_name: source, recorded }
        } else {
            CourseError::MissingChannel { source_name: source, channel: "current_a" }
        });
    }
    settle_steps(&mut runs);
    done.say(&mut notes);
    let noise = Noise::of(&runs);
    noise.say(&mut notes);
    let apart = (pressure_s != NEVER && runs.iter().all(|run| run.readings() == 0)).then_some((current_s, pressure_s));
    Ok(Course { source, runs, noise, input, input_stated: stated.is_some(), notes, apart })
}

/// When a channel was recorded, in words.
fn when(recording: &Recording, channel: impl Fn(&recording::Run) -> &[f64]) -> String {
    stretch(recording.runs.iter().flat_map(|run| run.time_s.iter().zip(channel(run)).filter(|(_, v)| v.is_finite()).map(|(t, _)| t)))
}

/// A run of one sample has no step of its own: it takes that of the others, or of a loop at 100 Hz.
fn settle_steps(runs: &mut [Run]) {
    const USUAL_STEP_S: f64 = 0.01;
    let usual = runs.iter().filter(|run| run.len() > 1).map(|run| run.dt_s).next().unwrap_or(USUAL_STEP_S);
    runs.iter_mut().filter(|run| run.len() < 2).for_each(|run| run.dt_s = usual);
}

/// What is said of a channel without a value.
const NEVER: &str = "never";

/// The first and the last of some times, in words.
fn stretch<'a>(times: impl Iterator<Item = &'a f64>) -> String {
    let (from, to) = times.fold((f64::INFINITY, f64::NEG_INFINITY), |(from, to), t| (from.min(*t), to.max(*t)));
    if from <= to { format!("from {from} s to {to} s") } else { NEVER.into() }
}

impl Done {
    fn say(&self, notes: &mut Vec<String>) {
        if self.splits > 0 {
            let (gaps, parts) = if self.splits == 1 { ("1 long gap", "its two parts start") } else { ("long gaps", "the parts start") };
            let count = if self.splits == 1 { String::new() } else { format!("{} ", self.splits) };
            notes.push(format!(
                "{count}{gaps} in the command, the longest {:.4} s: what the valve did in it is unknown, so {parts} anew",
                self.longest_gap_s
            ));
        }
        if self.outside > 0 {
            notes.push(format!("{} readings of the pressure stand where the command is unknown, and are not compared", self.outside));
        }
        if self.silent > 0 {
            notes.push(format!("{} runs hold no command and are left out", self.silent));
        }
        if self.uneven > 0 {
            notes.push(format!(
                "{} samples do not lie on an even grid: the simulation runs on one, and is compared with each reading at the reading's own time",
                self.uneven
            ));
        }
    }
}
