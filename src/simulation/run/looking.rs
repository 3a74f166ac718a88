//! What is looked at after each period, and when a run or a daemon is over.

use std::collections::VecDeque;

use super::Run;
use crate::channel::memory::Message;
use crate::geometry::Vec2;
use crate::simulation::kind::Kind;
use crate::wire::RobotState;

/// Periods after the last fault in which everybody who can has to arrive.
const ARRIVE: u64 = 2500;

impl Run {
    /// Looks at everything that was published and counted since the last time.
    pub(crate) fn look(&mut self, now_ns: u64) {
        let period = self.world.period(now_ns);
        let Some(crew) = &mut self.crew else { return };
        crew.keep_house();
        let lines = self.listener.take();
        let counts = crew.counts();
        let mut commands = self.monitors.commands.edit(std::mem::take);
        let states = self.monitors.states.edit(std::mem::take);
        for message in &commands {
            let (epoch, tick) = (message.header.epoch, message.header.tick);
            let answered = |state: &&Message<RobotState>| {
                state.header.epoch == epoch && state.header.tick.wrapping_add(1) == tick
            };
            self.world.genuine.add(message.clone(), states.iter().find(answered).cloned());
        }
        let checkpoints = self.monitors.checkpoints.edit(std::mem::take);
        let world = &self.world;
        self.judge.published(
            &self.plan,
            (&states, commands.make_contiguous(), &checkpoints),
            &mut self.active,
            |stamp_ns| world.period(stamp_ns),
            self.ending,
        );
        self.judge.counted(period, &counts, &self.world.outside, &lines, &mut self.active);
        self.judge.expire(period, &mut self.active);
        self.end_when_done(period);
    }

    /// The daemon is killed; for how many periods it stays away.
    pub(crate) fn kill(&mut self, period: u64) -> u64 {
        self.look_at_the_last();
        self.crew = None;
        self.memory.command.exhaust(false);
        self.late.clear();
        self.turns = (None, Vec::new());
        let Some(one) = self.due(Kind::Kill, period + 1).map(|one| one.fault.number) else { return 3 };
        let mut down = 3;
        for active in self.active.iter_mut().filter(|active| active.fault.number == one) {
            (active.applied, down) = (1, active.fault.periods);
            active.last = period + down + 2;
            active.until = active.last + active.kind().promise().recovery;
        }
        down
    }

    /// What went out before the end of a daemon still acts.
    fn look_at_the_last(&mut self) {
        let commands = self.monitors.commands.edit(std::mem::take);
        for message in commands {
            self.world.genuine.add(message, None);
        }
        self.monitors.states.edit(VecDeque::clear);
        self.monitors.checkpoints.edit(VecDeque::clear);
    }

    /// Where everybody is to be in the end.
    fn expected_m(&self) -> Vec<Vec2> {
        #[allow(unused_mut, reason = "tests expect somebody elsewhere")]
        let mut goals_m = self.goals_m.clone();
        #[cfg(test)]
        for goal_m in &mut goals_m {
            goal_m.x += self.expected_off_m;
        }
        goals_m
    }

    fn end_when_done(&mut self, period: u64) {
        let Some(crew) = &self.crew else { return };
        if self.ending
            || (self.judge.failures().is_empty() && (period < self.faults_until || !self.pending.is_empty()))
        {
            return;
        }
        if self.judge.failures().is_empty() {
            if !self.active.is_empty() {
                return;
            }
            let goals_m = self.expected_m();
            if !self.judge.settled(&self.plan, &goals_m) {
                if period > self.faults_until + ARRIVE {
                    let who = self.judge.who_is_away(&self.plan, &goals_m);
                    self.judge.fail(period, None, 'l', format!("no fault acts any more, and {who}"));
                } else {
                    return;
                }
            }
        }
        self.ending = true;
        crew.stop();
    }
}
