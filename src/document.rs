//! A TOML document that a person wrote: read with exact places, so that a message can underline the wrong token.

use annotate_snippets::{AnnotationKind, Level, Renderer, Snippet};
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Largest document that is read [bytes]; a plan or a model is a few kilobytes.
pub const MAX_BYTES: u64 = 4 << 20;

/// Why a document cannot be used; the text is complete and shows the place.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct DocumentError(pub String);

/// Reads the text of a document, refusing a directory, a file that is not text, an empty and a huge one.
pub fn read(path: &std::path::Path) -> Result<String, DocumentError> {
    if let Some(text) = crate::shipped::text(path) {
        return Ok(text.into());
    }
    let name = path.display();
    let fail = |problem: String| DocumentError(format!("{name}: {problem}"));
    let meta = std::fs::metadata(path).map_err(|e| fail(e.to_string()))?;
    if meta.is_dir() {
        return Err(fail("is a directory; a TOML file is wanted".into()));
    }
    if meta.len() > MAX_BYTES {
        return Err(fail(format!("has {} bytes; at most {MAX_BYTES} are read", meta.len())));
    }
    let bytes = std::fs::read(path).map_err(|e| fail(e.to_string()))?;
    let text = String::from_utf8(bytes).map_err(|e| fail(format!("is not UTF-8 text (byte {})", e.utf8_error().valid_up_to())))?;
    if text.trim().is_empty() {
        return Err(fail("is empty".into()));
    }
    Ok(text)
}

/// Bytes of a table that a person wrote (valves, readings), at most 64 MB.
///
/// # Errors
/// What the system says, or that the file is a directory or too large.
pub fn read_table(path: &std::path::Path) -> Result<Vec<u8>, DocumentError> {
    const MOST: u64 = 64 << 20;
    let fail = |problem: String| DocumentError(format!("{}: {problem}", path.display()));
    let file = std::fs::File::open(path).map_err(|e| fail(e.to_string()))?;
    let mut bytes = Vec::new();
    // One byte more than is read shows that there is more, also where the size is not known before.
    std::io::Read::read_to_end(&mut std::io::Read::take(file, MOST + 1), &mut bytes).map_err(|e| fail(e.to_string()))?;
    if bytes.len() as u64 > MOST { Err(fail(format!("has more than {MOST} bytes; at most so many are read"))) } else { Ok(bytes) }
}

/// Reads `text` as a `T`. Unknown keys, wrong types and wrong units are errors that underline the token.
pub fn parse<T: DeserializeOwned>(text: &str, source_name: &str) -> Result<T, DocumentError> {
    toml::from_str(text).map_err(|error| explain(text, source_name, &error))
}

/// Whether a text is of the wanted kind, by its `schema` key: a file of another kind is not refused for its first strange key.
/// What is no TOML is left to the reader that says where.
pub fn expect_schema(text: &str, source_name: &str, schema: &str, what: &str) -> Result<(), DocumentError> {
    let Ok(table) = text.parse::<toml::Table>() else { return Ok(()) };
    match table.get("schema") {
        Some(toml::Value::String(found)) if found == schema => Ok(()),
        Some(found) => Err(underline_key(text, source_name, "schema", &format!("is {found}; {what} has \"{schema}\""))),
        None => Err(DocumentError(format!("{source_name}: schema: is missing; {what} has \"{schema}\""))),
    }
}

/// What the parser says, with the place underlined and, for a mistyped name, what was probably meant.
pub fn explain(text: &str, source_name: &str, error: &toml::de::Error) -> DocumentError {
    let span = error.span().unwrap_or(0..0);
    // A text that is no TOML and names no schema is none of our files: its lines are nobody's to see.
    let named = text.lines().any(|line| line.trim_start().starts_with("schema"));
    if !named && DeTable::parse(text).is_err() {
        let line = 1 + text[..span.start.min(text.len())].matches('\n').count();
        return DocumentError(format!("{source_name}: line {line}: is not TOML, and has no key `schema`: not a file of this program"));
    }
    let mut message = error.message().to_string();
    // serde names what it found and what it knows: "unknown field `x`, expected one of `a`, `b`".
    let mut names = message.split('`').skip(1).step_by(2);
    if message.starts_with("unknown ")
        && let Some(typed) = names.next()
        && let Some(meant) = nearest(typed, names)
    {
        message = format!("{message}\ndid you mean `{meant}`?");
    }
    if message == "invalid type: unit variant, expected newtype variant" {
        message = "a name with a table is wanted here\nwrite for instance `metric.rmse = {}`".into();
    }
    // A person does not know the names of Rust's types.
    for (theirs, ours) in
        [("f64", "a number"), ("u64", "a whole number"), ("u32", "a whole number"), ("usize", "a whole number"), ("a map", "a table")]
    {
        if let Some(begin) = message.strip_suffix(&format!("expected {theirs}")) {
            message = format!("{begin}expected {ours}");
        }
    }
    if message.ends_with("expected a string") && (message.contains("floating point") || message.contains("integer")) {
        message.push_str("\na number carries its unit, as text: \"0.5 bar\"");
    }
    underline(text, source_name, span, &message)
}

/// Where the value of a dotted key (`curve.range`) stands in the text. The tables of an array are looked through in
/// their order.
pub fn place(text: &str, key: &str) -> Option<std::ops::Range<usize>> {
    fn within(value: &Spanned<DeValue<'_>>, path: &[&str]) -> Option<std::ops::Range<usize>> {
        let Some((first, rest)) = path.split_first() else { return Some(value.span()) };
        match value.get_ref() {
            DeValue::Table(table) => within(table.get(*first)?, rest),
            DeValue::Array(items) => items.iter().find_map(|item| within(item, path)),
            _ => None,
        }
    }
    let path: Vec<&str> = key.split('.').collect();
    let root = DeTable::parse(text).ok()?;
    within(root.get_ref().get(*path.first()?)?, &path[1..])
}

/// `key: problem` with the value of the key underlined, or without a place where the text has no such key.
pub fn underline_key(text: &str, source_name: &str, key: &str, problem: &str) -> DocumentError {
    match place(text, key) {
        Some(span) => underline(text, source_name, span, &format!("{key}: {problem}")),
        None => DocumentError(format!("{source_name}: {key}: {problem}")),
    }
}

/// Where the value of a parameter comes from, if the underlined token is one (`"$high"`).
fn parameter(text: &str, token: &str) -> Option<String> {
    let name = token.trim_matches('"').strip_prefix('$')?;
    let span = place(text, &format!("parameters.{name}"))?;
    let line = 1 + text[..span.start].matches('\n').count();
    Some(format!("`${name}` is a parameter: line {line}, or --set {name}=.."))
}

/// The message with the place in the text underlined, in plain text without colours.
pub fn underline(text: &str, source_name: &str, span: std::ops::Range<usize>, message: &str) -> DocumentError {
    let mut lines = message.lines();
    let title = lines.next().unwrap_or("wrong");
    let mut rest: Vec<&str> = lines.collect();
    let parameter = text.get(span.clone()).and_then(|token| parameter(text, token));
    rest.extend(parameter.as_deref());
    // A span over many lines (a whole table) is shown at its first line.
    let end = text[span.start.min(text.len())..].find('\n').map_or(text.len(), |n| span.start + n);
    let span = span.start.min(text.len())..span.end.min(end).max(span.start.min(text.len()));
    let snippet = Snippet::source(text).path(source_name).annotation(AnnotationKind::Primary.span(span));
    let mut group = Level::ERROR.primary_title(title).element(snippet);
    if !rest.is_empty() {
        group = group.element(Level::HELP.message(rest.join(" ")));
    }
    let rendered = Renderer::plain().render(&[group]);
    // The caller prints its own "error: ".
    DocumentError(rendered.strip_prefix("error: ").unwrap_or(&rendered).to_string())
}

/// The known name that a mistyped one was probably meant to be.
pub fn nearest<'a>(typed: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let ranked = known.into_iter().map(|k| (strsim::osa_distance(typed, k), k));
    ranked.filter(|(d, k)| *d <= 2.max(k.len() / 4)).min().map(|(_, k)| k)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Example {
        #[expect(dead_code, reason = "only parsed")]
        delay: crate::units::Time,
    }

    #[test]
    fn the_wrong_token_is_underlined() {
        let error = parse::<Example>("# a comment\ndelay = \"20 mA\"\n", "x.toml").unwrap_err();
        insta::assert_snapshot!(error.0, @r#"
        `20 mA` is not a time: the unit `mA` is of a current; allowed: s, ms, us, min, h
         --> x.toml:2:9
          |
        2 | delay = "20 mA"
          |         ^^^^^^^
        "#);
        let error = parse::<Example>("delai = \"20 ms\"\n", "x.toml").unwrap_err();
        insta::assert_snapshot!(error.0, @r#"
        unknown field `delai`, expected `delay`
         --> x.toml:1:1
          |
        1 | delai = "20 ms"
          | ^^^^^
          |
          = help: did you mean `delay`?
        "#);
    }

    #[test]
    fn a_key_is_found_in_tables_and_in_arrays_of_tables() {
        let text = "a.b = 1\n[[effect]]\ncreep = { gain = \"1 %\" }\n[[effect]]\nlag.tau = \"2 s\"\n";
        let found = |key: &str| place(text, key).map(|span| &text[span]);
        assert_eq!(found("a.b"), Some("1"));
        assert_eq!(found("effect.lag.tau"), Some("\"2 s\""));
        assert_eq!(found("effect.lag.nothing"), None);
    }

    #[test]
    fn a_parameter_is_traced_to_its_line() {
        let text = "[parameters]\nrise = \"400\"\n\n[x]\nover = \"$rise\"\n";
        insta::assert_snapshot!(underline(text, "x.toml", place(text, "x.over").unwrap(), "no unit").0, @r#"
        no unit
         --> x.toml:5:8
          |
        5 | over = "$rise"
          |        ^^^^^^^
          |
          = help: `$rise` is a parameter: line 2, or --set rise=..
        "#);
    }

    #[test]
    fn a_mistyped_name_finds_its_neighbour() {
        assert_eq!(nearest("setling_time", ["settling_time", "rise_time"]), Some("settling_time"));
        assert_eq!(nearest("xyz", ["settling_time", "rise_time"]), None);
    }
}
