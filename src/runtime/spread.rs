//! What the workers left robot by robot, put together and sent.

use super::answers::Answers;
use super::forecast::Forecast;
use crate::cache;
use crate::channel::Writer;
use crate::telemetry::PeriodRecord;
use crate::wire::{
    CheckpointHeader, RobotCheckpoint, RobotCommand, RobotTelemetry, TelemetryHeader, checkpoint_flags,
};

/// Places that are asked for ahead of the one that is written.
const AHEAD: usize = 8;

/// Puts each record into its robot's place, and lets `complete` add what its command tells.
fn spread<R: Copy>(
    records: &[(usize, R)],
    robots: &mut [R],
    commands: &[RobotCommand],
    complete: impl Fn(&mut R, &RobotCommand),
) {
    let later = records.iter().skip(AHEAD).map(|(index, _)| Some(*index)).chain(std::iter::repeat(None));
    for ((index, record), later) in records.iter().zip(later) {
        // Workers go through the fleet in another order: the processor cannot guess where the next one is.
        if let Some(place) = later.and_then(|index| robots.get(index)) {
            cache::expect(place);
        }
        if let (Some(robot), Some(command)) = (robots.get_mut(*index), commands.get(*index)) {
            *robot = *record;
            complete(robot, command);
        }
    }
}

/// Puts a period's telemetry together and sends it.
pub(super) fn publish(
    telemetry: &mut Writer<RobotTelemetry>,
    header: &TelemetryHeader,
    period: &PeriodRecord,
    answers: &Answers,
    forecast: &Forecast,
) {
    // What went out, whatever the worker wanted.
    let tell = |robot: &mut RobotTelemetry, command: &RobotCommand| {
        robot.id = command.id;
        robot.stop_reason = command.stop_reason;
        (robot.v_mps, robot.omega_radps) = (command.v_mps, command.omega_radps);
    };
    let sent = telemetry.publish(|head, robots| {
        *head = *header;
        if answers.answered(header.tick).known < robots.len() {
            robots.iter_mut().zip(&period.commands).for_each(|(robot, command)| tell(robot, command));
        }
        for record in answers.of(header.tick) {
            spread(&record.robots, robots, &period.commands, |robot, command| {
                robot.settling_steps = forecast.settling_steps(robot.lyapunov_position_m2);
                tell(robot, command);
            });
        }
    });
    if sent.is_err() {
        tracing::debug!(tick = header.tick, "telemetry did not reach every reader");
    }
}

/// Sends what the controllers remembered before they answered the period's state.
pub(super) fn publish_checkpoint(
    checkpoints: &mut Writer<RobotCheckpoint>,
    period: &PeriodRecord,
    answers: &Answers,
) {
    // What was remembered may be another robot's, which stood there before.
    let name = |robot: &mut RobotCheckpoint, command: &RobotCommand| {
        if robot.flags & checkpoint_flags::ANSWERED == 0 {
            robot.id = command.id;
        }
    };
    let tick = period.header.tick;
    let sent = checkpoints.publish(|head, robots| {
        *head = CheckpointHeader {
            epoch: period.header.epoch,
            tick,
            skipped_periods: period.header.skipped_periods,
            commands_published: u64::from(period.published),
            ..CheckpointHeader::default()
        };
        let known: usize = answers.of(tick).map(|record| record.checkpoints.len()).sum();
        if known < robots.len() {
            robots.iter_mut().zip(&period.commands).for_each(|(robot, command)| name(robot, command));
        }
        for record in answers.of(tick) {
            spread(&record.checkpoints, robots, &period.commands, name);
        }
    });
    if sent.is_err() {
        tracing::debug!(tick, "a checkpoint did not reach every reader");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In whatever order, and wherever there is no such place: each lands in its own, and nothing anywhere else.
    #[test]
    fn each_record_lands_in_its_robots_place() {
        let robots = 3 * AHEAD;
        let commands: Vec<RobotCommand> =
            (0..robots).map(|n| RobotCommand { v_mps: n as f64, ..RobotCommand::default() }).collect();
        let records: Vec<(usize, (usize, f64))> =
            (0..robots + 2).rev().filter(|n| n % 5 != 2).map(|n| (n, (n + 100, 0.0))).collect();
        let mut places = vec![(0, -1.0); robots];
        spread(&records, &mut places, &commands, |place, command| place.1 = command.v_mps);
        for (n, place) in places.into_iter().enumerate() {
            assert_eq!(place, if n % 5 == 2 { (0, -1.0) } else { (n + 100, n as f64) });
        }
    }
}
