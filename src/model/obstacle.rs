use crate::geometry::{
    Arc, Bound, Vec2, closest_point_on_segment, min_distance_arc_point, min_distance_arc_segment,
};

/// A static convex obstacle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Obstacle {
    /// A disc.
    Circle {
        /// Centre, m.
        centre_m: Vec2,
        /// Radius, m; may be 0.
        radius_m: f64,
    },
    /// A thin wall.
    Segment {
        /// One end, m.
        from_m: Vec2,
        /// The other end, m.
        to_m: Vec2,
    },
}

impl Obstacle {
    /// Point of the obstacle's core (centre or segment) nearest to `p`, m.
    pub fn closest_core_point(&self, p: Vec2) -> Vec2 {
        match *self {
            Self::Circle { centre_m, .. } => centre_m,
            Self::Segment { from_m, to_m } => closest_point_on_segment(p, from_m, to_m),
        }
    }

    /// How far the body reaches from its core, m: the radius of a disc, 0 for a wall.
    pub fn reach_m(&self) -> f64 {
        match *self {
            Self::Circle { radius_m, .. } => radius_m,
            Self::Segment { .. } => 0.0,
        }
    }

    /// Distance from a point to the core, m.
    pub fn core_distance(&self, p: Vec2) -> f64 {
        (p - self.closest_core_point(p)).norm()
    }

    /// Smallest distance from a moving robot's centre to the core over [0, `horizon_s`].
    pub fn min_core_distance(&self, arc: &Arc, horizon_s: f64) -> Bound {
        match *self {
            Self::Circle { centre_m, .. } => min_distance_arc_point(arc, centre_m, horizon_s),
            Self::Segment { from_m, to_m } => min_distance_arc_segment(arc, from_m, to_m, horizon_s),
        }
    }
}
