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

/// The one-sided derivatives at a point, and the largest kink between `lo` and it, `lo` for none.
struct Look {
    left: f64,
    right: f64,
    kink: f64,
}

/// A row as the walk meets it: its kink and its coefficient.
type Kinked = (f64, f64);

/// Where a row changes its sign; nowhere for one without a coefficient, whose bound is never negative.
pub(super) fn kink(row: &Row) -> f64 {
    if row.coefficient == 0.0 { f64::INFINITY } else { row.bound / row.coefficient }
}

/// Whether a row is positive just left and just right of `x`.
#[inline]
fn row_beside((kink, coefficient): Kinked, x: f64) -> (bool, bool) {
    if coefficient < 0.0 { (x <= kink, x < kink) } else { (x > kink, x >= kink) }
}

impl Positive {
    /// Whether it is just left and just right of `x`.
    #[inline]
    fn beside(self, x: f64) -> (bool, bool) {
        (x <= self.low || x > self.high, x < self.low || x >= self.high)
    }
}

fn sign_of_line(c: Certificate) -> Positive {
    if c.linear > 0.0 {
        Positive::above(-c.decrease / c.linear)
    } else if c.linear < 0.0 {
        Positive::below(-c.decrease / c.linear)
    } else if c.decrease > 0.0 {
        Positive::ALWAYS
    } else {
        Positive::NEVER
    }
}

/// An excess above this part of its terms is none of rounding, nor is that of the roots that it is taken for.
const CLEAR: f64 = 1e-12;

impl Piecewise<'_> {
    /// Where the certificate is positive; where that is everywhere from `lo` to `hi` for certain, without its roots.
    fn sign_of_certificate(&self) -> Positive {
        let c = self.certificate;
        if c.curvature == 0.0 {
            return sign_of_line(c);
        }
        if self.is_clear_of_roots() { Positive::ALWAYS } else { self.between_roots() }
    }

    fn between_roots(&self) -> Positive {
        let c = self.certificate;
        // The root that does not cancel first, the other through their product 2Q/q.
        let u = -c.linear - self.discriminant().sqrt().copysign(c.linear);
        let (one, other) = (u / c.curvature, if u == 0.0 { 0.0 } else { 2.0 * c.decrease / u });
        if one < other { Positive { low: one, high: other } } else { Positive { low: other, high: one } }
    }

    fn discriminant(&self) -> f64 {
        let c = self.certificate;
        c.linear * c.linear - 2.0 * c.curvature * c.decrease
    }

    /// Whether the certificate has no roots, or `lo` and `hi` are on the same side of both, their vertex being beyond
    /// the end that is nearer.
    #[inline]
    fn is_clear_of_roots(&self) -> bool {
        let (c, discriminant) = (self.certificate, self.discriminant());
        if discriminant.is_nan() || discriminant <= 0.0 {
            return c.curvature != 0.0;
        }
        let end = if c.linear < 0.0 { self.hi } else { self.lo };
        let turned = c.curvature * end;
        let scale = c.linear * c.linear + turned * turned;
        c.linear * (c.linear + turned) > 0.0 && c.excess(end) * c.curvature > CLEAR * scale
    }

    /// The unique minimiser.
    pub(super) fn minimise(&self) -> Minimum {
        self.walk(self.sign_of_certificate(), &self.rows.iter().map(|row| (kink(row), row.coefficient)))
    }

    /// The same with the kinks of all rows.
    #[expect(clippy::inline_always, reason = "most often it is but a line, of which nothing need be stored")]
    #[inline(always)]
    pub(super) fn minimise_with(self, kinks: &[f64]) -> Minimum {
        // Most have no rows, and without them there are but two kinks, mostly none.
        if self.rows.is_empty() && self.is_clear_of_roots() {
            self.only_line()
        } else {
            self.walk_along(kinks)
        }
    }

    #[inline(never)]
    fn walk_along(self, kinks: &[f64]) -> Minimum {
        let certificate = self.sign_of_certificate();
        if self.rows.is_empty() {
            self.walk(certificate, &std::iter::empty())
        } else {
            self.walk(certificate, &self.kinked(kinks))
        }
    }

    fn kinked(&self, kinks: &[f64]) -> impl Iterator<Item = Kinked> + Clone {
        kinks.iter().zip(self.rows).map(|(kink, row)| (*kink, row.coefficient))
    }

    /// Without rows, where the certificate is positive throughout: the derivative is one line.
    #[inline]
    fn only_line(&self) -> Minimum {
        let (certificate, derivative) =
            (Positive::ALWAYS, |x: f64| self.effort * x + self.weight * self.certificate.slope(x));
        let at_hi = derivative(self.hi);
        if at_hi <= 0.0 || self.hi <= self.lo {
            return Minimum { x: self.hi, right: at_hi, left: at_hi, certificate };
        }
        let at_lo = derivative(self.lo);
        if at_lo < 0.0 {
            let x = self.crossing(certificate, self.lo, self.hi, at_hi).clamp(self.lo, self.hi);
            return Minimum { x, right: 0.0, left: 0.0, certificate };
        }
        Minimum { x: self.lo, right: at_lo, left: at_lo, certificate }
    }

    /// From the upper end down, at most one step for each kink.
    #[inline]
    fn walk(&self, certificate: Positive, rows: &(impl Iterator<Item = Kinked> + Clone)) -> Minimum {
        let mut upper = self.hi;
        let mut at_upper = self.look(certificate, rows.clone(), upper);
        if at_upper.left <= 0.0 || self.hi <= self.lo {
            return Minimum { x: upper, right: at_upper.right, left: at_upper.left, certificate };
        }
        loop {
            let lower = at_upper.kink;
            let last = lower == self.lo;
            let at_lower = self.look(certificate, rows.clone(), lower);
            if at_lower.right < 0.0 {
                // The derivative crosses zero inside (lower, upper), where it is a line.
                let x = self.crossing(certificate, lower, upper, at_upper.left).clamp(lower, upper);
                return Minimum { x, right: 0.0, left: 0.0, certificate };
            }
            if last || at_lower.left <= 0.0 {
                return Minimum { x: lower, right: at_lower.right, left: at_lower.left, certificate };
            }
            (upper, at_upper) = (lower, at_lower);
        }
    }

    #[inline]
    fn look(&self, certificate: Positive, rows: impl Iterator<Item = Kinked>, x: f64) -> Look {
        let mut kink = self.lo;
        let mut offer = |k: f64| {
            if k < x && k > kink {
                kink = k;
            }
        };
        offer(certificate.low);
        offer(certificate.high);
        let only = |is: bool, term: f64| if is { term } else { 0.0 };
        let mut slopes = [0.0; 2];
        for row in rows {
            let (left, right) = row_beside(row, x);
            slopes[0] += only(left, row.1);
            slopes[1] += only(right, row.1);
            offer(row.0);
        }
        let (effort, slope) = (self.effort * x, self.weight * self.certificate.slope(x));
        let (left, right) = certificate.beside(x);
        Look {
            left: effort + only(left, slope) + self.row_weight * slopes[0],
            right: effort + only(right, slope) + self.row_weight * slopes[1],
            kink,
        }
    }

    /// Zero of the derivative's line on (lower, upper), given its value at `upper`'s left.
    fn crossing(&self, certificate: Positive, lower: f64, upper: f64, at_upper: f64) -> f64 {
        let (_, positive) = certificate.beside(lower);
        let slope =
            if positive { self.effort + self.weight * self.certificate.curvature } else { self.effort };
        upper - at_upper / slope
    }

    /// The multiplier of the certificate at the minimiser; those of the rows come in the place of their kinks.
    ///
    /// Rows that are positive carry their whole weight, rows that are not carry none, and rows with
    /// their kink at `x` share what is left of the derivative, in order.
    #[inline]
    pub(super) fn multipliers(&self, minimum: &Minimum, kinks: &mut [f64]) -> f64 {
        let Minimum { x, certificate, .. } = *minimum;
        // Start from the left derivative; every share given to a row at its kink raises it.
        let mut missing = if minimum.left > 0.0 {
            0.0 // held by the lower bound
        } else if minimum.right < 0.0 {
            f64::INFINITY // held by the upper bound: rows at their kink count as positive
        } else {
            -minimum.left
        };
        let mut share = |beside: (bool, bool), weight: f64, slope: f64| match beside {
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
        };
        let dual = if certificate == Positive::ALWAYS {
            self.weight
        } else {
            share(certificate.beside(x), self.weight, self.certificate.slope(x))
        };
        for (kink, row) in kinks.iter_mut().zip(self.rows) {
            *kink = share(row_beside((*kink, row.coefficient), x), self.row_weight, row.coefficient);
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Leaving out the roots changes no bit, however near to one of them an end of the interval is.
        #[test]
        fn an_interval_clear_of_the_roots_needs_none_of_them(
            linear in prop_oneof![-2.0..2.0f64, -1e-3..1e-3f64], curvature in prop_oneof![1e-6..2.0f64, 1e-3..1e-2f64],
            part in prop_oneof![-2.0..1.0f64, (1e-16..1e-3f64).prop_map(|by| 1.0 - by), Just(0.0)],
            lo in -4.0..=0.0f64, hi in prop_oneof![0.0..=4.0f64, 0.0..0.1f64],
            near in prop::option::of((any::<bool>(), any::<bool>(), -1e-3..1e-3f64, 0..5)),
            (effort, weight) in (0.01..2.0f64, 0.1..1e4f64),
        ) {
            // A part of the decrease from which on there are no roots.
            let decrease = part * linear * linear / (2.0 * curvature);
            let mut problem = Piecewise {
                effort,
                weight,
                certificate: Certificate { linear, curvature, decrease },
                row_weight: 1.0,
                rows: &[],
                lo,
                hi,
            };
            if problem.discriminant() <= 0.0 {
                return Ok(()); // rounded to where there are none
            }
            let roots = problem.between_roots();
            if let Some((low, lower_end, by, scale)) = near {
                let at = (if low { roots.low } else { roots.high }) * (1.0 + by * 1e-3f64.powi(scale));
                if lower_end { problem.lo = at.min(0.0) } else { problem.hi = at.max(0.0) }
            }
            let (short, long) = (problem.minimise_with(&[]), problem.walk(roots, &std::iter::empty()));
            let bits = |m: &Minimum| [m.x, m.left, m.right, problem.multipliers(m, &mut [])].map(f64::to_bits);
            prop_assert_eq!(bits(&short), bits(&long), "{:?} {:?} {:?}", problem, short, long);
        }
    }
}
