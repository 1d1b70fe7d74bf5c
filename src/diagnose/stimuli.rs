//! The menu of stimuli that an experiment chooses from: currents over time, within the limits of the valve.

use rand::{RngExt, SeedableRng};

use crate::valve::Valve;

/// Shortest time between two points: a jump [s].
const JUMP_S: f64 = 0.01;

/// A current over time, straight lines between points.
pub struct Stimulus {
    /// What it is, in a few words.
    pub name: &'static str,
    /// Time [s] and current [A], the times increasing from 0 s.
    pub points: Vec<(f64, f64)>,
}

/// A stimulus in the making.
struct Path {
    points: Vec<(f64, f64)>,
    range_a: (f64, f64),
}

impl Path {
    fn from(current_a: f64, range_a: (f64, f64)) -> Self {
        Self { points: vec![(0.0, rounded(current_a, 1e-4).clamp(range_a.0, range_a.1))], range_a }
    }
    fn last(&self) -> (f64, f64) {
        self.points.last().copied().unwrap_or_default()
    }
    /// A straight line to `current_a` in `over_s`.
    fn to(&mut self, current_a: f64, over_s: f64) -> &mut Self {
        let (t, _) = self.last();
        let current_a = rounded(current_a, 1e-4).clamp(self.range_a.0, self.range_a.1);
        self.points.push((rounded(t + over_s.max(JUMP_S), 1e-3), current_a));
        self
    }
    fn hold(&mut self, for_s: f64) -> &mut Self {
        let current_a = self.last().1;
        self.to(current_a, for_s)
    }
    fn jump(&mut self, current_a: f64, hold_s: f64) -> &mut Self {
        self.to(current_a, JUMP_S).hold(hold_s)
    }
    fn named(self, name: &'static str) -> Stimulus {
        Stimulus { name, points: self.points }
    }
}

/// To whole steps of `size`: what a plan prints is what is simulated.
fn rounded(value: f64, size: f64) -> f64 {
    (value / size).round() * size
}

/// The limits of the current, inwards to what a plan prints [A].
pub fn limits(valve: &Valve) -> (f64, f64) {
    let (low, high) = valve.current_limits_a;
    // A hair of tolerance, so that a limit that is printed whole stays itself.
    (((low / 1e-4 - 1e-6).ceil()) * 1e-4, ((high / 1e-4 + 1e-6).floor()) * 1e-4)
}

/// The menu for a valve.
pub fn menu(valve: &Valve) -> Vec<Stimulus> {
    let limits = limits(valve);
    let range = valve.curves.range_a;
    // Where the curves hold, but for the dips to the empty clutch.
    let (low, high) = (range.0.clamp(limits.0, limits.1), range.1.clamp(limits.0, limits.1));
    let (low, high) = if high - low > 0.1 * (limits.1 - limits.0) { (low, high) } else { limits };
    let at = |share: f64| low + share * (high - low);
    let path = |share: f64| Path::from(at(share), limits);
    let mut all = Vec::new();

    let mut p = path(0.1);
    for _ in 0..2 {
        p.to(at(0.9), 15.0).to(at(0.1), 15.0);
    }
    all.push(p.named("a slow triangle"));

    let mut p = path(0.2);
    for period_s in [4.0, 2.0, 1.0, 0.5, 0.25] {
        for _ in 0..4 {
            p.to(at(0.8), 0.5 * period_s).to(at(0.2), 0.5 * period_s);
        }
        p.hold(2.0);
    }
    all.push(p.named("triangles from slow to fast"));

    let mut p = path(0.1);
    for share in [0.25, 0.4, 0.55, 0.7, 0.85, 0.95, 0.8, 0.65, 0.5, 0.35, 0.2, 0.1] {
        p.jump(at(share), 3.0);
    }
    all.push(p.named("a staircase with dwells"));

    let mut random = rand_pcg::Pcg64::seed_from_u64(0x0073_7465_7073);
    let mut p = path(0.5);
    for _ in 0..40 {
        let share = random.random_range(0.05..0.95);
        p.jump(at(share), random.random_range(0.3..2.0));
    }
    all.push(p.named("random steps"));

    let mut p = path(0.5);
    p.hold(1.0);
    for cycle in 0..60 {
        // 0.3 Hz to 9 Hz, each cycle a little faster.
        let half_s = 0.5 / (0.3 * 30f64.powf(f64::from(cycle) / 59.0));
        p.to(at(0.56), 0.5 * half_s).to(at(0.44), half_s).to(at(0.5), 0.5 * half_s);
    }
    all.push(p.named("small waves from slow to fast"));

    let mut p = path(0.1);
    for (from, to) in [(0.9, 0.2), (0.8, 0.3), (0.7, 0.4), (0.6, 0.45)] {
        p.to(at(from), 3.0).to(at(to), 3.0).to(at(from), 3.0);
    }
    p.to(at(0.1), 4.0);
    all.push(p.named("nested loops"));

    let mut p = Path::from(limits.0, limits);
    for share in [0.5, 0.8, 0.35, 0.65] {
        p.jump(at(0.3), 0.15).jump(at(share), 2.5).to(at(0.15), 0.3).hold(0.5).jump(limits.0, 2.0);
    }
    all.push(p.named("shifts from the empty clutch"));

    let mut p = path(0.2);
    p.hold(10.0).jump(at(0.75), 30.0).jump(at(0.4), 30.0);
    all.push(p.named("long dwells after a jump"));

    let mut p = path(0.2);
    p.to(at(0.5), 3.0).hold(2.0);
    for size in [0.01, 0.02, 0.04] {
        p.to(at(0.5 + size), 5.0).to(at(0.5 - size), 10.0).to(at(0.5), 5.0);
    }
    all.push(p.named("micro-ramps about the middle"));
    all
}

/// The current of a stimulus at even steps of `dt_s`: times [s] and currents [A].
pub fn sampled(points: &[(f64, f64)], dt_s: f64) -> (Vec<f64>, Vec<f64>) {
    let end_s = points.last().map_or(0.0, |p| p.0);
    let count = (end_s / dt_s).round() as usize + 1;
    let mut k = 0;
    (0..count)
        .map(|j| {
            let t = j as f64 * dt_s;
            while k + 2 < points.len() && points[k + 1].0 <= t {
                k += 1;
            }
            let (a, b) = (points[k], points[(k + 1).min(points.len() - 1)]);
            let share = if b.0 > a.0 { ((t - a.0) / (b.0 - a.0)).clamp(0.0, 1.0) } else { 0.0 };
            (t, a.1 + share * (b.1 - a.1))
        })
        .unzip()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_stimulus_stays_within_the_limits_and_goes_forward() {
        let valve = Valve::load(std::path::Path::new("valves/paper.toml")).unwrap();
        let menu = menu(&valve);
        assert_eq!(menu.len(), 9);
        for stimulus in menu {
            assert!(stimulus.points.windows(2).all(|w| w[1].0 > w[0].0), "{}", stimulus.name);
            let (low, high) = valve.current_limits_a;
            assert!(stimulus.points.iter().all(|p| (low..=high).contains(&p.1)), "{}", stimulus.name);
            let span = stimulus.points.iter().fold((1.0f64, 0.0f64), |(l, h), p| (l.min(p.1), h.max(p.1)));
            assert!(span.1 - span.0 > 0.02, "{} moves", stimulus.name);
            assert!(stimulus.points.last().unwrap().0 < 120.0, "{} is short", stimulus.name);
        }
    }

    #[test]
    fn samples_lie_on_the_lines() {
        let (t, i) = sampled(&[(0.0, 0.0), (0.2, 0.4), (0.3, 0.4)], 0.1);
        assert_eq!(t.len(), 4);
        for (i, expected) in i.iter().zip([0.0, 0.2, 0.4, 0.4]) {
            assert!((i - expected).abs() < 1e-12);
        }
    }
}
