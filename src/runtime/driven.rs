use crate::telemetry::PeriodRecord;
use crate::wire::{RobotCommand, RobotState};

/// The period after the one that was recorded last.
///
/// Its commands were already out when that one ended. A loop that oversleeps it leaves no record of it,
/// and yet the robots drive it.
#[derive(Debug)]
pub(super) struct Driven {
    /// Its tick; `None` when no commands went out for it.
    next: Option<u64>,
    /// The states that were recorded last, and the commands that went out.
    states: Vec<RobotState>,
    commands: Vec<RobotCommand>,
    period_s: f64,
}

impl Driven {
    /// With memory for as many robots as the records have.
    pub(super) fn with_robots(robots: usize, period_s: f64) -> Self {
        let PeriodRecord { states, commands, .. } = PeriodRecord::with_robots(robots);
        Self { next: None, states, commands, period_s }
    }

    /// The period that was driven between the last record and `period` and was skipped, if there is one.
    pub(super) fn unrecorded(&mut self, period: &PeriodRecord) -> Option<(u64, &[RobotState])> {
        let first_skipped = period.header.tick.checked_sub(period.header.skipped_periods)?;
        let skipped = |tick: &u64| period.header.skipped_periods > 0 && first_skipped == *tick;
        let tick = self.next.take().filter(skipped)?;
        for (state, command) in self.states.iter_mut().zip(&self.commands) {
            state.set_pose(state.arc().pose(self.period_s));
            state.set_command(command.command());
        }
        Some((tick, &self.states))
    }

    /// Remembers where the commands of `period` begin to act, and leaves it memory to be written anew.
    pub(super) fn remember(&mut self, period: &mut PeriodRecord) {
        self.next = period.published.then_some(period.header.tick + 1);
        std::mem::swap(&mut self.states, &mut period.states);
        std::mem::swap(&mut self.commands, &mut period.commands);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figures::Accumulator;
    use crate::geometry::{Pose, Vec2};
    use crate::model::{Command, Limits, RobotId, RobotSpec};
    use crate::scenario::Scenario;
    use crate::wire::{RobotCommand, TelemetryHeader, state_flags};

    const T_S: f64 = 0.5;

    /// A robot on a straight line, recorded at `tick` after `skipped` periods without a record.
    fn record(tick: u64, skipped: u64, x_m: f64, v_mps: f64, next_mps: f64) -> PeriodRecord {
        let mut record = PeriodRecord::with_robots(1);
        record.header = TelemetryHeader { tick, skipped_periods: skipped, ..TelemetryHeader::default() };
        record.published = true;
        let goal = RobotState { goal_x_m: 4.0, flags: state_flags::VALID, ..RobotState::default() };
        record.states[0] = RobotState { x_m, v_mps, ..goal };
        let next = Command { v_mps: next_mps, omega_radps: 0.0 };
        record.commands[0] = RobotCommand::verified(RobotId(0), next);
        record
    }

    #[test]
    fn a_period_that_was_overslept_but_driven_counts() {
        let scenario = Scenario {
            name: "one".into(),
            tolerance_m: 0.05,
            duration_s: 10.0,
            limits: Limits::default(),
            robots: vec![RobotSpec {
                id: RobotId(0),
                radius_m: 0.15,
                start: Pose::new(0.0, 0.0, 0.0),
                goal_m: Vec2::new(4.0, 0.0),
                foreign_speed_mps: None,
            }],
            obstacles: vec![],
        };
        // 2 m/s all the time, but period 1 is overslept, and in 2 nobody has a command.
        let mut run =
            vec![record(0, 0, 0.0, 2.0, 2.0), record(3, 2, 2.0, 0.0, 4.0), record(4, 0, 2.0, 4.0, 0.0)];
        run.push(record(5, 0, 4.0, 0.0, 0.0));
        let (mut figures, mut driven) = (Accumulator::new(&scenario, T_S), Driven::with_robots(1, T_S));
        let mut unrecorded = vec![];
        for period in &mut run {
            if let Some((tick, states)) = driven.unrecorded(period) {
                unrecorded.push((tick, states[0].x_m, states[0].v_mps));
                figures.observe_period(tick, states);
            }
            figures.observe_period(period.header.tick, &period.states);
            driven.remember(period);
        }
        assert_eq!(unrecorded, [(1, 1.0, 2.0)]);
        assert_eq!(figures.finish().path_ratio, Some(1.0));

        // Commands that were late were not driven, and a lost record leaves nothing to go by.
        let mut late = record(6, 0, 0.0, 0.0, 1.0);
        late.published = false;
        driven.remember(&mut late);
        assert_eq!(driven.unrecorded(&record(8, 1, 0.0, 0.0, 0.0)), None);
        driven.remember(&mut record(8, 0, 0.0, 0.0, 1.0));
        assert_eq!(driven.unrecorded(&record(12, 1, 0.0, 0.0, 0.0)), None);
    }
}
