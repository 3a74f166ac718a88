//! Controllers that are broken on purpose, so that it is seen that the checks can fail.

use std::rc::Rc;

use super::hands::{Switch, Wrong};
use super::plan::Options;

/// The first period of a controller that is broken by [`Options::sabotage`].
const FROM: u64 = 20;

#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sabotage {
    /// What a worker does wrong from this period on.
    pub(crate) wrong: Option<(u64, Wrong)>,
    /// Counters do not move.
    #[cfg(test)]
    pub(crate) hides_counters: bool,
}

impl Sabotage {
    pub(crate) fn new(options: &Options) -> Self {
        Self {
            wrong: options.sabotage.then_some((FROM, Wrong::Reckless)),
            #[cfg(test)]
            hides_counters: false,
        }
    }

    pub(crate) fn spoil(&self, switches: &[Rc<Switch>], period: u64) {
        if let Some((_, wrong)) = self.wrong.filter(|(from, _)| period >= *from) {
            for switch in switches {
                switch.wrong.set(wrong);
            }
        }
    }
}
