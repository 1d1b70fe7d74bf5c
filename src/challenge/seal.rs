//! The sealed truth: one text, whose digest is told before anybody is asked.

use super::case::Case;
use super::controller::Controller;
use crate::digest;

/// The truth of a series as text, and its SHA-256.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Seal {
    /// JSON: for each case what is concealed, how, how large, and the seed of its valve (which keeps the digest
    /// from being found by trying all answers).
    pub text: String,
    /// SHA-256 of the text, in hexadecimal digits.
    pub sha256: String,
}

impl Seal {
    /// Seals the truth of a series.
    pub fn new(cases: &[Case]) -> Self {
        let truth = serde_json::json!({ "schema": "hil.challenge.truth/1", "cases": cases.iter().map(truth_of).collect::<Vec<_>>() });
        let text = format!("{truth:#}\n");
        let sha256 = digest::sha256(&text);
        Self { text, sha256 }
    }

    /// Whether a text is the one that was sealed.
    pub fn holds(&self, text: &str) -> bool {
        digest::sha256(text) == self.sha256
    }
}

/// The truth of one case.
pub fn truth_of(case: &Case) -> serde_json::Value {
    serde_json::json!({
        "seed": case.seed,
        "effects": case.ids(),
        "variants": case.effects.iter().map(|e| e.variant).collect::<Vec<_>>(),
        "severities": case.effects.iter().map(|e| e.severity).collect::<Vec<_>>(),
        "grade": case.grade().name(),
        "visible": case.visible,
        "closed": case.closed(),
        "controller": case.controller.map(Controller::name),
        "absorbed": case.absorbed,
        "plant": case.anatomy.name(),
        "family": case.family(),
        "form": case.form(),
        "drive": case.drive.name(),
        "rate_hz": case.rate_hz,
        "length_s": case.length_s,
        "delay_s": case.delay_s(),
        "noise_bar": case.noise_bar(),
        "coloured": case.coloured(),
    })
}

#[cfg(test)]
mod tests {
    use super::super::draw::{Range, draw_series};
    use super::*;

    #[test]
    fn another_truth_breaks_the_seal() {
        let seal = Seal::new(&draw_series(1, 3, Range::default()));
        assert_eq!(seal.sha256.len(), 64);
        assert!(seal.holds(&seal.text));
        assert!(!seal.holds(&seal.text.replacen("false", "true", 1)));
        assert_eq!(seal, Seal::new(&draw_series(1, 3, Range::default())));
    }
}
