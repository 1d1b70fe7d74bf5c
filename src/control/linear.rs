//! The linear loop that stands for a valve model when margins are judged.

use super::stability::LoopPlant;
use crate::physics::resolve;
use crate::valve::Valve;

/// The linear plant of a valve, and what was left out on the way there.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearLoop {
    /// Gain, lag and delay.
    pub plant: LoopPlant,
    /// Range of the delay [s].
    pub delay_range_s: (f64, f64),
    /// Current at which the gain was taken [A].
    pub at_current_a: f64,
    /// Effects of the model that have no place in the linear loop.
    pub left_out: Vec<String>,
}

/// The linear loop of `valve`: the steepest slope of its reference curves, its largest lag, and a delay that holds
/// the dead time and the smaller lags, which is the cautious side (a lag turns the phase less than a delay of its size).
pub fn linear_loop(valve: &Valve) -> LinearLoop {
    const STEPS: usize = 400;
    let (low, high) = valve.curves.range_a;
    let slope = |i: f64| valve.curves.ascending.slope(i).max(valve.curves.descending.slope(i));
    let (at_current_a, gain) = (0..=STEPS)
        .map(|k| low + (high - low) * k as f64 / STEPS as f64)
        .map(|i| (i, slope(i)))
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .unwrap_or((low, 0.0));
    let mut lags = vec![valve.lag_s];
    let (mut delay_s, mut spread_s) = (0.0, 0.0);
    let mut left_out = Vec::new();
    let mut factor = 1.0;
    for spec in &valve.effects {
        match resolve(spec).ok().and_then(|(effect, theta)| effect.linear(&theta)) {
            Some(form) => {
                factor *= form.gain;
                lags.push(form.lag_s);
                delay_s += form.delay_s;
                spread_s += form.delay_spread_s;
            }
            None => left_out.push(spec.id.clone()),
        }
    }
    lags.sort_by(f64::total_cmp);
    let lag_s = lags.pop().unwrap_or(0.0);
    delay_s += lags.iter().sum::<f64>();
    LinearLoop {
        plant: LoopPlant { gain_bar_per_ma: factor * gain * 1e-3, lag_s, delay_s: valve.delay_s + delay_s },
        delay_range_s: (valve.delay_range_s.0 + delay_s, valve.delay_range_s.1 + delay_s + spread_s),
        at_current_a,
        left_out,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::controller::tests::valve;
    use crate::valve::EffectSpec;

    #[test]
    fn the_gain_is_the_steepest_slope() {
        // Ascending curve of Eq. (3): 185 i - 127.95 i^2 - 8.4 is largest at i = 185 / 255.9.
        let found = linear_loop(&valve());
        assert!((found.plant.gain_bar_per_ma - 0.058_472).abs() < 1e-5, "{found:?}");
        assert!((found.at_current_a - 0.7229).abs() < 3e-3);
        assert_eq!((found.plant.lag_s, found.plant.delay_s), (0.0, 0.02));
    }

    #[test]
    fn lags_of_the_effects_count() {
        let mut valve = valve();
        valve.lag_s = 0.01;
        let effect = |id: &str, name: &str, text: &str| EffectSpec { id: id.into(), parameters: vec![(name.into(), text.into())] };
        valve.effects = vec![effect("first_order_lag", "tau", "45 ms"), effect("stiction", "band", "10 mA")];
        let found = linear_loop(&valve);
        assert_eq!((found.plant.lag_s, found.plant.delay_s), (0.045, 0.03));
        assert_eq!(found.left_out, ["stiction"]);
    }
}
