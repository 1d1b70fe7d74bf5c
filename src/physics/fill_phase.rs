//! # Fill phase
//!
//! What it is: an empty clutch must be filled before its pressure can rise above that of the return spring.
//!
//! Model: while the piston moves (0 < x < 1) with the speed u / time, the pressure is p = plateau + spring x + viscous u (or less,
//! where less is asked for), and u = sgn(d) (|d| / 1 bar)^(1/2), d = P0 - p: an orifice in line with a piston that the oil
//! resists. It falls back likewise when P0 is below the plateau: there the pressure is P0 + hold (p - P0), as the return spring presses
//! the oil out. The drag of the piston adds to the plateau on the way in and takes from it on the way out; between the two the
//! piston stands. With the clutch full the pressure is P0. A run begins with the clutch full
//! where the pressure that was read at first is nearer to P0 than to what an empty clutch would show, by more than half
//! the loop there, which nobody knows P0 better than by; otherwise with it empty.
//!
//! Signature: only from empty: a rise, a plateau at the kiss point, then a fast rise.
//!
//! What to check on the bench: a step from tank pressure with the clutch vented; fill volume and flow.
//!
//! Source: US patent 7,574,906 (fill volume); Merritt, Hydraulic Control Systems, Wiley 1967, section 3.3 (orifice).

use super::block::{Block, Dynamic};
use super::effect::{Context, Effect, Hint, Parameter, Stage, Theta};
use super::signal::{Point, Step};
use crate::units::{PRESSURE, RATIO, TIME};
use crate::valve::ReferenceCurves;

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
        static PARAMETERS: [Parameter; 7] = [
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
            Parameter {
                name: "viscous",
                unit: &PRESSURE,
                range: (0.0, 30.0),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "pressure that the oil about the piston takes, either way, at the speed that an excess of 1 bar alone would give",
            },
        ];
        &PARAMETERS
    }
    /// The longest stretches in which the pressure stays low while more is asked for: where it stands, and the time after which the
    /// piston has reached its end. Where it stands the higher the more is asked for, the oil resists the piston.
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
        let resisted = resisted(hint, &stretches).into_iter();
        likely.flat_map(|(plateau, time_s)| tried(plateau, time_s)).chain(resisted).collect()
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
            viscous: theta[6],
            left: context.arrival.left(),
            curves: context.curves.clone(),
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
    DRAGS_BAR.into_iter().flat_map(move |drag| DRAINS.map(|drain| vec![plateau, time_s, 0.2, drain, 0.0, drag, 0.0]))
}

/// A stretch this many times as short as the longest one is no filling.
const SHORTER: usize = 4;

/// The start at which the pressure of these stretches, the longest first, is a plateau and what grows with the root of the excess, by
/// least squares; none where it does not grow.
fn resisted(hint: &Hint<'_>, stretches: &[(usize, usize)]) -> Option<Vec<f64>> {
    let seen = |k: usize| ((-hint.residual_bar[k]).max(0.0).sqrt(), hint.pressure_bar[k] + hint.residual_bar[k]);
    let longest = stretches.first()?;
    let fills = |(from, to): &&(usize, usize)| SHORTER * (to - from) >= longest.1 - longest.0;
    let all = || stretches.iter().filter(fills).flat_map(|(from, to)| *from..*to).map(seen).filter(|(_, p)| p.is_finite());
    let count = all().count() as f64;
    let (root, pressure) = all().fold((0.0, 0.0), |(r, p), (root, pressure)| (r + root / count, p + pressure / count));
    let (square, product) = all().fold((0.0, 0.0), |(s, x), (r, p)| (s + (r - root).powi(2), x + (r - root) * (p - pressure)));
    let viscous = product / square;
    let plateau = pressure - viscous * root;
    let time_s: f64 = (longest.0..longest.1).map(|k| seen(k).0 * hint.dt_s).sum();
    let likely = (0.01..=30.0).contains(&viscous) && (0.2..=20.0).contains(&plateau) && (0.005..=10.0).contains(&time_s);
    likely.then(|| vec![plateau, time_s, 0.2, 1.0, 0.5, 0.0, viscous])
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
    viscous: f64,
    left: f64,
    curves: ReferenceCurves,
    stroke: f64,
}

impl Fill {
    /// Pressure of the return spring at this stroke [bar].
    fn against(&self, stroke: f64) -> f64 {
        self.plateau + self.spring * stroke
    }

    /// What drives the piston: friction takes its part, and holds the piston where no more is there.
    fn driving(&self, input: f64, stroke: f64) -> f64 {
        let alone = input - self.against(stroke);
        if alone > 0.0 { (alone - self.drag).max(0.0) } else { (alone + self.drag).min(0.0) }
    }

    /// The root of the pressure over the orifice where this much drives the piston: u^2 + viscous u = driving.
    fn root(&self, driving: f64) -> f64 {
        let half = 0.5 * self.viscous;
        // As written, so that little driving beside much resistance is not lost in a difference.
        let driving = driving.abs();
        if driving > 0.0 { driving / (half + (half * half + driving).sqrt()) } else { 0.0 }
    }

    /// The pressure that shows while `input` is asked for.
    fn shown(&self, input: f64, stroke: f64) -> f64 {
        let driving = self.driving(input, stroke);
        let over_orifice = self.root(driving).powi(2);
        if driving > 0.0 && stroke < 1.0 {
            input - over_orifice
        } else if driving < 0.0 && stroke > 0.0 {
            input + self.hold * over_orifice
        } else {
            input
        }
    }

    /// The piston moves for `share` of a step while the input stands; returns the integral of the pressure.
    fn move_for(&mut self, input: f64, share: f64) -> f64 {
        let driving = self.driving(input, self.stroke);
        let (speed, end) = if driving >= 0.0 { (self.rate, 1.0) } else { (self.rate * self.drain, 0.0) };
        if self.stroke == end || driving == 0.0 {
            return share * self.shown(input, self.stroke);
        }
        let slows = Slowing { root: self.root(driving), viscous: self.viscous, spring: self.spring, speed };
        let way = (end - self.stroke).abs();
        // It never gets faster.
        let may_arrive = slows.root * speed * share >= way;
        let left = (driving.abs() - self.spring * way).max(0.0);
        let arrives = if may_arrive { slows.arrives(way, self.root(left)) } else { f64::INFINITY };
        let time = share.min(arrives);
        let before = self.stroke;
        let direction = if end > 0.5 { 1.0 } else { -1.0 };
        self.stroke = if time == arrives { end } else { (before + direction * slows.travel(time)).clamp(0.0, 1.0) };
        let middle = (before + direction * slows.travel(0.5 * time)).clamp(1e-12, 1.0 - 1e-12);
        time * self.shown(input, middle) + (share - time) * self.shown(input, self.stroke)
    }
}

/// A spring less stiff than this over a step slows nothing [bar].
const SOFT_BAR: f64 = 1e-9;

/// A piston that the spring slows: with u the root of the pressure over the orifice, x' = speed u and (2 u + viscous) u' = -spring speed u,
/// so that spring x = u0^2 - u^2 + viscous (u0 - u) and spring speed t = 2 (u0 - u) + viscous ln(u0 / u).
struct Slowing {
    root: f64,
    viscous: f64,
    spring: f64,
    speed: f64,
}

impl Slowing {
    /// The time [steps] until it has gone `way`, where the root of the pressure over the orifice is `root_there`; never where that is zero.
    fn arrives(&self, way: f64, root_there: f64) -> f64 {
        if self.spring < SOFT_BAR {
            way / (self.speed * self.root)
        } else if root_there > 0.0 {
            (2.0 * (self.root - root_there) + self.viscous * (self.root / root_there).ln()) / (self.spring * self.speed)
        } else {
            f64::INFINITY
        }
    }

    /// How far it has gone after `time` [steps].
    fn travel(&self, time: f64) -> f64 {
        if self.spring < SOFT_BAR {
            return self.speed * self.root * time;
        }
        let slowed = self.spring * self.speed * time;
        // From below, where Newton's steps on the convex law of the time do not overshoot.
        let mut root = self.root * (1.0 - slowed / (2.0 * self.root + self.viscous));
        if self.viscous > 0.0 {
            if root < 0.5 * self.root {
                root = root.max(self.root * (-slowed / self.viscous).exp());
            }
            for _ in 0..NEWTON_STEPS {
                let beyond = 2.0 * (self.root - root) + self.viscous * (self.root / root).ln() - slowed;
                let step = beyond / (2.0 + self.viscous / root);
                root += step;
                if step.abs() < NEAR * root {
                    break;
                }
            }
        }
        let root = root.max(0.0);
        (self.root - root) * (self.root + root + self.viscous) / self.spring
    }
}

/// Most steps: where all are taken they leave less than a millionth,
const NEWTON_STEPS: usize = 5;
/// and one that moves the root by no more than this share is the last.
const NEAR: f64 = 1e-5;

impl Dynamic for Fill {
    fn start(&mut self, at: &Point, input: f64) {
        let open_bar = 0.5 * (self.curves.descending_at(at.current_a) - self.curves.ascending_at(at.current_a)).abs();
        let is_full = (at.begins_bar - input).abs() + open_bar < (at.begins_bar - self.shown(input, 0.0)).abs();
        self.stroke = if is_full { 1.0 } else { 0.0 };
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_piston_that_spring_and_oil_slow_goes_as_its_law_says() {
        for (driving, viscous, spring) in [(4.0f64, 0.0f64, 2.0f64), (4.0, 2.7, 1.5), (0.3, 9.0, 4.0), (2.0, 1e-6, 0.5), (2.0, 3.0, 0.0)] {
            let fill = piston(viscous, spring);
            let (speed, steps) = (0.7, 20_000);
            let slows = Slowing { root: fill.root(driving), viscous, spring, speed };
            for until in [0.05, 0.4, 1.1] {
                // The same by small steps (midpoint rule).
                let (mut way, dt) = (0.0f64, until / f64::from(steps));
                for _ in 0..steps {
                    let half = way + 0.5 * dt * speed * fill.root((driving - spring * way).max(0.0));
                    way += dt * speed * fill.root((driving - spring * half).max(0.0));
                }
                assert!((slows.travel(until) - way).abs() < 1e-5, "{viscous} {spring}: {} {way}", slows.travel(until));
                let there = fill.root((driving - spring * way).max(0.0));
                if there > 0.05 {
                    assert!((slows.arrives(way, there) - until).abs() < 1e-3, "{viscous} {spring}: {until}");
                }
            }
        }
    }

    #[test]
    fn it_begins_full_or_empty_whichever_the_first_reading_is_nearer_to() {
        for (viscous, input, begins_bar, stroke) in [
            (0.0, 10.0, 9.8, 1.0),
            (0.0, 10.0, 3.2, 0.0),
            (0.0, 10.0, f64::NAN, 0.0),
            // An empty clutch whose oil resists shows more than the plateau.
            (2.7, 10.0, 5.9, 0.0),
            // Half the loop is wider than what parts the two.
            (0.0, 3.6, 3.5, 0.0),
            // Below the plateau it is empty, whatever was read.
            (0.0, 2.0, 2.1, 0.0),
        ] {
            let mut fill = piston(viscous, 0.2);
            fill.start(&Point { begins_bar, ..Point::current(0.5) }, input);
            assert_eq!(fill.stroke, stroke, "{viscous} {input} {begins_bar}");
        }
    }

    #[test]
    fn oil_that_resists_lifts_the_plateau_with_the_root_of_the_excess() {
        let fill = piston(2.5, 0.0);
        for root in [0.5f64, 1.2, 2.0] {
            let shown = 3.0 + 2.5 * root;
            assert!((fill.shown(shown + root * root, 0.5) - shown).abs() < 1e-9);
        }
        // Way out of the clutch: the return spring presses against orifice and oil.
        assert!((fill.shown(0.5, 0.5) - (0.5 + fill.root(2.5).powi(2))).abs() < 1e-9);
        assert_eq!(fill.shown(0.5, 0.0), 0.5);
        assert_eq!(fill.shown(9.0, 1.0), 9.0);
    }

    fn piston(viscous: f64, spring: f64) -> Fill {
        let curves = crate::physics::tests::valve(Vec::new()).curves;
        Fill { plateau: 3.0, rate: 0.1, spring, drain: 1.0, hold: 1.0, drag: 0.0, viscous, left: 0.0, curves, stroke: 0.0 }
    }
}
