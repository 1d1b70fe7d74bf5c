//! The effects about a model that is not ours: what acts ahead of it, on its command, and what acts behind it, on its
//! pressure. Its own curve, lag and dead time stay its own.

use super::block::{Block, Pointwise};
use super::effect::Stage;
use super::pipeline::{Pipeline, spread};
use super::signal::Signals;

impl Pipeline<'_> {
    /// Whether an effect acts ahead of the curve by more than a dead time, so that the model behind it gets another command.
    pub fn acts_ahead(&self, start_s: f64, dt_s: f64) -> bool {
        let context = self.context(start_s, dt_s, None);
        let early = self.effects.iter().filter(|(e, _)| e.stage() < Stage::Static);
        early.map(|(e, theta)| e.block(theta, &context)).any(|block| matches!(block, Block::Pointwise(_)))
    }

    /// The command as the effects ahead of the curve leave it [A], without any dead time, at each sample.
    pub fn ahead(&self, start_s: f64, dt_s: f64, signals: &Signals<'_>) -> Vec<f64> {
        let parts = self.parts(dt_s);
        let fine = |values: &[f64], input| spread(values, parts, input);
        let mut current_a = fine(signals.current_a, self.input);
        let [oil, supply] = [signals.oil_temp_c, signals.supply_bar].map(|c| c.map(|c| fine(c, crate::valve::Input::Ramp)));
        let around = Signals { current_a: &[], oil_temp_c: oil.as_deref(), supply_bar: supply.as_deref(), ..*signals };
        let context = self.context(start_s, dt_s / parts as f64, None);
        for mut block in self.current_blocks(&context).into_iter().flatten() {
            pass(block.as_mut(), &around, &mut current_a);
        }
        current_a.into_iter().step_by(parts).collect()
    }

    /// The effects behind the curve on a pressure [bar] that comes from elsewhere, in place; `at` holds the current at the curve.
    pub fn behind(&self, start_s: f64, dt_s: f64, at: &Signals<'_>, pressure_bar: &mut [f64]) {
        self.pressure_stages(&self.context(start_s, dt_s, None), at, pressure_bar);
    }
}

fn pass(block: &mut dyn Pointwise, around: &Signals<'_>, current_a: &mut [f64]) {
    let input = current_a.to_vec();
    let Some(first) = input.first() else { return };
    let at = around.with_current(&input);
    block.start(&at.at(0), *first);
    block.run(&at, current_a);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::valve::{Input, Valve};

    /// A valve with effects on both sides is what its effects make of the valve without them.
    #[test]
    fn a_model_with_effects_is_the_model_between_what_acts_ahead_and_what_acts_behind() {
        let paper = include_str!("../../valves/paper.toml");
        let effects = "\n[[effect]]\nreversal_dead_band = { width = \"15 mA\" }\n[[effect]]\nleakage = { loss = \"1 bar\" }\n[[effect]]\nsensor_lag = { tau = \"30 ms\" }\n";
        let current_a: Vec<f64> = (0..3000).map(|k| 0.5 + 0.3 * (f64::from(k) * 0.011).sin()).collect();
        let run = |valve: &Valve, current_a: &[f64]| {
            let mut out = Vec::new();
            let pipeline = Pipeline { input: Input::Held, ..Pipeline::of(valve).unwrap() };
            pipeline.run(0.0, 0.01, &Signals::current(current_a), &mut Vec::new(), &mut out);
            out
        };
        let bare = Valve::from_toml(
            &paper
                .replace("lag = \"10 ms\"", "")
                .replace("delay = \"20 ms\"", "delay = \"0 ms\"")
                .replace("delay_range = [\"10 ms\", \"30 ms\"]", ""),
            "bare",
        )
        .unwrap();
        let full = Valve { effects: Valve::from_toml(&format!("{paper}{effects}"), "full").unwrap().effects, ..bare.clone() };
        let pipeline = Pipeline::of(&full).unwrap();
        assert!(pipeline.acts_ahead(0.0, 0.01) && !Pipeline::of(&bare).unwrap().acts_ahead(0.0, 0.01));
        let ahead = pipeline.ahead(0.0, 0.01, &Signals::current(&current_a));
        let mut pressure = run(&bare, &ahead);
        pipeline.behind(0.0, 0.01, &Signals::current(&ahead), &mut pressure);
        let whole = run(&full, &current_a);
        let worst = pressure.iter().zip(&whole).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-9, "{worst}");
        let moved = run(&bare, &current_a).iter().zip(&whole).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(moved > 0.5, "{moved}");
    }
}
