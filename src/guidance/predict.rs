//! Where a robot will be, as everybody near it expects: turning to the heading that it published, holding it for
//! `hold_s`, then steering to its target.
//!
//! It depends on that robot alone, so it is worked out once a period, when somebody asks for it first.

use super::Params;
use super::types::{Limits, Neighbour};
use crate::geometry::{Vec2, rotate, unit};

/// Steps of the prediction.
pub(super) const STEPS: usize = 16;

/// Positions at the ends of the steps, m.
pub(super) type Path = [Vec2; STEPS];

/// The predictions of one period. Made once; neither allocates nor locks afterwards.
#[derive(Debug, Clone)]
pub struct Predictions {
    period: u32,
    /// The period in which each path was worked out.
    known: Vec<u32>,
    paths: Vec<Path>,
}

impl Predictions {
    /// With room for a fleet of `robots`.
    pub fn for_robots(robots: usize) -> Self {
        Self { period: 0, known: vec![0; robots], paths: vec![[Vec2::zeros(); STEPS]; robots] }
    }

    /// Forgets the last period.
    pub fn begin(&mut self) {
        self.period = self.period.wrapping_add(1);
        if self.period == 0 {
            self.known.fill(0);
            self.period = 1;
        }
    }

    /// Where `n` will be.
    pub(super) fn of(&mut self, n: &Neighbour, limits: &Limits, params: &Params) -> &Path {
        let path = &mut self.paths[n.index];
        if self.known[n.index] != self.period {
            self.known[n.index] = self.period;
            *path = predict(n, limits, params);
        }
        path
    }
}

/// Speed share for the cosine of the heading error.
pub(super) fn align(cos: f64, params: &Params) -> f64 {
    ((cos - params.align_cos) / (1.0 - params.align_cos)).clamp(0.0, 1.0)
}

/// The largest turn in one step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turn {
    pub(super) cos: f64,
    pub(super) sin: f64,
}

impl Turn {
    pub(super) fn new(limits: &Limits, params: &Params) -> Self {
        let (sin, cos) = libm::sincos(limits.omega_max_radps * params.step_s);
        Self { cos, sin }
    }

    /// `h` turned toward the unit vector `to` by at most one step.
    pub(super) fn toward(&self, h: Vec2, to: Vec2) -> Vec2 {
        if h.dot(&to) >= self.cos {
            to
        } else if h.perp(&to) >= 0.0 {
            rotate(h, self.cos, self.sin)
        } else {
            rotate(h, self.cos, -self.sin)
        }
    }
}

/// Turn to the published heading, hold it, then go to the target and stay there.
fn predict(n: &Neighbour, limits: &Limits, params: &Params) -> Path {
    let mut points = [n.position_m; STEPS];
    if n.arrived {
        return points;
    }
    let turn = Turn::new(limits, params);
    let dt = params.step_s;
    let published = unit(n.intent.heading_rad);
    let speed = n.intent.speed_mps.max(params.other_speed_min_mps);
    let (mut p, mut h, mut time) = (n.position_m, unit(n.heading_rad), 0.0);
    for point in &mut points {
        let to = n.intent.target_m - p;
        let left = to.norm();
        let aim = if time < params.hold_s || left < 1e-6 { published } else { to / left };
        h = turn.toward(h, aim);
        p += h * (speed * align(h.dot(&aim), params) * dt).min(left);
        *point = p;
        time += dt;
    }
    points
}
