//! One robot on the screen, and the order of them all.

use std::cmp::Ordering;

use clearway::wire::{
    RobotCommand, RobotState, RobotTelemetry, SolveStatus, StopReason, state_flags, telemetry_flags,
};

/// What the newest samples say of a robot.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Robot {
    pub(crate) state: RobotState,
    pub(crate) command: Option<RobotCommand>,
    pub(crate) telemetry: Option<RobotTelemetry>,
}

impl Robot {
    /// Straight line to its goal, m; none for a foreign robot.
    pub(crate) fn goal_away_m(&self) -> Option<f64> {
        let away = (self.state.position_m() - self.state.goal_m()).norm();
        (!self.is_foreign()).then_some(away)
    }

    pub(crate) fn is_foreign(&self) -> bool {
        self.state.has(state_flags::FOREIGN)
    }

    pub(crate) fn has_arrived(&self) -> bool {
        self.state.has(state_flags::ARRIVED)
    }

    pub(crate) fn is_seen(&self) -> bool {
        self.state.has(state_flags::VALID)
    }

    /// Code of the stop that went out last; 0: a verified command.
    pub(crate) fn stop_code(&self) -> u32 {
        let told = self.command.map(|command| command.stop_reason);
        told.or(self.telemetry.map(|telemetry| telemetry.stop_reason)).unwrap_or(0)
    }

    /// Why it was told to stop, if it was.
    pub(crate) fn stop_reason(&self) -> Option<&'static str> {
        let code = self.stop_code();
        (code != 0).then(|| StopReason::from_code(code).map_or("unknown", StopReason::name))
    }

    /// Whether it stands for a reason that nobody wanted.
    pub(crate) fn is_failing(&self) -> bool {
        let wanted = |reason: StopReason| {
            reason.is_wanted() || matches!(reason, StopReason::Start | StopReason::Finished)
        };
        let code = self.stop_code();
        code != 0 && StopReason::from_code(code).is_none_or(|reason| !wanted(reason))
    }

    pub(crate) fn is_stalled(&self) -> bool {
        self.telemetry.is_some_and(|telemetry| telemetry.flags & telemetry_flags::STALLED != 0)
    }

    /// How it is doing, in at most ten columns.
    pub(crate) fn status(&self) -> &'static str {
        let flags = self.telemetry.map_or(0, |telemetry| telemetry.flags);
        if self.stop_code() == StopReason::OutOfStep as u32 {
            // Its name has a letter more.
            "lost step"
        } else if let Some(reason) = self.stop_reason() {
            reason
        } else if self.is_foreign() {
            "foreign"
        } else if !self.is_seen() {
            "unseen"
        } else if self.has_arrived() {
            "arrived"
        } else if self.is_stalled() {
            "stalled"
        } else if flags & telemetry_flags::GIVING_WAY != 0 {
            "gives way"
        } else {
            "drives"
        }
    }

    /// How its last programme ended, for a script.
    pub(crate) fn solve_status(&self) -> Option<&'static str> {
        let code = self.telemetry?.status;
        let names = [
            (SolveStatus::NotSolved, "not_solved"),
            (SolveStatus::Verified, "verified"),
            (SolveStatus::Refused, "refused"),
            (SolveStatus::Failed, "failed"),
        ];
        names.into_iter().find(|(status, _)| *status as u32 == code).map(|(_, name)| name)
    }

    /// The larger of its certificates' slacks δ_p and δ_θ.
    pub(crate) fn slack(&self) -> f64 {
        self.telemetry.map_or(0.0, |t| t.slack_position_m2.max(t.slack_heading))
    }
}

/// What comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Sort {
    #[default]
    Slack,
    Stopped,
    Distance,
    Solve,
    Id,
}

impl Sort {
    pub(crate) fn next(self) -> Self {
        match self {
            Self::Slack => Self::Stopped,
            Self::Stopped => Self::Distance,
            Self::Distance => Self::Solve,
            Self::Solve => Self::Id,
            Self::Id => Self::Slack,
        }
    }

    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::Slack => "worst slack",
            Self::Stopped => "stopped first",
            Self::Distance => "farthest first",
            Self::Solve => "slowest solve",
            Self::Id => "by id",
        }
    }

    fn compare(self, a: &Robot, b: &Robot) -> Ordering {
        // Graver first, then farther: a stop that nobody wanted, no state, a stall, a wanted stop.
        let gravity = |robot: &Robot| {
            if robot.is_failing() {
                4
            } else if !robot.is_seen() {
                3
            } else if robot.is_stalled() && !robot.has_arrived() {
                2
            } else {
                i32::from(robot.stop_code() != 0 && !robot.is_foreign())
            }
        };
        let solve = |robot: &Robot| robot.telemetry.map_or(0, |telemetry| telemetry.solve_ns);
        let distance = |robot: &Robot| robot.goal_away_m().unwrap_or(-1.0);
        let first = match self {
            Self::Slack => b.slack().total_cmp(&a.slack()),
            Self::Stopped => gravity(b).cmp(&gravity(a)),
            Self::Distance => distance(b).total_cmp(&distance(a)),
            Self::Solve => solve(b).cmp(&solve(a)),
            Self::Id => Ordering::Equal,
        };
        first.then(a.state.id.cmp(&b.state.id))
    }
}

/// Who is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Filter {
    #[default]
    All,
    /// Away from its goal.
    Away,
    /// Told to stop, without a state, or stalled.
    Standing,
}

impl Filter {
    pub(crate) fn next(self) -> Self {
        match self {
            Self::All => Self::Away,
            Self::Away => Self::Standing,
            Self::Standing => Self::All,
        }
    }

    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Away => "away from goal",
            Self::Standing => "standing",
        }
    }

    fn keeps(self, robot: &Robot) -> bool {
        match self {
            Self::All => true,
            Self::Away => !robot.has_arrived() && !robot.is_foreign(),
            Self::Standing => {
                robot.stop_code() != 0 && !robot.is_foreign()
                    || !robot.is_seen()
                    || robot.is_stalled() && !robot.has_arrived()
            }
        }
    }
}

/// Those that are shown, in order.
pub(crate) fn listed(robots: &[Robot], sort: Sort, filter: Filter) -> Vec<&Robot> {
    let mut listed: Vec<&Robot> = robots.iter().filter(|robot| filter.keeps(robot)).collect();
    listed.sort_by(|a, b| sort.compare(a, b));
    listed
}
