//! `hil explain --page`: what can be measured, and how good its verdicts are; docs/metrics.md is what this prints.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::valves::believed;
use super::{CliError, exit};
use crate::plan::{Override, Plan};
use crate::record::{Dut, Outcome, TestRecord};
use crate::rig::RigIdentity;
use crate::rig::simulated::SimulatedRig;
use crate::runner::{Prepared, RunOptions, run};
use crate::valve::{EffectSpec, Valve};

/// How far beyond its limit a valve lies that must be rejected.
const BEYOND: f64 = 0.25;
/// Seeds with which a valve beyond a limit is tried.
const TRIED: u64 = 100;

/// A change of a valve with one number: effect, parameter, unit, largest size.
struct Knob {
    effect: &'static str,
    parameter: &'static str,
    unit: &'static str,
    most: f64,
    /// Whether it makes the valve slower, which is what a time should be tried with first.
    slows: bool,
    /// A further parameter that the effect wants, with its value.
    beside: Option<(&'static str, &'static str)>,
}

/// What can be wrong with a valve, the simplest first: the first knob that moves a figure to where it is wanted is used.
const KNOBS: [Knob; 14] = [
    Knob { effect: "reference_shift", parameter: "offset", unit: "bar", most: 5.0, slows: false, beside: None },
    Knob { effect: "reference_shift", parameter: "offset", unit: "bar", most: -5.0, slows: false, beside: None },
    Knob { effect: "reference_shift", parameter: "gain", unit: "", most: 0.39, slows: false, beside: None },
    Knob { effect: "reference_shift", parameter: "gain", unit: "", most: -0.39, slows: false, beside: None },
    Knob { effect: "reversal_dead_band", parameter: "width", unit: "A", most: 0.09, slows: false, beside: None },
    Knob { effect: "transport_delay", parameter: "extra", unit: "s", most: 0.09, slows: true, beside: None },
    Knob { effect: "first_order_lag", parameter: "tau", unit: "s", most: 0.15, slows: true, beside: None },
    Knob { effect: "reference_drift", parameter: "offset", unit: "bar", most: 5.0, slows: false, beside: Some(("tau", "100 s")) },
    Knob { effect: "reference_drift", parameter: "offset", unit: "bar", most: -5.0, slows: false, beside: Some(("tau", "100 s")) },
    Knob { effect: "reference_drift", parameter: "gain", unit: "", most: 0.29, slows: false, beside: Some(("tau", "100 s")) },
    Knob { effect: "reference_drift", parameter: "gain", unit: "", most: -0.29, slows: false, beside: Some(("tau", "100 s")) },
    Knob { effect: "stiction", parameter: "band", unit: "A", most: 0.09, slows: false, beside: None },
    Knob { effect: "sensor_dead_band", parameter: "width", unit: "bar", most: 3.0, slows: false, beside: None },
    Knob {
        effect: "second_order_resonance",
        parameter: "frequency",
        unit: "Hz",
        most: 3.0,
        slows: false,
        beside: Some(("damping", "0.2")),
    },
];

struct Shipped {
    name: String,
    plan: Plan,
    valve: Valve,
    model: Valve,
}

fn shipped(plans: &Path) -> Result<Vec<Shipped>, CliError> {
    let wrong = |e: std::io::Error| CliError::input(format!("{}: {e}", plans.display()));
    let mut files: Vec<PathBuf> = std::fs::read_dir(plans).map_err(wrong)?.filter_map(|e| Some(e.ok()?.path())).collect();
    files.retain(|p| p.extension().is_some_and(|e| e == "toml"));
    files.sort();
    let load = |path: &PathBuf| {
        let name = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        // The long drive in short: its rounds are alike.
        let set: Vec<Override> = if name == "drive-800s" { vec![("rounds".into(), "2".into())] } else { Vec::new() };
        let plan = Plan::load(path, &set).map_err(CliError::input)?;
        let valve = Valve::find(plan.valve.as_deref().unwrap_or("paper")).and_then(|p| Valve::load(&p)).map_err(CliError::input)?;
        let model = believed(&plan, &valve)?;
        Ok(Shipped { name, plan, valve, model })
    };
    files.iter().map(load).collect()
}

fn once(shipped: &Shipped, valve: &Valve, seed: Option<u64>) -> Option<TestRecord> {
    let (dut, prepared) = (Dut::default(), Prepared::default());
    let mut rig = SimulatedRig::new(valve, shipped.plan.period_s, seed, RigIdentity::default()).ok()?;
    let options = RunOptions { model: &shipped.model, dut: &dut, seed: seed.unwrap_or(0), stop: None, prepared: Some(&prepared) };
    Some(run(&shipped.plan, &mut rig, &options, &mut ()).0)
}

/// The page. `seeds` is the number of runs of each plan on its own valve; 0 leaves the verdicts out.
pub fn page(plans: &Path, seeds: u64, metrics: &[(String, String)]) -> Result<String, CliError> {
    let shipped = shipped(plans)?;
    let mut out = String::from(HEAD);
    out.push_str("| metric | meaning and source | measured by |\n|---|---|---|\n");
    for (id, text) in metrics {
        let by: Vec<&str> = shipped
            .iter()
            .filter(|s| s.plan.phases.iter().flat_map(|p| &p.measures).any(|m| m.metric.metric().id() == id))
            .map(|s| s.name.as_str())
            .collect();
        let _ = writeln!(out, "| `{id}` | {} | {} |", text.replace('\n', " ").replace('|', "\\|"), by.join(", "));
    }
    if seeds > 0 {
        verdicts(&mut out, &shipped, seeds)?;
    }
    Ok(out)
}

const HEAD: &str = "# What is measured

Written by `hil explain --page --seeds 1000 > docs/metrics.md`; a test holds the table, and the verdicts with fewer seeds.
`hil explain METRIC` says more of each.

";

fn verdicts(out: &mut String, shipped: &[Shipped], seeds: u64) -> Result<(), CliError> {
    let internal = || CliError { code: exit::INTERNAL, message: "a shipped valve cannot be simulated".into() };
    let _ = writeln!(
        out,
        "\n## Are the verdicts right?\n\nEvery shipped plan on its own simulated valve, {seeds} seeds of the noise: a reject is false.\n"
    );
    out.push_str("| plan | runs | false rejects |\n|---|--:|--:|\n");
    for s in shipped {
        let failed: Option<Vec<bool>> = (1..=seeds)
            .into_par_iter()
            .map(|seed| once(s, &s.valve, Some(seed)).map(|r| r.outcome != Outcome::Pass && r.outcome != Outcome::Marginal))
            .collect();
        let failed = failed.ok_or_else(internal)?.into_iter().filter(|f| *f).count();
        let _ = writeln!(out, "| {} | {seeds} | {failed} |", s.name);
    }
    let tried = seeds.min(TRIED);
    let _ = writeln!(
        out,
        "\nA valve changed until its figure, without noise, lies {:.0} % beyond the limit, then {tried} seeds of the noise: how many are rejected.\nA band about zero is tried on both sides.\n",
        100.0 * BEYOND
    );
    out.push_str("| plan, phase, metric | limit | changed | rejected |\n|---|---|---|--:|\n");
    for s in shipped {
        for (phase, metric, limit, wanted) in limits(s) {
            let time = metric.ends_with("_time");
            let first = KNOBS.iter().filter(|knob| knob.slows == time);
            let knobs = first.chain(KNOBS.iter().filter(|knob| knob.slows != time));
            let found = knobs.into_iter().find_map(|knob| turned(s, knob, &phase, &metric, limit, wanted).map(|v| (knob, v)));
            let name = format!("{}, {phase}, `{metric}`", s.name);
            let Some((knob, (valve, size))) = found else {
                let _ = writeln!(out, "| {name} | {limit} | none of the changes reaches {wanted:.4} | - |");
                continue;
            };
            let rejected =
                (1..=tried).into_par_iter().filter(|seed| once(s, &valve, Some(*seed)).is_some_and(|r| r.outcome == Outcome::Fail)).count();
            let _ = writeln!(
                out,
                "| {name} | {limit} | `{}` {} = {size:.4} {} | {rejected} of {tried} |",
                knob.effect, knob.parameter, knob.unit
            );
        }
    }
    Ok(())
}

/// Every limit: phase, metric, bound, and the figure beyond it.
fn limits(s: &Shipped) -> Vec<(String, String, f64, f64)> {
    let mut found = Vec::new();
    for phase in &s.plan.phases {
        for m in &phase.measures {
            let Some(limit) = &m.limit else { continue };
            let id = m.metric.metric().id();
            if let Some(max) = limit.max {
                found.push((phase.name.clone(), id.to_string(), max, max * (1.0 + BEYOND)));
            }
            if let Some(min) = limit.min {
                // Below a positive limit by a quarter; beyond a negative one by a quarter.
                let wanted = if min > 0.0 { min * (1.0 - BEYOND) } else { min * (1.0 + BEYOND) };
                found.push((phase.name.clone(), id.to_string(), min, wanted));
            }
        }
    }
    found
}

fn changed(base: &Valve, knob: &Knob, size: f64) -> Valve {
    let mut parameters = vec![(knob.parameter.to_string(), format!("{size} {}", knob.unit).trim().to_string())];
    parameters.extend(knob.beside.map(|(name, value)| (name.to_string(), value.to_string())));
    let mut valve = base.clone();
    match valve.effects.iter_mut().find(|e| e.id == knob.effect) {
        // A valve that has the effect already gets the new number in place of its own.
        Some(effect) => {
            effect.parameters.retain(|p| p.0 != knob.parameter);
            effect.parameters.extend(parameters);
        }
        None => valve.effects.push(EffectSpec { id: knob.effect.into(), parameters }),
    }
    valve
}

/// The valve with this knob turned until the figure is as wanted, with the size.
fn turned(s: &Shipped, knob: &Knob, phase: &str, metric: &str, limit: f64, wanted: f64) -> Option<(Valve, f64)> {
    let base = Valve { noise_bar: 0.0, ..s.valve.clone() };
    let of = |size: f64| {
        let record = once(s, &changed(&base, knob, size), None)?;
        record.phases.iter().find(|p| p.name == phase)?.measurements.iter().find(|m| m.metric == metric)?.value
    };
    // From the valve as it is outwards, until the figure is beyond; a slower knob in finer steps would find no more.
    let outwards = (wanted - limit).signum();
    let steps = (1..=12).map(|k| knob.most * 0.5f64.powi(12 - k)).collect::<Vec<_>>();
    let reached = steps.iter().position(|size| of(*size).is_some_and(|v| (v - wanted) * outwards >= 0.0))?;
    let (mut low, mut high) = (if reached == 0 { 0.0 } else { steps[reached - 1] }, steps[reached]);
    for _ in 0..14 {
        let middle = 0.5 * (low + high);
        if of(middle).is_some_and(|v| (v - wanted) * outwards >= 0.0) { high = middle } else { low = middle }
    }
    // The figure must come to where it is wanted, not jump over it.
    let there = of(high)?;
    ((there - wanted).abs() <= 0.1 * (wanted - limit).abs() + 1e-3).then(|| (changed(&s.valve, knob, high), high))
}
