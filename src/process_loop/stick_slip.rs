//! The valve that sticks: from the controller's output to the position of the stem, with two parameters.
//!
//! The stem rests until output and position are (S + J)/2 apart, and then moves to within (S - J)/2 of the output: after a
//! turn the output travels S before anything happens (dead band and stick band), and then the stem slips by J.
//!
//! Source: Choudhury, Thornhill and Shah, Control Eng. Practice 13 (2005) 641; Kano, Maruta, Kugemoto and Shimizu, IFAC
//! DYCOPS (2004) 303; He, Wang, Pottmann and Qin, Ind. Eng. Chem. Res. 46 (2007) 4549.

/// How the stem goes on once it has broken away.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// It sticks again after each move (He).
    Steps,
    /// It slides until the output turns or rests (Kano, Choudhury).
    Slides,
}

/// A stem with friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StickSlip {
    /// Dead band and stick band, S [unit of the output].
    pub band: f64,
    /// Slip jump, J [unit of the output]; at most the band.
    pub jump: f64,
    /// How it goes on.
    pub motion: Motion,
    /// Where the stem stands at first between the places at which it breaks away: -1 to 1.
    pub start: f64,
}

impl StickSlip {
    /// Stems with these bands (from, to, how many, in equal ratios), and jumps as shares of the band.
    pub fn grid((from, to, count): (f64, f64, usize), jumps: &[f64]) -> Vec<Self> {
        let ratio = |k: usize| (to / from).powf(k as f64 / (count - 1) as f64);
        let bands = (0..count).map(|k| from * ratio(k));
        let pairs = bands.flat_map(|band| jumps.iter().map(move |share| (band, share * band)));
        pairs.flat_map(|(band, jump)| [Motion::Steps, Motion::Slides].map(|motion| Self { band, jump, motion, start: 0.0 })).collect()
    }

    /// Distance of output and position at which the stem breaks away, and that which is left when it moves.
    pub fn friction(&self) -> (f64, f64) {
        (0.5 * (self.band + self.jump), 0.5 * (self.band - self.jump))
    }

    /// The position at each sample of the output; how often the stem broke away.
    pub fn follow(&self, output: &[f64], position: &mut Vec<f64>) -> usize {
        position.clear();
        let (resting, moving) = self.friction();
        let mut last = output.first().copied().unwrap_or(0.0);
        let mut x = last + self.start * resting;
        let (mut sliding, mut slips) = (0.0, 0);
        for u in output {
            let travel = u - last;
            last = *u;
            if travel * sliding <= 0.0 {
                sliding = 0.0;
            }
            if sliding != 0.0 {
                x = u - sliding * moving;
            } else if (u - x).abs() > resting {
                let direction = (u - x).signum();
                x = u - direction * moving;
                slips += 1;
                if self.motion == Motion::Slides {
                    sliding = direction;
                }
            }
            position.push(x);
        }
        slips
    }
}
