//! What the guidance layer reads and writes. Positions in m, headings in rad, world frame.

use nalgebra::Vector2;

/// Most neighbours considered; further ones are ignored (they are the farthest).
pub const NEIGHBOURS_MAX: usize = 16;
/// Most static obstacles considered.
pub const OBSTACLES_MAX: usize = 8;

/// The robot that decides, from the snapshot of this tick.
#[derive(Clone, Copy, Debug)]
pub struct Ego {
    pub id: u32,
    pub position_m: Vector2<f64>,
    pub heading_rad: f64,
    pub radius_m: f64,
    /// Where to go now: the goal itself, or the waypoint the route gives.
    pub target_m: Vector2<f64>,
    /// Route length left beyond `target_m`; 0 when the target is the goal.
    pub beyond_m: f64,
    pub v_mps: f64,
    pub omega_radps: f64,
    pub arrived: bool,
}

/// What a robot publishes besides its state: where it steers, and how fast it means to go.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Intent {
    pub heading_rad: f64,
    pub speed_mps: f64,
    /// Seconds without progress, for right of way.
    pub blocked_s: f64,
    /// The target turned by the virtual roundabout.
    pub target_m: Vector2<f64>,
    /// Own id, or the rank taken over from the robot this one gives way to.
    pub rank: u32,
}

/// Another robot, from the same snapshot.
#[derive(Clone, Copy, Debug, Default)]
pub struct Neighbour {
    pub id: u32,
    pub position_m: Vector2<f64>,
    pub heading_rad: f64,
    pub v_mps: f64,
    pub omega_radps: f64,
    /// Its target (goal or waypoint).
    pub target_m: Vector2<f64>,
    /// Required centre distance ρ_ij to this robot.
    pub required_distance_m: f64,
    pub arrived: bool,
    pub intent: Intent,
}

/// A static obstacle near the robot, reduced to its nearest point.
#[derive(Clone, Copy, Debug)]
pub enum ObstacleView {
    Circle { centre_m: Vector2<f64>, radius_m: f64, keep_m: f64 },
    Segment { from_m: Vector2<f64>, to_m: Vector2<f64>, keep_m: f64 },
}

impl ObstacleView {
    /// Unit vector from the obstacle to `p`, and the distance left beyond the required one.
    pub fn clearance(&self, p: Vector2<f64>) -> (Vector2<f64>, f64) {
        let (nearest, keep) = match *self {
            Self::Circle { centre_m, radius_m, keep_m } => (centre_m, radius_m + keep_m),
            Self::Segment { from_m, to_m, keep_m } => (nearest_on_segment(from_m, to_m, p), keep_m),
        };
        let offset = p - nearest;
        let d = offset.norm();
        if d > 1e-9 { (offset / d, d - keep) } else { (Vector2::new(1.0, 0.0), -keep) }
    }
}

/// Point of the segment nearest to `p`.
pub fn nearest_on_segment(a: Vector2<f64>, b: Vector2<f64>, p: Vector2<f64>) -> Vector2<f64> {
    let ab = b - a;
    let l2 = ab.norm_squared();
    if l2 < 1e-18 {
        return a;
    }
    a + ab * ((p - a).dot(&ab) / l2).clamp(0.0, 1.0)
}

/// Actuator limits and the period.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    pub v_max_mps: f64,
    pub omega_max_radps: f64,
    pub period_s: f64,
}

/// What one robot remembers from tick to tick.
#[derive(Clone, Copy, Debug, Default)]
pub struct Memory {
    /// What was published last tick.
    pub intent: Intent,
    /// Seconds without progress; decays when the robot moves.
    pub blocked_s: f64,
    /// Seconds since the robot last moved, and its net turn since then.
    pub still_s: f64,
    pub turned_rad: f64,
    /// Seconds left under the right-hand rule.
    pub fallback_s: f64,
    /// Clockwise rotation the right-hand rule remembers.
    pub beta_rad: f64,
    /// Side on which a cluster of parked robots is being passed: 1 left, −1 right, 0 none.
    pub queued_s: f64,
    pub side: f64,
    pub side_free_s: f64,
    /// Time spent passing it, and time left to go straight at it instead.
    pub around_s: f64,
    pub straight_s: f64,
    pub side_changes: f64,
    /// Giving way: time left, rest before doing so again, to which rank, and where to.
    pub give_way_s: f64,
    pub rest_s: f64,
    pub rank: u32,
    pub spot_m: Vector2<f64>,
    pub started: bool,
}

/// What the programme receives.
#[derive(Clone, Copy, Debug)]
pub struct Guidance {
    pub reference_m: Vector2<f64>,
    pub speed_cap_mps: f64,
    /// Angle from the direction of the target to the reference, counter-clockwise positive.
    pub beta_rad: f64,
    pub intent: Intent,
    pub stalled: bool,
    /// An arrived robot is asked to leave its goal for a moment.
    pub leave_goal: bool,
}

/// Angle in (−π, π].
pub fn wrap(angle: f64) -> f64 {
    use core::f64::consts::{PI, TAU};
    let a = angle - TAU * libm::floor((angle + PI) / TAU);
    if a <= -PI { a + TAU } else { a }
}

/// Unit vector of a heading.
pub fn unit(heading_rad: f64) -> Vector2<f64> {
    let (s, c) = libm::sincos(heading_rad);
    Vector2::new(c, s)
}

/// `v` turned counter-clockwise by the angle with this cosine and sine.
pub fn rotate(v: Vector2<f64>, cos: f64, sin: f64) -> Vector2<f64> {
    Vector2::new(v.x * cos - v.y * sin, v.x * sin + v.y * cos)
}

pub fn cross(a: Vector2<f64>, b: Vector2<f64>) -> f64 {
    a.x * b.y - a.y * b.x
}
