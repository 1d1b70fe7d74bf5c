//! Parameters of a plan: `"$name"` in the text, `--set NAME=VALUE` on the command line.
//!
//! Both work on the parsed TOML before it becomes a plan, so that a wrong value is underlined where it is used.

use std::borrow::Cow;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::PlanError;
use super::error::Wrong;
use crate::document::nearest;
use crate::units::Unit;

/// A change from the command line: key and value as typed.
pub type Override = (String, String);

/// Applies `overrides` to the parameters, or to a value named by its dotted path (`controller.ki`).
pub fn apply_overrides<'i>(root: &mut DeTable<'i>, overrides: &'i [Override]) -> Result<(), PlanError> {
    for (key, value) in overrides {
        let wrong = |problem: String| PlanError::Override { key: key.clone(), value: value.clone(), problem };
        let known = names(root);
        let is_parameter = matches!(root.get("parameters").map(Spanned::get_ref), Some(DeValue::Table(t)) if t.contains_key(key.as_str()));
        let path = if is_parameter { format!("parameters.{key}") } else { key.clone() };
        let target = at_path(root, &path).ok_or_else(|| wrong(unknown(key, &known)))?;
        let new = typed(target.get_ref(), value).map_err(wrong)?;
        *target.get_mut() = new;
    }
    Ok(())
}

/// Replaces every text `"$name"` by the parameter's value.
pub fn substitute(root: &mut DeTable<'_>) -> Result<(), Wrong> {
    let parameters = match root.get("parameters").map(Spanned::get_ref) {
        Some(DeValue::Table(table)) => table.clone(),
        _ => return Ok(()),
    };
    for (name, value) in &parameters {
        if !matches!(value.get_ref(), DeValue::String(_) | DeValue::Integer(_) | DeValue::Boolean(_)) {
            let kind = value.get_ref().type_str();
            let message = format!(
                "parameter `{}` is a {kind}; a quantity as text (\"20 bar\"), a whole number or a switch is wanted",
                name.get_ref()
            );
            return Err(Wrong::new(value.span(), message));
        }
    }
    root.iter_mut().filter(|(key, _)| key.get_ref() != "parameters").try_for_each(|(_, value)| replace(value, &parameters))
}

fn replace<'i>(value: &mut Spanned<DeValue<'i>>, parameters: &DeTable<'i>) -> Result<(), Wrong> {
    let span = value.span();
    match value.get_mut() {
        DeValue::String(text) => {
            let Some(name) = text.strip_prefix('$') else { return Ok(()) };
            match parameters.get(name) {
                Some(new) => *value.get_mut() = new.get_ref().clone(),
                None => {
                    let known: Vec<&str> = parameters.keys().map(|k| k.get_ref().as_ref()).collect();
                    let hint = nearest(name, known.iter().copied()).map_or_else(String::new, |n| format!("; did you mean `${n}`?"));
                    return Err(Wrong::new(span, format!("there is no parameter `{name}`{hint} (parameters: {})", known.join(", "))));
                }
            }
        }
        DeValue::Array(items) => items.iter_mut().try_for_each(|item| replace(item, parameters))?,
        DeValue::Table(table) => table.iter_mut().try_for_each(|(_, item)| replace(item, parameters))?,
        _ => {}
    }
    Ok(())
}

/// `text` as a value of the same type and dimension as `like`.
fn typed<'i>(like: &DeValue<'_>, text: &'i str) -> Result<DeValue<'i>, String> {
    match like {
        DeValue::String(old) => {
            if let Some(unit) = Unit::of_text(old) {
                unit.parse(text).map_err(|e| format!("{e} (the plan has `{old}`)"))?;
            }
            Ok(DeValue::String(Cow::Borrowed(text)))
        }
        DeValue::Boolean(old) => match text {
            "true" => Ok(DeValue::Boolean(true)),
            "false" => Ok(DeValue::Boolean(false)),
            _ => Err(format!("a switch is wanted, `true` or `false` (the plan has `{old}`)")),
        },
        DeValue::Integer(old) => match DeValue::parse(text).map(Spanned::into_inner) {
            Ok(value @ DeValue::Integer(_)) => Ok(value),
            _ => Err(format!("a whole number is wanted (the plan has `{old}`)")),
        },
        other => Err(format!("is a {} in the plan; only texts, whole numbers and switches can be set", other.type_str())),
    }
}

fn table_mut<'a, 'i>(value: &'a mut DeValue<'i>) -> Option<&'a mut DeTable<'i>> {
    if let DeValue::Table(table) = value { Some(table) } else { None }
}

/// The scalar at a dotted path, or `None`.
fn at_path<'a, 'i>(root: &'a mut DeTable<'i>, path: &str) -> Option<&'a mut Spanned<DeValue<'i>>> {
    let (first, rest) = match path.split_once('.') {
        Some((first, rest)) => (first, Some(rest)),
        None => (path, None),
    };
    let value = root.get_mut(first)?;
    match rest {
        Some(rest) => at_path(table_mut(value.get_mut())?, rest),
        None => Some(value),
    }
}

/// Names that `--set` could mean: parameters, and keys of the controller.
fn names(root: &DeTable<'_>) -> Vec<String> {
    let keys = |name: &str| match root.get(name).map(|v| v.get_ref()) {
        Some(DeValue::Table(table)) => table.keys().map(|k| k.get_ref().to_string()).collect(),
        _ => Vec::new(),
    };
    let mut all: Vec<String> = keys("parameters");
    all.extend(keys("controller").into_iter().map(|k| format!("controller.{k}")));
    all
}

fn unknown(key: &str, known: &[String]) -> String {
    let hint = nearest(key, known.iter().map(String::as_str)).map_or_else(String::new, |n| format!("; did you mean `{n}`?"));
    let list = if known.is_empty() { "the plan has no parameters".to_string() } else { format!("allowed: {}", known.join(", ")) };
    format!("the plan has no such parameter{hint} ({list})")
}
