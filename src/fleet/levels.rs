//! The parameters of what counts against valves, group by group: whether one lot has more of it than another.

use std::collections::BTreeMap;

use super::findings::groups;
use super::row::{Row, Status};
use super::standing::Standing;
use crate::batch::statistics::{Interval, sample};

/// Groups of fewer valves with a parameter than this are not told: their mean says next to nothing.
const LEAST: usize = 3;

/// A parameter in one group.
#[derive(Debug, Clone, PartialEq)]
pub struct Level {
    /// Effect and parameter.
    pub parameter: String,
    /// Its unit.
    pub unit: String,
    /// The free column that groups.
    pub column: String,
    /// Its value.
    pub group: String,
    /// Valves of the group with the parameter.
    pub count: usize,
    /// Their mean.
    pub mean: f64,
    /// Its 95 % interval (Student's t).
    pub interval: Interval,
}

/// Each parameter of each cause in each group that has it three times or more, by parameter, column and group.
pub fn levels(rows: &[Row], standing: &Standing) -> Vec<Level> {
    let rows: Vec<&Row> = rows.iter().filter(|r| r.status == Status::Done).collect();
    let mut out = Vec::new();
    for (column, groups) in groups(&rows) {
        for (group, members) in groups {
            let mut values: BTreeMap<(String, &String), Vec<f64>> = BTreeMap::new();
            for effect in members.iter().flat_map(|m| standing.causes(rows[*m])) {
                for (name, (value, _, unit)) in &effect.parameters {
                    values.entry((format!("{} {name}", effect.id), unit)).or_default().push(*value);
                }
            }
            for ((parameter, unit), values) in values.into_iter().filter(|(_, v)| v.len() >= LEAST) {
                if let Some(s) = sample(&values).value {
                    let (count, mean, interval) = (s.count, s.mean, s.mean_interval);
                    out.push(Level { parameter, unit: unit.clone(), column: column.clone(), group: group.clone(), count, mean, interval });
                }
            }
        }
    }
    out.sort_by(|a, b| (&a.parameter, &a.column, &a.group).cmp(&(&b.parameter, &b.column, &b.group)));
    out
}

#[cfg(test)]
mod tests {
    use super::super::row::RowEffect;
    use super::super::table::example;
    use super::*;

    #[test]
    fn a_parameter_has_a_level_in_each_group_that_shows_it() {
        let leak = |k: usize, lot: &str| {
            let mut row = example(&k.to_string());
            row.tags = [("lot".to_owned(), lot.to_owned())].into();
            let parameters = [("loss".to_owned(), (1.0 + (k % 3) as f64, None, "bar".to_owned()))].into();
            row.effects = vec![RowEffect { id: "leakage".into(), parameters, ..RowEffect::default() }];
            row
        };
        let mut rows: Vec<Row> = (0..6).map(|k| leak(k, "A")).chain((6..8).map(|k| leak(k, "B"))).collect();
        rows.push(Row { effects: Vec::new(), ..leak(8, "B") });
        let found = levels(&rows, &Standing::of(&rows));
        assert_eq!(found.len(), 1, "two values of lot B are too few: {found:?}");
        let level = &found[0];
        assert_eq!((level.parameter.as_str(), level.group.as_str(), level.count, level.mean), ("leakage loss", "A", 6, 2.0));
        // 2.571 = t(0.975, 5); the deviation of 1, 2, 3, 1, 2, 3 is 0.894.
        assert!((level.interval.high - 2.0 - 2.5706 * 0.8944 / 6.0_f64.sqrt()).abs() < 1e-3, "{level:?}");
    }
}
