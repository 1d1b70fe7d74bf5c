//! Capability of the measuring system and of the measuring process, by their uncertainty against the tolerance.
//!
//! VDA Volume 5 and ISO 22514-7: standard uncertainties of the influences are added in squares, doubled (k = 2), and set
//! against the tolerance, Q = 2 U / TOL. The formulas are those of S. Conrad, "Comparison of Capability Analyses for
//! Measurement Processes according to VDA Volume 5 and MSA" (piq-online.de, 2015), and E. Dietrich, "VDA 5 vs. MSA 4" (2011).
//! Of resolution and repeatability only the larger counts, because the scatter of readings holds the steps already.

use serde::{Deserialize, Serialize};

use super::msa::GaugeStudy;
use super::statistics::Finding;

/// Largest %Q_MS of a capable measuring system.
pub const MOST_SYSTEM: f64 = 0.15;
/// Largest %Q_MP of a capable measuring process.
pub const MOST_PROCESS: f64 = 0.30;
/// Coverage factor of the expanded uncertainty.
const COVERAGE: f64 = 2.0;

/// What is known of the instrument beside the study, in the metric's unit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Instrument {
    /// Expanded uncertainty of its calibration, k = 2.
    pub calibration_uncertainty: Option<f64>,
    /// Smallest step of its reading.
    pub resolution: Option<f64>,
    /// Difference of its mean reading from a reference.
    pub bias: Option<f64>,
    /// Standard deviation of repeated readings of a reference.
    pub reference_deviation: Option<f64>,
    /// Largest deviation from linearity over its range.
    pub linearity: Option<f64>,
}

/// One influence.
#[doc(alias = "measurement uncertainty")]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Influence {
    /// `u_CAL`, `u_RE`, `u_BI`, `u_LIN`, `u_EVR` (repeatability on a reference), `u_EVO` (on the parts), `u_AV` (appraisers), `u_IA`
    /// (interaction).
    pub name: String,
    /// Standard uncertainty, in the metric's unit.
    pub uncertainty: f64,
}

/// What the uncertainties say of the measuring system and the measuring process.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MeasuringCapability {
    /// The influences.
    pub budget: Vec<Influence>,
    /// %Q_MS: twice the expanded uncertainty of the measuring system (calibration, resolution or repeatability on a reference, bias,
    /// linearity) over the tolerance. Capable up to 15 %.
    #[doc(alias("%Q_MS", "Q_MS"))]
    pub q_ms: Finding<f64>,
    /// %Q_MP: the same of the measuring process, with repeatability on the parts, appraisers and interaction of the study. Capable up
    /// to 30 %.
    #[doc(alias("%Q_MP", "Q_MP"))]
    pub q_mp: Finding<f64>,
    /// Smallest tolerance for which the measuring process is capable, in the metric's unit.
    pub smallest_tolerance: f64,
    /// Whether both are capable; `None` where one is not known.
    pub capable: Option<bool>,
}

/// The capability from the study and what is known of the instrument.
pub fn measuring_capability(study: &GaugeStudy, instrument: &Instrument, tolerance: Option<f64>) -> MeasuringCapability {
    let of_study = |source: &str| study.components.iter().find(|c| c.source == source).map_or(0.0, |c| c.deviation);
    let budget: Vec<Influence> = [
        ("u_CAL", instrument.calibration_uncertainty.map(|u| u / COVERAGE)),
        // A reading lies anywhere within its step, a bias anywhere up to its size: rectangular distributions.
        ("u_RE", instrument.resolution.map(|r| r / 12f64.sqrt())),
        ("u_BI", instrument.bias.map(|b| b.abs() / 3f64.sqrt())),
        ("u_LIN", instrument.linearity.map(|l| l.abs() / 3f64.sqrt())),
        ("u_EVR", instrument.reference_deviation),
        ("u_EVO", Some(of_study("repeatability"))),
        ("u_AV", Some(of_study("appraiser"))),
        ("u_IA", Some(of_study("interaction"))),
    ]
    .into_iter()
    .filter_map(|(name, u)| u.map(|uncertainty| Influence { name: name.into(), uncertainty }))
    .collect();
    let u = |name: &str| budget.iter().find(|i| i.name == name).map_or(0.0, |i| i.uncertainty);
    let always = u("u_CAL").powi(2) + u("u_BI").powi(2) + u("u_LIN").powi(2);
    let system = (always + u("u_EVR").max(u("u_RE")).powi(2)).sqrt();
    let readings = u("u_EVR").max(u("u_RE")).max(u("u_EVO"));
    let process = (always + readings.powi(2) + u("u_AV").powi(2) + u("u_IA").powi(2)).sqrt();
    let share =
        |u: f64| tolerance.map_or_else(|| Finding::absent("no tolerance: it needs both limits"), |t| Finding::of(2.0 * COVERAGE * u / t));
    let q_ms = match (instrument.calibration_uncertainty, instrument.reference_deviation.or(instrument.resolution)) {
        (Some(_), Some(_)) => share(system),
        _ => Finding::absent("it needs the uncertainty of the calibration, and the deviation on a reference or the resolution"),
    };
    let q_mp = share(process);
    let capable = q_ms.value.zip(q_mp.value).map(|(ms, mp)| ms <= MOST_SYSTEM && mp <= MOST_PROCESS);
    MeasuringCapability { budget, q_ms, q_mp, smallest_tolerance: 2.0 * COVERAGE * process / MOST_PROCESS, capable }
}

#[cfg(test)]
mod tests {
    use super::super::msa::{Component, GaugeStudy};
    use super::*;

    fn study(repeatability: f64, appraiser: f64, interaction: f64) -> GaugeStudy {
        let component = |source: &str, deviation: f64| Component {
            source: source.into(),
            variance: deviation * deviation,
            deviation,
            contribution: 0.0,
            study_variation: 0.0,
            of_tolerance: None,
        };
        GaugeStudy {
            size: (10, 3, 3),
            anova: vec![],
            pooled: true,
            components: vec![
                component("repeatability", repeatability),
                component("appraiser", appraiser),
                component("interaction", interaction),
            ],
            grr_of_tolerance: Finding::absent(""),
            grr_of_study: 0.0,
            distinct_categories: Finding::absent(""),
            verdict: String::new(),
        }
    }

    /// By hand: u_CAL 0.003, u_RE 0.0006, u_BI 0.0012, u_EVR 0.002 give u_MS = 0.003800; with u_EVO 0.004 and u_AV 0.002 u_MP =
    /// 0.005517; a tolerance of 0.12 makes 12.7 % and 18.4 %.
    #[test]
    fn a_budget_by_hand() {
        let instrument = Instrument {
            calibration_uncertainty: Some(0.006),
            resolution: Some(0.0006 * 12f64.sqrt()),
            bias: Some(-0.0012 * 3f64.sqrt()),
            reference_deviation: Some(0.002),
            linearity: None,
        };
        let found = measuring_capability(&study(0.004, 0.002, 0.0), &instrument, Some(0.12));
        let (ms, mp) = (found.q_ms.value.unwrap(), found.q_mp.value.unwrap());
        let by_hand = |squares: &[f64]| 4.0 * squares.iter().map(|u| u * u).sum::<f64>().sqrt() / 0.12;
        assert!((ms - by_hand(&[0.003, 0.0012, 0.002])).abs() < 1e-12 && (ms - 0.1267).abs() < 1e-3, "{ms}");
        assert!((mp - by_hand(&[0.003, 0.0012, 0.004, 0.002])).abs() < 1e-12 && (mp - 0.1839).abs() < 1e-3, "{mp}");
        assert_eq!(found.capable, Some(true));
        assert!((found.smallest_tolerance / 0.12 * 0.3 - mp).abs() < 1e-12);
        assert_eq!(measuring_capability(&study(0.02, 0.002, 0.0), &instrument, Some(0.12)).capable, Some(false));
        // Calibration 0.003 and linearity 0.004 are 0.005, with an interaction of 0.012 they are 0.013.
        let linearity = Some(-0.004 * 3f64.sqrt());
        let instrument = Instrument { calibration_uncertainty: Some(0.006), resolution: Some(0.0), linearity, ..Instrument::default() };
        let found = measuring_capability(&study(0.0, 0.0, 0.012), &instrument, Some(0.1));
        assert!((found.q_ms.value.unwrap() - 0.2).abs() < 1e-12 && (found.q_mp.value.unwrap() - 0.52).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn what_is_not_known_is_absent() {
        let found = measuring_capability(&study(0.004, 0.002, 0.001), &Instrument::default(), Some(0.12));
        assert!(found.q_ms.absent.is_some() && found.q_mp.value.is_some() && found.capable.is_none());
        assert!(measuring_capability(&study(0.004, 0.002, 0.001), &Instrument::default(), None).q_mp.absent.unwrap().contains("tolerance"));
        // Coarse steps count where they are larger than the scatter.
        let coarse = Instrument { resolution: Some(0.1), ..Instrument::default() };
        let found = measuring_capability(&study(0.004, 0.0, 0.0), &coarse, Some(1.0)).q_mp.value.unwrap();
        assert!((found - 0.4 / 12f64.sqrt()).abs() < 1e-12);
    }
}
