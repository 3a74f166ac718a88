//! The faults: what each one does, which counter tells of it, what it may cost, and for how long.

use super::tally::Counter;
use crate::actuation::Refusal;
use crate::admission::Rejection;
use crate::wire::StopReason;

/// Whom a fault concerns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// One robot, by what is observed of it or how its command is carried.
    Robot,
    /// All robots of one driver.
    Driver,
    /// Whoever a worker answers.
    Worker,
    /// Everybody.
    Fleet,
}

/// What is promised about a fault.
#[derive(Debug, Clone, Copy)]
pub struct Promise {
    /// Its name on the command line.
    pub name: &'static str,
    /// Whom it concerns.
    pub scope: Scope,
    /// What the system does about it, in a few words.
    pub policy: &'static str,
    /// Counters that it may move.
    pub(crate) counters: &'static [Counter],
    /// Whether the first of them has to move.
    pub(crate) named: bool,
    /// Reasons for which robots that it concerns may be told to stop.
    pub(crate) stops: &'static [StopReason],
    /// Periods after its end in which robots that it concerns may still stop, and counters move.
    pub recovery: u64,
    /// What the log has to say.
    pub(crate) says: Option<&'static str>,
    /// How many periods it may last: from, to.
    pub(crate) lasts: (u64, u64),
    /// Whether robots keep clear of each other all the same: not of one whose senses lie within what is
    /// plausible for many periods.
    pub(crate) keeps_clear: bool,
    /// Whether a pose that is not true may be believed: the robot may drive from elsewhere than is known.
    pub(crate) misleads: bool,
}

const REFUSED: Option<&str> = Some("observations refused");
const MISSED: Option<&str> = Some("periods without a complete command in time");
const UNVERIFIED: Option<&str> = Some("stops sent in place of verified commands");

use Counter::{Gate, Panics, Rejected, Rests, SendFailures, Silent, Skipped, SkippedPeriods, Stop};

const fn one(name: &'static str, scope: Scope, policy: &'static str) -> Promise {
    Promise {
        name,
        scope,
        policy,
        counters: &[],
        named: true,
        stops: &[],
        recovery: 1,
        says: None,
        lasts: (1, 1),
        keeps_clear: true,
        misleads: false,
    }
}

/// Robots stop when their observations are refused for longer than they may be old.
const UNSEEN: &[StopReason] = &[StopReason::NoState];
/// A robot that missed a command: the daemon hears of it, the robot holds a stop, the daemon hears of that.
const UNHEARD: u64 = 4;
const LATE: &[StopReason] = &[StopReason::Deadline];
/// A sample that jumps, and five that agree.
const READMITTED: u64 = 8;

impl Promise {
    /// The counter that it has to move.
    pub fn counter(&self) -> Option<String> {
        self.counters.first().filter(|_| self.named).map(ToString::to_string)
    }

    /// Whether it is about something that goes wrong, or that somebody asks for.
    pub fn is_fault(&self) -> bool {
        self.name != "begin"
    }
}

macro_rules! kinds {
    ($($(#[$doc:meta])* $kind:ident => $promise:expr;)+) => {
        /// A kind of fault.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Kind {
            $($(#[$doc])* $kind,)+
        }

        impl Kind {
            /// Every kind.
            pub const ALL: &'static [Self] = &[$(Self::$kind),+];

            /// What is promised about it.
            pub fn promise(self) -> &'static Promise {
                match self {
                    $(Self::$kind => const { &$promise },)+
                }
            }
        }
    };
}

kinds! {
    /// No fault: the first periods of a daemon.
    Begin => Promise {
        // It attaches two to three periods before its first: what came at once is too old by then.
        counters: &[Rejected(Rejection::Epoch), Rejected(Rejection::Stale)], named: false,
        stops: &[StopReason::Start, StopReason::NoState], recovery: 0,
        ..one("begin", Scope::Fleet, "robots stand until the first state is answered")
    };
    /// A worker panics among its robots.
    WorkerPanic => Promise {
        counters: &[Panics, Stop(StopReason::Deadline), Counter::Misses], stops: LATE,
        says: Some("worker panics; who went without an answer stopped"),
        ..one("worker-panic", Scope::Worker, "robots that nobody answered stop for the period; rebuilt")
    };
    /// A worker takes no turn.
    WorkerHang => Promise {
        counters: &[Silent, Stop(StopReason::Deadline), Counter::Misses], stops: LATE, lasts: (2, 6),
        says: Some("a worker does not answer in time"),
        ..one("worker-hang", Scope::Worker, "the others answer as far as they have room, the rest stop; noticed after two periods")
    };
    /// A worker answers after the deadline.
    WorkerLate => Promise {
        counters: &[Stop(StopReason::Deadline), Counter::Misses, Silent], stops: LATE, lasts: (1, 3), says: MISSED,
        ..one("worker-late", Scope::Worker, "the others answer as far as they have room, the rest stop; no late answer is used")
    };
    /// The solver answers not-a-number.
    SolverNan => Promise {
        counters: &[Stop(StopReason::Unverified)], stops: &[StopReason::Unverified], lasts: (1, 4), says: UNVERIFIED,
        ..one("solver-nan", Scope::Worker, "not verified; the robots stop")
    };
    /// The solver answers beyond the limits.
    SolverBeyond => Promise {
        counters: &[Stop(StopReason::Unverified)], stops: &[StopReason::Unverified], lasts: (1, 4), says: UNVERIFIED,
        ..one("solver-beyond", Scope::Worker, "not verified; the robots stop")
    };
    /// The solver answers almost the solution.
    SolverAlmost => Promise {
        counters: &[Stop(StopReason::Unverified)], stops: &[StopReason::Unverified], lasts: (1, 4), says: UNVERIFIED,
        ..one("solver-almost", Scope::Worker, "not verified; the robots stop")
    };
    /// The solver runs out of iterations.
    SolverGivesUp => Promise {
        counters: &[Stop(StopReason::Solver)], stops: &[StopReason::Solver], lasts: (1, 4), says: UNVERIFIED,
        ..one("solver-gives-up", Scope::Worker, "the robots stop")
    };
    /// A worker stages what no robot can do.
    AnswerWild => Promise {
        counters: &[Stop(StopReason::Unverified)], stops: &[StopReason::Unverified], lasts: (1, 4), says: UNVERIFIED,
        ..one("answer-wild", Scope::Worker, "refused by the loop; the robots stop")
    };
    /// The loop wakes 1.5, 3.2 or 20 periods late.
    Overrun => Promise {
        counters: &[SkippedPeriods, Counter::Misses, Rejected(Rejection::Stale), Skipped], stops: UNSEEN, recovery: 1,
        says: MISSED,
        ..one("overrun", Scope::Fleet, "whole periods skipped, the phase kept; robots stand meanwhile")
    };
    /// The loop is preempted between its state and its commands until the period is over.
    Preempted => Promise {
        counters: &[Counter::Misses, SkippedPeriods, Rejected(Rejection::Stale)], stops: LATE, says: MISSED,
        ..one("preempted", Scope::Fleet, "output that comes too late is thrown away; robots stand")
    };
    /// The daemon is killed and started again.
    Kill => Promise {
        counters: &[Rejected(Rejection::Epoch), Gate(Refusal::OldEpoch), Gate(Refusal::Future)],
        stops: &[StopReason::Start, StopReason::NoState], recovery: 6, lasts: (3, 12), named: false,
        ..one("kill", Scope::Fleet, "robots stop when their commands expire; a new epoch, the goals resume")
    };
    /// A coordinate is NaN or infinite.
    ObsNotFinite => Promise {
        counters: &[Rejected(Rejection::NotFinite)], stops: UNSEEN, lasts: (1, 6), recovery: 2, says: REFUSED,
        ..one("obs-not-finite", Scope::Robot, "refused; stale after two periods, then the robot stops")
    };
    /// A coordinate is subnormal.
    ObsSubnormal => Promise {
        counters: &[Rejected(Rejection::Jump)], stops: UNSEEN, lasts: (1, 3), recovery: READMITTED,
        named: false, keeps_clear: false, misleads: true,
        ..one("obs-subnormal", Scope::Robot, "a number like any other: refused where it is a jump, else believed")
    };
    /// A coordinate is outside of the arena.
    ObsOutOfRange => Promise {
        counters: &[Rejected(Rejection::OutOfRange)], stops: UNSEEN, lasts: (1, 6), recovery: 2, says: REFUSED,
        ..one("obs-out-of-range", Scope::Robot, "refused; stale after two periods, then the robot stops")
    };
    /// A record of a robot that is not of the fleet takes another's place.
    ObsUnknownRobot => Promise {
        counters: &[Rejected(Rejection::UnknownRobot)], stops: UNSEEN, lasts: (1, 4), recovery: 2, says: REFUSED,
        ..one("obs-unknown-robot", Scope::Robot, "refused")
    };
    /// A robot stands twice in a sample, in another robot's place.
    ObsDuplicate => Promise {
        counters: &[Rejected(Rejection::DuplicateRobot), Rejected(Rejection::Jump)], stops: UNSEEN,
        lasts: (1, 3), recovery: READMITTED, says: REFUSED,
        ..one("obs-duplicate", Scope::Driver, "neither counts; quarantine until five samples agree")
    };
    /// A second writer speaks for a robot.
    ObsMasquerade => Promise {
        counters: &[Rejected(Rejection::ForeignWriter), Rejected(Rejection::Jump), Rejected(Rejection::Reordered)],
        stops: UNSEEN, lasts: (1, 4), recovery: READMITTED, says: REFUSED,
        ..one("obs-masquerade", Scope::Robot, "refused while the first one is heard")
    };
    /// A sample with more records than there are robots.
    ObsOversize => Promise {
        counters: &[Rejected(Rejection::Oversize), Skipped], stops: UNSEEN, lasts: (1, 4), recovery: 2, says: REFUSED,
        ..one("obs-oversize", Scope::Driver, "refused as a whole; nothing is cut off")
    };
    /// A sample again.
    ObsRepeated => Promise {
        counters: &[Rejected(Rejection::Repeated)], lasts: (1, 4), says: REFUSED,
        ..one("obs-repeated", Scope::Driver, "refused; nothing else happens")
    };
    /// An older sample after a newer one.
    ObsReordered => Promise {
        // One that was stamped ahead is of its time when it comes again, and tells what was held long before.
        counters: &[
            Rejected(Rejection::Reordered), Skipped, Rejected(Rejection::Repeated), Rejected(Rejection::Stale),
            Stop(StopReason::OutOfStep),
        ],
        stops: &[StopReason::OutOfStep], lasts: (1, 4), recovery: UNHEARD, says: REFUSED, misleads: true,
        ..one("obs-reordered", Scope::Driver, "refused; of one stamped ahead its robots stop until they have held a stop")
    };
    /// Samples are lost on the way.
    ObsLost => Promise {
        counters: &[Skipped], stops: UNSEEN, lasts: (1, 6), recovery: 2,
        ..one("obs-lost", Scope::Driver, "counted when the next one comes; stale after two periods")
    };
    /// The sequence number is far ahead.
    ObsGap => Promise {
        counters: &[Rejected(Rejection::Gap), Skipped, Rejected(Rejection::Reordered), Counter::Resynchronised],
        stops: UNSEEN, lasts: (1, 3), recovery: READMITTED, says: REFUSED,
        ..one("obs-gap", Scope::Driver, "refused; where it is the first of its writer, given up after five others")
    };
    /// The sample follows another run of the daemon.
    ObsOldEpoch => Promise {
        counters: &[Rejected(Rejection::Epoch), Skipped], stops: UNSEEN, lasts: (1, 6), recovery: 2, says: REFUSED,
        ..one("obs-old-epoch", Scope::Driver, "refused; stale after two periods, then its robots stop")
    };
    /// The stamp is older than is allowed.
    ObsStale => Promise {
        counters: &[Rejected(Rejection::Stale), Skipped], stops: UNSEEN, lasts: (1, 6), recovery: 2, says: REFUSED,
        ..one("obs-stale", Scope::Driver, "refused; stale after two periods, then its robots stop")
    };
    /// The stamp lies ahead: another clock.
    ObsFuture => Promise {
        // One that waits while the loop overruns is not of the future any more, and newer than those behind it.
        counters: &[Rejected(Rejection::Future), Skipped, Rejected(Rejection::Reordered)],
        stops: UNSEEN, lasts: (1, 6), recovery: 2, says: REFUSED, misleads: true,
        ..one("obs-future", Scope::Driver, "refused; stale after two periods, then its robots stop")
    };
    /// A robot is seen elsewhere than where it can be.
    ObsTeleport => Promise {
        counters: &[Rejected(Rejection::Jump)], stops: UNSEEN, lasts: (1, 3), recovery: READMITTED, says: REFUSED,
        ..one("obs-teleport", Scope::Robot, "quarantine until five samples agree; the robot stands")
    };
    /// The pose stays the same while the robot drives and its samples go on.
    ObsFrozen => Promise {
        counters: &[Counter::Frozen, Rejected(Rejection::Jump)], stops: UNSEEN, lasts: (13, 18),
        recovery: READMITTED, says: Some("robots whose pose does not change"), keeps_clear: false, misleads: true,
        ..one("obs-frozen", Scope::Robot, "believed, and reported after ten samples: an alarm, not a stop")
    };
    /// A driver says nothing.
    ObsSilence => Promise {
        counters: &[Stop(StopReason::NoState)], stops: UNSEEN, lasts: (4, 12), recovery: 2, says: UNVERIFIED,
        ..one("obs-silence", Scope::Driver, "stale after two periods, then its robots stop")
    };
    /// A driver is started again and numbers its samples anew, as another writer.
    DriverRestart => Promise {
        counters: &[Rejected(Rejection::ForeignWriter), Skipped], stops: UNSEEN, recovery: 5, says: REFUSED,
        ..one("driver-restart", Scope::Driver, "refused until the old writer is silent for two periods")
    };
    /// A robot is carried to another place.
    Kidnapped => Promise {
        counters: &[Rejected(Rejection::Jump), Stop(StopReason::OutOfStep), Gate(Refusal::OutOfStep)],
        stops: &[StopReason::NoState, StopReason::OutOfStep], recovery: READMITTED, says: REFUSED,
        ..one("kidnapped", Scope::Robot, "quarantine until five samples agree; the robot stands")
    };
    /// A worker does not get the state.
    StateLost => Promise {
        counters: &[Stop(StopReason::Deadline), Counter::Misses, Silent], stops: LATE, lasts: (1, 3), says: MISSED,
        ..one("state-lost", Scope::Worker, "the others answer as far as they have room, the rest stop")
    };
    /// A worker gets the state of an earlier period.
    StateOld => Promise {
        counters: &[Stop(StopReason::Deadline), Counter::Misses, Silent], stops: LATE, lasts: (1, 3), says: MISSED,
        ..one("state-old", Scope::Worker, "not answered; the others answer as far as they have room, the rest stop")
    };
    /// A worker gets the state of another run.
    StateOtherEpoch => Promise {
        counters: &[Stop(StopReason::Deadline), Counter::Misses, Silent], stops: LATE, lasts: (1, 3), says: MISSED,
        ..one("state-other-epoch", Scope::Worker, "not answered; the others answer as far as they have room, the rest stop")
    };
    /// A bit of an observation flips on the way.
    ObsBit => Promise {
        counters: &[Rejected(Rejection::Corrupt), Skipped], stops: UNSEEN, lasts: (1, 6), recovery: 2, says: REFUSED,
        ..one("obs-bit", Scope::Driver, "refused as a whole; stale after two periods, then its robots stop")
    };
    /// A bit of the state flips on its way to a worker.
    StateBit => Promise {
        counters: &[Counter::CorruptStates, Stop(StopReason::Corrupt), Counter::Misses, Silent],
        stops: &[StopReason::Corrupt, StopReason::Deadline], lasts: (1, 3), says: Some("states that changed in memory"),
        ..one("state-bit", Scope::Worker, "not answered; the others answer as far as they have room, the rest stop")
    };
    /// A bit of a command sample flips on its way to a driver.
    CmdBit => Promise {
        counters: &[Counter::CorruptCommands, Gate(Refusal::OutOfStep), Stop(StopReason::OutOfStep)],
        stops: &[StopReason::OutOfStep], lasts: (1, 3), recovery: UNHEARD,
        ..one("cmd-bit", Scope::Driver, "not handed out; the robots stand until they have held a stop")
    };
    /// A command sample comes again.
    CmdRepeated => Promise {
        counters: &[Gate(Refusal::OldTick)], lasts: (1, 4),
        ..one("cmd-repeated", Scope::Driver, "refused by the gate; nothing else happens")
    };
    /// A command sample comes after it has expired.
    CmdLate => Promise {
        counters: &[Stop(StopReason::OutOfStep), Gate(Refusal::OldTick), Gate(Refusal::Expired), Gate(Refusal::OutOfStep)],
        stops: &[StopReason::OutOfStep], recovery: UNHEARD,
        ..one("cmd-late", Scope::Driver, "refused by the gate; the robots stand until they have held a stop")
    };
    /// Commands of an earlier run are played back.
    CmdOldEpoch => Promise {
        counters: &[Gate(Refusal::OldEpoch)], lasts: (1, 4),
        ..one("cmd-old-epoch", Scope::Driver, "refused by the gate; nothing else happens")
    };
    /// A robot gets another one's command.
    CmdWrongRobot => Promise {
        counters: &[Gate(Refusal::WrongRobot)], lasts: (1, 4),
        ..one("cmd-wrong-robot", Scope::Robot, "refused by the gate; nothing else happens")
    };
    /// A robot gets a command that no robot can do, ahead of its own.
    CmdWild => Promise {
        counters: &[Gate(Refusal::Input)], lasts: (1, 4),
        ..one("cmd-wild", Scope::Robot, "refused by the gate, not clamped; nothing else happens")
    };
    /// A robot gets a command that is valid for too long, ahead of its own.
    CmdForever => Promise {
        counters: &[Gate(Refusal::Validity)], lasts: (1, 4),
        ..one("cmd-forever", Scope::Robot, "refused by the gate; nothing else happens")
    };
    /// A command sample is lost on the way to a driver.
    CmdLost => Promise {
        counters: &[Stop(StopReason::OutOfStep), Gate(Refusal::OutOfStep)],
        stops: &[StopReason::OutOfStep], lasts: (1, 4), recovery: UNHEARD,
        ..one("cmd-lost", Scope::Driver, "the robots stand until they have held a stop")
    };
    /// A robot stops by itself: an emergency stop, a blocked wheel.
    Halted => Promise {
        counters: &[Stop(StopReason::OutOfStep), Gate(Refusal::OutOfStep)],
        stops: &[StopReason::OutOfStep], lasts: (1, 6), recovery: UNHEARD,
        ..one("halted", Scope::Robot, "it stands until it has held a stop; others keep clear of all of its way")
    };
    /// There is no shared memory for the next command sample.
    Exhausted => Promise {
        counters: &[SendFailures, Counter::Misses], lasts: (1, 4),
        says: Some("samples that could not be loaned"),
        ..one("exhausted", Scope::Fleet, "nothing goes out and the robots stand; the loop goes on")
    };
    /// An operator sends a robot elsewhere.
    OpGoal => Promise { ..one("op-goal", Scope::Robot, "carried out at the start of a period") };
    /// An operator asks for what cannot be: NaN, outside of the arena, an unknown robot, another's goal.
    OpBadGoal => Promise {
        counters: &[Counter::Refused],
        says: Some("refused: "),
        ..one("op-bad-goal", Scope::Robot, "refused with a reason; the last goal is kept")
    };
    /// An operator pauses the fleet, and resumes.
    OpPause => Promise {
        counters: &[Stop(StopReason::Paused)], stops: &[StopReason::Paused], lasts: (2, 10), recovery: 2,
        ..one("op-pause", Scope::Fleet, "everybody stands until it is resumed")
    };
    /// An operator stops the fleet; a resume is refused, then it is cleared and resumed.
    OpStop => Promise {
        counters: &[Stop(StopReason::Stopped), Stop(StopReason::Paused), Counter::Refused],
        stops: &[StopReason::Stopped, StopReason::Paused], lasts: (4, 10), recovery: 4,
        ..one("op-stop", Scope::Fleet, "latched until it is cleared; nobody moves before a resume")
    };
    /// An operator adds a robot and one more, for which there is no room, and takes the first away again.
    OpAdd => Promise {
        stops: &[StopReason::Start, StopReason::NoState, StopReason::OutOfStep],
        counters: &[Counter::Refused, Stop(StopReason::OutOfStep)], lasts: (6, 20),
        recovery: 4, says: Some("refused: "),
        ..one("op-add", Scope::Fleet, "takes a free place and is driven once it is seen; the surplus is refused")
    };
    /// A worker panics four times in a row.
    WorkerRests => Promise {
        counters: &[Rests, Panics, Stop(StopReason::Deadline), Counter::Misses, Silent], stops: LATE,
        lasts: (4, 4), recovery: 20, says: Some("workers that rest after repeated panics"),
        ..one("worker-rests", Scope::Worker, "it rests 16 periods, and longer each time; its robots stand")
    };
}

impl Kind {
    /// Its name.
    pub fn name(self) -> &'static str {
        self.promise().name
    }

    /// The kind that is called so.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|kind| kind.name() == name)
    }
}

impl std::fmt::Display for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}
