//! Which faults act now, and what they have shown so far.

use super::kind::{Kind, Scope};
use super::plan::Fault;

/// A fault that has begun.
#[derive(Debug, Clone)]
#[expect(clippy::struct_excessive_bools, reason = "each is a fact of its own")]
pub(crate) struct Active {
    pub(crate) fault: Fault,
    /// Robots that it concerns; `None`: everybody.
    pub(crate) robots: Option<Vec<usize>>,
    /// The last period in which it may show.
    pub(crate) until: u64,
    /// The last period in which it acts.
    pub(crate) last: u64,
    /// How often it was done.
    pub(crate) applied: u64,
    /// What it needs beyond that to be seen, is there.
    pub(crate) armed: bool,
    /// Its counter moved.
    pub(crate) moved: bool,
    /// The log told of it.
    pub(crate) said: bool,
    /// The last period in which a robot that it concerns stopped for its reason.
    pub(crate) stopped: Option<u64>,
    /// The last period in which an operator did something about it.
    pub(crate) stepped: Option<u64>,
    /// Another fault may have hidden it.
    pub(crate) shadowed: bool,
}

impl Active {
    pub(crate) fn new(fault: Fault, robots: Option<Vec<usize>>) -> Self {
        Self {
            fault,
            robots,
            until: fault.until(),
            last: fault.last(),
            applied: 0,
            armed: fault.kind != Kind::ObsFrozen,
            moved: false,
            said: false,
            stopped: None,
            stepped: None,
            shadowed: false,
        }
    }

    pub(crate) fn kind(&self) -> Kind {
        self.fault.kind
    }

    pub(crate) fn acts_at(&self, period: u64) -> bool {
        (self.fault.from..=self.last).contains(&period)
    }

    /// Whether it acts, or may still show.
    pub(crate) fn acts_within(&self, period: u64) -> bool {
        (self.fault.from..=self.until).contains(&period)
    }

    pub(crate) fn touches(&self, robot: usize) -> bool {
        self.robots.as_ref().is_none_or(|robots| robots.contains(&robot))
    }

    /// Whether one may hide what the other shows.
    pub(crate) fn meets(&self, other: &Self) -> bool {
        let everybody = |one: &Self| one.kind().promise().scope == Scope::Fleet || one.robots.is_none();
        everybody(self) || everybody(other) || self.robots.iter().flatten().any(|robot| other.touches(*robot))
    }

    /// Recovers only after the other has: what it needs for that may be what the other takes.
    pub(crate) fn outlast(&mut self, other_until: u64) {
        let recovery = self.kind().promise().recovery;
        self.until = self.until.max(other_until.saturating_add(recovery));
    }

    /// Periods after its end until the last robot that it concerns was driven again.
    pub(crate) fn recovery(&self) -> u64 {
        self.stopped.map_or(0, |period| (period + 1).saturating_sub(self.last))
    }
}
