//! What the guidance layer reads and writes. Positions in m, headings in rad, world frame.

use crate::geometry::{Vec2, closest_point_on_segment};
/// Most neighbours considered: the nearest ones, in the order given.
pub const NEIGHBOURS_MAX: usize = 16;
/// Most static obstacles considered.
pub const OBSTACLES_MAX: usize = 8;

/// The robot that decides, from the snapshot of this tick.
#[derive(Clone, Copy, Debug)]
pub struct Ego {
    pub id: u32,
    pub position_m: Vec2,
    pub heading_rad: f64,
    pub radius_m: f64,
    /// Where to go now: the goal itself, or the waypoint of `Route::target`.
    pub target_m: Vec2,
    /// Route length left beyond `target_m`; 0 when the target is the goal.
    pub beyond_m: f64,
    pub v_mps: f64,
    pub omega_radps: f64,
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

/// Another robot, from the same snapshot.
#[derive(Clone, Copy, Debug, Default)]
pub struct Neighbour {
    pub id: u32,
    pub position_m: Vec2,
    pub heading_rad: f64,
    pub v_mps: f64,
    pub omega_radps: f64,
    /// Its goal, or the waypoint it is heading for.
    pub target_m: Vec2,
    /// Required centre distance ρ_ij.
    pub required_distance_m: f64,
    pub arrived: bool,
    /// What it published last tick.
    pub intent: Intent,
}

/// Where a neighbour is, seen from a point.
#[derive(Clone, Copy, Debug)]
pub struct Bearing {
    /// Unit vector from the neighbour to the point (n_ij).
    pub normal: Vec2,
    pub distance_m: f64,
    /// Distance beyond the required one.
    pub gap_m: f64,
}

impl Neighbour {
    pub fn seen_from(&self, p: Vec2) -> Bearing {
        let offset = p - self.position_m;
        let distance_m = offset.norm().max(1e-6);
        Bearing { normal: offset / distance_m, distance_m, gap_m: distance_m - self.required_distance_m }
    }
}

/// A static obstacle and the distance to keep from it (d_s + radius).
#[derive(Clone, Copy, Debug)]
pub enum ObstacleView {
    Circle { centre_m: Vec2, radius_m: f64, keep_m: f64 },
    Segment { from_m: Vec2, to_m: Vec2, keep_m: f64 },
}

impl ObstacleView {
    /// Unit vector from the nearest point of the obstacle to `p`, and the clearance beyond the required distance.
    pub fn clearance(&self, p: Vec2) -> (Vec2, f64) {
        let (nearest, keep) = match *self {
            Self::Circle { centre_m, radius_m, keep_m } => (centre_m, radius_m + keep_m),
            Self::Segment { from_m, to_m, keep_m } => (closest_point_on_segment(p, from_m, to_m), keep_m),
        };
        let offset = p - nearest;
        let d = offset.norm();
        if d > 1e-9 { (offset / d, d - keep) } else { (Vec2::new(1.0, 0.0), -keep) }
    }
}

/// Actuator limits and the period.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    pub v_max_mps: f64,
    pub omega_max_radps: f64,
    pub period_s: f64,
}

/// What one robot remembers from tick to tick. `Memory::default()` at start and when its goal changes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Memory {
    pub started: bool,
    /// What was published last tick.
    pub intent: Intent,
    pub progress: Progress,
    /// Right-hand rule: motion left until it ends, and the clockwise turn it remembers.
    pub fallback_s: f64,
    pub beta_rad: f64,
    pub around: Around,
    pub way: Way,
    /// Time left to go straight and ask parked robots to make way.
    pub ask_s: f64,
}

/// Whether the robot gets anywhere.
#[derive(Clone, Copy, Debug, Default)]
pub struct Progress {
    /// Seconds without progress; decays while the robot moves.
    pub blocked_s: f64,
    /// Seconds since it last moved, and its net turn since then.
    pub still_s: f64,
    pub turned_rad: f64,
    /// Seconds waiting behind others at an opening.
    pub queued_s: f64,
}

/// Passing a cluster of parked robots.
#[derive(Clone, Copy, Debug, Default)]
pub struct Around {
    /// 1 left, −1 right, 0 none.
    pub side: f64,
    /// Seconds since the straight way was last blocked.
    pub free_s: f64,
    /// Seconds spent going around.
    pub spent_s: f64,
    /// How often the side was changed.
    pub changes: f64,
}

/// Giving way.
#[derive(Clone, Copy, Debug, Default)]
pub struct Way {
    /// Time left aside, and rest before going aside again.
    pub left_s: f64,
    pub rest_s: f64,
    /// Whose way it is; the own id otherwise.
    pub rank: u32,
    pub spot_m: Vec2,
}

/// Heading and speed that one rule decides on.
#[derive(Clone, Copy, Debug)]
pub struct Drive {
    pub heading_rad: f64,
    pub speed_cap_mps: f64,
    /// Mean speed to publish.
    pub intent_speed_mps: f64,
}

/// What the programme receives.
#[derive(Clone, Copy, Debug)]
pub struct Guidance {
    pub reference_m: Vec2,
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
