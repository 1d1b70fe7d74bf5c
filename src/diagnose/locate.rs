//! Where a residual lies: when, at which operating points, at which frequencies.

use super::diagnosis::{Place, Region, Window};
use super::evidence::Evidence;

/// Windows that a run is cut into.
const WINDOWS: usize = 60;
/// Bins of each variable.
const BINS: usize = 8;
/// Most windows and regions that are listed.
const LISTED: usize = 8;
/// A rate below this is rest [A/s].
const REST_A_PER_S: f64 = 2e-3;

/// A variable of the operating point, one value per sample.
pub struct Variable {
    /// Its name with the unit.
    pub name: &'static str,
    /// Its values.
    pub values: Vec<f64>,
}

/// The operating point of every sample: pressure (simulated), current, rate, and the history of reversals.
pub fn variables(evidence: &Evidence, simulated_bar: &[f64]) -> Vec<Variable> {
    let n = evidence.samples();
    let mut columns: [Vec<f64>; 6] = std::array::from_fn(|_| Vec::with_capacity(n));
    for grid in &evidence.grids {
        let (mut reversal_a, mut since_s, mut dwell_s, mut direction) = (grid.current_a[0], 0.0, 0.0, 0.0);
        let reach = ((0.03 / grid.dt_s) as usize).max(1);
        for k in 0..grid.current_a.len() {
            let behind = k.saturating_sub(reach);
            let rate = (grid.current_a[k] - grid.current_a[behind]) / ((k - behind).max(1) as f64 * grid.dt_s);
            if rate.abs() > REST_A_PER_S {
                if rate.signum() != direction {
                    (direction, reversal_a, since_s) = (rate.signum(), grid.current_a[k], 0.0);
                }
                dwell_s = 0.0;
            } else {
                dwell_s += grid.dt_s;
            }
            since_s += grid.dt_s;
            columns[1].push(grid.current_a[k]);
            columns[2].push(rate);
            columns[3].push((grid.current_a[k] - reversal_a).abs());
            columns[4].push(since_s);
            columns[5].push(dwell_s);
        }
    }
    columns[0] = simulated_bar.to_vec();
    let time = evidence.grids.iter().flat_map(|g| (0..g.len()).map(|k| g.elapsed_s + k as f64 * g.dt_s)).collect();
    let names = ["pressure_bar", "current_a", "rate_a_per_s", "distance_since_reversal_a", "time_since_reversal_s", "dwell_s"];
    let mut all: Vec<Variable> = names.into_iter().zip(columns).map(|(name, values)| Variable { name, values }).collect();
    all.push(Variable { name: "time_s", values: time });
    all
}

/// Bins of a variable with about equal counts: for each its range and the samples in it.
pub fn bins(values: &[f64], residual: &[f64], count: usize) -> Vec<(f64, f64, Vec<usize>)> {
    let mut order: Vec<usize> = (0..values.len()).filter(|k| residual[*k].is_finite() && values[*k].is_finite()).collect();
    order.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let per = order.len().div_ceil(count).max(1);
    order.chunks(per).map(|c| (values[c[0]], values[c[c.len() - 1]], c.to_vec())).collect()
}

/// Bins of one single value joined with the next where that begins with the same value: which sample lies in which would be chance.
fn whole_ties(bins: Vec<(f64, f64, Vec<usize>)>) -> Vec<(f64, f64, Vec<usize>)> {
    let mut out: Vec<(f64, f64, Vec<usize>)> = Vec::new();
    for (from, to, members) in bins {
        match out.last_mut() {
            Some(last) if last.0 == last.1 && last.1 == from => {
                last.1 = to;
                last.2.extend(members);
            }
            _ => out.push((from, to, members)),
        }
    }
    out
}

/// Splits the squared error of `residual` by time, by operating region and by frequency.
pub fn locate(evidence: &Evidence, residual: &[f64], simulated_bar: &[f64]) -> Place {
    let total: f64 = residual.iter().filter(|e| e.is_finite()).map(|e| e * e).sum::<f64>().max(1e-300);
    let noise = evidence.noise_bar * evidence.noise_bar;
    let mut regions: Vec<Region> = Vec::new();
    for variable in variables(evidence, simulated_bar).iter().filter(|v| v.name != "time_s") {
        let all = whole_ties(bins(&variable.values, residual, BINS));
        let samples: usize = all.iter().map(|b| b.2.len()).sum();
        regions.extend(all.into_iter().map(|(from, to, members)| Region {
            variable: variable.name.into(),
            from,
            to,
            share: members.iter().map(|k| residual[*k] * residual[*k]).sum::<f64>() / total,
            samples_share: members.len() as f64 / samples.max(1) as f64,
            mean_bar: members.iter().map(|k| residual[*k]).sum::<f64>() / members.len().max(1) as f64,
        }));
    }
    regions.retain(|r| r.share > 1.3 * r.samples_share);
    regions.sort_by(|a, b| (b.share / b.samples_share).total_cmp(&(a.share / a.samples_share)));
    regions.truncate(LISTED);
    Place { windows: windows(evidence, residual, total, noise), regions, band_hz: band(evidence, residual) }
}

/// The windows that carry more than twice their part, neighbours joined, largest share first.
fn windows(evidence: &Evidence, residual: &[f64], total: f64, noise: f64) -> Vec<Window> {
    let samples: usize = residual.iter().filter(|e| e.is_finite()).count();
    let mut found: Vec<Window> = Vec::new();
    let mut begin = 0;
    for grid in &evidence.grids {
        let n = grid.current_a.len();
        let per = n.div_ceil(WINDOWS.min(n / 10 + 1));
        let mut open: Option<Window> = None;
        for from in (0..n).step_by(per) {
            let to = (from + per).min(n);
            let part: Vec<f64> = residual[begin + from..begin + to].iter().copied().filter(|e| e.is_finite()).collect();
            let share = part.iter().map(|e| e * e).sum::<f64>() / total;
            let hot = share > 2.0 * part.len() as f64 / samples.max(1) as f64;
            let noise_share = (part.len() as f64 * noise / total).min(1.0);
            match (&mut open, hot) {
                (Some(w), true) => {
                    w.to_s = grid.time_s(to - 1);
                    w.share += share;
                    w.noise_share += noise_share;
                }
                (None, true) => {
                    open = Some(Window { run: grid.name.clone(), from_s: grid.time_s(from), to_s: grid.time_s(to - 1), share, noise_share })
                }
                _ => found.extend(open.take()),
            }
        }
        found.extend(open);
        begin += n;
    }
    found.sort_by(|a, b| b.share.total_cmp(&a.share));
    found.truncate(LISTED);
    found
}

/// The frequencies between which the middle four fifths of the energy beyond the white noise lie [Hz].
fn band(evidence: &Evidence, residual: &[f64]) -> Option<(f64, f64)> {
    let (samples, run) = evidence.longest();
    let (n, dt_s) = (samples.len(), run.dt_s);
    let mut input: Vec<f64> = residual[samples].iter().map(|e| if e.is_finite() { *e } else { 0.0 }).collect();
    let mean = input.iter().sum::<f64>() / n as f64;
    input.iter_mut().for_each(|e| *e -= mean);
    let plan = realfft::RealFftPlanner::<f64>::new().plan_fft_forward(n);
    let mut spectrum = plan.make_output_vec();
    plan.process(&mut input, &mut spectrum).ok()?;
    let white = n as f64 * evidence.noise_bar * evidence.noise_bar;
    let excess: Vec<f64> = spectrum.iter().map(|c| c.norm_sqr() - white).collect();
    let total: f64 = excess.iter().sum();
    if total < 0.3 * white * excess.len() as f64 {
        return None;
    }
    let at = |share: f64| {
        let mut sum = 0.0;
        let k = excess.iter().position(|e| {
            sum += e;
            sum >= share * total
        });
        k.unwrap_or(excess.len() - 1) as f64 / (n as f64 * dt_s)
    };
    Some((at(0.1), at(0.9)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_of_one_value_are_in_one_place() {
        let values = [0.0; 6].into_iter().chain([1.0, 2.0, 3.0, 4.0]).collect::<Vec<f64>>();
        let all = whole_ties(bins(&values, &[1.0; 10], 5));
        let ranges: Vec<(f64, f64, usize)> = all.iter().map(|b| (b.0, b.1, b.2.len())).collect();
        assert_eq!(ranges, [(0.0, 0.0, 6), (1.0, 2.0, 2), (3.0, 4.0, 2)]);
    }
}
