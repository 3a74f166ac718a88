//! The commands of the last periods: where they led, and who follows them.

use crate::geometry::{Arc, Pose};
use crate::model::Command;
use crate::wire::{CommandHeader, Holding, RobotCommand};

/// Periods whose commands can lie between an observation of the greatest age and now: those it spans,
/// the one that it begins in, the one that is running, and the one whose commands are already out.
pub(super) fn history(max_age_ns: u64, period_ns: u64) -> usize {
    usize::try_from(max_age_ns.div_ceil(period_ns.max(1))).unwrap_or(usize::MAX).saturating_add(3)
}

/// The commands of one period.
#[derive(Debug, Clone)]
struct Sent {
    /// Code of [`Holding::Command`] of its tick; of [`Holding::Untold`] where nothing was sent.
    code: u32,
    from_ns: u64,
    until_ns: u64,
    commands: Vec<Command>,
}

/// The commands of the last periods.
#[derive(Debug)]
pub(super) struct Held {
    periods: Vec<Sent>,
    newest: usize,
}

impl Held {
    pub(super) fn new(robots: usize, history: usize) -> Self {
        let nothing = Sent { code: 0, from_ns: 0, until_ns: 0, commands: vec![Command::STOP; robots] };
        Self { periods: vec![nothing; history], newest: 0 }
    }

    pub(super) fn remember(&mut self, header: &CommandHeader, commands: &[RobotCommand]) {
        // What acts from now on ends what was to act then.
        for sent in &mut self.periods {
            sent.until_ns = sent.until_ns.min(header.valid_from_ns);
        }
        self.newest = (self.newest + 1) % self.periods.len();
        let sent = &mut self.periods[self.newest];
        sent.code = Holding::Command { tick: header.tick }.code();
        (sent.from_ns, sent.until_ns) = (header.valid_from_ns, header.valid_until_ns);
        for (held, command) in sent.commands.iter_mut().zip(commands) {
            *held = command.command();
        }
    }

    /// What was sent so many samples ago.
    fn back(&self, samples: usize) -> &Sent {
        let history = self.periods.len();
        &self.periods[(self.newest + history - samples) % history]
    }

    /// Whether a robot that told `holding` when it was seen at `stamp_ns` followed its commands then. If not,
    /// it stood, and stands until it has held a stop that says that this is known.
    pub(super) fn follows(&self, holding: u32, stamp_ns: u64) -> bool {
        if holding == Holding::Untold.code() {
            return true;
        }
        let sent = || (0..self.periods.len()).map(|samples| self.back(samples));
        // The newest whose time had come, and those that it may hold for later.
        let begun = |sent: &&Sent| sent.code == Holding::Untold.code() || sent.from_ns <= stamp_ns;
        let newest = sent().find(begun).map_or(0, |sent| sent.code);
        newest == holding || sent().take_while(|sent| !begun(sent)).any(|sent| sent.code == holding)
    }

    pub(super) fn forget(&mut self, index: usize) {
        for sent in &mut self.periods {
            sent.commands[index] = Command::STOP;
        }
    }

    /// Where robot `index`, seen at `pose` at `stamp_ns`, is at `at_ns`, which may also lie before, and the
    /// length of the way between, m.
    pub(super) fn carry(&self, index: usize, pose: Pose, stamp_ns: u64, at_ns: u64) -> (Pose, f64) {
        let (start_ns, end_ns) = (stamp_ns.min(at_ns), stamp_ns.max(at_ns));
        let backwards = at_ns < stamp_ns;
        let (mut pose, mut way_m) = (pose, 0.0);
        // Those that end after the start: a handful of the newest.
        let recent = (0..self.periods.len()).take_while(|back| self.back(*back).until_ns > start_ns).count();
        // Oldest first, or newest first when going back in time.
        for step in 0..recent {
            let back = if backwards { step } else { recent - 1 - step };
            let sent = self.back(back);
            let overlap_ns = end_ns.min(sent.until_ns).saturating_sub(start_ns.max(sent.from_ns));
            let Some(command) = sent.commands.get(index).filter(|_| overlap_ns > 0) else { continue };
            let s = overlap_ns as f64 * 1e-9;
            let arc = Arc { start: pose, v_mps: command.v_mps, omega_radps: command.omega_radps };
            pose = arc.pose(if backwards { -s } else { s });
            way_m += command.v_mps.abs() * s;
        }
        (pose, way_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::RobotId;

    const T: u64 = 100;

    fn held() -> Held {
        let mut held = Held::new(1, 8);
        for tick in 1..5_u64 {
            let header = CommandHeader {
                tick,
                valid_from_ns: tick * T,
                valid_until_ns: (tick + 1) * T,
                ..CommandHeader::default()
            };
            // 10⁷ m/s for 100 ns is a metre.
            let command = Command { v_mps: 1e7 * tick as f64, omega_radps: 0.0 };
            held.remember(&header, &[RobotCommand::verified(RobotId(0), command)]);
        }
        held
    }

    #[test]
    fn an_observation_is_carried_along_the_commands_in_force() {
        let held = held();
        let x = |stamp, at| held.carry(0, Pose::new(10.0, 0.0, 0.0), stamp, at).0.position_m.x;
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} is not {b}");
        close(x(300, 300), 10.0);
        close(x(250, 300), 11.0);
        close(x(150, 350), 10.0 + 0.5 + 2.0 + 1.5);
        close(x(350, 300), 10.0 - 1.5);
        close(x(350, 150), 10.0 - 1.5 - 2.0 - 0.5);
        // Before the first and after the last command the robot stands.
        close(x(0, 200), 11.0);
        close(x(450, 10_000), 12.0);
    }

    /// Half a period late and half a period into the next: no command that matters is overwritten.
    #[test]
    fn the_oldest_observation_that_is_let_through_is_carried_over_every_command() {
        for periods in [1, 7, 8, 100] {
            let mut held = Held::new(1, history(periods * T, T));
            for tick in 0..1000_u64 {
                let header = CommandHeader {
                    tick,
                    valid_from_ns: tick * T,
                    valid_until_ns: (tick + 1) * T,
                    ..CommandHeader::default()
                };
                let command = Command { v_mps: 1e7, omega_radps: 0.0 };
                held.remember(&header, &[RobotCommand::verified(RobotId(0), command)]);
                // The commands of `tick` are out, the state of the period before is wanted.
                let Some(now_ns) = (tick * T).checked_sub(T / 2) else { continue };
                let Some(stamp_ns) = now_ns.checked_sub(periods * T) else { continue };
                let (pose, _) = held.carry(0, Pose::new(0.0, 0.0, 0.0), stamp_ns, now_ns);
                assert!((pose.position_m.x - periods as f64).abs() < 1e-9, "{periods} {tick} {pose:?}");
            }
        }
    }
    #[test]
    fn forwards_and_backwards_cancel_on_arcs() {
        let mut held = Held::new(1, 8);
        for tick in 0..3_u64 {
            let header = CommandHeader {
                tick,
                valid_from_ns: tick * 80_000_000,
                valid_until_ns: (tick + 1) * 80_000_000,
                ..CommandHeader::default()
            };
            let command = Command { v_mps: 2.0, omega_radps: 0.3 * tick as f64 };
            held.remember(&header, &[RobotCommand::verified(RobotId(0), command)]);
        }
        let pose = Pose::new(1.0, 2.0, 0.5);
        let (there, way_m) = held.carry(0, pose, 10_000_000, 200_000_000);
        let (back, way_back_m) = held.carry(0, there, 200_000_000, 10_000_000);
        assert!((back.position_m - pose.position_m).norm() < 1e-12);
        assert!((back.theta_rad - pose.theta_rad).abs() < 1e-12);
        // 190 ms at 2 m/s.
        assert!((way_m - 0.38).abs() < 1e-12 && (way_back_m - way_m).abs() < 1e-12, "{way_m}");
    }
    /// A history in which ticks 1 to 4 act from 100, 200, 300 and 400 on.
    #[test]
    fn a_robot_follows_while_it_holds_the_newest_command_whose_time_has_begun() {
        let held = held();
        let follows = |tick, stamp_ns| held.follows(Holding::Command { tick }.code(), stamp_ns);
        for (stamp_ns, newest) in [(100, 1), (199, 1), (200, 2), (399, 3), (400, 4), (10_000, 4)] {
            for tick in 0..8 {
                // It may have taken the next ones already.
                assert_eq!(follows(tick, stamp_ns), (newest..5).contains(&tick), "{tick} at {stamp_ns}");
            }
            assert!(!held.follows(Holding::Nothing.code(), stamp_ns));
            assert!(held.follows(Holding::Untold.code(), stamp_ns));
        }
        // Before the first one acts it is enough to have it.
        assert!(follows(1, 50) && !follows(0, 50) && !held.follows(Holding::Nothing.code(), 50));
        let empty = Held::new(1, 8);
        assert!(!empty.follows(Holding::Nothing.code(), 50));
        assert!(!empty.follows(Holding::Command { tick: 0 }.code(), 50));
    }

    #[test]
    fn a_command_from_before_all_that_is_remembered_is_followed_by_nobody() {
        let mut held = Held::new(1, 3);
        for tick in 10..20_u64 {
            let (valid_from_ns, valid_until_ns) = (tick * T, (tick + 1) * T);
            let header = CommandHeader { tick, valid_from_ns, valid_until_ns, ..CommandHeader::default() };
            held.remember(&header, &[RobotCommand::verified(RobotId(0), Command::STOP)]);
        }
        let follows = |tick, stamp_ns| held.follows(Holding::Command { tick }.code(), stamp_ns);
        assert_eq!([16, 17, 18, 19].map(|tick| follows(tick, 18 * T)), [false, false, true, true]);
        // Periods that the daemon skipped take nothing from who holds the last one.
        assert!(follows(19, 500 * T) && !follows(18, 500 * T));
    }
}
