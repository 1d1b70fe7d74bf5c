//! The seats at the sites: from the samples of a run to the page, and from the page to the run.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use super::super::clock::now;
use super::super::lock::lock;
use super::super::seat::{Company, Seat};
use super::asking::AtPage;
use crate::batch::campaign::{Confirmed, Job};
use crate::plan::{Picture, Plan, Prompt};
use crate::record::{Origin, Outcome, TestRecord};
use crate::report::format;
use crate::rig::loop_thread::{LoopControl, OPERATOR};
use crate::runner::{Glance, glances};
use crate::station::{Hub, Light, PhaseCard, PromptCard, RunCard, SafeCard, VerdictCard};

/// Glances that wait for the page at most: four seconds of a loop at 1 kHz.
const RING: usize = 4096;

/// The seats of all sites.
pub struct Seats {
    hub: Arc<Hub>,
    sites: Vec<Mutex<Place>>,
    shared: Mutex<Shared>,
}

/// One site.
#[derive(Default)]
struct Place {
    operator: String,
    control: Option<Arc<LoopControl>>,
    asking: Option<Arc<AtPage>>,
}

/// What all sites share.
#[derive(Default)]
struct Shared {
    runs: u64,
    product: String,
    phases: Vec<PhaseCard>,
    prompts: Arc<Vec<Option<Prompt>>>,
    period_s: f64,
    /// Site and run of each attempt that is under way.
    under_way: BTreeMap<(usize, u32), (usize, u64)>,
}

impl Seats {
    /// Seats for so many sites.
    pub fn new(hub: Arc<Hub>, sites: usize) -> Self {
        Self { hub, sites: (0..sites).map(|_| Mutex::default()).collect(), shared: Mutex::default() }
    }

    /// What is tested from now on.
    pub fn set_plan(&self, product: &str, plan: &Plan) {
        let mut shared = lock(&self.shared);
        shared.product = product.into();
        shared.period_s = plan.period_s;
        let card = |p: &crate::plan::Phase| PhaseCard {
            name: p.name.clone(),
            samples: p.samples_per_repetition(plan.period_s) * p.repeat as usize,
        };
        shared.phases = plan.phases.iter().map(card).collect();
        shared.prompts = Arc::new(plan.phases.iter().map(|p| p.prompt.clone()).collect());
    }

    /// Somebody sits down to test a valve; a stop before the run begins counts.
    pub fn take(&self, site: usize, operator: String) {
        if let Some(place) = self.sites.get(site) {
            *lock(place) = Place { operator, control: Some(Arc::new(LoopControl::default())), asking: None };
        }
    }

    /// Stops what runs at a site.
    pub fn stop(&self, site: usize, who: &str) {
        if let Some(control) = self.sites.get(site).and_then(|p| lock(p).control.clone()) {
            control.request_stop(who);
        }
    }

    /// What the last run at a site left known of its safe state.
    pub fn evidence(&self, site: usize) -> Option<String> {
        let control = self.sites.get(site).and_then(|p| lock(p).control.clone())?;
        control.safe_state().map(|s| s.evidence)
    }

    /// Stops everything; whether anything ran.
    pub fn stop_all(&self, who: &str) -> bool {
        let busy: Vec<usize> = self.hub.read(|b| b.sites.iter().enumerate().filter(|(_, s)| s.run.is_some()).map(|(k, _)| k).collect());
        busy.iter().for_each(|site| self.stop(*site, who));
        !busy.is_empty()
    }

    /// A record is on the disk: its verdict may be said.
    pub fn confirmed(&self, one: &Confirmed, record: String, counts: BTreeMap<String, usize>) {
        let found = lock(&self.shared).under_way.remove(&(one.job.position, one.job.attempt));
        let Some((site, run)) = found else { return };
        let product = lock(&self.shared).product.clone();
        let operator = self.operator(site).unwrap_or_default();
        let verdict = verdict(one, run, record, product, operator);
        let line = format!("{}: {}", verdict.serial, verdict.outcome);
        let light = if one.record.ended_unsafe() { Light::Unsafe } else { Light::Idle };
        self.hub.change(|board| {
            if let Some(batch) = &mut board.batch {
                batch.counts = counts;
            }
            if let Some(card) = board.sites.get_mut(site) {
                if card.run.as_ref().is_none_or(|r| r.id == run) {
                    card.run = None;
                    card.prompt = None;
                    card.light = light;
                }
                card.verdict = Some(verdict);
            }
            board.note(now(), Some(site), line);
        });
    }

    /// An attempt gave no record, or none that could be stored.
    pub fn failed(&self, site: usize, job: &Job, message: &str) {
        let found = lock(&self.shared).under_way.remove(&(job.position, job.attempt));
        let run = found.map_or(0, |f| f.1);
        let product = lock(&self.shared).product.clone();
        let verdict = VerdictCard {
            run,
            serial: job.dut.serial.clone(),
            product,
            operator: self.operator(site).unwrap_or_default(),
            attempt: job.attempt,
            outcome: "NOT_STORED".into(),
            reasons: vec![message.into()],
            at: now(),
            ..VerdictCard::default()
        };
        let energised = self.sites.get(site).and_then(|p| lock(p).control.clone()).is_some_and(|c| c.left_energised());
        self.hub.change(|board| {
            if let Some(card) = board.sites.get_mut(site) {
                card.run = None;
                card.prompt = None;
                card.light = if energised { Light::Unsafe } else { Light::Idle };
                card.verdict = Some(verdict);
            }
            board.note(now(), Some(site), format!("{}: no record: {message}", job.dut.serial));
        });
    }

    /// Answers the question that stands at a site.
    pub fn answer(&self, site: usize, id: u64, typed: &str) -> Result<(), String> {
        let asking = self.sites.get(site).and_then(|p| lock(p).asking.clone()).ok_or("nothing is asked at this site")?;
        asking.answer(id, typed)
    }

    /// The picture of the question that stands at a site.
    pub fn picture(&self, site: usize) -> Option<Picture> {
        self.sites.get(site).and_then(|p| lock(p).asking.clone())?.picture()
    }

    /// Shows a question, or that none stands any more.
    fn show(&self, site: usize, run: u64, prompt: Option<PromptCard>) {
        self.hub.change(|board| {
            let Some(card) = board.sites.get_mut(site).filter(|c| c.run.as_ref().is_some_and(|r| r.id == run)) else { return };
            match (&prompt, card.light) {
                (Some(_), Light::Running | Light::Waiting) => card.light = Light::Asking,
                (None, Light::Asking) => card.light = Light::Running,
                _ => {}
            }
            card.prompt = prompt;
        });
    }

    fn light(&self, site: usize, light: Light) {
        self.hub.change(|board| {
            if let Some(card) = board.sites.get_mut(site)
                && card.light != Light::Stopping
            {
                card.light = light;
            }
        });
    }
}

impl Company for Seats {
    fn seat(&self, site: usize, job: &Job) -> Seat<'_> {
        let mut shared = lock(&self.shared);
        shared.runs += 1;
        let run = shared.runs;
        shared.under_way.insert((job.position, job.attempt), (site, run));
        let operator = self.operator(site).unwrap_or_default();
        let card = RunCard {
            id: run,
            serial: job.dut.serial.clone(),
            product: shared.product.clone(),
            operator,
            attempt: job.attempt,
            phases: shared.phases.clone(),
            period_s: shared.period_s,
        };
        let asking = Arc::new(AtPage::new(run, Arc::clone(&shared.prompts)));
        drop(shared);
        let control = Arc::new(LoopControl::default());
        if let Some(place) = self.sites.get(site) {
            // A further attempt has a control of its own; a stop holds for it, too.
            let mut place = lock(place);
            place.asking = Some(Arc::clone(&asking));
            let before = place.control.replace(Arc::clone(&control));
            if let Some(who) = before.and_then(|c| c.stop_requested()) {
                control.request_stop(who);
            }
        }
        self.hub.change(|board| {
            board.note(now(), Some(site), format!("{}: begun, attempt {}", card.serial, card.attempt));
            if let Some(own) = board.sites.get_mut(site) {
                own.run = Some(card);
                own.verdict = None;
            }
        });
        let (feed, mut seen) = glances(RING);
        let mut buffer: Vec<Glance> = Vec::with_capacity(64);
        let page = Arc::clone(&asking);
        let mut shown = None;
        let look = move || {
            let stands = page.stands();
            if stands != shown {
                shown = stands;
                self.show(site, run, page.card());
            }
            buffer.clear();
            while let Ok(glance) = seen.pop() {
                buffer.push(glance);
            }
            self.hub.samples(site, run, &buffer);
        };
        Seat {
            control,
            feed: Some(feed),
            look: Box::new(look),
            waits: Box::new(move || self.light(site, Light::Waiting)),
            begins: Box::new(move || self.light(site, Light::Running)),
            paced: true,
            attendant: Some(asking),
        }
    }

    fn operator(&self, site: usize) -> Option<String> {
        self.sites.get(site).map(|p| lock(p).operator.clone()).filter(|o| !o.is_empty())
    }
}

fn verdict(one: &Confirmed, run: u64, id: String, product: String, operator: String) -> VerdictCard {
    let record = &one.record;
    VerdictCard {
        run,
        record: id,
        serial: record.dut.serial.clone(),
        product,
        operator,
        attempt: one.job.attempt,
        outcome: record.outcome.text().into(),
        reasons: record.reasons.clone(),
        failed: failures(record),
        origin: origin(record.origin()).into(),
        safe_state: record.safe_state.as_ref().map(|s| SafeCard { confirmed: s.confirmed, evidence: s.evidence.clone() }),
        at: now(),
        lateness_s: record
            .timing
            .lateness_p50_s
            .zip(record.timing.lateness_p99_s)
            .zip(record.timing.lateness_max_s)
            .map(|((a, b), c)| [a, b, c]),
        lost: record.timing.lost_samples + record.timing.stale_samples + record.timing.missed_slots,
    }
}

/// What is outside its limits: name, value, limit.
fn failures(record: &TestRecord) -> Vec<[String; 3]> {
    let all = record.phases.iter().flat_map(|p| p.measurements.iter().map(move |m| (p, m)));
    let failed = all.filter(|(_, m)| matches!(m.outcome, Outcome::Fail | Outcome::Marginal));
    failed.map(|(p, m)| [format!("{}/{}", p.name, m.metric), format::value(m), format::limit(m)]).collect()
}

/// As the board names an origin.
pub fn origin(origin: Origin) -> &'static str {
    match origin {
        Origin::Real => "real",
        Origin::Emulated => "emulated",
        Origin::Simulated => "simulated",
    }
}

/// Who is named where a person stopped a run.
pub const BY_OPERATOR: &str = OPERATOR;
