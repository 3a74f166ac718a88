//! The gate that every receiver of commands applies before it moves anything.
//!
//! Reads command samples, writes the input that may act now. A command acts from its valid-from
//! time and never after its valid-until time; outside, the robot stands still. Nothing is trusted:
//! a sample of an older run, a repeated or reordered one, one that is not finite or whose times
//! make no sense is refused and counted, and inputs beyond the limits are refused, not clamped,
//! because such a command was never verified. Whatever a header says, a robot does not move by a
//! command for longer than the longest hold, nor later than three of them after it was received.
//!
//! A command was computed for where the one before it leads. So one that moves the robot is followed only
//! if that one was, and not once its time has begun. A robot that missed one, or was stopped by something
//! else, stands until the daemon has heard of it and says so in a stop ([`StopReason::OutOfStep`]): only
//! then does it know from where the next one drives. [`Gate::holding`] is what the daemon has to hear
//! (docs/MATH.md, Theorem 4).
//!
//! One instance a robot; 208 bytes, no allocation, tens of nanoseconds.
//!
//! Bits that changed on the way are found before: by who reads the sample ([`crate::wire::Seal`]).

use crate::model::{Command, Limits, RobotId};
use crate::wire::{CommandHeader, Holding, RobotCommand, StopReason};

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
    /// It would have moved the robot, and its time had begun when it arrived.
    Late,
    /// It would have moved the robot, which does not hold the command before it.
    OutOfStep,
    /// Its valid-until time is not after its valid-from time, it would hold longer than allowed, or it
    /// was published before the state that it answers or after it was to act.
    Validity,
    /// By the receiver's clock it is stamped in the future, or would act only when what it answers is
    /// long over: its sender has another clock.
    Future,
    /// An input is not finite or outside the limits, or is not a stop and gives a reason for one.
    Input,
}

/// What one robot may do now.
#[derive(Debug, Clone, Copy)]
pub struct Gate {
    id: RobotId,
    limits: Limits,
    max_hold_ns: u64,
    /// Nobody tells the daemon what it holds.
    unreported: bool,
    epoch: u64,
    tick: Option<u64>,
    /// The newest command that was taken in an unbroken sequence, and when that began, ns.
    followed: Option<(u64, u64)>,
    current: Held,
    /// Those that wait for their time, the earlier one first.
    waiting: [Held; 2],
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
            unreported: false,
            epoch: 0,
            tick: None,
            followed: None,
            current: Held::NOTHING,
            waiting: [Held::NOTHING; 2],
            refused: 0,
        }
    }

    /// Follows commands that come late or after one that was missed: for robots of which nobody tells the
    /// daemon what they hold. It would not hear that they stand, and never let them go on.
    ///
    /// That no command is lost is then for whoever connects them to see to.
    #[must_use]
    pub fn unreported(self) -> Self {
        Self { unreported: true, ..self }
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
                self.accept(header, command, now_ns);
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
        // Announced however early, a stop is a stop, and however late.
        let is_stop = command.command() == Command::STOP;
        if !is_stop && (header.state_stamp_ns > header.stamp_ns || header.stamp_ns > header.valid_from_ns) {
            return Err(Refusal::Validity);
        }
        // A receiver may read its clock a little before the sample, and a period is published ahead.
        let (ahead_ns, from_ns) = (now_ns.saturating_add(self.max_hold_ns), header.valid_from_ns);
        if header.stamp_ns > ahead_ns || !is_stop && from_ns > ahead_ns.saturating_add(self.max_hold_ns) {
            return Err(Refusal::Future);
        }
        let reason_to_stop = command.stop_reason != 0;
        if !self.limits.admits(command.command()) || reason_to_stop && !is_stop {
            return Err(Refusal::Input);
        }
        let heeds = !is_stop && !self.unreported;
        if heeds && header.valid_from_ns < now_ns {
            return Err(Refusal::Late);
        }
        if heeds && !self.is_followed_by(header) {
            return Err(Refusal::OutOfStep);
        }
        Ok(())
    }

    /// Whether the sample of `header` is the one after the newest that was followed.
    fn is_followed_by(&self, header: &CommandHeader) -> bool {
        header.epoch == self.epoch && self.followed.is_some_and(|(tick, _)| tick == header.follows)
    }

    fn accept(&mut self, header: &CommandHeader, command: &RobotCommand, now_ns: u64) {
        self.followed = match (self.followed, StopReason::from_code(command.stop_reason)) {
            (Some((_, since_ns)), _) if self.is_followed_by(header) => Some((header.tick, since_ns)),
            // Until it acts the daemon may believe that the robot moves.
            (_, Some(StopReason::OutOfStep)) => Some((header.tick, header.valid_from_ns)),
            // No command of this run came before it.
            (_, Some(StopReason::Start)) if header.epoch > self.epoch => Some((header.tick, now_ns)),
            (followed, _) if header.epoch == self.epoch => followed,
            _ => None,
        };
        if header.epoch > self.epoch {
            self.drop_all();
        }
        self.promote(now_ns);
        (self.epoch, self.tick) = (header.epoch, Some(header.tick));
        let (from_ns, until_ns) = (header.valid_from_ns, header.valid_until_ns);
        self.wait(Held { command: command.command(), from_ns, until_ns });
    }

    /// Lets a command wait for its time behind those that are to act before.
    fn wait(&mut self, held: Held) {
        let before = |other: &Held| other.until_ns > 0 && other.from_ns < held.from_ns;
        match self.waiting.map(|other| before(&other)) {
            [false, _] => self.waiting = [held, Held::NOTHING],
            [true, false] => self.waiting[1] = held,
            // What moves is never announced so early: a stop. To drop one that waits for its time would lead
            // the robot elsewhere than is known, so that it stands at once and tells.
            [true, true] => {
                self.drop_all();
                (self.waiting[0], self.followed) = (held, None);
            }
        }
    }

    fn drop_all(&mut self) {
        (self.current, self.waiting) = (Held::NOTHING, [Held::NOTHING; 2]);
    }

    /// Commands whose time has come replace the ones before them.
    fn promote(&mut self, now_ns: u64) {
        while self.waiting[0].until_ns > 0 && self.waiting[0].from_ns <= now_ns {
            (self.current, self.waiting) = (self.waiting[0], [self.waiting[1], Held::NOTHING]);
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

    /// The robot has stopped by itself: an emergency stop, a blocked wheel. To be called for as long as that
    /// lasts.
    ///
    /// It is where no command has led it, so it follows none until the daemon has said in a stop that it
    /// knows.
    pub fn halt(&mut self) {
        self.drop_all();
        self.followed = None;
    }

    /// Which command the robot follows now, at `now_ns`: what its driver tells the daemon with where the robot is.
    ///
    /// A command that it has taken and that waits for its time counts; a stop with which it begins anew
    /// counts from when it acts.
    /// Times must not run backwards from call to call, of this and of the others. The daemon is not told what
    /// robots hold that follow whatever comes ([`unreported`](Self::unreported)).
    pub fn holding(&self, now_ns: u64) -> Holding {
        match self.followed {
            _ if self.unreported => Holding::Untold,
            Some((tick, since_ns)) if since_ns <= now_ns => Holding::Command { tick },
            _ => Holding::Nothing,
        }
    }

    /// The next instant after `now_ns` at which [`Gate::input`] can change without a new command.
    pub fn next_change_ns(&self, now_ns: u64) -> Option<u64> {
        let waiting = self.waiting.iter().flat_map(|held| [held.from_ns, held.until_ns]);
        waiting.chain([self.current.until_ns]).filter(|&t| t > now_ns).min()
    }

    /// Commands refused so far.
    pub fn refused(&self) -> u64 {
        self.refused
    }
}

#[cfg(test)]
mod tests;
