//! The gate that every receiver of commands applies before it moves anything.
//!
//! Reads command samples, writes the input that may act now. A command acts from its valid-from
//! time and never after its valid-until time; outside, the robot stands still. Nothing is trusted:
//! a sample of an older run, a repeated or reordered one, one that is not finite or whose times
//! make no sense is refused and counted, and inputs beyond the limits are refused, not clamped,
//! because such a command was never verified. One instance a robot; 200 bytes, no allocation,
//! tens of nanoseconds.

use crate::model::{Command, Limits, RobotId};
use crate::wire::{CommandHeader, RobotCommand};

/// Why a command was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    /// It is meant for another robot.
    WrongRobot,
    /// It comes from a run of the daemon older than the newest one seen.
    OldEpoch,
    /// Its tick is not larger than the last accepted one's: repeated or out of order.
    OldTick,
    /// It had expired when it arrived.
    Expired,
    /// Its valid-until time is not after its valid-from time, or it would hold longer than allowed.
    Validity,
    /// An input is not finite or outside the limits.
    Input,
}

/// What one robot may do now.
#[derive(Debug, Clone, Copy)]
pub struct Gate {
    id: RobotId,
    limits: Limits,
    max_hold_ns: u64,
    epoch: u64,
    tick: Option<u64>,
    current: Held,
    pending: Held,
    refused: u64,
}

/// A command and when it may act: `[from, until)`.
#[derive(Debug, Clone, Copy)]
struct Held {
    command: Command,
    from_ns: u64,
    until_ns: u64,
}

impl Held {
    /// Acts at no time.
    const NOTHING: Self = Self { command: Command::STOP, from_ns: 0, until_ns: 0 };

    fn acts_at(&self, now_ns: u64) -> bool {
        (self.from_ns..self.until_ns).contains(&now_ns)
    }
}

impl Gate {
    /// A gate for robot `id` that lets nothing act for longer than `max_hold_ns`.
    pub fn new(id: RobotId, limits: Limits, max_hold_ns: u64) -> Self {
        Self {
            id,
            limits,
            max_hold_ns,
            epoch: 0,
            tick: None,
            current: Held::NOTHING,
            pending: Held::NOTHING,
            refused: 0,
        }
    }

    /// Takes a command, received at `now_ns`.
    ///
    /// The first command of a new epoch drops whatever an older one left.
    ///
    /// # Errors
    /// The reason for refusing it; what was held before stays.
    pub fn offer(
        &mut self,
        header: &CommandHeader,
        command: &RobotCommand,
        now_ns: u64,
    ) -> Result<(), Refusal> {
        match self.check(header, command, now_ns) {
            Ok(()) => {
                self.accept(header, command.command(), now_ns);
                Ok(())
            }
            Err(refusal) => {
                self.refused += 1;
                Err(refusal)
            }
        }
    }

    fn check(&self, header: &CommandHeader, command: &RobotCommand, now_ns: u64) -> Result<(), Refusal> {
        if command.id != self.id.0 {
            return Err(Refusal::WrongRobot);
        }
        if header.epoch < self.epoch {
            return Err(Refusal::OldEpoch);
        }
        if header.epoch == self.epoch && self.tick.is_some_and(|tick| header.tick <= tick) {
            return Err(Refusal::OldTick);
        }
        let hold_ns = header.valid_until_ns.checked_sub(header.valid_from_ns);
        if !hold_ns.is_some_and(|ns| ns > 0 && ns <= self.max_hold_ns) {
            return Err(Refusal::Validity);
        }
        if header.valid_until_ns <= now_ns {
            return Err(Refusal::Expired);
        }
        if !self.limits.admits(command.command()) {
            return Err(Refusal::Input);
        }
        Ok(())
    }

    fn accept(&mut self, header: &CommandHeader, command: Command, now_ns: u64) {
        if header.epoch > self.epoch {
            (self.current, self.pending) = (Held::NOTHING, Held::NOTHING);
        }
        self.promote(now_ns);
        (self.epoch, self.tick) = (header.epoch, Some(header.tick));
        self.pending = Held { command, from_ns: header.valid_from_ns, until_ns: header.valid_until_ns };
    }

    /// The newest command whose time has come replaces the one before it.
    fn promote(&mut self, now_ns: u64) {
        if self.pending.until_ns > 0 && self.pending.from_ns <= now_ns {
            self.current = self.pending;
            self.pending = Held::NOTHING;
        }
    }

    /// The input that may act at `now_ns`: the held command inside its validity, otherwise a stop.
    ///
    /// Times must not run backwards from call to call.
    pub fn input(&mut self, now_ns: u64) -> Command {
        self.promote(now_ns);
        if self.current.acts_at(now_ns) { self.current.command } else { Command::STOP }
    }

    /// Whether a command acts at `now_ns`; without one the robot stands still.
    ///
    /// Times must not run backwards from call to call.
    pub fn is_commanded(&mut self, now_ns: u64) -> bool {
        self.promote(now_ns);
        self.current.acts_at(now_ns)
    }

    /// The next instant after `now_ns` at which [`Gate::input`] can change without a new command.
    pub fn next_change_ns(&self, now_ns: u64) -> Option<u64> {
        let times = [self.current.until_ns, self.pending.from_ns, self.pending.until_ns];
        times.into_iter().filter(|&t| t > now_ns).min()
    }

    /// Commands refused so far.
    pub fn refused(&self) -> u64 {
        self.refused
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::StopReason;

    fn header(epoch: u64, tick: u64) -> CommandHeader {
        CommandHeader {
            epoch,
            tick,
            valid_from_ns: tick * 100,
            valid_until_ns: (tick + 1) * 100,
            ..CommandHeader::default()
        }
    }

    fn go(v_mps: f64) -> RobotCommand {
        RobotCommand::verified(RobotId(3), Command { v_mps, omega_radps: 0.0 })
    }

    fn gate() -> Gate {
        Gate::new(RobotId(3), Limits::default(), 1_000)
    }

    #[test]
    fn acts_inside_its_validity_and_stops_outside() {
        let mut g = gate();
        g.offer(&header(1, 5), &go(2.0), 420).unwrap();
        for (now, v) in [(420, 0.0), (499, 0.0), (500, 2.0), (599, 2.0), (600, 0.0), (10_000, 0.0)] {
            assert_eq!((g.input(now).v_mps, g.is_commanded(now)), (v, v > 0.0), "at {now}");
        }
    }

    #[test]
    fn the_next_command_waits_for_its_time() {
        let mut g = gate();
        g.offer(&header(1, 5), &go(2.0), 420).unwrap();
        assert_eq!(g.input(510).v_mps, 2.0);
        g.offer(&header(1, 6), &go(3.0), 580).unwrap();
        assert_eq!(g.input(599).v_mps, 2.0);
        assert_eq!(g.next_change_ns(599), Some(600));
        assert_eq!(g.input(600).v_mps, 3.0);
        assert_eq!(g.input(700).v_mps, 0.0);
    }

    #[test]
    fn a_stop_that_acts_at_once_wins() {
        let mut g = gate();
        g.offer(&header(1, 5), &go(2.0), 420).unwrap();
        g.offer(&header(1, 6), &go(2.0), 520).unwrap();
        let now = CommandHeader { valid_from_ns: 530, valid_until_ns: 800, ..header(1, 7) };
        g.offer(&now, &RobotCommand::stop(RobotId(3), StopReason::Operator), 530).unwrap();
        assert_eq!(g.input(530), Command::STOP);
        assert_eq!(g.input(610), Command::STOP);
    }

    #[test]
    fn every_refusal() {
        let mut g = gate();
        g.offer(&header(2, 5), &go(2.0), 420).unwrap();
        let other = RobotCommand { id: 4, ..go(1.0) };
        let backwards = CommandHeader { valid_until_ns: 1, ..header(2, 6) };
        let forever = CommandHeader { valid_until_ns: u64::MAX, ..header(2, 6) };
        let cases = [
            (g.offer(&header(2, 6), &other, 420), Refusal::WrongRobot),
            (g.offer(&header(1, 9), &go(1.0), 420), Refusal::OldEpoch),
            (g.offer(&header(2, 5), &go(1.0), 420), Refusal::OldTick),
            (g.offer(&header(2, 4), &go(1.0), 420), Refusal::OldTick),
            (g.offer(&backwards, &go(1.0), 420), Refusal::Validity),
            (g.offer(&forever, &go(1.0), 420), Refusal::Validity),
            (g.offer(&header(2, 6), &go(1.0), 700), Refusal::Expired),
            (g.offer(&header(2, 6), &go(f64::NAN), 420), Refusal::Input),
            (g.offer(&header(2, 6), &go(5.1), 420), Refusal::Input),
        ];
        for (got, expected) in cases {
            assert_eq!(got, Err(expected));
        }
        assert_eq!(g.refused(), 9);
        assert_eq!(g.input(550).v_mps, 2.0);
    }

    #[test]
    fn a_new_epoch_starts_over() {
        let mut g = gate();
        g.offer(&header(1, 5), &go(2.0), 420).unwrap();
        assert_eq!(g.input(550).v_mps, 2.0);
        g.offer(&CommandHeader { epoch: 2, ..header(1, 0) }, &go(1.0), 50).unwrap();
        assert_eq!(g.input(60).v_mps, 1.0);
        assert_eq!(g.offer(&header(1, 99), &go(1.0), 60), Err(Refusal::OldEpoch));
    }
}
