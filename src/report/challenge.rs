//! A challenge as text, Markdown and JSON.

use std::fmt::Write as _;

use serde_json::{Value, json};

use super::sharpened::sharpened;
use crate::challenge::{Answer, Case, Curve, Share, Table, Trial, Verdict, formulation, tabulate, truth_of};

/// What came of a case: a trial, or why there is none.
pub type Outcome = Result<Trial, String>;

/// What is printed before anything is asked.
pub fn head(seed: u64, count: usize, sha256: &str) -> String {
    format!("challenge of {count} concealed valve{}, seed {seed}\nsealed truth: sha256 {sha256}\n", if count == 1 { "" } else { "s" })
}

/// One case, in one line, or in a few where it failed.
pub fn line(number: usize, case: &Case, outcome: &Outcome) -> String {
    let mut text = format!("{number:>3}  {:<11} {}", verdict_of(outcome), concealed(case));
    match outcome {
        Err(words) => {
            let _ = write!(text, "\n          {words}");
        }
        Ok(trial) => {
            let m = trial.misfit;
            let _ = write!(
                text,
                "\n          -> {}: {}; unseen drive {:.3} -> {:.3} bar, healthy twin {:.3} bar{}",
                trial.answer.verdict.name(),
                answered(trial),
                m.base_bar,
                m.augmented_bar,
                m.floor_bar,
                trial.score.recovered.map_or(String::new(), |r| format!(", recovered {r:.2}")),
            );
        }
    }
    if let Some(after) = outcome.as_ref().ok().and_then(|t| t.after.as_ref()) {
        let _ = write!(
            text,
            "\n          with the experiment asked for, {} -> {}: {}; unseen drive {:.3} bar",
            after.score.outcome.name(),
            after.answer.verdict.name(),
            answered(after),
            after.misfit.augmented_bar
        );
    }
    text.push('\n');
    text
}

fn verdict_of(outcome: &Outcome) -> &'static str {
    outcome.as_ref().map_or("ERROR", |t| t.score.outcome.name())
}

fn concealed(case: &Case) -> String {
    let each: Vec<String> = case.effects.iter().map(|e| format!("{} ({})", e.id, formulation(e.id, e.variant))).collect();
    let what = if each.is_empty() { "healthy".to_owned() } else { format!("{}, {}", each.join(" + "), case.grade().name()) };
    let how = case.controller.map_or("open loop", |c| c.name());
    let rest =
        format!("{}, {}, {} at {:.0} Hz for {:.0} s", case.anatomy.name(), case.form(), case.drive.name(), case.rate_hz, case.length_s);
    format!("{what}; {rest}, {how}{}", if case.absorbed { ", calibrated with it" } else { "" })
}

fn answered(trial: &Trial) -> String {
    let each: Vec<String> = trial
        .answer
        .effects
        .iter()
        .map(|e| if e.indistinguishable.is_empty() { e.id.clone() } else { format!("{} (or {})", e.id, e.indistinguishable.join(", ")) })
        .collect();
    if each.is_empty() { "nothing named".to_owned() } else { each.join(" + ") }
}

/// `12 of 14 (86 %, 60 to 96 %)`.
fn share(share: Share) -> String {
    match (share.value(), share.wilson()) {
        (Some(value), Some((low, high))) => {
            format!("{} of {} ({:.0} %; {:.0} to {:.0} %)", share.hits, share.of, 100.0 * value, 100.0 * low, 100.0 * high)
        }
        _ => "no case".to_owned(),
    }
}

fn figures(table: &Table, errors: usize) -> Vec<(&'static str, String)> {
    let number = |value: Option<f64>| value.map_or("no case".to_owned(), |v| format!("{v:.2}"));
    vec![
        ("healthy valves accused", share(table.false_alarm)),
        ("wrong name", share(table.wrong_name)),
        ("unknown physics admitted, and no cause named", share(table.unknown_admitted)),
        ("explained, but more than 1.5 x floor left", share(table.explained_too_early)),
        ("augmented model worse on the unseen drive (> 2 %)", share(table.worse)),
        ("healthy valves with the verdict match", share(table.healthy_match)),
        ("single effect named first", share(table.single.named)),
        ("pairs, both named", share(table.pairs)),
        ("credible set holds the truth", share(table.set_holds_truth)),
        ("  its size, median and ninth decile", table.set_size.map_or("no case".to_owned(), |(m, d)| format!("{m:.1}, {d:.1}"))),
        ("95 % intervals that hold what was planted", share(table.intervals)),
        (
            "real over claimed gain: tenth, median, ninth decile",
            table.real_over_claimed.map_or("no case".to_owned(), |(l, m, h)| format!("{l:.2}, {m:.2}, {h:.2}")),
        ),
        ("names beside the concealed ones", table.spurious.to_string()),
        ("misfit recovered on the unseen drive, median", number(table.recovered_median)),
        ("  worst tenth", number(table.recovered_worst_tenth)),
        ("cases without an answer", errors.to_string()),
    ]
}

/// One row of the detection curve.
fn detected(curve: &Curve) -> [String; 5] {
    [curve.named, curve.class, curve.admitted, curve.silent, curve.wrong].map(|s| match s.wilson() {
        Some((low, high)) => format!("{} ({:.0}-{:.0} %)", s.hits, 100.0 * low, 100.0 * high),
        None => "-".to_owned(),
    })
}

const DETECTED: [&str; 5] = ["named first", "in the answer", "admitted", "silent", "wrong"];

fn sums(outcomes: &[Outcome]) -> (Table, usize) {
    (tabulate(outcomes.iter().flatten()), outcomes.iter().filter(|o| o.is_err()).count())
}

/// The table below the cases; nothing for a single case.
pub fn text(outcomes: &[Outcome]) -> String {
    if outcomes.len() < 2 {
        return String::new();
    }
    let (table, errors) = sums(outcomes);
    let mut text = String::from("\n");
    for (name, figure) in figures(&table, errors) {
        let _ = writeln!(text, "{name:<52} {figure}");
    }
    let _ = writeln!(
        text,
        "95 % intervals after Wilson\n\n{:<14}{:>5}  {}",
        "misfit / floor",
        "of",
        DETECTED.map(|d| format!("{d:<16}")).concat().trim_end()
    );
    for (grade, curve) in &table.detection {
        let row = detected(curve).map(|d| format!("{d:<16}")).concat();
        let _ = writeln!(text, "{:<14}{:>5}  {}", grade.name(), curve.named.of, row.trim_end());
    }
    let sharpened = sharpened(outcomes.iter().flatten());
    if !sharpened.is_empty() {
        let _ = writeln!(text, "\n{:<52} {:<14}after", "valves whose diagnosis asked for an experiment", "before");
        for (name, before, after) in sharpened {
            let _ = writeln!(text, "{name:<52} {before:<14}{after}");
        }
    }
    text.push_str("\nconcealed -> named first\n");
    for (truth, named) in &table.confusion {
        let _ = writeln!(text, "{truth:<46} {}", named.iter().map(|(id, n)| format!("{id} {n}")).collect::<Vec<_>>().join(", "));
    }
    text
}

/// Figures, confusion matrix and cases as tables.
pub fn markdown(seed: u64, sha256: &str, outcomes: &[Outcome]) -> String {
    let (table, errors) = sums(outcomes);
    let mut text = format!(
        "Seed {seed}, {} valves, sealed truth SHA-256 `{sha256}`.\n\n| figure | value (95 % interval after Wilson) |\n|---|---|\n",
        outcomes.len()
    );
    for (name, figure) in figures(&table, errors) {
        let _ = writeln!(text, "| {} | {figure} |", name.trim_start());
    }
    let _ = writeln!(text, "\n| misfit over the floor | of | {} |\n|---|---|---|---|---|---|---|", DETECTED.join(" | "));
    for (grade, curve) in &table.detection {
        let _ = writeln!(text, "| {} | {} | {} |", grade.name(), curve.named.of, detected(curve).join(" | "));
    }
    let sharpened = sharpened(outcomes.iter().flatten());
    if !sharpened.is_empty() {
        text.push_str("\n| valves whose diagnosis asked for an experiment | before it | with it |\n|---|---|---|\n");
        for (name, before, after) in sharpened {
            let _ = writeln!(text, "| {name} | {before} | {after} |");
        }
    }
    text.push_str("\n| concealed | named first |\n|---|---|\n");
    for (truth, named) in &table.confusion {
        let _ = writeln!(text, "| {truth} | {} |", named.iter().map(|(id, n)| format!("{id} {n}")).collect::<Vec<_>>().join(", "));
    }
    text.push_str("\n| | concealed | answer | unseen drive, bar: before, after, healthy twin | recovered |\n|---|---|---|---|---|\n");
    for outcome in outcomes {
        let _ = match outcome {
            Ok(t) => writeln!(
                text,
                "| {} | {} | {}: {} | {:.3}, {:.3}, {:.3} | {} |",
                verdict_of(outcome),
                concealed(&t.case),
                t.answer.verdict.name(),
                answered(t),
                t.misfit.base_bar,
                t.misfit.augmented_bar,
                t.misfit.floor_bar,
                t.score.recovered.map_or("-".to_owned(), |r| format!("{r:.2}")),
            ),
            Err(words) => writeln!(text, "| ERROR | | {words} | | |"),
        };
    }
    text
}

/// Everything, `schema: "hil.challenge/1"`.
pub fn json(seed: u64, sha256: &str, cases: &[Case], outcomes: &[Outcome]) -> String {
    let (table, errors) = sums(outcomes);
    let share =
        |s: Share| json!({ "hits": s.hits, "of": s.of, "low": s.wilson().map(|w| digits(w.0)), "high": s.wilson().map(|w| digits(w.1)) });
    let rows: Vec<Value> = cases.iter().zip(outcomes).map(|(case, outcome)| row(case, outcome)).collect();
    let document = json!({
        "schema": "hil.challenge/1",
        "seed": seed,
        "count": outcomes.len(),
        "sealed_sha256": sha256,
        "figures": {
            "false_alarm": share(table.false_alarm),
            "healthy_match": share(table.healthy_match),
            "wrong_name": share(table.wrong_name),
            "some_cause_named": share(table.cause_named),
            "named_first": share(table.single.named),
            "pairs_both_named": share(table.pairs),
            "unknown_admitted": share(table.unknown_admitted),
            "explained_too_early": share(table.explained_too_early),
            "augmented_worse": share(table.worse),
            "set_holds_truth": share(table.set_holds_truth),
            "set_size_median": table.set_size.map(|s| s.0),
            "set_size_ninth_decile": table.set_size.map(|s| s.1),
            "intervals_hold": share(table.intervals),
            "real_over_claimed": table.real_over_claimed.map(|(l, m, h)| [digits(l), digits(m), digits(h)]),
            "spurious": table.spurious,
            "recovered_median": table.recovered_median.map(digits),
            "recovered_worst_tenth": table.recovered_worst_tenth.map(digits),
            "errors": errors,
        },
        "detection": table.detection.iter().map(|(grade, c)| (grade.name().to_owned(), json!({
            "named": share(c.named), "class": share(c.class), "admitted": share(c.admitted), "silent": share(c.silent), "wrong": share(c.wrong),
        }))).collect::<serde_json::Map<_, _>>(),
        "confusion": table.confusion,
        "cases": rows,
    });
    format!("{document:#}\n")
}

fn row(case: &Case, outcome: &Outcome) -> Value {
    let truth = truth_of(case);
    match outcome {
        Err(words) => json!({ "truth": truth, "error": words }),
        Ok(t) => json!({
            "truth": truth,
            "verdict": t.answer.verdict.name(),
            "effects": t.answer.effects.iter().map(|e| json!({ "id": e.id, "indistinguishable": e.indistinguishable })).collect::<Vec<_>>(),
            "rmse_bar": { "base": digits(t.misfit.base_bar), "augmented": digits(t.misfit.augmented_bar), "floor": digits(t.misfit.floor_bar) },
            "outcome": t.score.outcome.name().to_lowercase().replace(' ', "_"),
            "spurious": t.score.spurious,
            "recovered": t.score.recovered.map(digits),
            "after_experiment": t.after.as_ref().map(|after| json!({
                "verdict": after.answer.verdict.name(),
                "effects": after.answer.effects.iter().map(|e| json!({ "id": e.id, "indistinguishable": e.indistinguishable })).collect::<Vec<_>>(),
                "augmented_bar": digits(after.misfit.augmented_bar),
                "outcome": after.score.outcome.name().to_lowercase().replace(' ', "_"),
            })),
        }),
    }
}

/// What was said of recordings that do not belong to the model: how each is broken, and the answer or the refusal.
type BrokenOutcome = (String, Result<Answer, String>);

/// Counts: a cause named, called explained, not comparable, refused, no name, of all.
fn broken_counts(outcomes: &[BrokenOutcome]) -> [(&'static str, Share); 5] {
    let share = |holds: &dyn Fn(&Result<Answer, String>) -> bool| Share {
        hits: outcomes.iter().filter(|o| holds(&o.1)).count(),
        of: outcomes.len(),
    };
    let verdict = |answer: &Result<Answer, String>, v: Verdict| answer.as_ref().is_ok_and(|a| a.verdict == v);
    [
        ("a cause named", share(&|a| a.as_ref().is_ok_and(|a| !a.effects.is_empty()))),
        ("called explained", share(&|a| verdict(a, Verdict::Explained))),
        ("called a match", share(&|a| verdict(a, Verdict::Match))),
        ("not comparable", share(&|a| verdict(a, Verdict::NotComparable))),
        ("refused", share(&|a| a.is_err())),
    ]
}

/// Broken recordings as text or Markdown: what was said of each, and the counts.
pub fn broken_text(outcomes: &[BrokenOutcome], markdown: bool) -> String {
    let said = |answer: &Result<Answer, String>| match answer {
        Err(words) => format!("refused: {words}"),
        Ok(a) => {
            let ids: Vec<&str> = a.effects.iter().map(|e| e.id.as_str()).collect();
            format!("{}{}{}", a.verdict.name(), if ids.is_empty() { "" } else { ": " }, ids.join(" + "))
        }
    };
    let mut text = String::new();
    if markdown {
        text.push_str("| broken recordings | |\n|---|---|\n");
        for (name, count) in broken_counts(outcomes) {
            let _ = writeln!(text, "| {name} | {} |", share(count));
        }
        text.push_str("\n| what was done | what was said |\n|---|---|\n");
        for (how, answer) in outcomes {
            let _ = writeln!(text, "| {how} | {} |", said(answer));
        }
        return text;
    }
    for (how, answer) in outcomes {
        let _ = writeln!(text, "{how:<28} {}", said(answer));
    }
    text.push('\n');
    for (name, count) in broken_counts(outcomes) {
        let _ = writeln!(text, "{name:<28} {}", share(count));
    }
    text
}

/// The same, `schema: "hil.challenge/1"`.
pub fn broken_json(seed: u64, sha256: &str, outcomes: &[BrokenOutcome]) -> String {
    let cases: Vec<Value> = outcomes
        .iter()
        .map(|(how, answer)| match answer {
            Err(words) => json!({ "broken": how, "refused": words }),
            Ok(a) => json!({ "broken": how, "verdict": a.verdict.name(), "effects": a.effects.iter().map(|e| &e.id).collect::<Vec<_>>() }),
        })
        .collect();
    let figures: serde_json::Map<String, Value> =
        broken_counts(outcomes).into_iter().map(|(name, s)| (name.replace(' ', "_"), json!({ "hits": s.hits, "of": s.of }))).collect();
    let document = json!({ "schema": "hil.challenge/1", "seed": seed, "sealed_sha256": sha256, "figures": figures, "cases": cases });
    format!("{document:#}\n")
}

/// Six decimals: beyond them is the arithmetic of the machine.
fn digits(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::challenge::{Concealed, Misfit, Named, placed};

    fn case() -> Case {
        placed(12, vec![Concealed { id: "stiction", variant: 1, severity: 0.4 }])
    }

    fn answer() -> Answer {
        let effects = vec![Named { id: "stiction".into(), indistinguishable: vec!["reversal_dead_band".into()], ..Named::default() }];
        Answer { verdict: Verdict::Explained, effects, form: Vec::new(), claimed_gain_bar: 0.2, with_commission: false }
    }

    fn outcomes() -> Vec<Outcome> {
        let misfit = Misfit { base_bar: 0.25, augmented_bar: 0.1, floor_bar: 0.09 };
        vec![Ok(Trial::new(&case(), answer(), misfit)), Err("diagnose: the recording is too short".into())]
    }

    #[test]
    fn a_case_reads_as_truth_answer_and_what_it_was_worth() {
        insta::assert_snapshot!(line(7, &case(), &outcomes()[0]));
    }

    #[test]
    fn the_table_names_its_intervals_and_its_failures() {
        insta::assert_snapshot!(text(&outcomes()));
    }

    #[test]
    fn of_broken_recordings_the_counts_and_the_words_are_told() {
        let outcomes = [("swapped".to_owned(), Ok(answer())), ("time_in_ms".to_owned(), Err("row 3: backwards".to_owned()))];
        insta::assert_snapshot!(broken_text(&outcomes, false), @r"
        swapped                      explained: stiction
        time_in_ms                   refused: row 3: backwards

        a cause named                1 of 2 (50 %; 9 to 91 %)
        called explained             1 of 2 (50 %; 9 to 91 %)
        called a match               0 of 2 (0 %; 0 to 66 %)
        not comparable               0 of 2 (0 %; 0 to 66 %)
        refused                      1 of 2 (50 %; 9 to 91 %)
        ");
        assert!(broken_text(&outcomes, true).contains("| swapped | explained: stiction |"));
        assert!(broken_json(1, "ab", &outcomes).contains("\"a_cause_named\""));
    }

    #[test]
    fn json_holds_what_the_text_says() {
        let outcomes = outcomes();
        let cases = vec![case(), placed(13, Vec::new())];
        let document: Value = serde_json::from_str(&json(5, "ab", &cases, &outcomes)).unwrap_or_default();
        assert_eq!(document["figures"]["named_first"]["hits"], 1);
        assert_eq!(document["figures"]["errors"], 1);
        assert_eq!(document["detection"]["clear"]["named"]["hits"], 1);
        assert_eq!(document["cases"][0]["recovered"], 0.9375);
        assert_eq!(document["cases"][0]["outcome"], "named");
        assert_eq!(document["cases"][1]["error"], "diagnose: the recording is too short");
    }
}
