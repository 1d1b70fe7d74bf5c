//! Sags of the supply: stretches in which the measured pressure stands at one level while the simulated one, above it,
//! moves, and other stretches in which it passes that level freely. When a shared pump is needed elsewhere is not in the
//! current, so no free simulation can follow it; the level shows it all the same.

use super::effect::Scatter;

/// A simulation this many times the noise above the measured pressure is too high.
const BEYOND: f64 = 8.0;
/// Shortest stretch [s].
const SHORTEST_S: f64 = 0.4;
/// Fewest stretches at the level.
const FEWEST: usize = 2;
/// Shortest time at the level, and beyond it elsewhere [s].
const TIME_S: f64 = 1.5;
/// Width of the level in units of the noise.
const LEVEL: f64 = 6.0;
/// Share of a stretch that must lie at the level.
const STANDING: f64 = 0.6;
/// Share that stretches at the level must have of all in which the simulation is too high.
const MOST: f64 = 0.7;
/// How much more than the noise the simulation must move in them.
const MOVING: f64 = 8.0;
/// Where the level lies at least among the simulated pressures: tank pressure is a level, too.
const HEIGHT: f64 = 0.3;
/// What is left out on both sides of a stretch: the pump does not recover at once [s].
const RECOVERY_S: f64 = 0.3;

/// What was found.
pub(super) struct Sags {
    /// The level [bar].
    pub level_bar: f64,
    /// Samples of each stretch, from and to.
    pub stretches: Vec<(usize, usize)>,
    /// Shorter stretches at that level: the peaks of what is asked.
    pub peaks: Vec<(usize, usize)>,
}

impl Sags {
    /// The samples in and about the stretches.
    pub fn samples(&self, dt_s: f64, samples: usize) -> Vec<usize> {
        let margin = (RECOVERY_S / dt_s) as usize;
        let near =
            |k: &usize| self.stretches.iter().chain(&self.peaks).any(|(from, to)| (from.saturating_sub(margin)..to + margin).contains(k));
        (0..samples).filter(near).collect()
    }

    /// The longest stretch.
    pub fn longest(&self) -> (usize, usize) {
        self.stretches.iter().copied().max_by_key(|(from, to)| to - from).unwrap_or((0, 0))
    }
}

/// Looks for sags.
pub(super) fn sags(of: &Scatter<'_>) -> Option<Sags> {
    let too_high = |k: usize| of.simulated_bar[k] - of.measured_bar[k] > BEYOND * of.noise_bar;
    let stretches = stretches(of.measured_bar.len(), (SHORTEST_S / of.dt_s) as usize, too_high);
    let mut pressures: Vec<f64> = stretches.iter().flat_map(|(from, to)| of.measured_bar[*from..*to].iter().copied()).collect();
    pressures.retain(|p| p.is_finite());
    let in_all = pressures.len();
    let level_bar = densest(&mut pressures, LEVEL * of.noise_bar)?;
    let (low, high) = of.simulated_bar.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
    if level_bar < low + HEIGHT * (high - low) {
        return None;
    }
    let at_level = |k: &usize| (of.measured_bar[*k] - level_bar).abs() <= 0.5 * LEVEL * of.noise_bar;
    let standing = |(from, to): &(usize, usize)| (*from..*to).filter(at_level).count() as f64 >= STANDING * (to - from) as f64;
    let found: Vec<(usize, usize)> = stretches.into_iter().filter(standing).collect();
    let inside: Vec<usize> = found.iter().flat_map(|(from, to)| *from..*to).collect();
    // Once the level is known, every reading that stands at it where it is too low is one of its own.
    let peaks = self::stretches(of.measured_bar.len(), 0, |k| too_high(k) && at_level(&k));
    let sags = Sags { level_bar, stretches: found, peaks };
    let fewest = TIME_S / of.dt_s;
    if sags.stretches.len() < FEWEST || (inside.len() as f64) < fewest.max(MOST * in_all as f64) {
        return None;
    }
    let near = sags.samples(of.dt_s, of.measured_bar.len());
    let mut near = near.iter().peekable();
    let beyond = (0..of.measured_bar.len())
        .filter(|k| near.next_if_eq(&k).is_none() && of.measured_bar[*k] > level_bar + BEYOND * of.noise_bar)
        .count();
    let mean = inside.iter().map(|k| of.simulated_bar[*k]).sum::<f64>() / inside.len() as f64;
    let spread_bar = (inside.iter().map(|k| (of.simulated_bar[*k] - mean).powi(2)).sum::<f64>() / inside.len() as f64).sqrt();
    (beyond as f64 >= fewest && spread_bar > MOVING * of.noise_bar).then_some(sags)
}

/// Runs of samples that hold, at least `shortest` long; one or two that do not are no end.
fn stretches(samples: usize, shortest: usize, holds: impl Fn(usize) -> bool) -> Vec<(usize, usize)> {
    let mut out: Vec<(usize, usize)> = Vec::new();
    for k in (0..samples).filter(|k| holds(*k)) {
        match out.last_mut() {
            Some(last) if k <= last.1 + 2 => last.1 = k + 1,
            _ => out.push((k, k + 1)),
        }
    }
    out.retain(|(from, to)| to - from >= shortest.max(3));
    out
}

/// The middle of the interval of this width that holds most of the values.
pub(super) fn densest(values: &mut [f64], width: f64) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let mut from = 0;
    let mut best = (0, f64::NAN);
    for to in 0..values.len() {
        while values[to] - values[from] > width {
            from += 1;
        }
        if to + 1 - from > best.0 {
            best = (to + 1 - from, 0.5 * (values[from] + values[to]));
        }
    }
    (best.0 > 0).then_some(best.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 60 s in which the pressure wanted swings between 10 and 26 bar, and `supply` bounds it.
    fn drive(supply: impl Fn(f64) -> f64) -> (Vec<f64>, Vec<f64>) {
        let wanted: Vec<f64> = (0..6000).map(|k| 18.0 + 8.0 * (k as f64 * 0.011).sin()).collect();
        let got = wanted.iter().enumerate().map(|(k, p)| p.min(supply(k as f64 * 0.01)) + 0.02 * ((k * 7919) % 13) as f64 / 6.0 - 0.02);
        (got.collect(), wanted)
    }

    fn found(supply: impl Fn(f64) -> f64) -> Option<Sags> {
        let (measured_bar, simulated_bar) = drive(supply);
        sags(&Scatter::between(&measured_bar, &simulated_bar, 0.03))
    }

    #[test]
    fn a_level_that_holds_at_times_is_a_sag() {
        let sagging = |t: f64| if (14.0..21.0).contains(&t) || (40.0..50.0).contains(&t) { 20.0 } else { 40.0 };
        let sags = found(sagging).expect("two sags");
        assert!((sags.level_bar - 20.0).abs() < 0.1, "{}", sags.level_bar);
        assert!(sags.stretches.len() >= 2);
    }

    #[test]
    fn the_peaks_that_a_sag_cuts_belong_to_it_however_short_they_are() {
        let sagging = |t: f64| if (14.0..21.0).contains(&t) || (40.0..50.0).contains(&t) { 20.0 } else { 40.0 };
        let (mut measured_bar, mut simulated_bar) = drive(sagging);
        // In the second sag, half a second of peaks of 50 ms each that all are cut at the level.
        for k in (4600..4650).filter(|k| k % 10 < 5) {
            (simulated_bar[k], measured_bar[k]) = (24.0, 20.0);
        }
        for k in (4600..4650).filter(|k| k % 10 >= 5) {
            (simulated_bar[k], measured_bar[k]) = (12.0, 12.0);
        }
        let sags = sags(&Scatter::between(&measured_bar, &simulated_bar, 0.03)).expect("two sags");
        let masked = sags.samples(0.01, 6000);
        assert!((4600..4650).filter(|k| k % 10 < 5).all(|k| masked.contains(&k)));
    }

    #[test]
    fn a_level_that_always_holds_and_none_at_all_are_not() {
        assert!(found(|_| 20.0).is_none());
        assert!(found(|_| 40.0).is_none());
    }

    #[test]
    fn a_tank_pressure_that_has_drifted_is_not() {
        let (_, wanted) = drive(|_| 40.0);
        let wanted: Vec<f64> = wanted.iter().map(|p| (p - 15.0).max(0.0) * 2.0 + 0.5).collect();
        let measured: Vec<f64> = wanted.iter().enumerate().map(|(k, p)| if k > 3000 && *p < 2.0 { 0.1 } else { *p }).collect();
        assert!(sags(&Scatter::between(&measured, &wanted, 0.03)).is_none());
    }

    #[test]
    fn a_pressure_that_is_too_low_at_any_level_is_not() {
        let (measured, wanted) = drive(|_| 40.0);
        let low: Vec<f64> = measured.iter().map(|p| 0.95 * p).collect();
        assert!(sags(&Scatter::between(&low, &wanted, 0.03)).is_none());
    }
}
