//! The marks by which the program knows its own files again.

use std::io::Read;
use std::path::Path;

/// Bytes at the head of a file in which its mark stands.
const HEAD: u64 = 4096;

/// The kind of a file that is written, by the mark that it carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// A TOML or JSON document with this `schema`.
    Schema(&'static str),
    /// A page of the program.
    Page,
    /// A kind that carries no mark: CSV, Parquet, MDF, text. It is never replaced without `--force`.
    None,
}

impl Mark {
    /// What stands in the head of every page.
    pub const PAGE: &'static str = "<meta name=\"generator\" content=\"hil\">";

    /// What a file of this kind is called in a message.
    pub fn what(self) -> String {
        match self {
            Self::Schema(schema) => format!("a file with `schema` = \"{schema}\""),
            Self::Page => "a page of this program".into(),
            Self::None => "a file that can be told to be this program's own".into(),
        }
    }

    /// Whether the file at `path` carries this mark.
    pub fn is_on(self, path: &Path) -> bool {
        let mut head = Vec::new();
        let read = std::fs::File::open(path).and_then(|file| file.take(HEAD).read_to_end(&mut head));
        if read.is_err() {
            return false;
        }
        let head = String::from_utf8_lossy(&head);
        match self {
            Self::None => false,
            Self::Page => head.contains(Self::PAGE),
            Self::Schema(schema) => {
                let quoted = format!("\"{schema}\"");
                head.lines().any(|line| {
                    let key = line.trim_start().trim_start_matches('{').trim_start();
                    let key = key.strip_prefix("\"schema\"").or_else(|| key.strip_prefix("schema"));
                    let value = key.map(str::trim_start).and_then(|rest| rest.strip_prefix(['=', ':']));
                    value.is_some_and(|v| v.trim_start().starts_with(&quoted))
                })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mark_is_the_schema_and_not_a_word_in_the_text() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x");
        let on = |mark: Mark, text: &str| {
            std::fs::write(&path, text).unwrap();
            mark.is_on(&path)
        };
        let valve = Mark::Schema("hil.valve/1");
        assert!(on(valve, "# by hand\nschema = \"hil.valve/1\"\n"));
        assert!(on(valve, "{\"schema\":\"hil.valve/1\"}") && on(valve, "{\n  \"schema\": \"hil.valve/1\"\n}"));
        assert!(!on(valve, "schema = \"hil.plan/1\"") && !on(valve, "# not schema = \"hil.valve/1\"") && !on(valve, ""));
        assert!(on(Mark::Page, &format!("<html><head>{}</head>", Mark::PAGE)) && !on(Mark::Page, "<html></html>"));
        assert!(!on(Mark::None, "time_s,current_a\n"));
        assert!(!valve.is_on(&folder.path().join("absent")) && !valve.is_on(folder.path()));
    }
}
