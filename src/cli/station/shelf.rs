//! The records in the store, by ids that this program gives out: no path of a browser is ever opened.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use serde_json::{Value, json};

use super::super::batch_folder::attempt_folder;
use super::super::lock::lock;
use super::super::run_folder::read_trace;
use crate::batch::index::{Index, Query};
use crate::digest;
use crate::record::TestRecord;
use crate::report;
use crate::station::Refused;

/// Attempts that are listed at once.
const LISTED: usize = 500;

/// The store, with the ids given out.
pub struct Shelf {
    store: PathBuf,
    given: Mutex<HashMap<String, PathBuf>>,
}

/// The id of an attempt's record.
pub fn id(batch: &str, serial: &str, attempt: u32) -> String {
    digest::sha256(format!("{batch}\n{serial}\n{attempt}"))[..24].to_string()
}

impl Shelf {
    /// The records below `store`.
    pub fn new(store: &Path) -> Self {
        Self { store: store.into(), given: Mutex::default() }
    }

    /// Attempts, the newest first.
    pub fn list(&self, serial: Option<&str>) -> Result<Value, Refused> {
        let query = Query { serial: serial.map(|s| s.trim().to_string()), limit: LISTED, ..Query::default() };
        let (_, answers, _) = Index::answers(&self.store, &query).map_err(Refused::because)?;
        let mut given = lock(&self.given);
        let rows = answers.iter().rev().map(|a| {
            let id = id(&a.batch, &a.serial, a.attempt);
            given.insert(id.clone(), self.store.join(&a.batch).join(attempt_folder(&a.serial, a.attempt)));
            let mut row = serde_json::to_value(a).unwrap_or_default();
            row["id"] = id.into();
            row
        });
        Ok(json!({ "attempts": rows.collect::<Vec<_>>() }))
    }

    /// The folder of a record whose id was given out.
    pub fn folder(&self, id: &str) -> Result<PathBuf, Refused> {
        if !lock(&self.given).contains_key(id) {
            self.list(None)?;
        }
        lock(&self.given).get(id).cloned().ok_or_else(|| Refused::because("there is no such record"))
    }

    /// The page of a record.
    pub fn page(&self, id: &str) -> Result<String, Refused> {
        let folder = self.folder(id)?;
        let record = TestRecord::load(&folder).map_err(|_| Refused::because("this record has no page of its own"))?;
        let trace = read_trace(&folder, &record).map_err(Refused::because)?.unwrap_or_default();
        Ok(report::html(&record, &trace))
    }
}
