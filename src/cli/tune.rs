//! `hil tune`: gains for a largest sensitivity over the whole delay range, beside textbook rules, and what they gain on a plan.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::margins::{TextOrJson, time_range};
use super::valves::believed;
use super::{CliError, CliResult, exit, files};
use crate::control::rules::{RULES, TextbookRule};
use crate::control::stability::{Margins, margins};
use crate::control::tune::{DISTURBANCE_BAR, TuningTask, left, tune};
use crate::control::{Gains, linear_loop};
use crate::plan::Plan;
use crate::record::{Dut, TestRecord};
use crate::rig::RigIdentity;
use crate::rig::simulated::SimulatedRig;
use crate::runner::{Prepared, RunOptions};
use crate::units::Unit;
use crate::valve::Valve;

/// Arguments of `hil tune`.
#[derive(Debug, Args)]
pub struct TuneArgs {
    /// Valve model that the controller believes in.
    #[arg(long, value_name = "VALVE", required_unless_present = "page")]
    model: Option<String>,
    /// Whose gains are proposed: `hil`, or a textbook rule at the same sensitivity.
    #[arg(long, value_enum, default_value_t)]
    rule: Rule,
    /// Print docs/control.md instead: what each step of the controller is worth, on valves of the challenge.
    #[arg(long, hide = true)]
    page: bool,
    /// Number of valves of the page.
    #[arg(long, hide = true, default_value_t = super::control_page::VALVES)]
    valves: u64,
    /// Largest sensitivity anywhere in the delay range, exact and sampled; 1.2 (cautious) to 2 (bold).
    #[arg(long, value_name = "M", default_value_t = 1.4)]
    max_sensitivity: f64,
    /// Range of the delay, for instance "10 ms..40 ms"; the model's by default.
    #[arg(long, value_name = "LOW..HIGH", value_parser = time_range)]
    delay_range: Option<(f64, f64)>,
    /// Plan to compare the gains with the paper's on.
    #[arg(long, value_name = "PLAN", default_value = "tipin")]
    plan: PathBuf,
    /// Valve to compare them on; the plan's by default.
    #[arg(long)]
    valve: Option<String>,
    /// Seed of the comparison.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// What is printed.
    #[arg(long, value_enum, default_value_t)]
    format: TextOrJson,
}

/// Whose gains are proposed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum)]
enum Rule {
    /// Those that leave the least of a disturbance.
    #[default]
    Hil,
    /// Skogestad's.
    Simc,
    /// Astrom and Hagglund's.
    Amigo,
    /// Lambda tuning.
    Lambda,
}

impl Rule {
    fn textbook(self) -> Option<TextbookRule> {
        match self {
            Self::Hil => None,
            Self::Simc => Some(TextbookRule::Simc),
            Self::Amigo => Some(TextbookRule::Amigo),
            Self::Lambda => Some(TextbookRule::Lambda),
        }
    }
}

/// Gains of a rule at the sensitivity that was asked for.
#[derive(Debug, Serialize)]
struct RuleRow {
    rule: String,
    kp_ma_per_bar: f64,
    ki_ma_per_bar_s: f64,
    /// What the loop leaves of a disturbance of 0.2 bar that rises within 0.3 s: its RMS over 3 s, with what is withheld because it
    /// may be noise, as a share of the disturbance.
    left: f64,
    /// Over that of the proposed gains.
    against_proposed: f64,
}

/// What the command prints as JSON.
#[derive(Debug, Serialize)]
struct Tuning {
    schema: &'static str,
    kp_ma_per_bar: f64,
    ki_ma_per_bar_s: f64,
    max_sensitivity: f64,
    margins: Margins,
    paper: Margins,
    plan: String,
    valve: String,
    comparison: Vec<Comparison>,
    rules: Vec<RuleRow>,
}

/// One figure of the plan with the paper's gains and with the proposed ones.
#[derive(Debug, Serialize)]
struct Comparison {
    phase: String,
    metric: String,
    unit: String,
    paper: Option<f64>,
    tuned: Option<f64>,
}

/// Runs the command.
pub fn run(args: &TuneArgs) -> CliResult {
    if !(args.max_sensitivity > 1.0 && args.max_sensitivity <= 10.0) {
        return Err(CliError::usage(format!("--max-sensitivity {}: more than 1 and at most 10 is allowed", args.max_sensitivity)));
    }
    if args.page {
        super::print(&super::control_page::page(args.valves)?)?;
        return Ok(exit::DONE);
    }
    let (model, _) = files::valve(args.model.as_deref().unwrap_or_default())?;
    let mut plan = files::plan(&args.plan, &[])?;
    let valve = match (&args.valve, &plan.valve) {
        (None, None) => model.clone(),
        (typed, _) => files::valve_under(&plan, typed.as_deref())?.0,
    };
    let found = linear_loop(&model);
    let delay_range_s = args.delay_range.unwrap_or(found.delay_range_s);
    let rate_hz = 1.0 / plan.period_s;
    let task = TuningTask {
        plant: found.plant,
        delay_range_s,
        max_sensitivity: args.max_sensitivity,
        rate_hz,
        noise_share: model.noise_bar / DISTURBANCE_BAR,
    };
    let proposed = args.rule.textbook().map_or_else(|| tune(&task), |rule| rule.tuned(&task));
    let Some(gains) = proposed else {
        return Err(CliError::input(format!("no gains keep the sensitivity of `{}` within {}", model.name, args.max_sensitivity)));
    };
    // As they would be typed into a plan: three digits, downwards.
    let three =
        |v: f64| if v > 0.0 { (v / 10f64.powf(v.log10().floor() - 2.0)).floor() * 10f64.powf(v.log10().floor() - 2.0) } else { 0.0 };
    let gains = Gains { kp_ma_per_bar: clean(three(gains.kp_ma_per_bar)), ki_ma_per_bar_s: clean(three(gains.ki_ma_per_bar_s)) };
    let judge = |gains| margins(&found.plant, delay_range_s, gains, rate_hz).map_err(CliError::input);
    let (tuned, paper) = (judge(gains)?, judge(Gains::PAPER)?);
    plan.model = None;
    plan.check_valve(&model).map_err(CliError::input)?;
    let with = |gains: Gains| on_plan(&plan, &model, &valve, gains, args.seed);
    let comparison = compare(&with(Gains::PAPER)?, &with(gains)?);
    let tuning = Tuning {
        schema: "hil.tuning/1",
        kp_ma_per_bar: gains.kp_ma_per_bar,
        ki_ma_per_bar_s: gains.ki_ma_per_bar_s,
        max_sensitivity: args.max_sensitivity,
        margins: tuned,
        paper,
        plan: plan.name.clone(),
        valve: valve.name.clone(),
        comparison,
        rules: rules(&task, gains),
    };
    super::print(&match args.format {
        TextOrJson::Json => super::to_json(&tuning)?,
        TextOrJson::Text => table(&tuning, &model),
    })?;
    Ok(exit::DONE)
}

/// Every rule beside the proposed gains, all at the task's sensitivity.
fn rules(task: &TuningTask, proposed: Gains) -> Vec<RuleRow> {
    let base = left(task, proposed);
    let row = |rule: &str, gains: Gains| RuleRow {
        rule: rule.into(),
        kp_ma_per_bar: clean(gains.kp_ma_per_bar),
        ki_ma_per_bar_s: clean(gains.ki_ma_per_bar_s),
        left: clean(left(task, gains).sqrt()),
        against_proposed: clean((left(task, gains) / base).sqrt()),
    };
    let of_rules = RULES.iter().filter_map(|r| r.tuned(task).map(|g| row(r.name(), g)));
    std::iter::once(row("proposed", proposed)).chain(of_rules).collect()
}

/// Without the dust of the decimal rounding.
fn clean(value: f64) -> f64 {
    format!("{value:.9}").parse().unwrap_or(value)
}

/// The plan with `gains` in every phase, on the simulated `valve`.
fn on_plan(plan: &Plan, model: &Valve, valve: &Valve, gains: Gains, seed: u64) -> Result<TestRecord, CliError> {
    let mut plan = plan.clone();
    plan.controller.gains = gains;
    for phase in &mut plan.phases {
        phase.controller.gains = gains;
    }
    let model = believed(&plan, model)?;
    let mut rig = SimulatedRig::new(valve, plan.period_s, Some(seed), RigIdentity::default()).map_err(CliError::input)?;
    let (dut, prepared) = (Dut::default(), Prepared::default());
    let options = RunOptions { model: &model, dut: &dut, seed, stop: None, prepared: Some(&prepared) };
    Ok(crate::runner::run(&plan, &mut rig, &options, &mut ()).0)
}

fn compare(paper: &TestRecord, tuned: &TestRecord) -> Vec<Comparison> {
    let mut lines = Vec::new();
    for (a, b) in paper.phases.iter().zip(&tuned.phases) {
        for (x, y) in a.measurements.iter().zip(&b.measurements) {
            lines.push(Comparison {
                phase: a.name.clone(),
                metric: x.metric.clone(),
                unit: x.unit.clone(),
                paper: x.value,
                tuned: y.value,
            });
        }
    }
    lines
}

fn table(tuning: &Tuning, model: &Valve) -> String {
    let worst = |m: &Margins| {
        let exact = m.worst_over_delay_range.max_sensitivity;
        exact.zip(m.worst_over_delay_range.sampled.max_sensitivity).map_or("unstable".into(), |(a, b)| format!("{:.3}", a.max(b)))
    };
    let (low, high) = tuning.margins.of.delay_range_s;
    let mut text = format!(
        "gains for `{}`, largest sensitivity {} over a delay of {low} s to {high} s\n\n{:<24}{:>14}{:>14}\n",
        model.name, tuning.max_sensitivity, "", "paper", "proposed"
    );
    let of = |m: &Margins| m.of.clone();
    let mut line = |name: &str, a: String, b: String| text += &format!("{name:<24}{a:>14}{b:>14}\n");
    line("K_P [mA/bar]", of(&tuning.paper).kp_ma_per_bar.to_string(), tuning.kp_ma_per_bar.to_string());
    line("K_I [mA/(bar s)]", of(&tuning.paper).ki_ma_per_bar_s.to_string(), tuning.ki_ma_per_bar_s.to_string());
    line("worst sensitivity", worst(&tuning.paper), worst(&tuning.margins));
    text += &format!("\n{:<24}{:>14}{:>18}{:>14}{:>10}\n", "at this sensitivity", "K_P [mA/bar]", "K_I [mA/(bar s)]", "left", "against");
    for r in &tuning.rules {
        text += &format!(
            "{:<24}{:>14.3}{:>18.2}{:>12.2} %{:>10.3}\n",
            r.rule,
            r.kp_ma_per_bar,
            r.ki_ma_per_bar_s,
            100.0 * r.left,
            r.against_proposed
        );
    }
    text += "left: RMS over 3 s of what the loop leaves of a disturbance that rises in 0.3 s, and of what may be noise\n";
    text += &format!("\nplan `{}` on the simulated valve `{}`\n\n{:<46}{:>14}{:>14}\n", tuning.plan, tuning.valve, "", "paper", "proposed");
    for c in &tuning.comparison {
        let print = |v: Option<f64>| match (v, Unit::by_symbol(&c.unit)) {
            (Some(v), Some(unit)) => unit.print(v),
            _ => "-".into(),
        };
        text += &format!("{:<46}{:>14}{:>14}\n", format!("{}: {}", c.phase, c.metric), print(c.paper), print(c.tuned));
    }
    text
}
