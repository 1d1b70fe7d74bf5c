//! Which effect and which parameter take a simulation out of the numbers.

use super::error::PhysicsError;
use super::pipeline::Pipeline;
use super::signal::Signals;

/// The error of a simulation whose pressure is not finite at sample `k` of a grid that begins at `start_s` with steps
/// of `dt_s`: found by taking out one effect after the other, then by giving its parameters their first starts.
pub(super) fn blame(pipeline: &Pipeline<'_>, (start_s, dt_s): (f64, f64), signals: &Signals<'_>, k: usize) -> PhysicsError {
    let end = (k + 1).min(signals.current_a.len());
    let cut = |channel: Option<&'_ [f64]>| channel.map(|c| c[..end].to_vec());
    let (oil, supply) = (cut(signals.oil_temp_c), cut(signals.supply_bar));
    let begin = Signals { current_a: &signals.current_a[..end], oil_temp_c: oil.as_deref(), supply_bar: supply.as_deref(), ..*signals };
    let finite = |changed: &Pipeline<'_>| {
        let (mut work, mut pressure) = (Vec::new(), Vec::new());
        changed.run(start_s, dt_s, &begin, &mut work, &mut pressure);
        pressure.iter().all(|p| p.is_finite())
    };
    let with = |effects| Pipeline { effects, ..*pipeline };
    let mut cause = "neither an effect nor its parameters alone make it so; look at the curves, the lag and the current".to_string();
    for j in 0..pipeline.effects.len() {
        let mut less = pipeline.effects.clone();
        let (effect, theta) = less.remove(j);
        if !finite(&with(less)) {
            continue;
        }
        let of = |p: usize| format!("parameter `{}` = {} {}", effect.parameters()[p].name, theta[p], effect.parameters()[p].unit.symbol);
        let mended = (0..theta.len()).find(|p| {
            let mut other = pipeline.effects.clone();
            other[j].1[*p] = effect.parameters()[*p].starts[0];
            finite(&with(other))
        });
        let parameter = mended.map_or_else(|| (0..theta.len()).map(of).collect::<Vec<_>>().join(", "), of);
        cause = format!("effect `{}`, {parameter}", effect.id());
        break;
    }
    PhysicsError::NotFinite { of_run: String::new(), sample: k + 1, time_s: start_s + k as f64 * dt_s, cause }
}
