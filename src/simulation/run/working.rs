//! The workers' turns, and what goes wrong with them.

use std::collections::VecDeque;

use super::Run;
use crate::channel::Channel;
use crate::clock::{Clock, VirtualTime};
use crate::runtime::Crew;
use crate::simulation::kind::{Kind, Scope};
use crate::simulation::world::{FLEET, flip};
use crate::wire::state_flags;

impl Run {
    /// The loop waits for its workers until `wake_ns`; whether the daemon is killed meanwhile.
    pub(crate) fn waiting(&mut self, now: &VirtualTime, wake_ns: u64) -> bool {
        let Some(tick) = self.crew.as_ref().and_then(Crew::released) else {
            now.sleep_until(wake_ns);
            return false;
        };
        let period = self.world.period(now.now_ns());
        if self.turns.0 != Some(tick) {
            let mut left: Vec<usize> = (0..self.plan.workers).collect();
            let mut shuffled = Vec::new();
            while !left.is_empty() {
                shuffled.push(left.swap_remove(self.order.index(left.len())));
            }
            self.turns = (Some(tick), shuffled);
            self.remember_state();
            if self.due(Kind::Kill, period).is_some() {
                return true;
            }
            if let Some(one) = self.due(Kind::Preempted, period) {
                one.applied = 1;
                let over_ns = (one.fault.chance * 0.5 * self.period_ns() as f64) as u64;
                let workers = std::mem::take(&mut self.turns.1);
                for worker in workers {
                    self.work(worker, period, now.now_ns());
                }
                self.look_who_went_without(tick, period);
                self.advance(now, wake_ns + self.plan.config.timing.margin_ns() + over_ns);
                return false;
            }
        }
        match self.turns.1.pop() {
            Some(worker) => {
                self.work(worker, period, wake_ns);
                if self.turns.1.is_empty() {
                    self.look_who_went_without(tick, period);
                }
                let work_ns = 20_000 + self.order.below(100_000);
                now.sleep_until((now.now_ns() + work_ns).min(wake_ns));
            }
            None => self.advance(now, wake_ns),
        }
        false
    }

    fn remember_state(&mut self) {
        let newest = self.monitors.states.edit(|waiting| waiting.back().cloned());
        if newest.is_some() {
            self.older = std::mem::replace(&mut self.newest, newest);
        }
    }

    /// One worker's turn, and what goes wrong with it.
    fn work(&mut self, worker: usize, period: u64, deadline_ns: u64) {
        let Some(crew) = &mut self.crew else { return };
        let before = self.switches.get(worker).map_or(0, |switch| switch.applied.get());
        let mut works = true;
        for one in &mut self.active {
            if one.fault.target != worker
                || one.kind().promise().scope != Scope::Worker
                || !one.acts_at(period)
            {
                continue;
            }
            match one.kind() {
                Kind::WorkerHang => works = false,
                Kind::WorkerLate => {
                    self.late.push((deadline_ns + 100_000, worker));
                    works = false;
                }
                Kind::StateLost => {
                    if let Some(states) = crew.states(worker) {
                        states.edit(VecDeque::clear);
                    }
                }
                Kind::StateOld => {
                    let Some(older) = &self.older else { continue };
                    if let Some(states) = crew.states(worker) {
                        states.edit(|waiting| *waiting = VecDeque::from([older.clone()]));
                    }
                }
                Kind::StateBit => {
                    let (chance, times) = (one.fault.chance, one.applied);
                    if let Some(states) = crew.states(worker) {
                        states.edit(|waiting| waiting.iter_mut().for_each(|one| flip(one, chance, times)));
                    }
                }
                Kind::StateOtherEpoch => {
                    if let Some(states) = crew.states(worker) {
                        states.edit(|waiting| {
                            for one in waiting {
                                one.header.epoch -= 1;
                                Channel::State.seal(FLEET).put(&mut one.header, &one.robots);
                            }
                        });
                    }
                }
                _ => continue,
            }
            one.applied += 1;
        }
        if works {
            crew.work(worker);
        }
        let applied = self.switches.get(worker).map_or(0, |switch| switch.applied.get()) - before;
        for one in &mut self.active {
            let inside = matches!(
                one.kind(),
                Kind::WorkerPanic
                    | Kind::WorkerRests
                    | Kind::SolverNan
                    | Kind::SolverBeyond
                    | Kind::SolverAlmost
                    | Kind::SolverGivesUp
                    | Kind::AnswerWild
            );
            if inside && one.fault.target == worker && one.acts_at(period) {
                one.applied += applied;
                // Where the others had answered everything it had nothing to panic at, and will not rest.
                one.armed &= applied > 0 || one.kind() != Kind::WorkerRests;
            }
        }
    }

    /// All workers had their turns: where the others answered for the one that did not, there is nothing to show.
    fn look_who_went_without(&mut self, tick: u64, period: u64) {
        let (Some(crew), Some(state)) = (&self.crew, &self.newest) else { return };
        let nobody = state_flags::VACANT | state_flags::FOREIGN;
        let mut ours = state.robots.iter().enumerate().filter(|(_, robot)| robot.flags & nobody == 0);
        let missing = ours.any(|(index, _)| !crew.has_answer(index, tick));
        let silent = [Kind::WorkerLate, Kind::StateLost, Kind::StateOld, Kind::StateOtherEpoch];
        for one in self.active.iter_mut().filter(|one| one.acts_at(period) && silent.contains(&one.kind())) {
            one.armed &= missing;
        }
    }
}
