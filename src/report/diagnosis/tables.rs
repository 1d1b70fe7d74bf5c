//! Tiles and tables of the page of a diagnosis.

use maud::{Markup, html};

use crate::diagnose::{Cell, Diagnosis, Finding, Remainder, Story, Verdict, figure, paragraph, title, uncertainty};
use crate::physics::effect;

/// The errors that a reader looks for first.
pub fn tiles(d: &Diagnosis) -> Markup {
    let e = &d.rmse_bar;
    let tile = |name: &str, value: f64, note: &str| {
        html! { .tile { .name { (name) } .value { (bar(value)) " " small { "bar" } } .note { (note) } } }
    };
    html! {
        .tiles {
            (tile("model as given", e.base, "RMS error, all data"))
            @if is_fitted(d) { (tile("recalibrated", e.refit_heldout, "RMS error, held-out data")) }
            @if let Some(unseen) = d.discovered.as_ref().and_then(|term| term.unseen.last()) {
                (tile(if d.effects.is_empty() { "with the term" } else { "with what is missing" }, unseen.rmse_with_bar, "RMS error, data that the search has not seen"))
            } @else if !d.effects.is_empty() {
                (tile("with what is missing", e.augmented_heldout, "RMS error, held-out data"))
            }
            (tile("sensor noise", e.noise_floor, "estimated from the readings"))
            @if let Some(share) = recovered(d) {
                .tile { .name { "misfit explained" } .value { (format!("{:.0}", 100.0 * share)) " " small { "%" } } .note { "of what lies above the noise" } }
            }
        }
    }
}

/// Whether anything was fitted: of what does not belong together, nothing is.
pub fn is_fitted(d: &Diagnosis) -> bool {
    d.verdict != Verdict::NotComparable
}

/// An error in mbar, and a large one with five digits.
fn bar(value: f64) -> String {
    let digits = (4 - value.abs().max(1.0).log10().floor() as i32).clamp(0, 3) as usize;
    format!("{value:.digits$}")
}

/// Part of the misfit above the noise that the effects take away.
fn recovered(d: &Diagnosis) -> Option<f64> {
    let e = &d.rmse_bar;
    let above = e.base_heldout - e.noise_floor;
    // With a discovered term the error is that on its unseen part alone.
    (!d.effects.is_empty() && d.discovered.is_none() && above > 0.0)
        .then(|| ((e.base_heldout - e.augmented_heldout) / above).clamp(0.0, 1.0))
}

/// The operating point as strips of cells, darker where the error is larger.
pub fn strips(d: &Diagnosis, story: &Story) -> Markup {
    let noise = d.rmse_bar.noise_floor;
    let worst = story.strips.iter().flat_map(|s| &s.cells).map(|c| c.base_bar).fold(noise, f64::max);
    // Colour grows from the noise to the worst cell.
    let percent = |rms: f64| if worst > noise { (80.0 * (rms - noise) / (worst - noise)).clamp(0.0, 80.0) } else { 0.0 };
    let row = |cells: &[Cell], of: &dyn Fn(&Cell) -> f64| {
        html! { @for cell in cells { td.cell style={ "--p:" (format!("{:.0}", percent(of(cell)))) "%" } { (bar(of(cell))) } } }
    };
    let changed = d.adds();
    let most = story.strips.iter().map(|s| s.cells.len()).max().unwrap_or_default();
    html! {
        .card.scroll {
            p { b { "RMS error [bar] over the operating point" } ", ranges of equal count; the stronger the colour, the larger the error." }
            table.heat {
                colgroup { col style="width:16%"; col style="width:9%"; }
                @for strip in &story.strips {
                    @let missing = most.saturating_sub(strip.cells.len());
                    tbody style={ "--cells:" (most) } {
                        tr {
                            th.name rowspan=(if changed { 3 } else { 2 }) { (strip.label) }
                            th.model { "as given" }
                            (row(&strip.cells, &|c| c.base_bar))
                            @for _ in 0..missing { td {} }
                        }
                        @if changed {
                            tr {
                                th.model { "after" }
                                (row(&strip.cells, &|c| c.augmented_bar))
                                @for _ in 0..missing { td {} }
                            }
                        }
                        tr {
                            th.model {}
                            @for cell in &strip.cells { td.from { (short(cell.from)) " \u{2026} " (short(cell.to)) } }
                            @for _ in 0..missing { td {} }
                        }
                    }
                }
            }
        }
    }
}

/// Three significant digits.
fn short(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let digits = (2 - value.abs().log10().floor() as i32).clamp(0, 4) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}

/// One effect: its parameters, its gain, what speaks for it, what to check.
pub fn finding(n: usize, f: &Finding) -> Markup {
    let known = effect(&f.id);
    let doc = known.map(|e| e.doc()).unwrap_or_default();
    let what = paragraph(&doc, "What it is:");
    let meaning = |name: &str| known.and_then(|e| e.parameters().iter().find(|p| p.name == name)).map_or("", |p| p.meaning);
    html! {
        .card {
            h3 style="margin-top:0" { (n) ". " (title(&f.id)) " " span.soft { "(" code { (f.id) } ")" @if f.is_class { " or another of its class" } } }
            p { b { (f.claim.text()) } (format!(", posterior share {:.0} %.", 100.0 * f.share)) }
            @if !what.is_empty() { p { (sentence(&what)) } }
            .scroll { table {
                thead { tr { th { "parameter" } th.num { "value" } th { "95 % interval" } th { "meaning" } } }
                tbody {
                    @for (name, p) in &f.parameters {
                        tr { td { code { (name) } } td.num { (figure(p.value, &p.unit)) } td { (uncertainty(&f.id, name, p)) } td.soft { (meaning(name)) } }
                    }
                }
            } }
            p { b { "Evidence: " } (f.evidence.trim_end_matches('.')) "." }
            p { b { "Gain on held-out data: " } (format!("{:.3} bar", f.heldout_gain_bar))
                @if let Some((low, high)) = f.heldout_gain_ci_bar { (format!(" (95 %: {low:.3} to {high:.3} bar)")) }
                (format!(", p = {:.4}.", f.p_value)) }
            @if !f.indistinguishable.is_empty() {
                p { b { "Explains this recording as well: " }
                    @for (k, id) in f.indistinguishable.iter().enumerate() { @if k > 0 { ", " } (title(id)) " (" code { (id) } ")" } "." }
            }
        }
    }
}

/// First letter large.
fn sentence(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// What the fit moved in the base.
pub fn recalibration(d: &Diagnosis) -> Markup {
    html! {
        h2 { "Recalibrated besides" }
        .card.scroll {
            p.soft { "Parameters that the model already has; new values are a finding, but no missing physics." }
            table {
                thead { tr { th { "parameter" } th.num { "as given" } th.num { "after the fit" } } }
                tbody { @for c in &d.recalibration { tr { td { (c.parameter) } td.num { (figure(c.before, &c.unit)) } td.num { (figure(c.after, &c.unit)) } } } }
            }
        }
    }
}

/// What no effect carries.
pub fn remainder(rest: &Remainder) -> Markup {
    html! {
        .card {
            p { b { (format!("{:.3} bar RMS", rest.rms_bar)) } " beyond the noise are carried by no effect of the library. No name is given, because none fits." }
            @if rest.depends_on.is_empty() {
                p { "They depend on none of the variables of the operating point that were looked at." }
            } @else {
                p { "They depend on "
                    @for (k, (name, share)) in rest.depends_on.iter().enumerate() { @if k > 0 { ", " } code { (name) } (format!(" ({:.0} % of their variance)", 100.0 * share)) }
                    "." }
            }
            @if rest.table_heldout_gain_bar > 0.0 {
                p { (format!("A plain table over the strongest variable lowers the held-out error by {:.3} bar: that much is repeatable.", rest.table_heldout_gain_bar)) }
            }
            @if !rest.windows.is_empty() {
                p { "Most of it lies at "
                    @for (k, w) in rest.windows.iter().take(5).enumerate() {
                        @if k > 0 { ", " } @if let Some(run) = &w.run { (run) ": " } (format!("{:.1} s to {:.1} s ({:.0} %)", w.from_s, w.to_s, 100.0 * w.share))
                    } "." }
            }
        }
    }
}

/// All candidates with what each would gain.
pub fn candidates(d: &Diagnosis) -> Markup {
    let best = d.candidates.iter().map(|c| -c.bic).fold(1.0, f64::max);
    html! {
        .card.scroll {
            p.soft { "Each effect added alone to the recalibrated model. BIC on effective samples: the more negative, the better; a difference of ten is very strong evidence." }
            table.tried {
                thead { tr { th { "effect" } th.num { "BIC" } th { "of the best" } th.num { "held-out RMSE [bar]" } th { "why not" } } }
                tbody {
                    @for c in &d.candidates {
                        tr.named[c.rejected_because.is_none()] {
                            td { (title(&c.id)) }
                            // No fit, no figure.
                            td.num data-of="BIC" { @if c.bic == 0.0 { "-" } @else { (format!("{:.0}", c.bic)) } }
                            td.share { span.gauge { i style={ "width:" (format!("{:.1}", (100.0 * -c.bic / best).clamp(0.0, 100.0))) "%" } {} } }
                            td.num data-of="bar" { (c.heldout_rmse_bar.map_or_else(|| "-".to_string(), |r| format!("{r:.3}"))) }
                            td.why { (c.rejected_because.as_deref().unwrap_or("named")) }
                        }
                    }
                }
            }
        }
    }
}

/// The errors on held-out data.
pub fn errors(d: &Diagnosis) -> Markup {
    let e = &d.rmse_bar;
    let row = |name: &str, all: Option<f64>, held: Option<f64>| {
        let text = |v: Option<f64>| v.map_or_else(String::new, |v| format!("{v:.4}"));
        html! { tr { td { (name) } td.num { (text(all)) } td.num { (text(held)) } } }
    };
    html! {
        .card.scroll {
            p.soft { "Every stretch of the recording is held out once: the parameters are fitted on the others, the error is taken on it." }
            table {
                thead { tr { th { "model" } th.num { "all data: RMSE [bar]" } th.num { "held out: RMSE [bar]" } } }
                tbody {
                    (row("as given", Some(e.base), Some(e.base_heldout)))
                    (row("recalibrated, nothing added", None, Some(e.refit_heldout)))
                    @if let Some(term) = &d.discovered {
                        (row("with the term, on all data that it was fitted to", Some(term.rmse_with_bar), None))
                        @for u in &term.unseen {
                            (row(&format!("without it, on the {} that its search has not seen", u.on), None, Some(u.rmse_without_bar)))
                            (row(&format!("with it, on the {} that its search has not seen", u.on), None, Some(u.rmse_with_bar)))
                        }
                    } @else if !d.effects.is_empty() {
                        (row("with what is missing", None, Some(e.augmented_heldout)))
                    }
                    (row("sensor noise", Some(e.noise_floor), None))
                }
            }
        }
    }
}

/// What to check on the bench, and which experiment would decide; `is_foreign`: of a model that is not ours.
pub fn next(d: &Diagnosis, is_foreign: bool) -> Markup {
    html! {
        .card {
            @for f in &d.effects {
                @let check = paragraph(&effect(&f.id).map(|e| e.doc()).unwrap_or_default(), "What to check on the bench:");
                @if !check.is_empty() { p { b { "Bench, for " (title(&f.id)) ": " } (check) } }
            }
            @for id in d.effects.iter().flat_map(|f| &f.indistinguishable) {
                @let check = paragraph(&effect(id).map(|e| e.doc()).unwrap_or_default(), "What to check on the bench:");
                @if !check.is_empty() { p { b { "And in case it is " (title(id)) ": " } (check) } }
            }
            @if let Some(next) = &d.next_experiment {
                p { b { "Next experiment: " } (next.text) " " code { "--next-plan FILE" } " writes it as a plan." }
            }
            @match d.verdict {
                Verdict::Match => p { "Nothing. The model may be used as it is." },
                Verdict::Explained if is_foreign => p { "Put what was found about the model (" code { "-o FILE" } ", then " code { "hil export" } "), or mend the model, or the valve, and record again." },
                Verdict::Explained => p { "Use the augmented model (" code { "-o FILE" } ") for simulation, margins and tuning, or mend the valve and record again." },
                Verdict::NotComparable => p { "Mend what the answer names and diagnose again." },
                Verdict::PartlyExplained | Verdict::Unexplained => p { "Look at the stretches with the largest error above; record the same drive again: what comes back is in the valve, what does not is in the day or the bench." },
            }
        }
    }
}
