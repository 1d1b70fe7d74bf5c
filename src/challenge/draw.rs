//! What is concealed: drawn from the seed, as large, small, alone, in pairs, or not at all.

use rand::RngExt;
use rayon::prelude::*;

use super::anatomy::Anatomy;
use super::case::{Case, Concealed, UNKNOWN};
use super::chance::{stream, uniform};
use super::excitation::Drive;
use super::formulation::{CONTROLLERS, DRIVES, EFFECTS, Formulations, UNKNOWNS};
use super::plain::floor_bar;
use super::session::in_open_loop;

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

/// What a series is drawn from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Range {
    /// One plant only; `None`: two of three valves are blocks, one is equations.
    pub anatomy: Option<Anatomy>,
    /// Which formulations.
    pub formulations: Formulations,
}

/// Cases in a row from one seed. Of each 20, in shuffled order: 12 hide one effect, 1 a pair, 5 nothing and 2 something
/// unknown. Single effects come from a shuffled deck that holds each once; their sizes are aimed at faint, medium and
/// clear in turn. A longer series begins with the shorter one.
pub fn draw_series(seed: u64, count: usize, range: Range) -> Vec<Case> {
    drawn(seed, count, range).into_par_iter().map(|(case, aimed)| sized(case, aimed)).collect()
}

/// Healthy valves in a row from one seed.
pub fn draw_healthy(seed: u64, count: usize, range: Range) -> Vec<Case> {
    drawn(seed, 5 * count, range).into_iter().map(|(case, _)| case).filter(|c| c.effects.is_empty()).take(count).collect()
}

/// The cases with the size that each is aimed at.
fn drawn(seed: u64, count: usize, range: Range) -> Vec<(Case, f64)> {
    let rng = &mut stream(seed, 2);
    let mut kinds = Deck::new((0..20).collect());
    let mut singles = Deck::new((0..EFFECTS.len()).collect());
    let mut pairs = Deck::new((0..PAIRS.len()).collect());
    let mut unknowns = Deck::new(range.formulations.of(&UNKNOWNS).into_iter().map(usize::from).collect());
    let mut plants = Deck::new((0..3).collect());
    let mut turn = rng.random_range(0..3);
    (0..count)
        .map(|_| {
            let concealed = |id, variant| Concealed { id, variant, severity: 1.0 };
            let effects: Vec<Concealed> = match kinds.next(rng) {
                0..12 => vec![concealed(EFFECTS[singles.next(rng)], rng.random_range(0..2))],
                12 => {
                    let (a, b) = PAIRS[pairs.next(rng)];
                    [a, b].map(|id| concealed(id, rng.random_range(0..2))).to_vec()
                }
                13..18 => Vec::new(),
                _ => vec![concealed(UNKNOWN, unknowns.next(rng) as u8)],
            };
            turn = (turn + 1) % 3;
            let aimed = match turn {
                0 => uniform(rng, 0.5, 1.0),
                1 => uniform(rng, 1.0, 2.0),
                _ => uniform(rng, 2.0, 4.0),
            };
            // of a pair or of something unknown, nobody wants to see the faint
            let aimed = if effects.len() == 1 && effects[0].id != UNKNOWN { aimed } else { aimed.max(1.5) };
            let plant = if plants.next(rng) == 0 { Anatomy::Equations } else { Anatomy::Blocks };
            let anatomy = range.anatomy.unwrap_or(plant);
            (situated(rng.random::<u64>(), effects, anatomy, range.formulations), aimed)
        })
        .collect()
}

/// A case with its effects as large as drawn, in a drive, at a rate, in a loop that follow from the seed.
fn situated(seed: u64, effects: Vec<Concealed>, anatomy: Anatomy, formulations: Formulations) -> Case {
    let rng = &mut stream(seed, 3);
    let closed = rng.random::<f64>() < 0.4;
    // a faint effect that the calibration has taken in leaves nothing to find
    let absorbed = rng.random::<f64>() < 0.15 && !effects.is_empty() && effects.iter().all(|e| ABSORBABLE.contains(&e.id));
    let rate_hz = [100.0, 100.0, 100.0, 200.0, 500.0, 1000.0, 50.0, 50.0, 25.0, 20.0, 10.0][rng.random_range(0..11)];
    let longest = (80_000.0_f64 / rate_hz).min(780.0);
    let length_s = (60.0 * (longest / 60.0).powf(rng.random::<f64>())).round();
    let drive = formulations.choose(&DRIVES, rng);
    let controller = closed.then(|| formulations.choose(&CONTROLLERS, rng));
    Case { seed, effects, anatomy, formulations, drive, rate_hz, length_s, controller, absorbed, visible: 0.0 }
}

/// Makes the effects as large as aimed at, measured in what a plain model of the healthy valve leaves of the record;
/// no larger than 2.5 times what a bench would call clear, so that words keep their meaning.
fn sized(mut case: Case, aimed: f64) -> Case {
    if case.effects.is_empty() {
        return case;
    }
    let (currents, healthy) = in_open_loop(&case, &[]);
    let floor = floor_bar(&case, &currents, &healthy);
    let visible = |effects: &[Concealed]| {
        let faulty = in_open_loop(&case, effects).1;
        (faulty.iter().zip(&healthy).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / healthy.len() as f64).sqrt() / floor
    };
    let scaled = |size: f64| -> Vec<Concealed> { case.effects.iter().map(|e| Concealed { severity: size, ..e.clone() }).collect() };
    let mut tried: Vec<(f64, f64)> = Vec::new();
    let mut size: f64 = 0.7;
    for _ in 0..4 {
        let seen = visible(&scaled(size));
        tried.push((size, seen));
        // effects grow between in proportion and with the square of their size
        let next = (size * (aimed / seen.max(1e-3)).powf(0.8)).clamp(0.1, 2.5);
        if (seen / aimed).ln().abs() < 0.15 || next == size {
            break;
        }
        size = next;
    }
    let miss = |seen: f64| (seen.max(1e-3) / aimed).ln().abs();
    let (size, seen) = tried.into_iter().min_by(|a, b| miss(a.1).total_cmp(&miss(b.1))).unwrap_or((1.0, 0.0));
    (case.effects, case.visible) = (scaled(size), seen);
    case
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

/// A case with given effects, as large as drawn, on a plant of blocks with a mixed drive at 100 Hz; loop and
/// calibration follow from the seed.
pub fn placed(seed: u64, effects: Vec<Concealed>) -> Case {
    let may_be = |e: &Concealed| ABSORBABLE.contains(&e.id) && e.severity > 0.9;
    let case = situated(seed, effects, Anatomy::Blocks, Formulations::Open);
    let absorbed = case.absorbed && case.effects.iter().all(may_be);
    Case { drive: Drive::Mixed, rate_hz: 100.0, length_s: 120.0, absorbed, visible: 2.0, ..case }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plans(seed: u64, count: usize, range: Range) -> Vec<Case> {
        drawn(seed, count, range).into_iter().map(|(case, _)| case).collect()
    }

    #[test]
    fn a_series_conceals_every_effect_and_leaves_one_valve_in_four_healthy() {
        let cases = plans(5, 40, Range { anatomy: Some(Anatomy::Blocks), ..Range::default() });
        for id in EFFECTS {
            assert!(cases.iter().any(|c| c.ids() == [id]), "{id}");
        }
        let count = |f: &dyn Fn(&Case) -> bool| cases.iter().filter(|c| f(c)).count();
        assert_eq!(count(&|c| c.effects.is_empty()), 10);
        assert_eq!(count(&|c| c.ids() == [UNKNOWN]), 4);
        assert_eq!(count(&|c| c.effects.len() == 2), 2);
    }

    #[test]
    fn an_effect_is_made_as_large_as_aimed_at() {
        let effects = vec![Concealed { id: "leakage", variant: 0, severity: 1.0 }];
        for aimed in [0.7, 3.0] {
            let case = sized(placed(6, effects.clone()), aimed);
            assert!((case.visible / aimed).ln().abs() < 0.3, "{} for {aimed}", case.visible);
        }
    }

    #[test]
    fn the_same_seed_draws_the_same_series_and_a_longer_one_begins_with_it() {
        let series = |seed, count| plans(seed, count, Range::default());
        assert_eq!(series(5, 6), series(5, 9)[..6]);
        assert_ne!(series(5, 6), series(6, 6));
    }

    #[test]
    fn what_is_kept_for_the_end_is_a_third_and_never_drawn_before() {
        fn third<T: Copy>(list: &[super::super::formulation::Marked<T>]) {
            let kept = Formulations::Kept.of(list).len();
            assert_eq!(kept + Formulations::Open.of(list).len(), list.len());
            assert!((kept as f64 / list.len() as f64 - 1.0 / 3.0).abs() < 0.04, "{kept} of {}", list.len());
        }
        third(&super::super::formulation::LOOPS);
        third(&super::super::formulation::CURVES);
        third(&DRIVES);
        third(&CONTROLLERS);
        third(&UNKNOWNS);
        for case in plans(9, 60, Range { anatomy: Some(Anatomy::Blocks), formulations: Formulations::Open }) {
            assert!(Formulations::Open.of(&DRIVES).contains(&case.drive));
            assert!(!["duhem", "lugre", "jiles_atherton"].contains(&case.form()));
        }
    }
}
