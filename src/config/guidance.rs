//! The tunables: unit, sign, and what goes wrong when one is set badly.
//!
//! One set of defaults serves every scenario; they come from a random search over 80 training scenarios and were checked
//! on other seeds and sizes.

use crate::document::Section;
use std::ops::Bound::{Excluded, Included};

/// Parameters of the guidance layer. None of them can endanger safety: the hard rows hold for any guidance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuidanceParams {
    /// m, robots farther than this are not looked at by any rule.
    pub sight_m: f64,

    // ---- Virtual roundabout (`roundabout`) ----
    /// m beyond ρ between the lanes of two robots that converge. Too small: rings shrink until they jam.
    /// Too large: needless detours.
    pub lane_gap_m: f64,
    /// s until closest approach from which a conflict counts. Too small: turns come too late for |ω| ≤ 1 rad/s.
    pub lane_horizon_s: f64,
    /// m of miss distance on the wrong (right) side from which the pair is left to pass there. Too large: robots
    /// swerve across each other's nose; 0: mirrored pairs choose different sides.
    pub lane_wrong_m: f64,
    /// rad, largest clockwise rotation. Near π/2 a full ring holds its radius; above, robots drive outward.
    pub lane_beta_max_rad: f64,
    /// Multiple of the lane at which neighbours on both sides count however late the conflict is. 0: rings of
    /// more than 100 robots shrink too far before anybody turns.
    pub lane_close: f64,
    /// Share of the turn taken when robots converge from one side only; anticipation handles those well.
    /// 1: detours in random traffic; 0: crossing pairs interfere more.
    pub lane_single: f64,

    // ---- Anticipation (`anticipate`) ----
    /// s, step of the prediction; 16 steps are the horizon. Too small: short-sighted; too large: coarse.
    pub step_s: f64,
    /// s for which a candidate heading, and a published one, is held before steering to the target again.
    pub hold_s: f64,
    /// m, neighbours farther than this are not predicted.
    pub range_m: f64,
    /// s of lost time that touching costs. Too small: contact and stops; too large: detours.
    pub prox_weight: f64,
    /// m beyond ρ within which closeness to a moving robot costs.
    pub prox_margin_m: f64,
    /// Fraction by which costs have faded at the end of the horizon, in [0, 1).
    pub prox_fade: f64,
    /// s of lost time for predicted overlap, per ρ of depth.
    pub overlap_weight: f64,
    /// s/rad for deflections to the left. Equal to `right_weight`, mirrored pairs deadlock.
    pub left_weight: f64,
    /// s/rad for deflections to the right; below `left_weight`, so that everybody keeps right.
    pub right_weight: f64,
    /// s/rad for changing the published heading. Too small: dithering; too large: slow reactions.
    pub hysteresis_weight: f64,
    /// s for driving at zero speed instead of full speed. Too large: robots never yield by slowing.
    pub slow_weight: f64,
    /// s for ending the prediction at a right angle to the target.
    pub turn_weight: f64,
    /// Cosine of the heading error at which driving starts. Low: wide arcs; high: turns on the spot.
    pub align_cos: f64,
    /// Fraction of the speed at which the arc would circle the target, in (0, 1]. Above 1 robots orbit.
    pub arc_gain: f64,
    /// 1/s, speed allowed per metre of clearance in the prediction (the hard row gives γ/(2T) = 6.25).
    pub row_rate: f64,
    /// m/s, a moving neighbour is predicted no slower than this.
    pub other_speed_min_mps: f64,
    /// m beyond ρ within which closeness to a parked robot costs.
    pub parked_margin_m: f64,
    /// m beyond ρ at which a robot stops short of another while it is not blocked.
    pub standoff_m: f64,

    /// m, nearer than which the sixteenth nearest robot makes a crowd.
    pub crowd_m: f64,
    /// s for which a robot in a crowd keeps to what anticipation decided. Too large: it reacts late. Up to a
    /// period: it decides every time.
    pub crowd_hold_s: f64,

    // ---- Way around parked robots (`bypass`) ----
    /// m, gaps between parked robots narrower than needed plus this are closed. Too large: goals inside a
    /// parked grid seem unreachable; too small: robots squeeze where a short detour is faster.
    pub pass_gap_m: f64,
    /// m beyond ρ to the edge that is steered for.
    pub bypass_room_m: f64,
    /// m by which the left way has to be shorter.
    pub bypass_left_m: f64,
    /// s of going around after which every gap that fits is tried, and parked robots may be passed closely.
    pub squeeze_s: f64,
    /// s of going around after which the robot goes straight and asks parked robots to make way.
    pub give_up_around_s: f64,

    // ---- Right-hand rule (`halfplane`) ----
    /// s without progress after which the right-hand rule takes over.
    pub blocked_enter_s: f64,
    /// s of motion for which the right-hand rule stays. Too small: it flickers.
    pub fallback_hold_s: f64,
    /// 1/s, approach speed allowed per metre beyond the margin.
    pub plane_gain: f64,
    /// m beyond ρ that the half-planes keep.
    pub plane_margin_m: f64,
    /// Fraction of the preferred speed below which the preferred direction is turned clockwise.
    pub eta: f64,
    /// rad, largest such turn.
    pub beta_max_rad: f64,
    /// rad by which that turn decays a step. Too large: the robot turns back into the jam.
    pub beta_decay_rad: f64,
    /// 1/rad, loss of speed with heading error.
    pub align_slope: f64,
    /// Fraction of full speed that counts as progress.
    pub moving_fraction: f64,
    /// s at rest after which the heading is made tangential to robots in contact.
    pub slide_after_s: f64,

    // ---- Queueing at openings (`queue`) ----
    /// m beyond ρ kept to those ahead. Too small: no room to turn at the opening.
    pub queue_gap_m: f64,
    /// s of waiting after which the queue is ignored.
    pub queue_patience_s: f64,

    // ---- Giving way (`giveway`) ----
    /// s another of higher rank must be blocked before this robot leaves its way.
    pub give_way_after_s: f64,
    /// s another robot must be blocked before a parked one leaves its place for it.
    pub parked_wait_s: f64,
    /// s for which it stays aside.
    pub give_way_s: f64,
    /// s before it may go aside again. Too small: it never gets anywhere itself.
    pub give_way_rest_s: f64,
    /// m beyond ρ within which it concerns itself.
    pub give_way_reach_m: f64,
    /// s blocked after which a robot asks parked ones to make way.
    pub ask_after_s: f64,
    /// s for which it asks.
    pub ask_s: f64,
    /// m of room it leaves the parked ones meanwhile. Too small: they cannot turn away.
    pub ask_room_m: f64,
}

impl Default for GuidanceParams {
    fn default() -> Self {
        Self {
            sight_m: 8.0,
            lane_gap_m: 0.459,
            lane_horizon_s: 9.51,
            lane_wrong_m: 0.155,
            lane_beta_max_rad: 1.5,
            lane_close: 1.26,
            lane_single: 0.6,
            step_s: 0.16,
            hold_s: 0.162,
            range_m: 8.0,
            prox_weight: 1.09,
            prox_margin_m: 0.388,
            prox_fade: 0.853,
            overlap_weight: 2.84,
            left_weight: 0.227,
            right_weight: 0.0674,
            hysteresis_weight: 0.153,
            slow_weight: 0.223,
            turn_weight: 0.129,
            align_cos: 0.541,
            arc_gain: 0.95,
            row_rate: 11.9,
            other_speed_min_mps: 0.513,
            parked_margin_m: 0.703,
            standoff_m: 0.0194,
            crowd_m: 3.0,
            crowd_hold_s: 0.64,
            pass_gap_m: 0.08,
            bypass_room_m: 0.05,
            bypass_left_m: 0.524,
            squeeze_s: 3.07,
            give_up_around_s: 14.0,
            blocked_enter_s: 0.505,
            fallback_hold_s: 0.471,
            plane_gain: 17.4,
            plane_margin_m: 0.21,
            eta: 0.333,
            beta_max_rad: 1.19,
            beta_decay_rad: 0.0659,
            align_slope: 1.84,
            moving_fraction: 0.0598,
            slide_after_s: 0.5,
            queue_gap_m: 0.5,
            queue_patience_s: 5.0,
            give_way_after_s: 1.76,
            parked_wait_s: 4.0,
            give_way_s: 2.64,
            give_way_rest_s: 1.04,
            give_way_reach_m: 0.554,
            ask_after_s: 6.0,
            ask_s: 8.0,
            ask_room_m: 0.3,
        }
    }
}

impl GuidanceParams {
    /// Reads a `[guidance]` section over these.
    pub(super) fn read(self, mut s: Section<'_>) -> Self {
        let mut p = self;
        s.set_number("sight_m", &mut p.sight_m, (Excluded(0.0), Included(1000.0)));
        s.set_number("lane_gap_m", &mut p.lane_gap_m, (Excluded(0.0), Included(100.0)));
        s.set_number("lane_horizon_s", &mut p.lane_horizon_s, (Excluded(0.0), Included(3600.0)));
        s.set_number("lane_wrong_m", &mut p.lane_wrong_m, (Excluded(0.0), Included(100.0)));
        s.set_number("lane_beta_max_rad", &mut p.lane_beta_max_rad, (Excluded(0.0), Included(3.2)));
        s.set_number("lane_close", &mut p.lane_close, (Excluded(0.0), Included(100.0)));
        s.set_number("lane_single", &mut p.lane_single, (Included(0.0), Included(1.0)));
        s.set_number("step_s", &mut p.step_s, (Excluded(0.0), Included(3600.0)));
        s.set_number("hold_s", &mut p.hold_s, (Excluded(0.0), Included(3600.0)));
        s.set_number("range_m", &mut p.range_m, (Excluded(0.0), Included(1000.0)));
        s.set_number("prox_weight", &mut p.prox_weight, (Included(0.0), Included(1000.0)));
        s.set_number("prox_margin_m", &mut p.prox_margin_m, (Excluded(0.0), Included(100.0)));
        s.set_number("prox_fade", &mut p.prox_fade, (Included(0.0), Excluded(1.0)));
        s.set_number("overlap_weight", &mut p.overlap_weight, (Included(0.0), Included(1000.0)));
        s.set_number("left_weight", &mut p.left_weight, (Included(0.0), Included(1000.0)));
        s.set_number("right_weight", &mut p.right_weight, (Included(0.0), Included(1000.0)));
        s.set_number("hysteresis_weight", &mut p.hysteresis_weight, (Included(0.0), Included(1000.0)));
        s.set_number("slow_weight", &mut p.slow_weight, (Included(0.0), Included(1000.0)));
        s.set_number("turn_weight", &mut p.turn_weight, (Included(0.0), Included(1000.0)));
        s.set_number("align_cos", &mut p.align_cos, (Excluded(-1.0), Excluded(1.0)));
        s.set_number("arc_gain", &mut p.arc_gain, (Excluded(0.0), Included(1.0)));
        s.set_number("row_rate", &mut p.row_rate, (Excluded(0.0), Included(100.0)));
        s.set_number("other_speed_min_mps", &mut p.other_speed_min_mps, (Excluded(0.0), Included(100.0)));
        s.set_number("parked_margin_m", &mut p.parked_margin_m, (Excluded(0.0), Included(100.0)));
        s.set_number("standoff_m", &mut p.standoff_m, (Excluded(0.0), Included(100.0)));
        s.set_number("crowd_m", &mut p.crowd_m, (Included(0.0), Included(1000.0)));
        s.set_number("crowd_hold_s", &mut p.crowd_hold_s, (Included(0.0), Included(3600.0)));
        s.set_number("pass_gap_m", &mut p.pass_gap_m, (Excluded(0.0), Included(100.0)));
        s.set_number("bypass_room_m", &mut p.bypass_room_m, (Excluded(0.0), Included(100.0)));
        s.set_number("bypass_left_m", &mut p.bypass_left_m, (Excluded(0.0), Included(100.0)));
        s.set_number("squeeze_s", &mut p.squeeze_s, (Excluded(0.0), Included(3600.0)));
        s.set_number("give_up_around_s", &mut p.give_up_around_s, (Excluded(0.0), Included(3600.0)));
        s.set_number("blocked_enter_s", &mut p.blocked_enter_s, (Excluded(0.0), Included(3600.0)));
        s.set_number("fallback_hold_s", &mut p.fallback_hold_s, (Excluded(0.0), Included(3600.0)));
        s.set_number("plane_gain", &mut p.plane_gain, (Excluded(0.0), Included(100.0)));
        s.set_number("plane_margin_m", &mut p.plane_margin_m, (Excluded(0.0), Included(100.0)));
        s.set_number("eta", &mut p.eta, (Excluded(0.0), Excluded(1.0)));
        s.set_number("beta_max_rad", &mut p.beta_max_rad, (Excluded(0.0), Included(3.2)));
        s.set_number("beta_decay_rad", &mut p.beta_decay_rad, (Excluded(0.0), Included(3.2)));
        s.set_number("align_slope", &mut p.align_slope, (Excluded(0.0), Included(100.0)));
        s.set_number("moving_fraction", &mut p.moving_fraction, (Excluded(0.0), Excluded(1.0)));
        s.set_number("slide_after_s", &mut p.slide_after_s, (Excluded(0.0), Included(3600.0)));
        s.set_number("queue_gap_m", &mut p.queue_gap_m, (Excluded(0.0), Included(100.0)));
        s.set_number("queue_patience_s", &mut p.queue_patience_s, (Excluded(0.0), Included(3600.0)));
        s.set_number("give_way_after_s", &mut p.give_way_after_s, (Excluded(0.0), Included(3600.0)));
        s.set_number("parked_wait_s", &mut p.parked_wait_s, (Excluded(0.0), Included(3600.0)));
        s.set_number("give_way_s", &mut p.give_way_s, (Excluded(0.0), Included(3600.0)));
        s.set_number("give_way_rest_s", &mut p.give_way_rest_s, (Excluded(0.0), Included(3600.0)));
        s.set_number("give_way_reach_m", &mut p.give_way_reach_m, (Excluded(0.0), Included(100.0)));
        s.set_number("ask_after_s", &mut p.ask_after_s, (Excluded(0.0), Included(3600.0)));
        s.set_number("ask_s", &mut p.ask_s, (Excluded(0.0), Included(3600.0)));
        s.set_number("ask_room_m", &mut p.ask_room_m, (Excluded(0.0), Included(100.0)));
        s.finish();
        p
    }
}
