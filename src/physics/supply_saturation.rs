//! # Supply saturation
//!
//! What it is: the supply cannot deliver the pressure that the current asks for.
//!
//! Model: P = min(P0, limit), rounded over `softness`: P = limit - s ln(1 + exp((limit - P0)/s)); the limit holds
//! from `from` to `until`.
//!
//! Signature: one-sided clipping at high current; a sag only while the pressure is high.
//!
//! What to check on the bench: supply pressure during the run, pump speed, relief valve.
//!
//! Source: Merritt, Hydraulic Control Systems, Wiley 1967, chapter 7 (hydraulic power elements).

use super::effect::{Block, Context, Effect, Parameter, Stage, Theta};
use crate::units::{PRESSURE, TIME};

/// The effect `supply_saturation`.
pub struct SupplySaturation;

impl Effect for SupplySaturation {
    fn id(&self) -> &'static str {
        "supply_saturation"
    }
    fn source_text(&self) -> &'static str {
        include_str!("supply_saturation.rs")
    }
    fn stage(&self) -> Stage {
        Stage::Supply
    }
    fn parameters(&self) -> &'static [Parameter] {
        static PARAMETERS: [Parameter; 4] = [
            Parameter {
                name: "limit",
                unit: &PRESSURE,
                range: (1.0, 400.0),
                starts: &[12.0, 16.0, 20.0, 24.0, 28.0],
                default: None,
                meaning: "pressure that the supply can deliver",
            },
            Parameter {
                name: "softness",
                unit: &PRESSURE,
                range: (0.005, 3.0),
                starts: &[0.05],
                default: Some(0.005),
                meaning: "pressure over which the clipping sets in",
            },
            Parameter {
                name: "from",
                unit: &TIME,
                range: (0.0, 1e6),
                starts: &[0.0],
                default: Some(0.0),
                meaning: "begin of the limit since the start of the recording",
            },
            Parameter { name: "until", unit: &TIME, range: (0.0, 1e6), starts: &[1e6], default: Some(1e6), meaning: "end of the limit" },
        ];
        &PARAMETERS
    }
    fn block(&self, theta: Theta<'_>, context: &Context) -> Box<dyn Block> {
        Box::new(Supply {
            limit: theta[0],
            softness: theta[1],
            from_s: theta[2],
            until_s: theta[3],
            time_s: context.start_s,
            dt_s: context.dt_s,
        })
    }
}

struct Supply {
    limit: f64,
    softness: f64,
    from_s: f64,
    until_s: f64,
    time_s: f64,
    dt_s: f64,
}

impl Block for Supply {
    fn start(&mut self, _: f64, _: f64) {}
    #[inline]
    fn step(&mut self, _: f64, input: f64) -> f64 {
        let now = self.time_s;
        self.time_s += self.dt_s;
        let room = (self.limit - input) / self.softness;
        if room > 36.0 || now < self.from_s || now >= self.until_s {
            return input;
        }
        let rounded = if room < -36.0 { 0.0 } else { room.exp().ln_1p() };
        self.limit - self.softness * rounded
    }
}
