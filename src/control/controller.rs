//! The controller of the paper: feed-forward by the inverse model plus PI, within limits of current and slew.

use serde::{Deserialize, Serialize};

use super::expectation::{Expectation, Undone};
use super::significance::Significance;
use super::{FeedForward, FeedForwardModel, Gains, Pi, linear_loop};
use crate::valve::Valve;

/// Which parts act.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// The inverse model alone.
    FeedForward,
    /// The PI alone, active at every pressure.
    Feedback,
    /// Both; the PI above the threshold only.
    #[default]
    Both,
}

/// Which target the PI compares the measured pressure with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Reference {
    /// The pressure that the valve model gives for what the feed-forward alone has sent, with its dead time and its lag: the PI does
    /// not fight what is already on its way.
    #[default]
    #[doc(alias("two degrees of freedom", "Smith predictor"))]
    Delayed,
    /// The present target.
    Direct,
}

/// Where the feedback is added.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Addition {
    /// To the target, as the pressure that its current would give; the memory of the feed-forward knows of it, and what is no more
    /// than noise is withheld.
    #[default]
    Pressure,
    /// To the current of the feed-forward, whose memory does not know of it: the paper's controller.
    Current,
}

/// Settings of the controller, all checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControllerSettings {
    /// Which parts act.
    pub mode: Mode,
    /// Model that the feed-forward inverts.
    pub feed_forward: FeedForwardModel,
    /// Gains of the PI.
    pub gains: Gains,
    /// Target above which the PI acts in [`Mode::Both`] [bar].
    pub threshold_bar: f64,
    /// Largest rate of the current [A/s]; infinite for none.
    pub slew_a_per_s: f64,
    /// What the PI compares with.
    pub reference: Reference,
    /// Where the feedback is added.
    pub addition: Addition,
    /// Loop period [s].
    pub period_s: f64,
}

/// One command with its parts, which add up to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// The current to apply [A].
    pub current_a: f64,
    /// Part of the feed-forward [A].
    pub feed_forward_a: f64,
    /// Part of the feedback, with what the limits cut [A].
    pub feedback_a: f64,
}

/// The controller with its memory.
///
/// Feedback acts in pressure: its current times the slope of the curve is added to the target, and one inverse model, whose
/// memory moves with the current that is really sent, gives the current for the sum. So small reversals of the feedback do not
/// make the feed-forward forget where in its loop the valve stands, and the gain of the loop is that of the curve, on either
/// branch.
pub struct Controller {
    settings: ControllerSettings,
    /// The feed-forward as if it acted alone.
    alone: FeedForward,
    /// The same model, moved along with the current that is sent.
    sent: FeedForward,
    undone: Option<Undone>,
    expectation: Expectation,
    pi: Pi,
    significance: Significance,
    limits_a: (f64, f64),
    alone_a: f64,
    last_a: f64,
}

impl Controller {
    /// A controller that believes in `valve`, starting at `current_a`.
    pub fn new(settings: ControllerSettings, valve: &Valve, current_a: f64) -> Self {
        Self {
            settings,
            alone: FeedForward::new(settings.feed_forward, valve, current_a),
            sent: FeedForward::new(settings.feed_forward, valve, current_a),
            undone: undone(settings, valve, current_a),
            expectation: Expectation::new(valve, settings.period_s, current_a),
            pi: Pi::default(),
            significance: Significance::new(valve, settings.period_s),
            limits_a: valve.current_limits_a,
            alone_a: current_a,
            last_a: current_a,
        }
    }

    /// Closes the loop at the current that flows.
    pub fn engage(&mut self, current_a: f64) {
        (self.last_a, self.alone_a) = (current_a, current_a);
        self.pi.reset();
        self.significance.reset();
    }

    /// Follows a current that somebody else commands, in open loop, so that the model's memory stays true.
    pub fn follow(&mut self, current_a: f64) {
        (self.last_a, self.alone_a) = (current_a, current_a);
        self.alone.follow(current_a);
        self.sent.follow(current_a);
        self.expectation.step(current_a);
        if let Some(undone) = &mut self.undone {
            undone.sent(current_a, self.alone.pressure_bar(current_a));
        }
    }

    /// Changes the settings without a jump of the feedback. A changed feed-forward model starts at `valve`'s average.
    pub fn change(&mut self, settings: ControllerSettings, valve: &Valve) {
        if settings.feed_forward != self.settings.feed_forward {
            self.alone = FeedForward::new(settings.feed_forward, valve, self.last_a);
            self.sent = self.alone.clone();
            self.undone = undone(settings, valve, self.last_a);
        }
        self.settings = settings;
        self.pi.rebase();
    }

    /// The command for `target_bar`, after the measured pressure, `None` where no usable sample came.
    pub fn step(&mut self, target_bar: f64, measured_bar: Option<f64>) -> Command {
        let settings = self.settings;
        let measured = measured_bar.filter(|p| p.is_finite());
        let wanted_bar = self.undone.as_mut().map_or(target_bar, |u| u.ask(target_bar));
        self.alone_a = self.alone.current_for(wanted_bar, self.range(self.alone_a));
        if let Some(undone) = &mut self.undone {
            undone.sent(self.alone_a, self.alone.pressure_bar(self.alone_a));
        }
        let expected = self.expectation.step(self.alone_a).unwrap_or(target_bar);
        let reference = if settings.reference == Reference::Direct { target_bar } else { expected };
        let base = if settings.mode == Mode::Feedback { 0.0 } else { self.alone_a };
        let range = self.range(self.last_a);
        let acts = match settings.mode {
            Mode::FeedForward => false,
            Mode::Feedback => true,
            Mode::Both => reference > settings.threshold_bar,
        };
        let withheld_bar = if settings.addition == Addition::Pressure { self.significance.withheld_bar() } else { 0.0 };
        let feedback_a = match measured {
            _ if !acts => self.pi.fade(settings.period_s),
            None => self.pi.hold(),
            Some(measured) => self.pi.step(settings.gains, reference - measured - withheld_bar, settings.period_s, base, range),
        };
        let current_a = if settings.mode == Mode::Feedback || settings.addition == Addition::Current {
            let current_a = (base + feedback_a).clamp(range.0, range.1);
            self.sent.follow(current_a);
            current_a
        } else {
            let slope = self.sent.slope_bar_per_a(wanted_bar);
            let correction_bar = self.significance.step(slope * feedback_a, settings.gains);
            self.sent.current_for(wanted_bar + correction_bar, range)
        };
        self.last_a = current_a;
        Command { current_a, feed_forward_a: base, feedback_a: current_a - base }
    }

    /// Currents that can be reached from `from_a` within one period.
    fn range(&self, from_a: f64) -> (f64, f64) {
        let reach = self.settings.slew_a_per_s * self.settings.period_s;
        let (low, high) = ((from_a - reach).max(self.limits_a.0), (from_a + reach).min(self.limits_a.1));
        (low.min(self.limits_a.1), high.max(self.limits_a.0))
    }
}

/// What the feed-forward undoes beyond the curve, where it is asked to.
fn undone(settings: ControllerSettings, valve: &Valve, current_a: f64) -> Option<Undone> {
    (settings.feed_forward == FeedForwardModel::Model).then(|| {
        let found = linear_loop(valve);
        // The linear loop keeps the largest lag and counts the others as delay.
        let lag_s = found.plant.lag_s + (found.plant.delay_s - valve.delay_s).max(0.0);
        Undone::new(valve, lag_s, settings.period_s, current_a)
    })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use std::collections::VecDeque;

    use crate::physics::Plant;
    use crate::valve::HyperbolaState;

    pub fn valve() -> Valve {
        let text = r#"
            schema = "hil.valve/1"
            name = "test"
            current_limits = ["0 A", "1 A"]
            hysteresis.hyperbolic.a = "0.8 bar^2"
            delay = "20 ms"
            floor = "0 bar"
            curve.ascending = [-42.65, 92.5, -8.4, -2.03]
            curve.descending = [-40.01, 83.32, -1.3, -2.41]
        "#;
        Valve::from_toml(text, "test").unwrap()
    }

    pub fn settings() -> ControllerSettings {
        ControllerSettings {
            mode: Mode::Both,
            feed_forward: FeedForwardModel::Hyperbolic,
            gains: Gains::PAPER,
            threshold_bar: 6.0,
            slew_a_per_s: f64::INFINITY,
            reference: Reference::Delayed,
            addition: Addition::Pressure,
            period_s: 0.01,
        }
    }

    /// Runs the controller on a valve that is `offset_bar` above the model, with two periods of delay.
    fn steady_error(settings: ControllerSettings, offset_bar: f64) -> f64 {
        let valve = valve();
        let mut controller = Controller::new(settings, &valve, 0.3);
        let mut plant = HyperbolaState::start(0.8, 0.3, valve.curves.average_at(0.3));
        let mut line = VecDeque::from([plant.pressure_bar(); 2]);
        for _ in 0..3000 {
            let measured = line.pop_back().unwrap() + offset_bar;
            let command = controller.step(20.0, Some(measured));
            line.push_front(plant.advance(&valve.curves, command.current_a));
        }
        line[0] + offset_bar - 20.0
    }

    #[test]
    fn feedback_removes_what_the_model_does_not_know() {
        assert!((steady_error(ControllerSettings { mode: Mode::FeedForward, ..settings() }, 0.5) - 0.5).abs() < 1e-6);
        assert!(steady_error(settings(), 0.5).abs() < 1e-3);
        let alone = ControllerSettings { mode: Mode::Feedback, gains: Gains { ki_ma_per_bar_s: 50.0, ..Gains::PAPER }, ..settings() };
        assert!(steady_error(alone, 0.5).abs() < 1e-3);
    }

    #[test]
    fn below_the_threshold_there_is_no_feedback() {
        let mut controller = Controller::new(settings(), &valve(), 0.1);
        for _ in 0..100 {
            assert_eq!(controller.step(5.0, Some(0.0)).feedback_a, 0.0);
        }
    }

    /// A valve that is exactly as the model says, with its noise.
    fn errors(settings: ControllerSettings, valve: &Valve, samples: usize, target: impl Fn(usize) -> f64) -> (Vec<f64>, Vec<f64>) {
        let mut plant = Plant::new(valve, 0.01, 0.0, Some(4)).unwrap();
        let mut clean = Plant::new(valve, 0.01, 0.0, None).unwrap();
        let mut controller = Controller::new(settings, valve, 0.0);
        let (mut measured, mut pressures, mut feedback) = (None, Vec::new(), Vec::new());
        for k in 0..samples {
            let command = controller.step(target(k), measured);
            feedback.push(command.feedback_a);
            measured = Some(plant.step(command.current_a));
            pressures.push(clean.step(command.current_a));
        }
        (pressures, feedback)
    }

    fn tip_in(k: usize) -> f64 {
        match k % 600 {
            0..200 => 8.0,
            200..240 => 8.0 + 0.4 * (k % 600 - 200) as f64,
            240..500 => 24.0,
            500..530 => 24.0 - 16.0 / 30.0 * (k % 600 - 500) as f64,
            _ => 8.0,
        }
    }

    #[test]
    fn on_a_perfect_valve_feedback_does_nothing() {
        for (gains, lag_s, noise_bar) in [
            (Gains::PAPER, 0.0, 0.02),
            (Gains::PAPER, 0.01, 0.02),
            (Gains { kp_ma_per_bar: 5.0, ki_ma_per_bar_s: 200.0 }, 0.01, 0.05),
            (Gains::PAPER, 0.025, 0.0),
        ] {
            for delay_s in [0.02, 0.0137] {
                let valve = Valve { lag_s, noise_bar, delay_s, ..valve() };
                let alone = errors(ControllerSettings { mode: Mode::FeedForward, ..settings() }, &valve, 3000, tip_in).0;
                let (both, feedback) = errors(ControllerSettings { gains, ..settings() }, &valve, 3000, tip_in);
                let largest = feedback.iter().fold(0.0f64, |l, f| l.max(f.abs()));
                let apart = alone.iter().zip(&both).fold(0.0f64, |l, (a, b)| l.max((a - b).abs()));
                assert!(largest < 1e-9 && apart < 1e-6, "{gains:?}, lag {lag_s}, delay {delay_s}: {largest} A, {apart} bar");
            }
        }
    }

    #[test]
    fn the_model_inverse_leaves_less_than_the_curve_inverse() {
        let valve = Valve { lag_s: 0.025, noise_bar: 0.0, ..valve() };
        let rms = |feed_forward: FeedForwardModel| {
            let settings = ControllerSettings { mode: Mode::FeedForward, feed_forward, ..settings() };
            let pressures = errors(settings, &valve, 3000, tip_in).0;
            // The pressure may be late by the dead time: two periods.
            let sum: f64 = (600..3000).map(|k| (pressures[k] - tip_in(k - 2)).powi(2)).sum();
            (sum / 2400.0).sqrt()
        };
        let (curve, model) = (rms(FeedForwardModel::Hyperbolic), rms(FeedForwardModel::Model));
        assert!(model < 0.3 * curve, "{model} against {curve}");
    }

    #[test]
    fn slew_and_limits_hold() {
        let mut controller = Controller::new(ControllerSettings { slew_a_per_s: 2.0, ..settings() }, &valve(), 0.1);
        let mut last = 0.1;
        for k in 0..200 {
            let target = if k % 40 < 20 { 60.0 } else { 0.0 };
            let command = controller.step(target, Some(10.0));
            assert!((command.current_a - last).abs() <= 0.02 + 1e-12 && (0.0..=1.0).contains(&command.current_a));
            assert!((command.feed_forward_a + command.feedback_a - command.current_a).abs() < 1e-15);
            last = command.current_a;
        }
    }

    #[test]
    fn a_lost_sample_holds_the_feedback() {
        let mut controller = Controller::new(settings(), &valve(), 0.5);
        for _ in 0..50 {
            controller.step(15.0, Some(14.0));
        }
        let before = controller.step(15.0, None).feedback_a;
        assert_eq!(controller.step(15.0, Some(f64::NAN)).feedback_a, before);
    }

    #[test]
    fn switching_the_gains_does_not_jump() {
        let mut controller = Controller::new(settings(), &valve(), 0.5);
        let mut before = 0.0;
        for _ in 0..100 {
            before = controller.step(15.0, Some(14.0)).feedback_a;
        }
        controller.change(ControllerSettings { gains: Gains { kp_ma_per_bar: 10.0, ki_ma_per_bar_s: 10.0 }, ..settings() }, &valve());
        let after = controller.step(15.0, Some(14.0)).feedback_a;
        assert!((after - before).abs() < 5e-4, "{before} then {after}");
    }
}
