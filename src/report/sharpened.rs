//! What the experiments that a diagnosis asked for have made of its answers.

use crate::challenge::{Outcome, Share, Table, Trial, tabulate};

/// What the experiments have changed, over the trials that asked for one: figure, before, after. Empty where none did.
pub fn sharpened<'t>(trials: impl Iterator<Item = &'t Trial>) -> Vec<(&'static str, String, String)> {
    let pairs: Vec<(&Trial, &Trial)> = trials.filter_map(|t| Some((t, t.after.as_deref()?))).collect();
    if pairs.is_empty() {
        return Vec::new();
    }
    let (before, after) = (tabulate(pairs.iter().map(|p| p.0)), tabulate(pairs.iter().map(|p| p.1)));
    let of_table = |table: &Table, trials: &mut dyn Iterator<Item = &Trial>| {
        let (mut first, mut class, mut total) = (0, 0, 0);
        for t in trials {
            total += 1;
            first += usize::from(matches!(t.score.outcome, Outcome::Named | Outcome::LeftAlone));
            class += usize::from(t.score.outcome == Outcome::Class);
        }
        let count = |s: Share| format!("{} of {}", s.hits, s.of);
        [
            format!("{first} of {total}"),
            format!("{class} of {total}"),
            count(table.wrong_name),
            count(table.false_alarm),
            table.set_size.map_or("-".to_owned(), |s| format!("{:.1}, {:.1}", s.0, s.1)),
            table.recovered_median.map_or("-".to_owned(), |r| format!("{r:.2}")),
            count(table.worse),
        ]
    };
    let names = [
        "named first, or rightly left alone",
        "in the answer, not first",
        "wrong name",
        "healthy valves accused",
        "size of the credible set, median and ninth decile",
        "misfit recovered on the unseen drive, median",
        "augmented model worse on the unseen drive (> 2 %)",
    ];
    let before = of_table(&before, &mut pairs.iter().map(|p| p.0));
    let after = of_table(&after, &mut pairs.iter().map(|p| p.1));
    names.into_iter().zip(before).zip(after).map(|((name, before), after)| (name, before, after)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::challenge::{Answer, Concealed, Misfit, Named, Verdict, placed};

    #[test]
    fn only_valves_that_were_asked_again_count() {
        let case = placed(12, vec![Concealed { id: "creep", variant: 0, severity: 1.0 }]);
        let trial = |id: &str, augmented_bar| {
            let effects = vec![Named { id: id.into(), ..Named::default() }];
            let answer = Answer { verdict: Verdict::Explained, effects, form: Vec::new(), claimed_gain_bar: 0.2, with_commission: false };
            Trial::new(&case, answer, Misfit { base_bar: 0.25, augmented_bar, floor_bar: 0.05 })
        };
        let alone = trial("creep", 0.1);
        assert!(sharpened([&alone].into_iter()).is_empty());
        let asked = Trial { after: Some(Box::new(trial("creep", 0.05))), ..trial("leakage", 0.15) };
        let rows = sharpened([&alone, &asked].into_iter());
        assert_eq!(rows[0], ("named first, or rightly left alone", "0 of 1".into(), "1 of 1".into()));
        assert_eq!(rows[2], ("wrong name", "1 of 1".into(), "0 of 1".into()));
        assert_eq!(rows[5], ("misfit recovered on the unseen drive, median", "0.50".into(), "1.00".into()));
    }
}
