//! The controller of the paper: feed-forward by the inverse model plus PI, within limits of current and slew.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use super::{FeedForward, FeedForwardModel, Gains, Pi};
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
    /// The target as the valve model would follow it, after its dead time and its lag: the PI does not fight what the
    /// feed-forward has already sent.
    #[default]
    Delayed,
    /// The present target.
    Direct,
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
#[derive(Debug, Clone)]
pub struct Controller {
    settings: ControllerSettings,
    feed_forward: FeedForward,
    pi: Pi,
    limits_a: (f64, f64),
    delay_s: f64,
    /// Share of a step that the model's lag lets through in one period.
    lag_share: f64,
    last_a: f64,
    /// Past targets, the newest first; as many as the dead time needs.
    targets: VecDeque<f64>,
    /// The delayed target behind the lag.
    expected_bar: Option<f64>,
}

impl Controller {
    /// A controller that believes in `valve`, starting at `current_a`.
    pub fn new(settings: ControllerSettings, valve: &Valve, current_a: f64) -> Self {
        Self {
            settings,
            feed_forward: FeedForward::new(settings.feed_forward, valve, current_a),
            pi: Pi::default(),
            limits_a: valve.current_limits_a,
            delay_s: valve.delay_s,
            lag_share: if valve.lag_s > 0.0 { 1.0 - (-settings.period_s / valve.lag_s).exp() } else { 1.0 },
            last_a: current_a,
            targets: VecDeque::new(),
            expected_bar: None,
        }
    }

    /// Closes the loop at the current that flows.
    pub fn engage(&mut self, current_a: f64) {
        self.last_a = current_a;
        self.pi.reset();
        self.targets.clear();
        self.expected_bar = None;
    }

    /// Follows a current that somebody else commands, in open loop, so that the model's memory stays true.
    pub fn follow(&mut self, current_a: f64) {
        self.last_a = current_a;
        self.feed_forward.follow(current_a);
    }

    /// Changes the settings without a jump of the feedback. A changed feed-forward model starts at `valve`'s average.
    pub fn change(&mut self, settings: ControllerSettings, valve: &Valve) {
        if settings.feed_forward != self.settings.feed_forward {
            self.feed_forward = FeedForward::new(settings.feed_forward, valve, self.last_a);
        }
        self.settings = settings;
        self.pi.rebase();
    }

    /// The command for `target_bar`, after the measured pressure, `None` where no usable sample came.
    pub fn step(&mut self, target_bar: f64, measured_bar: Option<f64>) -> Command {
        let settings = self.settings;
        let base = match settings.mode {
            Mode::Feedback => 0.0,
            Mode::FeedForward | Mode::Both => self.feed_forward.current_for(target_bar),
        };
        let reference = self.remember(target_bar);
        let reach = settings.slew_a_per_s * settings.period_s;
        let range = ((self.last_a - reach).max(self.limits_a.0), (self.last_a + reach).min(self.limits_a.1));
        let acts = match settings.mode {
            Mode::FeedForward => false,
            Mode::Feedback => true,
            Mode::Both => reference > settings.threshold_bar,
        };
        let feedback = match measured_bar.filter(|p| p.is_finite()) {
            _ if !acts => self.pi.fade(settings.period_s),
            None => self.pi.hold(),
            Some(measured) => self.pi.step(settings.gains, reference - measured, settings.period_s, base, range),
        };
        // `range` is never crossed: the last command lies within the limits, or the limit is what is reached.
        let current_a = (base + feedback).max(range.0.min(self.limits_a.1)).min(range.1.max(self.limits_a.0));
        self.last_a = current_a;
        Command { current_a, feed_forward_a: base, feedback_a: current_a - base }
    }

    /// Notes `target_bar` and gives the target that the PI compares with.
    fn remember(&mut self, target_bar: f64) -> f64 {
        if self.settings.reference == Reference::Direct {
            return target_bar;
        }
        let delay = self.delay_s / self.settings.period_s;
        let wanted = delay.ceil() as usize + 1;
        self.targets.push_front(target_bar);
        self.targets.truncate(wanted);
        let at = |i: usize| self.targets.get(i).or(self.targets.back()).copied().unwrap_or(target_bar);
        let (whole, part) = (delay.floor() as usize, delay.fract());
        let delayed = at(whole) * (1.0 - part) + at(whole + 1) * part;
        let before = self.expected_bar.unwrap_or(delayed);
        *self.expected_bar.insert(before + self.lag_share * (delayed - before))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
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

    #[test]
    fn the_reference_of_the_feedback_is_delayed() {
        let mut controller = Controller::new(settings(), &valve(), 0.5);
        controller.step(10.0, Some(10.0));
        // The new target is not yet to be expected: two periods without error, then the whole step at once.
        let feedback: Vec<f64> = (0..3).map(|_| controller.step(12.0, Some(10.0)).feedback_a).collect();
        assert!(feedback[0].abs() < 1e-12 && feedback[1].abs() < 1e-12, "{feedback:?}");
        assert!((feedback[2] - (2e-3 + 1e-4)).abs() < 1e-12, "{feedback:?}");
    }

    #[test]
    fn what_the_model_expects_is_no_error() {
        // A valve that follows with dead time and lag exactly as the model says leaves the feedback at rest.
        let valve = Valve { lag_s: 0.03, ..valve() };
        let mut controller = Controller::new(settings(), &valve, 0.5);
        let (mut pressure, mut line) = (10.0, VecDeque::from([10.0; 2]));
        for k in 0..200 {
            let target = if k < 20 { 10.0 } else { 14.0 };
            line.push_front(target);
            pressure += (1.0 - (-0.01f64 / 0.03).exp()) * (line.pop_back().unwrap_or(10.0) - pressure);
            assert!(controller.step(target, Some(pressure)).feedback_a.abs() < 1e-12, "{k}");
        }
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
        assert!((after - before - 1e-4).abs() < 1e-12, "{before} then {after}");
    }
}
