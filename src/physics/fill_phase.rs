//! # Fill phase
//!
//! What it is: an empty clutch must be filled before its pressure can rise above that of the return spring.
//!
//! Model: while the piston moves (0 < x < 1) the pressure is plateau + spring x (or less, where less is asked for);
//! it moves with x' = sgn(d) (|d| / 1 bar)^(1/2) / time, d = P0 - pressure, and falls back likewise when P0 is
//! below the plateau: there the pressure is P0 + hold (plateau + spring x - P0), as the return spring pushes the oil
//! out. The drag of the piston adds to the plateau on the way in and takes from it on the way out; between the two the
//! piston stands. With the clutch full the pressure is P0. A run begins with the clutch empty.
//!
//! Signature: only from empty: a rise, a plateau at the kiss point, then a fast rise.
//!
//! What to check on the bench: a step from tank pressure with the clutch vented; fill volume and flow.
//!
//! Source: US patent 7,574,906 (fill volume); Merritt, Hydraulic Control Systems, Wiley 1967, section 3.3 (orifice).

use super::block::{Block, Dynamic, Point, Step};
use super::effect::{Context, Effect, Hint, Parameter, Stage, Theta};
use crate::units::{PRESSURE, RATIO, TIME};

/// The effect `fill_phase`.
pub struct FillPhase;

impl Effect for FillPhase {
    fn id(&self) -> &'static str {
        "fill_phase"
    }
    fn source_text(&self) -> &'static str {
        include_str!("fill_phase.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Chamber
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 6] = [
            Parameter {
                name: "plateau",
                unit: &PRESSURE,
                range: (0.2, 20.0),
                starts: &[1.5, 3.0, 4.5],
                default: None,
                meaning: "pressure at which the piston moves",
            },
            Parameter {
                name: "time",
                unit: &TIME,
                range: (0.005, 10.0),
                starts: &[0.2, 0.8],
                default: None,
                meaning: "fill time at an excess of 1 bar",
            },
            Parameter {
                name: "spring",
                unit: &PRESSURE,
                range: (0.0, 5.0),
                starts: &[0.2],
                default: Some(0.0),
                meaning: "rise of the pressure over the stroke",
            },
            Parameter {
                name: "drain",
                unit: &RATIO,
                range: (0.02, 20.0),
                starts: &[1.0],
                default: Some(1.0),
                meaning: "speed of draining over that of filling",
            },
            Parameter {
                name: "hold",
                unit: &RATIO,
                range: (0.0, 1.0),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "share of the return spring's pressure that shows while the clutch drains",
            },
            Parameter {
                name: "drag",
                unit: &PRESSURE,
                range: (0.0, 5.0),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "pressure that the friction of the piston's seals takes, either way",
            },
        ];
        &PARAMETERS
    }
    /// The longest stretch in which the pressure stays low while more is asked for: where it stands, and the time after which the
    /// piston has reached its end.
    fn propose(&self, hint: &Hint<'_>) -> Vec<Vec<f64>> {
        let standing = |k: usize| hint.residual_bar[k] < -BEYOND * hint.scale_bar;
        let mut stretches: Vec<(usize, usize)> = Vec::new();
        for k in (0..hint.residual_bar.len()).filter(|k| standing(*k)) {
            match stretches.last_mut() {
                Some(last) if k <= last.1 + 2 => last.1 = k + 1,
                _ => stretches.push((k, k + 1)),
            }
        }
        let of = |(from, to): &(usize, usize)| {
            let mut levels: Vec<f64> =
                (*from..*to).map(|k| hint.pressure_bar[k] + hint.residual_bar[k]).filter(|p| p.is_finite()).collect();
            let middle = levels.len() / 2;
            let plateau = *levels.select_nth_unstable_by(middle, f64::total_cmp).1;
            let time_s: f64 = (*from..*to).map(|k| (hint.pressure_bar[k] - plateau).max(0.0).sqrt() * hint.dt_s).sum();
            (plateau, time_s)
        };
        stretches.sort_by_key(|(from, to)| std::cmp::Reverse(to - from));
        let found = stretches.iter().take(2).map(of);
        let likely = found.filter(|(plateau, time_s)| (0.2..=20.0).contains(plateau) && (0.005..=10.0).contains(time_s));
        likely.flat_map(|(plateau, time_s)| tried(plateau, time_s)).collect()
    }
    fn shortest_s(&self, theta: Theta<'_>) -> f64 {
        // An excess of some 25 bar fills five times as fast as one of 1 bar.
        0.2 * theta[1]
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        Block::dynamic(Fill {
            plateau: theta[0],
            rate: context.dt_s / theta[1],
            spring: theta[2],
            drain: theta[3],
            hold: theta[4],
            drag: theta[5],
            left: context.arrival.left(),
            stroke: 0.0,
        })
    }
}

/// A pressure so many times the scale of the residual below the simulated one is held down.
const BEYOND: f64 = 3.0;
/// Speeds of draining and drags of the piston [bar] that are tried.
const DRAINS: [f64; 3] = [0.3, 1.0, 4.0];
const DRAGS_BAR: [f64; 2] = [0.0, 0.2];

/// Starts of a fit about this plateau [bar] and this time [s].
fn tried(plateau: f64, time_s: f64) -> impl Iterator<Item = Vec<f64>> {
    DRAGS_BAR.into_iter().flat_map(move |drag| DRAINS.map(|drain| vec![plateau, time_s, 0.2, drain, 0.0, drag]))
}

/// Input that changes by more than this within a step is taken in parts [bar].
const RESOLUTION_BAR: f64 = 0.2;

struct Fill {
    plateau: f64,
    /// Stroke per step at 1 bar.
    rate: f64,
    spring: f64,
    drain: f64,
    hold: f64,
    drag: f64,
    left: f64,
    stroke: f64,
}

impl Fill {
    /// Pressure of the return spring at this stroke [bar].
    fn against(&self, stroke: f64) -> f64 {
        self.plateau + self.spring * stroke
    }

    /// The pressure that shows while `input` is asked for.
    fn shown(&self, input: f64, stroke: f64) -> f64 {
        let inside = self.against(stroke);
        if input >= inside + self.drag {
            if stroke >= 1.0 { input } else { inside + self.drag }
        } else if input <= inside - self.drag && stroke > 0.0 {
            input + self.hold * (inside - self.drag - input)
        } else {
            input
        }
    }

    /// The piston moves for `share` of a step while the input stands; returns the integral of the pressure.
    fn move_for(&mut self, input: f64, share: f64) -> f64 {
        let alone = input - self.against(self.stroke);
        // Friction takes its part of what drives the piston, and holds it where no more is there.
        let excess = if alone > 0.0 { (alone - self.drag).max(0.0) } else { (alone + self.drag).min(0.0) };
        let (speed, end) = if excess >= 0.0 { (self.rate, 1.0) } else { (self.rate * self.drain, 0.0) };
        if self.stroke == end || excess == 0.0 {
            return share * self.shown(input, self.stroke);
        }
        // The root of the excess falls at a constant pace, as the spring takes it up on the way.
        let (root, pace) = (excess.abs().sqrt(), 0.5 * self.spring * speed);
        let travel =
            |time: f64| if pace > 1e-12 { ((2.0 * root - pace * time) * time * speed).max(0.0) * 0.5 } else { root * speed * time };
        let stops = if pace > 1e-12 { root / pace } else { f64::INFINITY };
        let way = (end - self.stroke).abs();
        let direction = if end > 0.5 { 1.0 } else { -1.0 };
        // 2 way = (2 root - pace t) t speed, solved for the time at which the end of the stroke is reached.
        let left = root * root - 2.0 * pace * way / speed;
        let arrives = if left < 0.0 { f64::INFINITY } else { 2.0 * way / speed / (root + left.sqrt()) };
        let time = share.min(stops).min(arrives);
        let before = self.stroke;
        self.stroke = if time == arrives { end } else { (before + direction * travel(time)).clamp(0.0, 1.0) };
        let middle = (before + direction * travel(0.5 * time)).clamp(1e-12, 1.0 - 1e-12);
        time * self.shown(input, middle) + (share - time) * self.shown(input, self.stroke)
    }
}

impl Dynamic for Fill {
    fn start(&mut self, _: &Point, _: f64) {
        self.stroke = 0.0;
    }
    #[inline]
    fn step(&mut self, _: &Point, from: f64, input: Step) -> Step {
        let full = self.plateau + self.spring;
        if self.stroke >= 1.0 && from >= full && input.to >= full && input.mean >= full {
            return input;
        }
        let mut mean = 0.0;
        input.pieces(from, self.left, RESOLUTION_BAR, |share, a, b| mean += self.move_for(0.5 * (a + b), share));
        Step { to: self.shown(input.to, self.stroke), mean, jump: 0.0 }
    }
}
