//! A diagnosis for a terminal of 80 columns.

use std::fmt::Write;

use crate::diagnose::{Diagnosis, Finding, Verdict, figure, title, uncertainty};
use crate::report::{COLUMNS, fold};

/// The diagnosis as text.
pub fn text(d: &Diagnosis) -> String {
    let mut out = String::new();
    let verdict = match d.verdict {
        Verdict::Match => "MATCH: nothing is wrong",
        Verdict::Explained => "EXPLAINED",
        Verdict::PartlyExplained if d.unexplained.is_none() => "PARTLY EXPLAINED: named, but no model follows it",
        Verdict::PartlyExplained => "PARTLY EXPLAINED: structure remains",
        Verdict::Unexplained => "UNEXPLAINED: no effect of the library carries it",
        Verdict::NotComparable => "NOT COMPARABLE: model and recording do not belong together",
    };
    let _ = writeln!(out, "{} against {}: {verdict}\n", d.recording, d.model);
    paragraph(&mut out, &d.summary, 0);
    if d.verdict == Verdict::NotComparable {
        notes(&mut out, d);
        return out;
    }
    let e = &d.rmse_bar;
    let _ = writeln!(out, "\nRMSE [bar]      all data  held out");
    let _ = writeln!(out, "  as given      {:8.3}  {:8.3}", e.base, e.base_heldout);
    let _ = writeln!(out, "  recalibrated            {:8.3}", e.refit_heldout);
    // That of a discovered term is taken where its search has not looked.
    let unseen = d
        .discovered
        .as_ref()
        .filter(|found| found.in_model)
        .and_then(|found| found.unseen.last())
        .map_or(String::new(), |u| format!("  (unseen {})", u.on));
    let _ = writeln!(out, "  augmented               {:8.3}{unseen}", e.augmented_heldout);
    let _ = writeln!(out, "  sensor noise  {:8.3}", e.noise_floor);
    for (n, f) in d.effects.iter().enumerate() {
        let _ = writeln!(out, "\n{}. {} ({}){}", n + 1, title(&f.id), f.id, if f.is_class { ", or another of its class" } else { "" });
        let _ = writeln!(out, "   {}, share {:.0} %", f.claim.text(), 100.0 * f.share);
        finding(&mut out, f);
    }
    if let Some(found) = &d.discovered {
        let _ = writeln!(out, "\nA term that no effect of the library holds");
        for term in &found.formula {
            paragraph(&mut out, &format!("+ {term}"), 3);
        }
        for f in &found.follows {
            paragraph(&mut out, &format!("{} seen from {} to {}", f.state, figure(f.from, &f.unit), figure(f.to, &f.unit)), 3);
        }
        let _ = writeln!(
            out,
            "   adds {:.3} bar RMS; error {:.3} bar -> {:.3} bar",
            found.adds_bar, found.rmse_without_bar, found.rmse_with_bar
        );
        for u in &found.unseen {
            let _ = writeln!(
                out,
                "   unseen {} of {:.0} s: {:.3} bar -> {:.3} bar, p = {:.4}",
                u.on, u.lasts_s, u.rmse_without_bar, u.rmse_with_bar, u.p_value
            );
        }
    }
    if !d.form.is_empty() {
        let _ = writeln!(out, "\nForm of curve, hysteresis and dynamics: corrections that say nothing of a fault");
        for f in &d.form {
            let _ = writeln!(out, "   {} ({})", title(&f.id), f.id);
            finding(&mut out, f);
        }
    }
    if !d.recalibration.is_empty() {
        let _ = writeln!(out, "\nRecalibrated besides");
        for c in &d.recalibration {
            let _ = writeln!(out, "  {:<12} {:>12} -> {}", c.parameter, figure(c.before, &c.unit), figure(c.after, &c.unit));
        }
    }
    where_it_is(&mut out, d);
    let _ = writeln!(out, "\nTried, alone           BIC  held out [bar]");
    for c in d.candidates.iter().take(8) {
        let held = c.heldout_rmse_bar.map_or("-".into(), |r| format!("{r:.3}"));
        let _ = writeln!(out, "  {:<26}{:>8.0}  {held:>7}{}", c.id, c.bic, if c.rejected_because.is_none() { "  named" } else { "" });
    }
    if let Some(next) = &d.next_experiment {
        let _ = writeln!(out, "\nNext experiment");
        paragraph(&mut out, &next.text, 2);
    }
    notes(&mut out, d);
    out
}

fn notes(out: &mut String, d: &Diagnosis) {
    if !d.notes.is_empty() {
        let _ = writeln!(out, "\nNotes");
        for note in &d.notes {
            paragraph(out, note, 2);
        }
    }
}

fn finding(out: &mut String, f: &Finding) {
    for (name, p) in &f.parameters {
        let level = if p.interval.is_some_and(|(low, high)| low.or(high).is_some()) { " (95 %)" } else { "" };
        let _ = writeln!(out, "   {name:<12} {:>12}  {}{level}", figure(p.value, &p.unit), uncertainty(&f.id, name, p));
    }
    let interval = f.heldout_gain_ci_bar.map_or(String::new(), |(a, b)| format!(" (95 %: {a:.3} to {b:.3})"));
    let _ = writeln!(out, "   held-out gain {:.3} bar{interval}, p = {:.4}", f.heldout_gain_bar, f.p_value);
    if !f.indistinguishable.is_empty() {
        paragraph(out, &format!("explains this record as well: {}", f.indistinguishable.join(", ")), 3);
    }
    paragraph(out, &f.evidence, 3);
}

fn where_it_is(out: &mut String, d: &Diagnosis) {
    if d.place.windows.is_empty() && d.place.regions.is_empty() {
        return;
    }
    let _ = writeln!(out, "\nWhere the model as given errs (share of the squared error)");
    for w in d.place.windows.iter().take(4) {
        let run = w.run.as_ref().map_or(String::new(), |r| format!("{r}: "));
        let _ = writeln!(out, "  {run}{:.1} s to {:.1} s: {:.0} %", w.from_s, w.to_s, 100.0 * w.share);
    }
    for r in d.place.regions.iter().take(4) {
        let _ = writeln!(
            out,
            "  {} {:.3} to {:.3}: {:.0} % on {:.0} % of the samples, mean {:+.3} bar",
            r.variable,
            r.from,
            r.to,
            100.0 * r.share,
            100.0 * r.samples_share,
            r.mean_bar
        );
    }
    if let Some((low, high)) = d.place.band_hz {
        let _ = writeln!(out, "  mostly between {low:.2} Hz and {high:.2} Hz");
    }
}

fn paragraph(out: &mut String, text: &str, indent: usize) {
    for line in fold(text, COLUMNS - indent) {
        let _ = writeln!(out, "{:indent$}{line}", "");
    }
}
