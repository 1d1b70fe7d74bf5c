//! The term that no effect of the library holds, on the page of a diagnosis.

use maud::{Markup, html};

use crate::diagnose::{Discovery, figure};

/// The formula, where it acts, and what it is worth on data that its search has not seen.
pub fn discovered(d: &Discovery) -> Markup {
    let bar = |value: f64| format!("{value:.3}");
    html! {
        .card {
            p { "What the error follows, not why. The pressure of the model, and to it" }
            ul { @for term in &d.formula { li { code { (term) } } } }
            p { (format!("It adds {:.3} bar RMS. Tried were {} smooth functions of one or two states; where there is nothing to find, the best of so many is as good with a chance of {:.3}.", d.adds_bar, d.tried, d.p_value)) }
            table {
                thead { tr { th { "Where it acts" } th { "seen from" } th { "to" } } }
                tbody { @for f in &d.follows { tr { td { code { (f.state) } } td { (figure(f.from, &f.unit)) } td { (figure(f.to, &f.unit)) } } } }
            }
            p.soft {
                "Beyond that range a state counts as the end of it."
                @if !d.in_model { " The augmented model is without the term: a second recording has to confirm it first." }
            }
            table {
                thead { tr { th { "Error [bar]" } th { "without" } th { "with" } } }
                tbody {
                    @for u in &d.unseen {
                        tr {
                            td { (if u.on == "run" { "run that the search has not seen" } else { "end that the search has not seen" }) (format!(", {:.0} s", u.lasts_s)) }
                            td { (bar(u.rmse_without_bar)) } td { (bar(u.rmse_with_bar)) }
                        }
                    }
                    tr { td { "all data, fitted to it" } td { (bar(d.rmse_without_bar)) } td { (bar(d.rmse_with_bar)) } }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::{Followed, OnUnseen};

    #[test]
    fn formula_place_and_worth_are_on_it() {
        let found = Discovery {
            text: "A term was found".into(),
            in_model: false,
            formula: vec!["0.8 bar * sin((pressure - 3 bar) / 1.5 bar)".into()],
            follows: vec![Followed { state: "pressure".into(), from: 1.25, to: 21.5, unit: "bar".into() }],
            adds_bar: 0.5123,
            rmse_without_bar: 0.6123,
            rmse_with_bar: 0.2345,
            unseen: vec![OnUnseen {
                on: "end".into(),
                lasts_s: 36.0,
                rmse_without_bar: 0.71,
                rmse_with_bar: 0.31,
                gain_ci_bar: None,
                p_value: 0.001,
            }],
            tried: 187,
            p_value: 0.025,
        };
        let html = discovered(&found).into_string();
        for part in [
            "0.8 bar * sin((pressure - 3 bar) / 1.5 bar)",
            "1.25 bar",
            "21.5 bar",
            "0.512 bar",
            "0.710",
            "0.310",
            "36 s",
            "187",
            "0.025",
            "end that",
            "without the term",
        ] {
            assert!(html.contains(part), "{part}: {html}");
        }
    }
}
