//! A fleet with a concealed story: lots, suppliers, two kinds of sensors; one bad lot whose effect sets in with the
//! mileage; here and there a valve with a fault of its own.

use rand::RngExt;
use rayon::prelude::*;
use serde_json::{Value, json};

use super::anatomy::Anatomy;
use super::case::Concealed;
use super::chance::{stream, uniform};
use super::excitation::{self, Drive};
use super::formulation::Formulations;
use super::plant::Plant;
use super::session::open_loop;
use super::specimen::Specimen;
use crate::recording::Run;

/// Effects that set in with wear.
const WEAR: [&str; 6] = ["leakage", "reversal_dead_band", "stiction", "first_order_lag", "air_entrainment", "reference_shift"];
/// Valves of a lot.
const LOT: usize = 15;
/// Mileage that the fleet covers [km].
const RANGE_KM: f64 = 200_000.0;
/// Share of valves with a fault of their own.
const STRAY: f64 = 0.03;
const RATE_HZ: f64 = 100.0;

/// One valve of the fleet.
#[derive(Debug, Clone, PartialEq)]
pub struct FleetValve {
    /// Its number, from 1.
    pub number: usize,
    /// Its lot.
    pub lot: String,
    /// Its part number; the transmitter belongs to it.
    pub part: usize,
    /// Who made it.
    pub supplier: &'static str,
    /// Day of the recording.
    pub date: String,
    /// Mileage [km].
    pub mileage_km: f64,
    effects: Vec<Concealed>,
    seed: u64,
}

/// A fleet and its story.
#[derive(Debug, Clone, PartialEq)]
pub struct Fleet {
    /// All valves.
    pub valves: Vec<FleetValve>,
    seed: u64,
    /// The bad lot, its effect, and where it sets in [km].
    pub story: (String, &'static str, f64),
}

/// Draws a fleet of `count` valves.
pub fn draw_fleet(seed: u64, count: usize) -> Fleet {
    let rng = &mut stream(seed, 60);
    let lots = count.div_ceil(LOT).max(2);
    let bad = rng.random_range(0..lots);
    let effect = WEAR[rng.random_range(0..WEAR.len())];
    let (variant, onset_km) = (rng.random_range(0..2), uniform(rng, 0.25, 0.65) * RANGE_KM);
    let changed = rng.random_range(lots / 3..=2 * lots / 3);
    let valves = (0..count)
        .map(|k| {
            let lot = k % lots;
            let mileage_km = uniform(rng, 0.0, RANGE_KM).round();
            let stray = rng.random::<f64>() < STRAY;
            let other =
                Concealed { id: WEAR[rng.random_range(0..WEAR.len())], variant: rng.random_range(0..2), severity: uniform(rng, 0.6, 1.5) };
            let effects = if lot == bad && mileage_km > onset_km {
                let severity = 0.8 + 1.2 * (mileage_km - onset_km) / (RANGE_KM - onset_km);
                vec![Concealed { id: effect, variant, severity }]
            } else if stray {
                vec![other]
            } else {
                Vec::new()
            };
            FleetValve {
                number: k + 1,
                lot: lot_name(lot),
                part: k % 2,
                supplier: if lot < changed { "north" } else { "south" },
                date: format!("2026-{:02}-{:02}", 1 + lot * 10 / lots, 1 + k * 7 % 28),
                mileage_km,
                effects,
                seed: rng.random(),
            }
        })
        .collect();
    Fleet { valves, seed, story: (lot_name(bad), effect, onset_km) }
}

fn lot_name(lot: usize) -> String {
    format!("L{:03}", lot + 1)
}

impl Fleet {
    /// The truth, to be sealed.
    pub fn truth(&self) -> Value {
        let (lot, effect, onset_km) = &self.story;
        let valves: Vec<Value> = self
            .valves
            .iter()
            .map(|v| json!({ "number": v.number, "effects": v.effects.iter().map(|e| e.id).collect::<Vec<_>>(), "seed": v.seed }))
            .collect();
        json!({ "schema": "hil.fleet.truth/1", "seed": self.seed, "lot": lot, "effect": effect, "onset_km": onset_km, "range_km": RANGE_KM, "valves": valves })
    }

    /// The type of a part number: what all its valves have in common.
    fn part(&self, part: usize) -> Specimen {
        let mut specimen = Specimen::draw(self.seed.wrapping_add(part as u64), Anatomy::Blocks, Formulations::Open);
        specimen.noise_bar = if part == 0 { 0.025 } else { 0.05 };
        specimen
    }

    /// The sweep of a good valve of a part number.
    pub fn sweep(&self, part: usize) -> Run {
        let mut plant = Plant::new(&self.part(part), &[], self.seed, 0, 0.1, 1.0 / RATE_HZ);
        open_loop(&excitation::sweep(1.0 / RATE_HZ), &mut plant, RATE_HZ)
    }

    /// The recordings of all valves, `length_s` each, in order.
    pub fn recordings(&self, length_s: f64) -> impl ParallelIterator<Item = (&FleetValve, Run)> {
        self.valves.par_iter().map(move |valve| {
            let rng = &mut stream(valve.seed, 61);
            let wanted = excitation::drive(Drive::Mixed, rng, length_s, 1.0 / RATE_HZ);
            // no two valves of a type are quite alike
            let specimen = self.part(valve.part);
            let scatter = Concealed { id: "reference_shift", variant: 0, severity: uniform(rng, 0.0, 0.15) };
            let effects: Vec<Concealed> = std::iter::once(scatter).chain(valve.effects.iter().cloned()).collect();
            let mut plant = Plant::new(&specimen, &effects, valve.seed, 1, wanted[0], 1.0 / RATE_HZ);
            (valve, open_loop(&wanted, &mut plant, RATE_HZ))
        })
    }
}

/// Whether a finding tells the story: the lot, the effect (or a set that holds it), and the onset within a tenth of the range.
pub fn tells(fleet: &Fleet, column: &str, group: &str, whats: &[&str], onset_km: Option<f64>) -> [bool; 3] {
    let (lot, effect, from_km) = &fleet.story;
    let right_lot = column == "lot" && group == lot;
    [right_lot, right_lot && whats.contains(effect), right_lot && onset_km.is_some_and(|at| (at - from_km).abs() <= 0.1 * RANGE_KM)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_bad_lot_beyond_its_onset_has_the_effect_in_number() {
        let fleet = draw_fleet(5, 300);
        let (lot, effect, onset) = fleet.story.clone();
        let has = |v: &&FleetValve| v.effects.iter().any(|e| e.id == effect);
        let bad: Vec<&FleetValve> = fleet.valves.iter().filter(|v| v.lot == lot).collect();
        assert_eq!(bad.len(), 15);
        assert!(bad.iter().filter(|v| v.mileage_km > onset).all(has));
        assert!(fleet.valves.iter().filter(|v| v.lot != lot).filter(has).count() < 12);
        assert_eq!(draw_fleet(5, 300), fleet);
    }

    #[test]
    fn the_story_is_told_by_lot_effect_and_onset() {
        let fleet = draw_fleet(5, 30);
        let (lot, effect, onset) = fleet.story.clone();
        assert_eq!(tells(&fleet, "lot", &lot, &["creep", effect], Some(onset + 15_000.0)), [true, true, true]);
        assert_eq!(tells(&fleet, "lot", &lot, &["creep"], Some(onset + 25_000.0)), [true, false, false]);
        assert_eq!(tells(&fleet, "supplier", &lot, &[effect], None), [false, false, false]);
    }

    #[test]
    fn recordings_differ_from_valve_to_valve() {
        let fleet = draw_fleet(5, 4);
        let runs: Vec<(&FleetValve, Run)> = fleet.recordings(5.0).collect();
        assert!(runs.len() == 4 && runs[0].1.pressure_bar != runs[1].1.pressure_bar);
    }
}
