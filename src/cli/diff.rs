//! `hil diff`: what differs between two records, or between two folders of records.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::Args;

use super::batch_diff::is_batch;
use super::diff_format::DiffFormat;
use super::{CliError, CliResult, batch_diff, exit};
use crate::record::{TestRecord, records};
use crate::report::diff::{RecordDiff, Tolerances, compare, different, json, markdown, text};
use crate::units::Unit;

/// What to compare.
#[derive(Debug, Args)]
pub struct DiffArgs {
    /// The record before: a record.json, a run's folder, or a folder of those; or the folder of a batch
    before: PathBuf,
    /// The record after
    after: PathBuf,
    /// How far a metric may move, for instance rmse="5 mbar"; one in the last printed digit where it is not given
    #[arg(long, value_name = "METRIC=VALUE")]
    tolerance: Vec<String>,
    /// How to print the differences
    #[arg(long, value_enum, default_value = "text")]
    format: DiffFormat,
}

/// Prints the differences; the exit code says whether there are any.
pub fn run(args: &DiffArgs) -> CliResult {
    if is_batch(&args.before) && is_batch(&args.after) {
        return batch_diff::run(&args.before, &args.after, args.format);
    }
    if is_batch(&args.before) != is_batch(&args.after) {
        let (batch, other) = if is_batch(&args.before) { (&args.before, &args.after) } else { (&args.after, &args.before) };
        return Err(CliError::usage(format!(
            "{} is a batch and {} is not: a batch is compared with a batch, a record with a record, a folder of records with a folder of records. \
             A valve of the batch that has a folder of its own is a record: {}/valves/SERIAL/attempt-1",
            batch.display(),
            other.display(),
            batch.display()
        )));
    }
    let before = records(&args.before).map_err(CliError::input)?;
    let after = records(&args.after).map_err(CliError::input)?;
    let tolerances = tolerances(&args.tolerance, before.iter().chain(&after).map(|r| &r.1))?;
    let diffs = all(before, after, &tolerances);
    if let [one] = diffs.as_slice()
        && one.before.is_some()
        && one.after.is_some()
        && one.nothing_in_common()
    {
        return Err(CliError::usage(format!(
            "{} and {} have no figure in common: they are records of different plans ({}). \
             `hil compare` draws any two over each other",
            args.before.display(),
            args.after.display(),
            one.notes.first().map_or("of the same name", |n| n.as_str())
        )));
    }
    super::print(&match args.format {
        DiffFormat::Text => text(&diffs),
        DiffFormat::Markdown => markdown(&diffs),
        DiffFormat::Json => json(&diffs),
    })?;
    Ok(if different(&diffs) { exit::NEGATIVE } else { exit::DONE })
}

/// Pairs the records by their place in the folders; two single records are a pair wherever they lie.
fn all(before: Vec<(String, TestRecord)>, after: Vec<(String, TestRecord)>, tolerances: &Tolerances) -> Vec<RecordDiff> {
    if let ([(_, a)], [(_, b)]) = (&before[..], &after[..]) {
        return vec![compare(&format!("{} on {}", b.plan.name, b.dut.serial), Some(a), Some(b), tolerances)];
    }
    let mut pairs: BTreeMap<String, (Option<TestRecord>, Option<TestRecord>)> = BTreeMap::new();
    for (place, record) in before {
        pairs.entry(place).or_default().0 = Some(record);
    }
    for (place, record) in after {
        pairs.entry(place).or_default().1 = Some(record);
    }
    pairs.iter().map(|(place, (a, b))| compare(place, a.as_ref(), b.as_ref(), tolerances)).collect()
}

fn tolerances<'a>(texts: &[String], records: impl Iterator<Item = &'a TestRecord>) -> Result<Tolerances, CliError> {
    let mut units: BTreeMap<&str, &str> = BTreeMap::new();
    for measurement in records.flat_map(|r| &r.phases).flat_map(|p| &p.measurements) {
        units.insert(&measurement.metric, &measurement.unit);
    }
    let mut tolerances = Tolerances::default();
    for text in texts {
        let Some((metric, value)) = text.split_once('=') else {
            return Err(CliError::usage(format!("--tolerance {text}: write METRIC=VALUE, for instance rmse=\"5 mbar\"")));
        };
        let Some(unit) = units.get(metric) else {
            let known: Vec<&str> = units.keys().copied().collect();
            return Err(CliError::usage(format!(
                "--tolerance {text}: no record holds the metric `{metric}`; they hold: {}",
                known.join(", ")
            )));
        };
        let unit = Unit::by_symbol(unit).ok_or_else(|| CliError::usage(format!("--tolerance {text}: the unit `{unit}` is not known")))?;
        let value = unit.parse(value).map_err(|e| CliError::usage(format!("--tolerance {text}: {e}")))?;
        if value < 0.0 {
            return Err(CliError::usage(format!("--tolerance {text}: a tolerance is not negative")));
        }
        tolerances.by_metric.insert(metric.into(), value);
    }
    Ok(tolerances)
}
