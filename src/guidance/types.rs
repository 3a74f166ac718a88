//! What the guidance layer reads and writes. Positions in m, headings in rad, world frame.

use crate::geometry::Vec2;
use crate::model::Obstacle;
/// Most neighbours considered: the nearest ones, in the order given.
pub const NEIGHBOURS_MAX: usize = 16;
/// Most static obstacles considered.
pub const OBSTACLES_MAX: usize = 8;

/// The robot that decides, from the snapshot of this tick.
#[derive(Clone, Copy, Debug)]
pub struct Ego {
    /// Its id.
    pub id: u32,
    /// Position, m.
    pub position_m: Vec2,
    /// Heading, rad.
    pub heading_rad: f64,
    /// Where to go now: the goal itself, or the waypoint of `Route::target`.
    pub target_m: Vec2,
    /// Route length left beyond `target_m`; 0 when the target is the goal.
    pub beyond_m: f64,
    /// Speed in force, m/s.
    pub v_mps: f64,
    /// Turn rate in force, rad/s.
    pub omega_radps: f64,
    /// Inside the tolerance of its goal.
    pub arrived: bool,
}

/// What a robot publishes besides its state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Intent {
    /// Heading it steers to.
    pub heading_rad: f64,
    /// Mean speed it expects.
    pub speed_mps: f64,
    /// Its target, turned by the virtual roundabout.
    pub target_m: Vec2,
    /// Seconds without progress; `ask::ASKING_S` when it asks parked robots to make way.
    pub blocked_s: f64,
    /// Own id, or the rank of the robot it gives way to. Lower goes first.
    pub rank: u32,
}

/// Another robot, from the same snapshot: the same for all who see it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Neighbour {
    /// Position, m.
    pub position_m: Vec2,
    /// Its goal, or the waypoint it is heading for.
    pub target_m: Vec2,
    /// Radius of its body, m.
    pub radius_m: f64,
    /// Its id.
    pub id: u32,
    /// Inside the tolerance of its goal.
    pub arrived: bool,
    /// What it published last tick.
    pub intent: Intent,
    /// Heading, rad.
    pub heading_rad: f64,
}

/// A neighbour as the robot that decides sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// Which of the neighbours it is.
    pub(super) lane: usize,
    /// From it to the robot, m, and how far that is.
    pub(super) apart_m: Vec2,
    pub(super) distance_m: f64,
    /// Required centre distance ρ_ij.
    pub(super) required_m: f64,
}

/// Where a neighbour is, seen from the robot.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bearing {
    /// Unit vector from the neighbour to the robot (n_ij).
    pub normal: Vec2,
    /// Distance beyond the required one.
    pub gap_m: f64,
}

impl Seen {
    pub(super) fn bearing(&self) -> Bearing {
        let distance_m = self.distance_m.max(1e-6);
        Bearing { normal: self.apart_m / distance_m, gap_m: distance_m - self.required_m }
    }
}

/// A static obstacle and the distance to keep from its body.
#[derive(Clone, Copy, Debug)]
pub struct ObstacleView {
    /// The obstacle.
    pub obstacle: Obstacle,
    /// d_s + radius of the robot, m.
    pub keep_m: f64,
}

impl ObstacleView {
    /// Distance to keep from the obstacle's core, m.
    pub fn required_m(&self) -> f64 {
        self.obstacle.reach_m() + self.keep_m
    }

    /// Unit vector from the nearest point of the obstacle to `p`, and the clearance beyond the required distance.
    pub fn clearance(&self, p: Vec2) -> (Vec2, f64) {
        let offset = p - self.obstacle.closest_core_point(p);
        let (d, required) = (offset.norm(), self.required_m());
        if d > 1e-9 { (offset / d, d - required) } else { (Vec2::new(1.0, 0.0), -required) }
    }
}

/// Actuator limits and the period.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Largest speed, m/s.
    pub v_max_mps: f64,
    /// Largest turn rate to either side, rad/s.
    pub omega_max_radps: f64,
    /// Sampling period T, s.
    pub period_s: f64,
}

/// What one robot remembers from tick to tick. `Memory::default()` at start.
#[derive(Clone, Copy, Debug, Default)]
pub struct Memory {
    pub(super) started: bool,
    /// What was published last tick.
    pub(super) intent: Intent,
    pub(super) progress: Progress,
    /// Right-hand rule: motion left until it ends, and the clockwise turn it remembers.
    pub(super) fallback_s: f64,
    pub(super) beta_rad: f64,
    pub(super) plan: Plan,
    /// Seconds in a crowd since the plan was made, less than a period after it; 0 outside of a crowd.
    pub(super) crowded_s: f64,
    pub(super) around: Around,
    pub(super) way: Way,
    /// Time left to go straight and ask parked robots to make way.
    pub(super) ask_s: f64,
}

/// What anticipation has decided.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Plan {
    /// Heading to steer to, rad.
    pub(super) heading_rad: f64,
    /// Share of the full speed.
    pub(super) share: f64,
    /// Mean speed expected over the horizon, m/s.
    pub(super) mean_speed_mps: f64,
    /// Turn of the target about the robot, rad.
    pub(super) turn_rad: f64,
}

/// Whether the robot gets anywhere.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Progress {
    /// Seconds without progress; decays while the robot moves.
    pub(super) blocked_s: f64,
    /// Seconds since it last moved, and its net turn since then.
    pub(super) still_s: f64,
    pub(super) turned_rad: f64,
    /// Seconds waiting behind others at an opening.
    pub(super) queued_s: f64,
}

/// Passing a cluster of parked robots.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Around {
    /// 1 left, −1 right, 0 none.
    pub(super) side: f64,
    /// Seconds since the straight way was last blocked.
    pub(super) free_s: f64,
    /// Seconds spent going around.
    pub(super) spent_s: f64,
    /// How often the side was changed.
    pub(super) changes: f64,
}

/// Giving way.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Way {
    /// Time left aside, and rest before going aside again.
    pub(super) left_s: f64,
    pub(super) rest_s: f64,
    /// Whose way it is; the own id otherwise.
    pub(super) rank: u32,
    pub(super) spot_m: Vec2,
}

/// Heading and speed that one rule decides on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Drive {
    pub(super) heading_rad: f64,
    /// Unit vector of it.
    pub(super) direction: Vec2,
    pub(super) speed_cap_mps: f64,
    /// Mean speed to publish.
    pub(super) intent_speed_mps: f64,
}

/// What the programme receives.
#[derive(Clone, Copy, Debug)]
pub struct Guidance {
    /// Reference of the position certificate, m.
    pub reference_m: Vec2,
    /// Upper bound on v, m/s.
    pub speed_cap_mps: f64,
    /// Angle from the direction of the target to the reference, counter-clockwise positive.
    pub beta_rad: f64,
    /// To publish with the next snapshot.
    pub intent: Intent,
    /// No progress for more than a second.
    pub stalled: bool,
    /// An arrived robot leaves its goal for a moment: the programme must not hold it.
    pub leave_goal: bool,
}
