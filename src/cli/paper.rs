//! `hil paper`: every number of the paper beside ours, as Markdown; `docs/paper.md` is what this prints.
//!
//! Each figure of ours is computed here and now: the limits and margins by `control`, the errors by running the
//! shipped plans on the shipped valves.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;

use super::run::believed;
use super::{CliError, CliResult, exit};
use crate::control::stability::{LoopPlant, exact, routh};
use crate::control::{Gains, LinearLoop, linear_loop};
use crate::plan::Plan;
use crate::record::{Dut, TestRecord};
use crate::rig::RigIdentity;
use crate::rig::simulated::SimulatedRig;
use crate::runner::{self, RunOptions};
use crate::valve::{Hysteresis, Valve};

/// Where to find the plans.
#[derive(Debug, Args)]
pub struct PaperArgs {
    /// Folder of the shipped plans
    #[arg(long, default_value = "plans", value_name = "DIR")]
    plans: PathBuf,
}

/// The loop of the paper's stability example, Eqs. (12)-(18).
const EXAMPLE: LoopPlant = LoopPlant { gain_bar_per_ma: 0.04, lag_s: 0.01, delay_s: 0.04 };
/// Seed of the runs.
const SEED: u64 = 1;

/// Prints the comparison.
pub fn run(args: &PaperArgs) -> CliResult {
    let valve = load("paper")?;
    let mut out = String::from(HEAD);
    curves(&mut out, &valve);
    stability(&mut out, &valve);
    tracking(&mut out, &args.plans)?;
    clutches(&mut out, &args.plans)?;
    super::print(&out)?;
    Ok(exit::DONE)
}

const HEAD: &str = "# The paper's numbers beside ours

Written by `hil paper > docs/paper.md`; a test holds that the two agree.

What cannot be had, and what follows from it:

- **The measured recordings.** The paper's errors are those of a real valve. Ours come from `valves/paper.toml`, which
  is the paper's model with assumed noise: they show what controller, delay and limits contribute, and nothing about
  how well the model fits the real valve. Equal digits would be chance.
- **The parameter `a` of the hyperbola, and the noise.** The paper as we have it prints neither; both are assumptions
  of `valves/paper.toml`.
- **The drives.** Targets are shaped after the description of the figures, not read from them.

";

fn load(name: &str) -> Result<Valve, CliError> {
    Valve::find(name).and_then(|path| Valve::load(&path)).map_err(CliError::input)
}

fn table(out: &mut String, head: [&str; 3], rows: &[[String; 3]]) {
    let _ = writeln!(out, "| {} |\n|---|---|---|", head.join(" | "));
    for row in rows {
        let _ = writeln!(out, "| {} |", row.join(" | "));
    }
    out.push('\n');
}

fn row(what: &str, paper: &str, ours: impl Into<String>) -> [String; 3] {
    [what.into(), paper.into(), ours.into()]
}

fn curves(out: &mut String, valve: &Valve) {
    let (low, high) = valve.curves.range_a;
    let (least, most) = valve.curves.pressure_range_bar();
    let a = match valve.hysteresis {
        Hysteresis::Hyperbolic { a_bar2 } => format!("{a_bar2} bar^2, assumed"),
        other => format!("none: the hysteresis is {}", other.name()),
    };
    out.push_str("## Reference curves, Eq. (3)\n\n");
    table(
        out,
        ["", "paper", "ours"],
        &[
            row("range on which the model holds", "0 to 1 A", format!("{low:.3} to {high:.3} A: below, the curves cross or fall")),
            row("pressures on that range", "-", format!("{least:.2} to {most:.2} bar")),
            row("parameter a", "not printed", a),
            row(
                "dead time",
                "10 to 30 ms",
                format!(
                    "{:.0} to {:.0} ms, nominal {:.0} ms",
                    valve.delay_range_s.0 * 1e3,
                    valve.delay_range_s.1 * 1e3,
                    valve.delay_s * 1e3
                ),
            ),
        ],
    );
}

fn stability(out: &mut String, valve: &Valve) {
    let print = |v: Option<f64>, digits: usize, unit: &str| v.map_or_else(|| "none".into(), |v| format!("{v:.digits$} {unit}"));
    let at = |kp| routh::limits(&EXAMPLE, kp);
    out.push_str("## Limits of the gains, Eq. (18)\n\nk = 0.04 bar/mA, tau = 10 ms, T_d = 40 ms. The paper prints a_2 with a factor too many; ours is the mended form.\n\n");
    table(
        out,
        ["Routh with the first-order Pade form", "paper", "ours"],
        &[
            row("largest K_P", "35 mA/bar", print(at(0.0).kp_max_ma_per_bar, 1, "mA/bar")),
            row("largest K_I at K_P = 0", "900 mA/(bar s)", print(at(0.0).ki_max_ma_per_bar_s, 1, "mA/(bar s)")),
            row("largest K_I at K_P = 35 mA/bar", "500 mA/(bar s)", print(at(35.0).ki_max_ma_per_bar_s, 1, "mA/(bar s)")),
        ],
    );
    out.push_str("The true margins at the paper's gains, K_P = 1 mA/bar and K_I = 5 mA/(bar s), with the exact delay, for\nwhich we have no figures of the paper. The second column is the loop of its example, the third the steepest point of\n`valves/paper.toml`.\n\n");
    let LinearLoop { plant, at_current_a, .. } = linear_loop(valve);
    let (example, steepest) = (exact::margins(&EXAMPLE, Gains::PAPER), exact::margins(&plant, Gains::PAPER));
    let both = |what: &str, of: fn(&crate::control::stability::FrequencyMargins) -> Option<f64>, digits: usize, unit: &str| {
        [what.to_string(), print(of(&example), digits, unit), print(of(&steepest), digits, unit)]
    };
    let ours = format!(
        "at {at_current_a:.2} A: k = {:.4} bar/mA, tau = {:.0} ms, T_d = {:.0} ms",
        plant.gain_bar_per_ma,
        plant.lag_s * 1e3,
        plant.delay_s * 1e3
    );
    table(
        out,
        ["exact delay", "the paper's loop", &ours],
        &[
            both("gain margin", |m| m.gain_margin_db, 3, "dB"),
            both("phase crossover", |m| m.phase_crossover_rad_s, 2, "rad/s"),
            both("phase margin", |m| m.phase_margin_deg, 2, "deg"),
            both("gain crossover", |m| m.gain_crossover_rad_s, 5, "rad/s"),
            both("delay margin", |m| m.delay_margin_s, 3, "s"),
            both("maximum sensitivity", |m| m.max_sensitivity, 4, ""),
        ],
    );
}

/// Runs a shipped plan on a valve by name, or on the valve of the plan.
fn record(plans: &Path, plan: &str, valve: Option<&str>) -> Result<TestRecord, CliError> {
    let plan = Plan::load(&plans.join(format!("{plan}.toml")), &[]).map_err(CliError::input)?;
    let valve = load(valve.or(plan.valve.as_deref()).unwrap_or("paper"))?;
    let model = believed(&plan, &valve)?;
    plan.check_valve(&model).and_then(|()| plan.check_valve(&valve)).map_err(CliError::input)?;
    let mut rig = SimulatedRig::new(&valve, plan.period_s, Some(SEED), RigIdentity::default()).map_err(CliError::input)?;
    let dut = Dut { serial: valve.name.clone(), ..Dut::default() };
    let options = RunOptions { model: &model, dut: &dut, seed: SEED, stop: None, prepared: None };
    Ok(runner::run(&plan, &mut rig, &options, &mut ()).0)
}

/// A figure of a record as text; a phase or a metric that is not there is an error, not a gap in the table.
fn figure(record: &TestRecord, phase: &str, metric: &str) -> Result<String, CliError> {
    let found = record.phases.iter().filter(|p| p.name == phase).flat_map(|p| &p.measurements).find(|m| m.metric == metric);
    let missing = || CliError::input(format!("plan {}: phase `{phase}` does not measure `{metric}`", record.plan.name));
    found.map(crate::report::format::value).ok_or_else(missing)
}

fn tracking(out: &mut String, plans: &Path) -> Result<(), CliError> {
    out.push_str("## Errors of model and control\n\nRMSE; tracking errors against the reference delayed by the dead time.\n\n");
    let triangles = record(plans, "triangle-amplitudes", None)?;
    let ramps = record(plans, "ramp-hold", None)?;
    let drive = record(plans, "drive-800s", None)?;
    let mut rows = Vec::new();
    for phase in triangles.phases.iter().filter(|p| !p.measurements.is_empty()) {
        let (hyperbolic, average) =
            (figure(&triangles, &phase.name, "model_rmse")?, figure(&triangles, &phase.name, "model_rmse_average")?);
        rows.push(row(
            &format!("Fig. 5, triangles, {}: hyperbolic model", phase.name),
            "0.173 bar",
            format!("{hyperbolic} (average model {average})"),
        ));
    }
    rows.push(row(
        "Fig. 7, ramps and holds: feed-forward by the hyperbolic model",
        "0.207 bar",
        figure(&ramps, "hyperbolic model", "rmse")?,
    ));
    rows.push(row("Fig. 7: feed-forward by the average model", "0.404 bar", figure(&ramps, "average model", "rmse")?));
    rows.push(row("drive of 800 s, tracking", "0.436 bar", figure(&drive, "drive", "rmse")?));
    table(out, ["", "paper", "ours"], &rows);
    out.push_str("The model error of our triangles is the assumed noise alone, because the simulated valve is the model itself: it says\nthat the recursion is right, not that the model fits a valve. The order of Fig. 7 is a statement about the\ncontrol, and holds here too: the hyperbolic feed-forward tracks better than the average one.\n\n");
    Ok(())
}

fn clutches(out: &mut String, plans: &Path) -> Result<(), CliError> {
    out.push_str("## Table 1: two clutches, three controllers\n\nThe true curves of the two clutches are not those that the controller believes in (the paper: \"error due to oil\ntemperature\"). One parameter of each variant is set so that feed-forward alone gives the paper's error; the other four\nfigures are predictions. The paper's own values of those four are not in the material at hand, so nothing stands beside\nthem.\n\n");
    let mut rows = Vec::new();
    let mut bands = Vec::new();
    for (clutch, paper) in [("clutch-1", "0.413 bar"), ("clutch-2", "0.487 bar")] {
        let valve = load(clutch)?;
        let shift: Vec<String> = valve
            .effects
            .iter()
            .map(|e| {
                let parameters: Vec<String> = e.parameters.iter().map(|(name, value)| format!("{name} = {value}")).collect();
                format!("`{}` {}", e.id, parameters.join(", "))
            })
            .collect();
        let run = record(plans, "gain-comparison", Some(clutch))?;
        for (phase, beside) in [("feed-forward only", paper), ("K_I 5", "not at hand"), ("K_I 10", "not at hand")] {
            let kind = if beside == paper { format!("calibrated: {}", shift.join("; ")) } else { "predicted".into() };
            rows.push(row(&format!("{clutch}, {phase}"), beside, format!("{}, {kind}", figure(&run, phase, "rmse")?)));
            bands.push(row(&format!("{clutch}, {phase}"), "not at hand", figure(&run, phase, "rmse_band")?));
        }
    }
    table(out, ["RMSE", "paper", "ours"], &rows);
    out.push_str("The same within 20 to 26 bar:\n\n");
    table(out, ["RMSE", "paper", "ours"], &bands);
    // One blank line at the end is enough.
    out.truncate(out.trim_end().len());
    out.push('\n');
    Ok(())
}
