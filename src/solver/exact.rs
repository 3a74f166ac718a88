use super::piecewise::{Piecewise, kink};
use super::{Outcome, Solver};
use crate::programme::{Interval, Programme, Row, Solution};

/// The closed-form solver.
///
/// Separates the programme into its two scalar problems, walks their breakpoints, and reads the
/// multipliers off the one-sided derivatives. Worst case quadratic in the number of rows, typically
/// one evaluation. Never allocates when the solution was built with the programme's capacity.
#[derive(Debug, Clone, Copy, Default)]
pub struct ExactSolver;

impl Solver for ExactSolver {
    fn solve(&mut self, programme: &Programme, solution: &mut Solution) -> Outcome {
        if !programme.is_well_posed() {
            return Outcome::IllPosed;
        }
        solve_within(programme, solution, EVERYWHERE, EVERYWHERE);
        Outcome::Solved
    }
}

/// A force on an end of the trust interval this small against its terms is their rounding.
const ROUNDING: f64 = 1e-9;

const EVERYWHERE: Interval = Interval { min: f64::NEG_INFINITY, max: f64::INFINITY };

/// The minimiser with v and ω looked for in `v_trust` and `omega_trust` only; false when it would
/// lie outside of them, and `solution` is then not to be used.
pub(super) fn solve_within(
    programme: &Programme,
    solution: &mut Solution,
    v_trust: Interval,
    omega_trust: Interval,
) -> bool {
    // All that is not assigned below: inside its bounds an input has no multiplier of them.
    (solution.dual_v, solution.dual_omega) = ([0.0; 2], [0.0; 2]);
    solution.dual_safety.clear();
    solution.dual_safety.resize(programme.safety.len(), 0.0);
    solve_v(programme, solution, v_trust) && solve_omega(programme, solution, omega_trust)
}

/// The minimiser in ω alone, rad/s. The programme separates, so it is that of every solution of it.
pub fn optimal_turn_rate(programme: &Programme) -> f64 {
    heading_part(programme, programme.omega_radps).minimise_with(&[]).x
}

/// The minimiser in v alone, m/s.
pub fn optimal_speed(programme: &Programme) -> f64 {
    speed_part(programme, programme.admissible_v()).minimise().x
}

fn speed_part(programme: &Programme, interval: Interval) -> Piecewise<'_> {
    Piecewise {
        effort: programme.weights.v,
        weight: programme.weights.position,
        certificate: programme.position,
        row_weight: programme.weights.comfort,
        rows: &programme.comfort,
        lo: interval.min,
        hi: interval.max,
    }
}

fn heading_part(programme: &Programme, interval: Interval) -> Piecewise<'static> {
    Piecewise {
        effort: programme.weights.omega,
        weight: programme.weights.heading,
        certificate: programme.heading,
        row_weight: 1.0,
        rows: &[],
        lo: interval.min,
        hi: interval.max,
    }
}

fn solve_v(programme: &Programme, solution: &mut Solution, trust: Interval) -> bool {
    let w = &programme.weights;
    let ends = Ends::of(programme.v_mps, &programme.safety, trust);
    let problem = speed_part(programme, ends.interval);
    // The kinks stand where the multipliers will.
    solution.dual_comfort.clear();
    solution.dual_comfort.extend(programme.comfort.iter().map(kink));
    let minimum = problem.minimise_with(&solution.dual_comfort);
    let v = minimum.x;
    solution.v_mps = v;
    solution.dual_position = problem.multipliers(&minimum, &mut solution.dual_comfort);
    solution.slack_position = positive(programme.position.excess(v));
    solution.slack_comfort.clear();
    solution.slack_comfort.extend(programme.comfort.iter().map(|row| positive(row.excess(v))));
    let mut comfort = 0.0;
    for (dual, row) in solution.dual_comfort.iter().zip(&programme.comfort) {
        comfort += dual * row.coefficient;
    }
    let certificate = solution.dual_position * programme.position.slope(v);
    let force = w.v * v + certificate + comfort;
    match ends.holding(v, force) {
        None => true,
        Some(Binding::Safety(k)) => {
            solution.dual_safety[k] = -force / programme.safety[k].coefficient;
            true
        }
        Some(Binding::Limit) => {
            solution.dual_v = [positive(force), positive(-force)];
            true
        }
        Some(Binding::Trust) => force.abs() <= ROUNDING * (1.0 + certificate.abs() + comfort.abs()),
    }
}

fn solve_omega(programme: &Programme, solution: &mut Solution, trust: Interval) -> bool {
    let w = &programme.weights;
    let ends = Ends::of(programme.omega_radps, &[], trust);
    let problem = heading_part(programme, ends.interval);
    let minimum = problem.minimise_with(&[]);
    let omega = minimum.x;
    solution.omega_radps = omega;
    solution.dual_heading = problem.multipliers(&minimum, &mut []);
    solution.slack_heading = positive(programme.heading.excess(omega));
    let certificate = solution.dual_heading * programme.heading.slope(omega);
    let force = w.omega * omega + certificate;
    match ends.holding(omega, force) {
        None => true,
        Some(Binding::Trust) => force.abs() <= ROUNDING * (1.0 + certificate.abs()),
        Some(_) => {
            solution.dual_omega = [positive(force), positive(-force)];
            true
        }
    }
}

/// What is positive of a number.
fn positive(x: f64) -> f64 {
    if x > 0.0 { x } else { 0.0 }
}

/// What bounds an input from one side.
#[derive(Debug, Clone, Copy)]
enum Binding {
    Limit,
    Safety(usize),
    Trust,
}

/// The interval that the limits, the safety rows and the trust interval leave, and what is at its
/// ends.
struct Ends {
    interval: Interval,
    lower: Binding,
    upper: Binding,
}

impl Ends {
    fn of(limits: Interval, safety: &[Row], trust: Interval) -> Self {
        let mut ends = Self { interval: limits, lower: Binding::Limit, upper: Binding::Limit };
        for (k, row) in safety.iter().enumerate() {
            if row.coefficient > 0.0 {
                ends.below(row.bound / row.coefficient, Binding::Safety(k));
            } else if row.coefficient < 0.0 {
                ends.above(row.bound / row.coefficient, Binding::Safety(k));
            }
        }
        ends.below(trust.max, Binding::Trust);
        ends.above(trust.min, Binding::Trust);
        ends
    }

    fn below(&mut self, end: f64, binding: Binding) {
        if end < self.interval.max {
            (self.interval.max, self.upper) = (end, binding);
        }
    }

    fn above(&mut self, end: f64, binding: Binding) {
        if end > self.interval.min {
            (self.interval.min, self.lower) = (end, binding);
        }
    }

    /// What holds back the derivative `force` of the Lagrangian at `x`; `None` inside the interval.
    fn holding(&self, x: f64, force: f64) -> Option<Binding> {
        if x >= self.interval.max && force < 0.0 {
            Some(self.upper)
        } else if x <= self.interval.min && force > 0.0 {
            Some(self.lower)
        } else {
            None
        }
    }
}
