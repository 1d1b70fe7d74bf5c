//! `hil paper`: every number of the paper beside ours, as Markdown; `docs/paper.md` is what this prints.
//!
//! Each figure of ours is computed here and now: the limits and margins by `control`, the errors by running the
//! shipped plans on the shipped valves.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;

use super::paper_search::{Search, TABLE_1, behind_the_driver};
use super::valves::believed;
use super::{CliError, CliResult, exit};
use crate::control::stability::sampled::SampledLoop;
use crate::control::stability::{LoopPlant, exact, routh};
use crate::control::{Gains, LinearLoop, Mode, linear_loop};
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
    /// Search for the physics that explains Table 1 instead; docs/paper-search.md is what this prints
    #[arg(long)]
    search: bool,
}

/// The loop of the paper's stability example, Eqs. (12)-(18).
const EXAMPLE: LoopPlant = LoopPlant { gain_bar_per_ma: 0.04, lag_s: 0.01, delay_s: 0.04 };
/// Seed of the runs.
const SEED: u64 = 1;

/// Prints the comparison.
pub fn run(args: &PaperArgs) -> CliResult {
    if args.search {
        super::print(&search(&args.plans)?)?;
        return Ok(exit::DONE);
    }
    let valve = load("paper")?;
    let mut out = String::from(HEAD);
    curves(&mut out, &valve);
    stability(&mut out, &valve);
    clutches(&mut out, &args.plans)?;
    errors(&mut out, &args.plans)?;
    super::print(&out)?;
    Ok(exit::DONE)
}

const HEAD: &str = "# The paper's numbers beside ours

Written by `hil paper > docs/paper.md`; a test holds that the two agree.

What cannot be had, and what follows from it:

- **The measured recordings.** The paper's errors are those of a real valve on a real bench. Ours come from simulated ones:
  from `valves/paper.toml`, which is the paper's model with little noise, and from `valves/clutch-1.toml` and
  `valves/clutch-2.toml`, which hold what explains the six figures of Table 1 (below). Equal digits would be chance.
- **The drives.** Targets and currents are shaped after the description of the figures, not read from them.

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
        Hysteresis::Hyperbolic { a_bar2 } => format!("{a_bar2} bar^2"),
        other => format!("none: the hysteresis is {}", other.name()),
    };
    out.push_str("## Reference curves, Eq. (3)\n\n");
    table(
        out,
        ["", "paper", "ours"],
        &[
            row("range on which the model holds", "0 to 1 A", format!("{low:.3} to {high:.3} A: below, the curves cross or fall")),
            row("pressures on that range", "-", format!("{least:.2} to {most:.2} bar")),
            row("parameter a, section 2.3", "1 (bar^2)", a),
            row("R^2 of the curves", "0.99", "none: our sweeps are simulated from the curves themselves"),
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
    // With the exact delay, and at the loop rate of 100 Hz: how far each gain alone may go.
    let most = |stable: &dyn Fn(f64) -> bool| {
        let (mut low, mut high) = (0.0, 4000.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if stable(middle) { low = middle } else { high = middle }
        }
        low
    };
    let gains = |kp_ma_per_bar: f64, ki_ma_per_bar_s: f64| Gains { kp_ma_per_bar, ki_ma_per_bar_s };
    let exact_at = |g: Gains| exact::margins(&EXAMPLE, g).stable;
    let sampled_at = |g: Gains| SampledLoop::new(&EXAMPLE, g, 100.0).stable();
    let says = |stable: bool| if stable { "stable" } else { "UNSTABLE" };
    out.push_str("The Pade form is too kind to K_P: with the exact delay the loop is unstable long before it.\n\n");
    table(
        out,
        ["largest gain for stability", "exact delay", "sampled at 100 Hz, one period of computation"],
        &[
            row(
                "K_P at K_I = 0",
                &format!("{:.2} mA/bar", most(&|k| exact_at(gains(k, 0.0)))),
                format!("{:.2} mA/bar", most(&|k| sampled_at(gains(k, 0.0)))),
            ),
            row(
                "K_I at K_P = 0",
                &format!("{:.0} mA/(bar s)", most(&|k| exact_at(gains(0.0, k)))),
                format!("{:.0} mA/(bar s)", most(&|k| sampled_at(gains(0.0, k)))),
            ),
            row("the paper's K_P = 35, K_I = 5", says(exact_at(gains(35.0, 5.0))), says(sampled_at(gains(35.0, 5.0)))),
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
fn record(plans: &Path, plan: &str, valve: Option<&str>, mode: Option<Mode>) -> Result<TestRecord, CliError> {
    record_on(plans, plan, valve, mode, Valve::clone)
}

/// The same on what `part` makes of the valve.
fn record_on(
    plans: &Path,
    plan: &str,
    valve: Option<&str>,
    mode: Option<Mode>,
    part: impl Fn(&Valve) -> Valve,
) -> Result<TestRecord, CliError> {
    let mut plan = Plan::load(&plans.join(format!("{plan}.toml")), &[]).map_err(CliError::input)?;
    for phase in &mut plan.phases {
        phase.controller.mode = mode.unwrap_or(phase.controller.mode);
    }
    let valve = part(&load(valve.or(plan.valve.as_deref()).unwrap_or("paper"))?);
    // The controller believes in the paper's valve, whatever the clutch is.
    let model = if plan.model.is_some() { believed(&plan, &valve)? } else { load("paper")? };
    plan.check_valve(&model).and_then(|()| plan.check_valve(&valve)).map_err(CliError::input)?;
    let mut rig = SimulatedRig::new(&valve, plan.period_s, Some(SEED), RigIdentity::default()).map_err(CliError::input)?;
    let dut = Dut { serial: valve.name.clone(), ..Dut::default() };
    let options = RunOptions { model: &model, dut: &dut, seed: SEED, stop: None, prepared: None };
    Ok(runner::run(&plan, &mut rig, &options, &mut ()).0)
}

/// A figure of a record; a phase or a metric that is not there is an error, not a gap in the table.
fn number(record: &TestRecord, phase: &str, metric: &str) -> Result<f64, CliError> {
    let found = record.phases.iter().filter(|p| p.name == phase).flat_map(|p| &p.measurements).find(|m| m.metric == metric);
    let missing = || CliError::input(format!("plan {}: phase `{phase}` has no `{metric}`", record.plan.name));
    found.and_then(|m| m.value).ok_or_else(missing)
}

const CLUTCHES: [&str; 2] = ["clutch-1", "clutch-2"];

fn clutches(out: &mut String, plans: &Path) -> Result<(), CliError> {
    out.push_str(TABLE_1_HEAD);
    let mut rows = Vec::new();
    let mut worst = 0.0f64;
    for (clutch, paper) in CLUTCHES.into_iter().zip(TABLE_1) {
        let run = record(plans, "gain-comparison", Some(clutch), None)?;
        for (phase, paper) in ["feed-forward only", "K_I 5", "K_I 10"].into_iter().zip(paper) {
            let ours = number(&run, phase, "rmse")?;
            worst = worst.max((ours - paper).abs());
            rows.push(row(&format!("{clutch}, {phase}"), &format!("{paper:.3} bar"), format!("{ours:.3} bar")));
        }
    }
    table(out, ["Table 1, RMSE of the whole drive, K_P 1", "paper", "ours"], &rows);
    let _ = writeln!(out, "Largest miss: {:.0} mbar. The valves:\n", 1e3 * worst);
    for clutch in CLUTCHES {
        let valve = load(clutch)?;
        let effects: Vec<String> = valve
            .effects
            .iter()
            .map(|e| {
                format!(
                    "`{}` {}",
                    e.id,
                    e.parameters.iter().map(|(name, value)| format!("{name} = {value}")).collect::<Vec<_>>().join(", ")
                )
            })
            .collect();
        let _ = writeln!(out, "- {clutch}: noise {:.3} bar, {}", valve.noise_bar, effects.join("; "));
    }
    out.push_str(TABLE_1_TAIL);
    let needed = parameters(&load(CLUTCHES[0])?, &load(CLUTCHES[1])?);
    let _ = writeln!(out, " It needs {needed}.\n");
    Ok(())
}

/// Fitted parameters of two clutches: what both have alike is one, what each has of its own two.
fn parameters(first: &Valve, second: &Valve) -> usize {
    let values = |valve: &Valve| valve.effects.iter().flat_map(|e| e.parameters.clone()).collect::<Vec<_>>();
    let both: Vec<_> = values(first).into_iter().zip(values(second)).collect();
    both.len() + both.iter().filter(|(a, b)| a != b).count()
}

const TABLE_1_HEAD: &str = "## Table 1: two clutches, three controllers

The clutches differ from what the controller believes in by at most four parameters: dead time and lag between the command and the
current in the coil, which both share, and a gain or a zero of the curve of each. `hil paper --search` finds them among all sets of
plausible causes ([paper-search.md](paper-search.md) is what it prints), by these six figures alone.

";

const TABLE_1_TAIL: &str = "
Feedback takes a static error away within seconds, so a wrong curve alone cannot explain what is left at K_I = 10: it must be
something that feedback cannot reach. Dead time, lag, noise and ripple are such, and the six figures do not tell which: many sets
come within 25 mbar, and a fifth or sixth parameter buys some millibars. Of the sets of at most four, the one shown is nearest to
Figs. 5 and 7, which the search did not see: there the paper gives its model the measured current, and what happens before that
current does not count.";

fn errors(out: &mut String, plans: &Path) -> Result<(), CliError> {
    out.push_str("## Figures that the search did not see\n\nThe same valves. Figs. 5 to 7: RMSE of the model for the same measured current, so without what stands between the command and\nthat current; which clutch they show, the paper does not say. The others: the pressure against the target delayed by the dead time.\n\n");
    let valves = ["paper", "clutch-1", "clutch-2"];
    let of = |plan: &str, mode: Option<Mode>| valves.iter().map(|v| record(plans, plan, Some(v), mode)).collect::<Result<Vec<_>, _>>();
    let behind =
        |plan: &str| valves.iter().map(|v| record_on(plans, plan, Some(v), None, behind_the_driver)).collect::<Result<Vec<_>, _>>();
    let (triangles, validation) = (behind("triangle-amplitudes")?, behind("model-validation")?);
    let (ramps, drive) = (of("ramp-hold", None)?, of("drive-800s", Some(Mode::FeedForward))?);
    let (whole, tipin) = (of("drive-800s", None)?, of("tipin", None)?);
    let mut rows: Vec<[String; 5]> = Vec::new();
    let mut add = |what: &str, paper: &str, runs: &[TestRecord], phase: &str, metric: &str| -> Result<(), CliError> {
        let cells = runs.iter().map(|r| number(r, phase, metric).map(|v| format!("{v:.3}"))).collect::<Result<Vec<_>, _>>()?;
        rows.push([what.into(), paper.into(), cells[0].clone(), cells[1].clone(), cells[2].clone()]);
        Ok(())
    };
    for phase in ["shrinking from the low end", "around the middle"] {
        add(&format!("Fig. 5, triangles, {phase}: hyperbolic model"), "0.173", &triangles, phase, "model_rmse")?;
        add("the same: average model", "-", &triangles, phase, "model_rmse_average")?;
    }
    for (figure, phase) in [("Fig. 6, oncoming clutch", "oncoming clutch"), ("Fig. 6, off-going clutch", "off-going clutch")] {
        add(&format!("{figure}: hyperbolic model"), "better", &validation, phase, "model_rmse")?;
        add("the same: average model", "worse", &validation, phase, "model_rmse_average")?;
    }
    add("Fig. 7, ramps with holds: hyperbolic model", "0.207", &validation, "ramps with holds", "model_rmse")?;
    add("Fig. 7: average model", "0.404", &validation, "ramps with holds", "model_rmse_average")?;
    add("ramps and holds, feed-forward: hyperbolic model", "-", &ramps, "hyperbolic model", "rmse")?;
    add("the same: average model", "-", &ramps, "average model", "rmse")?;
    add("drive of 800 s, feed-forward only", "0.436", &drive, "drive", "rmse")?;
    add("drive of 800 s, with feedback", "-", &whole, "drive", "rmse")?;
    add("tip-in (10.5 to 11.5 s of the paper's drive)", "-", &tipin, "tip-in", "rmse")?;
    add("tip-out", "-", &tipin, "tip-out", "rmse")?;
    let _ = writeln!(out, "| [bar] | paper | paper's valve | clutch-1 | clutch-2 |\n|---|---|---|---|---|");
    for row in &rows {
        let _ = writeln!(out, "| {} |", row.join(" | "));
    }
    out.push_str("\nOn the paper's valve the model error is the noise alone, because that valve is the model: it says that the recursion is right.\n\n");
    let error = record(plans, "curve-error", None, None)?;
    let figure = |phase: &str, metric: &str| number(&error, phase, metric).map(|v| format!("{v:.3} bar"));
    out.push_str("## Fig. 10: a curve that is off, simulated\n\nDelay 30 ms, K_P 1, K_I 5, a curve 0.7 bar too high (`plans/curve-error.toml`). The paper shows that the offset goes with feedback.\n\n");
    table(
        out,
        ["", "feed-forward only", "with feedback"],
        &[
            row("offset at the end of the hold", &figure("feed-forward only", "steady_offset")?, figure("with feedback", "steady_offset")?),
            row("RMSE", &figure("feed-forward only", "rmse")?, figure("with feedback", "rmse")?),
        ],
    );
    // One blank line at the end is enough.
    out.truncate(out.trim_end().len());
    out.push('\n');
    Ok(())
}

/// The search for the physics of Table 1: docs/paper-search.md.
fn search(plans: &Path) -> Result<String, CliError> {
    let search = Search::new(plans, &load("paper")?)?;
    let mut out = String::from(SEARCH_HEAD);
    let _ = writeln!(
        out,
        "| causes | parameters | worst miss | values | clutch 1 | clutch 2 | Figs. 5, 5, 7 of clutch 1 | of clutch 2 | off |\n|---|--:|--:|---|---|---|---|---|--:|"
    );
    let fits = search.all(6);
    for most in [4, 5, 6] {
        for fit in fits.iter().filter(|f| f.parameters() == most || (most == 4 && f.parameters() < 4)).take(10) {
            let causes: Vec<&str> = fit.causes.iter().map(|c| c.name()).collect();
            let values: Vec<String> = fit.values.iter().map(|v| format!("{v:.4}")).collect();
            let three = |f: [f64; 3]| f.map(|v| format!("{v:.3}")).join(", ");
            let _ = writeln!(
                out,
                "| {} | {} | {:.0} mbar | {} | {} | {} | {} | {} | {:.0} % |",
                causes.join(", "),
                fit.parameters(),
                1e3 * fit.worst_bar,
                values.join(", "),
                three(fit.figures[0]),
                three(fit.figures[1]),
                three(fit.unseen[0]),
                three(fit.unseen[1]),
                100.0 * fit.off()
            );
        }
    }
    Ok(out)
}

const SEARCH_HEAD: &str = "# What explains the six figures of Table 1

Written by `hil paper --search > docs/paper-search.md`, in some minutes. Every set of causes with at most six parameters that
tells the two clutches apart is fitted to the six figures of Table 1 (0.413, 0.352, 0.312 bar and 0.487, 0.362, 0.345 bar) on
`plans/gain-comparison.toml`, from `valves/paper.toml`. The ten best with at most four parameters, with five and with six; Figs. 5
and 7 (0.173 and 0.207 bar), which the fit does not see, stand beside.
Noise, dead time, lag and the shared zero are one parameter of both clutches; gains and zeros are one of each. Noise and
zeros in bar, dead time and lag in s. Sets of like miss cannot be told apart by these figures. Dead time and lag stand between the
command and the current in the coil; Figs. 5 and 7 are driven by the measured current, so they do not show there. `off`: the
largest miss of these figures, of the nearer clutch.

";
