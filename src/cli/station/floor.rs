//! The floor of the station: products, sites, the open batch; carries out what the page asks for.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use serde_json::{Value, json};

use super::super::clock::now;
use super::super::lock::lock;
use super::super::{CliError, batch_folder, batch_open, last_word};
use super::StationArgs;
use super::diagnosing::Diagnosing;
use super::product::Ready;
use super::seats::{BY_OPERATOR, Seats, origin};
use super::session::{Session, today};
use super::shelf::Shelf;
use crate::batch::station::Station;
use crate::digest;
use crate::output::make_folder;
use crate::record::Outcome;
use crate::report;
use crate::shipped;
use crate::station::{Accepted, BatchCard, Board, Conduct, Diagnose, Entry, Given, Hub, Light, Refused, SiteCard, StationCard};
use crate::valve::Valve;

/// The floor.
pub struct Floor {
    station: Station,
    store: PathBuf,
    products: Vec<Ready>,
    hub: Arc<Hub>,
    seats: Arc<Seats>,
    shelf: Shelf,
    session: Mutex<Option<Session>>,
    diagnosing: Diagnosing,
    /// Each model that is offered, with its path.
    models: Vec<(String, String)>,
}

impl Floor {
    /// Checks everything that the station file offers.
    pub fn open(args: &StationArgs, path: PathBuf, station: Station) -> Result<Arc<Self>, CliError> {
        for (key, there) in [("[[product]]", !station.products.is_empty()), ("[[site]]", !station.sites.is_empty())] {
            if !there {
                return Err(CliError::input(format!("{}: names no {key}; what the page offers stands in docs/station.md", path.display())));
            }
        }
        let products = station.products.iter().map(|p| Ready::new(args, &path, &station, p)).collect::<Result<Vec<_>, _>>()?;
        let folder = path.parent().filter(|_| !shipped::is_shipped(&path)).unwrap_or(Path::new(""));
        let store = match (&args.store, &station.store) {
            (Some(store), _) => store.clone(),
            (None, Some(store)) => folder.join(store),
            (None, None) => PathBuf::from("reports/station"),
        };
        make_folder(&store).map_err(|e| CliError::not_stored(format!("{}: {e}", store.display())))?;
        let board = Board {
            station: StationCard {
                id: station.id.clone(),
                location: station.location.clone(),
                badges: !station.operators.is_empty(),
                version: env!("CARGO_PKG_VERSION").into(),
            },
            products: products.iter().map(|p| p.card.clone()).collect(),
            models: station.models.clone(),
            sites: station.sites.iter().map(|s| SiteCard { name: s.name.clone(), ..SiteCard::default() }).collect(),
            ..Board::default()
        };
        let beside = path.parent().filter(|_| !shipped::is_shipped(&path));
        let model = |name: &String| match Valve::find_beside(name, beside) {
            Ok(found) => Ok((name.clone(), found.display().to_string())),
            Err(e) => Err(CliError::input(format!("{}: models: {e}", path.display()))),
        };
        let models = station.models.iter().map(model).collect::<Result<Vec<_>, _>>()?;
        let hub = Arc::new(Hub::new(board));
        let diagnosing = Diagnosing::new(Arc::clone(&hub));
        let seats = Arc::new(Seats::new(Arc::clone(&hub), station.sites.len()));
        Ok(Arc::new(Self {
            shelf: Shelf::new(&store),
            station,
            store,
            products,
            hub,
            seats,
            session: Mutex::new(None),
            diagnosing,
            models,
        }))
    }

    /// Id of the station.
    pub fn id(&self) -> &str {
        &self.station.id
    }

    /// Folder of the records.
    pub fn store(&self) -> &Path {
        &self.store
    }

    /// What the page shows.
    pub fn hub(&self) -> Arc<Hub> {
        Arc::clone(&self.hub)
    }

    /// Stops what runs, lets it be stored, and closes the batch; whether anything ran.
    pub fn shut(&self) -> bool {
        let ran = self.seats.stop_all("SIGTERM");
        if let Some(session) = lock(&self.session).take() {
            session.close();
        }
        ran
    }

    /// Everything that can refuse an entry; the batch of its product is open afterwards.
    fn admit<T>(
        &self,
        entry: &Entry,
        admitted: impl FnOnce(&Session, Accepted, crate::record::Dut) -> Result<T, String>,
    ) -> Result<T, Refused> {
        let ready = self.products.iter().find(|p| p.product.id == entry.product);
        let ready = ready.ok_or_else(|| Refused::because("this station does not test such a product"))?;
        let operator = self.station.offer().operator(&entry.operator).map_err(Refused)?;
        let lot = entry.lot.as_deref().map(str::trim).filter(|l| !l.is_empty());
        if lot.is_some_and(|l| l.chars().count() > 64 || l.chars().any(char::is_control)) {
            return Err(Refused::because("the lot is longer than 64 characters, or holds what cannot be printed"));
        }
        let light = self.hub.read(|b| b.sites.get(entry.site).map(|s| s.light));
        match light {
            None => return Err(Refused::because("there is no such site")),
            Some(Light::Idle) => {}
            Some(Light::Unsafe) => {
                return Err(Refused::because("SAFE STATE NOT CONFIRMED at this site: remove its power, then confirm that here"));
            }
            Some(_) => return Err(Refused::because("this site is busy")),
        }
        let mut held = lock(&self.session);
        self.open_batch(&mut held, ready)?;
        let session = held.as_ref().ok_or_else(|| Refused::because("no batch is open"))?;
        let (mut dut, attempt, before) = session.entry(&entry.serial).map_err(Refused)?;
        if let Some(lot) = lot {
            dut.lot = Some(lot.into());
        }
        let accepted = Accepted { serial: dut.serial.clone(), operator, attempt, before };
        admitted(session, accepted, dut).map_err(Refused)
    }

    /// Opens the batch of a product, where it is not open already; a calibration that has run out and masters that are too old refuse
    /// also an open one.
    fn open_batch(&self, held: &mut Option<Session>, ready: &Ready) -> Result<(), Refused> {
        let refused = |e: CliError| Refused(e.message);
        if let Some(open) = held.as_ref() {
            let same = open.runs() && open.product == ready.product.id && open.day == today();
            if same {
                return batch_open::admits(&ready.batch_args(&self.store)).map_err(refused);
            }
            if self.hub.read(|b| b.sites.iter().any(|s| s.run.is_some())) {
                return Err(Refused::because("another batch is under test; wait for its last valve"));
            }
        }
        if let Some(open) = held.take() {
            open.close();
        }
        let session = Session::open(ready, &self.station.sites, &self.store, &self.seats).map_err(refused)?;
        let card = BatchCard {
            product: ready.product.id.clone(),
            name: session.name.clone(),
            counts: session.counts(),
            origin: ready.card.origin.clone(),
        };
        self.hub.change(|board| {
            board.note(now(), None, format!("batch {}", card.name));
            board.batch = Some(card);
        });
        *held = Some(session);
        Ok(())
    }

    /// Something of the open batch.
    fn of_batch<T>(&self, of: impl FnOnce(&crate::batch::summary::BatchSummary) -> T) -> Result<T, Refused> {
        let summary = lock(&self.session).as_ref().and_then(Session::summary);
        summary.map(|s| of(&s)).ok_or_else(|| Refused::because("no valve of this batch has been tested yet"))
    }
}

impl Conduct for Floor {
    fn check(&self, entry: &Entry) -> Result<Accepted, Refused> {
        self.admit(entry, |_, accepted, _| Ok(accepted))
    }

    fn start(&self, entry: &Entry) -> Result<Accepted, Refused> {
        self.admit(entry, |session, accepted, dut| {
            self.seats.take(entry.site, accepted.operator.clone());
            session.begin(entry.site, dut)?;
            // Nobody else starts a valve at this site before its run is shown.
            self.hub.change(|board| {
                if let Some(site) = board.sites.get_mut(entry.site)
                    && site.run.is_none()
                {
                    site.light = Light::Waiting;
                    site.verdict = None;
                }
            });
            Ok(accepted)
        })
    }

    fn stop(&self, site: usize) -> Result<(), Refused> {
        let busy = self.hub.change(|board| {
            let card = board.sites.get_mut(site)?;
            let busy = !matches!(card.light, Light::Idle | Light::Unsafe);
            if busy {
                card.light = Light::Stopping;
                board.note(now(), Some(site), "stopped by the operator");
            }
            Some(busy)
        });
        match busy {
            None => Err(Refused::because("there is no such site")),
            Some(false) => Err(Refused::because("nothing runs at this site")),
            Some(true) => {
                self.seats.stop(site, BY_OPERATOR);
                Ok(())
            }
        }
    }

    fn answer(&self, given: &Given) -> Result<(), Refused> {
        self.seats.answer(given.site, given.prompt, &given.answer).map_err(Refused)
    }

    fn picture(&self, site: usize) -> Option<(&'static str, Arc<[u8]>)> {
        self.seats.picture(site).map(|p| (p.kind, p.bytes))
    }

    fn acknowledge(&self, site: usize) -> Result<(), Refused> {
        self.hub.change(|board| match board.sites.get_mut(site) {
            Some(card) if card.light == Light::Unsafe => {
                card.light = Light::Idle;
                // A later attempt to reach the safe state may have another evidence than the record.
                let said = card.verdict.as_ref().and_then(|v| v.safe_state.as_ref()).map(|s| s.evidence.clone());
                said.into_iter().chain(self.seats.evidence(site)).for_each(|evidence| last_word::settled(&evidence));
                board.note(now(), Some(site), "somebody confirmed that the power of this site was taken away");
                Ok(())
            }
            _ => Err(Refused::because("this site was not left energised")),
        })
    }

    fn close(&self) -> Result<(), Refused> {
        if self.hub.read(|b| b.sites.iter().any(|s| s.run.is_some())) {
            return Err(Refused::because("a valve is under test"));
        }
        let Some(session) = lock(&self.session).take() else { return Err(Refused::because("no batch is open")) };
        session.close();
        self.hub.change(|board| {
            board.batch = None;
            board.note(now(), None, "the batch is closed");
        });
        Ok(())
    }

    fn records(&self, serial: Option<&str>) -> Result<Value, Refused> {
        self.shelf.list(serial)
    }

    fn record_page(&self, id: &str) -> Result<String, Refused> {
        self.shelf.page(id)
    }

    fn diagnose(&self, what: &Diagnose<'_>) -> Result<u64, Refused> {
        let named = |name: &str| self.models.iter().find(|m| m.0 == name).map(|m| m.1.as_str());
        match what {
            Diagnose::Bytes { name, bytes, model } => {
                let model = named(model).ok_or_else(|| Refused::because("this station offers no such model"))?;
                self.diagnosing.of_bytes(name, bytes, model)
            }
            Diagnose::Record { id, model } => {
                let model = named(model).ok_or_else(|| Refused::because("this station offers no such model"))?;
                let folder = self.shelf.folder(id)?;
                self.diagnosing.of_record(&folder, id, model)
            }
        }
    }

    fn diagnosis_page(&self, number: u64) -> Result<String, Refused> {
        self.diagnosing.page(number)
    }

    fn batch_page(&self) -> Result<String, Refused> {
        self.of_batch(|summary| report::batch::html(summary, &batch_folder::report_id(summary)))
    }

    fn figures(&self) -> Result<Value, Refused> {
        self.of_batch(|summary| {
            let judged: Vec<_> =
                summary.valves.iter().filter(|v| matches!(v.outcome, Outcome::Pass | Outcome::Marginal | Outcome::Fail)).collect();
            let limited = summary.metrics.iter().enumerate().filter(|(_, m)| m.tolerance.min.is_some() || m.tolerance.max.is_some());
            let metrics = limited.map(|(k, m)| {
                let points = judged.iter().map(|v| json!([v.serial, v.values.get(k).copied().filter(|x| x.is_finite())]));
                json!({
                    "name": m.name, "unit": m.unit, "tolerance": m.tolerance, "chart": m.chart, "ppk": m.capability.ppk,
                    "points": points.collect::<Vec<_>>(),
                })
            });
            json!({
                "id": digest::sha256(&summary.batch.plan_sha256)[..8], "origin": origin(summary.origin), "counts": summary.counts,
                "first_pass": summary.first_pass, "final_yield": summary.final_yield, "pareto": summary.pareto,
                "valves": summary.valves.len(), "metrics": metrics.collect::<Vec<_>>(),
            })
        })
    }
}
