//! Verification: no solution becomes a command before it has passed here.
//!
//! Written apart from the solvers, from the optimality conditions alone: [`Residuals`] checks
//! primal feasibility, dual feasibility, complementarity and stationarity of a solution of a
//! [`Programme`]. The controller checks the safety rows a second time against the bodies themselves,
//! with the exact motion of the command that is about to go out. Nothing here allocates.

mod disagreement;

pub use disagreement::Disagreement;

use crate::programme::{Certificate, Interval, Programme, Solution};

/// Largest relative violation of each optimality condition. All are 0 at an exact solution.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Residuals {
    /// Of the rows, the bounds and δ ≥ 0.
    pub primal: f64,
    /// Of the signs of the multipliers.
    pub dual: f64,
    /// Of multiplier × distance to the row = 0.
    pub complementarity: f64,
    /// Of the gradient of the Lagrangian.
    pub stationarity: f64,
}

impl Residuals {
    /// The residuals of `solution`; +∞ where a number is not finite or a length does not match.
    pub fn of(programme: &Programme, solution: &Solution) -> Self {
        if solution.slack_comfort.len() != programme.comfort.len()
            || solution.dual_comfort.len() != programme.comfort.len()
            || solution.dual_safety.len() != programme.safety.len()
        {
            return Self::REFUSED;
        }
        let mut check = Check::default();
        check.v(programme, solution);
        check.omega(programme, solution);
        check.residuals
    }

    /// The largest of the four.
    pub fn max(&self) -> f64 {
        self.primal.max(self.dual).max(self.complementarity).max(self.stationarity)
    }

    /// These and those of a row: by how much it is violated, how far its multiplier is from where it may be, and the
    /// product with the distance, against the sizes of multiplier and row. What is not finite, as `probe` tells
    /// (comparisons do not), is refused.
    #[inline(never)]
    fn with(self, [primal, sign, product]: [f64; 3], weight: f64, scale: f64, probe: f64) -> Self {
        let before = if probe.is_finite() { self } else { Self::REFUSED };
        Self {
            primal: larger(before.primal, relative(primal, scale)),
            dual: larger(before.dual, relative(sign, weight)),
            complementarity: larger(before.complementarity, relative(product, weight * (1.0 + scale))),
            ..before
        }
    }

    const REFUSED: Self = Self {
        primal: f64::INFINITY,
        dual: f64::INFINITY,
        complementarity: f64::INFINITY,
        stationarity: f64::INFINITY,
    };
}

#[derive(Default)]
struct Check {
    residuals: Residuals,
}

/// `value` against `scale`; anything not finite counts as infinitely wrong.
fn relative(value: f64, scale: f64) -> f64 {
    let r = value / (1.0 + scale);
    if r.is_finite() { r } else { f64::INFINITY }
}

/// The larger of two that are numbers.
fn larger(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}

/// Whether a row holds, its multiplier has its sign and their product is 0, as it mostly is to the last bit. Of what is
/// not finite the product is not 0.
#[inline]
fn is_met(excess: f64, dual: f64, product: f64) -> bool {
    excess <= 0.0 && dual >= 0.0 && product == 0.0
}

/// What is positive of a number.
fn positive(x: f64) -> f64 {
    larger(0.0, x)
}

/// Gradient of a Lagrangian, summed with the size of its terms.
#[derive(Default)]
struct Gradient {
    sum: f64,
    scale: f64,
}

impl Gradient {
    fn add(&mut self, term: f64) {
        self.sum += term;
        self.scale += term.abs();
    }
}

#[expect(clippy::inline_always, reason = "all is in registers, and hardly anything has to be measured")]
impl Check {
    /// A row `excess ≤ slack` with multiplier `dual` in [0, weight]; `scale` is the row's size.
    #[inline(always)]
    fn soft_row(&mut self, excess: f64, slack: f64, dual: f64, weight: f64, scale: impl Fn() -> f64) {
        // Both multipliers, λ of the row and w − λ of δ ≥ 0, against their distances.
        let (gap, rest) = (excess - slack, weight - dual);
        let products = [dual * gap, rest * slack];
        if !(is_met(gap, dual, products[0]) && is_met(-slack, rest, products[1])) {
            let primal = larger(positive(gap), positive(-slack));
            let sign = larger(positive(-dual), positive(-rest));
            let product = larger(products[0].abs(), products[1].abs());
            self.residuals =
                self.residuals.with([primal, sign, product], weight, scale(), excess + slack + dual + weight);
        }
    }

    /// A row `excess ≤ 0` with multiplier `dual` ≥ 0.
    #[inline(always)]
    fn hard_row(&mut self, excess: f64, dual: f64, scale: impl Fn() -> f64) {
        let product = dual * excess;
        if !is_met(excess, dual, product) {
            let (primal, sign) = (positive(excess), positive(-dual));
            self.residuals =
                self.residuals.with([primal, sign, product.abs()], dual.abs(), scale(), excess + dual);
        }
    }

    #[inline(always)]
    fn bounds(&mut self, x: f64, interval: Interval, duals: [f64; 2], gradient: &mut Gradient) {
        self.hard_row(interval.min - x, duals[0], || interval.min.abs());
        self.hard_row(x - interval.max, duals[1], || interval.max.abs());
        gradient.add(-duals[0]);
        gradient.add(duals[1]);
    }

    #[inline(always)]
    fn certificate(
        &mut self,
        c: Certificate,
        x: f64,
        slack: f64,
        dual: f64,
        weight: f64,
        gradient: &mut Gradient,
    ) {
        let scale = || (c.linear * x).abs() + 0.5 * c.curvature * x * x + c.decrease.abs();
        self.soft_row(c.excess(x), slack, dual, weight, scale);
        gradient.add(dual * c.linear);
        gradient.add(dual * c.curvature * x);
    }

    #[inline(always)]
    fn v(&mut self, programme: &Programme, s: &Solution) {
        let (w, v) = (&programme.weights, s.v_mps);
        let mut gradient = Gradient::default();
        gradient.add(w.v * v);
        self.certificate(programme.position, v, s.slack_position, s.dual_position, w.position, &mut gradient);
        for ((row, slack), dual) in programme.comfort.iter().zip(&s.slack_comfort).zip(&s.dual_comfort) {
            let scale = || (row.coefficient * v).abs() + row.bound.abs();
            self.soft_row(row.excess(v), *slack, *dual, w.comfort, scale);
            gradient.add(dual * row.coefficient);
        }
        for (row, dual) in programme.safety.iter().zip(&s.dual_safety) {
            self.hard_row(row.excess(v), *dual, || (row.coefficient * v).abs() + row.bound.abs());
            gradient.add(dual * row.coefficient);
        }
        self.bounds(v, programme.v_mps, s.dual_v, &mut gradient);
        self.stationary(&gradient);
    }

    #[inline(always)]
    fn omega(&mut self, programme: &Programme, s: &Solution) {
        let (w, omega) = (&programme.weights, s.omega_radps);
        let mut gradient = Gradient::default();
        gradient.add(w.omega * omega);
        self.certificate(programme.heading, omega, s.slack_heading, s.dual_heading, w.heading, &mut gradient);
        self.bounds(omega, programme.omega_radps, s.dual_omega, &mut gradient);
        self.stationary(&gradient);
    }

    #[inline(always)]
    fn stationary(&mut self, gradient: &Gradient) {
        let r = &mut self.residuals;
        r.stationarity = larger(r.stationarity, relative(gradient.sum.abs(), gradient.scale));
    }
}
