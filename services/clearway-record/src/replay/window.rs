//! Puts a period's samples together, which come in different order and not always all.

use crate::convert::{Checkpoint, Command, State};
use std::collections::BTreeMap;

/// Bytes that wait for their missing parts at most; some periods always may.
const WAITING_BYTES: usize = 64 << 20;
const PERIODS_MIN: usize = 64;
const PERIODS_MAX: usize = 4096;

/// What there is of a period, by the tick of its state.
#[derive(Debug, Default)]
pub(super) struct Entry {
    pub(super) state: Option<State>,
    pub(super) checkpoint: Option<Checkpoint>,
    /// The answer, which acts one tick later.
    pub(super) command: Option<Command>,
}

impl Entry {
    fn is_complete(&self) -> bool {
        let late = self.checkpoint.as_ref().is_some_and(|c| c.header.commands_published == 0);
        self.state.is_some() && self.checkpoint.is_some() && (late || self.command.is_some())
    }
}

/// Periods that are not dealt with yet, in their order.
#[derive(Debug, Default)]
pub(super) struct Window {
    entries: BTreeMap<(u64, u64), Entry>,
    robots: usize,
}

impl Window {
    pub(super) fn entry(&mut self, epoch: u64, tick: u64) -> &mut Entry {
        self.entries.entry((epoch, tick)).or_default()
    }

    /// The oldest period, when it is complete or has waited long enough.
    pub(super) fn ready(&mut self) -> Option<(u64, u64, Entry)> {
        let (_, oldest) = self.entries.first_key_value()?;
        let robots = oldest.state.as_ref().map_or(self.robots, |state| state.robots.len());
        self.robots = robots;
        let most = (WAITING_BYTES / (robots.max(1) * 512)).clamp(PERIODS_MIN, PERIODS_MAX);
        if oldest.is_complete() || self.entries.len() > most { self.oldest() } else { None }
    }

    /// The oldest period as it is.
    pub(super) fn oldest(&mut self) -> Option<(u64, u64, Entry)> {
        let ((epoch, tick), entry) = self.entries.pop_first()?;
        Some((epoch, tick, entry))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::convert::Sample;
    use clearway::wire::{CheckpointHeader, CommandHeader, StateHeader};

    fn fill(window: &mut Window, tick: u64, parts: &str) {
        let entry = window.entry(1, tick);
        for part in parts.chars() {
            match part {
                's' => entry.state = Some(Sample { header: StateHeader::default(), robots: vec![] }),
                'c' => entry.command = Some(Sample { header: CommandHeader::default(), robots: vec![] }),
                published => {
                    let commands_published = u64::from(published == 'm');
                    let header = CheckpointHeader { commands_published, ..CheckpointHeader::default() };
                    entry.checkpoint = Some(Sample { header, robots: vec![] });
                }
            }
        }
    }

    #[test]
    fn periods_come_in_order_and_when_they_are_complete() {
        let mut window = Window::default();
        fill(&mut window, 7, "s");
        fill(&mut window, 8, "smc");
        assert!(window.ready().is_none(), "8 waits for 7");
        fill(&mut window, 7, "c");
        assert!(window.ready().is_none());
        fill(&mut window, 7, "m");
        assert_eq!(window.ready().map(|(_, tick, _)| tick), Some(7));
        assert_eq!(window.ready().map(|(_, tick, _)| tick), Some(8));
        fill(&mut window, 9, "sl");
        assert_eq!(window.ready().map(|(_, tick, _)| tick), Some(9), "its commands never went out");
    }

    #[test]
    fn what_never_comes_is_not_waited_for_for_ever() {
        let mut window = Window::default();
        fill(&mut window, 0, "s");
        let mut most = 0;
        for tick in 1..10_000 {
            fill(&mut window, tick, "smc");
            while window.ready().is_some() {}
            most = most.max(window.entries.len());
        }
        assert!(most <= PERIODS_MAX + 1, "{most}");
        assert!(window.entries.is_empty());
    }
}
