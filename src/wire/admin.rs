use super::named_codes;
use iceoryx2::prelude::ZeroCopySend;

/// Header of a request on `admin`. Its payload is a slice of [`AdminRobot`]: one record for each robot
/// that the request is about, none where it is about the fleet.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend)]
#[type_name("clearway.v1.AdminRequest")]
pub struct AdminRequest {
    /// Chosen by the client and repeated in the answer.
    pub ticket: u64,
    /// From when the request must not be carried out any more, `CLOCK_MONOTONIC` ns; at most a minute
    /// ahead.
    pub expires_ns: u64,
    /// The run of the daemon that is meant; 0: whichever runs.
    pub epoch: u64,
    /// Where the wanted piece of a long text begins, bytes; 0 for kinds that answer none.
    pub offset: u64,
    /// Code of the [`AdminKind`].
    pub kind: u32,
    /// Zero; reserved.
    pub reserved: u32,
}

/// One robot in a request on `admin`. Fields that its kind does not name are not looked at.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend)]
#[type_name("clearway.v1.AdminRobot")]
pub struct AdminRobot {
    /// Id of the robot.
    pub id: u32,
    /// Zero; reserved.
    pub reserved: u32,
    /// Goal, m; for [`AdminKind::SetGoals`] and [`AdminKind::AddRobot`].
    pub goal_x_m: f64,
    /// Goal, m.
    pub goal_y_m: f64,
    /// Where it stands, m; for [`AdminKind::AddRobot`], as the two below.
    pub start_x_m: f64,
    /// Where it stands, m.
    pub start_y_m: f64,
    /// Heading, rad, any finite value.
    pub start_theta_rad: f64,
    /// Radius of the disc that covers its body, m.
    pub radius_m: f64,
}

/// Header of an answer on `admin`: what became of the request, and how the daemon is doing. Its payload
/// is UTF-8 text, a slice of bytes: the reason of a refusal, a piece of the configuration as TOML, or
/// what is degraded, a line each.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend)]
#[type_name("clearway.v1.AdminAnswer")]
pub struct AdminAnswer {
    /// The request's.
    pub ticket: u64,
    /// Which run of the daemon.
    pub epoch: u64,
    /// When it was answered, `CLOCK_MONOTONIC` ns.
    pub stamp_ns: u64,
    /// Tick of the first commands that obey the request; the state of the tick before already shows
    /// it. 0 when it changed nothing.
    pub acts_from_tick: u64,
    /// Code of the [`AdminCode`].
    pub code: u32,
    /// The request's.
    pub kind: u32,
    /// Id of the robot that a refusal is about; [`NO_ROBOT`](super::NO_ROBOT): none in particular.
    pub robot: u32,
    /// Bits of [`admin_flags`].
    pub flags: u32,
    /// Length of the whole text, bytes, of which this answer may hold a piece.
    pub text_bytes: u64,
    /// Period that was recorded last.
    pub tick: u64,
    /// Sampling period T, ns.
    pub period_ns: u64,
    /// Since the daemon started, ns.
    pub uptime_ns: u64,
    /// Periods driven.
    pub periods: u64,
    /// Periods without a complete command in time.
    pub deadline_misses: u64,
    /// Periods that never ran.
    pub skipped_periods: u64,
    /// Stops in place of verified commands, for a reason other than an operator's.
    pub fallback_commands: u64,
    /// Observations refused.
    pub rejected_inputs: u64,
    /// Records that telemetry lost.
    pub lost_records: u64,
    /// Times that a worker panicked.
    pub worker_panics: u64,
    /// The latest release so far, ns.
    pub release_lateness_max_ns: u64,
    /// 99 % of the solves took at most this, ns.
    pub solve_p99_ns: u64,
    /// Smallest clearance so far, over continuous time, m; +∞ without a pair.
    pub min_clearance_m: f64,
    /// Requests that were carried out.
    pub requests_done: u64,
    /// Requests that were refused, expired ones among them.
    pub requests_refused: u64,
    /// Requests that were answered busy.
    pub requests_busy: u64,
    /// Robots that the fleet has room for.
    pub capacity: u32,
    /// Robots of the fleet, foreign ones among them.
    pub robots: u32,
    /// Robots that stand inside the tolerance of their goals.
    pub arrived: u32,
    /// Robots that have not made progress for more than a second, away from their goals.
    pub stalled: u32,
    /// Robots without a trusted state.
    pub unseen: u32,
    /// Worker threads.
    pub workers: u32,
    /// Workers that have not answered in time for two periods.
    pub workers_silent: u32,
    /// Lines of the text that `status` answers: where the real-time set-up fell short, and what went wrong since.
    pub degraded: u32,
    /// Readers of `state`, without the daemon's own.
    pub state_readers: u32,
    /// Readers of `command`.
    pub command_readers: u32,
    /// Readers of `telemetry`.
    pub telemetry_readers: u32,
    /// Writers of `observation`.
    pub observation_writers: u32,
    /// Clients of `admin`.
    pub admin_clients: u32,
    /// Restarts after a crash that count; see the configuration's `journal.restarts`.
    pub restarts: u32,
}

impl AdminAnswer {
    /// Whether all bits of `flags` are set.
    pub fn has(&self, flags: u32) -> bool {
        self.flags & flags == flags
    }
}

/// Bits of [`AdminAnswer::flags`].
pub mod admin_flags {
    /// The fleet is paused, until it is resumed.
    pub const PAUSED: u32 = 1;
    /// The fleet is stopped, by an operator or by the daemon itself, until that is cleared.
    pub const STOPPED: u32 = 1 << 1;
    /// The kernel refused a real-time call, or what `status` tells went wrong since.
    pub const DEGRADED: u32 = 1 << 2;
    /// All memory is locked.
    pub const MEMORY_LOCKED: u32 = 1 << 3;
    /// States come from the `observation` channel.
    pub const OBSERVED: u32 = 1 << 4;
    /// The run ends when every robot has arrived.
    pub const ENDS_ON_ARRIVAL: u32 = 1 << 5;
    /// What operators change is kept in a journal, over a restart of the daemon.
    pub const JOURNAL: u32 = 1 << 6;
    /// The journal cannot be written.
    pub const JOURNAL_FAILING: u32 = 1 << 7;
    /// With STOPPED: the daemon itself stopped the fleet, because it had to be started again too often.
    pub const STOPPED_BY_RESTARTS: u32 = 1 << 8;
    /// With STOPPED: the daemon itself stopped the fleet, because its journal could not be read.
    pub const STOPPED_BY_JOURNAL: u32 = 1 << 9;
    /// A worker panicked again and again and rests before it tries once more; its robots stand.
    pub const WORKER_RESTING: u32 = 1 << 10;
}

named_codes! {
    /// What a request asks for.
    AdminKind {
        /// How is the daemon doing? Changes nothing.
        Status = 1, "status";
        /// What is in force? Answers the configuration as TOML, from `offset` on.
        Configuration = 2, "configuration";
        /// New goals for one robot or several, all of them or none.
        SetGoals = 3, "set_goals";
        /// Everybody holds until resumed.
        Pause = 4, "pause";
        /// Go on after a pause.
        Resume = 5, "resume";
        /// Everybody stops; latched until cleared.
        Stop = 6, "stop";
        /// Takes the latch off a stop. The fleet is paused then: nobody moves before a resume.
        Clear = 7, "clear";
        /// One more robot.
        AddRobot = 8, "add_robot";
        /// One robot fewer. The others keep clear of it no longer: whoever asks answers for it that the
        /// robot has been taken away.
        RemoveRobot = 9, "remove_robot";
        /// Who is to go where? Answers the scenario as TOML, with today's robots, goals and obstacles,
        /// from `offset` on.
        Scenario = 10, "scenario";
    }
}

named_codes! {
    /// What became of a request.
    AdminCode {
        /// It was carried out.
        Done = 0, "done";
        /// Too much is asked for at a time: try again a period later.
        Busy = 1, "busy";
        /// It came, or would have been carried out, after its expiry.
        Expired = 2, "expired";
        /// Its kind is unknown, or its records do not fit its kind.
        Malformed = 3, "malformed";
        /// It is meant for another run of the daemon.
        OtherEpoch = 4, "other_epoch";
        /// There is no robot with this id.
        UnknownRobot = 5, "unknown_robot";
        /// The robot is a foreign one: it takes no goals and is not the daemon's to remove.
        ForeignRobot = 6, "foreign_robot";
        /// A robot stands in the request twice.
        RepeatedRobot = 7, "repeated_robot";
        /// There is a robot with this id already, or the id is reserved.
        TakenId = 8, "taken_id";
        /// A number is not finite.
        NotFinite = 9, "not_finite";
        /// A point is outside the arena.
        OutsideArena = 10, "outside_arena";
        /// A point is closer to an obstacle than the robot may come.
        InsideObstacle = 11, "inside_obstacle";
        /// A goal is closer to another robot's goal than the two may come.
        GoalTaken = 12, "goal_taken";
        /// The robot would stand closer to another than the two may come.
        TooClose = 13, "too_close";
        /// The radius is out of range.
        BadRadius = 14, "bad_radius";
        /// The fleet has no room for another robot.
        Full = 15, "full";
        /// The fleet is stopped: clear that first.
        Stopped = 16, "stopped";
        /// The run is ending.
        Ending = 17, "ending";
        /// It was carried out and is in force, and could not be kept, or not yet: it may not survive a restart
        /// of the daemon.
        NotKept = 18, "not_kept";
    }
}

impl AdminKind {
    /// Whether it only asks and changes nothing.
    pub fn is_question(self) -> bool {
        matches!(self, Self::Status | Self::Configuration | Self::Scenario)
    }
}
