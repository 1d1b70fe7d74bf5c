//! Reads the doc comments of the sources: what rustdoc shows to a programmer, `hil explain` shows to an engineer.

/// A documented name.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Name in the spelling of plans and records: `settling_time`.
    pub name: String,
    /// The type that a field or a variant belongs to, as written.
    pub parent: Option<String>,
    /// What it is: `struct`, `field`, `variant`, `fn`, ...
    pub kind: &'static str,
    /// Other words for it, from `#[doc(alias = "...")]`: those of reports and of the trade.
    pub aliases: Vec<String>,
    /// Its doc comment.
    pub doc: String,
    /// Source file below `src/`.
    pub file: &'static str,
}

/// The doc comment of the file itself.
pub fn module_doc(source: &str) -> String {
    let lines = source.lines().take_while(|l| l.starts_with("//!"));
    lines.map(|l| l.trim_start_matches("//!").trim_start_matches(' ')).collect::<Vec<_>>().join("\n")
}

/// Every public documented item of a file. Tests at its end are not looked at.
pub fn entries(file: &'static str, source: &str) -> Vec<Entry> {
    let mut found = Vec::new();
    let mut doc: Vec<&str> = Vec::new();
    let mut aliases: Vec<String> = Vec::new();
    // Name of the type whose braces are open, and whether it is an enum.
    let mut inside: Option<(String, bool)> = None;
    for line in source.lines().take_while(|l| !l.starts_with("#[cfg(test)]")) {
        let text = line.trim();
        let indent = line.len() - line.trim_start().len();
        if let Some(comment) = text.strip_prefix("///") {
            doc.push(comment.strip_prefix(' ').unwrap_or(comment));
            continue;
        }
        if let Some(list) = text.strip_prefix("#[doc(alias") {
            aliases.extend(list.split('"').skip(1).step_by(2).map(snake));
        }
        if text.starts_with("#[") || text.starts_with("//") {
            continue;
        }
        if line == "}" {
            inside = None;
        }
        let item = item(text, indent, inside.as_ref());
        if let Some((kind, name)) = item {
            if !doc.is_empty() {
                let member = matches!(kind, "field" | "variant");
                let parent = if member { inside.as_ref().map(|i| i.0.clone()) } else { None };
                let aliases = std::mem::take(&mut aliases);
                found.push(Entry { name: snake(name), parent, kind, aliases, doc: clean(&doc), file });
            }
            if matches!(kind, "struct" | "enum" | "trait") && text.ends_with('{') {
                inside = Some((name.to_string(), kind == "enum"));
            }
        }
        doc.clear();
        aliases.clear();
    }
    found
}

fn item<'a>(text: &'a str, indent: usize, inside: Option<&(String, bool)>) -> Option<(&'static str, &'a str)> {
    const KINDS: [&str; 7] = ["struct", "enum", "trait", "fn", "const", "static", "type"];
    let public = text.strip_prefix("pub ").map(|t| t.strip_prefix("const fn ").map_or(t, |_| &t["const ".len()..]));
    if let Some(rest) = public {
        for kind in KINDS {
            if let Some(rest) = rest.strip_prefix(kind).and_then(|r| r.strip_prefix(' ')) {
                return Some((kind, identifier(rest)?));
            }
        }
        let name = identifier(rest)?;
        return (inside.is_some() && rest[name.len()..].starts_with(':')).then_some(("field", name));
    }
    let (_, true) = inside? else { return None };
    let name = identifier(text)?;
    (indent == 4 && name.starts_with(char::is_uppercase)).then_some(("variant", name))
}

fn identifier(text: &str) -> Option<&str> {
    let end = text.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(text.len());
    (end > 0).then(|| &text[..end])
}

/// `SettlingTime`, `settling-time` and `Settling time` as `settling_time`.
pub fn snake(name: &str) -> String {
    let mut out = String::new();
    let letters: Vec<char> = name.trim().chars().collect();
    for (n, c) in letters.iter().copied().enumerate() {
        let before = n.checked_sub(1).map(|p| letters[p]);
        let begins = before.is_some_and(|p| p.is_lowercase() || p.is_ascii_digit())
            || (before.is_some_and(char::is_uppercase) && letters.get(n + 1).is_some_and(|next| next.is_lowercase()));
        if c.is_uppercase() && begins {
            out.push('_');
        }
        out.extend(if matches!(c, '-' | ' ') { '_' } else { c }.to_lowercase());
    }
    // A constant is upper case throughout and has its underscores already.
    if name.chars().all(|c| !c.is_lowercase()) { name.trim().to_lowercase().replace(['-', ' '], "_") } else { out }
}

/// Comment lines as text: links lose their brackets, headings become plain words.
fn clean(lines: &[&str]) -> String {
    let heading = |l: &&str| l.trim_start_matches('#').trim().to_string() + ":";
    let lines = lines.iter().map(|l| if l.starts_with("# ") { heading(l) } else { (*l).to_string() });
    lines.collect::<Vec<_>>().join("\n").replace("[`", "`").replace("`]", "`").replace("Self::", "")
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOURCE: &str = "//! About steps.\n//! Second line.\n\n/// Time to settle.\n///\n/// # Source\n/// A book.\n#[derive(Debug)]\npub struct SettlingTime {\n    /// Half-width, see [`Band`].\n    #[doc(alias(\"tolerance\", \"Half-width\"))]\n    #[serde(default)]\n    pub band: Ratio,\n    hidden: f64,\n}\n\n/// Kinds.\npub enum Kind {\n    /// The first.\n    FirstKind(Inner),\n    /// The second.\n    Second,\n}\n\n/// Not public.\nfn private() {}\n\n/// A limit [A].\npub const LIMIT_A: f64 = 1.0;\n";

    #[test]
    fn public_items_with_their_comments() {
        let found = entries("x.rs", SOURCE);
        let names: Vec<(&str, &str)> = found.iter().map(|e| (e.kind, e.name.as_str())).collect();
        assert_eq!(
            names,
            [
                ("struct", "settling_time"),
                ("field", "band"),
                ("enum", "kind"),
                ("variant", "first_kind"),
                ("variant", "second"),
                ("const", "limit_a")
            ]
        );
        assert_eq!(found[0].doc, "Time to settle.\n\nSource:\nA book.");
        assert_eq!((found[1].parent.as_deref(), found[1].doc.as_str()), (Some("SettlingTime"), "Half-width, see `Band`."));
        assert_eq!((found[1].aliases.join(" "), found[2].aliases.len()), ("tolerance half_width".to_string(), 0));
        assert_eq!(module_doc(SOURCE), "About steps.\nSecond line.");
    }

    #[test]
    fn spellings_of_a_term_are_one() {
        for spelling in ["SettlingTime", "settling-time", "Settling time", "settling_time"] {
            assert_eq!(snake(spelling), "settling_time");
        }
        assert_eq!(snake("LIMIT_A"), "limit_a");
        assert_eq!(snake("NotAStep"), "not_a_step");
    }
}
