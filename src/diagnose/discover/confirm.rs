//! A formula on data that its search has not seen: a second run, or the end of the only one.

use super::super::heldout::HeldOut;
use super::rows::Rows;

/// What a formula must take off the error on unseen data, in parts of it: what takes less may be lost on another drive.
pub const WORTH: f64 = 0.1;
/// Part of its gain on the data of the search that it must show on the unseen data.
const CARRIED: f64 = 0.5;
/// Chance of its gain up to which it is confirmed (one in twenty).
const CONFIRMED: f64 = 0.05;

/// A formula on unseen data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unseen {
    /// Whether that is a run of its own; otherwise the end of the only one.
    pub own_run: bool,
    /// How long it is [s].
    pub lasts_s: f64,
    /// Error without and with the formula [bar].
    pub rmse_bar: (f64, f64),
    /// 95 % interval of the difference over blocks [bar].
    pub gain_ci_bar: Option<(f64, f64)>,
    /// Chance of such a difference by flips of the sign of the blocks' differences.
    pub p_value: f64,
}

/// The formula with these columns on the rows that were held back; nothing where they do not confirm it.
pub fn confirmed(rows: &Rows<'_>, columns: &[Vec<f64>], material_bar: f64) -> Option<Unseen> {
    if columns.is_empty() {
        return None;
    }
    let n = rows.searched;
    let (_, without) = rows.regress(&[], 0..n)?;
    let (_, with) = rows.regress(columns, 0..n)?;
    let held = |left: &[f64]| HeldOut::plain(left[n..].to_vec(), rows.block.clone());
    let (_, gain_ci_bar, p_value) = held(&with).gain_over(&held(&without));
    let rms = |left: &[f64]| rows.of_samples(left.iter().map(|e| e * e).sum::<f64>() / left.len().max(1) as f64);
    let rmse_bar = (rms(&without[n..]), rms(&with[n..]));
    let (gain, claimed) = (rmse_bar.0 - rmse_bar.1, rms(&without[..n]) - rms(&with[..n]));
    let enough = gain >= material_bar && gain >= WORTH * rmse_bar.0 && gain >= CARRIED * claimed;
    (enough && p_value <= CONFIRMED).then_some(Unseen { own_run: rows.own_run, lasts_s: rows.held_s, rmse_bar, gain_ci_bar, p_value })
}
