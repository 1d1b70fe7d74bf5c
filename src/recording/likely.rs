//! Which column of a foreign log is likely to be which channel: by its name and its unit.

use super::Channel;
use super::mapping::Role;

/// A column as its file names it.
#[derive(Debug, Clone, PartialEq)]
pub struct Named {
    /// The name without its unit.
    pub name: String,
    /// The unit, where the name or the file gives one.
    pub unit: Option<String>,
}

/// Takes a header such as `I_cmd [mA]`, `Druck / bar`, `p (bar)` apart.
pub fn named(header: &str) -> Named {
    let header = header.trim();
    let known = |unit: &str| Role::all().any(|r| r.conversion(unit).is_ok());
    for (open, close) in [('[', ']'), ('(', ')')] {
        if let Some(at) = header.rfind(open)
            && let Some(unit) = header[at + 1..].strip_suffix(close)
        {
            let unit = unit.trim();
            // In round brackets stands much else.
            if open == '[' || known(unit) || unit.contains('/') {
                return Named { name: header[..at].trim().into(), unit: (!unit.is_empty()).then(|| unit.into()) };
            }
        }
    }
    for separator in [" / ", "/", " in ", "_", " "] {
        if let Some((name, unit)) = header.rsplit_once(separator)
            && known(unit.trim())
            && !name.trim().is_empty()
        {
            return Named { name: name.trim().into(), unit: Some(unit.trim().into()) };
        }
    }
    Named { name: header.into(), unit: None }
}

/// Words of a name that speak for a role, English and German, with their weight.
fn words(role: Role) -> &'static [(&'static str, i32)] {
    match role {
        Role::Time => &[("time", 4), ("zeit", 4), ("timestamp", 5), ("t", 3), ("clock", 3), ("uhrzeit", 5), ("sec", 2), ("seconds", 3)],
        Role::Run => &[("run", 3), ("lauf", 3), ("test", 1), ("versuch", 3)],
        Role::Channel(Channel::Current) => &[
            ("current", 3),
            ("strom", 3),
            ("i", 2),
            ("cmd", 2),
            ("command", 2),
            ("set", 1),
            ("soll", 1),
            ("duty", 2),
            ("pwm", 2),
            ("ventilstrom", 4),
        ],
        Role::Channel(Channel::Pressure) => &[
            ("pressure", 3),
            ("druck", 3),
            ("p", 2),
            ("press", 3),
            ("meas", 1),
            ("ist", 1),
            ("act", 1),
            ("actual", 1),
            ("kupplungsdruck", 4),
        ],
        Role::Channel(Channel::Target) => {
            &[("target", 4), ("soll", 2), ("set", 1), ("ref", 2), ("req", 2), ("demand", 2), ("solldruck", 4)]
        }
        Role::Channel(Channel::MeasuredCurrent) => {
            &[("current", 1), ("strom", 1), ("i", 1), ("meas", 2), ("ist", 2), ("act", 2), ("actual", 2)]
        }
        Role::Channel(Channel::OilTemperature) => &[("temp", 3), ("temperature", 3), ("temperatur", 3), ("oil", 1), ("t", 1)],
        Role::Channel(Channel::Supply) => {
            &[("supply", 4), ("pump", 2), ("line", 1), ("system", 2), ("versorgung", 4), ("versorgungsdruck", 5)]
        }
    }
}

/// Words that speak against a role.
fn against(role: Role) -> &'static [&'static str] {
    match role {
        Role::Channel(Channel::Current) => &["meas", "ist", "act", "actual"],
        Role::Channel(Channel::Pressure) => {
            &["target", "soll", "set", "ref", "req", "demand", "supply", "pump", "versorgung", "solldruck", "versorgungsdruck", "cmd"]
        }
        _ => &[],
    }
}

/// Words of which one must be there: a unit alone does not make a second pressure a target, or a second current a measured one.
fn needed(role: Role) -> Option<Vec<&'static str>> {
    match role {
        Role::Channel(Channel::Target | Channel::Supply) => Some(words(role).iter().map(|w| w.0).collect()),
        Role::Channel(Channel::MeasuredCurrent) => Some(against(Role::Channel(Channel::Current)).to_vec()),
        _ => None,
    }
}

/// How much speaks for a column being of a role, and what; 0 where nothing does.
pub fn score(role: Role, column: &Named) -> (i32, String) {
    let mut found: Vec<&str> = Vec::new();
    let lower = column.name.to_lowercase();
    let parts: Vec<&str> = lower.split(|c: char| !c.is_alphanumeric()).filter(|p| !p.is_empty()).collect();
    let mut score = 0;
    for (word, weight) in words(role) {
        // A short word counts alone only; a long one also within another.
        let there = parts.iter().any(|p| p == word || word.len() >= 4 && p.contains(word));
        if there {
            score += weight;
            found.push(word);
        }
    }
    // A word that is part of another one says nothing more.
    let whole = found.iter().filter(|word| !found.iter().any(|other| other != *word && other.contains(**word)));
    let mut why: Vec<String> = whole.map(|word| format!("`{word}` in its name")).collect();
    score -= 3 * against(role).iter().filter(|w| parts.iter().any(|p| p == *w || w.len() >= 5 && p.contains(*w))).count() as i32;
    if column.name.eq_ignore_ascii_case(role.name()) {
        return (100, "its own name".into());
    }
    if needed(role).is_some_and(|words| !words.iter().any(|word| found.contains(word))) {
        return (0, String::new());
    }
    match (&column.unit, role) {
        (_, Role::Run) => {}
        (Some(unit), _) if role.conversion(unit).is_ok() => {
            // A ratio may be a command, and much else.
            let own = role.units().is_some_and(|u| u.spellings.iter().any(|s| s.0 == unit));
            score += if own { 4 } else { 1 };
            why.push(format!("the unit {unit}"));
        }
        // What must be there is shown with a unit that nobody knows, too: a slip of the pen, or a voltage of a sensor.
        (Some(unit), Role::Time | Role::Channel(Channel::Current | Channel::Pressure))
            if !Role::all().any(|r| r.conversion(unit).is_ok()) =>
        {
            score -= 1;
        }
        (Some(_), _) => score -= 6,
        (None, _) => {}
    }
    if score > 0 { (score, why.join(" and ")) } else { (0, String::new()) }
}

/// The columns that are likely to be of a role, best first, with what speaks for each.
pub fn likely(role: Role, columns: &[Named]) -> Vec<(usize, String)> {
    let mut found: Vec<(i32, usize, String)> = columns
        .iter()
        .enumerate()
        .filter_map(|(at, column)| {
            let (score, why) = score(role, column);
            (score >= 2).then_some((score, at, why))
        })
        .collect();
    found.sort_by_key(|(score, at, _)| (-score, *at));
    found.into_iter().map(|(_, at, why)| (at, why)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_are_taken_apart() {
        let of = |text: &str| {
            let n = named(text);
            (n.name, n.unit.unwrap_or_default())
        };
        assert_eq!(of("I_cmd [mA]"), ("I_cmd".into(), "mA".into()));
        assert_eq!(of("Druck / bar"), ("Druck".into(), "bar".into()));
        assert_eq!(of("p (kp/cm2)"), ("p".into(), "kp/cm2".into()));
        assert_eq!(of("pressure_bar"), ("pressure".into(), "bar".into()));
        assert_eq!(of("Engine speed"), ("Engine speed".into(), String::new()));
    }

    #[test]
    fn the_right_column_comes_first() {
        let first = |role: Role, headers: &[&str]| {
            let columns: Vec<Named> = headers.iter().map(|h| named(h)).collect();
            likely(role, &columns).first().map(|f| headers[f.0].to_string())
        };
        let log = [
            "Datum",
            "Zeit",
            "Ventilstrom [mA]",
            "Strom ist [mA]",
            "Solldruck [bar]",
            "\u{d6}ldruck [MPa]",
            "\u{d6}ltemperatur [\u{b0}C]",
            "Versorgungsdruck [bar]",
            "Drehzahl [1/min]",
        ];
        let of = |role| first(role, &log).unwrap();
        assert_eq!(of(Role::Time), "Zeit");
        assert_eq!(of(Role::Channel(Channel::Current)), "Ventilstrom [mA]");
        assert_eq!(of(Role::Channel(Channel::Pressure)), "\u{d6}ldruck [MPa]");
        assert_eq!(of(Role::Channel(Channel::Target)), "Solldruck [bar]");
        assert_eq!(of(Role::Channel(Channel::OilTemperature)), "\u{d6}ltemperatur [\u{b0}C]");
        assert_eq!(of(Role::Channel(Channel::Supply)), "Versorgungsdruck [bar]");
        let english = ["t [ms]", "I_cmd [mA]", "I_meas [mA]", "P_target", "P_clutch [psi]"];
        assert_eq!(first(Role::Channel(Channel::Current), &english).unwrap(), "I_cmd [mA]");
        assert_eq!(first(Role::Channel(Channel::MeasuredCurrent), &english).unwrap(), "I_meas [mA]");
        assert_eq!(first(Role::Channel(Channel::Pressure), &english).unwrap(), "P_clutch [psi]");
        assert_eq!(first(Role::Channel(Channel::Pressure), &["rpm", "gear"]), None);
        let twice = ["Slow/Strom [A]", "Slow/Druck [bar]"];
        for other in [Channel::Target, Channel::Supply, Channel::MeasuredCurrent] {
            assert_eq!(first(Role::Channel(other), &twice), None, "{other:?}");
        }
    }
}
