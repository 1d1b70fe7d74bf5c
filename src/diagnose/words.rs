//! The sentences of a diagnosis.

use super::diagnosis::{Change, Diagnosis, Estimate, Finding, Verdict};
use crate::physics::{Effect, effect};
use crate::units::three_figures;

/// Smaller differences are nobody's concern.
const MOST_DECIMALS: i32 = 6;

/// The title of an effect's manual page, in lower case: `first-order lag`.
pub fn title(id: &str) -> String {
    let doc = effect(id).map(|e| e.doc()).unwrap_or_default();
    doc.lines().next().map_or(id.to_string(), |l| l.trim_start_matches("# ").to_lowercase())
}

/// What speaks for an effect of the course.
pub fn evidence(effect: &dyn Effect, without_bar: f64, with_bar: f64, bic: f64, p_value: f64) -> String {
    let doc = effect.doc();
    let signature = paragraph(&doc, "Signature:");
    format!(
        "without it the error of the fitted model is {without_bar:.3} bar, with it {with_bar:.3} bar (BIC {bic:.0} on effective samples, p = {p_value:.4} over held-out blocks); to be seen as: {signature}"
    )
}

/// The paragraph of a manual page that begins with `heading`, as one line.
pub fn paragraph(doc: &str, heading: &str) -> String {
    let lines = doc.lines().skip_while(|l| !l.starts_with(heading)).take_while(|l| !l.trim().is_empty());
    let text: Vec<&str> = lines.map(str::trim).collect();
    text.join(" ").trim_start_matches(heading).trim().to_string()
}

/// Why a candidate of this gain of BIC is not among the effects; a gain beyond `overwhelming` is no trifle.
pub fn rejected(id: &str, bic: f64, effects: &[Finding], overwhelming: f64) -> String {
    if let Some(f) = effects.iter().find(|f| f.indistinguishable.iter().any(|r| r == id)) {
        return format!("explains this record about as well as {}, which is named", f.id);
    }
    if bic > -10.0 {
        return format!("a recalibration explains the record as well (BIC {bic:+.0})");
    }
    match effects.first() {
        Some(f) => format!("{} explains the record better, and then this adds nothing of worth", f.id),
        None if bic < -overwhelming => {
            "it would take much of the error, but as a name it is denied: it leaves too much, held-out data does not confirm it, or data of the good valve speaks against it or against the calibration beside it".into()
        }
        None => "what it explains is a trifle against noise and accuracy of the model".into(),
    }
}

/// What is said where a recalibration, or another form of the loop beside it, hides that the valve stands apart from its own good data.
pub fn stands_apart(moved: &[Change], beside_form: bool) -> String {
    let moved: Vec<String> =
        moved.iter().map(|c| format!("{} {} instead of {}", c.parameter, figure(c.after, &c.unit), figure(c.before, &c.unit))).collect();
    let by = if moved.is_empty() { String::new() } else { format!(" ({})", moved.join(", ")) };
    let what = if beside_form { "Another form of the loop and a recalibration" } else { "A recalibration" };
    format!(
        "{what} would hide it{by}, but data of the good valve allows none of that size: something has moved the valve, its sensor or its current, and this record does not tell which."
    )
}

/// What is said where a cause is right, and what it does to single readings is a matter of chance or of times of its own; or where the
/// record follows from it, and tells too little of it for others.
fn not_followed(d: &Diagnosis) -> String {
    if let Some(there) = d.other_drives.as_ref().filter(|there| there.is_too_much) {
        return format!(
            "The model follows this record, but the record leaves open what it does on others: about {:.3} bar RMSE, most on {}. Such a drive, diagnosed together with this record, would settle it.",
            there.open_bar, there.most_on
        );
    }
    format!(
        "Nothing else is found to be off, but {:.3} bar RMSE stay. That may come by chance, at times of its own, or from where the valve stood before anybody looked: no model follows it.",
        d.rmse_bar.augmented_heldout
    )
}

/// The answer in one paragraph.
pub fn summary(d: &Diagnosis) -> String {
    let e = &d.rmse_bar;
    let error = format!(
        "The model as given is off by {:.3} bar RMSE; recalibrated {:.3} bar on held-out data; the sensor noise is {:.3} bar.",
        e.base, e.refit_heldout, e.noise_floor
    );
    let named: Vec<String> = d
        .effects
        .iter()
        .map(|f| {
            // What stays at its default says nothing of this valve.
            let told = f.parameters.iter().filter(|(name, p)| !stays_at_default(&f.id, name, p));
            let values: Vec<String> = told.take(3).map(|(name, p)| format!("{name} {}", figure(p.value, &p.unit))).collect();
            let rivals = match f.indistinguishable.as_slice() {
                [] => String::new(),
                rivals => format!("; this record cannot tell it from {}", rivals.iter().map(|r| title(r)).collect::<Vec<_>>().join(" or ")),
            };
            format!("{} ({}{rivals})", title(&f.id), values.join(", "))
        })
        .collect();
    let found = named.join("; ");
    let held = format!("With that the error on held-out data is {:.3} bar.", e.augmented_heldout);
    let rest = d.unexplained.as_ref().map_or(String::new(), |r| {
        let on = match r.depends_on.as_slice() {
            [] => "no variable of the operating point that was looked at".into(),
            some => {
                some.iter().map(|(name, share)| format!("{name} ({:.0} % of its variance)", 100.0 * share)).collect::<Vec<_>>().join(", ")
            }
        };
        format!("{:.3} bar RMS beyond the noise remain; they depend on {on}.", r.rms_bar)
    });
    match d.verdict {
        Verdict::Match => format!("Nothing is wrong beyond noise and the model's own accuracy. {error}"),
        Verdict::Explained => format!("Missing in the model: {found}. {error} {held}"),
        Verdict::PartlyExplained if d.unexplained.is_none() => {
            format!("Missing in the model: {found}. {error} {held} {}", not_followed(d))
        }
        Verdict::PartlyExplained => {
            format!("Missing in the model, among other things: {found}. {error} {held} {rest} I do not know what that is.")
        }
        // Said where it is found.
        Verdict::NotComparable => d.summary.clone(),
        Verdict::Unexplained => format!("Something is missing, but none of the effects in the library explains it. {error} {rest}"),
    }
}

/// Whether a parameter of an effect stays at the value with which a fit does without it.
fn stays_at_default(id: &str, name: &str, estimate: &Estimate) -> bool {
    let default = || effect(id)?.parameters().iter().find(|p| p.name == name)?.default;
    estimate.interval.is_none() && default() == Some(estimate.value)
}

/// How sure a parameter of an effect is: its 95 % interval, or why it has none.
pub fn uncertainty(id: &str, name: &str, estimate: &Estimate) -> String {
    let end = |value: f64| figure(value, &estimate.unit);
    match estimate.interval {
        Some((Some(low), Some(high))) => format!("{} to {}", end(low), end(high)),
        Some((Some(low), None)) => format!("at least {}", end(low)),
        Some((None, Some(high))) => format!("at most {}", end(high)),
        None if stays_at_default(id, name, estimate) => "its default".into(),
        _ => "not carried by this recording".into(),
    }
}

/// A value with a unit that reads well: seconds below one as milliseconds, amperes as milliamperes, ratios as percent.
pub fn figure(value: f64, unit: &str) -> String {
    let round = |v: f64| three_figures(v, MOST_DECIMALS);
    match unit {
        "s" if value.abs() < 1.0 => format!("{} ms", round(1e3 * value)),
        "A" if value.abs() < 1.0 => format!("{} mA", round(1e3 * value)),
        "1" => round(value),
        _ => format!("{} {unit}", round(value)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_would_take_much_and_is_not_named_is_no_trifle() {
        let why = |bic: f64| rejected("reversal_dead_band", bic, &[], 150.0);
        assert!(why(-817.0).contains("is denied") && why(-40.0).contains("trifle") && why(-4.0).contains("a recalibration"));
    }
}
