//! Preisach's model by Everett's function over the stack of reversals.
//!
//! Source: I. D. Mayergoyz, Mathematical Models of Hysteresis (1991), sections 1.2 and 1.3: a leg of the input from a
//! reversal `a` to `u` adds the integral of the density over the triangle between them, and a leg that passes an older
//! reversal wipes it out.

/// The input that passes on to the curve, with the reversals that are still remembered.
#[derive(Debug, Clone)]
pub(super) struct Reversals {
    /// Mean half width of the relays in the middle of the range [A], and how it changes per ampere.
    half_a: f64,
    slope: f64,
    /// Share of the current that goes through the relays.
    share: f64,
    /// Input and output at each remembered reversal, oldest first.
    turns: Vec<(f64, f64)>,
    last_a: f64,
    output_a: f64,
}

impl Reversals {
    /// A loop that is `2 half_width_a` wide where it is full; `reach` as in the specimen.
    pub(super) fn new(half_width_a: f64, reach: f64, start_a: f64) -> Self {
        let share = 0.35 / reach;
        let mut new = Self {
            half_a: half_width_a / share,
            slope: 0.9 * (reach - 1.0),
            share,
            turns: vec![(-0.2, -0.2)],
            last_a: -0.2,
            output_a: -0.2,
        };
        new.step(start_a);
        new
    }

    /// Everett's function [A]: what a leg between two inputs moves the output by. With relay half widths that are
    /// exponentially distributed with mean `h`, the triangle of side `l` holds `l - 2 h (1 - exp(-l / 2 h))`.
    fn everett(&self, from_a: f64, to_a: f64) -> f64 {
        let (length, middle) = ((to_a - from_a).abs(), 0.5 * (from_a + to_a));
        let half = self.half_a * (1.0 + self.slope * (middle - 0.5)).clamp(0.4, 1.6);
        (length - 2.0 * half * (1.0 - (-length / (2.0 * half)).exp())).copysign(to_a - from_a)
    }

    pub(super) fn step(&mut self, input_a: f64) -> f64 {
        if input_a != self.last_a {
            let rising = input_a > self.last_a;
            if self.turns.last().is_some_and(|t| (self.last_a > t.0) != rising && self.last_a != t.0) {
                self.turns.push((self.last_a, self.output_a));
            }
            // the leg passes the reversal before the last: both are forgotten
            while self.turns.len() > 2 {
                let before = self.turns[self.turns.len() - 2].0;
                if if rising { input_a >= before } else { input_a <= before } {
                    self.turns.truncate(self.turns.len() - 2);
                } else {
                    break;
                }
            }
            let from = self.turns.last().copied().unwrap_or((self.last_a, self.output_a));
            self.output_a = from.1 + self.everett(from.0, input_a);
            self.last_a = input_a;
        }
        (1.0 - self.share) * input_a + self.share * (self.output_a + 2.0 * self.half_a * 0.5)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_minor_loop_closes_and_is_wiped_out() {
        let mut r = Reversals::new(0.011, 1.1, 0.1);
        let path = |r: &mut Reversals, to: f64| {
            let from = r.last_a;
            (0..=200).map(|k| r.step(from + (to - from) * f64::from(k) / 200.0)).last().unwrap_or_default()
        };
        let at = path(&mut r, 0.6);
        path(&mut r, 0.45);
        let back = path(&mut r, 0.6);
        assert!((at - back).abs() < 1e-9, "{at} {back}");
        // a leg beyond the reversal is as if the minor loop had never been
        let mut straight = Reversals::new(0.011, 1.1, 0.1);
        assert!((path(&mut r, 0.8) - path(&mut straight, 0.8)).abs() < 1e-9);
        assert!(r.turns.len() == straight.turns.len());
    }

    #[test]
    fn the_major_loop_has_its_width_and_every_leg_rises() {
        let mut r = Reversals::new(0.011, 1.0, 0.0);
        let grid = |k: u32| f64::from(k) * 0.001;
        let up: Vec<f64> = (0..=1000).map(|k| r.step(grid(k))).collect();
        assert!(up.windows(2).all(|w| w[1] >= w[0]));
        let mut down: Vec<f64> = (0..=1000).rev().map(|k| r.step(grid(k))).collect();
        down.reverse();
        let width = down[500] - up[500];
        assert!((width - 0.022).abs() < 0.004, "{width}");
    }
}
