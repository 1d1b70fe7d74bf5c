//! What the page shows: one value, sent whole whenever it changes.

use std::collections::{BTreeMap, VecDeque};

use serde::Serialize;

/// Lines of the log that are kept.
const LOG: usize = 200;

/// Everything but the samples.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Board {
    /// The station.
    pub station: StationCard,
    /// What may be tested.
    pub products: Vec<ProductCard>,
    /// Models that a recording may be diagnosed with.
    pub models: Vec<String>,
    /// The places where a valve is mounted.
    pub sites: Vec<SiteCard>,
    /// The batch that is open.
    pub batch: Option<BatchCard>,
    /// What happened, the newest last.
    pub log: VecDeque<LogLine>,
}

impl Board {
    /// Adds a line to the log.
    pub fn note(&mut self, at: String, site: Option<usize>, text: impl Into<String>) {
        if self.log.len() >= LOG {
            self.log.pop_front();
        }
        self.log.push_back(LogLine { at, site, text: text.into() });
    }
}

/// The station as its file has it.
#[derive(Debug, Clone, Default, Serialize)]
pub struct StationCard {
    /// Id.
    pub id: String,
    /// Site and place.
    pub location: Option<String>,
    /// Whether operators are listed, so that a badge is asked for.
    pub badges: bool,
    /// Version of the program.
    pub version: String,
}

/// One product.
#[derive(Debug, Clone, Default, Serialize)]
pub struct ProductCard {
    /// Its id.
    pub id: String,
    /// Its name.
    pub title: String,
    /// Part number.
    pub part_number: Option<String>,
    /// Revision of the part.
    pub revision: Option<String>,
    /// Name of the plan.
    pub plan: String,
    /// What the plan is for.
    pub description: String,
    /// How long it takes [s].
    pub duration_s: f64,
    /// Each figure with its limit, as text.
    pub limits: Vec<String>,
    /// `real`, `emulated` or `simulated`.
    pub origin: String,
}

/// What a site does.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Light {
    /// Nothing; the next valve may be mounted.
    #[default]
    Idle,
    /// Waits for the supply that several sites share.
    Waiting,
    /// A valve is under test.
    Running,
    /// A person is asked something.
    Asking,
    /// The operator stopped it; the safe state is under way.
    Stopping,
    /// Nobody saw the current go.
    Unsafe,
}

/// One site.
#[derive(Debug, Clone, Default, Serialize)]
pub struct SiteCard {
    /// Its name.
    pub name: String,
    /// What it does.
    pub light: Light,
    /// The run that goes on.
    pub run: Option<RunCard>,
    /// What is asked.
    pub prompt: Option<PromptCard>,
    /// What the last one came to.
    pub verdict: Option<VerdictCard>,
}

/// A question that stands.
#[derive(Debug, Clone, Default, Serialize)]
pub struct PromptCard {
    /// Its id, which the answer names.
    pub id: u64,
    /// Phase of the plan.
    pub phase: String,
    /// What is asked.
    pub text: String,
    /// `confirm`, `number`, `choice` or `remark`.
    pub kind: String,
    /// What may be answered, in words.
    pub allowed: String,
    /// Unit of a number.
    pub unit: Option<String>,
    /// What there is to choose from.
    pub options: Vec<String>,
    /// Whether a picture shows it.
    pub picture: bool,
}

/// A run that goes on.
#[derive(Debug, Clone, Default, Serialize)]
pub struct RunCard {
    /// Number of the run since the station started.
    pub id: u64,
    /// The valve.
    pub serial: String,
    /// Product.
    pub product: String,
    /// Who tests.
    pub operator: String,
    /// Which attempt on the valve.
    pub attempt: u32,
    /// The phases of the plan.
    pub phases: Vec<PhaseCard>,
    /// Loop period [s].
    pub period_s: f64,
}

/// A phase of the plan.
#[derive(Debug, Clone, Default, Serialize)]
pub struct PhaseCard {
    /// Its name.
    pub name: String,
    /// Its samples.
    pub samples: usize,
}

/// What a run came to; shown after its record is stored.
#[derive(Debug, Clone, Default, Serialize)]
pub struct VerdictCard {
    /// The run.
    pub run: u64,
    /// The record.
    pub record: String,
    /// The valve.
    pub serial: String,
    /// Product.
    pub product: String,
    /// Who tested.
    pub operator: String,
    /// Which attempt.
    pub attempt: u32,
    /// As the record writes it.
    pub outcome: String,
    /// Why there is no verdict.
    pub reasons: Vec<String>,
    /// What is outside its limits: name, value, limit.
    pub failed: Vec<[String; 3]>,
    /// `real`, `emulated` or `simulated`.
    pub origin: String,
    /// What is known of the safe state; `None` in simulation.
    pub safe_state: Option<SafeCard>,
    /// When it was stored.
    pub at: String,
    /// Evidence of the timing: p50, p99 and largest lateness [s]; `None` in simulation.
    pub lateness_s: Option<[f64; 3]>,
    /// Samples that were lost or stale.
    pub lost: u64,
}

/// What is known of the safe state.
#[derive(Debug, Clone, Default, Serialize)]
pub struct SafeCard {
    /// Whether a measurement confirmed it.
    pub confirmed: bool,
    /// What was written and read back.
    pub evidence: String,
}

/// The batch that is open.
#[derive(Debug, Clone, Default, Serialize)]
pub struct BatchCard {
    /// Product.
    pub product: String,
    /// Name of its folder in the store.
    pub name: String,
    /// Valves by their final outcome.
    pub counts: BTreeMap<String, usize>,
    /// `real`, `emulated` or `simulated`.
    pub origin: String,
}

/// A line of the log.
#[derive(Debug, Clone, Serialize)]
pub struct LogLine {
    /// When.
    pub at: String,
    /// Where.
    pub site: Option<usize>,
    /// What.
    pub text: String,
}
