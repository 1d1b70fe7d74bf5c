//! What a search looks at of a long recording: enough of it that more would not name another cause, and no more, so that
//! the cost of a search does not grow with the length. What was found is then fitted and judged on all of it.

use super::evidence::{Evidence, MIDDLE};
use super::fit::Fitter;
use super::model::{Model, VALVE_STEP_S};
use crate::course::Run;

/// Samples that a search looks at where one of them costs a step of one lag: over two minutes at 100 Hz,
const MOST_SAMPLES: usize = 16_000;
/// and at least, however much one costs.
const FEWEST_SAMPLES: usize = 4_000;
/// Inner steps of a sample in which causes are looked for: what a coarse step is off by is small beside what they do.
const ROUGH: usize = 4;
/// Stretches of a run that is longer: its begin, where a valve fills and warms up, its end, where a drift is largest, and the
/// stretch between them where the current moves most.
const STRETCHES: usize = 3;
/// Part of a stretch within the run in which the simulation finds its way, and is not compared.
const LEAD_IN: f64 = 0.1;

/// The part of the evidence that a search looks at, masked as the fitter has it; `None` where that is all of it.
pub fn excerpt(fitter: &Fitter<'_>, base: &Model<'_>) -> Option<Evidence> {
    let evidence = fitter.evidence;
    let samples = evidence.samples();
    // What is added to the base divides a long step, too, unless all that is slow belongs to the base.
    let divided = if evidence.is_slow() { 1.0 } else { evidence.step_s() / VALVE_STEP_S };
    let steps = base.steps_per_sample(evidence).max(divided as usize);
    let most = (MOST_SAMPLES / steps).max(FEWEST_SAMPLES);
    // A foreign simulation is made once and for all of the recording.
    if evidence.base.is_some() {
        return None;
    }
    // No coarser than valves are recorded: what happens faster is seen at the samples that remain.
    let finest = ((VALVE_STEP_S / evidence.step_s()) as usize).max(1);
    let every = samples.div_ceil(most).clamp(1, finest);
    let mut begin = 0;
    let mut runs = Vec::new();
    for (run, share) in evidence.grids.iter().zip(&evidence.start_shares) {
        let mut masked = run.clone();
        masked.pressure_bar.copy_from_slice(&fitter.measured[begin..begin + run.len()]);
        begin += run.len();
        runs.push((masked.thinned(every, evidence.input), *share));
    }
    let samples_of = |runs: &[(Run, f64)]| runs.iter().map(|(run, _)| run.len()).sum::<usize>();
    // Of many runs some, whole: a few samples of each would show no movement of any.
    let many = runs.len() > STRETCHES;
    let among = if many { samples_of(&runs).div_ceil(most) } else { 1 };
    let mut runs: Vec<(Run, f64)> = runs.into_iter().step_by(among).collect();
    let all = samples_of(&runs);
    if all > most && runs.len() <= STRETCHES {
        runs = runs.iter().flat_map(|(run, share)| stretches(run, *share, run.len() * most / all)).collect();
    }
    Some(evidence.of_runs(runs.into_iter().unzip(), ROUGH))
}

/// What a reader should know of it; nothing where all samples are looked at.
pub fn note(all: &Evidence, short: &Evidence) -> Option<String> {
    if short.samples() == all.samples() {
        return None;
    }
    let stretch = |run: &Run| format!("{:.1} to {:.1} s", run.time_s(0), run.time_s(run.len().saturating_sub(1)));
    let stretches: Vec<String> = short.grids.iter().map(stretch).collect();
    let every = (short.step_s() / all.step_s()).round();
    let step = if every > 1.0 { format!("one sample of {every:.0} of ") } else { String::new() };
    Some(format!(
        "the recording is long: causes were looked for in {step}{}; what was found is fitted and judged on all of it",
        stretches.join(", ")
    ))
}

/// Stretches of a run with `most` samples in all, and where the valve stands at the begin of each.
fn stretches(run: &Run, start_share: f64, most: usize) -> Vec<(Run, f64)> {
    let each = most / STRETCHES;
    if run.len() <= most || each < 2 {
        return vec![(run.clone(), start_share)];
    }
    let moved = |from: usize| run.current_a[from..from + each].windows(2).map(|w| (w[1] - w[0]).abs()).sum::<f64>();
    let last = run.len() - each;
    let middle = (each..=last.saturating_sub(each).max(each)).step_by((each / 4).max(1)).max_by(|a, b| moved(*a).total_cmp(&moved(*b)));
    let mut parts = vec![(run.part(0..each), start_share)];
    for from in middle.into_iter().chain([last]) {
        let mut part = run.part(from..from + each);
        let lead_in = (LEAD_IN * each as f64) as usize;
        part.pressure_bar[..lead_in].fill(f64::NAN);
        parts.push((part, MIDDLE));
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::course::Input;
    use crate::valve::Valve;

    fn looked_at(fitter: &Fitter<'_>) -> Option<Evidence> {
        let text = "schema = \"hil.valve/1\"\nname = \"test\"\ncurrent_limits = [\"0 A\", \"1 A\"]\nhysteresis.hyperbolic.a = \"0.8 bar^2\"\n\
                    delay = \"23 ms\"\n[curve]\nascending = [20.0, 0.0]\ndescending = [20.0, 0.5]\n";
        excerpt(fitter, &Model::base(&Valve::from_toml(text, "test").unwrap()).unwrap())
    }

    fn evidence(samples: usize, dt_s: f64) -> Evidence {
        let current: Vec<f64> = (0..samples).map(|k| 0.5 + 0.3 * (k as f64 * dt_s).sin()).collect();
        let pressure = current.iter().map(|i| 20.0 * i).collect();
        Evidence::new(vec![Run::even(None, 0.0, dt_s, current, pressure)], 0.02, Input::Ramp)
    }

    #[test]
    fn two_minutes_are_looked_at_whole() {
        let all = evidence(12_000, 0.01);
        let looked = looked_at(&Fitter::new(&all)).unwrap();
        assert_eq!((looked.samples(), note(&all, &looked)), (12_000, None));
    }

    #[test]
    fn a_fast_recording_is_thinned_and_a_long_one_shows_its_begin_and_its_end() {
        let fast = evidence(120_000, 0.001);
        let less = looked_at(&Fitter::new(&fast)).unwrap();
        assert!(less.grids.len() == 1 && less.samples() <= MOST_SAMPLES && less.step_s() <= 0.010_001);
        let long = evidence(80_000, 0.01);
        let less = looked_at(&Fitter::new(&long)).unwrap();
        assert!(less.samples() <= MOST_SAMPLES && less.grids.len() == STRETCHES);
        let last = less.grids.last().unwrap();
        assert!((last.elapsed_s + last.len() as f64 * last.dt_s - 800.0).abs() < 1e-6, "{}", last.elapsed_s);
        // The current is what it is at these times.
        let t = last.time_s(100);
        assert!((last.current_a[100] - (0.5 + 0.3 * t.sin())).abs() < 1e-9);
    }

    #[test]
    fn of_many_runs_some_are_looked_at_whole() {
        let mut many = evidence(1_000, 0.01);
        many.grids = (0..60).map(|_| many.grids[0].clone()).collect();
        many.start_shares = vec![MIDDLE; 60];
        let less = looked_at(&Fitter::new(&many)).unwrap();
        assert!(less.grids.iter().all(|run| run.len() == 1_000) && less.samples() <= MOST_SAMPLES, "{}", less.samples());
    }

    #[test]
    fn what_is_masked_stays_masked() {
        let fast = evidence(120_000, 0.001);
        let mut fitter = Fitter::new(&fast);
        fitter.measured[..60_000].fill(f64::NAN);
        let less = looked_at(&fitter).unwrap();
        let half = less.grids[0].pressure_bar.iter().filter(|p| p.is_nan()).count();
        assert!(half.abs_diff(less.samples() / 2) <= 1, "{half}");
    }
}
