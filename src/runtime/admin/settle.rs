//! What has come back from the loop: taken over, kept, answered.

use std::sync::Arc;

use super::refusal::{Refusal, expired, outdated};
use super::thread::Admin;
use super::under_way::{Pending, is_hold, is_stop};
use crate::channel::Asked;
use crate::clock::Clock;
use crate::runtime::desk::{Batch, Change, Outcome};
use crate::wire::{AdminCode, AdminKind};

impl<C: Clock> Admin<C> {
    /// Takes over and answers what has come back. Each step is noted before the next may fail: a panic
    /// costs the answer that was being given, and the next round goes on behind it.
    pub(super) fn settle(&mut self) {
        loop {
            if self.back.is_none() {
                let Some(batch) = self.shared.desk.done.pop() else { break };
                self.take_over(*batch);
            }
            self.answer_back();
        }
        self.keep();
    }

    fn take_over(&mut self, batch: Batch) {
        let Some(at) = self.under_way.iter().position(|one| one.key == batch.key) else { return };
        let done = matches!(batch.outcome, Outcome::Done { .. });
        if done {
            self.unsaved.note(&batch.changes);
            batch.changes.iter().for_each(|change| self.carried_out.apply(change));
            self.version += u64::from(!is_hold(&batch.changes));
        } else {
            let refused = matches!(batch.outcome, Outcome::Expired | Outcome::TooClose { .. });
            self.refusals_known += u64::from(refused);
        }
        self.under_way.remove(at);
        let batch = self.back.insert(Arc::new(batch));
        if let Some(shelf) = &self.shared.desk.shelf {
            batch.routes.iter().for_each(|(place, _)| shelf.sweep(*place));
        }
        if !done {
            self.plan_anew();
        }
    }

    fn answer_back(&mut self) {
        let Some(batch) = self.back.clone() else { return };
        while let Some(at) = self.pending.iter().position(|pending| pending.key == batch.key) {
            let Pending { asked, .. } = self.pending.remove(at);
            // It was with a stop that expired before it does.
            if batch.outcome == Outcome::Expired
                && is_stop(&batch.changes)
                && self.clock.now_ns() < asked.header().expires_ns
            {
                self.accept(asked, AdminKind::Stop);
            } else {
                self.tell(asked, &batch);
            }
        }
        self.back = None;
    }

    /// What was carried out, and what will be. The loop does not carry out what was checked before it
    /// refused something.
    pub(super) fn plan_anew(&mut self) {
        self.plan = self.carried_out.clone();
        for one in &self.under_way {
            if one.refusals_known == self.refusals_known || is_hold(&one.changes) {
                one.changes.iter().for_each(|change| self.plan.apply(change));
            }
        }
    }

    fn tell(&mut self, asked: Asked, batch: &Batch) {
        #[cfg(test)]
        if let Some(kind) = AdminKind::from_code(asked.header().kind) {
            self.fail_at(super::thread::Fault::Back(kind));
        }
        let refusal = match batch.outcome {
            Outcome::Done { tick } => {
                log_change(asked.header().kind, tick, &batch.changes);
                return self.done_once_kept(asked, tick + 1);
            }
            Outcome::Expired => expired(),
            Outcome::Waiting | Outcome::Outdated => outdated(),
            Outcome::TooClose { id } => {
                let text = format!("it would stand too close to robot {id}, or in its way of this period");
                Refusal::of(id, AdminCode::TooClose, text)
            }
        };
        self.refuse(asked, &refusal);
    }
}

fn log_change(kind: u32, tick: u64, changes: &[Change]) {
    let kind = AdminKind::from_code(kind).map_or("unknown", AdminKind::name);
    match changes {
        [Change::Goal { .. }, ..] => tracing::debug!(tick, robots = changes.len(), "{kind}"),
        [Change::Add { robot, .. }] => tracing::info!(tick, robot = robot.id.0, "{kind}"),
        _ => tracing::info!(tick, "{kind}"),
    }
}
