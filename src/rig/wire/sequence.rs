//! What makes each request unlike the last ones, so that a late reply shows itself.

use crate::rig::OutsideLimits;
use crate::rig::profile::{Profile, SetpointLimit, Signal};

/// Requests that may be unanswered at once, and one more: so many in a row are all different.
const DISTINCT: usize = 4;

/// Tokens, quantities and the last digit of the set-point, each unlike those of the requests before.
#[derive(Debug, Clone, PartialEq)]
pub struct Sequence {
    token: u16,
    recent: [f64; DISTINCT - 1],
}

impl Sequence {
    /// A sequence whose tokens begin at `first`.
    pub fn new(first: u16) -> Self {
        Self { token: first, recent: [f64::NAN; DISTINCT - 1] }
    }

    /// The next token; zero, which fresh registers hold, is left out.
    pub fn token(&mut self) -> u16 {
        self.token = self.token.wrapping_add(1).max(1);
        self.token
    }

    /// Steps by which the quantity grows beyond the block, 0 to 3 in turn.
    pub fn extra(&self) -> u16 {
        self.token % DISTINCT as u16
    }

    /// The set-point in counts, within the limits and, where `alternate`, unlike those of the last three requests.
    pub fn setpoint(&mut self, current_a: f64, signal: &Signal, limit: &SetpointLimit, alternate: bool) -> Result<f64, OutsideLimits> {
        let refused = OutsideLimits { asked_a: current_a, min_a: limit.min_a, max_a: limit.max_a };
        if !(current_a >= limit.min_a && current_a <= limit.max_a) {
            return Err(refused);
        }
        let nearest = signal.to_raw(current_a).ok_or(refused)?;
        let float = signal.kind == crate::rig::profile::RawType::F32;
        let step = if float { 1e-5 / signal.scale.abs() } else { 1.0 };
        // A float nearest to the limit may lie a hair beyond it; its neighbour does not.
        let neighbours =
            if float { [f64::from((nearest as f32).next_down()), f64::from((nearest as f32).next_up())] } else { [nearest; 2] };
        let within = |raw: f64| {
            let value = signal.from_raw(raw);
            // Rounding may carry the nearest count a hair outside; never more than the limit leaves.
            value >= limit.min_a - 1e-12 && value <= limit.max_a + 1e-12 && signal.to_raw(value).is_some()
        };
        let fresh = |raw: f64| !alternate || !self.recent.contains(&raw);
        let around = [1.0, -1.0, 2.0, -2.0, 3.0, -3.0, 4.0, -4.0].map(|n| nearest + n * step);
        let rounded = move |raw: f64| if float { f64::from(raw as f32) } else { raw };
        let raw =
            std::iter::once(nearest).chain(neighbours).chain(around).map(rounded).find(|raw| within(*raw) && fresh(*raw)).ok_or(refused)?;
        self.recent.rotate_right(1);
        self.recent[0] = raw;
        Ok(raw)
    }
}

/// Whether the proof of freshness rests on the set-point itself, because the device gives no token back.
pub fn rests_on_setpoint(profile: &Profile) -> bool {
    use crate::rig::profile::{Freshness, SignalName};
    profile.signal(SignalName::Token).is_none() && profile.cycle.transactions.iter().any(|t| t.freshness == Freshness::Echo)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::profile::SignalName;
    use proptest::prelude::*;

    fn profile() -> Profile {
        Profile::from_toml(include_str!("../../../drivers/emulator.toml"), "emulator.toml").unwrap()
    }

    proptest! {
        #[test]
        fn a_set_point_never_leaves_its_limits_and_never_repeats(currents in proptest::collection::vec(-0.5f64..2.0, 1..60)) {
            let p = profile();
            let (_, signal) = p.signal(SignalName::Setpoint).unwrap();
            let mut sequence = Sequence::new(0);
            let mut sent: Vec<f64> = Vec::new();
            for current_a in currents {
                match sequence.setpoint(current_a, signal, &p.limit, true) {
                    Ok(raw) => {
                        prop_assert!(signal.from_raw(raw) <= p.limit.max_a + 1e-9 && signal.from_raw(raw) >= p.limit.min_a);
                        prop_assert!((signal.from_raw(raw) - current_a).abs() < 0.0005);
                        prop_assert!(!sent.iter().rev().take(3).any(|r| *r == raw));
                        sent.push(raw);
                    }
                    Err(_) => prop_assert!(current_a < p.limit.min_a || current_a > p.limit.max_a),
                }
            }
        }
    }

    #[test]
    fn no_number_is_no_current() {
        let p = profile();
        let (_, signal) = p.signal(SignalName::Setpoint).unwrap();
        for current_a in [f64::NAN, f64::INFINITY, -f64::INFINITY] {
            assert!(Sequence::new(0).setpoint(current_a, signal, &p.limit, false).is_err());
        }
    }

    #[test]
    fn four_requests_in_a_row_differ() {
        let mut s = Sequence::new(u16::MAX - 2);
        let seen: Vec<(u16, u16)> = (0..8).map(|_| (s.token(), s.extra())).collect();
        for window in seen.windows(3) {
            assert!(window[0].0 != window[1].0 && window[1].0 != window[2].0 && window[0].0 != window[2].0);
        }
        assert!(seen.iter().all(|t| t.0 != 0));
    }
}
