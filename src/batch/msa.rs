//! Measurement system analysis: crossed gauge R&R by analysis of variance.
//!
//! Method: AIAG, "Measurement Systems Analysis", 4th edition, chapter III B, analysis of variance: parts,
//! appraisers and their interaction are random; the interaction is pooled with the repeatability where it is not
//! significant at 25 %. On a test bench an appraiser is whatever is to be reproduced: an operator, a day, a mounting, a site.

use serde::{Deserialize, Serialize};

use super::statistics::{Finding, f_upper};

/// Level below which the interaction is kept, as AIAG has it.
pub const POOLING_LEVEL: f64 = 0.25;

/// A balanced study: `values[part][appraiser][trial]`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Study {
    /// Names of the parts.
    pub parts: Vec<String>,
    /// Names of the appraisers.
    pub appraisers: Vec<String>,
    /// The readings.
    pub values: Vec<Vec<Vec<f64>>>,
}

/// One line of the analysis of variance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AnovaLine {
    /// `part`, `appraiser`, `interaction`, `repeatability`, `total`.
    pub source: String,
    /// Degrees of freedom.
    pub freedom: f64,
    /// Sum of squares.
    pub squares: f64,
    /// Mean square; `None` for the total.
    pub mean_square: Option<f64>,
    /// F against the proper denominator.
    pub f: Option<f64>,
    /// Probability of such an F without an effect.
    pub p_value: Option<f64>,
}

/// A component of the variance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Component {
    /// `repeatability`, `reproducibility`, `appraiser`, `interaction`, `gauge`, `part`, `total`.
    #[doc(alias("EV", "AV", "IA", "PV", "TV", "reproducibility", "equipment variation", "appraiser variation", "part variation"))]
    pub source: String,
    /// Variance, in the square of the metric's unit.
    pub variance: f64,
    /// Standard deviation.
    pub deviation: f64,
    /// Share of the total variance.
    pub contribution: f64,
    /// Six deviations over six total deviations.
    pub study_variation: f64,
    /// Six deviations over the tolerance.
    pub of_tolerance: Option<f64>,
}

/// What the study says of the measuring system.
#[doc(alias("gauge R&R", "GRR", "MSA"))]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GaugeStudy {
    /// Parts, appraisers, trials.
    pub size: (usize, usize, usize),
    /// The full analysis, with the interaction.
    pub anova: Vec<AnovaLine>,
    /// Whether the interaction was pooled with the repeatability.
    pub pooled: bool,
    /// The components of the variance.
    pub components: Vec<Component>,
    /// Six gauge deviations over the tolerance, where there are two limits.
    pub grr_of_tolerance: Finding<f64>,
    /// Six gauge deviations over six total deviations.
    pub grr_of_study: f64,
    /// Number of distinct categories: 1.41 part deviations per gauge deviation, cut to a whole number.
    #[doc(alias = "ndc")]
    pub distinct_categories: Finding<u64>,
    /// `acceptable` (below 10 %), `conditional` (10 to 30 %) or `unacceptable`, by %GRR of tolerance, or of the study without it.
    pub verdict: String,
}

/// Why a study cannot be evaluated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MsaError {
    /// Too few of something.
    #[error("a gauge study needs at least 2 parts, 2 appraisers and 2 trials; this one has {parts}, {appraisers} and {trials}")]
    TooSmall {
        /// Number of parts.
        parts: usize,
        /// Number of appraisers.
        appraisers: usize,
        /// Smallest number of trials.
        trials: usize,
    },
    /// Not every cell holds the same number of readings.
    #[error("the study is not balanced: part `{part}`, appraiser `{appraiser}` has {found} reading(s), others have {wanted}")]
    Unbalanced {
        /// Part of the cell.
        part: String,
        /// Appraiser of the cell.
        appraiser: String,
        /// Readings in the cell.
        found: usize,
        /// Readings in the first cell.
        wanted: usize,
    },
    /// A reading is missing.
    #[error("part `{part}`, appraiser `{appraiser}`, trial {trial} has no value")]
    Missing {
        /// Part of the reading.
        part: String,
        /// Appraiser of the reading.
        appraiser: String,
        /// Trial, from 1.
        trial: usize,
    },
    /// The squares of the readings leave what numbers can hold.
    #[error("the readings differ by so much (up to {largest:e}) that their variance is no number; in which unit are they?")]
    TooLarge {
        /// Largest reading by magnitude.
        largest: f64,
    },
    /// Nothing varies.
    #[error("all readings are equal: nothing can be said of the gauge")]
    Constant,
}

/// Evaluates a study; `tolerance` is the width between the limits in the metric's unit.
pub fn gauge_study(study: &Study, tolerance: Option<f64>) -> Result<GaugeStudy, MsaError> {
    let (p, o, r) = balanced(study)?;
    let (pf, of, rf) = (p as f64, o as f64, r as f64);
    let mean = |values: &mut dyn Iterator<Item = f64>| {
        let (sum, count) = values.fold((0.0, 0.0), |(s, c), v| (s + v, c + 1.0));
        sum / count
    };
    let all = || study.values.iter().flatten().flatten().copied();
    let grand = mean(&mut all());
    let part_means: Vec<f64> = study.values.iter().map(|part| mean(&mut part.iter().flatten().copied())).collect();
    let appraiser_means: Vec<f64> = (0..o).map(|j| mean(&mut study.values.iter().flat_map(|part| part[j].iter().copied()))).collect();
    let squared = |means: &[f64]| means.iter().map(|m| (m - grand).powi(2)).sum::<f64>();
    let total: f64 = all().map(|v| (v - grand).powi(2)).sum();
    if total.is_nan() || total > 1e290 {
        return Err(MsaError::TooLarge { largest: all().map(f64::abs).fold(0.0, f64::max) });
    }
    if total == 0.0 {
        return Err(MsaError::Constant);
    }
    let parts = of * rf * squared(&part_means);
    let appraisers = pf * rf * squared(&appraiser_means);
    let repeat: f64 = study
        .values
        .iter()
        .flatten()
        .map(|cell| {
            let m = cell.iter().sum::<f64>() / rf;
            cell.iter().map(|v| (v - m).powi(2)).sum::<f64>()
        })
        .sum();
    // The cells' own sum, not total minus the rest: no cancellation when the interaction is small.
    let interaction: f64 = rf
        * (0..p)
            .flat_map(|i| (0..o).map(move |j| (i, j)))
            .map(|(i, j)| (study.values[i][j].iter().sum::<f64>() / rf - part_means[i] - appraiser_means[j] + grand).powi(2))
            .sum::<f64>();
    let freedom = [pf - 1.0, of - 1.0, (pf - 1.0) * (of - 1.0), pf * of * (rf - 1.0)];
    let ms = [parts / freedom[0], appraisers / freedom[1], interaction / freedom[2], repeat / freedom[3]];
    let line = |source: &str, k: usize, squares: f64, denominator: Option<usize>| {
        let f = denominator.filter(|&d| ms[d] > 0.0).map(|d| ms[k] / ms[d]);
        let p_value = f.zip(denominator).map(|(f, d)| f_upper(f, freedom[k], freedom[d]));
        AnovaLine { source: source.into(), freedom: freedom[k], squares, mean_square: Some(ms[k]), f, p_value }
    };
    let interaction_line = line("interaction", 2, interaction, Some(3));
    // Where every reading repeats there is no F: any interaction is more than that.
    let pooled = interaction_line.p_value.map_or(interaction == 0.0, |p| p >= POOLING_LEVEL);
    let anova = vec![
        line("part", 0, parts, Some(2)),
        line("appraiser", 1, appraisers, Some(2)),
        interaction_line,
        line("repeatability", 3, repeat, None),
        AnovaLine { source: "total".into(), freedom: pf * of * rf - 1.0, squares: total, mean_square: None, f: None, p_value: None },
    ];
    let error = if pooled { (interaction + repeat) / (freedom[2] + freedom[3]) } else { ms[3] };
    let base = if pooled { error } else { ms[2] };
    let interaction_variance = if pooled { 0.0 } else { ((ms[2] - error) / rf).max(0.0) };
    let appraiser_variance = ((ms[1] - base) / (pf * rf)).max(0.0);
    let part_variance = ((ms[0] - base) / (of * rf)).max(0.0);
    let variances = [error, appraiser_variance, interaction_variance, part_variance];
    Ok(conclude((p, o, r), anova, pooled, variances, tolerance))
}

fn conclude(size: (usize, usize, usize), anova: Vec<AnovaLine>, pooled: bool, variances: [f64; 4], tolerance: Option<f64>) -> GaugeStudy {
    let [error, appraiser, interaction, part] = variances;
    let gauge = error + appraiser + interaction;
    let total = gauge + part;
    let component = |source: &str, variance: f64| Component {
        source: source.into(),
        variance,
        deviation: variance.sqrt(),
        contribution: variance / total,
        study_variation: (variance / total).sqrt(),
        of_tolerance: tolerance.map(|t| 6.0 * variance.sqrt() / t),
    };
    let components = vec![
        component("gauge", gauge),
        component("repeatability", error),
        component("reproducibility", appraiser + interaction),
        component("appraiser", appraiser),
        component("interaction", interaction),
        component("part", part),
        component("total", total),
    ];
    let grr_of_study = (gauge / total).sqrt();
    let grr_of_tolerance = match components[0].of_tolerance {
        Some(share) => Finding::of(share),
        None => Finding::absent("no tolerance: it needs both limits"),
    };
    let distinct_categories = if gauge > 0.0 {
        Finding::of((1.41 * (part / gauge).sqrt()) as u64)
    } else {
        Finding::absent("the gauge shows no variation: its resolution hides it")
    };
    let judged = grr_of_tolerance.value.unwrap_or(grr_of_study);
    let verdict = if judged < 0.10 {
        "acceptable"
    } else if judged <= 0.30 {
        "conditional"
    } else {
        "unacceptable"
    };
    GaugeStudy { size, anova, pooled, components, grr_of_tolerance, grr_of_study, distinct_categories, verdict: verdict.into() }
}

fn balanced(study: &Study) -> Result<(usize, usize, usize), MsaError> {
    let (p, o) = (study.values.len(), study.values.first().map_or(0, Vec::len));
    let r = study.values.first().and_then(|part| part.first()).map_or(0, Vec::len);
    let name = |names: &[String], k: usize| names.get(k).cloned().unwrap_or_else(|| format!("{}", k + 1));
    for (i, part) in study.values.iter().enumerate() {
        for j in 0..o.max(part.len()) {
            let cell = part.get(j).map_or(&[][..], Vec::as_slice);
            if cell.len() != r || j >= o {
                let (part, appraiser) = (name(&study.parts, i), name(&study.appraisers, j));
                return Err(MsaError::Unbalanced { part, appraiser, found: cell.len(), wanted: r });
            }
            if let Some(k) = cell.iter().position(|v| !v.is_finite()) {
                let (part, appraiser) = (name(&study.parts, i), name(&study.appraisers, j));
                return Err(MsaError::Missing { part, appraiser, trial: k + 1 });
            }
        }
    }
    if p < 2 || o < 2 || r < 2 {
        return Err(MsaError::TooSmall { parts: p, appraisers: o, trials: r });
    }
    Ok((p, o, r))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readings_that_break_the_statistic_give_a_reason() {
        let study = |value: f64| Study {
            parts: vec!["p".into(), "q".into()],
            appraisers: vec!["a".into(), "b".into()],
            values: vec![vec![vec![1.0, 2.0], vec![1.5, 2.5]], vec![vec![value, -value], vec![0.0, 1.0]]],
        };
        for value in [1e300, 1e200, f64::MAX] {
            assert!(gauge_study(&study(value), None).unwrap_err().to_string().contains("in which unit"), "{value:e}");
        }
        assert!(gauge_study(&study(1e100), None).is_ok());
    }

    /// The study of AIAG, "Measurement Systems Analysis", 4th edition, Figure III-B 15 (Minitab's GAGEAIAG.MTW): ten parts,
    /// three appraisers, three trials.
    const AIAG: [[f64; 9]; 10] = [
        [0.29, 0.41, 0.64, 0.08, 0.25, 0.07, 0.04, -0.11, -0.15],
        [-0.56, -0.68, -0.58, -0.47, -1.22, -0.68, -1.38, -1.13, -0.96],
        [1.34, 1.17, 1.27, 1.19, 0.94, 1.34, 0.88, 1.09, 0.67],
        [0.47, 0.50, 0.64, 0.01, 1.03, 0.20, 0.14, 0.20, 0.11],
        [-0.80, -0.92, -0.84, -0.56, -1.20, -1.28, -1.46, -1.07, -1.45],
        [0.02, -0.11, -0.21, -0.20, 0.22, 0.06, -0.29, -0.67, -0.49],
        [0.59, 0.75, 0.66, 0.47, 0.55, 0.83, 0.02, 0.01, 0.21],
        [-0.31, -0.20, -0.17, -0.63, 0.08, -0.34, -0.46, -0.56, -0.49],
        [2.26, 1.99, 2.01, 1.80, 2.12, 2.19, 1.77, 1.45, 1.87],
        [-1.36, -1.25, -1.31, -1.68, -1.62, -1.50, -1.49, -1.77, -2.16],
    ];

    fn aiag() -> Study {
        let values = AIAG.iter().map(|row| row.chunks(3).map(<[f64]>::to_vec).collect()).collect();
        Study { parts: (1..=10).map(|i| i.to_string()).collect(), appraisers: vec!["A".into(), "B".into(), "C".into()], values }
    }

    /// Sums of squares, mean squares, F and components as published for these data: 88.3619, 3.1673, 0.3590, 2.7589,
    /// 94.6471; pooled: 0.03997, 0.05146, 1.08647; 27.86 % of the study; 4 categories.
    #[test]
    fn the_aiag_example() {
        let g = gauge_study(&aiag(), None).unwrap();
        let close = |value: f64, wanted: f64, within: f64| assert!((value - wanted).abs() < within, "{value} is not {wanted}");
        for (line, (squares, freedom)) in
            g.anova.iter().zip([(88.3619, 9.0), (3.1673, 2.0), (0.3590, 18.0), (2.7589, 60.0), (94.6471, 89.0)])
        {
            close(line.squares, squares, 5e-5);
            assert_eq!(line.freedom, freedom);
        }
        close(g.anova[0].f.unwrap(), 492.291, 5e-4);
        close(g.anova[1].f.unwrap(), 79.406, 5e-4);
        close(g.anova[2].f.unwrap(), 0.434, 5e-4);
        close(g.anova[2].p_value.unwrap(), 0.974, 5e-4);
        assert!(g.pooled);
        let of = |source: &str| g.components.iter().find(|c| c.source == source).unwrap();
        close(of("repeatability").variance, 0.03997, 5e-6);
        close(of("reproducibility").variance, 0.05146, 5e-6);
        close(of("gauge").variance, 0.09143, 5e-6);
        close(of("part").variance, 1.08645, 5e-5);
        close(100.0 * of("gauge").contribution, 7.76, 5e-3);
        close(100.0 * of("gauge").study_variation, 27.86, 5e-3);
        close(100.0 * of("repeatability").study_variation, 18.42, 5e-3);
        close(100.0 * of("reproducibility").study_variation, 20.90, 5e-3);
        close(100.0 * of("part").study_variation, 96.04, 5e-3);
        assert_eq!(g.distinct_categories.value, Some(4));
        assert_eq!(g.verdict, "conditional");
        assert!(g.grr_of_tolerance.absent.is_some());
    }

    /// Two parts, two appraisers, two trials with an interaction, by hand: cells 1 3 | 5 7 and 9 11 | 1 3.
    #[test]
    fn a_significant_interaction_is_kept() {
        let values = vec![vec![vec![1.0, 3.0], vec![5.0, 7.0]], vec![vec![9.0, 11.0], vec![1.0, 3.0]]];
        let g = gauge_study(&Study { values, ..Study::default() }, Some(60.0)).unwrap();
        let squares: Vec<f64> = g.anova.iter().map(|l| l.squares).collect();
        assert_eq!(squares, [8.0, 8.0, 72.0, 8.0, 96.0]);
        assert!(!g.pooled, "F = 36 with 1 and 4 degrees of freedom");
        let of = |source: &str| g.components.iter().find(|c| c.source == source).unwrap().variance;
        assert_eq!((of("repeatability"), of("interaction"), of("appraiser"), of("part")), (2.0, 35.0, 0.0, 0.0));
        assert!((g.grr_of_tolerance.value.unwrap() - 6.0 * 37f64.sqrt() / 60.0).abs() < 1e-12);
        assert_eq!(g.distinct_categories.value, Some(0));
    }

    /// A coarse gauge repeats every reading, by hand: cells 1 | 2 and 3 | 6. Interaction 2 with one degree of freedom, appraisers 8, parts 18.
    #[test]
    fn where_every_reading_repeats_an_interaction_is_kept() {
        let of = |cells: [f64; 4]| {
            let [a, b, c, d] = cells.map(|v| vec![v; 2]);
            gauge_study(&Study { values: vec![vec![a, b], vec![c, d]], ..Study::default() }, None).unwrap()
        };
        let found = of([1.0, 2.0, 3.0, 6.0]);
        let variances: Vec<(&str, f64)> = found.components.iter().map(|c| (c.source.as_str(), c.variance)).collect();
        assert_eq!(variances[..2], [("gauge", 2.5), ("repeatability", 0.0)]);
        assert_eq!(variances[3..6], [("appraiser", 1.5), ("interaction", 1.0), ("part", 4.0)]);
        assert!(!found.pooled && found.anova[2].f.is_none() && found.anova[2].p_value.is_none());
        // With nothing but parts there is no gauge to count categories by.
        let found = of([1.0, 1.0, 3.0, 3.0]);
        assert!(found.pooled && found.distinct_categories.absent.unwrap().contains("resolution"));
    }

    /// Six deviations of 1 of a tolerance of 60 are 10 %, of 20 they are 30 %.
    #[test]
    fn the_verdict_changes_at_ten_and_thirty_percent() {
        let verdict = |tolerance| conclude((2, 2, 2), Vec::new(), true, [1.0, 0.0, 0.0, 3.0], Some(tolerance)).verdict;
        assert_eq!([60.1, 60.0, 20.0, 19.9].map(verdict), ["acceptable", "conditional", "conditional", "unacceptable"]);
    }

    #[test]
    fn what_cannot_be_evaluated_is_refused() {
        let mut study = aiag();
        study.values[3][1].pop();
        assert!(gauge_study(&study, None).unwrap_err().to_string().contains("part `4`, appraiser `B` has 2"));
        let mut study = aiag();
        study.values[0][2][1] = f64::NAN;
        assert!(matches!(gauge_study(&study, None), Err(MsaError::Missing { trial: 2, .. })));
        for (parts, appraisers, trials) in [(0, 0, 0), (1, 2, 2), (2, 1, 2), (2, 2, 1)] {
            let study = Study { values: vec![vec![vec![1.0; trials]; appraisers]; parts], ..Study::default() };
            assert_eq!(gauge_study(&study, None), Err(MsaError::TooSmall { parts, appraisers, trials }));
        }
        let flat = Study { values: vec![vec![vec![1.0; 2]; 2]; 2], ..Study::default() };
        assert_eq!(gauge_study(&flat, None), Err(MsaError::Constant));
    }
}
