//! # Flow limit
//!
//! What it is: the flow through the valve limits how fast the pressure can change.
//!
//! Model: |dy/dt| <= rise going up and <= fall going down. Flow from a supply S and to the tank through orifices falls
//! with the counter-pressure: rise scales with (1 - y / S)^shape, fall with (4 y / S)^shape, S = 1.5 times the pressures
//! that the curves span. A shape of 0 is a constant limit (a pump), 1/2 orifices, 1 laminar restrictors. A metering edge
//! opens in proportion to what is missing: within `band` of the target the rate falls with the distance.
//!
//! Signature: large steps become ramps of one slope; small movements are untouched, or within the band all alike slow.
//!
//! What to check on the bench: steps of several sizes; pump flow, filters, line diameter.
//!
//! Source: Merritt, Hydraulic Control Systems, Wiley 1967, section 3.3 (orifice flow into a volume) and 5.2 (a metering
//! edge, linear in its opening until it is open).

use super::block::{Block, Dynamic};
use super::effect::{Context, Effect, Parameter, Stage, Theta};
use super::flow::{RESOLUTION_BAR, along_line};
use super::power::Power;
use super::signal::{Point, Step};
use crate::units::{PRESSURE, PRESSURE_RATE, RATIO};

/// The effect `flow_limit`.
pub struct FlowLimit;

impl Effect for FlowLimit {
    fn id(&self) -> &'static str {
        "flow_limit"
    }
    fn source_text(&self) -> &'static str {
        include_str!("flow_limit.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Chamber
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 4] = [
            Parameter {
                name: "rise",
                unit: &PRESSURE_RATE,
                range: (1.0, 5000.0),
                starts: &[40.0, 100.0, 250.0],
                default: None,
                meaning: "fastest rise",
            },
            Parameter {
                name: "fall",
                unit: &PRESSURE_RATE,
                range: (1.0, 5000.0),
                starts: &[40.0, 100.0, 250.0],
                default: None,
                meaning: "fastest fall",
            },
            Parameter {
                name: "shape",
                unit: &RATIO,
                range: (0.0, 1.0),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "dependence of the limits on the counter-pressure",
            },
            Parameter {
                name: "band",
                unit: &PRESSURE,
                range: (0.0, 40.0),
                starts: &[0.0, 3.0],
                default: Some(0.0),
                meaning: "distance from the target within which the flow is in proportion to it",
            },
        ];
        &PARAMETERS
    }
    fn shortest_s(&self, theta: Theta<'_>) -> f64 {
        // When the limited pressure meets its target must be known to a part of a bar.
        0.7 / theta[0].max(theta[1])
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Block {
        let supply_bar = 1.5 * context.curves.span_bar();
        let shape = theta[2];
        let free = theta[0].min(theta[1]) * context.dt_s * if shape > 0.0 { LEAST_SHARE.powf(shape) } else { 1.0 };
        Block::dynamic(Limit {
            rise: theta[0] * context.dt_s,
            fall: theta[1] * context.dt_s,
            shape: (shape > 0.0).then(|| (shape, Power::new(shape))),
            supply_bar,
            band: theta[3],
            free,
            left: context.arrival.left(),
            output: 0.0,
        })
    }
}

/// Least share of the supply's pressure that still drives: a flow never ends before its target is reached.
const LEAST_SHARE: f64 = 0.02;
/// Parts of a step in which the limited pressure may catch up with its target,
const PARTS: f64 = 16.0;
/// none of them smaller than this: the pressure is off by less where it catches up within it [bar].
const LEAST_PART_BAR: f64 = 0.01;

/// Share of what drives that a time may take away for its rate to be taken half-way, which is exact to a thousandth then.
const SHORT: f64 = 0.08;

struct Limit {
    /// Fastest rise and fall [bar per step].
    rise: f64,
    fall: f64,
    /// `None` of a constant limit.
    shape: Option<(f64, Power)>,
    supply_bar: f64,
    /// Within this distance the rate falls with it [bar].
    band: f64,
    /// A change per step at which neither limit binds at any pressure [bar].
    free: f64,
    left: f64,
    output: f64,
}

impl Limit {
    /// The limit towards a pressure [bar per step], the share of the supply that drives there from here, and its change per bar: it
    /// falls while the pressure rises, and with it when it falls.
    #[inline]
    fn driven(&self, up: bool, output: f64) -> (f64, f64, f64) {
        if up {
            (self.rise, -1.0 / self.supply_bar, 1.0 - output / self.supply_bar)
        } else {
            (self.fall, 4.0 / self.supply_bar, 4.0 * output / self.supply_bar)
        }
    }

    /// The limit upwards or downwards from a pressure [bar per step].
    #[inline]
    fn limit(&self, up: bool, output: f64) -> f64 {
        let (rate, _, drive) = self.driven(up, output);
        rate * self.shape.as_ref().map_or(1.0, |(_, power)| power.of(drive.max(LEAST_SHARE)))
    }

    /// From `output` behind an input on a straight line from `a` to `b` in `share` of a step, and the integral over it: at the limit until
    /// the band, as a lag within it, and without one along with the input.
    #[inline]
    fn after(&self, mut a: f64, b: f64, output: f64, share: f64) -> (f64, f64) {
        let (mut output, mut sum, mut rest) = (output, 0.0, share);
        if (b - output).abs() > self.band {
            let edge = b - self.band.copysign(b - output);
            let (end, integral, time) = self.towards(edge, output, share);
            rest = share - time;
            a += (b - a) * time / share;
            (output, sum) = (end, integral - rest * end);
        }
        if rest <= 0.0 {
            return (output, sum);
        }
        if self.band == 0.0 {
            return (b, sum + 0.5 * rest * (a + b));
        }
        let (end, mean) = along_line(output, rest * self.limit(b > output, output) / self.band, a, b);
        (end, sum + rest * mean)
    }

    /// How much a step may change in one part [bar]: within the band it is a lag all along, and far from the target the limit all along;
    /// in between it matters when the band is reached.
    #[inline]
    fn resolution_bar(&self, from: f64, input: Step, change: f64, bow: f64) -> f64 {
        let (before, after) = (from - self.output, input.to - self.output);
        // A parabola goes so far beyond its ends at most.
        let beyond = 1.5 * bow;
        if before.abs().max(after.abs()) + beyond <= self.band {
            return RESOLUTION_BAR;
        }
        let stays = |limit: f64| before.abs().min(after.abs()) - beyond > self.band + limit;
        // The limit falls on the way.
        if input.jump == 0.0 && (before > 0.0) == (after > 0.0) && stays(self.limit(after > 0.0, self.output)) {
            return f64::INFINITY;
        }
        (change.max(input.jump.abs()).max(bow) / PARTS).max(self.free).max(LEAST_PART_BAR)
    }

    /// From `output` as far towards `target` as the limits let it in `share` of a step, the integral over it, and how long it moved.
    #[inline]
    fn towards(&self, target: f64, output: f64, share: f64) -> (f64, f64, f64) {
        let up = target > output;
        let (rate, per_bar, drive) = self.driven(up, output);
        let way = (target - output).abs();
        let direction = if up { 1.0 } else { -1.0 };
        let (reach, needed) = match &self.shape {
            None => (rate * share, way / rate),
            Some((shape, power)) => {
                let slope = per_bar.abs();
                let drives = Drives { shape: *shape, drive, pace: rate * slope };
                let (lost, needed) = drives.short(power, share, way * slope).unwrap_or_else(|| drives.long(share, way * slope));
                (lost / slope, needed)
            }
        };
        if reach >= way || needed <= share {
            let time = needed.min(share);
            return (target, 0.5 * time * (output + target) + (share - time) * target, time);
        }
        let end = output + direction * reach;
        (end, 0.5 * share * (output + end), share)
    }
}

/// The share of the supply's pressure that drives, w' = -pace max(w, least)^shape.
struct Drives {
    shape: f64,
    drive: f64,
    pace: f64,
}

impl Drives {
    /// A primitive of w^-shape: it falls at a constant pace.
    fn primitive(&self, w: f64) -> f64 {
        if self.shape > 0.999 { w.ln() } else { w.powf(1.0 - self.shape) / (1.0 - self.shape) }
    }
    fn inverse(&self, primitive: f64) -> f64 {
        if self.shape > 0.999 { primitive.exp() } else { (primitive * (1.0 - self.shape)).max(0.0).powf(1.0 / (1.0 - self.shape)) }
    }
    /// What is lost after a time, and the time after which so much is lost, infinity where that takes longer: with the rate half-way,
    /// where it hardly changes.
    #[inline]
    fn short(&self, power: &Power, time: f64, lost: f64) -> Option<(f64, f64)> {
        // The rate falls on the way.
        let most = self.pace * time * power.of(self.drive.max(LEAST_SHARE));
        if self.drive - most < LEAST_SHARE || most > SHORT * self.drive {
            return None;
        }
        let rate_at = |gone: f64| self.pace * power.of(self.drive - gone);
        let needed = if lost > most { f64::INFINITY } else { lost / rate_at(0.5 * lost) };
        let lost = if needed <= time { lost } else { (time * rate_at(0.5 * most)).min(lost) };
        Some((lost, needed))
    }
    /// The same exactly.
    fn long(&self, time: f64, lost: f64) -> (f64, f64) {
        (self.lost(time), self.time(lost))
    }
    /// How much of it is lost after a time.
    fn lost(&self, time: f64) -> f64 {
        let slow = self.pace * LEAST_SHARE.powf(self.shape);
        if self.drive <= LEAST_SHARE {
            return slow * time;
        }
        let least = (self.primitive(self.drive) - self.primitive(LEAST_SHARE)) / self.pace;
        if time >= least {
            return self.drive - LEAST_SHARE + slow * (time - least);
        }
        self.drive - self.inverse(self.primitive(self.drive) - self.pace * time)
    }
    /// The time after which so much of it is lost.
    fn time(&self, lost: f64) -> f64 {
        let slow = self.pace * LEAST_SHARE.powf(self.shape);
        let above = (self.drive - LEAST_SHARE).clamp(0.0, lost);
        let fast = if above > 0.0 { (self.primitive(self.drive) - self.primitive(self.drive - above)) / self.pace } else { 0.0 };
        fast + (lost - above) / slow
    }
}

impl Dynamic for Limit {
    fn start(&mut self, _: &Point, input: f64) {
        self.output = input;
    }
    #[inline]
    fn step(&mut self, _: &Point, from: f64, input: Step) -> Step {
        let change = (input.to - from).abs();
        let bow = (input.mean - 0.5 * (from + input.to)).abs();
        if self.band == 0.0 && input.jump == 0.0 && self.output == from && change + 6.0 * bow <= self.free {
            self.output = input.to;
            return input;
        }
        let mut mean = 0.0;
        input.pieces(from, self.left, self.resolution_bar(from, input, change, bow), |share, a, b| {
            let (output, sum) = self.after(a, b, self.output, share);
            self.output = output;
            mean += sum;
        });
        Step { to: self.output, mean, jump: 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_way_with_the_rate_half_way_is_the_exact_one() {
        for shape in [0.1, 0.5, 0.8, 1.0] {
            let power = Power::new(shape);
            for (drive, pace) in [(0.1, 0.02), (0.5, 0.03), (1.0, 0.06), (3.0, 0.01)] {
                let drives = Drives { shape, drive, pace };
                let way = 0.7 * pace * f64::powf(drive, shape);
                for (time, lost) in [(1.0, 10.0), (1.0, way), (0.4, 0.1 * way)] {
                    let (Some(short), long) = (drives.short(&power, time, lost), drives.long(time, lost)) else { continue };
                    let is_near = |a: f64, b: f64| (a - b).abs() < 1e-3 * b;
                    assert!(is_near(short.0, long.0.min(lost)), "{shape} {drive}: {short:?} for {long:?}");
                    assert!(short.1 > time && long.1 > time || is_near(short.1, long.1), "{shape} {drive}: {short:?} for {long:?}");
                }
            }
            assert!(Drives { shape, drive: 0.5, pace: 0.5 }.short(&power, 1.0, 0.1).is_none(), "too far for it");
        }
    }
}
