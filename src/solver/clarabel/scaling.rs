//! What brings the data of a programme to order one, and back.

use crate::programme::{Certificate, Interval, Row};

/// An input that could move by less than this share of its admissible interval stays at 0.
const STILL: f64 = 1e-6;

/// An input that could move by less than this, m/s or rad/s, stays at 0 too: the speed left to a robot
/// that touches another.
const LEAST: f64 = 1e-7;

/// Half-width of the trust interval, as a share of the width that the solve was scaled with.
const TRUST: f64 = 1e-2;

/// Scales that undo the scaling of one solve.
#[derive(Clone, Copy)]
pub(super) struct Scales {
    pub(super) v: Axis,
    pub(super) omega: Axis,
    pub(super) position: Slack,
    pub(super) heading: Slack,
    pub(super) objective_v: f64,
    pub(super) objective_omega: f64,
}

/// δ = offset + scale·δ̂.
#[derive(Clone, Copy)]
pub(super) struct Slack {
    pub(super) offset: f64,
    pub(super) scale: f64,
}

/// x = lo + width·x̂.
#[derive(Clone, Copy)]
pub(super) struct Axis {
    pub(super) lo: f64,
    pub(super) width: f64,
    /// A width below this counts as 0.
    pub(super) still: f64,
}

impl Axis {
    /// The part of `interval` between 0 and the vertex of the certificate. The minimiser is there:
    /// every row holds at 0, and beyond the vertex all terms of the objective grow.
    pub(super) fn over(interval: Interval, certificate: Certificate) -> Self {
        let vertex = if certificate.curvature > 0.0 {
            -certificate.linear / certificate.curvature
        } else {
            f64::INFINITY.copysign(-certificate.linear)
        };
        let lo = interval.min.max(vertex.min(0.0));
        let hi = interval.max.min(vertex.max(0.0));
        // A way to go that vanishes beside what the input could do is rounding.
        let still = (STILL * (interval.max - interval.min)).max(LEAST);
        if hi - lo <= still {
            return Self { lo: 0.0f64.clamp(lo, hi.max(lo)), width: 0.0, still };
        }
        Self { lo, width: hi - lo, still }
    }

    /// Where the solution is looked for, given Clarabel's x.
    pub(super) fn trust(self, x: f64) -> Interval {
        let half = (TRUST * self.width).max(self.still);
        Interval { min: x - half, max: x + half }
    }

    /// The certificate in x̂.
    pub(super) fn certificate(self, c: Certificate) -> Certificate {
        Certificate {
            linear: c.slope(self.lo) * self.width,
            curvature: c.curvature * self.width * self.width,
            decrease: c.excess(self.lo),
        }
    }

    /// The row in x̂, divided by its largest term, and that term; `None` when it holds for every x̂
    /// in [0, 1].
    pub(super) fn row(self, row: Row) -> Option<(Row, f64)> {
        let (coefficient, bound) = (row.coefficient * self.width, row.bound - row.coefficient * self.lo);
        if coefficient.max(0.0) <= bound {
            return None;
        }
        let scale = or_one(coefficient.abs().max(bound.abs()));
        Some((Row { coefficient: coefficient / scale, bound: bound / scale }, scale))
    }
}

/// A place without a row, 0·x̂ ≤ 1, and the scale of its slack.
pub(super) const NO_ROW: (Row, f64) = (Row { coefficient: 0.0, bound: 1.0 }, 0.0);

/// 1 where a scale would be 0.
pub(super) fn or_one(scale: f64) -> f64 {
    if scale > 0.0 { scale } else { 1.0 }
}
