//! Views of a diagnosis: text for a terminal, the JSON of the contract, a page that tells the story.

mod discovered;
mod drawings;
mod page;
mod tables;
mod text;

pub use page::page;
pub use text::text;

use crate::diagnose::Diagnosis;

/// The diagnosis as one JSON document. Figures are rounded to six significant digits, so that equal input gives equal bytes.
pub fn json(diagnosis: &Diagnosis) -> String {
    let mut value = serde_json::to_value(diagnosis).unwrap_or_default();
    round(&mut value);
    serde_json::to_string_pretty(&value).unwrap_or_default() + "\n"
}

fn round(value: &mut serde_json::Value) {
    match value {
        serde_json::Value::Number(n) if n.is_f64() => {
            let text = format!("{:.5e}", n.as_f64().unwrap_or_default());
            if let Some(rounded) = text.parse().ok().and_then(serde_json::Number::from_f64) {
                *n = rounded;
            }
        }
        serde_json::Value::Array(items) => items.iter_mut().for_each(round),
        serde_json::Value::Object(map) => map.values_mut().for_each(round),
        _ => {}
    }
}
