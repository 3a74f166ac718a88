//! The barrier row of robots that are disturbed: where they may be, and what a command adds to it.
//!
//! The true pose is not known, commands act late, wheels slip. [`Margin`] turns the bounds on all that
//! into the two numbers that a row needs: how far towards another body the robot may be or still get
//! on the commands that are out already ([`Reach::towards_m`]), and how far one more command may carry
//! it ([`Margin::approach`]). docs/MATH.md §2, Theorem 3.

use super::barrier::Approach;
use crate::model::{Command, Disturbance, Limits};

/// A gap below this counts as none, m: two robots that compute it in a different order agree on the
/// larger ones.
pub const CONTACT_M: f64 = 1e-9;

/// Lags after which a robot that was told to stop counts as standing for what is not ours.
const LAGS_TO_REST: f64 = 5.0;

/// What the bounds on the disturbances make of the rows; the same for all robots.
#[derive(Debug, Clone, Copy)]
pub struct Margin {
    bounds: Disturbance,
    period_s: f64,
    /// From the state to the instant at which the command begins to count: T, or 0 under ideal timing.
    ahead_s: f64,
    speed_mps: f64,
    turn_rate_radps: f64,
    reverses: bool,
}

/// Where a robot may be from the instant on at which the next command counts, if that is a stop.
///
/// A capsule: `error_m` around the segment from `behind_m` behind to `ahead_m` ahead of a point, which
/// lies `lead_m` ahead of the pose that the commands in force lead to.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Reach {
    /// Distance of that point from the pose, along the heading, m.
    pub lead_m: f64,
    /// Length of the segment behind it, m.
    pub behind_m: f64,
    /// Length of the segment ahead of it, m.
    pub ahead_m: f64,
    /// Radius, m.
    pub error_m: f64,
}

impl Reach {
    /// How far from its point it extends against a unit vector n, m; `along` = n·h.
    pub fn towards_m(&self, along: f64) -> f64 {
        self.error_m + (along * self.behind_m).max(-along * self.ahead_m).max(0.0)
    }

    /// How far from its point it extends anywhere, m.
    pub fn extent_m(&self) -> f64 {
        self.error_m + self.behind_m.max(self.ahead_m)
    }
}

impl Margin {
    /// For robots within `limits`, disturbed within `bounds`; `ahead_s` from the state to the instant
    /// at which the command begins to count.
    pub fn new(bounds: Disturbance, limits: &Limits, period_s: f64, ahead_s: f64) -> Self {
        Self {
            bounds,
            period_s,
            ahead_s,
            speed_mps: limits.speed_mps(),
            turn_rate_radps: limits.turn_rate_radps(),
            reverses: limits.v_min_mps < 0.0,
        }
    }

    /// Largest true turn rate Ω, rad/s.
    fn true_turn_rate_radps(&self) -> f64 {
        self.turn_rate_radps + self.bounds.turn_rate_radps
    }

    /// Largest error of the heading that the command counts from, rad.
    fn heading_error_rad(&self) -> f64 {
        let lagging =
            if self.ahead_s > 0.0 { 2.0 * self.turn_rate_radps * self.bounds.late_s() } else { 0.0 };
        self.bounds.heading_rad + self.bounds.turn_rate_radps * self.ahead_s + lagging
    }

    /// κ: how far sideways, and backwards, one metre of a new command's travel may lead, m/m.
    ///
    /// From 1 on no command is known to lead away from anything.
    pub fn spread(&self) -> f64 {
        let mean_s = 0.5 * self.period_s + self.bounds.late_s();
        self.heading_error_rad() + self.bounds.slip + self.true_turn_rate_radps() * mean_s
    }

    /// Where a robot may be that holds `command` and may still travel `remaining_m` on earlier ones.
    pub fn reach(&self, remaining_m: f64, command: Command) -> Reach {
        let (b, late_s) = (&self.bounds, self.bounds.late_s());
        let driven_m = command.v_mps.abs() * self.ahead_s;
        let turned_rad = command.omega_radps.abs() * self.ahead_s;
        let left_m = self.remaining_next_m(remaining_m, command);
        let turn = self.true_turn_rate_radps();
        let held = b.heading_rad
            + b.slip
            + 0.5 * b.turn_rate_radps * self.ahead_s
            + (2.0 * self.turn_rate_radps + turn) * late_s;
        let carried = b.heading_rad + b.slip + turned_rad + turn * late_s;
        let undone = self.heading_error_rad() + turn * late_s;
        let error_m = b.position_m + driven_m * held + remaining_m * carried + left_m * undone;
        let along_m = if self.ahead_s > 0.0 { remaining_m + left_m } else { remaining_m };
        if self.reverses {
            return Reach { lead_m: 0.0, behind_m: along_m, ahead_m: along_m, error_m };
        }
        Reach { lead_m: remaining_m, behind_m: along_m, ahead_m: 0.0, error_m }
    }

    /// Bound on the travel that is left at the instant at which the next command counts, m.
    fn remaining_next_m(&self, remaining_m: f64, command: Command) -> f64 {
        let b = &self.bounds;
        if self.ahead_s <= 0.0 {
            return remaining_m;
        }
        let v_mps = command.v_mps.abs();
        let acted_s = (self.ahead_s - b.delay_s).max(0.0);
        if b.lag_s <= 0.0 {
            return v_mps * b.delay_s;
        }
        let kept = libm::exp(-acted_s / b.lag_s);
        v_mps * (b.delay_s + b.lag_s * (1.0 - kept)) + remaining_m.min(self.speed_mps * b.lag_s) * kept
    }

    /// How far a unit of speed may lead towards a body within all time, s.
    ///
    /// `along` = n·h with n from the body, `blind` the sine of the largest angle between n and the true
    /// direction. Without a gap only motion that leads away for all of those is admitted.
    pub fn approach(&self, along: f64, gap_m: f64, blind: f64) -> Approach {
        let spread = self.spread();
        let one = |along: f64| {
            if leads_away(along, spread, blind) {
                0.0
            } else if gap_m > CONTACT_M {
                self.period_s * (spread - along).max(0.0)
            } else {
                self.period_s * (1.0 + spread)
            }
        };
        Approach { forward: one(along), backward: one(-along) }
    }

    /// Largest extent of any robot's reach, m.
    pub fn extent_max_m(&self) -> f64 {
        let fastest = Command { v_mps: self.speed_mps, omega_radps: self.turn_rate_radps };
        let reach = self.reach(self.speed_mps * self.bounds.late_s(), fastest);
        reach.extent_m() + reach.lead_m
    }

    /// Time after which a robot that was told to stop has less than 1 % of its speed, s.
    pub fn rest_s(&self) -> f64 {
        self.bounds.delay_s + LAGS_TO_REST * self.bounds.lag_s
    }

    /// How far travelling `way_m` within `elapsed_s` may lead from where the commands lead, m: by directions that
    /// are not the commands', and by slip.
    pub fn stray_m(&self, way_m: f64, elapsed_s: f64) -> f64 {
        way_m * (self.spread() + self.bounds.turn_rate_radps * elapsed_s)
    }

    /// What carrying a lost robot over `silent_s` may add to the error of its position, m.
    ///
    /// It is carried from its last good pose along the commands since. What earlier ones had still to
    /// travel there comes on top of those, and the doubt of the direction is one over both.
    pub fn lost_m(&self, silent_s: f64) -> f64 {
        let pending_m = self.speed_mps * self.bounds.late_s();
        let driven_m = self.speed_mps * silent_s + pending_m;
        pending_m + self.stray_m(driven_m, silent_s)
    }

    /// The bounds.
    pub fn bounds(&self) -> &Disturbance {
        &self.bounds
    }
}

/// Whether the directions within the cone of half-angle asin(`blind`) around n all have n·h ≥ `spread`.
fn leads_away(along: f64, spread: f64, blind: f64) -> bool {
    if blind >= 1.0 {
        return false;
    }
    let across = (1.0 - along * along).max(0.0).sqrt();
    along * (1.0 - blind * blind).sqrt() - across * blind >= spread
}
