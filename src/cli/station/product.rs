//! A product of the station file, ready to be tested: its files found and checked.

use std::path::{Path, PathBuf};

use super::super::batch_args::{BatchArgs, Format, RigArgs};
use super::super::batch_bench::Setup;
use super::super::batch_emulated::Emulated;
use super::super::on_wire::WireArgs;
use super::super::outputs::Force;
use super::super::{CliError, files};
use super::StationArgs;
use crate::batch::offer::{Product, Site};
use crate::batch::population::Population;
use crate::batch::station::Station;
use crate::plan::{LimitsFile, Plan};
use crate::report::format;
use crate::rig::profile::Profile;
use crate::shipped::{self, Kind};
use crate::station::ProductCard;
use crate::valve::Valve;

/// A product, ready.
pub struct Ready {
    /// As the station file has it.
    pub product: Product,
    /// What the page shows of it.
    pub card: ProductCard,
    args: BatchArgs,
    population: Option<PathBuf>,
}

impl Ready {
    /// Finds and checks the files of a product. `folder` is that of the station file.
    pub fn new(args: &StationArgs, path: &Path, station: &Station, product: &Product) -> Result<Self, CliError> {
        let folder = path.parent().filter(|_| !shipped::is_shipped(path));
        let wrong = |e: CliError| CliError { message: format!("{}: product `{}`: {}", path.display(), product.id, e.message), ..e };
        let find = |kind, name: &str| shipped::find(kind, name, folder).map_err(CliError::input).map_err(wrong);
        let plan_path = find(Kind::Plan, &product.plan)?;
        let mut plan = Plan::load(&plan_path, &[]).map_err(CliError::input).map_err(wrong)?;
        let limits_path = product.limits.as_ref().map(|l| find(Kind::Batch, &l.to_string_lossy())).transpose()?;
        let limits = limits_path.as_deref().map(LimitsFile::load).transpose().map_err(CliError::input).map_err(wrong)?;
        if let Some(limits) = &limits {
            plan.apply_limits(limits).map_err(CliError::input).map_err(wrong)?;
        }
        let valve = match &product.valve {
            Some(name) => Some(Valve::find_beside(name, folder).map_err(CliError::input).map_err(wrong)?.display().to_string()),
            None => None,
        };
        let driver = product.driver.as_ref().map(|d| find(Kind::Driver, d)).transpose()?;
        let emulated = driver.as_deref().map(Profile::load).transpose().map_err(CliError::input).map_err(wrong)?;
        let emulated = emulated.is_some_and(|p| p.device.emulated);
        let population = product.population.as_ref().map(|p| find(Kind::Batch, p)).transpose()?;
        let part_number = product.part_number.clone().or_else(|| limits.as_ref().and_then(|l| l.part_number.clone()));
        let revision = product.revision.clone().or_else(|| limits.as_ref().and_then(|l| l.revision.clone()));
        let card = ProductCard {
            id: product.id.clone(),
            title: product.title.clone().unwrap_or_else(|| product.id.clone()),
            part_number: part_number.clone(),
            revision: revision.clone(),
            plan: plan.name.clone(),
            description: plan.description.trim().to_string(),
            duration_s: plan.duration_s(),
            limits: limit_lines(&plan),
            origin: if product.simulated {
                "simulated"
            } else if emulated {
                "emulated"
            } else {
                "real"
            }
            .into(),
        };
        let place = |site: Option<&Site>| match site {
            Some(Site { port: Some(port), .. }) => (Some(port.clone()), None),
            Some(Site { tcp: Some(tcp), .. }) => (None, Some(tcp.clone())),
            // Where an emulator listens is known when the valve is mounted.
            _ => (None, Some("127.0.0.1:0".to_string())),
        };
        let (port, tcp) = place(station.sites.first());
        let sites = station.sites.iter().skip(1).map(|s| match place(Some(s)) {
            (Some(port), _) => port.display().to_string(),
            (None, tcp) => tcp.unwrap_or_default(),
        });
        let wire = WireArgs {
            driver: driver.map(|d| d.display().to_string()),
            port,
            tcp,
            pressure_driver: None,
            pressure_port: None,
            pressure_tcp: None,
            max_current: None,
            max_pressure: None,
            without_watchdog: false,
            watch: false,
        };
        let args = BatchArgs {
            plan: plan_path,
            duts: None,
            count: None,
            prompt: true,
            part_number,
            revision,
            lot: None,
            rig: RigArgs { sim: product.simulated, sites: if product.simulated { Vec::new() } else { sites.collect() }, wire, valve },
            population: if product.simulated { population.clone() } else { None },
            set: Vec::new(),
            limits: limits_path,
            station: Some(path.to_path_buf()),
            operator: None,
            override_calibration: args.override_calibration.clone(),
            answers: None,
            seed: args.seed,
            resume: false,
            retest: false,
            threads: Some(station.sites.len()),
            out: None,
            known: None,
            valve_reports: None,
            force: Force::default(),
            format: Format::Text,
        };
        Ok(Self { product: product.clone(), card, args, population })
    }

    /// The arguments of `hil batch` that mean a batch of this product, with the earlier ones in `store`.
    pub fn batch_args(&self, store: &Path) -> BatchArgs {
        let a = &self.args;
        BatchArgs {
            plan: a.plan.clone(),
            duts: None,
            part_number: a.part_number.clone(),
            revision: a.revision.clone(),
            lot: None,
            rig: a.rig.clone(),
            population: a.population.clone(),
            set: Vec::new(),
            limits: a.limits.clone(),
            station: a.station.clone(),
            operator: None,
            override_calibration: a.override_calibration.clone(),
            answers: None,
            out: None,
            known: Some(store.to_path_buf()),
            ..*a
        }
    }

    /// Puts the emulators of the station file at their sites.
    pub fn emulate(&self, setup: &mut Setup, sites: &[Site]) -> Result<(), CliError> {
        let Some(driver) = self.args.rig.wire.driver.as_deref() else { return Ok(()) };
        let population = self.population.as_deref().map(Population::load).transpose().map_err(CliError::input)?;
        for (k, site) in sites.iter().enumerate() {
            if let Some(name) = &site.emulate {
                let (valve, _) = files::valve(name)?;
                setup.emulate(k, Emulated::new(driver, valve, population.clone(), self.args.seed)?);
            }
        }
        Ok(())
    }
}

/// Each figure with a limit: `tip-in/rmse <= 0.5 bar`.
fn limit_lines(plan: &Plan) -> Vec<String> {
    let measures = plan.phases.iter().flat_map(|p| p.measures.iter().map(move |m| (p, m)));
    let line = |(phase, measure): (&crate::plan::Phase, &crate::plan::Measure)| {
        let limit = measure.limit.as_ref()?;
        let metric = measure.metric.metric();
        let unit = metric.unit().symbol;
        let bound = match (limit.min, limit.max) {
            (Some(min), Some(max)) => format!("{} .. {}", format::number(min, unit), format::quantity(max, unit)),
            (None, Some(max)) => format!("\u{2264} {}", format::quantity(max, unit)),
            (Some(min), None) => format!("\u{2265} {}", format::quantity(min, unit)),
            (None, None) => return None,
        };
        Some(format!("{}/{} {bound}", phase.name, metric.id()))
    };
    measures.filter_map(line).collect()
}
