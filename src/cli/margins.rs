//! `hil margins`: how far the pressure loop is from its stability boundary.

use clap::Args;

use super::{CliError, CliResult, exit};
use crate::control::stability::{LoopPlant, Margins, margins};
use crate::control::{Gains, linear_loop};
use crate::units::{FREQUENCY, INTEGRAL_GAIN, PRESSURE_PER_CURRENT, PROPORTIONAL_GAIN, TIME, Unit};

/// Arguments of `hil margins`.
#[derive(Debug, Args)]
#[command(group(clap::ArgGroup::new("plant").args(["model", "gain"]).required(true)))]
pub struct MarginsArgs {
    /// Valve model: its steepest slope, its lag and its delay make the loop.
    #[arg(long, value_name = "VALVE", conflicts_with_all = ["lag", "delay"])]
    model: Option<String>,
    /// Plant gain; a plain number is in bar/mA.
    #[arg(long, value_name = "K", value_parser = gain, requires_all = ["lag", "delay"], allow_hyphen_values = true)]
    gain: Option<f64>,
    /// Plant lag; a plain number is in s.
    #[arg(long, value_name = "S", value_parser = time, requires = "gain", allow_hyphen_values = true)]
    lag: Option<f64>,
    /// Plant delay; a plain number is in s.
    #[arg(long, value_name = "S", value_parser = time, requires = "gain", allow_hyphen_values = true)]
    delay: Option<f64>,
    /// Range of the delay, for instance "10 ms..40 ms"; the model's by default.
    #[arg(long, value_name = "LOW..HIGH", value_parser = time_range)]
    delay_range: Option<(f64, f64)>,
    /// Proportional gain; a plain number is in mA/bar.
    #[arg(long, value_name = "X", value_parser = kp, allow_hyphen_values = true)]
    kp: f64,
    /// Integral gain; a plain number is in mA/(bar s).
    #[arg(long, value_name = "Y", value_parser = ki, allow_hyphen_values = true)]
    ki: f64,
    /// Loop rate; a plain number is in Hz.
    #[arg(long, value_name = "HZ", value_parser = rate, default_value = "100", allow_hyphen_values = true)]
    rate: f64,
    /// What is printed.
    #[arg(long, value_enum, default_value_t)]
    format: TextOrJson,
}

/// What is printed on stdout.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum TextOrJson {
    /// For a terminal.
    #[default]
    Text,
    /// One JSON document.
    Json,
}

/// A quantity, or a plain number in `plain`, the unit that the option's help names.
fn quantity(text: &str, unit: &'static Unit, plain: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(_) => unit.parse(&format!("{text} {plain}")),
        Err(_) => unit.parse(text),
    }
    .map_err(|e| e.to_string())
}

fn gain(text: &str) -> Result<f64, String> {
    quantity(text, &PRESSURE_PER_CURRENT, "bar/mA").map(|bar_per_a| bar_per_a * 1e-3)
}

/// A time; a plain number is in s.
pub fn time(text: &str) -> Result<f64, String> {
    quantity(text, &TIME, "s")
}

fn kp(text: &str) -> Result<f64, String> {
    quantity(text, &PROPORTIONAL_GAIN, "mA/bar")
}

fn ki(text: &str) -> Result<f64, String> {
    quantity(text, &INTEGRAL_GAIN, "mA/(bar s)")
}

/// A frequency; a plain number is in Hz.
pub fn rate(text: &str) -> Result<f64, String> {
    quantity(text, &FREQUENCY, "Hz")
}

/// `LOW..HIGH`, both times.
pub fn time_range(text: &str) -> Result<(f64, f64), String> {
    let (low, high) = text.split_once("..").ok_or("LOW..HIGH is wanted, for instance \"10 ms..40 ms\"")?;
    let (low, high) = (time(low.trim())?, time(high.trim())?);
    if low <= high { Ok((low, high)) } else { Err(format!("{low} s is larger than {high} s")) }
}

/// Runs the command.
pub fn run(args: &MarginsArgs) -> CliResult {
    let gains = Gains { kp_ma_per_bar: args.kp, ki_ma_per_bar_s: args.ki };
    let (plant, delay_range_s, left_out) = match &args.model {
        Some(name) => {
            let (valve, _) = super::files::valve(name)?;
            let found = linear_loop(&valve);
            (found.plant, found.delay_range_s, found.left_out)
        }
        None => {
            let value = |v: Option<f64>| v.ok_or_else(|| CliError::usage("--gain, --lag and --delay are wanted, or --model"));
            let plant = LoopPlant { gain_bar_per_ma: value(args.gain)?, lag_s: value(args.lag)?, delay_s: value(args.delay)? };
            (plant, (plant.delay_s, plant.delay_s), Vec::new())
        }
    };
    let found = margins(&plant, args.delay_range.unwrap_or(delay_range_s), gains, args.rate).map_err(CliError::usage)?;
    let text = match args.format {
        TextOrJson::Json => {
            let mut value = serde_json::to_value(&found).map_err(|e| CliError { code: exit::INTERNAL, message: e.to_string() })?;
            value["left_out"] = left_out.into();
            super::to_json(&value)?
        }
        TextOrJson::Text => table(&found, &left_out)?,
    };
    super::print(&text)?;
    Ok(exit::DONE)
}

/// The margins in the lines of a run's report.
fn table(found: &Margins, left_out: &[String]) -> Result<String, CliError> {
    let value = serde_json::to_value(found).map_err(|e| CliError { code: exit::INTERNAL, message: e.to_string() })?;
    let of = &found.of;
    let mut text = format!(
        "loop       k = {} bar/mA, tau = {} s, T_d = {} s ({} .. {} s)\ncontroller K_P = {} mA/bar, K_I = {} mA/(bar s)\n\n",
        of.gain_bar_per_ma, of.lag_s, of.delay_s, of.delay_range_s.0, of.delay_range_s.1, of.kp_ma_per_bar, of.ki_ma_per_bar_s
    );
    for margin in crate::report::format::margins(&value) {
        text += format!("{:<29} {:>20}  {}", margin.name, margin.print(), margin.remark).trim_end();
        text.push('\n');
    }
    text += if found.stable { "\nstable over the whole delay range\n" } else { "\nUNSTABLE somewhere in the delay range\n" };
    if !left_out.is_empty() {
        text += &format!("judged without {}: no place in a linear loop\n", left_out.join(", "));
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_numbers_have_the_unit_of_the_help() {
        assert_eq!(gain("0.04"), Ok(0.04));
        assert_eq!(gain("40 bar/A"), Ok(0.04));
        assert_eq!(time("30 ms"), Ok(0.03));
        assert_eq!(time_range("10 ms..0.04"), Ok((0.01, 0.04)));
        assert!(time_range("40 ms..10 ms").is_err() && time_range("x").is_err());
        insta::assert_snapshot!(kp("1 bar").unwrap_err(), @"`1 bar` is not a proportional gain: the unit `bar` is of a pressure; allowed: mA/bar, A/bar");
    }
}
