use crate::geometry::{Arc, Pose, Vec2};
use crate::model::{Command, RobotId, RobotSpec};
use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

/// Bits of [`RobotState::flags`].
pub mod state_flags {
    /// The pose comes from an accepted observation. Without it the pose is the middle of the way that it was
    /// told to drive since the last good one, the robot is told to stop, and others keep a larger distance.
    pub const VALID: u32 = 1;
    /// The robot is inside the tolerance of its goal.
    pub const ARRIVED: u32 = 1 << 1;
    /// The robot is a foreign one: it is observed, takes no commands and has no goal.
    pub const FOREIGN: u32 = 1 << 2;
    /// Nobody: a free place of the fleet. The rest of the record says nothing.
    pub const VACANT: u32 = 1 << 3;
    /// The fleet is paused: the robot is told to stop until it is resumed.
    pub const PAUSED: u32 = 1 << 4;
    /// The fleet is stopped, by an operator or by the daemon itself: the robot is told to stop until that is cleared.
    pub const STOPPED: u32 = 1 << 5;
    /// The robot is seen and not driven by the daemon itself: it follows its commands, or it has come to a
    /// stand somewhere on its way since it was last seen. Others keep clear of all of that way.
    pub const MAY_STAND: u32 = 1 << 6;
    /// The robot missed a command, or was stopped by something else: it stands, follows nothing that moves, and
    /// is told to stop until it is known to hold that.
    pub const OUT_OF_STEP: u32 = 1 << 7;
}

/// Header of a sample on `state`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend, Pod, Zeroable)]
#[type_name("clearway.v1.StateHeader")]
pub struct StateHeader {
    /// Which run of the daemon: larger than every earlier one of this fleet.
    pub epoch: u64,
    /// Number k of the period, from 0 in each epoch; skipped periods leave gaps.
    pub tick: u64,
    /// When the state was taken, `CLOCK_MONOTONIC` ns.
    pub stamp_ns: u64,
    /// Scheduled start `t_k` of the period, `CLOCK_MONOTONIC` ns.
    pub release_ns: u64,
    /// Sampling period T, ns.
    pub period_ns: u64,
    /// Records of the sample.
    pub records: u32,
    /// CRC-32 of the channel's name, the header before this field, and the records.
    pub checksum: u32,
}

/// One robot in a sample on `state`: where it is at `t_k`, and the command it holds until `t_{k+1}`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend, Pod, Zeroable)]
#[type_name("clearway.v1.RobotState")]
pub struct RobotState {
    /// Id of the robot.
    pub id: u32,
    /// Bits of [`state_flags`].
    pub flags: u32,
    /// Position, m.
    pub x_m: f64,
    /// Position, m.
    pub y_m: f64,
    /// Heading, rad, in (−π, π].
    pub theta_rad: f64,
    /// Forward speed held over [`t_k`, `t_{k+1}`), m/s.
    pub v_mps: f64,
    /// Turn rate held over [`t_k`, `t_{k+1}`), rad/s.
    pub omega_radps: f64,
    /// Goal, m.
    pub goal_x_m: f64,
    /// Goal, m.
    pub goal_y_m: f64,
    /// Radius of the body, m.
    pub radius_m: f64,
    /// How far a foreign robot may have moved from this pose by `t_k`, m: its speed bound times the
    /// age of its last good observation; +∞ before the first. For the robots of the fleet what they may
    /// still travel after `t_k` on earlier commands than the one held: 0 unless `[robust]` allows for lag
    /// or delay. For one that is not VALID also how far from its pose it may be: half of the way that it
    /// was told to drive since it was last seen; the pose is the middle of that way.
    pub uncertainty_m: f64,
    /// Where it was last seen, m: the beginning of the way on which it may stand. Of one that is OUT_OF_STEP the
    /// end, where its commands would have led it. Says nothing without MAY_STAND.
    pub seen_x_m: f64,
    /// Where it was last seen, m.
    pub seen_y_m: f64,
    /// Length of that way, between there and its pose, m; below 0 where it was seen only after `t_k`.
    pub way_m: f64,
    /// What the robot meant to do when it chose its command.
    pub intent: RobotIntent,
}

/// What a robot tells the others besides its state: where it steers and how fast it means to go.
///
/// Written by the robot's guidance one period earlier; read by the guidance of its neighbours.
/// Safety does not depend on it.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend, Pod, Zeroable)]
#[type_name("clearway.v1.RobotIntent")]
pub struct RobotIntent {
    /// Heading it steers to, rad.
    pub heading_rad: f64,
    /// Mean speed that it expects over the next seconds, m/s.
    pub speed_mps: f64,
    /// How long it has been without progress, s: the right of way of the one that waits.
    pub blocked_s: f64,
    /// Point it drives to now, after avoidance, m.
    pub target_x_m: f64,
    /// Point it drives to now, after avoidance, m.
    pub target_y_m: f64,
    /// Goal, or next point of its route around obstacles, m.
    pub waypoint_x_m: f64,
    /// Goal, or next point of its route around obstacles, m.
    pub waypoint_y_m: f64,
    /// Own id, or the id it acts for while it gives way.
    pub rank: u32,
    /// 0 before the robot's guidance ran for the first time.
    pub valid: u32,
}

impl RobotState {
    /// A robot at rest at its start, its pose not yet confirmed by an observation.
    pub fn at_start(robot: &RobotSpec) -> Self {
        let mut state = Self {
            id: robot.id.0,
            flags: if robot.foreign_speed_mps.is_some() { state_flags::FOREIGN } else { 0 },
            goal_x_m: robot.goal_m.x,
            goal_y_m: robot.goal_m.y,
            radius_m: robot.radius_m,
            ..Self::default()
        };
        state.set_pose(robot.start);
        state
    }

    /// A free place.
    pub fn vacant() -> Self {
        Self { id: super::NO_ROBOT, flags: state_flags::VACANT, ..Self::default() }
    }

    /// Whether the fleet is held: paused or stopped.
    pub fn is_held(&self) -> bool {
        self.flags & (state_flags::PAUSED | state_flags::STOPPED) != 0
    }

    /// Id of the robot.
    pub fn robot(&self) -> RobotId {
        RobotId(self.id)
    }

    /// Pose at `t_k`.
    pub fn pose(&self) -> Pose {
        Pose { position_m: self.position_m(), theta_rad: self.theta_rad }
    }

    /// Position at `t_k`, m.
    pub fn position_m(&self) -> Vec2 {
        Vec2::new(self.x_m, self.y_m)
    }

    /// Where it was last seen, m.
    pub fn seen_m(&self) -> Vec2 {
        Vec2::new(self.seen_x_m, self.seen_y_m)
    }

    /// Goal, m.
    pub fn goal_m(&self) -> Vec2 {
        Vec2::new(self.goal_x_m, self.goal_y_m)
    }

    /// The command held over [`t_k`, `t_{k+1}`).
    pub fn command(&self) -> Command {
        Command { v_mps: self.v_mps, omega_radps: self.omega_radps }
    }

    /// The motion over [`t_k`, `t_{k+1}`).
    pub fn arc(&self) -> Arc {
        Arc { start: self.pose(), v_mps: self.v_mps, omega_radps: self.omega_radps }
    }

    /// Whether all bits of `flags` are set.
    pub fn has(&self, flags: u32) -> bool {
        self.flags & flags == flags
    }

    /// Replaces the pose.
    pub fn set_pose(&mut self, pose: Pose) {
        (self.x_m, self.y_m, self.theta_rad) = (pose.position_m.x, pose.position_m.y, pose.theta_rad);
    }

    /// Replaces the held command.
    pub fn set_command(&mut self, command: Command) {
        (self.v_mps, self.omega_radps) = (command.v_mps, command.omega_radps);
    }
}
