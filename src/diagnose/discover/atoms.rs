//! The plain functions of one state of which a formula is made up, before they are refined.

use super::states::Tried;
use crate::physics::{Factor, Shape, StateKind};

/// Waves over the range of a state, [`TAU`] of them to the widest.
const WAVES: [f64; 8] = [2.0, 1.4, 1.0, 0.7, 0.5, 0.35, 0.25, 0.18];
/// Periods of a wave since an event, and times in which one dies out [s].
const PERIODS_S: [f64; 7] = [0.25, 0.4, 0.6, 0.9, 1.4, 2.2, 4.0];
const DECAYS_S: [f64; 4] = [0.15, 0.4, 1.0, 2.5];
/// Where a step or a hill stands in the range, and how wide it is there.
const PLACES: [f64; 7] = [0.08, 0.22, 0.36, 0.5, 0.64, 0.78, 0.92];
const STEP_WIDTHS: [f64; 2] = [0.25, 0.08];
const HILL_WIDTHS: [f64; 2] = [0.2, 0.1];

/// The functions of a state.
pub fn atoms(tried: &Tried) -> Vec<Factor> {
    let (low, high) = tried.seen;
    let wide = high - low;
    let since = tried.is_since();
    let of = |shape: Shape, centre: f64, width: f64| Factor { shape, state: tried.state, centre, width, seen: tried.seen };
    let middle = 0.5 * (low + high);
    let mut all = vec![of(Shape::Line, middle, 0.5 * wide)];
    if tried.state.kind == StateKind::Switch {
        return all;
    }
    all.extend([of(Shape::Square, middle, 0.5 * wide), of(Shape::Cube, middle, 0.5 * wide)]);
    let quarter = std::f64::consts::FRAC_PI_2;
    let waves: Vec<f64> = if since { PERIODS_S.to_vec() } else { WAVES.iter().map(|w| w * wide).collect() };
    for wave in waves {
        let width = wave / std::f64::consts::TAU;
        let from = if since { 0.0 } else { middle };
        all.extend([of(Shape::Sin, from, width), of(Shape::Sin, from - quarter * width, width)]);
    }
    if since {
        all.extend(DECAYS_S.iter().map(|tau| of(Shape::Decay, 0.0, *tau)));
        // Soon after the event, finer than the range is wide.
        all.extend(PERIODS_S.iter().map(|at| of(Shape::Bump, *at, 0.5 * at)));
    }
    for place in PLACES {
        let at = low + place * wide;
        all.extend(STEP_WIDTHS.iter().map(|w| of(Shape::Tanh, at, w * wide)));
        all.extend(HILL_WIDTHS.iter().map(|w| of(Shape::Bump, at, w * wide)));
    }
    all
}

/// What a formula of these states may consist of: single functions, and products of one of each state; of a time since an event
/// also of two.
pub fn products(states: &[&Tried]) -> Vec<Vec<Factor>> {
    let own: Vec<Vec<Factor>> = states.iter().map(|t| atoms(t)).collect();
    let mut all: Vec<Vec<Factor>> = own.iter().flatten().map(|f| vec![*f]).collect();
    let of_two = |a: &[Factor], b: &[Factor]| -> Vec<Vec<Factor>> { a.iter().flat_map(|u| b.iter().map(move |v| vec![*u, *v])).collect() };
    if let [first, second] = own.as_slice() {
        all.extend(of_two(first, second));
    }
    for (tried, own) in states.iter().zip(&own) {
        if tried.is_since() {
            let [waves, ends] = [Shape::Sin, Shape::Tanh].map(|shape| own.iter().filter(|f| f.shape == shape).copied().collect::<Vec<_>>());
            let fading: Vec<Factor> = own.iter().filter(|f| matches!(f.shape, Shape::Decay | Shape::Bump)).copied().collect();
            all.extend(of_two(&waves, &fading));
            all.extend(of_two(&ends, &fading));
        }
    }
    all
}
