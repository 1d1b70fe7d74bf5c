//! `hil tune --page`: what each step of the controller is worth, on valves that are not the model's; docs/control.md is what it prints.
//!
//! The valves are healthy ones of the challenge's plant, which shares no line with the models. Each model is identified by
//! this program from the sweep of its valve. Judged is the pressure in the chamber, without the sensor's noise.

use std::fmt::Write as _;
use std::path::Path;

use rayon::prelude::*;

use super::{CliError, files};
use crate::challenge::Bench;
use crate::control::rules::RULES;
use crate::control::tune::{DISTURBANCE_BAR, Form, TuningTask, left_as, tune, tune_as};
use crate::control::{Addition, ControllerSettings, FeedForwardModel, Gains, Mode, Reference, linear_loop};
use crate::identify::{Options, identify};
use crate::metrics::{Metric, Rmse, Segment, Signals};
use crate::record::Dut;
use crate::recording::Recording;
use crate::rig::{Rig, RigError, RigIdentity, SafeState, Sample};
use crate::runner::{Prepared, RunOptions, run};
use crate::valve::{Input, Valve};

/// Valves of the comparison.
pub const VALVES: u64 = 10;
/// First seed; nothing was tuned on these.
const FIRST_SEED: u64 = 4001;
/// Sensitivity that all gains but the paper's keep over the delay range.
const SENSITIVITY: f64 = 1.4;
/// The plans, with what shortens them.
const PLANS: [(&str, &[(&str, &str)]); 3] = [("tipin", &[]), ("gain-comparison", &[]), ("drive-800s", &[("rounds", "2")])];

/// A controller of the comparison.
struct Contender {
    name: &'static str,
    set: fn(&mut ControllerSettings, &Gained),
}

/// The gains of one valve's model: the paper's, ours, and those of the rules, all but the paper's at one sensitivity.
struct Gained {
    ours: Gains,
    rules: Vec<Gains>,
}

const CONTENDERS: [Contender; 12] = [
    Contender {
        name: "feed-forward alone: curve inverse",
        set: |s, _| (s.mode, s.feed_forward) = (Mode::FeedForward, FeedForwardModel::Hyperbolic),
    },
    Contender {
        name: "feed-forward alone: model inverse",
        set: |s, _| (s.mode, s.feed_forward) = (Mode::FeedForward, FeedForwardModel::Model),
    },
    Contender {
        name: "paper: curve inverse, K_P 1, K_I 5, one degree of freedom",
        set: |s, _| (s.addition, s.reference) = (Addition::Current, Reference::Direct),
    },
    Contender { name: "+ two degrees of freedom: compares with what the model expects", set: |s, _| s.addition = Addition::Current },
    Contender { name: "+ memory of the current really sent", set: |_, _| {} },
    Contender { name: "+ model inverse", set: |s, _| s.feed_forward = FeedForwardModel::Model },
    Contender { name: "+ tuned gains: the whole controller", set: |s, g| (s.feed_forward, s.gains) = (FeedForwardModel::Model, g.ours) },
    Contender { name: "model inverse, SIMC", set: |s, g| (s.feed_forward, s.gains) = (FeedForwardModel::Model, g.rules[0]) },
    Contender { name: "model inverse, AMIGO", set: |s, g| (s.feed_forward, s.gains) = (FeedForwardModel::Model, g.rules[1]) },
    Contender { name: "model inverse, lambda", set: |s, g| (s.feed_forward, s.gains) = (FeedForwardModel::Model, g.rules[2]) },
    Contender { name: "curve inverse, tuned gains", set: |s, g| (s.addition, s.gains) = (Addition::Current, g.ours) },
    Contender { name: "curve inverse, the best rule", set: |s, g| (s.addition, s.gains) = (Addition::Current, g.rules[0]) },
];

/// Figures of one valve: RMSE by contender and plan [bar].
type Figures = Vec<Vec<f64>>;

/// The page.
pub fn page(valves: u64) -> Result<String, CliError> {
    let all: Vec<Figures> = (0..valves).into_par_iter().map(|k| one_valve(FIRST_SEED + k)).collect::<Result<Vec<_>, _>>()?;
    let mean = |contender: usize, plan: usize| all.iter().map(|v| v[contender][plan]).sum::<f64>() / all.len() as f64;
    let mut out = HEAD.replace("VALVES", &valves.to_string()).replace("FIRST", &FIRST_SEED.to_string());
    let _ = writeln!(out, "| RMSE [bar], mean of {valves} valves | {} |", PLANS.map(|p| p.0).join(" | "));
    let _ = writeln!(out, "|---|{}", "--:|".repeat(PLANS.len()));
    for (c, contender) in CONTENDERS.iter().enumerate() {
        let cells: Vec<String> = (0..PLANS.len()).map(|p| format!("{:.4}", mean(c, p))).collect();
        let _ = writeln!(out, "| {} | {} |", contender.name, cells.join(" | "));
    }
    let ratio = |above: usize, below: usize| {
        let cells: Vec<String> = (0..PLANS.len())
            .map(|p| {
                let each: Vec<f64> = all.iter().map(|v| v[above][p] / v[below][p]).collect();
                let worst = each.iter().copied().fold(0.0, f64::max);
                format!("{:.3} ({worst:.3})", each.iter().sum::<f64>() / each.len() as f64)
            })
            .collect();
        cells.join(" | ")
    };
    let best_rule = (7..10).min_by(|a, b| total(&all, *a).total_cmp(&total(&all, *b))).unwrap_or(7);
    let _ = writeln!(out, "\n| ratio of the errors, mean (worst valve) | {} |", PLANS.map(|p| p.0).join(" | "));
    let _ = writeln!(out, "|---|{}", "--:|".repeat(PLANS.len()));
    let _ = writeln!(out, "| whole controller : curve inverse with the best rule | {} |", ratio(6, 11));
    let _ = writeln!(
        out,
        "| tuned gains : best rule ({}), both with the model inverse | {} |",
        CONTENDERS[best_rule].name,
        ratio(6, best_rule)
    );
    let _ = writeln!(out, "| tuned gains : best rule, both with the curve inverse | {} |", ratio(10, 11));
    out.push_str(TAIL);
    predictor(&mut out)?;
    Ok(out)
}

/// The claim of the paper that a Smith predictor does not pay because the delay varies, tried on its valve.
fn predictor(out: &mut String) -> Result<(), CliError> {
    let valve = Valve::find("paper").and_then(|path| Valve::load(&path)).map_err(CliError::input)?;
    let plant = linear_loop(&valve).plant;
    out.push_str(PREDICTOR);
    for half_width_ms in [0.0, 2.0, 5.0, 10.0] {
        let (low, high) = (plant.delay_s - 1e-3 * half_width_ms, plant.delay_s + 1e-3 * half_width_ms);
        let task = TuningTask { plant, delay_range_s: (low, high), max_sensitivity: SENSITIVITY, rate_hz: 100.0, noise_share: 0.0 };
        let of = |form| {
            let gains = tune_as(&task, form).ok_or_else(|| CliError::input("no gains keep the sensitivity"))?;
            Ok::<_, CliError>((gains, left_as(&task, form, gains).sqrt()))
        };
        let ((pi, pi_left), (smith, smith_left)) = (of(Form::Pi)?, of(Form::Smith)?);
        let _ = writeln!(
            out,
            "| {:.0} to {:.0} ms | {:.1}, {:.0} | {:.1} % | {:.1}, {:.0} | {:.1} % | {:.2} |",
            1e3 * low,
            1e3 * high,
            pi.kp_ma_per_bar,
            pi.ki_ma_per_bar_s,
            1e2 * pi_left,
            smith.kp_ma_per_bar,
            smith.ki_ma_per_bar_s,
            1e2 * smith_left,
            smith_left / pi_left
        );
    }
    Ok(())
}

const PREDICTOR: &str = "
## A Smith predictor?

The paper sets it aside because the delay varies. Tried on the linear loop of `valves/paper.toml` at 100 Hz: both controllers
tuned to leave the least of a disturbance that rises in 0.3 s, at the same largest sensitivity over the delay range; the
predictor believes in the middle of it. Left: RMS over 3 s as a share of the disturbance. Two degrees of freedom, above, are the
part of the predictor that costs no sensitivity: what the feed-forward has sent is compared with the model's late answer.

It is worth some percent, and that does not hang on how well the delay is known: the lag is short against the delay, and nothing
can act before the delay has passed. `hil` has none.

| delay | PI: K_P, K_I | left | predictor: K_P, K_I | left | ratio |
|---|---|--:|---|--:|--:|
";

fn total(all: &[Figures], contender: usize) -> f64 {
    all.iter().flat_map(|v| &v[contender]).sum()
}

const HEAD: &str = "# What each step of the controller is worth

Written by `hil tune --page > docs/control.md`; a test holds the ratios below on two of the valves.

VALVES valves of the challenge's plant, seeds from FIRST on, healthy; it shares no line with the models of the controller.
Each model is what `hil identify --input held` makes of the sweep of its valve. The error is that of the pressure in the chamber,
without the noise of the sensor, against the target delayed by the model's dead time. All gains but the paper's keep a largest
sensitivity of 1.4 over the delay range of the model, exact and sampled (`hil tune`, `hil margins`): rules as textbooks
print them, made bolder or more cautious until they are there.

";

const TAIL: &str = "
What the steps are:

- **Two degrees of freedom.** The feedback compares the measured pressure with what the model makes of the feed-forward's
  current, dead time, lag and all (`controller.reference = \"delayed\"`), not with the target itself. What is on its way is
  no error.
- **Memory of the current really sent.** The feedback is added to the wanted pressure, and one inverse, whose memory moves
  with the sum, gives the current (`controller.addition = \"pressure\"`). What is no more than the sensor's noise is
  withheld: on a perfect valve the feedback does nothing, and the hysteresis is not stirred.
- **Model inverse.** `controller.feed_forward = \"model\"` inverts what the valve file knows beyond the curve: lag, gain and
  zero, heating, leakage, creep, drift.
- **Tuned gains.** `hil tune`: of all gains that keep the sensitivity, those that leave the least of a disturbance that grows
  while the target moves, together with what is withheld because it may be noise. Rules by name: `hil tune --rule simc`, `amigo`, `lambda`.

Simulation and margins speak of the same loop: a valve of one straight line, without hysteresis and noise, stands at 98 % and falls
at 102 % of the sampled limit, at 50, 100 and 500 Hz, with three delays and lags and three ratios of the gains
(`tests/it/margins_law.rs`). On a perfect valve the feedback does nothing (`src/control/controller.rs`).
";

fn one_valve(seed: u64) -> Result<Figures, CliError> {
    let model = identified(seed)?;
    let found = linear_loop(&model);
    let task = TuningTask {
        plant: found.plant,
        delay_range_s: found.delay_range_s,
        max_sensitivity: SENSITIVITY,
        rate_hz: 100.0,
        noise_share: model.noise_bar / DISTURBANCE_BAR,
    };
    let none = || CliError::input(format!("valve {seed}: no gains keep the sensitivity"));
    let ours = tune(&task).ok_or_else(none)?;
    let rules = RULES.iter().map(|r| r.tuned(&task).ok_or_else(none)).collect::<Result<Vec<_>, _>>()?;
    let gained = Gained { ours, rules };
    let mut figures = Vec::new();
    for contender in &CONTENDERS[..11] {
        let of = |plan: &(&str, &[(&str, &str)])| tracked(plan, &model, seed, |s| (contender.set)(s, &gained));
        figures.push(PLANS.iter().map(of).collect::<Result<Vec<f64>, _>>()?);
    }
    // The best of the rules with the curve inverse, plan by plan: what a textbook can do at most.
    let mut best = vec![f64::INFINITY; PLANS.len()];
    for gains in &gained.rules {
        for (k, plan) in PLANS.iter().enumerate() {
            best[k] = best[k].min(tracked(plan, &model, seed, |s| (s.addition, s.gains) = (Addition::Current, *gains))?);
        }
    }
    figures.push(best);
    Ok(figures)
}

/// The model that `hil identify --input held` makes of the valve's sweep: the driver holds its command, and a sweep does not tell.
fn identified(seed: u64) -> Result<Valve, CliError> {
    let recording = Recording { runs: vec![Bench::sweep(seed)], ..Recording::default() };
    let options = Options { name: Some(format!("valve {seed}")), input: Some(Input::Held), ..Options::default() };
    Ok(identify(&recording, &options).map_err(CliError::input)?.valve)
}

/// RMSE of the true pressure over the main phases of a plan [bar].
fn tracked(
    (name, set): &(&str, &[(&str, &str)]),
    model: &Valve,
    seed: u64,
    change: impl Fn(&mut ControllerSettings),
) -> Result<f64, CliError> {
    let overrides: Vec<_> = set.iter().map(|(k, v)| (k.to_string(), v.to_string())).collect();
    let mut plan = files::plan(Path::new(name), &overrides)?;
    plan.model = None;
    (plan.controller.mode, plan.controller.feed_forward) = (Mode::Both, FeedForwardModel::Hyperbolic);
    change(&mut plan.controller);
    for phase in &mut plan.phases {
        let kept = (phase.controller.threshold_bar, phase.controller.period_s);
        phase.controller = plan.controller;
        (phase.controller.threshold_bar, phase.controller.period_s) = kept;
    }
    let mut rig = ChallengeRig { bench: Bench::new(seed), truth_bar: Vec::new(), period_s: plan.period_s };
    let (dut, prepared) = (Dut::default(), Prepared::default());
    let options = RunOptions { model, dut: &dut, seed, stop: None, prepared: Some(&prepared) };
    let (record, trace) = run(&plan, &mut rig, &options, &mut ());
    if rig.truth_bar.len() < trace.time_s.len() || record.phases.iter().any(|p| p.span_s.is_none()) {
        return Err(CliError::input(format!("valve {seed}, plan {name}: {}", record.reasons.join("; "))));
    }
    let first = plan.phases.iter().position(|p| p.role == crate::plan::Role::Main).unwrap_or(0) as u16;
    let last = plan.phases.iter().rposition(|p| p.role == crate::plan::Role::Main).unwrap_or(0) as u16;
    let begin = trace.phase.iter().position(|p| *p >= first).unwrap_or(0);
    let end = trace.phase.iter().rposition(|p| *p <= last).map_or(0, |k| k + 1);
    let signals = Signals { time_s: &trace.time_s, target_bar: &trace.target_bar, pressure_bar: &rig.truth_bar, ..Signals::default() };
    let segment = Segment {
        signals,
        range: begin..end,
        repetitions: std::iter::once(begin..end).collect(),
        delay_s: model.delay_s,
        lag_s: model.lag_s,
    };
    Rmse::default().compute(&segment).map_err(CliError::input)
}

/// A valve of the challenge's plant as a rig that also notes the true pressure.
struct ChallengeRig {
    bench: Bench,
    truth_bar: Vec<f64>,
    period_s: f64,
}

impl Rig for ChallengeRig {
    fn identity(&self) -> RigIdentity {
        RigIdentity { kind: "sim".into(), ..RigIdentity::default() }
    }

    fn step(&mut self, command_a: f64, _: f64) -> Result<Sample, RigError> {
        let time_s = self.truth_bar.len() as f64 * self.period_s;
        let (pressure_bar, truth) = self.bench.step(command_a);
        self.truth_bar.push(truth);
        Ok(Sample::simulated(time_s, pressure_bar))
    }

    fn make_safe(&mut self) -> Result<SafeState, RigError> {
        Ok(SafeState::of(true, "simulated"))
    }
}
