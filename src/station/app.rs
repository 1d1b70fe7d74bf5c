//! What every request sees.

use std::sync::Arc;

use super::access::Access;
use super::conduct::Conduct;
use super::hub::Hub;

/// What every request sees.
pub(super) struct App {
    pub hub: Arc<Hub>,
    pub conduct: Arc<dyn Conduct>,
    pub access: Access,
}
