//! Whether the augmented model is a new one.

use super::diagnosis::Verdict;

/// What a search has come to. Errors are RMS over all readings that count [bar].
#[derive(Debug, Clone, Copy)]
pub struct Outcome {
    /// The verdict.
    pub verdict: Verdict,
    /// Whether there is data of the good valve.
    pub has_good: bool,
    /// Whether a cause is named.
    pub is_named: bool,
    /// Whether a form is corrected, by the record or by data of the good valve.
    pub is_form: bool,
    /// Whether the chosen model has no effect beyond the base.
    pub found_nothing: bool,
    /// Error of the model as given.
    pub given_bar: f64,
    /// Error of that model recalibrated.
    pub refit_bar: f64,
    /// Error of the chosen model.
    pub chosen_bar: f64,
}

impl Outcome {
    /// Whether the model stays as it is given, or as data of the good valve has corrected it; `recalibrates`: how many times smaller an
    /// error has to become.
    ///
    /// A match leaves it: what a few per cent of recalibration gain here, another drive takes back, and what the good valve's own data
    /// have calibrated is not moved by a record in which nothing has changed. Nor is it moved by what nobody understands: new values of
    /// the calibration, or a form that takes next to nothing of it, would stand in for that on this drive only.
    pub fn leaves_the_model(&self, recalibrates: f64) -> bool {
        let moves = |to_bar: f64| self.given_bar > recalibrates * to_bar;
        let as_ever = self.verdict == Verdict::Match && !self.is_named && (self.has_good || !self.is_form);
        let unexplained = self.verdict == Verdict::Unexplained && !self.is_named && (self.found_nothing || !moves(self.chosen_bar));
        as_ever && (self.has_good || !moves(self.refit_bar)) || self.found_nothing && !moves(self.refit_bar) || unexplained
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNEXPLAINED: Outcome = Outcome {
        verdict: Verdict::Unexplained,
        has_good: true,
        is_named: false,
        is_form: false,
        found_nothing: true,
        given_bar: 1.0,
        refit_bar: 0.2,
        chosen_bar: 0.2,
    };

    #[test]
    fn what_nobody_understands_moves_no_model_but_by_a_form_that_takes_most_of_it() {
        assert!(UNEXPLAINED.leaves_the_model(1.3), "a recalibration stands in for it");
        let form = |chosen_bar: f64| Outcome { is_form: true, found_nothing: false, refit_bar: 0.99, chosen_bar, ..UNEXPLAINED };
        assert!(form(0.98).leaves_the_model(1.3) && form(0.78).leaves_the_model(1.3));
        assert!(!form(0.76).leaves_the_model(1.3));
    }

    #[test]
    fn a_match_moves_the_model_by_a_recalibration_that_nothing_contradicts() {
        let as_ever = |has_good: bool, refit_bar: f64| Outcome { verdict: Verdict::Match, has_good, refit_bar, ..UNEXPLAINED };
        assert!(as_ever(true, 0.2).leaves_the_model(1.3));
        assert!(as_ever(false, 0.8).leaves_the_model(1.3) && !as_ever(false, 0.7).leaves_the_model(1.3));
        let of_form = |has_good: bool| Outcome { is_form: true, found_nothing: false, ..as_ever(has_good, 0.2) };
        assert!(of_form(true).leaves_the_model(1.3) && !of_form(false).leaves_the_model(1.3));
    }

    #[test]
    fn a_cause_moves_it() {
        let named = Outcome { verdict: Verdict::PartlyExplained, is_named: true, found_nothing: false, ..UNEXPLAINED };
        assert!(!named.leaves_the_model(1.3));
        // Of single readings alone, nothing moves.
        assert!(Outcome { found_nothing: true, refit_bar: 0.99, ..named }.leaves_the_model(1.3));
    }
}
