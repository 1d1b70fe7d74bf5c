//! How much data of the good valve speaks against an effect with which the record is explained.

use super::descent::Descent;
use super::fit::{Fit, Fitter};
use super::model::Model;
use super::simulator::Simulator;
use crate::physics::Effect;

/// What values of an effect cost on the record [nats].
pub type Price<'p> = &'p dyn Fn(&[f64]) -> f64;

/// Values that are tried between what the record wants and what data of the good valve wants: shares of the way.
const BETWEEN: [f64; 3] = [0.3, 0.6, 1.0];
/// Steps of the fits.
const STEPS: usize = 6;

/// A model of the good valve on its data, without the effect and with it.
pub struct Against<'f, 'a> {
    fitter: &'f Fitter<'f>,
    start: Vec<f64>,
    without: Fit<'a>,
    with: Model<'a>,
}

impl<'f, 'a> Against<'f, 'a> {
    /// Fits the model without it.
    pub fn of(fitter: &'f Fitter<'f>, base: &Model<'a>, effect: &'static dyn Effect) -> Self {
        let start = base.calibrated();
        let without = fitter.polish(base, &start, STEPS);
        Self { fitter, start, without, with: base.with(effect, 0.0) }
    }

    /// Price of the values on that data [nats]; the base may make room for them.
    pub fn at(&self, values: &[f64]) -> f64 {
        self.nats(&self.fit(&self.start, values, true)) - self.nats(&self.without)
    }

    /// The same beside the base that the record has, at no price but that of this data, from which the calibration was made.
    pub fn at_recalibrated(&self, base: &[f64], values: &[f64]) -> f64 {
        let by_data = |fit: &Fit<'_>| self.nats(fit) - fit.prior_nats;
        by_data(&self.fit(base, values, true)) - by_data(&self.without)
    }

    /// Price, here and on the record, of the cheapest of values between those that the record wants and those that this data wants [nats].
    pub fn between(&self, record: &[f64], on_record: Price<'_>) -> f64 {
        let wanted = self.fit(&self.start, record, false).theta.split_off(self.start.len());
        let values = |share: f64| record.iter().zip(&wanted).map(|(a, b)| a + share * (b - a)).collect::<Vec<f64>>();
        BETWEEN.map(values).into_iter().map(|values| self.at(&values) + on_record(&values)).fold(f64::INFINITY, f64::min)
    }

    /// Error on that data without the effect, and with these values of it [bar]; the base makes room for them.
    pub fn errors_bar(&self, values: &[f64]) -> (f64, f64) {
        (self.without.rmse_bar, self.fit(&self.start, values, true).rmse_bar)
    }

    fn nats(&self, fit: &Fit<'_>) -> f64 {
        self.fitter.objective(fit) * self.fitter.effective()
    }

    fn fit(&self, base: &[f64], values: &[f64], is_held: bool) -> Fit<'a> {
        let descent = Descent { held: usize::from(is_held), ..Descent::of(STEPS) };
        self.fitter.polish_in(&mut Simulator::new(self.fitter.evidence), &self.with, &[base, values].concat(), descent)
    }
}
