//! What the page can ask for, carried out by whoever tests.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::Value;

/// A valve that somebody wants to test.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// Place of the site in the station file.
    pub site: usize,
    /// Id of the product.
    pub product: String,
    /// Serial number as it was scanned or typed.
    pub serial: String,
    /// Badge or name of the operator.
    pub operator: String,
    /// Lot, where there is one.
    #[serde(default)]
    pub lot: Option<String>,
}

/// An entry that may be started.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Accepted {
    /// The serial number without blanks around it.
    pub serial: String,
    /// The name behind the badge.
    pub operator: String,
    /// Which attempt it would be.
    pub attempt: u32,
    /// What the attempt before came to.
    pub before: Option<String>,
}

/// An answer to a question.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Given {
    /// Place of the site in the station file.
    pub site: usize,
    /// Id of the question: an answer to an older one is none.
    pub prompt: u64,
    /// As it was typed or chosen.
    pub answer: String,
}

/// What is to be diagnosed, with the name of a model that the station offers.
#[derive(Debug, Clone, Copy)]
pub enum Diagnose<'a> {
    /// A recording that was dropped on the page.
    Bytes {
        /// Its name there; never a path here.
        name: &'a str,
        /// The file.
        bytes: &'a [u8],
        /// The model.
        model: &'a str,
    },
    /// The trace of a record.
    Record {
        /// Id of the record.
        id: &'a str,
        /// The model.
        model: &'a str,
    },
}

/// Why something is not done, in words for the person at the page.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Refused(pub String);

impl Refused {
    /// Refuses for a reason.
    pub fn because(reason: impl ToString) -> Self {
        Self(reason.to_string())
    }
}

/// Whoever tests. Nothing here takes a path: products, sites, records and models go by the ids that the station file and the store
/// have given out.
pub trait Conduct: Send + Sync {
    /// Whether an entry could be started now; nothing is begun.
    fn check(&self, entry: &Entry) -> Result<Accepted, Refused>;
    /// Begins to test a valve.
    fn start(&self, entry: &Entry) -> Result<Accepted, Refused>;
    /// Stops what a site does; the safe state is on its way when this returns.
    fn stop(&self, site: usize) -> Result<(), Refused>;
    /// Answers the question that stands at a site.
    fn answer(&self, given: &Given) -> Result<(), Refused>;
    /// The picture of the question that stands at a site.
    fn picture(&self, site: usize) -> Option<(&'static str, Arc<[u8]>)>;
    /// Somebody has seen that a site was left energised and has taken its power away.
    fn acknowledge(&self, site: usize) -> Result<(), Refused>;
    /// Closes the open batch and writes its reports.
    fn close(&self) -> Result<(), Refused>;
    /// Attempts in the store, the newest first: of one serial number, or of all.
    fn records(&self, serial: Option<&str>) -> Result<Value, Refused>;
    /// The page of a record.
    fn record_page(&self, id: &str) -> Result<String, Refused>;
    /// Begins a diagnosis; its number.
    fn diagnose(&self, what: &Diagnose<'_>) -> Result<u64, Refused>;
    /// The page of a diagnosis.
    fn diagnosis_page(&self, number: u64) -> Result<String, Refused>;
    /// The page of the open batch, as it stands.
    fn batch_page(&self) -> Result<String, Refused>;
    /// Yield, failures and control charts of the open batch.
    fn figures(&self) -> Result<Value, Refused>;
}
