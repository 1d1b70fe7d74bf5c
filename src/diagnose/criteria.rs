//! Every threshold on which a decision rests, in one value, each with its reason.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Most effects that are claimed at once.
pub const MOST_EFFECTS: usize = 3;

/// The thresholds of a diagnosis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Criteria {
    /// A difference of BIC that counts as very strong evidence (Kass and Raftery, J. Am. Stat. Assoc. 90 (1995) 773).
    pub very_strong: f64,
    /// A finding must lower the scale or the RMSE of the residual by this share: less is no use to anybody,
    pub worth: f64,
    /// and by this share where it corrects the model by data of the good valve: every further search pays for it with each of its
    /// simulations, and what stays is known as the model's own error.
    pub worth_of_form: f64,
    /// Most rounds of a search: two more than effects are claimed at once, as one may be dropped again,
    pub rounds: usize,
    /// and where the model is corrected by data of the good valve: one for the loop and one for the dynamics.
    pub rounds_of_form: usize,
    /// what the new model explains beyond the old must have at least this RMS, in units of the floor,
    pub net: f64,
    /// and so must what the effect itself does to the pressure.
    pub trifle: f64,
    /// A gain of BIC beyond this counts even where what is explained lies within the noise, as a faint tone does.
    pub overwhelming: f64,
    /// Beside a recalibration that data of the good valve does not allow, the least gain of an effect in parts of what is left: wrong names
    /// of our unseen valves gained 0.04 to 0.13 of it, right ones 0.24 and more.
    pub alone: f64,
    /// Chance of its held-out gain up to which an effect is confirmed (one in twenty).
    pub confirmed: f64,
    /// or the part of the gain on the data of the fit that the held-out data must show: half, as a model with one parameter too
    /// many shows none.
    pub carried: f64,
    /// Share that the effects must take of the variance beyond the floor before a cause is named: four fifths leave less than
    /// half of the error. What leaves more is a cause in name only.
    pub explains: f64,
    /// A recalibration is written where the model as given is off by this many times what it leaves; less is the day.
    pub recalibrates: f64,
    /// Share of the posterior that a single name needs: more than all others together. Below it only the class is claimed.
    pub name_share: f64,
    /// How many times as likely as the effect that was found a rival must be to take its place: three to one is the least that is
    /// more than a bare mention (Kass and Raftery 1995).
    pub likelier: f64,
    /// To this power evidence is raised where models are held against each other: a set of 90 % held the truth in 12 of 16 of our own
    /// valves at 1, in 14 at 0.5 and at 0.4, with the median set no larger.
    pub power: f64,
    /// Posterior share of a credible set.
    pub credible: f64,
    /// A candidate with this share of the best one's gain is as good: the simpler one is taken,
    pub as_good: f64,
    /// and of two within this difference of BIC, which says nothing (Kass and Raftery 1995 call up to two a bare mention).
    pub tie: f64,
    /// Share of the gain of a free form from which on a cause goes before it, and of the best cause from which on a plainer one does
    /// that follows the record: half, as for a name.
    pub cause_first: f64,
    /// Most members of a credible set: beyond four it says nothing.
    pub members: usize,
    /// By how much data of the good valve must speak against an effect before it counts as a change [nats]: three are
    /// twenty to one.
    pub excluded_nats: f64,
    /// What is left counts as structure above this many times the accuracy of the base model: the sensor noise alone says it.
    pub structure: f64,
    /// The same for a model with a named cause, in units of the floor: half as much again is no explanation.
    pub structure_named: f64,
    /// The same where data of the good valve says how far the model is off when nothing is wrong.
    pub structure_known: f64,
    /// How many times as far as on its own data a good valve may be off on another drive: of 23 healthy valves of our own with one
    /// commissioning drive each the median is 1.2, the ninth decile 2.0.
    pub another_drive: f64,
    /// The same for one class of movements alone, which holds fewer readings: of eight such valves that have classes two reached 5 to 6.
    pub of_class: f64,
    /// The same where both drives are steps alike, as in tests of one kind: healthy valves of our own, as a whole no farther off than they
    /// were, reached 1.5 in their worst class.
    pub of_class_alike: f64,
    /// The same sensor on the same rig is not this many times as noisy from one recording to the next, nor does it scatter so much more
    /// in another way.
    pub noisier: f64,
    /// The share of the record's rates that reference data must reach to speak for the model's dynamics.
    pub excites: f64,
    /// The share of a movement's rate that its fastest one must reach to exclude what shows after such movements only: a dynamic
    /// that is not linear goes over into another at about twice what was seen of it. Likewise the share of its smallest swings that a
    /// swing must reach, for what shows in the form of the loop.
    pub reaches: f64,
    /// The share of a movement's rate that the fastest one of good data must reach to say how far a good valve is off behind it: four of
    /// four healthy valves of our own were off by 2.8 to 5 floors on steps two to three times as fast as any of their good data, and two
    /// of them by less than 2 but for what lay behind those.
    pub speaks: f64,
}

impl Default for Criteria {
    fn default() -> Self {
        Self {
            very_strong: 10.0,
            worth: 0.05,
            worth_of_form: 0.1,
            rounds: MOST_EFFECTS + 2,
            rounds_of_form: 2,
            net: 0.75,
            trifle: 0.5,
            overwhelming: 150.0,
            alone: 0.2,
            confirmed: 0.05,
            carried: 0.5,
            explains: 0.8,
            recalibrates: 1.3,
            name_share: 0.5,
            likelier: 3.0,
            power: 0.5,
            credible: 0.9,
            as_good: 0.985,
            tie: 1.0,
            cause_first: 0.5,
            members: 4,
            excluded_nats: 3.0,
            structure: 2.5,
            structure_named: 1.4,
            structure_known: 1.3,
            another_drive: 2.0,
            of_class: 6.0,
            of_class_alike: 2.0,
            noisier: 2.0,
            excites: 0.3,
            reaches: 0.5,
            speaks: 0.8,
        }
    }
}

impl Criteria {
    /// Every threshold, by its name, with its value.
    pub fn values(&self) -> Vec<(String, f64)> {
        self.fields().into_iter().filter_map(|(name, value)| Some((name, value.as_f64()?))).collect()
    }

    /// Whether a calibration at this price [nats] is denied by the data that it was made from, or costs that much more than another one.
    pub fn denies(&self, nats: f64) -> bool {
        nats > 0.5 * self.very_strong
    }

    /// The same thresholds with another value of the one that is named; what is counted takes the nearest whole number, at least one.
    ///
    /// # Errors
    /// Words that name the thresholds there are, or what a value has to be.
    pub fn with(&self, name: &str, value: f64) -> Result<Self, String> {
        let mut fields = self.fields();
        let Some(field) = fields.get_mut(name) else {
            let known: Vec<String> = fields.keys().cloned().collect();
            return Err(format!("`{name}` is no threshold of a diagnosis; there are: {}", known.join(", ")));
        };
        if !(value.is_finite() && value > 0.0) {
            return Err(format!("{name} = {value}: a threshold is a number above zero"));
        }
        *field = if field.is_u64() { Value::from(value.round().max(1.0) as u64) } else { Value::from(value) };
        serde_json::from_value(Value::Object(fields)).map_err(|e| format!("{name} = {value}: {e}"))
    }

    fn fields(&self) -> Map<String, Value> {
        match serde_json::to_value(self) {
            Ok(Value::Object(fields)) => fields,
            _ => Map::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_threshold_is_set_by_its_name_and_the_others_stay() {
        let (usual, values) = (super::Criteria::default(), super::Criteria::default().values());
        assert!(values.iter().any(|(name, value)| name == "likelier" && *value == 3.0));
        for (name, value) in values {
            let other = usual.with(&name, 2.0 * value).unwrap();
            assert_ne!(other, usual, "{name}");
            assert_eq!(other.with(&name, value).unwrap(), usual, "{name}");
        }
        // What is counted stays a count.
        assert_eq!(usual.with("members", 1.6).unwrap().members, 2);
        assert!(usual.with("luck", 1.0).unwrap_err().contains("very_strong"), "{:?}", usual.with("luck", 1.0));
        for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(usual.with("net", wrong).is_err(), "{wrong}");
        }
    }
}
