//! The scalar problem behind the exact solver:
//!
//! ```text
//! minimise  ½ r x² + w · max(0, c x + ½ q x² + Q) + w_r Σ_j max(0, a_j x − b_j)   over lo ≤ x ≤ hi
//! ```
//!
//! Convex and piecewise quadratic. Its breakpoints ("kinks") are the two roots of the certificate
//! and the points b_j/a_j. Between neighbouring kinks the derivative is one increasing line, so the
//! minimiser is found by walking from the upper end down: most programmes end at `hi` (a speed bound
//! or a safety row binds) after one evaluation.

use crate::programme::{Certificate, Row};

/// Where a row is positive: below `low` and above `high`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Positive {
    low: f64,
    high: f64,
}

impl Positive {
    const NEVER: Self = Self { low: f64::NEG_INFINITY, high: f64::INFINITY };
    const ALWAYS: Self = Self { low: f64::INFINITY, high: f64::INFINITY };

    fn above(kink: f64) -> Self {
        Self { high: kink, ..Self::NEVER }
    }

    fn below(kink: f64) -> Self {
        Self { low: kink, ..Self::NEVER }
    }
}

/// The scalar problem.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piecewise<'a> {
    /// r > 0.
    pub(super) effort: f64,
    /// w > 0.
    pub(super) weight: f64,
    /// c, q ≥ 0, Q.
    pub(super) certificate: Certificate,
    /// w_r > 0.
    pub(super) row_weight: f64,
    /// (a_j, b_j).
    pub(super) rows: &'a [Row],
    /// lo ≤ hi.
    pub(super) lo: f64,
    pub(super) hi: f64,
}

/// The minimiser and what the derivative says there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Minimum {
    pub(super) x: f64,
    /// Derivative from the right at x: what the bound holds back at `lo` when positive.
    pub(super) right: f64,
    /// Derivative from the left at x: what the bound holds back at `hi` when negative.
    pub(super) left: f64,
    /// Where the certificate is positive.
    certificate: Positive,
}

/// Which side of a point a one-sided derivative looks at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Left,
    Right,
}

/// Whether a row with these kinks is positive just beside `x`.
fn positive_beside(positive: Positive, x: f64, side: Side) -> bool {
    match side {
        Side::Left => x <= positive.low || x > positive.high,
        Side::Right => x < positive.low || x >= positive.high,
    }
}

fn sign_of_row(row: Row) -> Positive {
    if row.coefficient > 0.0 {
        Positive::above(row.bound / row.coefficient)
    } else if row.coefficient < 0.0 {
        Positive::below(row.bound / row.coefficient)
    } else if row.bound < 0.0 {
        Positive::ALWAYS
    } else {
        Positive::NEVER
    }
}

fn sign_of_certificate(c: Certificate) -> Positive {
    if c.curvature == 0.0 {
        return sign_of_row(Row { coefficient: c.linear, bound: -c.decrease });
    }
    let discriminant = c.linear * c.linear - 2.0 * c.curvature * c.decrease;
    if discriminant.is_nan() || discriminant <= 0.0 {
        return Positive::ALWAYS;
    }
    // The root that does not cancel first, the other through their product 2Q/q.
    let u = -c.linear - discriminant.sqrt().copysign(c.linear);
    let (one, other) = (u / c.curvature, if u == 0.0 { 0.0 } else { 2.0 * c.decrease / u });
    if one < other { Positive { low: one, high: other } } else { Positive { low: other, high: one } }
}

impl Piecewise<'_> {
    /// The derivative at `x` from one side, with these rows.
    #[inline]
    fn derivative(&self, certificate: Positive, rows: &[Row], x: f64, side: Side) -> f64 {
        let mut sum = self.effort * x;
        if positive_beside(certificate, x, side) {
            sum += self.weight * self.certificate.slope(x);
        }
        let mut slope = 0.0;
        for &row in rows {
            if positive_beside(sign_of_row(row), x, side) {
                slope += row.coefficient;
            }
        }
        sum + self.row_weight * slope
    }

    /// The largest kink strictly between `self.lo` and `below`.
    #[inline]
    fn next_kink(&self, certificate: Positive, rows: &[Row], below: f64) -> Option<f64> {
        let mut best = f64::NEG_INFINITY;
        let mut offer = |k: f64| {
            if k < below && k > self.lo && k > best {
                best = k;
            }
        };
        offer(certificate.low);
        offer(certificate.high);
        for &row in rows {
            let positive = sign_of_row(row);
            offer(positive.low);
            offer(positive.high);
        }
        (best > f64::NEG_INFINITY).then_some(best)
    }

    /// The unique minimiser. At most one step for each kink.
    pub(super) fn minimise(&self) -> Minimum {
        let certificate = sign_of_certificate(self.certificate);
        // Most have no rows, and without them there are but two kinks.
        if self.rows.is_empty() { self.walk(certificate, &[]) } else { self.walk(certificate, self.rows) }
    }

    #[inline]
    fn walk(&self, certificate: Positive, rows: &[Row]) -> Minimum {
        let mut upper = self.hi;
        let mut at_upper = self.derivative(certificate, rows, upper, Side::Left);
        if at_upper <= 0.0 || self.hi <= self.lo {
            let right = self.derivative(certificate, rows, upper, Side::Right);
            return Minimum { x: upper, right, left: at_upper, certificate };
        }
        loop {
            let kink = self.next_kink(certificate, rows, upper);
            let lower = kink.unwrap_or(self.lo);
            let at_lower = self.derivative(certificate, rows, lower, Side::Right);
            if at_lower < 0.0 {
                // The derivative crosses zero inside (lower, upper), where it is a line.
                let x = self.crossing(certificate, lower, upper, at_upper).clamp(lower, upper);
                return Minimum { x, right: 0.0, left: 0.0, certificate };
            }
            let left = self.derivative(certificate, rows, lower, Side::Left);
            if kink.is_none() || left <= 0.0 {
                return Minimum { x: lower, right: at_lower, left, certificate };
            }
            (upper, at_upper) = (lower, left);
        }
    }

    /// Zero of the derivative's line on (lower, upper), given its value at `upper`'s left.
    fn crossing(&self, certificate: Positive, lower: f64, upper: f64, at_upper: f64) -> f64 {
        let slope = if positive_beside(certificate, lower, Side::Right) {
            self.effort + self.weight * self.certificate.curvature
        } else {
            self.effort
        };
        upper - at_upper / slope
    }

    /// Multipliers of the certificate and of the rows at the minimiser.
    ///
    /// Rows that are positive carry their whole weight, rows that are not carry none, and rows with
    /// their kink at `x` share what is left of the derivative, in order.
    pub(super) fn multipliers(&self, minimum: &Minimum, rows: &mut [f64]) -> f64 {
        let Minimum { x, certificate, .. } = *minimum;
        // Start from the left derivative; every share given to a row at its kink raises it.
        let mut missing = if minimum.left > 0.0 {
            0.0 // held by the lower bound
        } else if minimum.right < 0.0 {
            f64::INFINITY // held by the upper bound: rows at their kink count as positive
        } else {
            -minimum.left
        };
        let mut share = |positive: Positive, weight: f64, slope: f64| {
            let (left, right) =
                (positive_beside(positive, x, Side::Left), positive_beside(positive, x, Side::Right));
            match (left, right) {
                (true, true) => weight,
                (false, false) => 0.0,
                (false, true) => {
                    let part = take(&mut missing, weight * slope.abs());
                    if slope == 0.0 { 0.0 } else { (part / slope.abs()).min(weight) }
                }
                (true, false) => {
                    let part = take(&mut missing, weight * slope.abs());
                    if slope == 0.0 { weight } else { (weight - part / slope.abs()).max(0.0) }
                }
            }
        };
        let dual = share(certificate, self.weight, self.certificate.slope(x));
        for (dual, row) in rows.iter_mut().zip(self.rows) {
            *dual = share(sign_of_row(*row), self.row_weight, row.coefficient);
        }
        dual
    }
}

/// Takes up to `most` from `missing`.
fn take(missing: &mut f64, most: f64) -> f64 {
    let part = missing.min(most);
    *missing -= part;
    part
}
