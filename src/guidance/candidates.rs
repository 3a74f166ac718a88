//! The candidates of a decision: what they cost before they are driven, and the best of them so far.

use super::Params;
use super::types::Plan;
use crate::geometry::wrap;

/// Candidate deflections, rad, counter-clockwise positive; near ones first, so that the rest is given up early.
pub(super) const DEFLECTIONS_RAD: [f64; 19] = [
    0.0, -0.06, 0.06, -0.12, 0.12, -0.2, 0.2, -0.3, 0.3, -0.42, 0.42, -0.6, 0.6, -0.85, 0.85, -1.15, 1.15,
    -1.5, -1.9,
];
/// Candidate shares of the full speed.
pub(super) const SPEEDS: [f64; 3] = [1.0, 0.6, 0.25];

/// What each deflection costs beside what the way does, s.
pub(super) type Biases = [f64; DEFLECTIONS_RAD.len()];

/// The bias of each deflection from `bearing`, with `previous_rad` steered to until now.
pub(super) fn biases(bearing: f64, previous_rad: f64, params: &Params) -> Biases {
    DEFLECTIONS_RAD.map(|deflection| {
        let side = if deflection > 0.0 { params.left_weight } else { params.right_weight };
        let change_rad = wrap(wrap(bearing + deflection) - previous_rad);
        side * deflection.abs() + params.hysteresis_weight * change_rad.abs()
    })
}

/// Deflections, those of the lowest bias first: the best is among the first more often than not, and what it costs
/// ends most of the others early.
pub(super) fn by_bias(biases: &Biases) -> [usize; DEFLECTIONS_RAD.len()] {
    let mut order = std::array::from_fn(|i| i);
    order.sort_unstable_by(|a: &usize, b| biases[*a].total_cmp(&biases[*b]).then(a.cmp(b)));
    order
}

/// The best candidate so far.
pub(super) struct Best {
    pub(super) cost: f64,
    /// Its place among all: of equal ones the first wins, in whatever order they are looked at.
    pub(super) rank: usize,
    pub(super) plan: Plan,
}

impl Best {
    /// The cost from which on the candidate of this place does not win.
    pub(super) fn give_up(&self, rank: usize) -> f64 {
        if rank < self.rank { self.cost.next_up() } else { self.cost }
    }

    pub(super) fn offer(
        &mut self,
        cost: f64,
        rank: usize,
        heading_rad: f64,
        share: f64,
        mean_speed_mps: f64,
    ) {
        if cost < self.give_up(rank) {
            *self = Self { cost, rank, plan: Plan { heading_rad, share, mean_speed_mps, turn_rad: 0.0 } };
        }
    }
}
