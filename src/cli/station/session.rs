//! An open batch: its folder, its campaign on a thread of its own, and what is known of it while it goes on.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use super::super::batch_args::ValveReports;
use super::super::batch_bench::Bench;
use super::super::batch_open::{self, Opened};
use super::super::batch_prompt::{Entries, Seen};
use super::super::clock::now;
use super::super::lock::lock;
use super::super::{CliError, batch_folder};
use super::product::Ready;
use super::seats::Seats;
use super::shelf;
use crate::batch::campaign::{self, Job, Jobs, Rules, Worker};
use crate::batch::duts::Entry;
use crate::batch::offer::Site;
use crate::batch::store::{Header, read_header};
use crate::batch::summary::BatchSummary;
use crate::batch::tally::{Tally, deciding};
use crate::plan::LimitsFile;
use crate::record::Dut;

/// A batch that is open.
pub struct Session {
    /// Id of its product.
    pub product: String,
    /// Its day.
    pub day: String,
    /// Name of its folder in the store.
    pub name: String,
    entries: Mutex<Entries>,
    sites: Vec<SyncSender<Job>>,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

/// What the campaign and the page share.
struct Shared {
    header: Header,
    dir: PathBuf,
    limits: Option<LimitsFile>,
    tally: Mutex<Tally>,
    stop: AtomicBool,
}

impl Shared {
    /// Valves by the outcome that decides on them.
    fn counts(&self) -> BTreeMap<String, usize> {
        let mut tally = lock(&self.tally);
        tally.sort();
        let mut counts = BTreeMap::new();
        for valve in tally.valves() {
            *counts.entry(deciding(valve).outcome.text().to_string()).or_default() += 1;
        }
        counts
    }
}

impl Session {
    /// Opens the batch of a product of today: the one that is there, where it can go on, else a new one.
    ///
    /// # Errors
    /// Whatever refuses a batch: calibration, master valves, plan, limits, driver, store.
    pub fn open(ready: &Ready, sites: &[Site], store: &Path, seats: &Arc<Seats>) -> Result<Self, CliError> {
        let mut args = ready.batch_args(store);
        let mut batch = batch_open::prepare(&args)?;
        ready.emulate(&mut batch.setup, sites)?;
        let day = today();
        let free = |name: &String| {
            let dir = store.join(name);
            !dir.exists() || read_header(&dir).is_ok_and(|held| held.continues(&batch.header))
        };
        let base = format!("{}-{day}", ready.product.id);
        let name = std::iter::once(base.clone()).chain((2..1000).map(|n| format!("{base}-{n}"))).find(free).unwrap_or(base);
        let dir = store.join(&name);
        args.resume = dir.exists();
        let mut opened = batch.open(&args, &dir)?;
        let journal = opened.journal()?;
        let seen = Seen::default();
        let entries = Entries::new(&args, &opened.loaded, opened.limits.as_ref(), Arc::clone(&seen));
        seats.set_plan(&ready.product.id, &opened.setup.plan);
        let shared = Arc::new(Shared {
            header: opened.store.header().clone(),
            dir: dir.clone(),
            limits: opened.limits.clone(),
            tally: Mutex::new(opened.loaded.tally.clone()),
            stop: AtomicBool::new(false),
        });
        // One valve at a time is mounted at a site.
        let (senders, receivers): (Vec<_>, Vec<_>) = sites.iter().map(|_| sync_channel::<Job>(1)).unzip();
        let conducted = Conducted { opened, shared: Arc::clone(&shared), seats: Arc::clone(seats), seen, name: name.clone() };
        let thread = std::thread::Builder::new().name("batch".into()).spawn(move || conducted.run(journal, receivers));
        let thread = thread.map_err(|e| CliError::rig(format!("the batch cannot begin: {e}")))?;
        Ok(Self {
            product: ready.product.id.clone(),
            day,
            name,
            entries: Mutex::new(entries),
            sites: senders,
            shared,
            thread: Some(thread),
        })
    }

    /// Whether the campaign still takes valves.
    pub fn runs(&self) -> bool {
        self.thread.as_ref().is_some_and(|t| !t.is_finished()) && !self.shared.stop.load(Ordering::Relaxed)
    }

    /// Whether a valve may be tested: its data, the number of its next attempt, what the one before came to.
    pub fn entry(&self, serial: &str) -> Result<(Dut, u32, Option<String>), String> {
        let entries = lock(&self.entries);
        match entries.entry(serial) {
            Entry::Dut(dut) => {
                let before = entries.before(&dut.serial);
                Ok((dut, before.map_or(1, |b| b.0 + 1), before.map(|b| b.1.text().to_string())))
            }
            Entry::Refused(why) => Err(why),
            Entry::End => Err("the serial number is blank".into()),
        }
    }

    /// Gives a valve that [`Session::entry`] let through to a site.
    pub fn begin(&self, site: usize, dut: Dut) -> Result<(), String> {
        let sender = self.sites.get(site).ok_or("there is no such site")?;
        let job = lock(&self.entries).begin(dut);
        sender.try_send(job).map_err(|_| "this site is busy".to_string())
    }

    /// The batch as it stands.
    pub fn summary(&self) -> Option<BatchSummary> {
        let mut tally = lock(&self.shared.tally).clone();
        tally.sort();
        if tally.attempts().is_empty() {
            return None;
        }
        let shared = &self.shared;
        Some(batch_open::summary(&shared.header, &shared.dir, &tally, Vec::new(), shared.limits.as_ref()))
    }

    /// Valves by the outcome that decides on them.
    pub fn counts(&self) -> BTreeMap<String, usize> {
        self.shared.counts()
    }

    /// Lets what runs end and writes the reports of the batch.
    pub fn close(mut self) {
        self.sites.clear();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The day as folders name it.
pub fn today() -> String {
    jiff::Zoned::now().date().to_string()
}

/// What the thread of a batch holds.
struct Conducted {
    opened: Opened,
    shared: Arc<Shared>,
    seats: Arc<Seats>,
    seen: Seen,
    name: String,
}

impl Conducted {
    fn run(self, journal: crate::batch::journal::Journal, receivers: Vec<Receiver<Job>>) {
        let Self { opened, shared, seats, seen, name } = self;
        let Opened { setup, store, mut loaded, claim: _claim, .. } = opened;
        let retry = batch_open::retry(&setup.plan);
        let bench = Bench {
            setup: &setup,
            dir: store.dir(),
            reports: ValveReports::All,
            threads: Some(receivers.len()),
            retry: &retry,
            station: store.header().station.as_ref(),
            mounted_by_hand: false,
            stop: &shared.stop,
            down: AtomicBool::new(false),
            company: seats.as_ref(),
            attended: true,
        };
        let workers = bench.workers().into_iter().enumerate().map(|(site, worker)| watched(site, worker, &seats, &shared.stop));
        let sites = receivers.into_iter().map(|r| jobs(r, &shared.stop)).zip(workers).collect();
        // Whoever stands at the site waits for the verdict, so no record waits for others.
        let rules = Rules { retry: &retry, stop: &shared.stop, clock: &now, synced: true };
        let result = campaign::run_each(journal, sites, rules, &mut loaded.tally, |one| {
            lock(&shared.tally).add(one.job.position, one.job.attempt, &one.record);
            lock(&seen).insert(one.job.dut.serial.clone(), (one.job.position, one.job.attempt, one.record.outcome));
            seats.confirmed(one, shelf::id(&name, &one.job.dut.serial, one.job.attempt), shared.counts());
        });
        if let Err(e) = result {
            shared.stop.store(true, Ordering::Relaxed);
            super::super::note(&format!("{}: {e}; what was confirmed is kept", store.dir().display()));
        }
        if loaded.tally.attempts().is_empty() {
            return;
        }
        let summary = batch_open::summary(store.header(), store.dir(), &loaded.tally, loaded.damage, shared.limits.as_ref());
        if let Err(e) = batch_folder::write(store.dir(), &summary, &loaded.tally) {
            super::super::note(&format!("{}: the reports of the batch could not be written: {e}", store.dir().display()));
        }
    }
}

/// A worker whose errors are shown at its site. The batch ends with one; the next entry opens it again.
fn watched<'a>(site: usize, mut worker: Worker<'a>, seats: &'a Seats, stop: &'a AtomicBool) -> Worker<'a> {
    Box::new(move |job: &Job| {
        worker(job).inspect_err(|e| {
            stop.store(true, Ordering::Relaxed);
            seats.failed(site, job, &e.to_string());
        })
    })
}

/// The valves of one site, as they are entered.
fn jobs(receiver: Receiver<Job>, stop: &AtomicBool) -> Jobs<'_> {
    Box::new(std::iter::from_fn(move || {
        loop {
            match receiver.recv_timeout(Duration::from_millis(50)) {
                Ok(job) => return Some(job),
                Err(RecvTimeoutError::Timeout) if !stop.load(Ordering::Relaxed) => {}
                Err(_) => return None,
            }
        }
    }))
}
