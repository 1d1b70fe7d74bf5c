//! What a row says against its valve, held against the other valves of the same model.
//!
//! A single recording without data of the good valve cannot tell what the valve has from what the model lacks. A fleet can: what a
//! model lacks it lacks for every valve that it stands for. An effect that only few valves of a model show, with an error that the
//! others have not, is theirs; one that most of them may have is the model's. In the same way a gain or a zero that is new for one
//! valve, and not for the others, is more than a recalibration.

use std::collections::{BTreeMap, BTreeSet};

use super::rate::Rate;
use super::row::{Row, RowEffect, Status};
use crate::diagnose::CALIBRATION;
use crate::physics::EFFECTS;

/// An effect is the model's own where the 95 % interval of the share of its valves that show it reaches half.
const MOST: f64 = 0.5;
/// An error stands apart by so many standard deviations of those of the other valves, on a scale of ratios (three: one valve in 740 by
/// chance, where something has been named beside),
const OFF: f64 = 3.0;
/// (two where a whole group is looked at: one in 44,)
const COMPARED: f64 = 2.0;
/// of at least this ratio,
const LEAST_RATIO: f64 = 1.05;
/// and a recalibration, of which nothing was named, by so many (five: one in two million).
const APART: f64 = 5.0;
/// Of fewer valves than this the spread is not known.
pub const LEAST_VALVES: usize = 10;
/// The standard deviation of a normal spread over its median absolute deviation.
const DEVIATION: f64 = 1.4826;
/// The parameters of a recalibration that a shift of the calibration changes, with what a good calibration may be off by: a diagnosis
/// tells of no less.
const CALIBRATED: [(&str, f64); 2] = [("gain", CALIBRATION.gain), ("offset", CALIBRATION.offset)];
/// How the look of an unknown rest begins.
pub const LOOK: &str = "unknown, ";

/// What counts against each valve of a fleet.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Standing {
    /// Effects and corrections of form that a model lacks, by the model's digest.
    lacking: BTreeMap<String, BTreeSet<String>>,
    /// By how many standard deviations the error of a valve, as given or recalibrated, stands apart from that of the other valves of
    /// the model, by the row's id; of models of too few valves nothing.
    off: BTreeMap<String, f64>,
    /// What stands apart from the other valves of the model beside the effects, by the row's id.
    apart: BTreeMap<String, Vec<RowEffect>>,
}

impl Standing {
    /// Of all rows that have an answer.
    pub fn of(rows: &[Row]) -> Self {
        let mut by_model: BTreeMap<String, Vec<&Row>> = BTreeMap::new();
        for row in rows.iter().filter(|r| r.status == Status::Done) {
            by_model.entry(row.model_key().to_owned()).or_default().push(row);
        }
        let mut standing = Self::default();
        for (model, rows) in by_model.into_iter().filter(|(_, rows)| rows.len() >= LEAST_VALVES) {
            let lacks =
                |r: &Row| r.effects.iter().filter(|e| e.is_lack()).map(|e| e.id.clone()).chain(r.form.clone()).collect::<BTreeSet<_>>();
            let mut shown: BTreeMap<String, usize> = BTreeMap::new();
            rows.iter().flat_map(|r| lacks(r)).for_each(|id| *shown.entry(id).or_default() += 1);
            let most = shown.into_iter().filter(|(_, hits)| Rate::new(*hits, rows.len()).high >= MOST);
            standing.lacking.insert(model.clone(), most.map(|(id, _)| id).collect());
            standing.set_apart(&model, &rows);
        }
        standing
    }

    /// Notes which of the valves of one model stand apart by a new gain or zero, or by an error that a correction of form takes away.
    fn set_apart(&mut self, model: &str, rows: &[&Row]) {
        let off_by = |key: &str| {
            let ln_error = |r: &&Row| r.rmse_bar.get(key).map_or(f64::NAN, |e| e.ln());
            apart(&rows.iter().map(ln_error).collect::<Vec<f64>>(), LEAST_RATIO.ln())
        };
        let changed = |id: &str| RowEffect { id: id.to_owned(), claim: Some("changed".to_owned()), ..RowEffect::default() };
        // Where the model's own zero is off for all of them, only the recalibrated error tells one from another.
        let off: Vec<f64> = off_by("base").into_iter().zip(off_by("refit_heldout")).map(|(given, refit)| given.max(refit)).collect();
        self.off.extend(rows.iter().zip(&off).map(|(row, apart)| (row.id.clone(), *apart)));
        for (row, _) in rows.iter().zip(off).filter(|(_, apart)| *apart > OFF) {
            let own: Vec<RowEffect> = row.form.iter().filter(|id| !self.is_lacking(model, id)).map(|id| changed(id)).collect();
            self.apart.entry(row.id.clone()).or_default().extend(own);
        }
        let Some(shift_id) = EFFECTS.iter().find(|e| e.is_shift_of_calibration()).map(|e| e.id()) else { return };
        for (name, least) in CALIBRATED {
            let moved: Vec<f64> = rows.iter().map(|r| r.recalibration.get(name).map_or(0.0, |c| c.0)).collect();
            for ((row, moved), _) in rows.iter().zip(&moved).zip(apart(&moved, least)).filter(|(_, apart)| apart.abs() > APART) {
                let beside = self.apart.entry(row.id.clone()).or_default();
                if row.effects.iter().chain(beside.iter()).all(|e| e.id != shift_id) {
                    beside.push(changed(shift_id));
                }
                if let Some(shift) = beside.iter_mut().find(|e| e.id == shift_id) {
                    let unit = row.recalibration.get(name).map_or_else(String::new, |c| c.1.clone());
                    shift.parameters.insert(name.to_owned(), (*moved, None, unit));
                }
            }
        }
    }

    /// Whether a model lacks an effect or a correction of form for the valves that it stands for.
    fn is_lacking(&self, model: &str, id: &str) -> bool {
        self.lacking.get(model).is_some_and(|ids| ids.contains(id))
    }

    /// Whether the error of a row stands apart from that of the other valves of its model.
    pub fn is_off(&self, row: &Row) -> bool {
        self.off.get(&row.id).is_some_and(|apart| *apart > OFF)
    }

    /// The effects that count against the valve of a row.
    pub fn causes<'r>(&'r self, row: &'r Row) -> impl Iterator<Item = &'r RowEffect> {
        let model = row.model_key();
        let is_off = self.is_off(row);
        let own = row.effects.iter().filter(move |e| !e.is_lack() || is_off && !self.is_lacking(model, &e.id));
        own.chain(self.apart.get(&row.id).into_iter().flatten())
    }

    /// All that a row shows and that may be more frequent in one group of valves than in the others, with what cannot be told from it:
    /// what counts against the valve, and effects beside a lesser error, since here the group is the evidence; where too few valves
    /// have its model to tell, every effect.
    pub fn shown(&self, row: &Row) -> BTreeSet<String> {
        let is_compared = self.off.get(&row.id).is_none_or(|apart| *apart > COMPARED);
        let mut shown: BTreeSet<String> = self.causes(row).flat_map(RowEffect::ids).cloned().collect();
        if is_compared {
            shown.extend(self.named(row));
        }
        if row.is_open() {
            shown.insert("something unknown".to_owned());
            shown.extend(row.remainder.iter().map(|r| format!("{LOOK}{r}")));
        }
        shown
    }

    /// All that a row names and its model does not lack, with what cannot be told from it, whatever the error.
    pub fn named(&self, row: &Row) -> BTreeSet<String> {
        let model = row.model_key();
        let own = row.effects.iter().filter(|e| !self.is_lacking(model, &e.id));
        own.flat_map(RowEffect::ids).cloned().collect()
    }

    /// Whether something is said to be wrong with the valve of a row.
    pub fn is_faulty(&self, row: &Row) -> bool {
        self.causes(row).next().is_some()
    }

    /// Whether something is missing that no effect carries, and nothing else is said.
    pub fn is_unknown(&self, row: &Row) -> bool {
        !self.is_faulty(row) && row.is_open()
    }
}

/// By how many standard deviations, of `least` at least, each value stands apart from the others.
fn apart(values: &[f64], least: f64) -> Vec<f64> {
    let middle = median(values.to_vec());
    let spread = (DEVIATION * median(values.iter().map(|v| (v - middle).abs()).collect())).max(least);
    values.iter().map(|v| (v - middle) / spread).collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::super::table::example;
    use super::*;

    fn showing(id: usize, effect: Option<&str>) -> Row {
        let mut row = example(&id.to_string());
        row.effects = effect.into_iter().map(|e| RowEffect { id: e.into(), claim: Some("lacks".into()), ..RowEffect::default() }).collect();
        row.rmse_bar.insert("base".into(), if effect == Some("leakage") { 0.9 } else { 0.1 + 0.01 * (id % 5) as f64 });
        row
    }

    #[test]
    fn what_few_valves_of_a_model_show_is_theirs_and_what_most_show_is_the_models() {
        let mut rows: Vec<Row> = (0..20).map(|k| showing(k, if k < 3 { Some("leakage") } else { Some("creep") })).collect();
        rows[10].rmse_bar.insert("base".into(), 0.9);
        let standing = Standing::of(&rows);
        assert_eq!(rows.iter().filter(|r| standing.is_faulty(r)).count(), 3);
        assert!(!standing.is_faulty(&rows[10]), "17 of 20 valves are not all wrong: their model is");
        // What a healthy valve's error is given for a name is the model's as well.
        let mut alike = rows.clone();
        alike[0].rmse_bar.insert("base".into(), 0.12);
        assert!(!Standing::of(&alike).is_faulty(&alike[0]) && Standing::of(&alike).is_faulty(&alike[1]));
        // Of two valves nothing can be said.
        let two = [showing(0, Some("leakage")), showing(1, None)];
        assert!(!Standing::of(&two).is_faulty(&two[0]));
    }

    #[test]
    fn where_all_are_off_by_the_models_zero_the_recalibrated_error_tells() {
        let mut rows: Vec<Row> = (0..20).map(|k| showing(k, (k < 3).then_some("leakage"))).collect();
        for (k, row) in rows.iter_mut().enumerate() {
            row.rmse_bar.insert("base".into(), 2.0 + 0.05 * (k % 5) as f64);
        }
        assert!(!Standing::of(&rows).is_faulty(&rows[0]));
        for (k, row) in rows.iter_mut().enumerate() {
            row.rmse_bar.insert("refit_heldout".into(), if k < 3 { 0.6 } else { 0.1 + 0.01 * (k % 5) as f64 });
        }
        let standing = Standing::of(&rows);
        assert_eq!(rows.iter().filter(|r| standing.is_faulty(r)).count(), 3);
    }

    #[test]
    fn another_models_valves_do_not_speak_for_this_one() {
        let mut rows: Vec<Row> = (0..20).map(|k| showing(k, (k < 8).then_some("leakage"))).collect();
        for row in &mut rows[..8] {
            row.model_sha256 = Some("another".into());
        }
        let standing = Standing::of(&rows);
        assert!(!standing.is_faulty(&rows[0]), "all eight valves of that model show it");
    }

    #[test]
    fn a_correction_of_form_counts_where_few_need_it_and_the_error_stands_apart() {
        let mut rows: Vec<Row> = (0..30).map(|k| showing(k, None)).collect();
        for (k, row) in rows.iter_mut().enumerate() {
            row.rmse_bar.insert("base".into(), 0.1 + 0.01 * (k % 5) as f64);
            row.form = (k < 3).then(|| "reversal_dead_band".into()).into_iter().collect();
        }
        assert!(!Standing::of(&rows).is_faulty(&rows[0]), "its error is like that of the others");
        rows[0].rmse_bar.insert("base".into(), 0.6);
        let standing = Standing::of(&rows);
        assert_eq!(standing.causes(&rows[0]).map(|e| e.id.as_str()).collect::<Vec<_>>(), ["reversal_dead_band"]);
        assert_eq!(rows.iter().filter(|r| standing.is_faulty(r)).count(), 1);
        // Where every valve needs it, it is the model that lacks it.
        rows.iter_mut().for_each(|r| r.form = vec!["reversal_dead_band".into()]);
        assert!(!Standing::of(&rows).is_faulty(&rows[0]));
    }

    #[test]
    fn a_zero_that_stands_apart_from_those_of_the_others_is_a_shift() {
        let mut rows: Vec<Row> = (0..30).map(|k| showing(k, None)).collect();
        for (k, row) in rows.iter_mut().enumerate() {
            row.recalibration.insert("offset".into(), (0.05 * (k % 5) as f64, "bar".into()));
        }
        assert!(!rows.iter().any(|r| Standing::of(&rows).is_faulty(r)));
        rows[7].recalibration.insert("offset".into(), (-0.6, "bar".into()));
        let standing = Standing::of(&rows);
        let causes: Vec<(&str, f64)> = standing.causes(&rows[7]).map(|e| (e.id.as_str(), e.parameters["offset"].0)).collect();
        assert_eq!(causes, [("reference_shift", -0.6)]);
        assert_eq!(rows.iter().filter(|r| standing.is_faulty(r)).count(), 1);
    }
}
