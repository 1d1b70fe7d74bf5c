//! A verdict as the page shows it.

use maud::{Markup, html};

use crate::record::Outcome;

/// A verdict in its colour.
pub fn badge(verdict: &str, big: bool) -> Markup {
    html! { span.badge.(verdict.to_lowercase().replace(['_', ' '], "-")).big[big] { (verdict.replace('_', " ")) } }
}

/// The class of a table row.
pub(super) fn row_class(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Pass | Outcome::NotRun => "",
        Outcome::Marginal => "marginal",
        Outcome::Fail | Outcome::Invalid | Outcome::Error | Outcome::Aborted => "fail",
    }
}
