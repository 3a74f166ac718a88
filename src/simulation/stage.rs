//! The clock that the loop sleeps on, and everybody who has a turn meanwhile.

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::atomic::AtomicU32;

use super::run::Run;
use crate::clock::{Clock, VirtualTime};

/// How a daemon is killed: it does not come back from a look at the clock.
pub(crate) struct Killed;

/// The loop's clock.
pub(crate) struct Stage {
    pub(crate) now: VirtualTime,
    pub(crate) run: RefCell<Run>,
}

/// A [`Stage`] that its owner keeps as well.
#[derive(Clone)]
pub(crate) struct OnStage(pub(crate) Rc<Stage>);

impl OnStage {
    fn killed_if(killed: bool) {
        if killed {
            // Not a panic that a hook has to report.
            std::panic::resume_unwind(Box::new(Killed));
        }
    }
}

impl Clock for OnStage {
    fn now_ns(&self) -> u64 {
        self.0.now.now_ns()
    }

    /// The loop has done its duty and sleeps until the next release.
    fn sleep_until(&self, wake_ns: u64) {
        let killed = self.0.run.borrow_mut().asleep(&self.0.now, wake_ns);
        Self::killed_if(killed);
    }

    fn spin_until(&self, wake_ns: u64) {
        self.sleep_until(wake_ns);
    }

    /// The loop waits for its workers.
    fn wait(&self, _: &AtomicU32, _: u32, wake_ns: u64) {
        let killed = self.0.run.borrow_mut().waiting(&self.0.now, wake_ns);
        Self::killed_if(killed);
    }
}
