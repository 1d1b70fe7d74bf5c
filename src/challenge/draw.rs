//! What is concealed: drawn from the seed, as large, small, alone, in pairs, or not at all.

use rand::RngExt;

use super::formulation::EFFECTS;
use super::specimen::{Specimen, stream, uniform};

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

/// Cases in a row from one seed. Of each 16, in shuffled order: 11 hide one effect, 2 a pair, 2 nothing and 1
/// something unknown. Single effects come from a shuffled deck that holds each once, clear and faint in turn.
pub fn draw_series(seed: u64, count: usize) -> Vec<Case> {
    let rng = &mut stream(seed, 2);
    let mut kinds = Deck::new((0..16).collect());
    let mut singles = Deck::new((0..EFFECTS.len()).collect());
    let mut pairs = Deck::new((0..PAIRS.len()).collect());
    let mut unknowns = Deck::new((0..3).collect());
    let mut faint = rng.random::<bool>();
    (0..count)
        .map(|_| {
            let effects: Vec<Concealed> = match kinds.next(rng) {
                0..11 => {
                    faint = !faint;
                    let severity = if faint { uniform(rng, 0.35, 0.5) } else { 1.0 };
                    vec![Concealed { id: EFFECTS[singles.next(rng)], variant: rng.random_range(0..2), severity }]
                }
                11 | 12 => {
                    let (a, b) = PAIRS[pairs.next(rng)];
                    [a, b].map(|id| Concealed { id, variant: rng.random_range(0..2), severity: 1.0 }).to_vec()
                }
                13 | 14 => Vec::new(),
                _ => vec![Concealed { id: UNKNOWN, variant: unknowns.next(rng) as u8, severity: 1.0 }],
            };
            placed(rng.random::<u64>(), effects)
        })
        .collect()
}

/// Cards that are shuffled anew when all are dealt.
struct Deck {
    cards: Vec<usize>,
    dealt: usize,
}

impl Deck {
    fn new(cards: Vec<usize>) -> Self {
        Self { dealt: cards.len(), cards }
    }
    fn next(&mut self, rng: &mut rand_pcg::Pcg64) -> usize {
        if self.dealt == self.cards.len() {
            for k in (1..self.cards.len()).rev() {
                self.cards.swap(k, rng.random_range(0..=k));
            }
            self.dealt = 0;
        }
        self.dealt += 1;
        self.cards[self.dealt - 1]
    }
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
    fn a_series_conceals_every_effect_and_leaves_one_valve_in_eight_healthy() {
        let cases = draw_series(5, 64);
        for id in EFFECTS {
            let of = |faint: bool| cases.iter().filter(|c| c.ids() == [id] && (c.effects[0].severity < 0.9) == faint).count();
            assert_eq!(of(true) + of(false), 2, "{id}");
        }
        let count = |f: &dyn Fn(&Case) -> bool| cases.iter().filter(|c| f(c)).count();
        assert_eq!(count(&|c| c.effects.is_empty()), 8);
        assert_eq!(count(&|c| c.ids() == [UNKNOWN]), 4);
        assert_eq!(count(&|c| c.effects.len() == 2), 8);
        assert_eq!(count(&|c| c.effects.len() == 1 && c.ids() != [UNKNOWN] && c.effects[0].severity < 0.9), 22);
    }

    #[test]
    fn the_same_seed_draws_the_same_series_and_a_longer_one_begins_with_it() {
        assert_eq!(draw_series(5, 20), draw_series(5, 40)[..20]);
        assert_ne!(draw_series(5, 20), draw_series(6, 20));
    }
}
