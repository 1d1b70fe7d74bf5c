//! The controller as a plan writes it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Spanned;

use super::error::Wrong;
use crate::control::{Addition, ControllerSettings, FeedForwardModel, Gains, Mode, Reference};
use crate::units::{CurrentRate, IntegralGain, Pressure, ProportionalGain};

/// Controller settings; in a phase, only what differs from the plan's.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ControllerFile {
    /// Which parts act: `feed_forward`, `feedback` or `both` (default).
    pub mode: Option<Mode>,
    /// Model that the feed-forward inverts: `hyperbolic` (default) or `average`.
    pub feed_forward: Option<FeedForwardModel>,
    /// Proportional gain K_P; the paper's 1 mA/bar by default.
    #[schemars(with = "Option<ProportionalGain>")]
    pub kp: Option<Spanned<ProportionalGain>>,
    /// Integral gain K_I; the paper's 5 mA/(bar s) by default.
    #[schemars(with = "Option<IntegralGain>")]
    pub ki: Option<Spanned<IntegralGain>>,
    /// Target above which the feedback acts in mode `both`; 6 bar by default, after the fill phase of the paper.
    pub threshold: Option<Pressure>,
    /// Largest rate of the current; none by default.
    #[schemars(with = "Option<CurrentRate>")]
    pub slew: Option<Spanned<CurrentRate>>,
    /// What the feedback compares with: the target `delayed` by the model's dead time and lag (default), or the
    /// `direct` one.
    pub reference: Option<Reference>,
    /// Where the feedback is added: to the `pressure` that is wanted (default), or to the `current` of the feed-forward, as in the
    /// paper.
    pub addition: Option<Addition>,
}

impl ControllerFile {
    /// The settings of a plan that says nothing.
    pub fn defaults(period_s: f64) -> ControllerSettings {
        ControllerSettings {
            mode: Mode::Both,
            feed_forward: FeedForwardModel::Hyperbolic,
            gains: Gains::PAPER,
            threshold_bar: 6.0,
            slew_a_per_s: f64::INFINITY,
            reference: Reference::Delayed,
            addition: Addition::Pressure,
            period_s,
        }
    }

    /// `base` with what is written here.
    pub(super) fn over(&self, base: ControllerSettings) -> Result<ControllerSettings, Wrong> {
        let mut settings = base;
        settings.mode = self.mode.unwrap_or(base.mode);
        settings.feed_forward = self.feed_forward.unwrap_or(base.feed_forward);
        settings.reference = self.reference.unwrap_or(base.reference);
        settings.addition = self.addition.unwrap_or(base.addition);
        settings.threshold_bar = self.threshold.map_or(base.threshold_bar, Pressure::value);
        if let Some(kp) = &self.kp {
            settings.gains.kp_ma_per_bar = not_negative(kp, ProportionalGain::value)?;
        }
        if let Some(ki) = &self.ki {
            settings.gains.ki_ma_per_bar_s = not_negative(ki, IntegralGain::value)?;
        }
        if let Some(slew) = &self.slew {
            settings.slew_a_per_s = not_negative(slew, CurrentRate::value)?;
            if settings.slew_a_per_s == 0.0 {
                return Err(Wrong::new(slew.span(), "a slew of zero would hold the current for ever; it must be positive"));
            }
        }
        Ok(settings)
    }
}

fn not_negative<T: Copy + std::fmt::Display>(quantity: &Spanned<T>, value: impl Fn(T) -> f64) -> Result<f64, Wrong> {
    match value(*quantity.get_ref()) {
        v if v >= 0.0 => Ok(v),
        _ => Err(Wrong::new(quantity.span(), format!("`{}` must not be negative", quantity.get_ref()))),
    }
}
