//! Valve files as commands take them: known to be ones that the physics has.

use std::path::Path;

use super::CliError;
use crate::document;
use crate::physics::{PhysicsError, resolve};
use crate::plan::Plan;
use crate::valve::Valve;

/// The model that the controller believes in: the plan's, or the valve itself without its further effects.
pub fn believed(plan: &Plan, valve: &Valve) -> Result<Valve, CliError> {
    match &plan.model {
        None => Ok(Valve { effects: Vec::new(), ..valve.clone() }),
        Some(name) => {
            let path = Valve::find_beside(name, Some(plan.folder())).map_err(CliError::input)?;
            checked_valve(&path)
        }
    }
}

/// The valve file at a path, with its effects known to be ones that the physics has.
pub fn checked_valve(path: &Path) -> Result<Valve, CliError> {
    let valve = Valve::load(path).map_err(CliError::input)?;
    for effect in &valve.effects {
        if let Err(error) = resolve(effect) {
            let mut key = format!("effect.{}", effect.id);
            if let PhysicsError::UnknownParameter { name, .. }
            | PhysicsError::Quantity { name, .. }
            | PhysicsError::OutOfRange { name, .. } = &error
            {
                key = format!("{key}.{name}");
            }
            let text = document::read(path).map_err(CliError::input)?;
            return Err(CliError::input(document::underline_key(&text, &path.display().to_string(), &key, &error.to_string())));
        }
    }
    Ok(valve)
}

/// Gives the model with what was found another name than the one as given, so that before and after are told apart
/// wherever a name stands.
pub fn name_apart(augmented: &mut Valve, given: &Valve) {
    let added: Vec<&str> = augmented.effects.iter().skip(given.effects.len()).map(|e| e.id.as_str()).collect();
    let mut plain = augmented.clone();
    plain.name.clone_from(&given.name);
    if !added.is_empty() {
        augmented.name = format!("{}+{}", given.name, added.join("+"));
    } else if plain != *given {
        augmented.name = format!("{}+recalibrated", given.name);
    }
}
