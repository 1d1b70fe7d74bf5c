//! Law: the simulated loop falls and stands where the sampled margins say.

use hil::control::stability::{margins, sampled::SampledLoop};
use hil::control::{Addition, Controller, ControllerSettings, FeedForwardModel, Gains, Mode, Reference, linear_loop};
use hil::physics::Plant;
use hil::valve::Valve;

/// A valve of one straight line, 40 bar/A, without hysteresis and noise.
fn straight(delay: &str, lag: &str) -> Valve {
    let text = format!(
        "schema = \"hil.valve/1\"\nname = \"straight\"\ncurrent_limits = [\"0 A\", \"1 A\"]\nhysteresis = \"none\"\ndelay = \"{delay}\"\nlag = \"{lag}\"\n\
         [curve]\nascending = [40.0, 0.0]\ndescending = [40.0, 0.0]\n"
    );
    Valve::from_toml(&text, "straight").unwrap()
}

/// Whether an oscillation that was started dies away.
fn stands(valve: &Valve, rate_hz: f64, gains: Gains, samples: usize) -> bool {
    let settings = ControllerSettings {
        mode: Mode::Both,
        feed_forward: FeedForwardModel::Average,
        gains,
        threshold_bar: 0.0,
        slew_a_per_s: f64::INFINITY,
        reference: Reference::Delayed,
        addition: Addition::Current,
        period_s: 1.0 / rate_hz,
    };
    let mut plant = Plant::new(valve, settings.period_s, 0.5, None).unwrap();
    let mut controller = Controller::new(settings, valve, 0.5);
    let mut measured = None;
    let mut feedback = Vec::new();
    for k in 0..samples {
        let command = controller.step(20.0, measured);
        // A knock at the start.
        let knock = if k < 3 { 0.01 } else { 0.0 };
        measured = Some(plant.step(command.current_a) + knock);
        feedback.push(command.feedback_a);
    }
    let size = |part: &[f64]| {
        let mean = part.iter().sum::<f64>() / part.len() as f64;
        part.iter().map(|f| (f - mean).powi(2)).sum::<f64>()
    };
    let quarter = samples / 4;
    size(&feedback[3 * quarter..]) < size(&feedback[quarter..2 * quarter])
}

#[test]
fn the_simulated_limit_is_the_sampled_one_within_two_percent() {
    for rate_hz in [50.0, 100.0, 500.0] {
        for (delay, lag) in [("20 ms", "10 ms"), ("30 ms", "25 ms"), ("13 ms", "4 ms")] {
            for (kp, ki) in [(1.0, 5.0), (0.0, 20.0), (4.0, 120.0)] {
                let valve = straight(delay, lag);
                let found = linear_loop(&valve);
                let start = Gains { kp_ma_per_bar: kp, ki_ma_per_bar_s: ki };
                let db = SampledLoop::new(&found.plant, start, rate_hz).margins().gain_margin_db.unwrap();
                let factor = 10f64.powf(db / 20.0);
                let at = |share: f64| Gains { kp_ma_per_bar: kp * factor * share, ki_ma_per_bar_s: ki * factor * share };
                let samples = (20.0 * rate_hz) as usize;
                let what = format!("{rate_hz} Hz, delay {delay}, lag {lag}, K_P {kp}, K_I {ki}");
                assert!(stands(&valve, rate_hz, at(0.98), samples), "{what}: falls at 98 % of the limit");
                assert!(!stands(&valve, rate_hz, at(1.02), samples), "{what}: stands at 102 % of the limit");
                assert!(margins(&found.plant, found.delay_range_s, at(0.98), rate_hz).unwrap().sampled.margins.stable);
            }
        }
    }
}
