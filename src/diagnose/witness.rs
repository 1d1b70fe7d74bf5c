//! What data of the good valve that moves more slowly than the record says of another form of the loop.
//!
//! It tells nothing of dynamics as fast as those of the record. But a form of the loop shows at any pace: with one that the good valve has
//! had all along, the model follows a slow sweep about as well as it did without.

use super::against::Against;
use super::criteria::Criteria;
use super::evidence::Evidence;
use super::excerpt::excerpt;
use super::fit::Fitter;
use super::good::together;
use super::model::Model;
use super::{comparable, settled};
use crate::physics::Effect;
use crate::recording::Recording;
use crate::valve::Valve;

/// Data of the good valve that does not speak for the model on the record.
#[derive(Clone, Copy)]
pub struct Witness<'v> {
    /// The recordings; none says nothing.
    pub recordings: &'v [Recording],
    /// The model.
    pub valve: &'v Valve,
}

impl Witness<'_> {
    /// Whether that data denies these values of an effect on the form of the loop: the record, which is off by `record_bar` without it, is
    /// farther off than a good valve is from one drive to the next, and so is the model with it on that data.
    pub fn denies(&self, effect: &'static dyn Effect, values: &[f64], fitter: &Fitter<'_>, record_bar: f64) -> bool {
        let (criteria, floor_bar) = (&fitter.criteria, fitter.floor_bar);
        // What the record may be off by needs no look at that data.
        record_bar > criteria.another_drive * floor_bar
            && self
                .errors_bar(effect, values, fitter.evidence)
                .is_some_and(|errors_bar| denies(criteria, floor_bar, record_bar, errors_bar))
    }

    /// Error of the model on that data without the effect, and with these values of it; the base makes room [bar]. Nothing where the data
    /// cannot be used, or does not belong to the model.
    fn errors_bar(&self, effect: &'static dyn Effect, values: &[f64], record: &Evidence) -> Option<(f64, f64)> {
        let mut evidence = Evidence::read(&together(self.recordings), self.valve).ok()?;
        (evidence.criteria, evidence.remembered) = (record.criteria, record.remembered.clone());
        if evidence.is_slow() || comparable::mistake(&evidence, self.valve).ok()?.is_some() {
            return None;
        }
        let base = Model::base(self.valve).ok()?.on(&evidence);
        let unsettled = settled::unsettled(&mut evidence, &base);
        let fitter = Fitter::without(&evidence, &unsettled);
        let short = excerpt(&fitter, &base, None);
        let looking = short.as_ref().map(|short| fitter.looking_at(short));
        Some(Against::of(looking.as_ref().unwrap_or(&fitter), &base, effect).errors_bar(values))
    }
}

/// Whether data on which the model is off by the first of `errors_bar`, and with an effect by the second, denies the effect, without which
/// a record of this floor is off by `record_bar` [bar].
fn denies(criteria: &Criteria, floor_bar: f64, record_bar: f64, (without_bar, with_bar): (f64, f64)) -> bool {
    let may_be_off_bar = criteria.another_drive * without_bar.max(floor_bar);
    record_bar.min(with_bar) > may_be_off_bar
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_form_is_denied_where_the_record_asks_for_it_and_the_slower_data_will_not_have_it() {
        let denies = |record_bar, errors_bar| denies(&Criteria::default(), 0.03, record_bar, errors_bar);
        assert!(denies(0.3, (0.05, 0.5)));
        assert!(!denies(0.09, (0.05, 0.5)), "a good valve may be as far off on another drive");
        assert!(!denies(0.3, (0.05, 0.09)), "nor is it farther off with that form");
        assert!(!denies(0.05, (0.01, 0.5)), "most of what is left is noise of the record");
    }
}
