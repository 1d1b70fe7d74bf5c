//! What a plan asks a person: to confirm, to read a number, to choose, to write a remark.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Spanned;

use super::bounds::limit;
use super::error::Wrong;
use super::{LimitFile, Source};
use crate::limits::{Limit, Verdict};
use crate::units::{Time, Unit, all_units};

/// How long an answer is waited for where the plan does not say [s].
const PATIENCE_S: f64 = 600.0;
/// Largest picture [bytes].
const PICTURE: u64 = 2 << 20;
/// Longest answer in words [characters].
const LONGEST: usize = 200;

/// A question to the person at the bench. While it stands, the last current is held and every interlock watches.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PromptFile {
    /// What is asked.
    pub text: String,
    /// A picture that shows it, PNG or JPEG, relative to the plan.
    #[schemars(with = "Option<PathBuf>")]
    pub picture: Option<Spanned<PathBuf>>,
    /// What an answer is; to confirm by default.
    #[schemars(with = "Option<AnswerFile>")]
    pub answer: Option<Spanned<AnswerFile>>,
    /// How long an answer is waited for, before the run ends as ABORTED; 600 s by default.
    #[schemars(with = "Option<Time>")]
    pub timeout: Option<Spanned<Time>>,
}

/// What an answer is.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum AnswerFile {
    /// Yes, or no, which fails the phase.
    #[default]
    Confirm,
    /// A number with its unit.
    Number {
        /// The unit in which it is read: `degC`, `bar`, `A`, ...
        unit: String,
        /// What it is judged by; without it, it is recorded only.
        #[serde(default)]
        #[schemars(with = "Option<LimitFile>")]
        limit: Option<Spanned<LimitFile>>,
    },
    /// One of several.
    Choice {
        /// What there is to choose from.
        options: Vec<String>,
        /// What passes; without it, every choice is recorded only.
        #[serde(default)]
        accept: Vec<String>,
    },
    /// A remark in words; may be empty.
    Remark,
}

/// A checked question.
#[derive(Debug, Clone)]
pub struct Prompt {
    /// What is asked.
    pub text: String,
    /// The picture's bytes and kind.
    pub picture: Option<Picture>,
    /// What an answer is.
    pub kind: Kind,
    /// How long an answer is waited for [s].
    pub timeout_s: f64,
}

/// A picture that shows what is meant.
#[derive(Clone)]
pub struct Picture {
    /// `image/png` or `image/jpeg`.
    pub kind: &'static str,
    /// The file.
    pub bytes: std::sync::Arc<[u8]>,
}

impl std::fmt::Debug for Picture {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} of {} bytes", self.kind, self.bytes.len())
    }
}

/// What an answer is, checked.
#[derive(Debug, Clone)]
pub enum Kind {
    /// Yes or no.
    Confirm,
    /// A number.
    Number {
        /// The unit in which it is kept.
        unit: &'static Unit,
        /// The unit in which it is read, and its factor to the other.
        read_in: (&'static str, f64),
        /// What it is judged by.
        limit: Option<Limit>,
    },
    /// One of several.
    Choice {
        /// What there is to choose from.
        options: Vec<String>,
        /// What passes.
        accept: Vec<String>,
    },
    /// A remark.
    Remark,
}

/// An answer that fits its question.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// As it is recorded.
    pub text: String,
    /// The number in the question's unit.
    pub value: Option<f64>,
    /// What it means for the phase; `None` where nothing is judged.
    pub verdict: Option<Verdict>,
}

impl Kind {
    /// As the page and a record name it.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Confirm => "confirm",
            Self::Number { .. } => "number",
            Self::Choice { .. } => "choice",
            Self::Remark => "remark",
        }
    }

    /// What may be answered, in words.
    pub fn allowed(&self) -> String {
        match self {
            Self::Confirm => "yes or no".into(),
            Self::Number { unit, read_in, .. } => format!("a {} with its unit, or a number in {}", unit.dimension, read_in.0),
            Self::Choice { options, .. } => format!("one of: {}", options.join(", ")),
            Self::Remark => format!("at most {LONGEST} characters"),
        }
    }

    /// What a typed answer comes to.
    ///
    /// # Errors
    /// What is wrong with it, and what is allowed.
    pub fn answer(&self, typed: &str) -> Result<Answer, String> {
        let typed = typed.trim();
        let wrong = || format!("`{typed}`: {} is wanted", self.allowed());
        let judged = |text: &str, pass: bool| Answer {
            text: text.into(),
            value: None,
            verdict: Some(if pass { Verdict::Pass } else { Verdict::Fail }),
        };
        match self {
            Self::Confirm => match typed.to_lowercase().as_str() {
                "yes" | "y" | "true" | "ja" | "j" => Ok(judged("yes", true)),
                "no" | "n" | "false" | "nein" => Ok(judged("no", false)),
                _ => Err(wrong()),
            },
            Self::Number { unit, limit, read_in } => {
                // A person reads the number off an instrument whose unit the question names.
                // In half of the world with a comma.
                let typed = typed.replacen(',', ".", 1);
                let value = match typed.parse::<f64>() {
                    Ok(value) if value.is_finite() => value * read_in.1,
                    _ => unit.parse(&typed).map_err(|e| e.to_string())?,
                };
                let verdict = limit.as_ref().map(|l| l.judge(Some(value)));
                Ok(Answer { text: format!("{value} {}", unit.symbol), value: Some(value), verdict })
            }
            Self::Choice { options, accept } => {
                let chosen = options.iter().find(|o| o.eq_ignore_ascii_case(typed)).ok_or_else(wrong)?;
                match accept.is_empty() {
                    true => Ok(Answer { text: chosen.clone(), value: None, verdict: None }),
                    false => Ok(judged(chosen, accept.contains(chosen))),
                }
            }
            Self::Remark if typed.chars().count() > LONGEST || typed.chars().any(char::is_control) => Err(wrong()),
            Self::Remark => Ok(Answer { text: typed.into(), value: None, verdict: None }),
        }
    }
}

/// Checks a question; `span` is its place in the plan.
pub(super) fn checked(file: &Spanned<PromptFile>, source: &Source) -> Result<Prompt, Wrong> {
    let written = file.get_ref();
    if written.text.trim().is_empty() {
        return Err(Wrong::new(file.span(), "asks nothing: `text` is blank"));
    }
    let timeout_s = match &written.timeout {
        None => PATIENCE_S,
        Some(t) if t.get_ref().value() > 0.0 => t.get_ref().value(),
        Some(t) => return Err(Wrong::new(t.span(), format!("{} is not positive", t.get_ref()))),
    };
    let kind = match written.answer.as_ref().map(|a| (a.get_ref(), a.span())) {
        None | Some((AnswerFile::Confirm, _)) => Kind::Confirm,
        Some((AnswerFile::Number { unit, limit: written }, span)) => {
            let spelled = |u: &'static Unit| u.spellings.iter().find(|s| s.0 == unit).map(|s| (u, *s));
            let Some((unit, read_in)) = all_units().find_map(spelled) else {
                let known: Vec<&str> = all_units().map(|u| u.symbol).collect();
                return Err(Wrong::new(span, format!("`{unit}` is no unit; there are: {}", known.join(", "))));
            };
            Kind::Number { unit, read_in, limit: written.as_ref().map(|l| limit(l, unit)).transpose()? }
        }
        Some((AnswerFile::Choice { options, accept }, span)) => {
            if options.len() < 2 || options.iter().any(|o| o.trim().is_empty()) {
                return Err(Wrong::new(span, "two options at least are wanted, and none of them blank"));
            }
            if let Some(stranger) = accept.iter().find(|a| !options.contains(a)) {
                return Err(Wrong::new(span, format!("`{stranger}` is accepted, but is no option: {}", options.join(", "))));
            }
            Kind::Choice { options: options.clone(), accept: accept.clone() }
        }
        Some((AnswerFile::Remark, _)) => Kind::Remark,
    };
    let picture = written.picture.as_ref().map(|p| picture(p, source)).transpose()?;
    Ok(Prompt { text: written.text.trim().into(), picture, kind, timeout_s })
}

fn picture(file: &Spanned<PathBuf>, source: &Source) -> Result<Picture, Wrong> {
    let wrong = |problem: String| Wrong::new(file.span(), problem);
    let path = source.folder.join(file.get_ref());
    super::territory::check(&source.folder, &file.get_ref().to_string_lossy(), &path).map_err(wrong)?;
    let meta = std::fs::metadata(&path).map_err(|e| wrong(format!("{}: {e}", path.display())))?;
    if !meta.is_file() || meta.len() > PICTURE {
        return Err(wrong(format!("{}: a file of at most {} MB is wanted", path.display(), PICTURE >> 20)));
    }
    let bytes = std::fs::read(&path).map_err(|e| wrong(format!("{}: {e}", path.display())))?;
    let kind = match bytes.as_slice() {
        [0x89, b'P', b'N', b'G', ..] => "image/png",
        [0xff, 0xd8, 0xff, ..] => "image/jpeg",
        _ => return Err(wrong(format!("{}: is neither PNG nor JPEG", path.display()))),
    };
    Ok(Picture { kind, bytes: bytes.into() })
}
