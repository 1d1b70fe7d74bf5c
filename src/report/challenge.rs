//! A challenge as text, Markdown and JSON.

use std::fmt::Write as _;

use serde_json::{Value, json};

use crate::challenge::{Case, Share, Table, Trial, formulation, tabulate, truth_of};

/// What came of a case: a trial, or why there is none.
pub type Outcome = Result<Trial, String>;

/// What is printed before anything is asked.
pub fn head(seed: u64, count: usize, sha256: &str) -> String {
    format!("challenge of {count} concealed valve{}, seed {seed}\nsealed truth: sha256 {sha256}\n", if count == 1 { "" } else { "s" })
}

/// One case, in one line, or in a few where it failed.
pub fn line(number: usize, case: &Case, outcome: &Outcome) -> String {
    let mut text = format!("{number:>3}  {:<5} {}", verdict_of(outcome), concealed(case));
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
    text.push('\n');
    text
}

fn verdict_of(outcome: &Outcome) -> &'static str {
    match outcome {
        Err(_) => "ERROR",
        Ok(t) if t.score.right => "right",
        Ok(t) if t.score.in_class => "class",
        Ok(_) => "MISS",
    }
}

fn concealed(case: &Case) -> String {
    let each: Vec<String> = case
        .effects
        .iter()
        .map(|e| format!("{} ({}{})", e.id, formulation(e.id, e.variant), if e.severity < 0.9 { ", faint" } else { "" }))
        .collect();
    let what = if each.is_empty() { "healthy".to_owned() } else { each.join(" + ") };
    let how = if case.closed { "closed loop" } else { "open loop" };
    format!("{what}; {how}{}", if case.absorbed { ", calibrated with it" } else { "" })
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
        ("single effect named first", share(table.named_first)),
        ("  clear", share(table.named_clear)),
        ("  faint", share(table.named_faint)),
        ("named, or in a class of at most three", share(table.in_class)),
        ("pairs, both named", share(table.pairs)),
        ("healthy valves left alone", share(table.healthy_left_alone)),
        ("unknown effects admitted", share(table.unknown_admitted)),
        ("false names beside the concealed ones", table.spurious.to_string()),
        ("misfit recovered on the unseen drive, median", number(table.recovered_median)),
        ("  worst tenth", number(table.recovered_worst_tenth)),
        ("cases without an answer", errors.to_string()),
    ]
}

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
        let _ = writeln!(text, "{name:<46} {figure}");
    }
    text.push_str("95 % intervals after Wilson\n\nconcealed -> named first\n");
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
            "named_first": share(table.named_first),
            "named_first_clear": share(table.named_clear),
            "named_first_faint": share(table.named_faint),
            "in_class": share(table.in_class),
            "pairs_both_named": share(table.pairs),
            "healthy_left_alone": share(table.healthy_left_alone),
            "unknown_admitted": share(table.unknown_admitted),
            "spurious": table.spurious,
            "recovered_median": table.recovered_median.map(digits),
            "recovered_worst_tenth": table.recovered_worst_tenth.map(digits),
            "errors": errors,
        },
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
            "right": t.score.right,
            "in_class": t.score.in_class,
            "spurious": t.score.spurious,
            "recovered": t.score.recovered.map(digits),
        }),
    }
}

/// Six decimals: beyond them is the arithmetic of the machine.
fn digits(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::challenge::{Answer, Concealed, Misfit, Named, Verdict, placed, score};

    fn outcomes() -> Vec<Outcome> {
        let case = placed(12, vec![Concealed { id: "stiction", variant: 1, severity: 0.4 }]);
        let effects = vec![Named { id: "stiction".into(), indistinguishable: vec!["reversal_dead_band".into()] }];
        let answer = Answer { verdict: Verdict::Explained, effects };
        let misfit = Misfit { base_bar: 0.25, augmented_bar: 0.1, floor_bar: 0.09 };
        let score = score(&case, &answer, Some(misfit));
        vec![Ok(Trial { case, answer, misfit, score }), Err("diagnose: the recording is too short".into())]
    }

    #[test]
    fn a_case_reads_as_truth_answer_and_what_it_was_worth() {
        let case = placed(12, vec![Concealed { id: "stiction", variant: 1, severity: 0.4 }]);
        insta::assert_snapshot!(line(7, &case, &outcomes()[0]), @r"
        7  right stiction (mass on a spring with Coulomb friction after Karnopp, faint); closed loop
                -> explained: stiction (or reversal_dead_band); unseen drive 0.250 -> 0.100 bar, healthy twin 0.090 bar, recovered 0.94
        ");
    }

    #[test]
    fn the_table_names_its_intervals_and_its_failures() {
        insta::assert_snapshot!(text(&outcomes()), @r"
        single effect named first                      1 of 1 (100 %; 21 to 100 %)
          clear                                        no case
          faint                                        1 of 1 (100 %; 21 to 100 %)
        named, or in a class of at most three          1 of 1 (100 %; 21 to 100 %)
        pairs, both named                              no case
        healthy valves left alone                      no case
        unknown effects admitted                       no case
        false names beside the concealed ones          0
        misfit recovered on the unseen drive, median   0.94
          worst tenth                                  0.94
        cases without an answer                        1
        95 % intervals after Wilson

        concealed -> named first
        stiction                                       stiction 1
        ");
    }

    #[test]
    fn json_holds_what_the_text_says() {
        let outcomes = outcomes();
        let cases = vec![placed(12, vec![Concealed { id: "stiction", variant: 1, severity: 0.4 }]), placed(13, Vec::new())];
        let document: Value = serde_json::from_str(&json(5, "ab", &cases, &outcomes)).unwrap_or_default();
        assert_eq!(document["figures"]["named_first"]["hits"], 1);
        assert_eq!(document["figures"]["errors"], 1);
        assert_eq!(document["cases"][0]["recovered"], 0.9375);
        assert_eq!(document["cases"][1]["error"], "diagnose: the recording is too short");
    }
}
