//! The path between the curves, whatever its form: over a whole current, sample by sample, and inverted.

use super::{FreeState, HyperbolaState, Hysteresis, InverseState, ReferenceCurves, hyperbola_stretches};

impl Hysteresis {
    /// Pressure [bar] for each current [A]. `start_share` is where the valve stands at first: 0 on the ascending curve,
    /// 1/2 on the average, 1 on the descending.
    pub fn run(&self, curves: &ReferenceCurves, start_share: f64, current_a: &[f64], pressure_bar: &mut [f64]) {
        let Some(first) = current_a.first() else { return };
        match self {
            Self::None => {
                for (i, p) in current_a.iter().zip(pressure_bar) {
                    *p = curves.average_at(*i);
                }
            }
            Self::Hyperbolic { a_bar2 } => {
                hyperbola_stretches(curves, *a_bar2, between(curves, *first, start_share), current_a, pressure_bar);
            }
            Self::Free(stack) => stack.run(curves, 2.0 * start_share - 1.0, current_a, pressure_bar),
        }
    }

    /// The state at a current, on the average curve.
    pub fn start(&self, curves: &ReferenceCurves, current_a: f64) -> HysteresisState {
        match self {
            Self::None => HysteresisState::None { pressure_bar: curves.average_at(current_a) },
            Self::Hyperbolic { a_bar2 } => {
                HysteresisState::Hyperbolic(HyperbolaState::start(*a_bar2, current_a, curves.average_at(current_a)))
            }
            Self::Free(stack) => HysteresisState::Free(FreeState::start(*stack, curves, current_a, 0.0)),
        }
    }

    /// The inverse model, its memory at a current and the pressure that the average curve gives there; `None` without
    /// hysteresis, where there is no memory.
    pub fn inverse(&self, curves: &ReferenceCurves, current_a: f64) -> Option<HysteresisInverse> {
        match self {
            Self::None => None,
            Self::Hyperbolic { a_bar2 } => {
                Some(HysteresisInverse::Hyperbolic(InverseState::start(*a_bar2, current_a, curves.average_at(current_a))))
            }
            Self::Free(stack) => Some(HysteresisInverse::Free(FreeState::start(*stack, curves, current_a, 0.0))),
        }
    }

    /// The name of the form, as it stands in a valve file.
    pub fn name(&self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Hyperbolic { .. } => "hyperbolic",
            Self::Free(_) => "free",
        }
    }

    /// Parameter `a` [bar^2] where the form is the hyperbola.
    pub fn a_bar2(&self) -> Option<f64> {
        match self {
            Self::Hyperbolic { a_bar2 } => Some(*a_bar2),
            Self::None | Self::Free(_) => None,
        }
    }
}

/// Pressure between the curves at a current: share 0 on the ascending, 1 on the descending one [bar].
fn between(curves: &ReferenceCurves, current_a: f64, share: f64) -> f64 {
    let (low, high) = (curves.ascending_at(current_a), curves.descending_at(current_a));
    low + share * (high - low)
}

/// A hysteresis at one instant: current in, pressure out.
#[derive(Debug, Clone, PartialEq)]
pub enum HysteresisState {
    /// No memory.
    None {
        /// The present pressure [bar].
        pressure_bar: f64,
    },
    /// The hyperbola.
    Hyperbolic(HyperbolaState),
    /// The stack of plays.
    Free(FreeState),
}

impl HysteresisState {
    /// The pressure after the current has moved monotonically to `current_a` [bar].
    #[inline]
    pub fn advance(&mut self, curves: &ReferenceCurves, current_a: f64) -> f64 {
        match self {
            Self::None { pressure_bar } => {
                *pressure_bar = curves.average_at(current_a);
                *pressure_bar
            }
            Self::Hyperbolic(state) => state.advance(curves, current_a),
            Self::Free(state) => state.advance(curves, current_a),
        }
    }

    /// The present pressure [bar].
    pub fn pressure_bar(&self) -> f64 {
        match self {
            Self::None { pressure_bar } => *pressure_bar,
            Self::Hyperbolic(state) => state.pressure_bar(),
            Self::Free(state) => state.pressure_bar(),
        }
    }
}

/// The inverse of a hysteresis at one instant: pressure wanted in, current out.
#[derive(Debug, Clone, PartialEq)]
pub enum HysteresisInverse {
    /// Of the hyperbola, Eq. (11).
    Hyperbolic(InverseState),
    /// Of the stack of plays.
    Free(FreeState),
}

impl HysteresisInverse {
    /// The current that moves the model's pressure to `pressure_bar` [A].
    pub fn current_for(&mut self, curves: &ReferenceCurves, pressure_bar: f64) -> f64 {
        match self {
            Self::Hyperbolic(state) => state.current_for(curves, pressure_bar),
            Self::Free(state) => state.current_for(curves, pressure_bar),
        }
    }

    /// Takes over what the valve really did: the model moves on from there.
    pub fn follow(&mut self, curves: &ReferenceCurves, current_a: f64) {
        match self {
            Self::Hyperbolic(state) => state.follow(curves, current_a),
            Self::Free(state) => {
                state.advance(curves, current_a);
            }
        }
    }

    /// The static pressure at which the memory stands [bar].
    pub fn pressure_bar(&self) -> f64 {
        match self {
            Self::Hyperbolic(state) => state.pressure_bar(),
            Self::Free(state) => state.pressure_bar(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::FreeLoop;
    use super::super::curves::tests::paper;
    use super::*;

    #[test]
    fn the_whole_the_stepwise_and_the_inverse_agree_for_every_form() {
        let c = paper();
        let path: Vec<f64> = (0..400).map(|k| 0.5 + 0.3 * (f64::from(k) * 0.05).sin() + 0.1 * (f64::from(k) * 0.31).sin()).collect();
        let free = FreeLoop::new([(0.0, 0.3), (1.0, 0.4), (2.0, 0.3)]).unwrap();
        let forms = [Hysteresis::None, Hysteresis::Hyperbolic { a_bar2: 0.5 }, Hysteresis::Free(free)];
        assert_eq!(forms.map(|f| f.a_bar2()), [None, Some(0.5), None]);
        assert_eq!(forms.map(|f| f.name()), ["none", "hyperbolic", "free"]);
        for form in forms {
            let mut whole = vec![0.0; path.len()];
            form.run(&c, 0.5, &path, &mut whole);
            let mut state = form.start(&c, path[0]);
            let mut inverse = form.inverse(&c, path[0]);
            assert_eq!(inverse.is_some(), form != Hysteresis::None);
            for (i, p) in path.iter().zip(&whole) {
                assert!((state.advance(&c, *i) - p).abs() < 1e-9 && (state.pressure_bar() - p).abs() < 1e-9, "{}", form.name());
                if let Some(inverse) = &mut inverse {
                    assert!((inverse.current_for(&c, *p) - i).abs() < 1e-6 && (inverse.pressure_bar() - p).abs() < 1e-9, "{}", form.name());
                }
            }
            if let Some(inverse) = &mut inverse {
                inverse.follow(&c, 0.9);
                assert!((inverse.pressure_bar() - state.advance(&c, 0.9)).abs() < 1e-6, "{}", form.name());
            }
        }
    }
}
