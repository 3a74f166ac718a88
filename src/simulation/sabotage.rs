//! Controllers that are broken on purpose, so that it is seen that the checks can fail.

use std::rc::Rc;

use super::active::Active;
use super::hands::{Switch, Wrong};

#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sabotage {
    /// What a worker does wrong from this period on.
    pub(crate) wrong: Option<(u64, Wrong)>,
    /// Counters do not move.
    pub(crate) hides_counters: bool,
}

impl Sabotage {
    pub(crate) fn spoil(&self, switches: &[Rc<Switch>], _: &[Active], period: u64) {
        if let Some((_, wrong)) = self.wrong.filter(|(from, _)| period >= *from) {
            switches.iter().for_each(|switch| switch.wrong.set(wrong));
        }
    }
}
