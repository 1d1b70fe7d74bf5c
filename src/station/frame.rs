//! Samples on their way to the page: columns as compact JSON.

use std::fmt::Write;

use crate::rig::Quality;
use crate::runner::Glance;

/// One sample of a run as the page draws it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    pub sample: usize,
    pub phase: usize,
    pub time_s: f64,
    pub pressure_bar: f64,
    pub target_bar: f64,
    pub current_a: f64,
    pub current_meas_a: f64,
    pub late_ms: f64,
    pub good: bool,
}

impl From<&Glance> for Point {
    fn from(g: &Glance) -> Self {
        Self {
            sample: g.sample,
            phase: g.phase,
            time_s: g.time_s,
            pressure_bar: g.pressure_bar,
            target_bar: g.target_bar,
            current_a: g.current_a,
            current_meas_a: g.current_meas_a,
            late_ms: g.lateness_s * 1e3,
            good: g.quality == Quality::Good,
        }
    }
}

/// The points as `{"s":site,"r":run,"n":[sample..],"f":[..],"t":[..],"p":[..],"g":[..],"c":[..],"m":[..],"l":[..],"q":[..]}`.
pub(super) fn json(site: usize, run: u64, points: &[Point]) -> String {
    let mut out = String::with_capacity(64 + 60 * points.len());
    let _ = write!(out, "{{\"s\":{site},\"r\":{run}");
    let mut column = |name: char, digits: usize, of: &dyn Fn(&Point) -> f64| {
        let _ = write!(out, ",\"{name}\":[");
        for (k, p) in points.iter().enumerate() {
            let value = of(p);
            let comma = if k > 0 { "," } else { "" };
            // JSON has no NaN; a gap is null.
            let _ = if value.is_finite() { write!(out, "{comma}{value:.digits$}") } else { write!(out, "{comma}null") };
        }
        out.push(']');
    };
    column('n', 0, &|p| p.sample as f64);
    column('f', 0, &|p| p.phase as f64);
    column('t', 3, &|p| p.time_s);
    column('p', 3, &|p| p.pressure_bar);
    column('g', 3, &|p| p.target_bar);
    column('c', 4, &|p| p.current_a);
    column('m', 4, &|p| p.current_meas_a);
    column('l', 3, &|p| p.late_ms);
    column('q', 0, &|p| f64::from(u8::from(p.good)));
    out.push('}');
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_is_null() {
        let point = Point {
            sample: 7,
            phase: 1,
            time_s: 0.07,
            pressure_bar: f64::NAN,
            target_bar: 8.0,
            current_a: 0.25,
            current_meas_a: 0.2501,
            late_ms: 0.02,
            good: false,
        };
        insta::assert_snapshot!(json(0, 3, &[point, Point { sample: 8, ..point }]), @r#"{"s":0,"r":3,"n":[7,8],"f":[1,1],"t":[0.070,0.070],"p":[null,null],"g":[8.000,8.000],"c":[0.2500,0.2500],"m":[0.2501,0.2501],"l":[0.020,0.020],"q":[0,0]}"#);
    }
}
