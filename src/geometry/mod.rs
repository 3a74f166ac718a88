//! Planar geometry of a unicycle under a zero-order hold: angles, exact arcs and the exact
//! distance between things that move on them.
//!
//! World frame, metres, radians, counter-clockwise positive. Trigonometry has the bits of `libm` here and in
//! all that follows, so that results are the same on every platform. Nothing here allocates.

mod angle;
mod arc;
mod arcs;
mod distance;
mod grid;
mod shape;
mod timed;
mod trig;
mod way;

pub use angle::{bearing, rotate, unit, wrap};
pub use arc::{Arc, Integration, Pose, chord_factor, sinc};
pub use arcs::Arcs;
pub use distance::{Bound, min_distance_arc_point, min_distance_arc_segment, min_distance_arcs};
pub use grid::Grid;
pub use shape::{closest_point_on_segment, segment_distance};
pub use timed::{TimedArc, min_distance_timed};
pub use trig::sincos;
pub use way::Way;

/// A point or vector in the plane, metres.
pub type Vec2 = nalgebra::Vector2<f64>;
