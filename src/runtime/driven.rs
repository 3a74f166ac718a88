use crate::telemetry::PeriodRecord;
use crate::wire::RobotState;

/// The period after the one that was recorded last.
///
/// Its commands were already out when that one ended. A loop that oversleeps it leaves no record of it,
/// and yet the robots drive it.
#[derive(Debug, Default)]
pub(super) struct Driven {
    /// The tick and the states of that period; `None` when no commands went out for it.
    next: Option<(u64, Vec<RobotState>)>,
}

impl Driven {
    /// The period that was driven between the last record and `period` and was skipped, if there is one.
    pub(super) fn unrecorded(&self, period: &PeriodRecord) -> Option<(u64, &[RobotState])> {
        let first_skipped = period.header.tick.checked_sub(period.header.skipped_periods)?;
        let (tick, states) = self.next.as_ref()?;
        (period.header.skipped_periods > 0 && first_skipped == *tick).then_some((*tick, states))
    }

    /// Remembers where the commands of `period` begin to act.
    pub(super) fn remember(&mut self, period: &PeriodRecord, period_s: f64) {
        let mut states = self.next.take().map(|(_, states)| states).unwrap_or_default();
        if !period.published {
            return;
        }
        states.clone_from(&period.states);
        for (state, command) in states.iter_mut().zip(&period.commands) {
            state.set_pose(state.arc().pose(period_s));
            state.set_command(command.command());
        }
        self.next = Some((period.header.tick + 1, states));
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
        let run = [record(0, 0, 0.0, 2.0, 2.0), record(3, 2, 2.0, 0.0, 4.0), record(4, 0, 2.0, 4.0, 0.0)];
        let last = record(5, 0, 4.0, 0.0, 0.0);
        let (mut figures, mut driven) = (Accumulator::new(&scenario, T_S), Driven::default());
        let mut unrecorded = vec![];
        for period in run.iter().chain([&last]) {
            if let Some((tick, states)) = driven.unrecorded(period) {
                unrecorded.push((tick, states[0].x_m, states[0].v_mps));
                figures.observe_period(tick, states);
            }
            figures.observe_period(period.header.tick, &period.states);
            driven.remember(period, T_S);
        }
        assert_eq!(unrecorded, [(1, 1.0, 2.0)]);
        assert_eq!(figures.finish().path_ratio, Some(1.0));

        // Commands that were late were not driven, and a lost record leaves nothing to go by.
        let mut late = record(6, 0, 0.0, 0.0, 1.0);
        late.published = false;
        driven.remember(&late, T_S);
        assert_eq!(driven.unrecorded(&record(8, 1, 0.0, 0.0, 0.0)), None);
        driven.remember(&record(8, 0, 0.0, 0.0, 1.0), T_S);
        assert_eq!(driven.unrecorded(&record(12, 1, 0.0, 0.0, 0.0)), None);
    }
}
