//! What a search looks at of a long recording: enough of it that more would not name another cause, and no more, so that
//! the cost of a search does not grow with the length. What was found is then fitted and judged on all of it.

use std::ops::Range;

use super::evidence::{Evidence, MIDDLE};
use super::fit::{Fit, Fitter};
use super::model::{Model, VALVE_STEP_S};
use super::settled::unsettled;
use super::simulator::Simulator;
use crate::course::Run;

/// Samples that a search looks at where one of them costs a step of one lag: over two minutes at 100 Hz,
const MOST_SAMPLES: usize = 16_000;
/// and at least, however much one costs.
const FEWEST_SAMPLES: usize = 4_000;
/// Inner steps of a sample in which causes are looked for, at most, and none much shorter than this: what a coarse step is off by is
/// small beside what they do.
const ROUGH: usize = 4;
const ROUGH_STEP_S: f64 = 0.0025;
/// Stretches of a run that is longer: one early, where a valve fills and warms up, one late, where a drift is largest, the one between
/// them where the current moves most, and the one where the recalibrated model is farthest off.
const STRETCHES: usize = 4;
/// An early or a late stretch is the begin or the end itself where the current moves at least so much of what it does in the liveliest
/// one of that third: a valve at rest shows nothing.
const LIVELY: f64 = 0.5;
/// Part of a stretch within the run in which the simulation finds its way, and is not compared.
const LEAD_IN: f64 = 0.1;

/// The part of the evidence that a search looks at, masked as the fitter has it; `None` where that is all of it. `null`: the
/// recalibrated model on all of it, where it is known.
pub fn excerpt(fitter: &Fitter<'_>, base: &Model<'_>, null: Option<&Fit<'_>>) -> Option<Evidence> {
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
    let coarsest = ((VALVE_STEP_S / evidence.step_s()) as usize).max(1);
    let every = samples.div_ceil(most).clamp(1, coarsest);
    let off_bar = null.filter(|_| samples > most).map_or_else(Vec::new, |null| distances(fitter, null));
    let off_bar = |samples: Range<usize>| off_bar.get(samples).unwrap_or_default().iter().copied().step_by(every).collect();
    let runs = thinned(fitter, every).into_iter().zip(evidence.runs());
    let runs: Vec<(Run, f64, Vec<f64>)> = runs.map(|((run, share), samples)| (run, share, off_bar(samples))).collect();
    let samples_of = |runs: &[(Run, f64, Vec<f64>)]| runs.iter().map(|(run, ..)| run.len()).sum::<usize>();
    // Of many runs some, whole: a few samples of each would show no movement of any.
    let many = runs.len() > STRETCHES;
    let among = if many { samples_of(&runs).div_ceil(most) } else { 1 };
    let runs: Vec<_> = runs.into_iter().step_by(among).collect();
    let all = samples_of(&runs);
    let part = if all > most && runs.len() <= STRETCHES { most as f64 / all as f64 } else { 1.0 };
    let runs = runs.iter().flat_map(|(run, share, off_bar)| stretches(run, *share, (run.len() as f64 * part) as usize, off_bar));
    let mut short = roughly(evidence, runs.unzip(), every);
    if part < 1.0 {
        mask(&mut short, base);
    }
    Some(short)
}

/// All of the evidence, every reading of it, masked as the fitter has it, in the inner steps of a search. Between the readings of a thinned
/// run a step of the current would be a ramp, and what follows that ramp would be confirmed.
pub fn throughout(fitter: &Fitter<'_>) -> Evidence {
    roughly(fitter.evidence, thinned(fitter, 1).into_iter().unzip(), 1)
}

/// Runs of which one sample of `every` remains, in the inner steps of a search.
fn roughly(evidence: &Evidence, runs: (Vec<Run>, Vec<f64>), every: usize) -> Evidence {
    let inner = (every as f64 * evidence.step_s() / ROUGH_STEP_S).round() as usize;
    evidence.of_runs(runs, inner.clamp(1, ROUGH))
}

/// One sample of `every` of the runs, masked as the fitter has them, each with where the valve stands at first.
fn thinned(fitter: &Fitter<'_>, every: usize) -> Vec<(Run, f64)> {
    let evidence = fitter.evidence;
    let of = |((run, share), samples): ((&Run, &f64), Range<usize>)| {
        let mut masked = run.clone();
        masked.pressure_bar.copy_from_slice(&fitter.measured[samples]);
        (masked.thinned(every, evidence.input), *share)
    };
    evidence.grids.iter().zip(&evidence.start_shares).zip(evidence.runs()).map(of).collect()
}

/// Has each stretch begin where it fits the model best, or leaves out what depends on that: while the current rests, a valve does not
/// forget where it stood in its loop, however long the lead-in.
fn mask(short: &mut Evidence, base: &Model<'_>) {
    let unsettled = unsettled(short, base);
    let mut readings: Vec<&mut f64> = short.grids.iter_mut().flat_map(|grid| &mut grid.pressure_bar).collect();
    for k in unsettled {
        *readings[k] = f64::NAN;
    }
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

/// How far off a fit is at each sample; zero where nothing is measured [bar].
fn distances(fitter: &Fitter<'_>, fit: &Fit<'_>) -> Vec<f64> {
    let mut residual = Vec::new();
    fitter.residual(&mut Simulator::new(fitter.evidence), &fit.model, &fit.theta, &mut residual);
    residual.iter().map(|r| if r.is_finite() { r.abs() } else { 0.0 }).collect()
}

/// Stretches of a run with `most` samples in all, and where the valve stands at the begin of each; `off_bar`: how far the
/// recalibrated model is off at each sample, or nothing.
fn stretches(run: &Run, start_share: f64, most: usize, off_bar: &[f64]) -> Vec<(Run, f64)> {
    let each = most / STRETCHES;
    if run.len() <= most || each < 2 {
        return vec![(run.clone(), start_share)];
    }
    let last = run.len() - each;
    let moved = cumulated(run.current_a.windows(2).map(|w| (w[1] - w[0]).abs()));
    let moved = |from: usize| moved[from + each - 1] - moved[from];
    let off = cumulated(off_bar.iter().copied());
    let off = |from: usize| off.get(from + each).map_or(0.0, |end| end - off[from]);
    let among = |from: usize, to: usize| (from..=to.max(from)).step_by((each / 4).max(1));
    let liveliest = |from: usize, to: usize| among(from, to).max_by(|a, b| moved(*a).total_cmp(&moved(*b))).unwrap_or(from);
    let at = |place: usize, other: usize| if moved(place) >= LIVELY * moved(other) { place } else { other };
    let early = at(0, liveliest(0, run.len() / 3));
    let late = at(last, liveliest((2 * run.len() / 3).min(last), last));
    let middle = liveliest(early + each, late.saturating_sub(each));
    let mut chosen = vec![early, middle, late];
    // Of the rest the one that is farthest off, or else the liveliest.
    let apart = |from: &usize| chosen.iter().all(|c| c.abs_diff(*from) >= each);
    chosen.extend(among(0, last).filter(apart).max_by(|a, b| off(*a).total_cmp(&off(*b)).then(moved(*a).total_cmp(&moved(*b)))));
    chosen.sort_unstable();
    let part = |from: usize| {
        let mut part = run.part(from..from + each);
        if from == 0 {
            return (part, start_share);
        }
        let lead_in = (LEAD_IN * each as f64) as usize;
        part.pressure_bar[..lead_in].fill(f64::NAN);
        (part, MIDDLE)
    };
    chosen.into_iter().map(part).collect()
}

/// Zero and the sums up to each value.
fn cumulated(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let sums = values.scan(0.0, |sum, v| {
        *sum += v;
        Some(*sum)
    });
    std::iter::once(0.0).chain(sums).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::course::Input;
    use crate::valve::Valve;

    fn model() -> Valve {
        let text = "schema = \"hil.valve/1\"\nname = \"test\"\ncurrent_limits = [\"0 A\", \"1 A\"]\nhysteresis.hyperbolic.a = \"0.8 bar^2\"\n\
                    delay = \"23 ms\"\n[curve]\nascending = [20.0, 0.0]\ndescending = [20.0, 0.5]\n";
        Valve::from_toml(text, "test").unwrap()
    }

    fn looked_at(fitter: &Fitter<'_>) -> Option<Evidence> {
        excerpt(fitter, &Model::base(&model()).unwrap(), None)
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
    fn all_is_looked_at_in_every_reading_and_in_steps_no_finer_than_those_of_a_search() {
        for (rate_hz, most_inner) in [(50.0, 4), (100.0, 4), (200.0, 2), (1000.0, 1)] {
            let all = evidence(30_000, 1.0 / rate_hz);
            let mut fitter = Fitter::new(&all);
            fitter.measured[..100].fill(f64::NAN);
            let looked = throughout(&fitter);
            assert_eq!((looked.samples(), looked.most_inner), (30_000, most_inner), "{rate_hz} Hz");
            assert_eq!(looked.current_a(), all.current_a(), "{rate_hz} Hz");
            assert!(looked.pressure_bar().iter().take_while(|p| p.is_nan()).count() == 100, "{rate_hz} Hz");
        }
        // A reading that stands for 4 ms is simulated in steps of 2 ms, as fine as one of 10 ms.
        let fast = looked_at(&Fitter::new(&evidence(64_000, 0.001))).unwrap();
        assert_eq!(((1e3 * fast.step_s()).round(), fast.most_inner), (4.0, 2));
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

    #[test]
    fn a_valve_at_rest_is_looked_at_where_it_moves_and_where_the_model_is_off() {
        // It moves for a minute at 500, 2000 and 3200 s, and something happens at 2600 s.
        let moves = |t: f64| [500.0, 2000.0, 3200.0].iter().any(|from| (*from..from + 60.0).contains(&t));
        let time_s = |k: usize| k as f64 * 0.01;
        let current: Vec<f64> = (0..360_000).map(|k| 0.5 + if moves(time_s(k)) { 0.3 * time_s(k).sin() } else { 0.0 }).collect();
        let off = |k: usize| if (2600.0..2700.0).contains(&time_s(k)) { 2.0 } else { 0.0 };
        let pressure = current.iter().enumerate().map(|(k, i)| 20.0 * i + off(k)).collect();
        let all = Evidence::new(vec![Run::even(None, 0.0, 0.01, current, pressure)], 0.02, Input::Ramp);
        let (fitter, valve) = (Fitter::new(&all), model());
        let base = Model::base(&valve).unwrap();
        let less = excerpt(&fitter, &base, Some(&fitter.recalibrate(&base, &[]))).unwrap();
        let windows: Vec<(f64, f64)> = less.grids.iter().map(|run| (run.time_s(0), run.time_s(run.len() - 1))).collect();
        for wanted in [530.0, 2030.0, 2650.0, 3230.0] {
            assert!(windows.iter().any(|(from, to)| (*from..*to).contains(&wanted)), "{wanted} s is not in {windows:?}");
        }
    }
}
