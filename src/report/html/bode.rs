//! The frequency response of every phase whose bandwidth was measured, over each other: gain and phase, as Bode drew them.

use maud::{Markup, html};

use crate::metrics::{Response, Segment, Signals, frequency_response};
use crate::record::{PhaseRecord, TestRecord, Trace};
use crate::report::plot::{Color, Figure, Scale};
use crate::rig::Quality;

const FREQUENCY: &str = "frequency [Hz]";

/// Gain and phase over the frequency; nothing where no phase measured a bandwidth.
pub fn bode(record: &TestRecord, trace: &Trace) -> Markup {
    let responses: Vec<(&PhaseRecord, Vec<Response>)> = record
        .phases
        .iter()
        .enumerate()
        .filter(|(_, p)| p.measurements.iter().any(|m| m.metric.starts_with("bandwidth")))
        .filter_map(|(n, p)| Some((p, response(trace, n as u16)?)))
        .collect();
    if responses.is_empty() {
        return html! {};
    }
    let mut gain = Figure::new("Gain", FREQUENCY, "gain [dB]").scales(Scale::Log, Scale::Linear).height(260);
    let mut phase = Figure::new("Phase", FREQUENCY, "phase [deg]").scales(Scale::Log, Scale::Linear).height(260);
    for (n, (record, points)) in responses.iter().enumerate() {
        let x = || points.iter().map(|p| p.frequency_hz).collect::<Vec<_>>();
        gain = gain.line(record.name.clone(), Color::nth(n), x(), points.iter().map(|p| p.gain_db).collect());
        phase = phase.line(record.name.clone(), Color::nth(n), x(), points.iter().map(|p| p.phase_deg).collect());
        for (metric, figure, level) in [("bandwidth_gain", &mut gain, -3.0), ("bandwidth_phase", &mut phase, -90.0)] {
            let found = record.measurements.iter().find(|m| m.metric == metric).and_then(|m| m.value);
            if let Some(at_hz) = found {
                *figure = figure.clone().marker(format!("{at_hz:.1} Hz"), Color::nth(n), at_hz, level);
            }
        }
    }
    let gain = gain.horizontal("-3 dB", Color::Limit, -3.0).caption("Against the gain at the lowest frequencies of the sweep.");
    let phase = phase.horizontal("-90 deg", Color::Limit, -90.0).caption("Counted from the command, dead time included.");
    html! {
        h2 { "Frequency response" }
        .columns { (gain.render()) (phase.render()) }
    }
}

/// The response of the phase of this number, from the same samples as its figures.
fn response(trace: &Trace, number: u16) -> Option<Vec<Response>> {
    let first = trace.phase.iter().position(|p| *p == number)?;
    let last = trace.phase.iter().rposition(|p| *p == number)?;
    let pairs = trace.pressure_bar.iter().zip(&trace.quality);
    let pressure_bar: Vec<f64> = pairs.map(|(p, q)| if *q == Quality::Good { *p } else { f64::NAN }).collect();
    let signals = Signals {
        time_s: &trace.time_s,
        target_bar: &trace.target_bar,
        current_a: &trace.current_a,
        pressure_bar: &pressure_bar,
        ..Signals::default()
    };
    let range = first..last + 1;
    let segment = Segment { signals, range: range.clone(), repetitions: vec![range], delay_s: 0.0, lag_s: 0.0 };
    frequency_response(&segment).ok()
}
