//! A play before the curve whose size changes with the speed of the current.

use super::reversal_dead_band::Play;
use super::signal::{Arrival, Step};
use crate::valve::ReferenceCurves;

/// The play at work.
pub(super) struct RateClearance {
    curves: ReferenceCurves,
    /// Mean slope of the curves [bar/A].
    slope: f64,
    arrival: Arrival,
    /// The spool before the curves, by the current that it has followed to [A].
    spool: Play,
    /// Pressure on the curves there [bar].
    followed_bar: f64,
    /// Current at the last sample [A], and the pressure on the curves there [bar].
    last: (f64, f64),
    /// What the play took of the pressure there [bar].
    lost_bar: f64,
}

impl RateClearance {
    /// Before these curves.
    pub fn before(curves: &ReferenceCurves, arrival: Arrival) -> Self {
        let slope = curves.span_bar() / (curves.range_a.1 - curves.range_a.0);
        let spool = Play { radius: 0.0, position: 0.0 };
        Self { curves: curves.clone(), slope, arrival, spool, followed_bar: 0.0, last: (0.0, 0.0), lost_bar: 0.0 }
    }

    /// At rest at this current [A].
    pub fn start(&mut self, current_a: f64) {
        self.last = (current_a, self.curves.average_at(current_a));
        (self.spool.position, self.followed_bar) = self.last;
        self.lost_bar = 0.0;
    }

    /// What the play takes of the pressure [bar] during the step to `current_a` [A]: `sizes`, half of its width over the mean slope of the
    /// curves [bar] at the instant before a held command jumps, right behind it, and at the sample. As it closes, the spool is drawn on.
    #[inline]
    pub fn step(&mut self, current_a: f64, sizes: [f64; 3]) -> Step {
        let before = self.lost_bar;
        let now = if current_a == self.last.0 { self.last } else { (current_a, self.curves.average_at(current_a)) };
        let lost = match self.arrival {
            Arrival::Held { left } => {
                let ends = self.taken(self.last, sizes[0]);
                let begins = self.taken(now, sizes[1]);
                let to = self.taken(now, sizes[2]);
                let mean = 0.5 * ((1.0 - left) * (before + ends) + left * (begins + to));
                Step { to, mean, jump: begins - ends }
            }
            Arrival::Ramp => Step::arriving(before, self.taken(now, sizes[2]), self.arrival),
        };
        (self.last, self.lost_bar) = (now, lost.to);
        lost
    }

    /// The spool follows to within the play; what that takes of the pressure [bar].
    #[inline]
    fn taken(&mut self, (current_a, pressure_bar): (f64, f64), size_bar: f64) -> f64 {
        let before_a = self.spool.position;
        self.spool.radius = size_bar / self.slope;
        if self.spool.follow(current_a) != before_a {
            self.followed_bar = self.curves.average_at(self.spool.position);
        }
        pressure_bar - self.followed_bar
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::valve::Polynomial;

    const SLOPE: f64 = 30.0;

    fn clearance(arrival: Arrival) -> RateClearance {
        let line = || Polynomial::new(vec![SLOPE, -2.0]);
        let mut clearance = RateClearance::before(&ReferenceCurves::on_range(line(), line(), (0.0, 1.0)), arrival);
        clearance.start(0.5);
        clearance
    }

    #[test]
    fn of_one_size_it_is_a_dead_band_at_the_reversal() {
        let mut clearance = clearance(Arrival::Ramp);
        let mut play = Play { radius: 0.01, position: 0.5 };
        for k in 0..2000 {
            let current_a = 0.5 + 0.2 * (0.01 * f64::from(k)).sin() + 0.02 * (0.13 * f64::from(k)).sin();
            let lost_bar = clearance.step(current_a, [0.01 * SLOPE; 3]).to;
            let expected_bar = SLOPE * (current_a - play.follow(current_a));
            assert!((lost_bar - expected_bar).abs() < 1e-9, "{k}: {lost_bar} {expected_bar}");
        }
    }

    #[test]
    fn as_it_closes_the_spool_is_drawn_on_and_what_is_left_at_rest_stays() {
        let mut clearance = clearance(Arrival::Ramp);
        let lost_bar = [1.2, 0.3, 2.0].map(|size_bar| clearance.step(0.6, [0.0, 0.0, size_bar]).to);
        assert!((lost_bar[0] - 1.2).abs() < 1e-9 && (lost_bar[1] - 0.3).abs() < 1e-9, "{lost_bar:?}");
        assert_eq!(lost_bar[2], lost_bar[1], "at rest nothing moves back");
    }

    #[test]
    fn a_command_that_is_held_is_taken_before_its_jump_and_behind_it() {
        let lost = clearance(Arrival::Held { left: 0.25 }).step(0.6, [0.3, 1.2, 0.6]);
        assert!((lost.to - 0.6).abs() < 1e-9 && (lost.jump - 1.2).abs() < 1e-9, "{lost:?}");
        assert!((lost.mean - 0.25 * 0.9).abs() < 1e-9, "{lost:?}");
    }
}
