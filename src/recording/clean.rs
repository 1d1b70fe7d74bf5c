//! From rows to runs: time is made to increase, and whatever is done to that end is noted.
//!
//! A run is split where its clock starts again; rows that share a rounded time stamp are spread again; single
//! rows that repeat a time or stand behind it are dropped. Where that would take more than a tenth of the rows
//! the file is refused: a wrong clock cannot be guessed.

use super::part::{Index, Part, parts};
use super::source::{Rows, Tally};
use super::{Channel, Recording, RecordingError, Run};

/// Largest share of rows that may be dropped because of their time.
const DROP_LIMIT: f64 = 0.1;
/// From this share of repeated stamps on, the clock is taken to be rounded.
const ROUNDED_SHARE: f64 = 0.2;
/// A step this many times the median is a gap in time.
const GAP_FACTOR: f64 = 5.0;

/// What was noticed over all runs.
#[derive(Default)]
struct Noticed {
    untimed: Tally,
    midnight: Tally,
    repeated: Tally,
    backward: Tally,
    spread: Tally,
    restarted: Tally,
    gaps: Tally,
    longest_gap_s: f64,
    step_range_s: Option<(f64, f64, f64)>,
}

pub(super) fn recording(mut rows: Rows) -> Result<Recording, RecordingError> {
    let mut noticed = Noticed::default();
    let mut notes = std::mem::take(&mut rows.notes);
    if rows.time_s.is_empty() {
        return Err(RecordingError::format(&rows.file, "there is no row of values"));
    }
    for channel in Channel::ALL {
        let values = &mut rows.channels[channel.index()];
        let Some(all) = values else { continue };
        let mut gaps = Tally::default();
        for (row, _) in all.iter().enumerate().filter(|v| v.1.is_nan()) {
            gaps.add(|| rows.places.of(row));
        }
        if gaps.count == all.len() {
            if channel == Channel::Current {
                return Err(RecordingError::format(&rows.file, "`current_a` holds no value at all"));
            }
            notes.push(format!("{} holds no value: taken as not recorded", channel.name()));
            *values = None;
        } else {
            notes.extend(gaps.note("value", "values", "missing").map(|n| format!("{}: {n}", channel.name())));
        }
    }
    if rows.channels[Channel::Pressure.index()].is_none() {
        notes.push("there is no pressure_bar: nothing measured to compare with".into());
    }

    let mut runs = Vec::new();
    for part in parts(&mut rows) {
        let Part { name, rows: of_part, mut run } = part;
        let index = Index { rows: of_part, places: &rows.places };
        plausible_times(&rows.file, &run, &index)?;
        let keep = drop_untimed(&rows.file, &mut run, &index, &mut noticed)?;
        let index = index.kept(keep);
        midnight(&mut run, &index, &mut noticed);
        for (piece, (mut run, index)) in restarts(run, index, &mut noticed).into_iter().enumerate() {
            spread(&mut run.time_s, &index, &mut noticed);
            let index = increase(&rows.file, &mut run, index, &mut noticed)?;
            steps(&run, &index, &mut noticed);
            run.name = match (&name, piece) {
                (name, 0) => name.clone(),
                (Some(name), n) => Some(format!("{name} ({})", n + 1)),
                (None, n) => Some(format!("{}", n + 1)),
            };
            runs.push(run);
        }
    }
    runs.retain(|run: &Run| !run.is_empty());
    if runs.len() > 1 && runs[0].name.is_none() {
        runs[0].name = Some("1".into());
    }
    unique_names(&mut runs);
    noticed.say(&mut notes);
    for run in &runs {
        let constant = [Channel::Current, Channel::Pressure].into_iter().filter(|c| run.len() > 1 && run.is_constant(*c));
        for channel in constant {
            let value = run.channel(channel).and_then(|v| v.iter().find(|v| v.is_finite()).copied()).unwrap_or(f64::NAN);
            let of = run.name.as_ref().map_or(String::new(), |n| format!(" in run {n}"));
            notes.push(format!("{} is constant{of}: {value} {}", channel.name(), channel.unit().symbol));
        }
    }
    if runs.is_empty() {
        return Err(RecordingError::format(&rows.file, "there is no row with a time"));
    }
    Ok(Recording { source: rows.file, runs, notes, input: rows.input })
}

impl Noticed {
    fn say(self, notes: &mut Vec<String>) {
        notes.extend(self.untimed.note("row", "rows", "without a time: dropped"));
        notes.extend(self.midnight.note("time", "times", "the seconds of the day pass midnight: counted on"));
        notes.extend(self.restarted.note("time", "times", "the clock starts again: taken as a new run"));
        notes.extend(self.spread.note("row shares", "rows share", "a rounded time stamp: spread evenly between the stamps"));
        notes.extend(self.repeated.note("row", "rows", "with a repeated time: dropped"));
        notes.extend(self.backward.note("row", "rows", "with a time that goes backwards: dropped"));
        if let Some(note) = self.gaps.note("gap", "gaps", "in time") {
            notes.push(format!("{note}, the longest {:.4} s", self.longest_gap_s));
        }
        if let Some((low, median, high)) = self.step_range_s {
            notes.push(format!("the time step varies: {low:.6}..{high:.6} s, median {median:.6} s"));
        }
    }
}

/// Latest time that is taken for one [s]: 300,000 years, far above any clock in seconds; one in nanoseconds needs a `--map`.
const LATEST_S: f64 = 1e13;

/// Refuses a time that no clock shows, before anything is made as long as it says.
fn plausible_times(file: &str, run: &Run, index: &Index) -> Result<(), RecordingError> {
    match run.time_s.iter().position(|t| t.abs() > LATEST_S) {
        None => Ok(()),
        Some(sample) => Err(RecordingError::Row {
            file: file.into(),
            place: index.place(sample),
            what: format!(
                "time_s is {:e} s; at most {LATEST_S:e} s are allowed (a clock in another unit: --map time_s=\"NAME [ns]\")",
                run.time_s[sample]
            ),
        }),
    }
}

fn drop_untimed(file: &str, run: &mut Run, index: &Index, noticed: &mut Noticed) -> Result<Option<Vec<bool>>, RecordingError> {
    let bad = run.time_s.iter().filter(|t| t.is_nan()).count();
    if bad == 0 {
        return Ok(None);
    }
    let keep: Vec<bool> = run.time_s.iter().map(|t| !t.is_nan()).collect();
    let first = keep.iter().position(|k| !k).unwrap_or(0);
    if bad as f64 > DROP_LIMIT * run.len() as f64 {
        return Err(RecordingError::Row {
            file: file.into(),
            place: index.place(first),
            what: format!("time_s is missing here and in {bad} of {} rows", run.len()),
        });
    }
    for sample in (0..run.len()).filter(|s| !keep[*s]) {
        noticed.untimed.add(|| index.place(sample));
    }
    run.retain(&keep);
    Ok(Some(keep))
}

/// Seconds of the day go on over midnight: from the end of a day to below where the run began.
fn midnight(run: &mut Run, index: &Index, noticed: &mut Noticed) {
    const DAY_S: f64 = 86_400.0;
    let slack_s = 10.0 * run.step_s().max(0.0);
    let Some(&start) = run.time_s.first() else { return };
    let mut days = 0.0;
    for at in 1..run.len() {
        // What stands before it is already counted on.
        let (before, now) = (run.time_s[at - 1] - days, run.time_s[at]);
        if now < start && before <= DAY_S && before > DAY_S - slack_s && (0.0..slack_s).contains(&now) {
            noticed.midnight.add(|| index.place(at));
            days += DAY_S;
        }
        run.time_s[at] += days;
    }
}

/// Splits a run where its clock jumps back to its start and goes on from there.
fn restarts<'a>(mut run: Run, mut index: Index<'a>, noticed: &mut Noticed) -> Vec<(Run, Index<'a>)> {
    let mut cuts = Vec::new();
    let mut start = 0;
    for at in 1..run.len() {
        let t = run.time_s[at];
        if t >= run.time_s[at - 1] || at - start <= 3 || run.len() - at <= 3 {
            continue;
        }
        // Near the run's start: within its first hundredth of samples, whatever single wrong times it holds.
        let near_start = t <= run.time_s[start + ((at - start) / 100).max(2)];
        let goes_on = run.time_s[at..at + 4].windows(2).all(|w| w[0] < w[1]) && run.time_s[at + 3] <= run.time_s[at - 1];
        if near_start && goes_on {
            noticed.restarted.add(|| index.place(at));
            cuts.push(at);
            start = at;
        }
    }
    let mut pieces = Vec::new();
    for &cut in cuts.iter().rev() {
        pieces.push((run.split_off(cut), index.split_off(cut)));
    }
    pieces.push((run, index));
    pieces.reverse();
    pieces
}

/// Spreads samples that share a time stamp because the stamp was rounded, each group up to the next stamp.
fn spread(time_s: &mut [f64], index: &Index, noticed: &mut Noticed) {
    let repeated = time_s.windows(2).filter(|w| w[0] == w[1]).count();
    if (repeated as f64) < ROUNDED_SHARE * time_s.len() as f64 || time_s.windows(2).any(|w| w[1] < w[0]) {
        return;
    }
    let mut stamps: Vec<f64> = time_s.windows(2).map(|w| w[1] - w[0]).filter(|d| *d > 0.0).collect();
    if stamps.is_empty() {
        return;
    }
    let middle = stamps.len() / 2;
    let usual = *stamps.select_nth_unstable_by(middle, f64::total_cmp).1;
    let mut from = 0;
    while from < time_s.len() {
        let stamp = time_s[from];
        let to = time_s[from..].iter().position(|t| *t != stamp).map_or(time_s.len(), |n| from + n);
        // A gap behind a group is no reason to stretch it.
        let width = time_s.get(to).map_or(usual, |next| (next - stamp).min(2.0 * usual));
        for (k, t) in time_s[from..to].iter_mut().enumerate().skip(1) {
            *t = stamp + width * k as f64 / (to - from) as f64;
            noticed.spread.add(|| index.place(from + k));
        }
        from = to;
    }
}

/// Drops the rows that keep time from increasing: as few as possible.
fn increase<'a>(file: &str, run: &mut Run, index: Index<'a>, noticed: &mut Noticed) -> Result<Index<'a>, RecordingError> {
    let Some(first) = run.time_s.windows(2).position(|w| w[1] <= w[0]) else { return Ok(index) };
    let keep = longest_increasing(&run.time_s);
    let dropped = keep.iter().filter(|k| !**k).count();
    if dropped as f64 > DROP_LIMIT * run.len() as f64 && dropped > 1 {
        let (before, after) = (run.time_s[first], run.time_s[first + 1]);
        let how = if after == before { "repeats" } else { "goes backwards" };
        return Err(RecordingError::Row {
            file: file.into(),
            place: index.place(first + 1),
            what: format!(
                "time_s {how} ({after} s after {before} s); {dropped} of {} rows would have to go, allowed is one in ten; runs are told apart by a `run` column",
                run.len()
            ),
        });
    }
    let mut last = f64::NAN;
    for (sample, kept) in keep.iter().enumerate() {
        let t = run.time_s[sample];
        if *kept {
            last = t;
        } else if t == last || run.time_s.get(sample + 1) == Some(&t) {
            noticed.repeated.add(|| index.place(sample));
        } else {
            noticed.backward.add(|| index.place(sample));
        }
    }
    run.retain(&keep);
    Ok(index.kept(Some(keep)))
}

/// Marks a longest strictly increasing subsequence; of equal times the first is kept.
fn longest_increasing(values: &[f64]) -> Vec<bool> {
    // tails[k]: the sample that ends the best subsequence of length k + 1; previous[i]: the one before sample i.
    let (mut tails, mut previous): (Vec<u32>, Vec<u32>) = (Vec::new(), Vec::with_capacity(values.len()));
    for (at, value) in values.iter().enumerate() {
        let length = match tails.last() {
            Some(&last) if values[last as usize] < *value => tails.len(),
            _ => tails.partition_point(|t| values[*t as usize] < *value),
        };
        previous.push(length.checked_sub(1).map_or(u32::MAX, |k| tails[k]));
        if length == tails.len() {
            tails.push(at as u32);
        } else if values[tails[length] as usize] > *value {
            tails[length] = at as u32;
        }
    }
    let mut keep = vec![false; values.len()];
    let mut at = tails.last().copied().unwrap_or(u32::MAX);
    while let Some(kept) = keep.get_mut(at as usize) {
        *kept = true;
        at = previous[at as usize];
    }
    keep
}

/// Looks for gaps in time and for a step that varies.
fn steps(run: &Run, index: &Index, noticed: &mut Noticed) {
    let median = run.step_s();
    if median <= 0.0 {
        return;
    }
    let (mut low, mut high) = (f64::INFINITY, 0.0f64);
    for (at, w) in run.time_s.windows(2).enumerate() {
        let step = w[1] - w[0];
        if step > GAP_FACTOR * median {
            noticed.gaps.add(|| format!("after {}", index.place(at)));
            noticed.longest_gap_s = noticed.longest_gap_s.max(step);
        } else {
            (low, high) = (low.min(step), high.max(step));
        }
    }
    if high - low > 0.02 * median {
        let range = noticed.step_range_s.get_or_insert((low, median, high));
        (range.0, range.2) = (range.0.min(low), range.2.max(high));
    }
}

fn unique_names(runs: &mut [Run]) {
    let mut seen = std::collections::HashSet::new();
    for (at, run) in runs.iter_mut().enumerate() {
        if run.name.as_ref().is_some_and(|n| !seen.insert(n.clone())) {
            let name = format!("{} #{}", run.name.take().unwrap_or_default(), at + 1);
            seen.insert(name.clone());
            run.name = Some(name);
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::recording::{Channel, Recording, RecordingError};
    use proptest::prelude::*;

    fn timed(times: impl IntoIterator<Item = f64>) -> Result<Recording, RecordingError> {
        let rows: String = times.into_iter().enumerate().map(|(k, t)| format!("{t},{},{}\n", 0.1 + 0.001 * k as f64, k)).collect();
        Recording::from_csv(format!("time_s,current_a,pressure_bar\n{rows}"), "x.csv", &[])
    }
    fn grid(n: usize) -> Vec<f64> {
        (0..n).map(|k| (k as f64 - 20.0) / 100.0).collect()
    }

    #[test]
    fn a_start_before_zero_is_kept() {
        let recording = timed(grid(50)).unwrap();
        assert_eq!((recording.runs[0].time_s[0], recording.notes.len()), (-0.2, 0));
    }

    #[test]
    fn seconds_of_the_day_go_on_over_midnight() {
        let recording = timed((0..200).map(|n| (8_639_900 + n) % 8_640_000).map(|n| f64::from(n) / 100.0)).unwrap();
        assert_eq!((recording.runs.len(), recording.runs[0].time_s[199]), (1, 86_400.99));
        assert_eq!(recording.notes, ["1 time the seconds of the day pass midnight: counted on (line 102)"]);
        // A day that was recorded from its first second and begins again is another run.
        let again = timed((0..200).map(|n| f64::from(n % 100) * 864.0)).unwrap();
        assert_eq!(again.runs.len(), 2);
    }

    #[test]
    fn single_wrong_times_are_dropped_and_said() {
        let mut times = grid(100);
        times[10] = times[9];
        times[50] = 99.0;
        times[70] = -3.0;
        let recording = timed(times).unwrap();
        assert_eq!(recording.runs[0].len(), 97);
        // The values stay with their times.
        assert_eq!(recording.runs[0].pressure_bar.as_ref().unwrap()[49], 51.0);
        insta::assert_snapshot!(recording.notes.join("\n"), @r"
        1 row with a repeated time: dropped (line 12)
        2 rows with a time that goes backwards: dropped (first: line 52)
        the time step varies: 0.010000..0.020000 s, median 0.010000 s
        ");
    }

    #[test]
    fn a_clock_that_runs_backwards_is_refused() {
        let message = timed(grid(100).into_iter().rev()).unwrap_err().to_string();
        insta::assert_snapshot!(message, @"x.csv: line 3: time_s goes backwards (0.78 s after 0.79 s); 99 of 100 rows would have to go, allowed is one in ten; runs are told apart by a `run` column");
    }

    #[test]
    fn a_clock_that_starts_again_begins_a_run() {
        let recording = timed(grid(100).into_iter().chain(grid(60))).unwrap();
        assert_eq!(
            recording.runs.iter().map(|r| (r.name.clone().unwrap(), r.len())).collect::<Vec<_>>(),
            [("1".into(), 100), ("2".into(), 60)]
        );
        assert_eq!(recording.notes, ["1 time the clock starts again: taken as a new run (line 102)"]);
    }

    #[test]
    fn rounded_stamps_are_spread_again() {
        let rounded = (0..100).map(|k| (k / 4) as f64 * 0.04);
        let recording = timed(rounded).unwrap();
        let run = &recording.runs[0];
        assert_eq!(run.len(), 100);
        assert!(run.time_s.iter().enumerate().all(|(k, t)| (t - 0.01 * k as f64).abs() < 1e-9));
        insta::assert_snapshot!(recording.notes.join("\n"), @"75 rows share a rounded time stamp: spread evenly between the stamps (first: line 3)");
    }

    #[test]
    fn gaps_in_time_and_missing_times_are_said() {
        let times = (0..100).map(|k| if k == 7 { f64::NAN } else { 0.01 * f64::from(k) + if k > 59 { 5.0 } else { 0.0 } });
        let recording = timed(times).unwrap();
        insta::assert_snapshot!(recording.notes.join("\n"), @r"
        1 row without a time: dropped (line 9)
        1 gap in time (after line 61), the longest 5.0100 s
        the time step varies: 0.010000..0.020000 s, median 0.010000 s
        ");
    }

    #[test]
    fn runs_come_apart_by_name_also_where_they_alternate() {
        let text = "run,time_s,current_a\na,0,1\nb,0,2\na,1,3\nb,1,4\n";
        let recording = Recording::from_csv(text, "x.csv", &[]).unwrap();
        let names: Vec<_> = recording.runs.iter().map(|r| (r.name.as_deref().unwrap(), r.current_a.clone())).collect();
        assert_eq!(names, [("a", vec![1.0, 3.0]), ("b", vec![2.0, 4.0])]);
        assert!(!recording.has(Channel::Pressure));
        assert_eq!(recording.notes, ["there is no pressure_bar: nothing measured to compare with"]);
    }

    #[test]
    fn a_constant_channel_is_said() {
        let recording = Recording::from_csv("time_s,current_a,pressure_bar\n0,0.5,1\n1,0.5,2\n2,,3\n", "x.csv", &[]).unwrap();
        assert!(recording.runs[0].is_constant(Channel::Current) && !recording.runs[0].is_constant(Channel::Pressure));
        assert!(recording.notes.contains(&"current_a is constant: 0.5 A".to_string()));
    }

    proptest! {
        #[test]
        fn time_increases_in_every_run_whatever_comes(times in prop::collection::vec(prop_oneof![9 => (0u32..400).prop_map(f64::from), 1 => Just(f64::NAN)], 1..200)) {
            if let Ok(recording) = timed(times) {
                for run in &recording.runs {
                    prop_assert!(!run.is_empty());
                    prop_assert!(run.time_s.windows(2).all(|w| w[0] < w[1]));
                    prop_assert_eq!(run.current_a.len(), run.len());
                    prop_assert_eq!(run.pressure_bar.as_ref().map(Vec::len), Some(run.len()));
                }
            }
        }

        #[test]
        fn the_kept_subsequence_is_increasing_and_as_long_as_can_be(values in prop::collection::vec(0u8..20, 0..12)) {
            let values: Vec<f64> = values.into_iter().map(f64::from).collect();
            let keep = super::longest_increasing(&values);
            let kept: Vec<f64> = values.iter().zip(&keep).filter(|k| *k.1).map(|k| *k.0).collect();
            prop_assert!(kept.windows(2).all(|w| w[0] < w[1]));
            let best = (0u32..1 << values.len()).filter_map(|set| {
                let chosen: Vec<f64> = (0..values.len()).filter(|k| set >> k & 1 == 1).map(|k| values[k]).collect();
                chosen.windows(2).all(|w| w[0] < w[1]).then_some(chosen.len())
            }).max().unwrap_or(0);
            prop_assert_eq!(kept.len(), best);
        }
    }
}
