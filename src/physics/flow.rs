//! A chamber that is fed through a restriction, d' = -sgn(d) |d|^m / tau for d = y - u: solved for an input that stands.

use super::power::Power;

/// Input that changes by more than this within a step is taken in parts [bar].
pub(super) const RESOLUTION_BAR: f64 = 0.2;
/// A chamber that is this near to its target is there [bar].
const SETTLED_BAR: f64 = 1e-7;

/// A restriction with the exponent m below 1 of its flow over its pressure drop: the target is reached in finite time.
#[derive(Debug, Clone)]
pub(super) struct Flow {
    loss: f64,
    less: Power,
    back: Power,
    per_area: f64,
}

impl Flow {
    /// With this exponent, below 1.
    pub fn new(exponent: f64) -> Self {
        let loss = 1.0 - exponent;
        Self { loss, less: Power::new(loss), back: Power::new(1.0 / loss), per_area: 1.0 / (1.0 + loss) }
    }

    /// The pressure a time of `steps` time constants after `output`, and the integral of its distance from the target
    /// over that time in time constants.
    #[inline]
    pub fn towards(&self, target: f64, output: f64, steps: f64) -> (f64, f64) {
        let away = output - target;
        let size = away.abs();
        if size < SETTLED_BAR {
            return (target, 0.0);
        }
        let before = self.less.of(size);
        let after = (before - self.loss * steps).max(0.0);
        let left = self.back.of(after);
        (target + left.copysign(away), ((size * before - left * after) * self.per_area).copysign(away))
    }
}

/// The share 1 - exp(-q) of its way that a linear lag has gone after `q` time constants. For time constants that change as they go.
#[inline]
fn gone(q: f64) -> f64 {
    if q >= 2.0 {
        return 1.0 - (-q).exp();
    }
    // 2 t / (1 + t) with t = tanh(q / 2), Lambert's continued fraction to its fifth term, z = q / 2.
    let z = 0.5 * q;
    let square = z * z;
    let above = z * (945.0 + square * (105.0 + square));
    2.0 * above / (945.0 + square * (420.0 + 15.0 * square) + above)
}

/// A linear lag from `output` behind an input that stands at `target`, after `q` time constants: its end, and its mean distance from the
/// target on the way. For time constants that change as they go.
#[inline]
pub(super) fn towards(target: f64, output: f64, q: f64) -> (f64, f64) {
    let gone = gone(q);
    let away = output - target;
    (output - away * gone, if q > 1e-9 { away * gone / q } else { away })
}

/// A linear lag from `output` behind an input on a straight line from `a` to `b` that lasts `q` time constants: its end,
/// and its mean on the way. For time constants that change as they go; [`super::FirstOrder`] is for one that stays.
#[inline]
pub(super) fn along_line(output: f64, q: f64, a: f64, b: f64) -> (f64, f64) {
    if q < 1e-9 {
        return (output, output);
    }
    let (gone, per_time) = (gone(q), 1.0 / q);
    // Weight of the begin of the line, from the exact answer to a ramp.
    let early = if q > 1e-4 { gone * per_time - (1.0 - gone) } else { 0.5 * q };
    let end = output + early * (a - b) + gone * (b - output);
    (end, 0.5 * (a + b) - (end - output) * per_time)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_way_is_that_of_the_exponential() {
        for q in [0.0, 1e-9, 1e-3, 0.1, 0.3, 0.5, 1.0, 1.999_999, 2.0, 50.0] {
            let exact = -f64::exp_m1(-q);
            assert!((gone(q) - exact).abs() <= 2e-7 * exact, "{q}: {} for {exact}", gone(q));
        }
    }

    #[test]
    fn an_orifice_is_at_its_target_in_finite_time() {
        // sqrt(d) falls by half a time constant's worth per time constant: from 4 bar it takes 4, with the area 4^1.5 / 1.5.
        let flow = Flow::new(0.5);
        let (end, area) = flow.towards(0.0, 4.0, 2.0);
        assert!((end - 1.0).abs() < 1e-3 && (area - (8.0 - 1.0) / 1.5).abs() < 1e-3, "{end} {area}");
        let (end, area) = flow.towards(0.0, -4.0, 6.0);
        assert!(end.abs() < 1e-9 && (area + 8.0 / 1.5).abs() < 1e-3, "{end} {area}");
    }
}
