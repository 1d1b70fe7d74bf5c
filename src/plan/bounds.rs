//! A limit of a plan as a file writes it, in the unit of its figure.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Spanned;

use super::error::Wrong;
use crate::limits::{Bound, Limit};
use crate::units::Unit;

/// A limit in the unit of its figure.
pub(super) fn limit(file: &Spanned<LimitFile>, unit: &'static Unit) -> Result<Limit, Wrong> {
    let bound = |text: &Option<Spanned<String>>| match text {
        None => Ok(None),
        Some(text) => unit.parse(text.get_ref()).map(Some).map_err(|e| Wrong::new(text.span(), e.to_string())),
    };
    let written = file.get_ref();
    let limit = Limit {
        min: bound(&written.min)?,
        max: bound(&written.max)?,
        marginal_min: bound(&written.marginal_min)?,
        marginal_max: bound(&written.marginal_max)?,
        bound: written.bound,
    };
    limit.check().map(|()| limit).map_err(|e| Wrong::new(file.span(), e.to_string()))
}

/// A limit, each bound with the unit of the figure.
#[derive(Debug, Clone, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LimitFile {
    /// Smallest accepted value.
    #[schemars(with = "Option<String>")]
    pub min: Option<Spanned<String>>,
    /// Largest accepted value.
    #[schemars(with = "Option<String>")]
    pub max: Option<Spanned<String>>,
    /// Below this the verdict is MARGINAL.
    #[schemars(with = "Option<String>")]
    pub marginal_min: Option<Spanned<String>>,
    /// Above this the verdict is MARGINAL.
    #[schemars(with = "Option<String>")]
    pub marginal_max: Option<Spanned<String>>,
    /// Whether a value on the bound is accepted; `inclusive` by default.
    #[serde(default)]
    pub bound: Bound,
}
