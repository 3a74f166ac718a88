use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// Exit status after a second signal, as shells report a death by SIGINT.
const IMPATIENT: i32 = 130;

/// Set by SIGINT and SIGTERM.
pub(crate) struct StopFlag(Arc<AtomicBool>);

impl StopFlag {
    pub(crate) fn is_set(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }
}

/// Makes SIGINT and SIGTERM set a flag, which is all that a handler does; a second one ends the
/// process at once, without a report.
pub(crate) fn stop_flag() -> std::io::Result<StopFlag> {
    let set = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        // In this order: the first signal finds the flag unset.
        flag::register_conditional_shutdown(signal, IMPATIENT, Arc::clone(&set))?;
        flag::register(signal, Arc::clone(&set))?;
    }
    Ok(StopFlag(set))
}
