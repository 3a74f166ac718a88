//! What operators change is kept before they are told that it is done.

use std::time::{Duration, Instant};

use super::refusal::Refusal;
use super::thread::Admin;
use crate::channel::Asked;
use crate::clock::Clock;
use crate::journal::{StoppedBy, own};
use crate::runtime::desk::Change;
use crate::wire::{AdminCode, state_flags};

/// How long the last answers of a run wait for the disk.
const PATIENCE: Duration = Duration::from_secs(1);
/// So long before a request expires, and its client hears no more, it is answered whatever the disk does, ns.
const LEAD_NS: u64 = 20_000_000;
/// Requests of one client that may wait for a slow disk: half of what it can have waiting at all, so that
/// what it asks next, a stop perhaps, is heard.
const HELD_MAX: usize = 4;

/// A request that was carried out and is on its way to the disk.
pub(super) struct Unkept {
    /// Number of the change in the journal, once that has it.
    number: Option<u64>,
    asked: Asked,
    acts_from_tick: u64,
}

/// What was carried out and is not handed over to the journal yet.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Unsaved {
    anything: bool,
    fleet: bool,
    cleared: bool,
}

impl Unsaved {
    pub(super) fn note(&mut self, changes: &[Change]) {
        let clears = |change: &Change| matches!(change, Change::Hold { clear, .. } if clear & state_flags::STOPPED != 0);
        self.anything = true;
        self.cleared |= changes.iter().any(clears);
        self.fleet |= changes.iter().any(|change| !matches!(change, Change::Hold { .. }));
    }
}

impl<C: Clock> Admin<C> {
    /// Hands what was carried out since the last time over to the journal. The fleet obeys already, and
    /// waits for no disk.
    pub(super) fn keep(&mut self) {
        let Unsaved { anything, fleet, cleared } = self.unsaved;
        let Some(journal) = self.shared.journal.as_ref().filter(|_| anything) else { return };
        let hold = self.carried_out.hold();
        // Copied and sorted before the journal is locked; what they replace is freed after.
        let mut robots = fleet.then(|| own(self.carried_out.robots()));
        let number = journal.keep(|kept| {
            if cleared {
                kept.stopped = None;
                kept.restarts.reset();
            }
            kept.paused = hold & state_flags::PAUSED != 0;
            let stopped = hold & state_flags::STOPPED != 0;
            kept.stopped = stopped.then_some(kept.stopped.unwrap_or(StoppedBy::Operator));
            if let Some(robots) = &mut robots {
                std::mem::swap(robots, &mut kept.robots);
            }
        });
        self.unsaved = Unsaved::default();
        for one in &mut self.unkept {
            one.number.get_or_insert(number);
        }
    }

    /// Answers that a request is carried out: without a journal at once, otherwise when it is kept.
    pub(super) fn done_once_kept(&mut self, asked: Asked, acts_from_tick: u64) {
        match self.shared.journal {
            Some(_) => self.unkept.push(Unkept { number: None, asked, acts_from_tick }),
            None => self.done(asked, acts_from_tick),
        }
    }

    /// Answers what is on the disk by now, or cannot be put there.
    pub(super) fn answer_kept(&mut self) {
        let Some(journal) = self.shared.journal.clone() else { return };
        let mut next = 0;
        while let Some(number) = self.unkept.get(next).map(|one| one.number) {
            let Some(outcome) = number.and_then(|number| journal.outcome(number)) else {
                next += 1;
                continue;
            };
            let one = self.unkept.remove(next);
            #[cfg(test)]
            if let Some(kind) = crate::wire::AdminKind::from_code(one.asked.header().kind) {
                self.fail_at(super::thread::Fault::Kept(kind));
            }
            match outcome {
                Ok(()) => self.done(one.asked, one.acts_from_tick),
                Err(why) => {
                    let text = format!(
                        "it is carried out and in force, and will not survive a restart of the daemon: the journal \
                         cannot be written: {why}"
                    );
                    self.refuse(one.asked, &Refusal::fleet(AdminCode::NotKept, text));
                }
            }
        }
        self.answer_what_cannot_wait(journal.is_slow());
    }

    /// Answers what is still on its way to the disk and cannot wait for it: what is about to expire, and,
    /// while the disk is slow, stops and all but the newest few requests of a client.
    fn answer_what_cannot_wait(&mut self, slow: bool) {
        let now_ns = self.clock.now_ns();
        let mut held = std::collections::BTreeMap::<u128, usize>::new();
        let mut next = self.unkept.len();
        while let Some(at) = next.checked_sub(1) {
            next = at;
            let Some(one) = self.unkept.get(at) else { continue };
            let header = one.asked.header();
            let held = held.entry(one.asked.client()).or_default();
            *held += 1;
            let urgent = *held > HELD_MAX || header.kind == crate::wire::AdminKind::Stop as u32;
            if slow && urgent || now_ns.saturating_add(LEAD_NS) >= header.expires_ns {
                let one = self.unkept.remove(at);
                self.refuse(one.asked, &not_yet());
            }
        }
    }

    /// Answers what still waits when the run is over.
    pub(super) fn wait_for_kept(&mut self) {
        let end = Instant::now() + PATIENCE;
        while !self.unkept.is_empty() && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(1));
            self.answer_kept();
        }
        while let Some(one) = self.unkept.pop() {
            self.refuse(one.asked, &not_yet());
        }
    }
}

fn not_yet() -> Refusal {
    let text = "it is carried out and in force, and not on the disk yet, which is slow: if the daemon ends before it \
                is, it does not survive that";
    Refusal::fleet(AdminCode::NotKept, text.to_owned())
}
