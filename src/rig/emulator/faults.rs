//! The fault script: what the emulated device does wrong, and when (`schema = "hil.faults/1"`).

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::units::{Current, Ratio, Time};

/// A fault script as it is typed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FaultScript {
    /// `hil.faults/1`.
    pub schema: String,
    /// Faults at fixed places.
    #[serde(default)]
    pub fault: Vec<Scheduled>,
    /// Faults at random places, the same for the same seed.
    #[serde(default)]
    pub random: Option<Random>,
}

/// A fault with its place: give one of `request`, `cycle`, `after`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scheduled {
    /// What goes wrong.
    pub kind: Kind,
    /// First request concerned, counted from 1 over everything that the device receives.
    #[serde(default)]
    pub request: Option<u64>,
    /// First request concerned, counted from 1 since the first set-point other than zero.
    #[serde(default)]
    pub cycle: Option<u64>,
    /// Time since the first set-point other than zero.
    #[serde(default)]
    pub after: Option<Time>,
    /// Number of requests concerned, default 1; 0 means all that follow.
    #[serde(default)]
    pub count: Option<u64>,
    /// Delay of `late` and `duplicate`.
    #[serde(default)]
    pub by: Option<Time>,
    /// Exception code of `exception`, number of bytes of `garbage`.
    #[serde(default)]
    pub number: Option<u8>,
    /// Limit of `clamped`.
    #[serde(default)]
    pub at: Option<Current>,
}

/// Faults at random places.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Random {
    /// Seed of the random numbers.
    pub seed: u64,
    /// Share of the requests since the first set-point other than zero.
    pub rate: Ratio,
    /// The kinds to draw from.
    pub kinds: Vec<Kind>,
    /// Requests without a fault after each fault, so that the loss in a row stays below the interlock; default 3.
    #[serde(default)]
    pub pause: Option<u64>,
}

/// What can go wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// The reply comes `by` later.
    Late,
    /// No reply; the request is carried out.
    Silent,
    /// A wrong CRC; on TCP a foreign protocol id; on a line a wrong checksum or a changed letter.
    WrongCrc,
    /// The last three bytes are missing.
    Truncated,
    /// `number` bytes of noise before the reply.
    Garbage,
    /// Noise that looks like the header of a long reply.
    GarbageHeader,
    /// Exception `number` instead of the reply; the request is not carried out.
    Exception,
    /// The reply twice, the second time `by` later.
    Duplicate,
    /// A pause of `by` in the middle of the reply.
    Gap,
    /// The request comes back before the reply, as from an adapter with local echo.
    LocalEcho,
    /// Only the request comes back: local echo with a dead device behind it.
    EchoOnly,
    /// The reply of another unit.
    WrongUnit,
    /// The reply of another function.
    WrongFunction,
    /// A register too many in the reply.
    ExtraRegister,
    /// A register too few in the reply.
    MissingRegister,
    /// The reply to the previous request instead of this one.
    Previous,
    /// Set-points above `at` become `at`.
    Clamped,
    /// The measured values and their counter stand still.
    FrozenSensor,
    /// The coil is open: no current, and the status says so where the map has the bit.
    WireBreak,
    /// The pressure sensor is open: its raw value falls below live zero.
    SensorBreak,
    /// The watchdog trips although the host talks.
    WatchdogTrip,
    /// The line is closed.
    ClosedLine,
}

impl Kind {
    /// The kinds after which the device goes on as if nothing had been.
    pub const PASSING: [Kind; 16] = [
        Kind::Late,
        Kind::Silent,
        Kind::WrongCrc,
        Kind::Truncated,
        Kind::Garbage,
        Kind::GarbageHeader,
        Kind::Exception,
        Kind::Duplicate,
        Kind::EchoOnly,
        Kind::WrongUnit,
        Kind::WrongFunction,
        Kind::ExtraRegister,
        Kind::MissingRegister,
        Kind::Previous,
        Kind::LocalEcho,
        Kind::Gap,
    ];
}

/// A fault with its parameters, at work in one request.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fault {
    /// What goes wrong.
    pub kind: Kind,
    /// Delay [s].
    pub by_s: f64,
    /// Exception code or number of bytes.
    pub number: u8,
    /// Limit of the set-point [A].
    pub at_a: f64,
}

impl Fault {
    /// A fault with the usual parameters.
    pub fn of(kind: Kind) -> Self {
        let number = if kind == Kind::Garbage { 5 } else { 6 };
        Self { kind, by_s: 0.008, number, at_a: 0.5 }
    }
}

/// A fault script at work.
#[derive(Debug, Clone)]
pub struct Faults {
    script: FaultScript,
    random: Option<Pcg64>,
    pause: u64,
}

impl Faults {
    /// No faults.
    pub fn none() -> Self {
        Self::new(FaultScript { schema: "hil.faults/1".into(), fault: vec![], random: None })
    }

    /// One fault at one place.
    pub fn once(kind: Kind, cycle: u64, by_s: f64) -> Self {
        let fault = Scheduled {
            kind,
            request: None,
            cycle: Some(cycle),
            after: None,
            count: None,
            by: Some(Time::new(by_s)),
            number: None,
            at: None,
        };
        Self::new(FaultScript { schema: "hil.faults/1".into(), fault: vec![fault], random: None })
    }

    /// A script that was read.
    pub fn new(script: FaultScript) -> Self {
        let random = script.random.as_ref().map(|r| Pcg64::seed_from_u64(r.seed));
        Self { script, random, pause: 0 }
    }

    /// Reads a script from its text.
    pub fn from_toml(text: &str, source_name: &str) -> Result<Self, String> {
        crate::document::expect_schema(text, source_name, "hil.faults/1", "a fault script").map_err(|e| e.to_string())?;
        let script: FaultScript = crate::document::parse(text, source_name).map_err(|e| e.to_string())?;
        for (index, f) in script.fault.iter().enumerate() {
            let places = [f.request.is_some(), f.cycle.is_some(), f.after.is_some()].iter().filter(|x| **x).count();
            if places != 1 {
                return Err(format!("{source_name}: fault {}: give one of `request`, `cycle`, `after`", index + 1));
            }
        }
        if let Some(r) = &script.random
            && (r.kinds.is_empty() || !(0.0..=1.0).contains(&r.rate.value()))
        {
            return Err(format!("{source_name}: `random`: a `rate` from 0 % to 100 % and one or more `kinds` are wanted"));
        }
        Ok(Self::new(script))
    }

    /// The faults at work in this request: its number, and number and time since the first current.
    pub fn at(&mut self, request: u64, cycle: Option<u64>, since_s: Option<f64>) -> Vec<Fault> {
        let mut faults = Vec::new();
        for f in &self.script.fault {
            let count = f.count.unwrap_or(1);
            let within = |n: u64, first: u64| n >= first && (count == 0 || n < first + count);
            let now = match (f.request, f.cycle, f.after) {
                (Some(first), ..) => within(request, first),
                (_, Some(first), _) => cycle.is_some_and(|n| within(n, first)),
                (.., Some(after)) => since_s.is_some_and(|t| t >= after.value()),
                _ => false,
            };
            if now {
                let usual = Fault::of(f.kind);
                faults.push(Fault {
                    kind: f.kind,
                    by_s: f.by.map_or(usual.by_s, |t| t.value()),
                    number: f.number.unwrap_or(usual.number),
                    at_a: f.at.map_or(usual.at_a, |a| a.value()),
                });
            }
        }
        if let (Some(r), Some(random), Some(_)) = (&self.script.random, &mut self.random, cycle) {
            // Both numbers are drawn always, so that one fault more does not move all that follow.
            let (hit, pick, by) = (random.random::<f64>(), random.random_range(0..r.kinds.len()), random.random_range(0.001..0.03));
            if self.pause > 0 {
                self.pause -= 1;
            } else if hit < r.rate.value() {
                self.pause = r.pause.unwrap_or(3);
                faults.push(Fault { by_s: by, ..Fault::of(r.kinds[pick]) });
            }
        }
        faults
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_script_names_its_places() {
        let text = "schema = \"hil.faults/1\"\n[[fault]]\nkind = \"late\"\ncycle = 3\ncount = 2\nby = \"11 ms\"\n";
        let mut faults = Faults::from_toml(text, "f.toml").unwrap();
        let mut hits = Vec::new();
        for cycle in 1..8 {
            hits.extend(faults.at(cycle + 10, Some(cycle), None).into_iter().map(|f| (cycle, f.kind, f.by_s)));
        }
        assert_eq!(hits, [(3, Kind::Late, 0.011), (4, Kind::Late, 0.011)]);
        let error = Faults::from_toml("schema = \"hil.faults/1\"\n[[fault]]\nkind = \"late\"\n", "f.toml").unwrap_err();
        assert_eq!(error, "f.toml: fault 1: give one of `request`, `cycle`, `after`");
    }

    #[test]
    fn random_faults_are_those_of_the_seed() {
        let text = "schema = \"hil.faults/1\"\n[random]\nseed = 4\nrate = \"10 %\"\nkinds = [\"late\", \"silent\"]\n";
        let run = || {
            let mut faults = Faults::from_toml(text, "f.toml").unwrap();
            (1..500).map(|n| faults.at(n, Some(n), None)).collect::<Vec<_>>()
        };
        assert_eq!(run(), run());
        let count = run().iter().filter(|f| !f.is_empty()).count();
        assert!((20..60).contains(&count), "{count}");
    }
}
