//! One instance of the model: its state in the order of the interface's calls, and its simulator.

use std::collections::VecDeque;
use std::path::Path;

use hil::exchange::fmu::{
    CURRENT_IN, CURRENT_OUT, CURVE_PRESSURE_OUT, Causality, MODEL_TIME_OUT, Meaning, OIL_TEMPERATURE_IN, PART_FILE, PRESSURE_IN,
    PRESSURE_OUT, Part, SEED, STEP_FILE, SUPPLY_PRESSURE_IN, VALVE_FILE, Variable, set, token, variables,
};
use hil::physics::{Channel, Plant};
use hil::valve::Valve;

/// How much of the past is simulated again where a parameter changes in mid-run [s]: as if it had always been so.
const MEMORY_S: f64 = 100.0;
/// A time this share of a step before a sample counts as that sample's.
const CLOSE: f64 = 1e-6;

/// Why a call was refused.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refused(pub String);

impl Refused {
    fn because<T>(why: impl Into<String>) -> Result<T, Self> {
        Err(Self(why.into()))
    }
}

/// Where in the order of calls an instance stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// Made, not yet initialising.
    Made,
    /// Between entering and leaving the initialisation.
    Initialising,
    /// Steps may be done.
    Stepping,
    /// The end.
    Terminated,
}

/// What a master sets at the begin of a step.
#[derive(Debug, Clone, Copy)]
struct Inputs {
    current_a: f64,
    /// Pressure of the model ahead, for effects behind one [bar].
    pressure_bar: f64,
    /// Where an effect of the model uses them.
    oil_temp_c: Option<f64>,
    supply_bar: Option<f64>,
}

/// What a master reads at the end of a step.
#[derive(Debug, Clone, Copy)]
struct Outputs {
    pressure_bar: f64,
    curve_current_a: f64,
    curve_pressure_bar: f64,
}

/// One instance of an exported model.
pub struct Instance {
    made_from: Valve,
    valve: Valve,
    variables: Vec<Variable>,
    step_s: f64,
    phase: Phase,
    seed: u64,
    part: Part,
    inputs: Inputs,
    outputs: Outputs,
    /// Time of the master at the initialisation [s].
    start_s: f64,
    /// Steps done since then.
    steps: u64,
    plant: Option<Plant>,
    /// The inputs of the steps that are remembered.
    past: VecDeque<Inputs>,
}

impl Instance {
    /// An instance of the model in this folder, if it is the one that the master's description belongs to.
    ///
    /// # Errors
    /// [`Refused`] where the model cannot be read or is another one.
    pub fn new(resources: &Path, wanted: &str) -> Result<Self, Refused> {
        let read = |name: &str| {
            let path = resources.join(name);
            std::fs::read_to_string(&path).map_err(|e| Refused(format!("{}: {e}", path.display())))
        };
        let text = read(VALVE_FILE)?;
        let step = read(STEP_FILE)?;
        let step_s: f64 = step.trim().parse().map_err(|_| Refused(format!("{STEP_FILE}: `{}` is no time", step.trim())))?;
        if !(step_s.is_finite() && step_s > 0.0) {
            return Refused::because(format!("{STEP_FILE}: {step_s} s is no step"));
        }
        let part = read(PART_FILE)?;
        let part = Part::of(part.trim()).ok_or_else(|| Refused(format!("{PART_FILE}: `{}` is no part", part.trim())))?;
        let have = token(&text, part, step_s);
        if have != wanted {
            return Refused::because(format!("the description is of model {wanted}, the resources hold {have}"));
        }
        let valve = Valve::from_toml(&text, VALVE_FILE).map_err(|e| Refused(e.to_string()))?;
        Self::of(valve, part, step_s)
    }

    /// An instance of this model, stepped every `step_s`.
    ///
    /// # Errors
    /// [`Refused`] where an effect of the model is not known.
    pub fn of(valve: Valve, part: Part, step_s: f64) -> Result<Self, Refused> {
        let variables = variables(&valve, part).map_err(|e| Refused(e.to_string()))?;
        let start = |meaning| variables.iter().find(|v| v.meaning == meaning).and_then(|v| v.start);
        let inputs = Inputs {
            current_a: start(Meaning::Current).unwrap_or(0.0),
            pressure_bar: 0.0,
            oil_temp_c: start(Meaning::Around(Channel::OilTemperature)),
            supply_bar: start(Meaning::Around(Channel::SupplyPressure)),
        };
        Ok(Self {
            made_from: valve.clone(),
            valve,
            variables,
            step_s,
            phase: Phase::Made,
            seed: 0,
            part,
            inputs,
            outputs: Outputs { pressure_bar: f64::NAN, curve_current_a: f64::NAN, curve_pressure_bar: f64::NAN },
            start_s: 0.0,
            steps: 0,
            plant: None,
            past: VecDeque::new(),
        })
    }

    /// Time of the begin; other than 0 for a master whose clock runs on.
    ///
    /// # Errors
    /// [`Refused`] after the initialisation began, or where the time is no number.
    pub fn set_start(&mut self, start_s: f64) -> Result<(), Refused> {
        self.expect(&[Phase::Made], "the begin is set before the initialisation")?;
        if !start_s.is_finite() {
            return Refused::because(format!("start time {start_s} s: a finite time is allowed"));
        }
        self.start_s = start_s;
        Ok(())
    }

    /// Enters the initialisation.
    ///
    /// # Errors
    /// [`Refused`] in another order.
    pub fn enter_initialization(&mut self) -> Result<(), Refused> {
        self.expect(&[Phase::Made], "the initialisation is entered once, after the instantiation")?;
        self.phase = Phase::Initialising;
        Ok(())
    }

    /// Leaves the initialisation: the valve stands settled at the current that was set.
    ///
    /// # Errors
    /// [`Refused`] in another order, or where the model cannot be simulated.
    pub fn exit_initialization(&mut self) -> Result<(), Refused> {
        self.expect(&[Phase::Initialising], "the initialisation is left after it was entered")?;
        let mut plant = self.plant()?;
        self.outputs = stepped(&mut plant, self.part, self.inputs);
        self.plant = Some(plant);
        self.past.push_back(self.inputs);
        self.phase = Phase::Stepping;
        Ok(())
    }

    /// Goes on from `now_s` by `step_s`, the inputs held.
    ///
    /// # Errors
    /// [`Refused`] in another order, for a time that is not the model's, a step that is no whole number of the model's.
    pub fn do_step(&mut self, now_s: f64, step_s: f64) -> Result<(), Refused> {
        self.expect(&[Phase::Stepping], "a step is done between the initialisation and the end")?;
        let own_s = self.start_s + self.steps as f64 * self.step_s;
        let near = (now_s - own_s).abs() <= CLOSE * self.step_s.max(own_s.abs());
        if !near {
            return Refused::because(format!("the master stands at {now_s} s, the model at {own_s} s"));
        }
        let count = step_s / self.step_s;
        if !((1.0 - CLOSE..1e9).contains(&count) && (count - count.round()).abs() <= CLOSE * count) {
            return Refused::because(format!("a step of {step_s} s: whole multiples of {} s are allowed", self.step_s));
        }
        let Some(plant) = &mut self.plant else { return Refused::because("the model is not initialised") };
        for _ in 0..count.round() as u64 {
            self.outputs = stepped(plant, self.part, self.inputs);
            self.steps += 1;
            self.past.push_back(self.inputs);
        }
        let most = (MEMORY_S / self.step_s).ceil() as usize + 1;
        let excess = self.past.len().saturating_sub(most);
        self.past.drain(..excess);
        if self.outputs.pressure_bar.is_finite() && self.outputs.curve_current_a.is_finite() {
            Ok(())
        } else {
            Refused::because(format!("the pressure at {} s is not finite", self.start_s + self.steps as f64 * self.step_s))
        }
    }

    /// Ends the simulation.
    ///
    /// # Errors
    /// [`Refused`] before it began.
    pub fn terminate(&mut self) -> Result<(), Refused> {
        self.expect(&[Phase::Stepping], "only a simulation that has begun is ended")?;
        self.phase = Phase::Terminated;
        Ok(())
    }

    /// Back to the moment after the instantiation, with the parameters of the file.
    ///
    /// # Errors
    /// None in practice: the model was read before.
    pub fn reset(&mut self) -> Result<(), Refused> {
        *self = Self::of(self.made_from.clone(), self.part, self.step_s)?;
        Ok(())
    }

    /// A value.
    ///
    /// # Errors
    /// [`Refused`] for an unknown reference, or a pressure before the initialisation.
    pub fn real(&self, reference: u32) -> Result<f64, Refused> {
        match reference {
            CURRENT_IN => Ok(self.inputs.current_a),
            PRESSURE_IN if self.part == Part::Behind => Ok(self.inputs.pressure_bar),
            OIL_TEMPERATURE_IN if self.inputs.oil_temp_c.is_some() => Ok(self.inputs.oil_temp_c.unwrap_or(f64::NAN)),
            SUPPLY_PRESSURE_IN if self.inputs.supply_bar.is_some() => Ok(self.inputs.supply_bar.unwrap_or(f64::NAN)),
            MODEL_TIME_OUT => Ok(self.start_s + self.steps as f64 * self.step_s),
            PRESSURE_OUT | CURRENT_OUT | CURVE_PRESSURE_OUT => {
                self.variable(reference)?;
                let outputs = match self.phase {
                    Phase::Made => return Refused::because("the outputs are known from the initialisation on"),
                    Phase::Initialising => stepped(&mut self.plant()?, self.part, self.inputs),
                    Phase::Stepping | Phase::Terminated => self.outputs,
                };
                Ok(match reference {
                    PRESSURE_OUT => outputs.pressure_bar,
                    CURRENT_OUT => outputs.curve_current_a,
                    _ => outputs.curve_pressure_bar,
                })
            }
            _ => self.variable(reference)?.start.ok_or_else(|| Refused(format!("reference {reference} has no value"))),
        }
    }

    /// Sets an input, or a parameter of the model.
    ///
    /// # Errors
    /// [`Refused`] for an unknown reference, an output, a value that is not finite or not allowed.
    pub fn set_real(&mut self, reference: u32, value: f64) -> Result<(), Refused> {
        if self.phase == Phase::Terminated {
            return Refused::because("nothing is set after the end");
        }
        let variable = self.variable(reference)?.clone();
        match variable.causality {
            Causality::Output => return Refused::because(format!("{} is an output", variable.name)),
            Causality::Input if !value.is_finite() => {
                return Refused::because(format!("{} = {value}: a finite value is allowed", variable.name));
            }
            Causality::Input => match reference {
                PRESSURE_IN => self.inputs.pressure_bar = value,
                OIL_TEMPERATURE_IN => self.inputs.oil_temp_c = Some(value),
                SUPPLY_PRESSURE_IN => self.inputs.supply_bar = Some(value),
                _ => self.inputs.current_a = value,
            },
            Causality::Parameter => {
                let mut changed = self.valve.clone();
                set(&mut changed, &variable, value).map_err(Refused)?;
                let before = std::mem::replace(&mut self.valve, changed);
                if let Err(refused) = self.simulate_again() {
                    self.valve = before;
                    return Err(refused);
                }
                if let Some(own) = self.variables.iter_mut().find(|v| v.reference == reference) {
                    own.start = Some(value);
                }
            }
        }
        Ok(())
    }

    /// The seed of chance; 0 for none.
    ///
    /// # Errors
    /// [`Refused`] for another reference.
    pub fn integer(&self, reference: u32) -> Result<i32, Refused> {
        if reference == SEED { Ok(self.seed as i32) } else { Refused::because(format!("no integer has the reference {reference}")) }
    }

    /// Sets the seed of chance.
    ///
    /// # Errors
    /// [`Refused`] for another reference, a negative seed, or after the initialisation.
    pub fn set_integer(&mut self, reference: u32, value: i32) -> Result<(), Refused> {
        self.integer(reference)?;
        self.expect(&[Phase::Made, Phase::Initialising], "the seed is set before the simulation begins")?;
        self.seed = u64::try_from(value).map_err(|_| Refused(format!("seed {value}: 0 or more is allowed")))?;
        Ok(())
    }

    /// Whether an integer has this reference.
    pub fn knows(&self, reference: u32) -> bool {
        reference == SEED || self.variables.iter().any(|v| v.reference == reference)
    }

    fn variable(&self, reference: u32) -> Result<&Variable, Refused> {
        let found = self.variables.iter().find(|v| v.reference == reference);
        found.ok_or_else(|| Refused(format!("no real variable has the reference {reference}")))
    }

    fn expect(&self, allowed: &[Phase], rule: &str) -> Result<(), Refused> {
        if allowed.contains(&self.phase) { Ok(()) } else { Refused::because(format!("wrong order of calls: {rule}")) }
    }

    /// The simulator of the present parameters, settled at the present current.
    ///
    /// A master sets the input at a step's begin and reads the output at its end, so the model's own dead time is shorter
    /// by that step; a dead time below one step is one step.
    fn plant(&self) -> Result<Plant, Refused> {
        let mut valve = self.valve.clone();
        valve.delay_s -= self.step_s;
        let seed = (self.seed > 0).then_some(self.seed);
        let start_a = self.past.front().map_or(self.inputs.current_a, |first| first.current_a);
        let plant = if self.part == Part::Behind { Plant::behind } else { Plant::new };
        plant(&valve, self.step_s, start_a, seed).map_err(|e| Refused(e.to_string()))
    }

    /// After a change of parameters in mid-run: the remembered past again, with the new ones.
    fn simulate_again(&mut self) -> Result<(), Refused> {
        if self.plant.is_none() {
            return self.plant().map(drop);
        }
        let mut plant = self.plant()?;
        for inputs in &self.past {
            self.outputs = stepped(&mut plant, self.part, *inputs);
        }
        self.plant = Some(plant);
        Ok(())
    }
}

/// One step with these inputs.
fn stepped(plant: &mut Plant, part: Part, inputs: Inputs) -> Outputs {
    if part == Part::Behind {
        plant.take(inputs.pressure_bar);
    }
    plant.surround(inputs.oil_temp_c, inputs.supply_bar);
    let pressure_bar = plant.step(inputs.current_a);
    Outputs { pressure_bar, curve_current_a: plant.at_curve_a(), curve_pressure_bar: plant.on_curve_bar() }
}
