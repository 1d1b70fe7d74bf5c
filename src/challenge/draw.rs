//! What is concealed: drawn from the seed, as large, small, alone, in pairs, or not at all.

use rand::RngExt;

use super::specimen::{Specimen, stream, uniform};

/// The effects that a diagnosis can name and this plant can conceal. The shape of the curve is no entry: every
/// specimen's curve differs from a cubic.
pub const EFFECTS: [&str; 22] = [
    "transport_delay",
    "delay_jitter",
    "first_order_lag",
    "second_order_resonance",
    "flow_limit",
    "reversal_dead_band",
    "stiction",
    "fill_phase",
    "supply_saturation",
    "reference_drift",
    "reference_shift",
    "leakage",
    "rate_dependent_hysteresis",
    "creep",
    "air_entrainment",
    "coil_heating",
    "nonlocal_memory",
    "sensor_lag",
    "sensor_quantization",
    "sensor_drift",
    "sensor_outliers",
    "periodic_disturbance",
];

/// Effects that a sweep shows as well, so that a calibration may have taken them in without making them invisible.
const ABSORBABLE: [&str; 7] =
    ["reversal_dead_band", "stiction", "fill_phase", "supply_saturation", "flow_limit", "creep", "rate_dependent_hysteresis"];

/// Pairs that act at different places of the signal's way, so that two names are a fair thing to ask for.
const PAIRS: [(&str, &str); 10] = [
    ("first_order_lag", "supply_saturation"),
    ("stiction", "reference_drift"),
    ("reversal_dead_band", "sensor_drift"),
    ("transport_delay", "creep"),
    ("fill_phase", "coil_heating"),
    ("second_order_resonance", "leakage"),
    ("flow_limit", "sensor_quantization"),
    ("nonlocal_memory", "sensor_outliers"),
    ("air_entrainment", "reference_drift"),
    ("sensor_lag", "reversal_dead_band"),
];

/// The id that stands for physics outside every library.
pub const UNKNOWN: &str = "unknown";

/// One concealed effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Concealed {
    /// Id as in the effects of the valve file, or `unknown`.
    pub id: &'static str,
    /// Which of its physical formulations.
    pub variant: u8,
    /// Size relative to a clear case (1.0); 0.35 to 0.5 is faint.
    pub severity: f64,
}

/// One case of the challenge.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// Everything else follows from it.
    pub seed: u64,
    /// What is concealed; empty for a healthy valve.
    pub effects: Vec<Concealed>,
    /// Whether the drives run in closed loop.
    pub closed: bool,
    /// Whether the effects were there when the valve was calibrated.
    pub absorbed: bool,
}

impl Case {
    /// Number of the hysteresis form: 0 reciprocal, 1 plays, 2 Dahl.
    pub fn family(&self) -> u8 {
        Specimen::draw(self.seed).family.number()
    }
    /// Delay of the healthy valve [s].
    pub fn delay_s(&self) -> f64 {
        Specimen::draw(self.seed).delay_s
    }
    /// Standard deviation of the sensor's noise [bar].
    pub fn noise_bar(&self) -> f64 {
        Specimen::draw(self.seed).noise_bar
    }
    /// The ids concealed, in order.
    pub fn ids(&self) -> Vec<&'static str> {
        self.effects.iter().map(|e| e.id).collect()
    }
    /// Name of the case: `stiction`, `first_order_lag+creep`, `healthy`.
    pub fn name(&self) -> String {
        if self.effects.is_empty() { "healthy".to_owned() } else { self.ids().join("+") }
    }
}

/// The case of a seed: 11 of 16 hide one effect (half of them faint), 2 a pair, 2 nothing, 1 something unknown.
pub fn draw_case(seed: u64) -> Case {
    let rng = &mut stream(seed, 2);
    let kind = rng.random_range(0..16);
    let severity = |rng: &mut rand_pcg::Pcg64| if rng.random::<bool>() { 1.0 } else { uniform(rng, 0.35, 0.5) };
    let effects: Vec<Concealed> = match kind {
        0..11 => {
            let id = EFFECTS[rng.random_range(0..EFFECTS.len())];
            vec![Concealed { id, variant: rng.random_range(0..2), severity: severity(rng) }]
        }
        11 | 12 => {
            let (a, b) = PAIRS[rng.random_range(0..PAIRS.len())];
            [a, b].map(|id| Concealed { id, variant: rng.random_range(0..2), severity: 1.0 }).to_vec()
        }
        13 | 14 => Vec::new(),
        _ => vec![Concealed { id: UNKNOWN, variant: rng.random_range(0..3), severity: 1.0 }],
    };
    placed(seed, effects)
}

/// A case with given effects; loop and calibration still follow from the seed.
pub fn placed(seed: u64, effects: Vec<Concealed>) -> Case {
    let rng = &mut stream(seed, 3);
    let closed = rng.random::<f64>() < 0.45;
    // a faint effect that the calibration has taken in leaves nothing to find
    let may_be = |e: &Concealed| ABSORBABLE.contains(&e.id) && e.severity > 0.9;
    let absorbed = rng.random::<f64>() < 0.35 && !effects.is_empty() && effects.iter().all(may_be);
    Case { seed, effects, closed, absorbed }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_seeds_conceal_every_effect_and_leave_some_valves_healthy() {
        let cases: Vec<Case> = (0..2000).map(draw_case).collect();
        for id in EFFECTS {
            for variant in 0..2 {
                assert!(cases.iter().any(|c| c.effects.iter().any(|e| e.id == id && e.variant == variant)), "{id} {variant}");
            }
        }
        let share = |f: &dyn Fn(&Case) -> bool| cases.iter().filter(|c| f(c)).count() as f64 / 2000.0;
        assert!((share(&|c| c.effects.is_empty()) - 0.125).abs() < 0.03);
        assert!((share(&|c| c.ids() == [UNKNOWN]) - 0.0625).abs() < 0.02);
        assert!((share(&|c| c.effects.len() == 2) - 0.125).abs() < 0.03);
    }
}
