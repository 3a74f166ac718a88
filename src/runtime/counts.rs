use std::collections::BTreeMap;

use crate::admission::Rejections;

/// What a daemon has counted so far.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Counts {
    pub(crate) rejections: Rejections,
    pub(crate) stops: BTreeMap<&'static str, u64>,
    pub(crate) skipped_periods: u64,
    pub(crate) deadline_misses: u64,
    pub(crate) fallback_commands: u64,
    pub(crate) send_failures: u64,
    pub(crate) lost_records: u64,
    pub(crate) worker_panics: u64,
    /// Times that a worker was lost for a while, because it panicked too often.
    pub(crate) worker_rests: u64,
    pub(crate) workers_silent: u64,
    pub(crate) corrupt_states: u64,
}
